//! Scratch buffers reused between views (not zeroed), and the number of views that the memory budget allows side by side.

use super::order::OrderEntry;
use super::{DecodedSignal, DecodedView, PlaneCoding};
use crate::limits::Budget;
use crate::transform::masked::{Coefficients, PixelScratch};
use crate::transform::shape_adaptive::ColourLanes;
use crate::transform::shape_adaptive::TransformScratch;
use crate::transform::synthesis::HalfPicture;
use crate::transform::window::Window;
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
    /// Photographs, and low bands after level 1.
    signals: [Vec<PixelScratch>; 2],
    coefficients: Vec<Coefficients>,
}

impl PlaneWorkspaces {
    fn free(&self) -> MutexGuard<'_, FreeWorkspaces> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Runs `work` with a workspace of its own.
    pub(crate) fn with<T>(&self, work: impl FnOnce(&mut PlaneWorkspace) -> T) -> T {
        let mut free = self.free();
        let mut workspace = free.workspaces.pop().unwrap_or_default();
        for (level, signals) in free.signals.iter_mut().enumerate() {
            if let Some(signal) = signals.pop() {
                workspace.transform.recycle(level, signal);
            }
        }
        if workspace.coefficients.bytes() == 0 {
            workspace.coefficients = free.coefficients.pop().unwrap_or_default();
        }
        drop(free);
        let result = work(&mut workspace);
        self.free().workspaces.push(workspace);
        result
    }
    /// Returns a view's signals to the pool.
    pub(crate) fn recycle(&self, view: &mut DecodedView) {
        let mut free = self.free();
        for signal in view.signals.drain(..) {
            match signal {
                DecodedSignal::Whole(pixels) => free.signals[0].push(pixels.into_scratch()),
                DecodedSignal::Half(HalfPicture { low, coefficients }) => {
                    free.signals[1].push(low.into_scratch());
                    free.coefficients.push(coefficients);
                }
            }
        }
    }
    /// Frees the pool unless its size and `bytes` more are left of the budget.
    pub(crate) fn free_for(&self, budget: &Budget, bytes: u64) {
        let mut free = self.free();
        let workspaces = free.workspaces.iter().map(|w| w.coefficients.bytes() + w.transform.bytes());
        let signals = free.signals.iter().flatten().map(PixelScratch::bytes);
        let kept: u64 = workspaces.chain(signals).chain(free.coefficients.iter().map(Coefficients::bytes)).sum();
        if budget.left() < kept.saturating_add(bytes) {
            *free = FreeWorkspaces::default();
        }
    }
}

/// Bytes for each pixel of a view, and for each of its predicted picture, while it is drawn.
const DRAWING_BYTES: [u64; 2] = [8, 64];
/// Bytes for each pixel of a view's window, and for each of these and component, while it is decoded.
const CODING_BYTES: [u64; 2] = [12, 40];
/// Bytes for each pixel of the predicted picture's window, and for each of these and component, besides.
const PREDICTION_BYTES: [u64; 2] = [36, 112];
/// Bytes for each pixel of the predicted picture while the model is drawn in it, and for each of its window's and component while it corrects the
/// prediction.
const MODEL_DRAWING_BYTES: u64 = 64;
const CORRECTION_BYTES: u64 = 80;
/// Adaptive state of a component.
pub(crate) const MODEL_BYTES: u64 = 300_000;
/// Bytes for each pixel of a photograph that is handed out: its mask, and each component.
const PHOTOGRAPH_BYTES: [u64; 2] = [1, 12];

/// What the memory that a view takes depends on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ViewSize {
    /// Pixels of the view, or of its window.
    pixels: u64,
    components: u64,
    /// Levels of the transform above the predicted picture.
    level: u64,
    /// Models of each component that are there at once: those of the base and of the tiles that others start from.
    models: u64,
    /// Whether the reflectance corrects the prediction.
    is_modelled: bool,
}

