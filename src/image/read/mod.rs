//! Photographs out of files, as linear radiance: EXR, PNG, JPEG, TIFF.

use super::{Grid, Mask, RgbImage, from_srgb};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use crate::limits::Reservation;
use std::path::Path;

mod openexr;
mod raster;

/// Conversion of display-referred images (PNG, JPEG, TIFF of integers) to linear radiance.
/// EXR and floating-point TIFF are linear whatever is declared.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorSpace {
    /// The space of the pixels in memory: always linear; `linear-rec709` but for `linear-NAME` of other primaries, which are kept.
    pub linear_name: String,
    /// Linear value of each 16-bit code.
    table: Vec<f32>,
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
        let table = (0..=65535).map(|code| decode(code as f64 / 65535.0) as f32).collect();
        Ok(ColorSpace { linear_name, table })
    }
    fn linear(&self, encoded: f32) -> f32 {
        // 8-bit codes fall on 16-bit ones: 65535 = 255 * 257.
        self.table[(encoded * 65535.0).round().clamp(0.0, 65535.0) as usize]
    }
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
}

/// Reads a photograph. A given `size` (width, height) is checked before the pixels are decoded.
pub(crate) fn read_radiance_image(
    path: &Path,
    access: &FileAccess,
    space: &ColorSpace,
    size: Option<(u32, u32)>,
) -> Result<RadianceImage, ImageFault> {
    with_raw(path, access, size, |raw| {
        let linear = |value: f32| if raw.display_referred { space.linear(value) } else { value };
        let colour = raw.map(|p| {
            let rgb = [p[0], p[1], p[2]];
            if rgb.iter().all(|c| c.is_finite()) { rgb.map(linear) } else { [f32::NAN; 3] }
        });
        let alpha = raw.has_alpha.then(|| raw.map(|p| p[3] >= 0.5)).filter(|mask| mask.data.contains(&false));
        RadianceImage { colour, alpha }
    })
}

/// Reads a picture that belongs to no capture, such as an environment map, as linear radiance; integer pictures are sRGB.
/// Memory is charged while it is read, not the result.
pub fn read_radiance(path: &Path, access: &FileAccess) -> Result<RgbImage> {
    read_linear_image(path, access, "srgb")
}

/// As [`read_radiance`], integer pictures being of another colour space (see [`ColorSpace::from_name`]); `linear` for numbers that are no
/// colours.
pub fn read_linear_image(path: &Path, access: &FileAccess, color_space: &str) -> Result<RgbImage> {
    Ok(read_radiance_image(path, access, &ColorSpace::from_name(color_space)?, None)?.colour)
}

/// Reads a picture of 8 bits a colour as it is, not decoded to radiance. `None` for pictures of other kinds, and for damaged ones.
#[cfg(feature = "ar")]
pub(crate) fn read_display_image(path: &Path, access: &FileAccess) -> Result<Option<Grid<[u8; 3]>>> {
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
        let brightness = |p: &[f32; 4]| p[0].max(p[1]).max(p[2]);
        let pixels = raw.values.as_chunks::<4>().0;
        let one_colour = pixels.iter().all(|p| brightness(p) == brightness(&pixels[0]));
        if raw.has_alpha && one_colour && pixels.iter().any(|p| p[3] < 0.5) {
            return raw.map(|p| p[3] >= 0.5);
        }
        let brightest = pixels.iter().map(brightness).fold(0.0, f32::max);
        // 1 of 255, or of 65535.
        let half =
            if raw.display_referred && brightest > 0.0 && brightest < 1.5 / 255.0 { 0.5 * brightest } else { 0.5 };
        raw.map(|p| brightness(p) >= half)
    })
}

/// Width and height of an image in pixels, from its header.
pub(crate) fn read_size(path: &Path, access: &FileAccess) -> Result<(u32, u32)> {
    let bytes = access.read_bytes(path, "picture file", u64::MAX)?;
    let file = ImageFile { path, bytes: &bytes, access };
    let size = if openexr::is_exr(&bytes) { openexr::size(&file) } else { raster::size(&file) };
    size.map_err(Error::from)
}

