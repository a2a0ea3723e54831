//! Photographs out of files, as linear radiance: EXR, PNG, JPEG, TIFF, Radiance.

use super::{Grid, ImageOrientation, Mask, RgbImage, from_srgb};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use crate::limits::Reservation;
use glam::{Mat3, Vec3};
use std::borrow::Cow;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

mod colour;
mod openexr;
mod raster;

use colour::{Curve, FileColour};

/// Conversion of display-referred images (PNG, JPEG, TIFF of integers) to linear radiance.
/// EXR and floating-point TIFF are linear whatever is declared.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorSpace {
    /// The space of the pixels in memory: always linear; `linear-rec709` but for `linear-NAME` of other primaries, which are kept.
    pub linear_name: String,
    /// Linear value of each 16-bit code.
    table: Vec<f32>,
    /// `true` if it is the same whatever a file says about its colours.
    is_declared: bool,
}

impl ColorSpace {
    /// By name: `srgb` (the default), `rec709`, `gamma-2.2` (any exponent), `linear-rec709`, or `linear-NAME` for other primaries.
    pub fn from_name(name: &str) -> Result<Self> {
        let lower = name.trim().to_ascii_lowercase();
        let plain = lower.replace(['_', ' '], "-");
        let mut linear_name = "linear-rec709".to_owned();
        let gamma = plain.strip_prefix("gamma").and_then(|g| g.trim_start_matches('-').parse::<f64>().ok());
        let decode: Box<dyn Fn(f64) -> f64> = match plain.as_str() {
            "linear" | "linear-rec709" | "linear-srgb" => Box::new(|v| v),
            "srgb" => Box::new(from_srgb),
            "rec709" | "bt709" | "rec.709" => {
                Box::new(|v| if v < 0.081 { v / 4.5 } else { ((v + 0.099) / 1.099).powf(1.0 / 0.45) })
            }
            _ if plain.starts_with("linear-") => {
                linear_name = plain.clone();
                Box::new(|v| v)
            }
            _ => match gamma {
                Some(gamma) if (0.1..=10.0).contains(&gamma) => Box::new(move |v| v.powf(gamma)),
                _ => {
                    return Err(Error::Unsupported(format!(
                        "colour space \"{name}\"; known: srgb, rec709, gamma-2.2 (any exponent), linear-rec709, linear-NAME"
                    )));
                }
            },
        };
        Ok(ColorSpace { linear_name, table: table(decode), is_declared: true })
    }

    /// What each file says about its colours: ICC profile, PNG's chunks; `srgb` where it says nothing.
    pub fn from_files() -> Self {
        ColorSpace { linear_name: "linear-rec709".into(), table: table(from_srgb), is_declared: false }
    }

    /// Returns this space if it is declared, else that of numbers which are linear as they are, such as raw ones.
    pub(crate) fn of_raw(&self) -> Cow<'_, Self> {
        match self.is_declared {
            true => Cow::Borrowed(self),
            false => {
                Cow::Owned(ColorSpace { linear_name: "linear-rec709".into(), table: table(|v| v), is_declared: true })
            }
        }
    }

    /// Returns `true` if primaries other than Rec. 709's are declared, and are to be kept.
    fn keeps_primaries(&self) -> bool {
        self.linear_name != "linear-rec709"
    }

    #[cfg(test)]
    fn linear(&self, encoded: f32) -> f32 {
        look_up(&self.table, encoded)
    }
}

/// Linear value of each 16-bit code.
fn table(linear: impl Fn(f64) -> f64) -> Vec<f32> {
    (0..=65535).map(|code| linear(code as f64 / 65535.0) as f32).collect()
}

fn look_up(table: &[f32], encoded: f32) -> f32 {
    // 8-bit codes fall on 16-bit ones: 65535 = 255 * 257.
    table[(encoded * 65535.0).round().clamp(0.0, 65535.0) as usize]
}

/// Fault of an image file, by its consequence.
pub(crate) enum ImageFault {
    /// It is missing or damaged: the frame can be left out.
    Unreadable(Error),
    /// It contradicts the capture: nothing should go on.
    Wrong(Error),
}

impl ImageFault {
    /// Classifies an error: too much memory, or no regular file, is no accident of one frame.
    fn from_error(error: Error) -> Self {
        use std::io::ErrorKind::{InvalidInput, IsADirectory};
        let accident = match &error {
            Error::InputMemory { .. } => false,
            Error::Io { source, .. } => !matches!(source.kind(), InvalidInput | IsADirectory),
            _ => true,
        };
        if accident { ImageFault::Unreadable(error) } else { ImageFault::Wrong(error) }
    }
}

