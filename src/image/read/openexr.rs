//! OpenEXR.

use super::colour::FileColour;
use super::{ImageFault, ImageFile, RawImage, orient};
use crate::image::ImageOrientation;
use crate::limits::Reservation;
use exr::block::UncompressedBlock;
use exr::block::reader::{ChunksReader, Reader};
use exr::error::Error as ExrError;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{ChannelDescription, SampleType};
use exr::meta::header::Header;
use exr::prelude::f16;
use std::io::{Cursor, Read};

/// Memory of a block while it is decompressed, in multiples of its bytes: as stored, decompressed, and two steps between.
const BLOCK_COPIES: u64 = 4;
/// Channels that an error names, at most.
const MAX_NAMED: usize = 12;

/// Returns `true` if the bytes begin as an OpenEXR file.
pub(super) fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

/// Returns width and height of the display window; reads no more than the header.
pub(super) fn size(header: impl Read) -> Result<(u32, u32), String> {
    let meta = MetaData::read_from_buffered(header, false).map_err(|e| format!("EXR: {e}"))?;
    let header = meta.headers.first().ok_or("EXR: no layer")?;
    let window = header.shared_attributes.display_window.size;
    Ok((window.0 as u32, window.1 as u32))
}

/// Where the colour of a file is: its part, and the channels of red, green and blue, and of alpha where there is one.
struct ColourChannels {
    part: usize,
    colour: [usize; 3],
    alpha: Option<usize>,
}

impl ColourChannels {
    /// Finds the first part with red, green and blue, else the first of luminance, else the first of a single channel. Renderers put depth and
    /// masks before them.
    fn find(headers: &[Header]) -> Result<Self, String> {
        let flat = || headers.iter().enumerate().filter(|(_, header)| !header.deep);
        let named = |header: &Header, wanted: &str| {
            header.channels.list.iter().position(|channel| channel.name.to_string().eq_ignore_ascii_case(wanted))
        };
        let of_colour = |header: &Header| Some([named(header, "R")?, named(header, "G")?, named(header, "B")?]);
        // With colour differences it is no picture of greys.
        let of_grey = |header: &Header| named(header, "Y").filter(|_| named(header, "RY").is_none()).map(|y| [y; 3]);
        let single = |header: &Header| match &header.channels.list[..] {
            [one] if !is_depth(one) => Some([0; 3]),
            _ => None,
        };
        let ways: [&dyn Fn(&Header) -> Option<[usize; 3]>; 3] = [&of_colour, &of_grey, &single];
        let found = ways.iter().find_map(|way| flat().find_map(|(part, header)| Some((part, header, way(header)?))));
        let Some((part, header, colour)) = found else {
            let names = headers.iter().flat_map(|header| header.channels.list.iter().map(|c| c.name.to_string()));
            let names = names.take(MAX_NAMED).collect::<Vec<_>>().join(", ");
            let deep = if headers.iter().all(|header| header.deep) { "deep pixels, which are not read; " } else { "" };
            return Err(format!("EXR: {deep}channels R, G, B or Y are needed, found {names}"));
        };
        // Of other channels, too, as the lines of all stand between each other.
        if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
            return Err("EXR: subsampled channels are not supported".into());
        }
        Ok(ColourChannels { part, colour, alpha: named(header, "A") })
    }
}

/// Returns `true` if a channel holds no radiance, by its name.
fn is_depth(channel: &ChannelDescription) -> bool {
    ["z", "zback", "depth", "id"].contains(&channel.name.to_string().to_ascii_lowercase().as_str())
}

