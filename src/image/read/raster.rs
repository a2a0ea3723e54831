//! PNG, JPEG, TIFF and Radiance HDR.

#[cfg(feature = "ar")]
use super::DisplayPicture;
use super::colour::{self, FileColour};
use super::{ImageFault, ImageFile, RawImage, orient};
#[cfg(feature = "ar")]
use crate::image::Grid;
use crate::image::ImageOrientation;
use crate::limits::Reservation;
use image::codecs::hdr::{HdrDecoder, HdrMetadata};
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::io::{BufRead, Cursor, Read, Seek};

/// Pixels that a byte of a JPEG can stand for, at most: a bit for a grey block of 8 x 8.
const JPEG_PIXELS_PER_BYTE: u64 = 512;

/// Memory for the colour profile of a PNG, which may be compressed a thousand times.
pub(super) const PNG_PROFILE_BYTES: u64 = 4 << 20;

/// Scans of a JPEG at most: each is work for every block of the picture. Progressive ones have some ten.
const MAX_JPEG_SCANS: usize = 256;

/// A picture as its decoder gives it, and what the file says about it.
struct DecodedPicture<'a> {
    picture: DynamicImage,
    colour: FileColour,
    /// As stated.
    orientation: ImageOrientation,
    /// The turn that the pixels need.
    turn: ImageOrientation,
    _held: Reservation<'a>,
}

/// Decodes, once the header's size has been checked and its memory charged.
fn decode<'a>(file: &ImageFile<'a>, size: Option<(u32, u32)>) -> Result<DecodedPicture<'a>, ImageFault> {
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
    let profile = if is_png { PNG_PROFILE_BYTES } else { 0 } + colour::MEMORY_BYTES;
    let _profile = file.access.reserve(file.path, "picture", profile).map_err(ImageFault::Wrong)?;
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    // A progressive JPEG holds its coefficients, and the decoder the file once more.
    let is_jpeg = format == ImageFormat::Jpeg;
    let decoder_bytes = decoder.total_bytes().saturating_add(if is_jpeg { 8 * pixels } else { 0 });
    let held = file.reserve(width.into(), height.into(), decoder_bytes.saturating_add(file.bytes.len() as u64))?;
    // EXIF is a help, not a condition: a damaged one says nothing.
    let stated = decoder.orientation().map_or(1, |orientation| orientation.to_exif());
    let orientation = ImageOrientation::from_exif(stated).unwrap_or_default();
    let turn = orient(file, (width, height), orientation, size)?;
    if is_jpeg && pixels > file.bytes.len() as u64 * JPEG_PIXELS_PER_BYTE {
        let count = file.bytes.len();
        return Err(
            file.damaged(format!("a JPEG of {width} x {height} pixels does not fit in {count} bytes: truncated"))
        );
    }
    if is_jpeg && count_jpeg_scans(file.bytes) > MAX_JPEG_SCANS {
        return Err(file.damaged(format!("a JPEG of more than {MAX_JPEG_SCANS} scans, which are not read")));
    }
    let profile = decoder.icc_profile().ok().flatten();
    let colour = match format {
        ImageFormat::Png => png_colour(file.bytes, profile.as_deref()),
        ImageFormat::Hdr => hdr_colour(file.bytes),
        ImageFormat::Tiff => tiff_colour(file)?,
        _ => profile.map_or(FileColour::Usual, |profile| FileColour::from_icc(&profile)),
    };
    let mut picture = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    if format == ImageFormat::Hdr {
        undo_exposure(file.bytes, &mut picture);
    }
    Ok(DecodedPicture { picture, colour, orientation, turn, _held: held })
}

/// What the chunks of a PNG say, by their precedence (PNG, 4.3): cICP, iCCP, sRGB, then gAMA and cHRM.
fn png_colour(bytes: &[u8], profile: Option<&[u8]>) -> FileColour {
    let limits = png::Limits { bytes: PNG_PROFILE_BYTES as usize };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_ignore_text_chunk(true);
    let Ok(reader) = decoder.read_info() else { return FileColour::Usual };
    let info = reader.info();
    if let Some(points) = info.coding_independent_code_points {
        let full = u8::from(points.is_video_full_range_image);
        return FileColour::from_code_points([
            points.color_primaries,
            points.transfer_function,
            points.matrix_coefficients,
            full,
        ]);
    }
    if let Some(profile) = profile {
        return FileColour::from_icc(profile);
    }
    if info.srgb.is_some() || (info.gama_chunk.is_none() && info.chrm_chunk.is_none()) {
        return FileColour::Usual;
    }
    let primaries = info.chrm_chunk.map(|c| {
        [c.red, c.green, c.blue, c.white].map(|(x, y)| [x, y].map(|value| f64::from(value.into_scaled()) / 1e5))
    });
    let gamma = info.gama_chunk.map(|gamma| f64::from(gamma.into_scaled()) / 1e5);
    FileColour::from_png_gamma(gamma, primaries.as_ref())
}