impl From<ImageFault> for Error {
    fn from(fault: ImageFault) -> Self {
        match fault {
            ImageFault::Unreadable(e) | ImageFault::Wrong(e) => e,
        }
    }
}

/// A picture in linear radiance.
pub(crate) struct RadianceImage {
    /// Missing pixels (NaN or infinite in any colour) are NaN in all three.
    pub colour: RgbImage,
    /// Pixels whose alpha is one half or more; `None` without alpha, or where all are.
    pub alpha: Option<Mask>,
    /// Pixels of which a colour is the largest number of the file's format; `None` where there are none.
    pub clipped: Option<Mask>,
    /// The turn that was applied.
    pub orientation: ImageOrientation,
}

/// Reads a photograph. A given `size` (width, height) is checked before the pixels are decoded.
///
/// Integers become linear by `space`, if that is declared; else by what the file says about its colours. Whatever of that can't be applied is
/// remarked.
pub(crate) fn read_radiance_image(
    path: &Path,
    access: &FileAccess,
    space: &ColorSpace,
    size: Option<(u32, u32)>,
) -> Result<RadianceImage, ImageFault> {
    with_raw(path, access, size, |raw| RadianceImage::of(path, access, space, raw))
}

impl RadianceImage {
    fn of(path: &Path, access: &FileAccess, space: &ColorSpace, raw: &RawImage) -> Self {
        let applied = AppliedColour::new(path, access, raw, space);
        let colour = raw.map(|p| {
            let rgb = [p[0], p[1], p[2]];
            if rgb.iter().all(|c| c.is_finite()) { applied.linear(rgb) } else { [f32::NAN; 3] }
        });
        let alpha = raw.has_alpha.then(|| raw.map(|p| p[3] >= 0.5)).filter(|mask| mask.data.contains(&false));
        let orientation = raw.orientation;
        RadianceImage {
            colour: orientation.apply(colour),
            alpha: alpha.map(|alpha| orientation.apply(alpha)),
            clipped: raw.clipped().map(|clipped| orientation.apply(clipped)),
            orientation,
        }
    }
}

/// The way from a file's values to linear ones.
struct AppliedColour<'a> {
    /// `None` for values that are linear as they are.
    curves: Option<[Cow<'a, [f32]>; 3]>,
    to_rec709: Option<Mat3>,
}

impl<'a> AppliedColour<'a> {
    fn new(path: &Path, access: &FileAccess, raw: &RawImage, space: &'a ColorSpace) -> Self {
        let declared = || std::array::from_fn(|_| Cow::Borrowed(&space.table[..]));
        let usual = AppliedColour { curves: raw.display_referred.then(declared), to_rec709: None };
        match &raw.colour {
            FileColour::Usual => usual,
            FileColour::Unknown(name, why) => {
                access.remark(path, format!("{name} is not applied: {why}"));
                usual
            }
            FileColour::Space(file) if raw.display_referred && space.is_declared => {
                access.remark(path, format!("{} is not applied, as a colour space is declared", file.name));
                usual
            }
            FileColour::Space(file) if !raw.display_referred && space.keeps_primaries() => {
                access.remark(path, format!("{} is not applied, as {} is declared", file.name, space.linear_name));
                usual
            }
            FileColour::Space(file) => {
                let to_rec709 = file.to_rec709.map(|matrix| matrix.as_mat3());
                let curves = match &file.curves {
                    Some(curves) if raw.display_referred => {
                        Some(std::array::from_fn(|c| Cow::Owned(table(|x| curves[c].linear(x)))))
                    }
                    Some(curves) if curves.iter().any(|curve| !curve.is_like(&Curve::Power(1.0))) => {
                        access
                            .remark(path, format!("the curve of {} is not applied: the values are floats", file.name));
                        None
                    }
                    _ => usual.curves,
                };
                AppliedColour { curves, to_rec709 }
            }
        }
    }

    fn linear(&self, rgb: [f32; 3]) -> [f32; 3] {
        let linear = match &self.curves {
            Some(curves) => std::array::from_fn(|c| look_up(&curves[c], rgb[c])),
            None => rgb,
        };
        self.to_rec709.map_or(linear, |matrix| (matrix * Vec3::from_array(linear)).to_array())
    }
}

/// Reads a picture that belongs to no capture, such as an environment map, as linear radiance; integer pictures are sRGB unless they say otherwise.
/// It is turned as its orientation says. Memory is charged while it is read, not the result.
pub fn read_radiance(path: &Path, access: &FileAccess) -> Result<RgbImage> {
    Ok(read_radiance_image(path, access, &ColorSpace::from_files(), None)?.colour)
}

