//! Pixels at the most that their files hold: what they show was brighter.

use super::CaptureFrame;
use crate::image::Mask;
use crate::mesh::Mesh;
use crate::surface::raster::{check_work, rasterise};
use serde::Serialize;

/// Share of the object that is told of without being asked.
const TOLD: f64 = 0.001;
/// Longest side at which the mesh is drawn where there is no mask, in pixels.
const SIDE: f64 = 320.0;

/// Clipped pixels of a capture's photographs, within the masks, or where the mesh is if there are none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Clipping {
    /// Pixels of which a colour is the largest number of its file's format: of integers, or of half floats.
    pub pixels: u64,
    /// Pixels of the object in the photographs that have clipped ones.
    pub object_pixels: u64,
    /// Photographs with clipped pixels.
    pub photographs: usize,
}

impl Clipping {
    /// Counts the clipped pixels of a frame that show the object.
    pub(super) fn of_frame(clipped: &Mask, frame: &CaptureFrame, mesh: &Mesh) -> Self {
        let drawn = if frame.mask.is_none() { covered(frame, mesh) } else { None };
        let Some(object) = frame.mask.as_ref().or(drawn.as_ref()) else { return Clipping::default() };
        let pairs = clipped.data.iter().zip(&object.data);
        let pixels = pairs.filter(|(clipped, shown)| **clipped && **shown).count() as u64;
        match pixels {
            0 => Clipping::default(),
            _ => Clipping { pixels, object_pixels: object.count() as u64, photographs: 1 },
        }
    }

    /// Adds another frame's.
    pub(super) fn merge(&mut self, other: Clipping) {
        self.pixels += other.pixels;
        self.object_pixels += other.object_pixels;
        self.photographs += other.photographs;
    }

    /// Returns the share of the object's pixels in the photographs that have clipped ones, 0 to 1.
    pub fn share(&self) -> f64 {
        self.pixels as f64 / self.object_pixels.max(1) as f64
    }

    /// A warning, if there is a noteworthy share.
    pub(super) fn warning(&self, frames: usize) -> Option<String> {
        (self.share() >= TOLD).then(|| {
            format!(
                "{} pixels in {} of {frames} photographs are at the most that their files hold, {:.2} % of the object there: their highlights are \
                 clipped, and measured too dark; expose less, or merge exposures into EXR",
                self.pixels,
                self.photographs,
                100.0 * self.share()
            )
        })
    }
}

/// The pixels of a frame that the mesh covers, as a small drawing of it says.
fn covered(frame: &CaptureFrame, mesh: &Mesh) -> Option<Mask> {
    let camera = &frame.view.camera;
    let small = camera.reduced(SIDE);
    let factor = [f64::from(small.width) / f64::from(camera.width), f64::from(small.height) / f64::from(camera.height)];
    check_work(mesh, &small).ok()?;
    let drawn = rasterise(mesh, &small);
    let (width, height) = (camera.width as usize, camera.height as usize);
    let at = |position: usize, factor: f64, size: usize| (((position as f64 + 0.5) * factor) as usize).min(size - 1);
    let data = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| drawn.is_covered(at(y, factor[1], drawn.height) * drawn.width + at(x, factor[0], drawn.width)));
    Some(Mask { width, height, data: data.collect() })
}