/// The ICC profile of a TIFF. The image crate would bound it by the bytes of the pixels.
fn tiff_colour(file: &ImageFile) -> Result<FileColour, ImageFault> {
    let bytes = file.bytes.len().min(colour::MAX_PROFILE_BYTES);
    // The decoder makes a value of each byte.
    let memory = (bytes * size_of::<tiff::decoder::ifd::Value>()) as u64;
    let _held = file.access.reserve(file.path, "picture", memory).map_err(ImageFault::Wrong)?;
    let mut limits = tiff::decoder::Limits::default();
    limits.ifd_value_size = bytes;
    let Ok(mut decoder) = tiff::decoder::Decoder::new(Cursor::new(file.bytes)).map(|d| d.with_limits(limits)) else {
        return Ok(FileColour::Usual);
    };
    Ok(match decoder.find_tag(tiff::tags::Tag::IccProfile) {
        Ok(None) => FileColour::Usual,
        Ok(Some(value)) => match value.into_u8_vec() {
            Ok(profile) => FileColour::from_icc(&profile),
            Err(error) => FileColour::Unknown("ICC profile".into(), error.to_string()),
        },
        Err(error) => FileColour::Unknown("ICC profile".into(), error.to_string()),
    })
}

/// What the header of a Radiance picture says.
fn hdr_header(bytes: &[u8]) -> Option<HdrMetadata> {
    // Strict reading would refuse lines of other programs.
    HdrDecoder::new_nonstrict(Cursor::new(bytes)).ok().map(|decoder| decoder.metadata())
}

/// The line PRIMARIES of a Radiance picture: x and y of red, green, blue and white.
fn hdr_colour(bytes: &[u8]) -> FileColour {
    let header = hdr_header(bytes);
    let lines = header.iter().flat_map(|header| &header.custom_attributes);
    let Some((_, value)) = lines.into_iter().rfind(|(key, _)| key == "PRIMARIES") else { return FileColour::Usual };
    let numbers: Option<Vec<f64>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[rx, ry, gx, gy, bx, by, wx, wy]) => {
            let primaries = [[rx, ry], [gx, gy], [bx, by], [wx, wy]];
            FileColour::from_primaries("the line PRIMARIES", &primaries, None)
        }
        _ => FileColour::Unknown("the line PRIMARIES".into(), "it has not eight numbers".into()),
    }
}

/// Divides by the factors that a Radiance picture's pixels were multiplied with, as its header says (EXPOSURE, COLORCORR).
fn undo_exposure(bytes: &[u8], picture: &mut DynamicImage) {
    let Some(header) = hdr_header(bytes) else { return };
    let exposure = header.exposure.unwrap_or(1.0);
    let (red, green, blue) = header.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let factors = [red, green, blue].map(|correction| exposure * correction);
    if factors == [1.0; 3] || !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        return;
    }
    if let DynamicImage::ImageRgb32F(picture) = picture {
        picture.pixels_mut().for_each(|pixel| (0..3).for_each(|c| pixel.0[c] /= factors[c]));
    }
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
    let DecodedPicture { picture, colour, turn, _held: held, .. } = decode(file, size)?;
    let colour_type = picture.color();
    let display_referred = !matches!(colour_type, ColorType::Rgb32F | ColorType::Rgba32F);
    let has_alpha = colour_type.has_alpha();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let values = picture.into_rgba32f().into_raw();
    let maximum = display_referred.then_some(1.0);
    Ok((RawImage { width, height, values, has_alpha, display_referred, maximum, colour, orientation: turn }, held))
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

/// The picture where it has 8 bits a colour, upright, and how it was stored.
#[cfg(feature = "ar")]
pub(super) fn read_rgb8(file: &ImageFile) -> Result<Option<DisplayPicture>, ImageFault> {
    let DecodedPicture { picture, colour, orientation, _held, .. } = decode(file, None)?;
    if !matches!(picture.color(), ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8) {
        return Ok(None);
    }
    let name = match colour {
        FileColour::Usual => None,
        FileColour::Space(space) => Some(space.name),
        FileColour::Unknown(name, _) => Some(name),
    };
    if let Some(name) = name {
        file.access.remark(file.path, format!("{name} is not applied: its colours are taken for sRGB's"));
    }
    let picture = picture.into_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let stored = Grid { width, height, data: picture.as_raw().as_chunks().0.to_vec() };
    Ok(Some((orientation.apply(stored), orientation)))
}