/// As [`read_radiance`], integer pictures being of another colour space (see [`ColorSpace::from_name`]); `linear` for numbers that are no
/// colours.
pub fn read_linear_image(path: &Path, access: &FileAccess, color_space: &str) -> Result<RgbImage> {
    Ok(read_radiance_image(path, access, &ColorSpace::from_name(color_space)?, None)?.colour)
}

/// As [`read_linear_image`], of bytes that stand in the file of this name.
pub(crate) fn parse_linear_image(
    path: &Path,
    bytes: &[u8],
    access: &FileAccess,
    color_space: &str,
) -> Result<RgbImage> {
    let space = ColorSpace::from_name(color_space)?;
    Ok(decode(path, bytes, access, None, |raw| RadianceImage::of(path, access, &space, raw).colour)?)
}

/// A picture of 8 bits a colour, upright, and the orientation that it was stored in.
#[cfg(feature = "ar")]
pub(crate) type DisplayPicture = (Grid<[u8; 3]>, ImageOrientation);

/// Reads a picture of 8 bits a colour as it is, not decoded to radiance, but turned as its orientation says. `None` for pictures of other kinds, and
/// for damaged ones.
#[cfg(feature = "ar")]
pub(crate) fn read_display_image(path: &Path, access: &FileAccess) -> Result<Option<DisplayPicture>> {
    let bytes = access.read_bytes(path, "picture file", u64::MAX)?;
    if openexr::is_exr(&bytes) {
        return Ok(None);
    }
    match raster::read_rgb8(&ImageFile { path, bytes: &bytes, access }) {
        Ok(picture) => Ok(picture),
        Err(ImageFault::Unreadable(_)) => Ok(None),
        Err(ImageFault::Wrong(error)) => Err(error),
    }
}

/// Reads a mask: pixels of one half of the brightest colour and brighter show the object; where the colour is the same everywhere and alpha is
/// not, those of one half of alpha and more. Integer masks may be of the values 0 and 1.
pub(crate) fn read_mask(path: &Path, access: &FileAccess, size: (u32, u32)) -> Result<Mask, ImageFault> {
    with_raw(path, access, Some(size), |raw| {
        let orientation = raw.orientation;
        let brightness = |p: &[f32; 4]| p[0].max(p[1]).max(p[2]);
        let pixels = raw.values.as_chunks::<4>().0;
        let one_colour = pixels.iter().all(|p| brightness(p) == brightness(&pixels[0]));
        if raw.has_alpha && one_colour && pixels.iter().any(|p| p[3] < 0.5) {
            return orientation.apply(raw.map(|p| p[3] >= 0.5));
        }
        let brightest = pixels.iter().map(brightness).fold(0.0, f32::max);
        // 1 of 255, or of 65535.
        let half =
            if raw.display_referred && brightest > 0.0 && brightest < 1.5 / 255.0 { 0.5 * brightest } else { 0.5 };
        orientation.apply(raw.map(|p| brightness(p) >= half))
    })
}

/// Bytes of a file's header, at most, and memory of reading it.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// Returns width and height of an image in pixels; reads no more of the file than its header.
pub(crate) fn read_size(path: &Path, access: &FileAccess) -> Result<(u32, u32)> {
    let (file, bytes) = crate::input::open(path)?;
    header_size(path, BufReader::new(file), bytes, access)
}

