//! Scratch buffers reused between views (not zeroed), and the number of views that the memory budget allows side by side.

use super::order::OrderEntry;
use super::{DecodedView, PlaneCoding};
use crate::limits::Budget;
use crate::transform::masked::{Coefficients, MaskedPixels, PixelScratch};
use crate::transform::shape_adaptive::ColourLanes;
use crate::transform::shape_adaptive::TransformScratch;
use crate::views::{Camera, View};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Scratch buffers of one component of a view.
#[derive(Debug, Default)]
pub(crate) struct PlaneWorkspace {
    pub coefficients: Coefficients,
    pub transform: TransformScratch,
}

/// Pool of scratch buffers that are not in use.
#[derive(Debug, Default)]
pub(crate) struct PlaneWorkspaces(Mutex<FreeWorkspaces>);

#[derive(Debug, Default)]
struct FreeWorkspaces {
    workspaces: Vec<PlaneWorkspace>,
    signals: Vec<PixelScratch>,
}

impl PlaneWorkspaces {
    fn free(&self) -> MutexGuard<'_, FreeWorkspaces> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Runs `work` with a workspace of its own.
    pub(crate) fn with<T>(&self, work: impl FnOnce(&mut PlaneWorkspace) -> T) -> T {
        let mut free = self.free();
        let mut workspace = free.workspaces.pop().unwrap_or_default();
        workspace.transform.recycle(0, free.signals.pop().unwrap_or_default());
        drop(free);
        let result = work(&mut workspace);
        self.free().workspaces.push(workspace);
        result
    }
    /// Returns a view's signals to the pool.
    pub(crate) fn recycle(&self, view: &mut DecodedView) {
        self.free().signals.extend(view.signals.drain(..).map(MaskedPixels::into_scratch));
    }
    /// Frees the pool unless its size and `bytes` more are left of the budget.
    pub(crate) fn free_for(&self, budget: &Budget, bytes: u64) {
        let mut free = self.free();
        let workspaces = free.workspaces.iter().map(|w| w.coefficients.bytes() + w.transform.bytes());
        let kept: u64 = workspaces.chain(free.signals.iter().map(PixelScratch::bytes)).sum();
        if budget.left() < kept.saturating_add(bytes) {
            *free = FreeWorkspaces::default();
        }
    }
}

/// Bytes for each pixel of a view while it is drawn.
const DRAWING_BYTES: u64 = 64;
/// Bytes for each pixel of a view's window, and for each of these and component, while it is decoded.
const CODING_BYTES: [u64; 2] = [48, 152];
/// Adaptive state of a component.
pub(crate) const MODEL_BYTES: u64 = 300_000;
/// Bytes for each pixel of a photograph that is handed out: its mask, and each component.
const PHOTOGRAPH_BYTES: [u64; 2] = [1, 12];

fn pixels(camera: &Camera) -> u64 {
    camera.width as u64 * camera.height as u64
}

/// Bytes that a view takes while it is drawn.
pub(crate) fn drawing_bytes(camera: &Camera) -> u64 {
    pixels(camera).saturating_mul(DRAWING_BYTES)
}

/// Bytes that a view takes while it is decoded, from the number of its window's pixels.
pub(crate) fn coding_bytes(window_pixels: u64, coding: &PlaneCoding) -> u64 {
    let components = coding.components.len() as u64;
    window_pixels
        .saturating_mul(CODING_BYTES[0] + CODING_BYTES[1] * components)
        .saturating_add(MODEL_BYTES * components)
}

/// Bytes of a photograph.
pub(crate) fn photograph_bytes(camera: &Camera, components: usize) -> u64 {
    pixels(camera).saturating_mul(PHOTOGRAPH_BYTES[0] + PHOTOGRAPH_BYTES[1] * components as u64)
}

/// Peak memory in bytes of decoding a view and handing it out; less is charged if its window is smaller than the image.
pub(crate) fn peak_bytes(camera: &Camera, coding: &PlaneCoding) -> u64 {
    (drawing_bytes(camera).saturating_add(coding_bytes(pixels(camera), coding)))
        .saturating_add(photograph_bytes(camera, coding.components.len()))
}

/// Most views that are coded side by side, so that memory does not grow with the threads.
const MAX_PARALLEL_VIEWS: usize = 8;

/// Memory budget of views that are coded side by side.
pub(crate) struct ParallelBudget<'a> {
    pub views: &'a [View],
    pub coding: &'a PlaneCoding,
    pub budget: &'a Budget,
    pub workspaces: &'a PlaneWorkspaces,
}

impl ParallelBudget<'_> {
    /// Returns how many of the first of these entries the budget has room for, whatever their masks, and one at least: its
    /// actual size is charged when its mask is known.
    pub(crate) fn parallel_views(&self, order: &[OrderEntry], steps: &[usize]) -> usize {
        let (mut count, mut bytes) = (0, 0u64);
        for &step in steps.iter().take(MAX_PARALLEL_VIEWS) {
            let more = bytes.saturating_add(peak_bytes(&self.views[order[step].view].camera, self.coding));
            if count > 0 && more > self.budget.left() {
                break;
            }
            (count, bytes) = (count + 1, more);
        }
        self.workspaces.free_for(self.budget, bytes);
        count
    }
}

/// Signal of a component: the sqrt domain, rotated, row-major in the view's window.
pub(crate) type PlaneSignal = Vec<ColourLanes>;
