//! Environment maps out of files: latitude-longitude, cube, mirror ball and fisheye images, one or a bracket of several.
//!
//! EXR and Radiance HDR are linear; PNG, JPEG and TIFF are decoded by their colour space. Images of one place with several
//! exposures are merged.

use super::environment::{CleanedPixels, EnvironmentMap, clean};
use super::projection::{EnvironmentProjection, unwrap};
use crate::error::{Error, Result};
use crate::image::bracket::ExposureBracket;
use crate::image::read::{ColorSpace, read_radiance_image};
use crate::image::{RgbImage, from_srgb};
use crate::input::FileAccess;
use crate::limits::Limits;
use std::path::Path;

/// Options of [`read_environment`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EnvironmentReadOptions {
    /// `None`: by the image's shape, [`EnvironmentProjection::guess`].
    pub projection: Option<EnvironmentProjection>,
    /// Columns of the environment made of other projections; `None`: as many as keep the image's detail.
    pub width: Option<usize>,
    /// Colour space of PNG, JPEG and TIFF; `None`: srgb.
    pub color_space: Option<String>,
    /// Exposure (seconds, or any number proportional to the light let in) of each image; empty for a single image.
    pub exposures: Vec<f64>,
    /// Bounds on all images together.
    pub limits: Limits,
}

/// Reads an environment from one image, or from several of different exposure.
///
/// Errors name the file: unreadable, of another size than the first, of a shape that no projection is guessed for.
pub fn read_environment<P: AsRef<Path>>(
    paths: &[P],
    options: &EnvironmentReadOptions,
) -> Result<(EnvironmentMap, CleanedPixels)> {
    let Some(first) = paths.first().map(AsRef::as_ref) else {
        return Err(Error::parameter("no image of the environment is given"));
    };
    if paths.len() > 1 && options.exposures.len() != paths.len() {
        let (pictures, exposures) = (paths.len(), options.exposures.len());
        return Err(Error::parameter(format!("{pictures} images need as many exposures, {exposures} are given")));
    }
    if options.exposures.iter().any(|&exposure| !(exposure > 0.0 && exposure.is_finite())) {
        return Err(Error::parameter("exposures must be positive"));
    }
    let space = options.color_space.as_deref().map_or_else(|| Ok(ColorSpace::from_files()), ColorSpace::from_name)?;
    let access = FileAccess::new(options.limits);
    let exposure = |k: usize| options.exposures.get(k).copied().unwrap_or(1.0);
    let mut order: Vec<usize> = (0..paths.len()).collect();
    order.sort_by(|&a, &b| exposure(a).total_cmp(&exposure(b)));
    let mut bracket: Option<ExposureBracket> = None;
    for k in order {
        let path = paths[k].as_ref();
        let image = read_radiance_image(path, &access, &space, None).map_err(Error::from)?;
        match &mut bracket {
            None => {
                // It stays, with its sums, and so does the environment that is made of it.
                access.charge(path, "environment", 3 * size_of_val(&image.colour.data[..]) as u64)?;
                bracket = Some(ExposureBracket::new(image, exposure(k)));
            }
            Some(bracket) if bracket.size() == image.colour.size() => bracket.add(&image, exposure(k)),
            Some(_) => return Err(Error::input(path, "of another size than the other images of the bracket")),
        }
    }
    let bracket = bracket.ok_or_else(|| Error::parameter("no image of the environment is given"))?;
    let mut image = bracket.finish().colour;
    let projection = match options.projection {
        Some(projection) => projection,
        None => EnvironmentProjection::guess(&image).ok_or_else(|| {
            let (width, height) = (image.width, image.height);
            Error::input(
                first,
                format!("{width} x {height} pixels are neither 2:1 nor a cube: its projection must be stated"),
            )
        })?,
    };
    let cleaned = clean(&mut image);
    let environment = unwrap(image, projection, options.width).map_err(|message| Error::input(first, message))?;
    Ok((environment, cleaned))
}

/// Multiplies what an 8-bit image cut off by `gain`: rising from display values of 240 of 255 to the full gain at 254.
pub fn raise_clipped(picture: &mut RgbImage, gain: f32) {
    let (low, high) = (from_srgb(240.0 / 255.0) as f32, from_srgb(254.0 / 255.0) as f32);
    for pixel in &mut picture.data {
        let most = pixel[0].max(pixel[1]).max(pixel[2]);
        if most > low {
            let share = ((most - low) / (high - low)).min(1.0);
            *pixel = pixel.map(|c| c * (1.0 + (gain - 1.0) * share));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lamps_that_were_cut_off_are_raised() {
        let mut lamp = RgbImage { width: 2, height: 1, data: vec![[1.0, 0.9, 0.8], [0.5, 0.6, 0.7]] };
        raise_clipped(&mut lamp, 10.0);
        assert!((lamp.data[0][0] - 10.0).abs() < 1e-4 && lamp.data[1] == [0.5, 0.6, 0.7]);
    }
}
