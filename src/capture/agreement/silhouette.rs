//! Silhouettes of a mesh against masks, in small versions of a capture's views.

use super::contrast::{Contrast, contrast};
use crate::capture::CaptureFrame;
use crate::mesh::Mesh;
use crate::surface::raster::{NO_TRIANGLE, check_work, rasterise};
use crate::views::Camera;
use glam::DVec3;

/// Longest side of a view while it is looked at, in pixels.
const SIDE: f64 = 160.0;
/// A mask of a greater share of its photograph cuts nothing out, and tells nothing.
const FULL: f64 = 0.98;

/// A view at the size at which it is looked at.
#[derive(Debug)]
pub(in crate::capture) struct SmallView {
    pub(super) camera: Camera,
    /// `None` where the photograph has no mask, or one that cuts nothing out.
    pub(super) mask: Option<Vec<bool>>,
    /// Of the photograph with the specular reflection blocked, where there is one.
    pub(super) contrast: Contrast,
}

impl SmallView {
    pub(in crate::capture) fn new(frame: &CaptureFrame) -> Self {
        let camera = &frame.view.camera;
        let small = camera.reduced(SIDE);
        let (width, height) = (small.width, small.height);
        let factor = [f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height)];
        let mask = frame.mask.as_ref().map(|mask| {
            let at = |x: u32, y: u32| {
                let [x, y] =
                    [(x, factor[0]), (y, factor[1])].map(|(at, factor)| ((f64::from(at) + 0.5) / factor) as usize);
                *mask.value_at(x.min(mask.width - 1), y.min(mask.height - 1))
            };
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect::<Vec<bool>>()
        });
        let tells = |mask: &Vec<bool>| (mask.iter().filter(|&&shown| shown).count() as f64) < FULL * mask.len() as f64;
        let photograph = frame.cross.as_ref().unwrap_or(&frame.photograph);
        SmallView {
            camera: small,
            mask: mask.filter(tells),
            contrast: contrast(photograph, width as usize, height as usize),
        }
    }
}

/// Numbers of one view's pixels.
#[derive(Default, Clone, Copy)]
pub(super) struct SilhouetteCounts {
    pub(super) covered: u64,
    pub(super) front: u64,
    pub(super) masked: u64,
    pub(super) both: u64,
}

pub(super) fn count(mesh: &Mesh, camera: &Camera, mask: Option<&[bool]>) -> SilhouetteCounts {
    let mut counts = SilhouetteCounts::default();
    // A mesh so large or so near that drawing it is no bounded work is not what the photograph shows.
    if check_work(mesh, camera).is_err() {
        counts.masked = mask.map_or(0, |mask| mask.iter().filter(|&&shown| shown).count() as u64);
        return counts;
    }
    let raster = rasterise(mesh, camera);
    let centre = DVec3::from_array(camera.centre());
    for (index, &triangle) in raster.triangle.iter().enumerate() {
        let covered = triangle != NO_TRIANGLE;
        let masked = mask.is_some_and(|mask| mask[index]);
        counts.masked += u64::from(masked);
        counts.both += u64::from(covered && masked);
        counts.covered += u64::from(covered);
        if covered {
            let [a, b, c] =
                mesh.triangles[triangle as usize].map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
            counts.front += u64::from((b - a).cross(c - a).dot(centre - a) > 0.0);
        }
    }
    counts
}

pub(super) fn iou(counts: &SilhouetteCounts) -> f64 {
    counts.both as f64 / (counts.covered + counts.masked - counts.both).max(1) as f64
}