/// Reads the colour of a file block by block into its display window.
pub(super) fn read_exr<'a>(
    file: &ImageFile<'a>,
    size: Option<(u32, u32)>,
) -> Result<(RawImage, Reservation<'a>), ImageFault> {
    let damaged = |e: ExrError| file.damaged(format!("EXR: {e}"));
    let reader = Reader::read_from_buffered(Cursor::new(file.bytes), false).map_err(damaged)?;
    let Some(first) = reader.headers().first() else {
        return Err(file.damaged("EXR: no layer"));
    };
    let window = first.shared_attributes.display_window;
    let (width, height) = (window.size.0, window.size.1);
    let block_bytes = reader.headers().iter().map(block_bytes).max().unwrap_or(0);
    let held = file.reserve(width as u64, height as u64, block_bytes.saturating_mul(BLOCK_COPIES))?;
    let orientation = orient(file, (width as u32, height as u32), ImageOrientation::default(), size)?;
    let colour = match &first.shared_attributes.chromaticities {
        Some(stated) => {
            let primaries = [stated.red, stated.green, stated.blue, stated.white];
            let primaries = primaries.map(|at| [f64::from(at.0), f64::from(at.1)]);
            FileColour::from_primaries("the attribute chromaticities", &primaries, None)
        }
        None => FileColour::Usual,
    };
    let channels = ColourChannels::find(reader.headers()).map_err(|message| file.damaged(message))?;
    let header = reader.headers()[channels.part].clone();
    let position = header.own_attributes.layer_position;
    let offset =
        [i64::from(position.0) - i64::from(window.position.0), i64::from(position.1) - i64::from(window.position.1)];
    // What lies in the display window but not in the data window was not stored, because it is black.
    let has_alpha = channels.alpha.is_some();
    let black = [0.0, 0.0, 0.0, if has_alpha { 0.0 } else { 1.0 }];
    let values = black.repeat(width * height);
    let is_half = |channel: usize| header.channels.list[channel].sample_type == SampleType::F16;
    let maximum = channels.colour.into_iter().all(is_half).then(|| f16::MAX.to_f32());
    let mut raw = RawImage { width, height, values, has_alpha, display_referred: false, maximum, colour, orientation };
    let blocks = reader
        .filter_chunks(false, |_, tile, block| block.layer == channels.part && tile.level_index == Vec2(0, 0))
        .map_err(damaged)?;
    for block in blocks.sequential_decompressor(false) {
        place_block(&block.map_err(damaged)?, &header, &channels, offset, &mut raw);
    }
    Ok((raw, held))
}

/// Bytes of a part's largest block.
fn block_bytes(header: &Header) -> u64 {
    let (block, layer) = (header.max_block_pixel_size(), header.layer_size);
    let pixels = (block.0.min(layer.0) as u64).saturating_mul(block.1.min(layer.1) as u64);
    pixels.saturating_mul(header.channels.bytes_per_pixel as u64)
}

/// Writes what a block has of the picture; `offset` leads from the data window into the picture.
fn place_block(
    block: &UncompressedBlock,
    header: &Header,
    channels: &ColourChannels,
    offset: [i64; 2],
    raw: &mut RawImage,
) {
    let (width, height) = (raw.width as i64, raw.height as i64);
    let wanted: Vec<usize> = channels.colour.into_iter().chain(channels.alpha).collect();
    let pixels = raw.values.as_chunks_mut::<4>().0;
    for line in block.lines(&header.channels) {
        let (x, y) = (line.location.position.0 as i64 + offset[0], line.location.position.1 as i64 + offset[1]);
        if !wanted.contains(&line.location.channel) || !(0..height).contains(&y) {
            continue;
        }
        let from = x.clamp(0, width);
        let target = &mut pixels[(y * width + from) as usize..((y + 1) * width) as usize];
        let skip = (from - x) as usize;
        let mut write = |samples: &mut dyn Iterator<Item = f32>| {
            for (pixel, value) in target.iter_mut().zip(samples.skip(skip)) {
                // A picture of greys has one channel in three places.
                for (slot, _) in wanted.iter().enumerate().filter(|(_, channel)| **channel == line.location.channel) {
                    pixel[slot] = value;
                }
            }
        };
        match header.channels.list[line.location.channel].sample_type {
            SampleType::F16 => {
                write(&mut line.value.as_chunks().0.iter().map(|bytes| f16::from_ne_bytes(*bytes).to_f32()));
            }
            SampleType::F32 => write(&mut line.value.as_chunks().0.iter().map(|bytes| f32::from_ne_bytes(*bytes))),
            SampleType::U32 => {
                write(&mut line.value.as_chunks().0.iter().map(|bytes| u32::from_ne_bytes(*bytes) as f32));
            }
        }
    }
}
