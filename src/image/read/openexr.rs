//! OpenEXR.

use super::{ImageFault, ImageFile, RawImage, check_size};
use crate::limits::Reservation;
use exr::prelude::{ReadChannels, ReadLayers};
use std::io::Cursor;

/// Whether the bytes begin as an OpenEXR file.
pub(super) fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

/// Width and height of the display window.
pub(super) fn size(file: &ImageFile) -> Result<(u32, u32), ImageFault> {
    let damaged = |e: exr::error::Error| file.damaged(format!("EXR: {e}"));
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(file.bytes), false).map_err(damaged)?;
    let header = meta.headers.first().ok_or_else(|| file.damaged("EXR: no layer"))?;
    let window = header.shared_attributes.display_window.size;
    Ok((window.0 as u32, window.1 as u32))
}

/// Whether a channel holds no radiance, by its name.
fn is_depth(name: &exr::meta::attribute::Text) -> bool {
    ["z", "zback", "depth", "id"].contains(&name.to_string().to_ascii_lowercase().as_str())
}

/// The first part with red, green and blue, where it is another than the first part of the file: renderers put depth and masks before it.
fn read_colour_part(
    file: &ImageFile,
    meta: &exr::meta::MetaData,
    (width, height): (usize, usize),
) -> Result<Option<RawImage>, ImageFault> {
    let has = |header: &exr::meta::header::Header, wanted: &str| {
        header.channels.list.iter().any(|channel| channel.name.to_string() == wanted)
    };
    let is_colour =
        |header: &exr::meta::header::Header| !header.deep && ["R", "G", "B"].iter().all(|name| has(header, name));
    match meta.headers.iter().position(is_colour) {
        None | Some(0) => return Ok(None),
        Some(_) => {}
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, _| (size.0, vec![[0f32; 4]; size.0 * size.1]),
            |(columns, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.1 * *columns + at.0] = [r, g, b, a],
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(file.bytes))
        .map_err(|e| file.damaged(format!("EXR: {e}")))?;
    let layer = &image.layer_data;
    let has_alpha = layer.channel_data.channels.3.is_some();
    let (columns, pixels) = &layer.channel_data.pixels;
    let (position, window) = (layer.attributes.layer_position, image.attributes.display_window.position);
    let offset = [i64::from(position.0) - i64::from(window.0), i64::from(position.1) - i64::from(window.1)];
    let black = [0.0, 0.0, 0.0, if has_alpha { 0.0 } else { 1.0 }];
    let mut values = black.repeat(width * height);
    let target = values.as_chunks_mut::<4>().0;
    for (index, pixel) in pixels.iter().enumerate() {
        let (x, y) = ((index % columns) as i64 + offset[0], (index / columns) as i64 + offset[1]);
        if (0..width as i64).contains(&x) && (0..height as i64).contains(&y) {
            target[y as usize * width + x as usize] = *pixel;
        }
    }
    Ok(Some(RawImage { width, height, values, has_alpha, display_referred: false }))
}

pub(super) fn read_exr<'a>(
    file: &ImageFile<'a>,
    size: Option<(u32, u32)>,
) -> Result<(RawImage, Reservation<'a>), ImageFault> {
    let damaged = |e: exr::error::Error| file.damaged(format!("EXR: {e}"));
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(file.bytes), false).map_err(damaged)?;
    let Some(header) = meta.headers.first() else {
        return Err(file.damaged("EXR: no layer"));
    };
    let window = header.shared_attributes.display_window;
    let (width, height) = (window.size.0, window.size.1);
    // Any of the layers may be the one that is read: its samples as they are stored, and of one channel as floats.
    let layers = meta.headers.iter().map(|layer| {
        let area = (layer.layer_size.0 as u64).saturating_mul(layer.layer_size.1 as u64);
        area.saturating_mul(layer.channels.bytes_per_pixel as u64 + 4)
    });
    let held = file.reserve(width as u64, height as u64, layers.max().unwrap_or(0))?;
    check_size(file.path, (width as u32, height as u32), size)?;
    if let Some(raw) = read_colour_part(file, &meta, (width, height))? {
        return Ok((raw, held));
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(file.bytes))
        .map_err(damaged)?;
    let layer = &image.layer_data;
    let channels = &layer.channel_data.list;
    let named = |wanted: &str| channels.iter().position(|c| c.name.to_string().eq_ignore_ascii_case(wanted));
    let colour = match (named("R"), named("G"), named("B"), named("Y")) {
        (Some(r), Some(g), Some(b), _) => [r, g, b],
        (.., Some(y)) if named("RY").is_none() => [y; 3],
        _ if channels.len() == 1 && !is_depth(&channels[0].name) => [0; 3],
        _ => {
            let names: Vec<_> = channels.iter().take(12).map(|c| c.name.to_string()).collect();
            return Err(file.damaged(format!("EXR: channels R, G, B or Y are needed, found {}", names.join(", "))));
        }
    };
    let alpha = named("A");
    // What lies in the display window but not in the data window was not stored, because it is black.
    let black = [0.0, 0.0, 0.0, if alpha.is_some() { 0.0 } else { 1.0 }];
    let mut values = black.repeat(width * height);
    let pixels = values.as_chunks_mut::<4>().0;
    let (layer_position, window_position) = (layer.attributes.layer_position, window.position);
    let offset = [
        i64::from(layer_position.0) - i64::from(window_position.0),
        i64::from(layer_position.1) - i64::from(window_position.1),
    ];
    for (slot, channel) in colour.into_iter().chain(alpha).enumerate() {
        let channel = &channels[channel];
        if channel.sampling.0 != 1 || channel.sampling.1 != 1 {
            return Err(file.damaged("EXR: subsampled channels are not supported"));
        }
        let samples: Vec<f32> = channel.sample_data.values_as_f32().collect();
        for (y, row) in (offset[1]..).zip(samples.chunks_exact(layer.size.0.max(1))) {
            if !(0..height as i64).contains(&y) {
                continue;
            }
            let target = &mut pixels[y as usize * width..(y as usize + 1) * width];
            let start = offset[0].clamp(0, width as i64) as usize;
            let skip = (-offset[0]).max(0) as usize;
            for (pixel, value) in target[start..].iter_mut().zip(row.iter().skip(skip)) {
                pixel[slot] = *value;
            }
        }
    }
    Ok((RawImage { width, height, values, has_alpha: alpha.is_some(), display_referred: false }, held))
}
