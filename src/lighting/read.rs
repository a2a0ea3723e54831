//! Environment maps out of files: latitude-longitude, cube, mirror ball and fisheye images, one or a bracket of several.
//!
//! EXR and Radiance HDR are linear; PNG, JPEG and TIFF are decoded by their colour space. Images of one place with several
//! exposures are merged, each divided by its exposure and weighed by how far its values are from black and from white.

use super::environment::{CleanedPixels, EnvironmentMap, clean};
use super::projection::{EnvironmentProjection, unwrap};
use crate::error::{Error, Result};
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
    let mut bracket: Vec<RgbImage> = Vec::new();
    for path in paths.iter().map(AsRef::as_ref) {
        let picture = read_radiance_image(path, &access, &space, None).map_err(Error::from)?.colour;
        // It stays, and so does the environment that is made of it.
        access.charge(path, "environment", 2 * size_of_val(&picture.data[..]) as u64)?;
        if let Some(before) = bracket.first()
            && (before.width, before.height) != (picture.width, picture.height)
        {
            return Err(Error::input(path, "of another size than the first image of the bracket"));
        }
        bracket.push(picture);
    }
    let mut image = match bracket.len() {
        1 => bracket.swap_remove(0),
        _ => merge(&bracket, &options.exposures),
    };
    if let (1, Some(exposure)) = (paths.len(), options.exposures.first()) {
        image.data.iter_mut().flatten().for_each(|x| *x = (*x as f64 / exposure) as f32);
    }
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

/// A bracket as one image: the mean of `value / exposure`, each weighed by a hat over the values 0 to 1 times its exposure.
/// Pixels that are white in all come from the shortest exposure, those that are black in all from the longest.
fn merge(bracket: &[RgbImage], exposures: &[f64]) -> RgbImage {
    let by_exposure = |a: &usize, b: &usize| exposures[*a].total_cmp(&exposures[*b]);
    let shortest = (0..exposures.len()).min_by(by_exposure).unwrap_or(0);
    let longest = (0..exposures.len()).max_by(by_exposure).unwrap_or(0);
    let mut merged = bracket[0].clone();
    for (at, pixel) in merged.data.iter_mut().enumerate() {
        for (c, value) in pixel.iter_mut().enumerate() {
            let (mut sum, mut total) = (0.0, 0.0);
            for (picture, exposure) in bracket.iter().zip(exposures) {
                let x = picture.data[at][c] as f64;
                // The hat stands over the encoded value, of which the linear one is about the square.
                let encoded = x.max(0.0).sqrt();
                let hat = (encoded.min(1.0 - encoded) - 0.02).clamp(0.0, 0.25) * 4.0;
                if hat > 0.0 {
                    sum += hat * exposure * (x / exposure);
                    total += hat * exposure;
                }
            }
            let bright = bracket[shortest].data[at][c] as f64;
            *value = if total > 0.0 {
                (sum / total) as f32
            } else if bright > 0.25 {
                (bright / exposures[shortest]) as f32
            } else {
                (bracket[longest].data[at][c] as f64 / exposures[longest]) as f32
            };
        }
    }
    merged
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

    #[test]
    fn a_bracket_gives_the_range_that_one_picture_has_not() {
        let radiance = |k: usize| 1e-3 * 1.5f32.powi(k as i32);
        let exposures = [16.0, 1.0, 1.0 / 16.0, 1.0 / 256.0];
        let bracket: Vec<RgbImage> = exposures
            .iter()
            .map(|&exposure| {
                let mut image = RgbImage::filled(30, 1, [0.0; 3]);
                for k in 0..30 {
                    let exposed = (radiance(k) * exposure as f32).min(1.0);
                    // Eight bits of the encoded value.
                    let code = (exposed.sqrt() * 255.0).round() / 255.0;
                    image.data[k] = [code * code; 3];
                }
                image
            })
            .collect();
        let merged = merge(&bracket, &exposures);
        for k in 0..30 {
            let ratio = merged.data[k][1] / radiance(k);
            assert!((ratio - 1.0).abs() < 0.04, "{k}: {ratio}");
        }
    }
}