/// As [`read_size`], of bytes that stand in the file of this name.
pub(crate) fn parse_size(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<(u32, u32)> {
    header_size(path, Cursor::new(bytes), bytes.len() as u64, access)
}

fn header_size(path: &Path, mut file: impl BufRead + Seek, bytes: u64, access: &FileAccess) -> Result<(u32, u32)> {
    let _held = access.reserve(path, "picture header", bytes.min(MAX_HEADER_BYTES))?;
    let is_exr = openexr::is_exr(file.fill_buf().map_err(|e| Error::io(path, e))?);
    let size = if is_exr { openexr::size(file.take(MAX_HEADER_BYTES)) } else { raster::size(file, MAX_HEADER_BYTES) };
    size.map_err(|message| Error::input(path, message))
}

/// A picture as its file has it.
struct RawImage {
    width: usize,
    height: usize,
    /// Red, green, blue and alpha of each pixel.
    values: Vec<f32>,
    has_alpha: bool,
    display_referred: bool,
    /// The largest number of the file's format, where that is within a photograph's reach.
    maximum: Option<f32>,
    /// What the file says about its colours.
    colour: FileColour,
    /// The turn that the pixels still need.
    orientation: ImageOrientation,
}

impl RawImage {
    /// A value for each pixel.
    fn map<T>(&self, value: impl FnMut(&[f32; 4]) -> T) -> Grid<T> {
        Grid { width: self.width, height: self.height, data: self.values.as_chunks().0.iter().map(value).collect() }
    }
    /// Pixels of which a colour is at the maximum, if there are any.
    fn clipped(&self) -> Option<Mask> {
        let maximum = self.maximum?;
        let is_clipped = |p: &[f32; 4]| p[0] >= maximum || p[1] >= maximum || p[2] >= maximum;
        self.values.as_chunks().0.iter().any(is_clipped).then(|| self.map(is_clipped))
    }
}

/// Bytes that a pixel takes while it is decoded, beside the decoder's own: four floats, and the result with its masks.
const WORKING_BYTES: u64 = 16 + 12 + 3;

/// Memory that a picture takes while it is read, at most: the file and what is made of it.
pub(crate) fn reading_memory(file_bytes: u64, width: u32, height: u32) -> u64 {
    // A decoder has up to four floats a pixel, and may hold the file a second time.
    2 * file_bytes
        + u64::from(width) * u64::from(height) * (WORKING_BYTES + 24)
        + raster::PNG_PROFILE_BYTES
        + colour::MEMORY_BYTES
}

/// Reads a file, and gives what is decoded of it to `take` while its memory is charged.
fn with_raw<T>(
    path: &Path,
    access: &FileAccess,
    size: Option<(u32, u32)>,
    take: impl FnOnce(&RawImage) -> T,
) -> Result<T, ImageFault> {
    let bytes = access.read_bytes(path, "picture file", u64::MAX).map_err(ImageFault::from_error)?;
    decode(path, &bytes, access, size, take)
}

fn decode<T>(
    path: &Path,
    bytes: &[u8],
    access: &FileAccess,
    size: Option<(u32, u32)>,
    take: impl FnOnce(&RawImage) -> T,
) -> Result<T, ImageFault> {
    if bytes.is_empty() {
        return Err(unreadable(path, "the picture file is empty (0 bytes)"));
    }
    let file = ImageFile { path, bytes, access };
    let (raw, _held) =
        if openexr::is_exr(bytes) { openexr::read_exr(&file, size)? } else { raster::read_raster(&file, size)? };
    Ok(take(&raw))
}

/// A picture's bytes, and what reading them may use.
struct ImageFile<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    access: &'a FileAccess,
}

impl<'a> ImageFile<'a> {
    /// Charges the memory of decoding, `decoder_bytes` and what every pixel takes, before anything is decoded.
    fn reserve(&self, width: u64, height: u64, decoder_bytes: u64) -> Result<Reservation<'a>, ImageFault> {
        let side = u64::from(self.access.budget().limits().image_side);
        if width == 0 || height == 0 || width > side || height > side {
            let message = format!("a picture of {width} x {height} pixels; 1 to {side} each way are read");
            return Err(ImageFault::Wrong(Error::input(self.path, message)));
        }
        let bytes = (width * height * WORKING_BYTES).saturating_add(decoder_bytes);
        self.access.reserve(self.path, "picture", bytes).map_err(ImageFault::Wrong)
    }
    fn damaged(&self, message: impl std::fmt::Display) -> ImageFault {
        unreadable(self.path, message)
    }
}

fn unreadable(path: &Path, message: impl std::fmt::Display) -> ImageFault {
    ImageFault::Unreadable(Error::input(path, message.to_string()))
}

/// Returns the turn that the pixels of a picture need, whose size is checked. A picture that belongs to no camera is turned as its orientation says;
/// one of a camera if the camera is of the upright size. Where both sizes are the same, the camera is taken to be that of the stored pixels, as
/// programs of structure from motion read them.
fn orient(
    file: &ImageFile,
    stored: (u32, u32),
    orientation: ImageOrientation,
    declared: Option<(u32, u32)>,
) -> Result<ImageOrientation, ImageFault> {
    let Some(declared) = declared else { return Ok(orientation) };
    let upright: (u32, u32) = orientation.swap_sides(stored.into()).into();
    if declared == stored {
        if upright == stored && !orientation.is_upright() {
            let number = orientation.to_exif();
            let text = format!(
                "its orientation (EXIF {number}) is not applied: its camera is taken to be that of the stored pixels"
            );
            file.access.remark(file.path, text);
        }
        return Ok(ImageOrientation::default());
    }
    if declared == upright {
        return Ok(orientation);
    }
    let shown = match upright == stored {
        true => String::new(),
        false => format!(" (upright {} x {})", upright.0, upright.1),
    };
    Err(ImageFault::Wrong(Error::input(
        file.path,
        format!(
            "the picture is {} x {} pixels{shown}, its camera is declared as {} x {}; resize the picture or correct the \
             camera (width, height, focal length and principal point scale together)",
            stored.0, stored.1, declared.0, declared.1
        ),
    )))
}

#[cfg(test)]
mod tests;
