//! Photographs out of files, as linear radiance: EXR, PNG, JPEG, TIFF.

use crate::error::{Error, Result};
use crate::image::{Grid, Mask, RgbImage, from_srgb};
use image::{ColorType, DynamicImage, ImageDecoder, ImageReader};
use std::io::Cursor;
use std::path::Path;

/// Bytes that one picture may take in memory while it is read.
const PICTURE_BYTES: u64 = 8 << 30;

/// How the numbers of display-referred pictures (PNG, JPEG, TIFF of integers) become radiance.
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
    pub fn named(name: &str) -> Result<Self> {
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

/// Why a picture was not read.
pub(crate) enum Fault {
    /// It is missing or damaged: the frame can be left out.
    Unreadable(Error),
    /// It contradicts the capture: nothing should go on.
    Wrong(Error),
}

impl From<Fault> for Error {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Unreadable(e) | Fault::Wrong(e) => e,
        }
    }
}

/// A picture in linear radiance.
pub(crate) struct Picture {
    /// Missing pixels (NaN or infinite in any colour) are NaN in all three.
    pub colour: RgbImage,
    /// Pixels whose alpha is one half or more; `None` without alpha, or where all are.
    pub alpha: Option<Mask>,
}

/// Reads a photograph. A given `size` (width, height) is checked before the pixels are decoded.
pub(crate) fn read_picture(path: &Path, space: &ColorSpace, size: Option<(u32, u32)>) -> Result<Picture, Fault> {
    let raw = read_raw(path, size)?;
    let linear = |value: f32| if raw.display_referred { space.linear(value) } else { value };
    let colour = raw.pixels.map(|p| {
        let rgb = [p[0], p[1], p[2]];
        if rgb.iter().all(|c| c.is_finite()) { rgb.map(linear) } else { [f32::NAN; 3] }
    });
    let alpha = raw.has_alpha.then(|| raw.pixels.map(|p| p[3] >= 0.5)).filter(|mask| mask.data.contains(&false));
    Ok(Picture { colour, alpha })
}

/// Reads a picture that belongs to no capture, such as an environment map, as linear radiance; integer pictures are sRGB.
pub fn read_radiance(path: &Path) -> Result<RgbImage> {
    Ok(read_picture(path, &ColorSpace::named("srgb")?, None)?.colour)
}

/// As [`read_radiance`], integer pictures being of another colour space (see [`ColorSpace::named`]); `linear` for numbers that are no
/// colours.
pub fn read_values(path: &Path, color_space: &str) -> Result<RgbImage> {
    Ok(read_picture(path, &ColorSpace::named(color_space)?, None)?.colour)
}

/// Reads a mask: pixels of one half and brighter show the object.
pub(super) fn read_mask(path: &Path, size: (u32, u32)) -> Result<Mask, Fault> {
    let raw = read_raw(path, Some(size))?;
    Ok(raw.pixels.map(|p| p[0].max(p[1]).max(p[2]) >= 0.5))
}

struct RawPicture {
    pixels: Grid<[f32; 4]>,
    has_alpha: bool,
    display_referred: bool,
}

fn read_raw(path: &Path, size: Option<(u32, u32)>) -> Result<RawPicture, Fault> {
    let bytes = std::fs::read(path).map_err(|e| Fault::Unreadable(Error::io(path, e)))?;
    decode(path, &bytes, size)
}

fn decode(path: &Path, bytes: &[u8], size: Option<(u32, u32)>) -> Result<RawPicture, Fault> {
    if bytes.is_empty() {
        return Err(unreadable(path, "the picture file is empty (0 bytes)"));
    }
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        read_exr(path, bytes, size)
    } else {
        read_display_referred(path, bytes, size)
    }
}

fn unreadable(path: &Path, message: impl std::fmt::Display) -> Fault {
    Fault::Unreadable(Error::input(path, message.to_string()))
}

