//! Thumbnail: a PNG file, kept as it is.

use super::Tag;
#[cfg(feature = "encode")]
use crate::image::{Grid, RgbImage};
use crate::{Error, Result};
use byteorder::{BigEndian, ByteOrder};

/// Largest width and height in pixels. Part of the format.
pub(crate) const MAX_SIDE: u32 = 1024;
const PNG_HEAD: [u8; 16] = *b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR";

/// Small image of the object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Thumbnail {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// The PNG file.
    pub png: Vec<u8>,
}

/// Longest side of the thumbnails that the encoder makes, in pixels.
#[cfg(feature = "encode")]
const REDUCED_SIDE: usize = 48;

/// Returns the image averaged down to at most 48 pixels a side.
#[cfg(feature = "encode")]
pub(crate) fn reduced(image: &RgbImage) -> RgbImage {
    let scale = image.width.max(image.height).div_ceil(REDUCED_SIDE).max(1);
    let mut small = RgbImage::filled((image.width / scale).max(1), (image.height / scale).max(1), [0.0; 3]);
    for y in 0..small.height {
        for x in 0..small.width {
            let mut mean = [0.0f32; 3];
            let mut count = 0.0;
            for sy in (y * scale)..((y + 1) * scale).min(image.height) {
                for sx in (x * scale)..((x + 1) * scale).min(image.width) {
                    (0..3).for_each(|c| mean[c] += image.value_at(sx, sy)[c]);
                    count += 1.0;
                }
            }
            *small.value_at_mut(x, y) = mean.map(|v| v / f32::max(count, 1.0));
        }
    }
    small
}

/// Writes an sRGB image as a PNG file.
/// # Errors
/// [`Error::Parameter`] if the image has no pixels.
#[cfg(feature = "encode")]
pub(crate) fn write_png(image: &Grid<[u8; 3]>) -> Result<Vec<u8>> {
    use ::image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
    let (width, height) = (image.width as u32, image.height as u32);
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(image.data.as_flattened(), width, height, ExtendedColorType::Rgb8)
        .map_err(|error| Error::parameter(format!("thumbnail: {error}")))?;
    Ok(png)
}

/// Checks a PNG file's head; the bytes are the section's content.
#[cfg(feature = "encode")]
pub fn encode_thumbnail(png: &[u8]) -> Result<Vec<u8>> {
    decode_thumbnail(png.to_vec()).map(|thumbnail| thumbnail.png)
}

/// Decodes the section: a PNG file of which only the head is checked.
/// # Errors
/// [`Error::Format`] if it is no PNG file of 1 to 1024 pixels a side.
pub fn decode_thumbnail(content: Vec<u8>) -> Result<Thumbnail> {
    let wrong = |offset: u64, message: &str| Err(Error::format(Tag::THUMBNAIL, offset, message));
    let Some(rest) = content.strip_prefix(&PNG_HEAD) else { return wrong(0, "no PNG image") };
    let Some((width, rest)) = rest.split_first_chunk::<4>() else { return wrong(16, "ends early") };
    let Some((height, _)) = rest.split_first_chunk::<4>() else { return wrong(20, "ends early") };
    let (width, height) = (BigEndian::read_u32(width), BigEndian::read_u32(height));
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return wrong(16, "width and height must be 1 to 1024 pixels");
    }
    Ok(Thumbnail { width, height, png: content })
}