impl ViewSize {
    pub(crate) fn new(camera: &Camera, coding: &PlaneCoding) -> Self {
        let grid = coding.tile_grid(camera);
        ViewSize {
            pixels: camera.width as u64 * camera.height as u64,
            components: coding.components.len() as u64,
            level: grid.levels() as u64,
            models: 1
                + (2..=grid.levels())
                    .map(|level| grid.level_tiles(level).iter().product::<usize>() as u64)
                    .sum::<u64>(),
            is_modelled: coding.is_modelled,
        }
    }
    /// The same of a window of the view.
    pub(crate) fn within(self, window: &Window) -> Self {
        ViewSize { pixels: window.pixel_count(), ..self }
    }
    fn low_pixels(&self) -> u64 {
        self.pixels >> (2 * self.level)
    }
    /// Bytes that it takes while it is drawn.
    pub(crate) fn drawing_bytes(&self) -> u64 {
        let each = DRAWING_BYTES[1] + if self.is_modelled { MODEL_DRAWING_BYTES } else { 0 };
        let drawn = self.low_pixels().saturating_mul(each);
        if self.level == 0 { drawn } else { drawn.saturating_add(self.pixels.saturating_mul(DRAWING_BYTES[0])) }
    }
    /// Bytes that it takes while it is decoded, `pixels` those of its window: the photograph, or only what others are predicted from.
    pub(crate) fn coding_bytes(&self, is_photograph: bool) -> u64 {
        let bytes =
            |pixels: u64, [each, component]: [u64; 2]| pixels.saturating_mul(each + component * self.components);
        let whole = bytes(self.pixels, if is_photograph { CODING_BYTES } else { [CODING_BYTES[0], 0] });
        let models = self.models.saturating_mul(MODEL_BYTES * self.components);
        let correction = if self.is_modelled { CORRECTION_BYTES } else { 0 };
        let predicted = bytes(self.low_pixels(), [PREDICTION_BYTES[0], PREDICTION_BYTES[1] + correction]);
        whole.saturating_add(predicted).saturating_add(models)
    }
}

/// Bytes of a photograph.
pub(crate) fn photograph_bytes(camera: &Camera, components: usize) -> u64 {
    let pixels = camera.width as u64 * camera.height as u64;
    pixels.saturating_mul(PHOTOGRAPH_BYTES[0] + PHOTOGRAPH_BYTES[1] * components as u64)
}

/// Peak memory in bytes of decoding a view and handing it out; less is charged if its window is smaller than the image.
pub(crate) fn peak_bytes(camera: &Camera, coding: &PlaneCoding) -> u64 {
    let size = ViewSize::new(camera, coding);
    (size.drawing_bytes().saturating_add(size.coding_bytes(true)))
        .saturating_add(photograph_bytes(camera, coding.components.len()))
}

/// Most views that are coded side by side, so that memory does not grow with the threads.
pub(super) const MAX_PARALLEL_VIEWS: usize = 8;
/// Views that are coded side by side where there are few threads, as they do not all take the same time. More would only hold more references.
pub(super) const LEAST_PARALLEL_VIEWS: usize = 4;

/// Memory budget of views that are coded side by side.
pub(crate) struct ParallelBudget<'a> {
    pub views: &'a [View],
    pub coding: &'a PlaneCoding,
    pub budget: &'a Budget,
    /// Bytes of what is drawn in each view besides its own, see [`PredictionScene::drawing_bytes`](super::PredictionScene::drawing_bytes).
    pub drawing_bytes: u64,
    /// Bytes of what is coded side by side, beyond which it is no more than one view, whatever the budget has.
    pub most: u64,
    pub workspaces: &'a PlaneWorkspaces,
}

impl ParallelBudget<'_> {
    /// Returns how many of the first of these entries the budget has room for, whatever their masks, and one at least: its
    /// actual size is charged when its mask is known.
    pub(crate) fn parallel_views(&self, order: &[OrderEntry], steps: &[usize]) -> usize {
        let (mut count, mut bytes) = (0, 0u64);
        for &step in steps.iter().take(MAX_PARALLEL_VIEWS) {
            let peak = peak_bytes(&self.views[order[step].view].camera, self.coding);
            let more = bytes.saturating_add(peak).saturating_add(self.drawing_bytes);
            if count > 0 && more > self.budget.left().min(self.most) {
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
