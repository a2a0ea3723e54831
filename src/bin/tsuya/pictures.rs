//! Images as bytes of PNG and EXR files.

use anyhow::{Context, Result};
use exr::prelude::{Encoding, Image, SpecificChannels, Vec2, WritableImage, f16};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io::Cursor;
use tsuya::image::{Grid, Mask, RgbImage, to_srgb};
use tsuya::metrics::DisplayImage;

/// 8-bit PNG.
pub fn png(picture: &DisplayImage) -> Result<Vec<u8>> {
    let bytes: Vec<u8> = picture.data.iter().flatten().copied().collect();
    encode_png(&bytes, picture.width, picture.height, ExtendedColorType::Rgb8)
}

/// 16-bit PNG, sRGB; `white` becomes 65535, what is brighter is clamped.
pub fn png16(image: &RgbImage, white: [f64; 3]) -> Result<Vec<u8>> {
    let code = |value: f32, white: f64| {
        let x = (value as f64 / white).clamp(0.0, 1.0);
        (to_srgb(x) * 65535.0).round() as u16
    };
    let bytes: Vec<u8> = (image.data.iter())
        .flat_map(|pixel| std::array::from_fn::<u16, 3, _>(|c| code(pixel[c], white[c])))
        .flat_map(u16::to_ne_bytes)
        .collect();
    encode_png(&bytes, image.width, image.height, ExtendedColorType::Rgb16)
}

/// 8-bit grey PNG, 255 within the mask.
pub fn mask_png(mask: &Mask) -> Result<Vec<u8>> {
    let bytes: Vec<u8> = mask.data.iter().map(|&inside| if inside { 255 } else { 0 }).collect();
    encode_png(&bytes, mask.width, mask.height, ExtendedColorType::L8)
}

fn encode_png(bytes: &[u8], width: usize, height: usize, colour: ExtendedColorType) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    PngEncoder::new(&mut file).write_image(bytes, width as u32, height as u32, colour).context("PNG")?;
    Ok(file)
}

/// What lies outside the mask is zero and costs next to nothing with run lengths; ZIP would take ten times as long to save a third.
const ENCODING: Encoding = Encoding::FAST_LOSSLESS;

/// EXR, linear, 32-bit floats or halves.
pub fn exr(image: &RgbImage, half: bool) -> Result<Vec<u8>> {
    let at = |p: Vec2<usize>| *image.value_at(p.x(), p.y());
    let size = (image.width, image.height);
    let mut file = Cursor::new(Vec::new());
    if half {
        let pixel = |p: Vec2<usize>| {
            let [r, g, b] = at(p).map(f16::from_f32);
            (r, g, b)
        };
        let channels = SpecificChannels::rgb(pixel);
        Image::from_encoded_channels(size, ENCODING, channels).write().non_parallel().to_buffered(&mut file)
    } else {
        let channels = SpecificChannels::rgb(|p: Vec2<usize>| {
            let [r, g, b] = at(p);
            (r, g, b)
        });
        Image::from_encoded_channels(size, ENCODING, channels).write().non_parallel().to_buffered(&mut file)
    }
    .context("EXR")?;
    Ok(file.into_inner())
}

/// EXR of one channel, Y.
pub fn exr_grey(image: &Grid<f32>) -> Result<Vec<u8>> {
    let channels =
        SpecificChannels::build().with_channel("Y").with_pixel_fn(|p: Vec2<usize>| (*image.value_at(p.x(), p.y()),));
    let mut file = Cursor::new(Vec::new());
    Image::from_encoded_channels((image.width, image.height), ENCODING, channels)
        .write()
        .non_parallel()
        .to_buffered(&mut file)
        .context("EXR")?;
    Ok(file.into_inner())
}

/// Images side by side, a dark gap between them.
pub fn beside(pictures: &[DisplayImage]) -> DisplayImage {
    const GAP: usize = 4;
    let width = pictures.iter().map(|p| p.width).sum::<usize>() + GAP * pictures.len().saturating_sub(1);
    let height = pictures.iter().map(|p| p.height).max().unwrap_or(0);
    let mut joined = Grid::filled(width, height, [24; 3]);
    let mut left = 0;
    for picture in pictures {
        for y in 0..picture.height {
            let start = y * width + left;
            joined.data[start..start + picture.width].copy_from_slice(picture.row(y));
        }
        left += picture.width + GAP;
    }
    joined
}

/// Every pixel as a square of `factor` pixels.
pub fn enlarged(picture: &DisplayImage, factor: usize) -> DisplayImage {
    let (width, height) = (picture.width * factor, picture.height * factor);
    let pixel = |k: usize| *picture.value_at(k % width / factor, k / width / factor);
    Grid { width, height, data: (0..width * height).map(pixel).collect() }
}

/// The part within the mask, black elsewhere.
pub fn masked(image: &RgbImage, mask: &Mask) -> RgbImage {
    let data = image.data.iter().zip(&mask.data).map(|(&pixel, &inside)| if inside { pixel } else { [0.0; 3] });
    Grid { width: image.width, height: image.height, data: data.collect() }
}
