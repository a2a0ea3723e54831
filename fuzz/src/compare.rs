//! A file decoded in every way there is: whole, view by view, from ranges and from a stream. All give the same bits.

use std::sync::Arc;
use tsuya::Asset;
use tsuya::Charts;
use tsuya::Mesh;
use tsuya::Photograph;
use tsuya::container::Poll;
use tsuya::decoder::{DecodeOptions, IncrementalDecoder, ViewSelection, ViewStatus, decode};
use tsuya::{Error, Limits, Result};

/// Decodes in every way and compares; the whole asset where it decodes.
pub fn decode_in_every_way(bytes: &[u8], limits: Limits) -> Result<Asset> {
    let options = |selection| DecodeOptions { limits, selection, ..Default::default() };
    let whole = decode(bytes, &options(ViewSelection::All));
    let views = whole.as_ref().map_or(4, |asset| asset.views.len());
    // What was decoded before must not matter: one view alone, and all from the last to the first.
    let backwards: Vec<usize> = (0..views).rev().collect();
    if views > 0 {
        let view = bytes.len() % views;
        let one = decode(bytes, &options(ViewSelection::Views(vec![view])));
        if let (Some(asset), Some(one)) = (whole.as_ref().ok(), agreed(&whole, one)) {
            same(&asset.photographs[view], &one.photographs[view]);
        }
    }
    let mut ranges = IncrementalDecoder::new(Some(bytes.len() as u64), true, limits);
    compare(&whole, &mut ranges, bytes, &backwards);
    let mut stream = IncrementalDecoder::new(None, false, limits);
    for (index, piece) in bytes.chunks(1 + bytes.len() / 7).enumerate() {
        let offset = index * (1 + bytes.len() / 7);
        if stream.feed(offset as u64, piece).is_err() || stream.header().is_err() {
            break;
        }
    }
    stream.set_length(bytes.len() as u64);
    let onwards: Vec<usize> = (0..views).map(|view| (view + 1) % views).collect();
    compare(&whole, &mut stream, bytes, &onwards);
    whole
}

/// Asks a file that arrives for everything, and compares it with the whole.
fn compare(whole: &Result<Asset>, file: &mut IncrementalDecoder, bytes: &[u8], order: &[usize]) {
    let asset = whole.as_ref().ok();
    let opened = fetch(file, bytes, |file| file.header());
    if let (Some(asset), Some(opened)) = (asset, agreed(whole, opened)) {
        assert_eq!(asset.views, opened.capture.views);
        assert_eq!(asset.metadata, opened.metadata.0);
    }
    for &view in order {
        let decoded = fetch(file, bytes, |file| {
            loop {
                let progress = match file.view(view)? {
                    Poll::Ready(progress) => progress,
                    Poll::NeedRanges(ranges) => return Ok(Poll::NeedRanges(ranges)),
                };
                match progress {
                    ViewStatus::Decoded(photograph) => return Ok(Poll::Ready(Some(photograph))),
                    ViewStatus::Absent => return Ok(Poll::Ready(None)),
                    ViewStatus::InProgress => {}
                }
            }
        });
        if let (Some(asset), Some(decoded)) = (asset, agreed(whole, decoded)) {
            same(&asset.photographs[view], &decoded);
        }
    }
    macro_rules! part {
        ($name:ident, $asset:ident => $expected:expr) => {
            let part = fetch(file, bytes, |file| file.$name());
            if let (Some($asset), Some(part)) = (asset, agreed(whole, part)) {
                assert!($expected(part), "{} differs", stringify!($name));
            }
        };
    }
    part!(mesh, asset => |part: Option<Arc<Mesh>>| asset.mesh == *part.unwrap_or_default());
    part!(charts, asset => |part: Option<Arc<Charts>>| asset.charts.as_ref() == part.as_deref());
    part!(surface, asset => |part| asset.surface == part);
    part!(reflectance, asset => |part| asset.reflectance == part);
    part!(visibility, asset => |part| asset.visibility == part);
    part!(light, asset => |part| asset.light == part);
    part!(materials, asset => |part| asset.materials == part);
    part!(coordinates, asset => |part| asset.coordinates == part);
    part!(binding, asset => |part| asset.binding == part);
    let _ = fetch(file, bytes, |file| file.verify());
}

/// What a second way gave. Where the whole file decodes it must, too, unless it keeps more at a time than the limits allow.
fn agreed<T>(whole: &Result<Asset>, part: Result<T>) -> Option<T> {
    match part {
        Ok(part) => Some(part),
        Err(Error::Limits { .. }) => None,
        Err(error) if whole.is_ok() => panic!("the whole file decodes, a part does not: {error}"),
        Err(_) => None,
    }
}

/// Asks until it is there, giving the ranges that are missing.
fn fetch<T>(
    file: &mut IncrementalDecoder,
    bytes: &[u8],
    mut ask: impl FnMut(&mut IncrementalDecoder) -> Result<Poll<T>>,
) -> Result<T> {
    for _ in 0..10_000 {
        match ask(file)? {
            Poll::Ready(value) => return Ok(value),
            Poll::NeedRanges(ranges) => {
                let mut given = 0;
                for range in ranges {
                    let [start, end] = [range.start, range.end].map(|at| at.min(bytes.len() as u64) as usize);
                    file.feed(start as u64, &bytes[start..end])?;
                    given += end - start;
                }
                assert!(given > 0, "only bytes beyond the end are asked for");
            }
        }
    }
    panic!("asked 10,000 times and not there");
}

/// The same photograph, bit for bit.
pub fn same(a: &Option<Photograph>, b: &Option<Photograph>) {
    let (Some(a), Some(b)) = (a, b) else {
        assert!(a.is_none() && b.is_none(), "a photograph is there one way only");
        return;
    };
    assert!(a.mask == b.mask, "masks differ");
    let bits = |p: &Photograph| -> Vec<u32> {
        p.images.iter().flat_map(|image| image.data.iter().flatten().map(|x| x.to_bits())).collect()
    };
    assert!(bits(a) == bits(b), "photographs differ");
}
