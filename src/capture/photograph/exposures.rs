//! One image out of the exposures of one position of the filters.

use super::ExposureFile;
use crate::error::Error;
use crate::image::bracket::ExposureBracket;
use crate::image::read::{ColorSpace, ImageFault, RadianceImage, read_radiance_image};
use crate::input::FileAccess;

/// Reads exposures into one image of the radiance at exposure 1, as [`ExposureBracket`] merges them.
pub(super) fn read(
    exposures: &[ExposureFile],
    access: &FileAccess,
    space: &ColorSpace,
    size: Option<(u32, u32)>,
) -> Result<RadianceImage, ImageFault> {
    let mut order: Vec<&ExposureFile> = exposures.iter().collect();
    order.sort_by(|a, b| a.time.total_cmp(&b.time));
    let mut bracket: Option<ExposureBracket> = None;
    for exposure in order {
        let size = size.or(bracket.as_ref().map(ExposureBracket::size));
        let image = read_radiance_image(&exposure.path, access, space, size)?;
        match &mut bracket {
            None => bracket = Some(ExposureBracket::new(image, exposure.time)),
            Some(bracket) => bracket.add(&image, exposure.time),
        }
    }
    let bracket = bracket.ok_or_else(|| ImageFault::Wrong(Error::parameter("a photograph of no image file")))?;
    Ok(bracket.finish())
}
