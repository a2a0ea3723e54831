//! PNG, JPEG, TIFF and Radiance HDR.

use super::{ImageFault, ImageFile, RawImage, check_size};
#[cfg(feature = "ar")]
use crate::image::Grid;
use crate::limits::Reservation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::io::{BufRead, Cursor, Read, Seek};

/// Pixels that a byte of a JPEG can stand for, at most: a bit for a grey block of 8 x 8.
const JPEG_PIXELS_PER_BYTE: u64 = 512;

/// Memory for the colour profile of a PNG, which may be compressed a thousand times.
pub(super) const PNG_PROFILE_BYTES: u64 = 4 << 20;

/// Scans of a JPEG at most: each is work for every block of the picture. Progressive ones have some ten.
const MAX_JPEG_SCANS: usize = 256;

/// Decodes, once the header's size has been checked and its memory charged.
fn decode<'a>(file: &ImageFile<'a>, size: Option<(u32, u32)>) -> Result<(DynamicImage, Reservation<'a>), ImageFault> {
    let damaged = |e: image::ImageError| file.damaged(format!("not readable as a picture: {e}"));
    let mut reader = ImageReader::new(Cursor::new(file.bytes))
        .with_guessed_format()
        .map_err(|e| file.damaged(format!("not readable as a picture: {e}")))?;
    let Some(format) = reader.format() else {
        return Err(file.damaged("not a picture that tsuya reads: it should be EXR, PNG, JPEG or TIFF"));
    };
    let mut limits = image::Limits::default();
    // PNG's is for colour profiles, not for the picture; TIFF's for the picture, too.
    let is_png = format == ImageFormat::Png;
    let most = if is_png { PNG_PROFILE_BYTES } else { u64::MAX };
    limits.max_alloc = Some(file.access.budget().left().min(most));
    let profile = if is_png { PNG_PROFILE_BYTES } else { 0 };
    let _profile = file.access.reserve(file.path, "picture", profile).map_err(ImageFault::Wrong)?;
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    // A progressive JPEG holds its coefficients, and the decoder the file once more.
    let is_jpeg = format == ImageFormat::Jpeg;
    let decoder_bytes = decoder.total_bytes().saturating_add(if is_jpeg { 8 * pixels } else { 0 });
    let held = file.reserve(width.into(), height.into(), decoder_bytes.saturating_add(file.bytes.len() as u64))?;
    check_size(file.path, (width, height), size)?;
    if is_jpeg && pixels > file.bytes.len() as u64 * JPEG_PIXELS_PER_BYTE {
        let count = file.bytes.len();
        return Err(
            file.damaged(format!("a JPEG of {width} x {height} pixels does not fit in {count} bytes: truncated"))
        );
    }
    if is_jpeg && count_jpeg_scans(file.bytes) > MAX_JPEG_SCANS {
        return Err(file.damaged(format!("a JPEG of more than {MAX_JPEG_SCANS} scans, which are not read")));
    }
    Ok((DynamicImage::from_decoder(decoder).map_err(damaged)?, held))
}

/// The scans of a JPEG, by its markers up to its end (ITU-T T.81, annex B).
fn count_jpeg_scans(bytes: &[u8]) -> usize {
    let (mut at, mut scans) = (2, 0);
    while let Some(&[first, kind]) = bytes.get(at..).and_then(|rest| rest.first_chunk()) {
        at += match (first, kind) {
            (0xff, 0xd9) => break,
            // Fill bytes, and markers without a length: restarts and TEM.
            (0xff, 0xff) => 1,
            (0xff, 0xd0..=0xd8 | 0x01) => 2,
            // A segment, by its length; after the head of a scan follow its data, which have no markers in them.
            (0xff, 1..) => {
                scans += usize::from(kind == 0xda);
                let length =
                    bytes.get(at + 2..).and_then(|rest| rest.first_chunk()).map_or(2, |l| u16::from_be_bytes(*l));
                2 + usize::from(length)
            }
            _ => 1,
        };
    }
    scans
}

pub(super) fn read_raster<'a>(
    file: &ImageFile<'a>,
    size: Option<(u32, u32)>,
) -> Result<(RawImage, Reservation<'a>), ImageFault> {
    let (picture, held) = decode(file, size)?;
    let colour_type = picture.color();
    let display_referred = !matches!(colour_type, ColorType::Rgb32F | ColorType::Rgba32F);
    let has_alpha = colour_type.has_alpha();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let values = picture.into_rgba32f().into_raw();
    Ok((RawImage { width, height, values, has_alpha, display_referred }, held))
}

/// Returns width and height; reads no more than the header, of `max_bytes` at most.
pub(super) fn size(file: impl BufRead + Seek, max_bytes: u64) -> Result<(u32, u32), String> {
    let unreadable = |e: &dyn std::fmt::Display| format!("not readable as a picture: {e}");
    let mut reader = ImageReader::new(file).with_guessed_format().map_err(|e| unreadable(&e))?;
    if reader.format() == Some(ImageFormat::Jpeg) {
        // The decoder would read the whole file.
        let mut file = reader.into_inner();
        let size = file.rewind().and_then(|()| jpeg_size(file)).map_err(|e| unreadable(&e))?;
        return size.ok_or_else(|| "a JPEG without a size before its first scan".into());
    }
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(max_bytes);
    reader.limits(limits);
    reader.into_dimensions().map_err(|e| unreadable(&e))
}

/// The size in a JPEG's frame header (ITU-T T.81, B.2.2); `None` if a scan comes first.
fn jpeg_size(mut file: impl Read + Seek) -> std::io::Result<Option<(u32, u32)>> {
    file.seek_relative(2)?;
    loop {
        let mut marker = [0xff; 2];
        file.read_exact(&mut marker)?;
        // Fill bytes, and what should not be there.
        while marker != [0xff, marker[1]] || marker[1] == 0xff {
            marker[0] = marker[1];
            file.read_exact(&mut marker[1..])?;
        }
        match marker[1] {
            // Without a length.
            0xd0..=0xd8 | 0x00 | 0x01 => continue,
            0xd9 | 0xda => return Ok(None),
            kind => {
                let mut head = [0; 2];
                file.read_exact(&mut head)?;
                if matches!(kind, 0xc0..=0xcf) && ![0xc4, 0xc8, 0xcc].contains(&kind) {
                    let mut frame = [0; 5];
                    file.read_exact(&mut frame)?;
                    let [_, sides @ ..] = frame;
                    let [height, width] = [0, 2].map(|at| u32::from(u16::from_be_bytes([sides[at], sides[at + 1]])));
                    return Ok(Some((width, height)));
                }
                file.seek_relative(i64::from(u16::from_be_bytes(head)).saturating_sub(2).max(0))?;
            }
        }
    }
}

/// The picture where it has 8 bits a colour.
#[cfg(feature = "ar")]
pub(super) fn read_rgb8(file: &ImageFile) -> Result<Option<Grid<[u8; 3]>>, ImageFault> {
    let (picture, _held) = decode(file, None)?;
    if !matches!(picture.color(), ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8) {
        return Ok(None);
    }
    let picture = picture.into_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Ok(Some(Grid { width, height, data: picture.as_raw().as_chunks().0.to_vec() }))
}
