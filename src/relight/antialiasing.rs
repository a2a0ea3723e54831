//! Several samples of each pixel, and more of those at the object's outline.

use crate::image::Region;
use crate::views::Camera;
use std::ops::Range;

/// Factor by which pixels at the outline have more samples along each side.
const EDGE_FACTOR: u32 = 2;
/// Samples that are drawn anew at once.
const MAX_SAMPLES_AT_ONCE: u64 = 1 << 22;

/// Rows of an image, drawn with several samples of each pixel.
pub(super) struct SampledRows {
    /// The camera of the samples, one for each of its pixels.
    pub(super) camera: Camera,
    width: usize,
    samples: usize,
    first_row: usize,
}

impl SampledRows {
    /// Some rows of what `camera` sees, with `samples` samples of a pixel along each side.
    fn new(camera: &Camera, samples: u32, rows: Range<u32>) -> Self {
        let (top, height) = (rows.start * samples, (rows.end - rows.start) * samples);
        let fine = supersampled(camera, samples);
        let region = Region { left: 0, top, width: fine.width, height };
        let (width, samples, first_row) = (camera.width as usize, samples as usize, rows.start as usize);
        SampledRows { camera: fine.cropped(&region), width, samples, first_row }
    }

    /// All rows.
    pub(super) fn whole(camera: &Camera, samples: u32) -> Self {
        Self::new(camera, samples, 0..camera.height)
    }

    /// The samples of a pixel of the image, by their place among those of the rows.
    pub(super) fn samples_of(&self, pixel: usize) -> impl Iterator<Item = usize> {
        let (n, fine) = (self.samples, self.width * self.samples);
        let first = (pixel / self.width - self.first_row) * n * fine + pixel % self.width * n;
        (0..n * n).map(move |k| first + k / n * fine + k % n)
    }

    /// Number of a sample of these rows among all of the image.
    pub(super) fn number(&self, sample: usize) -> usize {
        self.first_row * self.samples * self.samples * self.width + sample
    }

    /// Share of a pixel that is a sample's.
    pub(super) fn share(&self) -> f32 {
        1.0 / (self.samples * self.samples) as f32
    }
}

/// Returns the camera with `samples` pixels for each along either side.
pub(super) fn supersampled(camera: &Camera, samples: u32) -> Camera {
    camera.scaled([camera.width, camera.height].map(|side| side.saturating_mul(samples)), [samples as f64; 2])
}

/// The pixels of an image at the object's outline, by how many samples of each show the object, and rows with more samples to draw them anew;
/// of one sample none.
///
/// What is within the outline keeps its samples: chosen by their contrast, pixels whose samples met a highlight would lose a part of it, those whose
/// samples missed one would gain nothing.
pub(super) fn edges(camera: &Camera, samples: u32, hits: &[u32]) -> Vec<(SampledRows, Vec<usize>)> {
    if samples < 2 {
        return Vec::new();
    }
    let (width, height) = (camera.width as usize, camera.height as usize);
    let is_edge = |&pixel: &usize| {
        let (x, y, own) = (pixel % width, pixel / width, hits[pixel]);
        let borders = |is_inside: bool, beside: usize| is_inside && hits[beside] != own;
        (own > 0 && own < samples * samples)
            || borders(x > 0, pixel.wrapping_sub(1))
            || borders(x + 1 < width, pixel + 1)
            || borders(y > 0, pixel.wrapping_sub(width))
            || borders(y + 1 < height, pixel + width)
    };
    let more = samples * EDGE_FACTOR;
    let row = u64::from(camera.width) * u64::from(more) * u64::from(more);
    let rows = (MAX_SAMPLES_AT_ONCE / row.max(1)).clamp(1, u64::from(u32::MAX)) as u32;
    (0..camera.height)
        .step_by(rows as usize)
        .map(|first| first..first.saturating_add(rows).min(camera.height))
        .map(|rows| {
            let pixels = rows.start as usize * width..rows.end as usize * width;
            (SampledRows::new(camera, more, rows), pixels.filter(is_edge).collect::<Vec<_>>())
        })
        .filter(|(_, pixels)| !pixels.is_empty())
        .collect()
}
