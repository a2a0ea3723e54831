//! The white board: the unit of radiance, and what the crossed polarisers take away.

use super::description::{FrameDescription, WhiteReference};
use super::photograph::{PhotographReading, ReadPhotograph};
use crate::error::{Error, Result};
use crate::image::{Region, RgbImage};
use std::path::Path;

/// Radiance of a white board per colour, unpolarised and where photographs are pairs, with the specular reflection blocked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BoardRadiance {
    pub(super) photograph: [f64; 3],
    pub(super) cross: Option<[f64; 3]>,
}

impl BoardRadiance {
    /// Measures the board in a photograph of its own, over the middle quarter each way.
    pub(super) fn of_reference(reference: &WhiteReference, reading: PhotographReading<'_>) -> Result<Self> {
        let read = reading.read(&reference.photograph, None)?;
        let middle = |side: usize| (side as u32 * 3 / 8, (side as u32 * 5).div_ceil(8));
        let ((left, right), (top, bottom)) = (middle(read.photograph.width), middle(read.photograph.height));
        let region = Region { left, top, width: right - left, height: bottom - top };
        Self::measure(&read, &region, reference.photograph.files().collect::<Vec<_>>().as_slice())
    }

    /// Measures the board in a photograph that shows the object, too.
    pub(super) fn of_region(read: &ReadPhotograph, region: &Region, frame: &FrameDescription) -> Result<Self> {
        Self::measure(read, region, frame.photograph.files().collect::<Vec<_>>().as_slice())
    }

    /// Errors name the file of the image that is wrong.
    fn measure(read: &ReadPhotograph, region: &Region, files: &[&Path]) -> Result<Self> {
        let mean = |image: &RgbImage, number: usize| -> Result<[f64; 3]> {
            let path = files.get(number).or(files.first()).copied().unwrap_or(Path::new(""));
            if !region.is_within(image.width as u32, image.height as u32) {
                let (width, height) = (image.width, image.height);
                return Err(Error::input(path, format!("its white_region leaves its {width} x {height} pixels")));
            }
            let mean = mean(image, region);
            let bright = mean.iter().all(|m| m.is_finite() && *m > 0.0);
            let message =
                || format!("the white board has a mean radiance of {mean:?} in its middle: it should be positive");
            if bright { Ok(mean) } else { Err(Error::input(path, message())) }
        };
        Ok(BoardRadiance {
            photograph: mean(&read.photograph, 0)?,
            cross: read.cross.as_ref().map(|cross| mean(cross, 1)).transpose()?,
        })
    }

    /// Returns `beta = on_board / off_board` per colour (Miyazaki 2007, equation A.2), if there are pairs.
    pub(super) fn beta(&self) -> Option<[f64; 3]> {
        self.cross.map(|on| std::array::from_fn(|c| on[c] / self.photograph[c]))
    }

    /// Multiplies a photograph, in which the board has this radiance, so that it has another.
    pub(super) fn bring_to(&self, wanted: &BoardRadiance, read: &mut ReadPhotograph) {
        let cross = match (&mut read.cross, self.cross, wanted.cross) {
            (Some(image), Some(found), Some(wanted)) => Some((image, found, wanted)),
            _ => None,
        };
        for (image, found, wanted) in
            [(&mut read.photograph, self.photograph, wanted.photograph)].into_iter().chain(cross)
        {
            let factors: [f32; 3] = std::array::from_fn(|c| (wanted[c] / found[c]) as f32);
            image.data.iter_mut().for_each(|pixel| (0..3).for_each(|c| pixel[c] *= factors[c]));
        }
    }
}

/// Mean of a region of an image, missing pixels left out; NaN if all are missing.
fn mean(image: &RgbImage, region: &Region) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for y in region.rows() {
        for pixel in &image.row(y)[region.columns()] {
            if !pixel[0].is_nan() {
                (0..3).for_each(|c| sum[c] += pixel[c] as f64);
                count += 1.0;
            }
        }
    }
    sum.map(|s| s / count)
}