/// A picture as its file has it.
struct RawImage {
    width: usize,
    height: usize,
    /// Red, green, blue and alpha of each pixel.
    values: Vec<f32>,
    has_alpha: bool,
    display_referred: bool,
}

impl RawImage {
    /// A value for each pixel.
    fn map<T>(&self, value: impl FnMut(&[f32; 4]) -> T) -> Grid<T> {
        Grid { width: self.width, height: self.height, data: self.values.as_chunks().0.iter().map(value).collect() }
    }
}

/// Bytes that a pixel takes while it is decoded, beside the decoder's own: four floats, and the result with its mask.
const WORKING_BYTES: u64 = 16 + 12 + 2;

/// Memory that a picture takes while it is read, at most: the file and what is made of it.
pub(crate) fn reading_memory(file_bytes: u64, width: u32, height: u32) -> u64 {
    // A decoder has up to four floats a pixel, and may hold the file a second time.
    2 * file_bytes + u64::from(width) * u64::from(height) * (WORKING_BYTES + 24) + raster::PNG_PROFILE_BYTES
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

fn check_size(path: &Path, found: (u32, u32), declared: Option<(u32, u32)>) -> Result<(), ImageFault> {
    match declared {
        Some(declared) if declared != found => Err(ImageFault::Wrong(Error::input(
            path,
            format!(
                "the picture is {} x {} pixels, its camera is declared as {} x {}; resize the picture or correct the \
                 camera (width, height, focal length and principal point scale together)",
                found.0, found.1, declared.0, declared.1
            ),
        ))),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use crate::image::read::*;

    #[test]
    fn transfer_functions_at_known_codes() {
        let srgb = ColorSpace::from_name("sRGB").unwrap();
        assert!((srgb.linear(188.0 / 255.0) - 0.502_886_5).abs() < 1e-6);
        assert!((srgb.linear(10.0 / 255.0) - 10.0 / 255.0 / 12.92).abs() < 1e-8);
        assert_eq!((srgb.linear(0.0), srgb.linear(1.0)), (0.0, 1.0));
        let rec709 = ColorSpace::from_name("rec709").unwrap();
        assert!((rec709.linear(0.5) - ((0.5f32 + 0.099) / 1.099).powf(1.0 / 0.45)).abs() < 2e-5);
        let gamma = ColorSpace::from_name("gamma-2.2").unwrap();
        assert!((gamma.linear(128.0 / 255.0) - (128.0f32 / 255.0).powf(2.2)).abs() < 1e-6);
        let other = ColorSpace::from_name("linear-rec2020").unwrap();
        assert_eq!((other.linear(1.0), other.linear_name.as_str()), (1.0, "linear-rec2020"));
        assert!(matches!(ColorSpace::from_name("gamma-x"), Err(Error::Unsupported(_))));
        assert!(matches!(ColorSpace::from_name("slog3"), Err(Error::Unsupported(_))));
    }

    #[test]
    fn every_format_gives_the_same_radiance() {
        let folder = tempfile::tempdir().unwrap();
        let space = ColorSpace::from_name("srgb").unwrap();
        let read = |name: &str| {
            let path = folder.path().join(name);
            match read_radiance_image(&path, &FileAccess::default(), &space, Some((3, 2))) {
                Ok(picture) => picture,
                Err(fault) => panic!("{}", Error::from(fault)),
            }
        };
        let codes: Vec<u8> = (0..18).map(|i| i * 15).collect();
        let picture = image::RgbImage::from_raw(3, 2, codes.clone()).unwrap();
        picture.save(folder.path().join("a.png")).unwrap();
        picture.save(folder.path().join("a.tiff")).unwrap();
        let deep: Vec<u16> = codes.iter().map(|&c| c as u16 * 257).collect();
        let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(3, 2, deep).unwrap();
        deep.save(folder.path().join("b.png")).unwrap();
        let linear = |i: usize| space.linear(codes[i] as f32 / 255.0);
        exr::prelude::write_rgb_file(folder.path().join("a.exr"), 3, 2, |x, y| {
            let at = (y * 3 + x) * 3;
            (linear(at), linear(at + 1), linear(at + 2))
        })
        .unwrap();
        for name in ["a.png", "b.png", "a.tiff", "a.exr"] {
            let picture = read(name);
            assert!(picture.alpha.is_none());
            let found: Vec<f32> = picture.colour.data.iter().flatten().copied().collect();
            assert_eq!(found, (0..18).map(linear).collect::<Vec<_>>(), "{name}");
        }
        let grey = image::GrayImage::from_raw(3, 2, vec![0, 50, 100, 150, 200, 255]).unwrap();
        grey.save(folder.path().join("g.jpg")).unwrap();
        let picture = read("g.jpg");
        assert!((picture.colour.data[5][1] - 1.0).abs() < 0.1);
        let mut clear = image::RgbaImage::from_pixel(3, 2, image::Rgba([9, 9, 9, 255]));
        clear.put_pixel(1, 1, image::Rgba([9, 9, 9, 100]));
        clear.save(folder.path().join("c.png")).unwrap();
        assert_eq!(read("c.png").alpha.unwrap().data, [true, true, true, true, false, true]);
    }

    #[test]
    fn cropped_and_damaged_exr() {
        use exr::prelude::*;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cropped.exr");
        let values = SpecificChannels::rgb(|p: Vec2<usize>| {
            if p == Vec2(1, 0) { (f32::INFINITY, 1.0, 1.0) } else { (p.x() as f32 + 1.0, p.y() as f32, 3.0) }
        });
        let mut layer = LayerAttributes::named("main");
        layer.layer_position = Vec2(11, 6);
        let layer = Layer::new((2, 2), layer, Encoding::FAST_LOSSLESS, values);
        let window = IntegerBounds { position: Vec2(10, 5), size: Vec2(4, 3) };
        Image { attributes: ImageAttributes::new(window), layer_data: layer }.write().to_file(&path).unwrap();
        let space = ColorSpace::from_name("srgb").unwrap();
        let picture = read_radiance_image(&path, &FileAccess::default(), &space, Some((4, 3))).ok().unwrap().colour;
        assert_eq!(*picture.value_at(0, 0), [0.0; 3]);
        assert_eq!(*picture.value_at(1, 1), [1.0, 0.0, 3.0]);
        assert_eq!(*picture.value_at(2, 2), [2.0, 1.0, 3.0]);
        assert!(picture.value_at(2, 1).iter().all(|c| c.is_nan()));
        let whole = std::fs::read(&path).unwrap();
        for length in [0, 1, 4, 20, whole.len() / 2, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(
                matches!(
                    read_radiance_image(&path, &FileAccess::default(), &space, None),
                    Err(ImageFault::Unreadable(_))
                ),
                "{length}"
            );
        }
    }

    #[test]
    fn flipped_bytes_never_panic() {
        let folder = tempfile::tempdir().unwrap();
        let picture = image::RgbImage::from_fn(9, 7, |x, y| image::Rgb([(x * 20) as u8, (y * 30) as u8, 5]));
        for name in ["a.png", "a.tiff", "a.jpg", "a.exr"] {
            let file = folder.path().join(name);
            match name {
                "a.exr" => exr::prelude::write_rgb_file(&file, 9, 7, |x, y| (x as f32, y as f32, 0.5)).unwrap(),
                _ => picture.save(&file).unwrap(),
            }
            let whole = std::fs::read(&file).unwrap();
            for at in 0..whole.len().min(700) {
                for value in [0, 0x7f, 0xff, whole[at] ^ 1] {
                    let mut bytes = whole.clone();
                    bytes[at] = value;
                    let access = FileAccess::default();
                    let read = |raw: &RawImage| raw.values.len();
                    if let Ok(count) = decode(&file, &bytes, &access, Some((9, 7)), read) {
                        assert_eq!(count, 4 * 63);
                    }
                }
            }
        }
    }
}
