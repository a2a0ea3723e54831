//! Thumbnail: a PNG picture, kept as it is.

use super::Tag;
use crate::{Error, Result};

/// Largest width and height in pixels. Part of the format.
pub(crate) const MAX_SIDE: u32 = 1024;
const PNG_HEAD: [u8; 16] = *b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR";

/// A small picture of the object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Thumbnail {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// The PNG file.
    pub png: Vec<u8>,
}

/// Checks a PNG file's head; the bytes are the section's content.
#[cfg(feature = "encode")]
pub fn encode_thumbnail(png: &[u8]) -> Result<Vec<u8>> {
    decode_thumbnail(png.to_vec()).map(|thumbnail| thumbnail.png)
}

/// The picture in its section; only its head is looked at.
pub fn decode_thumbnail(content: Vec<u8>) -> Result<Thumbnail> {
    let wrong = |offset: u64, message: &str| Err(Error::format(Tag::THUMBNAIL, offset, message));
    let Some(rest) = content.strip_prefix(&PNG_HEAD) else { return wrong(0, "no PNG picture") };
    let Some((width, rest)) = rest.split_first_chunk::<4>() else { return wrong(16, "ends early") };
    let Some((height, _)) = rest.split_first_chunk::<4>() else { return wrong(20, "ends early") };
    let (width, height) = (u32::from_be_bytes(*width), u32::from_be_bytes(*height));
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return wrong(16, "width and height must be 1 to 1024 pixels");
    }
    Ok(Thumbnail { width, height, png: content })
}