fn check_size(path: &Path, found: (u32, u32), declared: Option<(u32, u32)>) -> Result<(), Fault> {
    match declared {
        Some(declared) if declared != found => Err(Fault::Wrong(Error::input(
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

fn read_display_referred(path: &Path, bytes: &[u8], size: Option<(u32, u32)>) -> Result<RawPicture, Fault> {
    let damaged = |e: image::ImageError| unreadable(path, format!("not readable as a picture: {e}"));
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| Fault::Unreadable(Error::io(path, e)))?;
    if reader.format().is_none() {
        return Err(unreadable(path, "not a picture that tsuya reads: it should be EXR, PNG, JPEG or TIFF"));
    }
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(PICTURE_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(damaged)?;
    check_size(path, decoder.dimensions(), size)?;
    let picture = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    let colour_type = picture.color();
    let display_referred = !matches!(colour_type, ColorType::Rgb32F | ColorType::Rgba32F);
    let has_alpha = colour_type.has_alpha();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let pixels = picture.into_rgba32f().into_raw().chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
    Ok(RawPicture { pixels: Grid { width, height, data: pixels }, has_alpha, display_referred })
}

fn read_exr(path: &Path, bytes: &[u8], size: Option<(u32, u32)>) -> Result<RawPicture, Fault> {
    use exr::prelude::{ReadChannels, ReadLayers};
    let damaged = |e: exr::error::Error| unreadable(path, format!("EXR: {e}"));
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(damaged)?;
    let Some(header) = meta.headers.first() else {
        return Err(unreadable(path, "EXR: no layer"));
    };
    let window = header.shared_attributes.display_window;
    let (width, height) = (window.size.0, window.size.1);
    check_size(path, (width as u32, height as u32), size)?;
    let in_layers = meta.headers.iter().map(|h| h.layer_size.0 as u64 * h.layer_size.1 as u64).max().unwrap_or(0);
    if in_layers.max(width as u64 * height as u64).saturating_mul(32) > PICTURE_BYTES {
        return Err(unreadable(path, "EXR: the picture claims more pixels than tsuya reads"));
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(damaged)?;
    let layer = &image.layer_data;
    let channels = &layer.channel_data.list;
    let named = |wanted: &str| channels.iter().position(|c| c.name.to_string().eq_ignore_ascii_case(wanted));
    let colour = match (named("R"), named("G"), named("B"), named("Y")) {
        (Some(r), Some(g), Some(b), _) => [r, g, b],
        (.., Some(y)) if named("RY").is_none() => [y; 3],
        _ if channels.len() == 1 => [0; 3],
        _ => {
            let names: Vec<_> = channels.iter().map(|c| c.name.to_string()).collect();
            return Err(unreadable(path, format!("EXR: channels R, G, B or Y are needed, found {}", names.join(", "))));
        }
    };
    let alpha = named("A");
    // What lies in the display window but not in the data window was not stored, because it is black.
    let mut pixels = Grid::filled(width, height, [0.0, 0.0, 0.0, if alpha.is_some() { 0.0 } else { 1.0 }]);
    let offset = layer.attributes.layer_position - window.position;
    for (slot, channel) in colour.into_iter().chain(alpha).enumerate() {
        let channel = &channels[channel];
        if channel.sampling.0 != 1 || channel.sampling.1 != 1 {
            return Err(unreadable(path, "EXR: subsampled channels are not supported"));
        }
        let samples: Vec<f32> = channel.sample_data.values_as_f32().collect();
        for (y, row) in (offset.1 as i64..).zip(samples.chunks_exact(layer.size.0.max(1))) {
            if !(0..height as i64).contains(&y) {
                continue;
            }
            let target = &mut pixels.data[y as usize * width..(y as usize + 1) * width];
            let start = (offset.0 as i64).clamp(0, width as i64) as usize;
            let skip = (-(offset.0 as i64)).max(0) as usize;
            for (pixel, value) in target[start..].iter_mut().zip(row.iter().skip(skip)) {
                pixel[slot] = *value;
            }
        }
    }
    Ok(RawPicture { pixels, has_alpha: alpha.is_some(), display_referred: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transfer_functions_at_known_codes() {
        let srgb = ColorSpace::named("sRGB").unwrap();
        assert!((srgb.linear(188.0 / 255.0) - 0.502_886_5).abs() < 1e-6);
        assert!((srgb.linear(10.0 / 255.0) - 10.0 / 255.0 / 12.92).abs() < 1e-8);
        assert_eq!((srgb.linear(0.0), srgb.linear(1.0)), (0.0, 1.0));
        let rec709 = ColorSpace::named("rec709").unwrap();
        assert!((rec709.linear(0.5) - ((0.5f32 + 0.099) / 1.099).powf(1.0 / 0.45)).abs() < 2e-5);
        let gamma = ColorSpace::named("gamma-2.2").unwrap();
        assert!((gamma.linear(128.0 / 255.0) - (128.0f32 / 255.0).powf(2.2)).abs() < 1e-6);
        let other = ColorSpace::named("linear-rec2020").unwrap();
        assert_eq!((other.linear(1.0), other.linear_name.as_str()), (1.0, "linear-rec2020"));
        assert!(matches!(ColorSpace::named("gamma-x"), Err(Error::Unsupported(_))));
        assert!(matches!(ColorSpace::named("slog3"), Err(Error::Unsupported(_))));
    }

    #[test]
    fn every_format_gives_the_same_radiance() {
        let folder = tempfile::tempdir().unwrap();
        let space = ColorSpace::named("srgb").unwrap();
        let read = |name: &str| {
            let path = folder.path().join(name);
            match read_picture(&path, &space, Some((3, 2))) {
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
        let space = ColorSpace::named("srgb").unwrap();
        let picture = read_picture(&path, &space, Some((4, 3))).ok().unwrap().colour;
        assert_eq!(*picture.at(0, 0), [0.0; 3]);
        assert_eq!(*picture.at(1, 1), [1.0, 0.0, 3.0]);
        assert_eq!(*picture.at(2, 2), [2.0, 1.0, 3.0]);
        assert!(picture.at(2, 1).iter().all(|c| c.is_nan()));
        let whole = std::fs::read(&path).unwrap();
        for length in [0, 1, 4, 20, whole.len() / 2, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(matches!(read_picture(&path, &space, None), Err(Fault::Unreadable(_))), "{length}");
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
                    if let Ok(picture) = decode(&file, &bytes, Some((9, 7))) {
                        assert_eq!(picture.pixels.data.len(), 63);
                    }
                }
            }
        }
    }
}
