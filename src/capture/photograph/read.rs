//! The images of a photograph's files, made into unpolarised radiance and radiance without the specular reflection.

use super::polariser::PolariserFit;
use super::{Exposures, PhotographFiles, PolarisationMosaic, exposures};
use crate::capture::description::FrameDescription;
use crate::error::Error;
use crate::image::read::{ColorSpace, ImageFault, RadianceImage, read_size, reading_memory};
use crate::image::{Grid, Mask, RgbImage};
use crate::input::FileAccess;
use std::path::Path;

/// What reading photographs takes.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct PhotographReading<'a> {
    pub(in super::super) access: &'a FileAccess,
    pub(in super::super) space: &'a ColorSpace,
}

/// A photograph, or a pair of photographs through polarisers.
pub(in super::super) struct ReadPhotograph {
    /// Unpolarised linear radiance; missing pixels are NaN.
    pub(in super::super) photograph: RgbImage,
    /// Linear radiance with the specular reflection blocked, of the same size.
    pub(in super::super) cross: Option<RgbImage>,
    /// Pixels whose alpha is one half or more, in the first image file.
    pub(in super::super) alpha: Option<Mask>,
    /// Pixels that are clipped in one of the images.
    pub(in super::super) clipped: Option<Mask>,
}

impl PhotographReading<'_> {
    /// Reads a photograph of this size (width, height), or of any.
    pub(in super::super) fn read(
        &self,
        files: &PhotographFiles,
        size: Option<(u32, u32)>,
    ) -> Result<ReadPhotograph, ImageFault> {
        match files {
            PhotographFiles::Unpolarised { photograph, cross } => {
                let image = self.exposures(photograph, size)?;
                let size = size.or(Some(image.colour.size()));
                let Some(cross) = cross else {
                    return Ok(ReadPhotograph::new(image.colour, None, image.alpha, image.clipped));
                };
                let cross = self.exposures(cross, size)?;
                let clipped = either(image.clipped, cross.clipped);
                Ok(ReadPhotograph::new(image.colour, Some(cross.colour), image.alpha, clipped))
            }
            PhotographFiles::Parallel { parallel, cross } => {
                let RadianceImage { mut colour, alpha, clipped, .. } = self.exposures(parallel, size)?;
                let cross = self.exposures(cross, size.or(Some(colour.size())))?;
                for (sum, value) in colour.data.iter_mut().zip(&cross.colour.data) {
                    (0..3).for_each(|c| sum[c] += value[c]);
                }
                Ok(ReadPhotograph::new(colour, Some(cross.colour), alpha, either(clipped, cross.clipped)))
            }
            PhotographFiles::Polariser(angles) => self.polariser(angles, size),
            PhotographFiles::Mosaic { raw, mosaic } => self.mosaic(raw, mosaic, size),
        }
    }

    /// Returns the memory that reading a photograph and its mask takes, at most, beside the photograph itself.
    pub(in super::super) fn memory(&self, frame: &FrameDescription, width: u32, height: u32) -> u64 {
        let pixels = u64::from(width) * u64::from(height);
        let bytes = |file: &Path| std::fs::metadata(file).map_or(0, |metadata| metadata.len());
        let largest = frame.files().map(bytes).max().unwrap_or(0);
        // The sums of exposures, where there may be several.
        let exposures = if frame.photograph.files().nth(1).is_some() { 16 * pixels } else { 0 };
        match &frame.photograph {
            PhotographFiles::Unpolarised { .. } | PhotographFiles::Parallel { .. } => {
                reading_memory(largest, width, height).saturating_add(exposures)
            }
            // The sums of the fit, and one image.
            PhotographFiles::Polariser(_) => {
                reading_memory(largest, width, height).saturating_add(exposures + 48 * pixels)
            }
            // The raw image may have four times the pixels.
            PhotographFiles::Mosaic { .. } => {
                reading_memory(largest, 2 * width, 2 * height).saturating_add(exposures + (4 * 4 + 48) * pixels)
            }
        }
    }

    fn exposures(&self, files: &Exposures, size: Option<(u32, u32)>) -> Result<RadianceImage, ImageFault> {
        exposures::read(files, self.access, self.space, size)
    }

    fn polariser(&self, angles: &[(f64, Exposures)], size: Option<(u32, u32)>) -> Result<ReadPhotograph, ImageFault> {
        let degrees: Vec<f64> = angles.iter().map(|(angle, _)| *angle).collect();
        let (mut fit, mut size, mut alpha, mut clipped) = (None, size, None, None);
        for (number, (_, files)) in angles.iter().enumerate() {
            let image = self.exposures(files, size)?;
            size = size.or(Some(image.colour.size()));
            fit.get_or_insert_with(|| PolariserFit::new(&degrees, image.colour.width, image.colour.height))
                .add(number, &image.colour);
            clipped = either(clipped, image.clipped);
            if number == 0 {
                alpha = image.alpha;
            }
        }
        let fit = fit.ok_or_else(|| ImageFault::Wrong(Error::parameter("polarisers of no angle")))?;
        let (photograph, cross) = fit.split();
        Ok(ReadPhotograph::new(photograph, Some(cross), alpha, clipped))
    }

    fn mosaic(
        &self,
        files: &Exposures,
        mosaic: &PolarisationMosaic,
        size: Option<(u32, u32)>,
    ) -> Result<ReadPhotograph, ImageFault> {
        let Some(first) = files.first() else {
            return Err(ImageFault::Wrong(Error::parameter("a mosaic of no image file")));
        };
        let stored = read_size(&first.path, self.access).map_err(ImageFault::Unreadable)?;
        let wrong = |message: String| ImageFault::Wrong(Error::input(&first.path, message));
        let step = match size {
            Some((width, height)) if (2 * width, 2 * height) == stored => 2,
            // Of another size than both it is told as any photograph is.
            _ => 1,
        };
        let least = 2 * mosaic.period() as u32;
        if stored.0.min(stored.1) < least {
            let (width, height) = stored;
            return Err(wrong(format!("{width} x {height} pixels are too few for a polarisation camera's mosaic")));
        }
        let raw =
            exposures::read(files, self.access, &self.space.of_raw(), if step == 2 { Some(stored) } else { size })?;
        let is_grey = |pixel: &[f32; 3]| pixel[0].is_nan() || (pixel[0] == pixel[1] && pixel[0] == pixel[2]);
        if !raw.colour.data.iter().all(is_grey) {
            return Err(wrong("a polarisation camera's raw image has one channel, this one has colours".into()));
        }
        let clipped = raw.clipped.map(|clipped| mosaic.clipped(&clipped, step));
        let raw: Grid<f32> = raw.colour.map(|pixel| pixel[0]);
        let mut fit = PolariserFit::new(&mosaic.angles, raw.width / step, raw.height / step);
        for polariser in 0..mosaic.angles.len() {
            fit.add(polariser, &mosaic.image(polariser, &raw, step));
        }
        let (photograph, cross) = fit.split();
        Ok(ReadPhotograph::new(photograph, Some(cross), None, clipped))
    }
}

impl ReadPhotograph {
    /// A pixel missing in one of a pair is missing in both, so that both components miss the same ones.
    fn new(mut photograph: RgbImage, mut cross: Option<RgbImage>, alpha: Option<Mask>, clipped: Option<Mask>) -> Self {
        for (value, other) in photograph.data.iter_mut().zip(cross.iter_mut().flat_map(|cross| &mut cross.data)) {
            if value[0].is_nan() || other[0].is_nan() {
                (*value, *other) = ([f32::NAN; 3], [f32::NAN; 3]);
            }
        }
        ReadPhotograph { photograph, cross, alpha, clipped }
    }
}

/// Pixels of either mask.
fn either(first: Option<Mask>, second: Option<Mask>) -> Option<Mask> {
    match (first, second) {
        (Some(mut first), Some(second)) => {
            first.data.iter_mut().zip(second.data).for_each(|(a, b)| *a |= b);
            Some(first)
        }
        (first, second) => first.or(second),
    }
}
