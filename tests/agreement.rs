//! Every way of decoding a file gives the same bits, and the error that the file states is the one that they have: for each kind of
//! capture, both profiles and all decoding modes.

use crate::support;
use tsuya::Asset;
use tsuya::Photograph;
use tsuya::capture::Capture;
use tsuya::container::{Container, ContainerWriter, Metadata, Poll, SectionCodec, Tag};
use tsuya::decoder::{DecodeOptions, IncrementalDecoder, ViewSelection, ViewStatus, decode, decode_from};
use tsuya::encoder::{EncodedFile, encode, separate};
use tsuya::image::Region;
use tsuya::internals::surface::rasterise;
use tsuya::metrics::PhotographError;
use tsuya::{DecodeSpeed, EncodeOptions, Profile};
use tsuya::{Limits, Result};

/// The last number is the side of tiles.
const CODINGS: [(Profile, DecodeSpeed, u32); 5] = [
    (Profile::Predictive, DecodeSpeed::Normal, 256),
    (Profile::Predictive, DecodeSpeed::Fast, 256),
    (Profile::Predictive, DecodeSpeed::Fastest, 256),
    (Profile::Predictive, DecodeSpeed::Fastest, 16),
    (Profile::WaveletTexture, DecodeSpeed::Normal, 256),
];

#[test]
fn sample_spot() {
    let mut capture = support::read(&support::sample()).unwrap();
    capture.frames.truncate(4);
    agree(capture, 0.95);
}

/// Masks that are not what the mesh covers, two lights, views of nothing.
#[test]
fn dome() {
    let capture = support::read(&support::bundled("dome")).unwrap();
    assert_eq!((capture.frames.len(), capture.skipped_frames), (18, 1), "one of 19 masks is empty");
    assert!(capture.warnings[0].ends_with("16.png: the mask is empty: no pixel shows the object"));
    agree(capture, 0.6);
}

/// One component; a mask in every second photograph's alpha.
#[test]
fn unpolarised() {
    let capture = support::read(&support::bundled("unpolarised")).unwrap();
    assert_eq!(capture.frames.iter().filter(|frame| frame.mask.is_some()).count(), 5);
    agree(capture, 0.99);
}

/// Photographs and masks taken through lenses meet the mesh once they are straight.
#[test]
fn lens() {
    let capture = support::read(&support::bundled("lens")).unwrap();
    let bent = |frame: &tsuya::capture::CaptureFrame| frame.photograph.data.iter().any(|pixel| pixel[0].is_nan());
    assert!(capture.frames.iter().any(bent), "straight pictures reach beyond some of the photographs");
    agree(capture, 0.98);
}

/// A COLMAP model with pictures of nine sizes, down to 5 x 4 pixels.
#[test]
fn sizes() {
    let capture = support::read(&support::bundled("sizes")).unwrap();
    assert_eq!((capture.frames[4].photograph.width, capture.frames[4].photograph.height), (5, 4));
    agree(capture, 0.85);
}

/// A file with sections PLAN and PAPR, the latter first.
#[test]
fn of_both_profiles_the_planes_count() {
    let mut capture = support::read(&support::sample()).unwrap();
    capture.frames.truncate(2);
    let [planes, paper] = [Profile::Predictive, Profile::WaveletTexture]
        .map(|profile| encode(capture.clone(), &EncodeOptions { profile, ..Default::default() }).unwrap().bytes);
    let mut writer = ContainerWriter::new(Vec::new()).unwrap();
    let mut copy = |file: &[u8], tags: &[Tag]| {
        let mut file = Container::open_slice(file, Limits::default()).unwrap();
        for &tag in tags {
            writer.write_section(tag, SectionCodec::Own, &file.read_section(tag).unwrap()).unwrap();
        }
    };
    copy(&paper, &[Tag::MESH, Tag::VIEWS, Tag::WAVELET_TEXTURE]);
    copy(&planes, &[Tag::CHARTS, Tag::REFLECTANCE, Tag::PLANES]);
    let both = writer.finish().unwrap();
    let expected = whole(&planes).photographs;
    assert_same(&expected, &whole(&both).photographs, "whole");
    for way in [by_selection, by_ranges, from_a_stream] {
        assert_same(&expected, &way(&both, 2, &mut Random(1)), "view by view");
    }
}

/// Encodes a capture in every way, decodes each file in every way and compares. Masks are of pixels that the mesh covers, at least
/// by the share `coverage`.
fn agree(capture: Capture, coverage: f64) {
    for (profile, decode_speed, tile_side) in CODINGS {
        let what = format!("{profile:?} {decode_speed:?}, tiles of {tile_side}");
        let options = EncodeOptions { profile, decode_speed, tile_side, ..Default::default() };
        let encoded = encode(capture.clone(), &options).unwrap();
        assert!(encoded.coverage > coverage, "{what}: the mesh covers {} of the masks", encoded.coverage);
        let [first, rest @ ..] = [1, 2, 5].map(|threads| with_threads(threads, || whole(&encoded.bytes)));
        for (other, threads) in rest.iter().zip([2, 5]) {
            assert_same(&first.photographs, &other.photographs, &format!("{what}, {threads} threads"));
        }
        let mut random = Random(0x5eed);
        for way in [by_selection, by_ranges, from_a_stream] {
            let photographs = way(&encoded.bytes, first.views.len(), &mut random);
            assert_same(&first.photographs, &photographs, &what);
        }
        check_error(capture.clone(), &first, &encoded, &what);
        check_reductions(&encoded.bytes, &first, profile, &what);
        let reductions = if profile == Profile::WaveletTexture { 0..1 } else { 0..4 };
        for reduction in reductions {
            check_regions(&encoded.bytes, reduction, &mut random, &what);
        }
    }
}

/// Smaller photographs are the same in every way, or refused where one is too small.
fn check_reductions(bytes: &[u8], asset: &Asset, profile: Profile, what: &str) {
    for reduction in [1, 3] {
        let what = format!("{what}, halved {reduction} times");
        let options = DecodeOptions { reduction, ..Default::default() };
        let least = asset.views.iter().map(|view| view.camera.width.min(view.camera.height)).min().unwrap();
        if profile == Profile::WaveletTexture || least >> reduction < 4 {
            assert!(matches!(decode(bytes, &options), Err(tsuya::Error::Parameter(_))), "{what}");
            continue;
        }
        let [first, other] =
            [1, 3].map(|threads| with_threads(threads, || decode(bytes, &options).unwrap().photographs));
        assert_same(&first, &other, &what);
        let mut file = IncrementalDecoder::new(Some(bytes.len() as u64), true, Limits::default());
        file.set_reduction(reduction);
        let mut fetched = 0;
        let one_by_one = view_by_view(&mut file, Random(7).order(first.len()), |file, wanted| {
            fetched += wanted.iter().map(|range| range.end - range.start).sum::<u64>();
            wanted.iter().try_for_each(|range| file.feed(range.start, &bytes[range.start as usize..range.end as usize]))
        });
        assert_same(&first, &one_by_one, &what);
        assert!(fetched < bytes.len() as u64, "{what}");
    }
}

/// Regions are the same bits as in the whole photographs, wherever they lie: of all views together, and of one after the other.
fn check_regions(bytes: &[u8], reduction: u8, random: &mut Random, what: &str) {
    let what = format!("{what}, halved {reduction} times");
    let options = DecodeOptions { reduction, ..Default::default() };
    let Ok(whole) = decode(bytes, &options) else { return };
    let mut inside = |width: u32, height: u32| {
        let mut part = |size: u32| {
            let length = 1 + random.below(size as usize) as u32;
            (random.below((size - length + 1) as usize) as u32, length)
        };
        let ((left, width), (top, height)) = (part(width), part(height));
        Region { left, top, width, height }
    };
    let cropped = |view: usize, region: Region| whole.photographs[view].as_ref().map(|whole| whole.cropped(&region));
    let sizes = || whole.views.iter().map(|view| [view.camera.width, view.camera.height]);
    let least = [0, 1].map(|axis| sizes().map(|size| size[axis]).min().unwrap());
    let region = inside(least[0], least[1]);
    let together = decode(bytes, &DecodeOptions { region: Some(region), ..options.clone() }).unwrap();
    let expected: Vec<_> = (0..whole.views.len()).map(|view| cropped(view, region)).collect();
    assert_same(&expected, &together.photographs, &format!("{what}, {region:?}"));
    for (part, whole) in together.views.iter().zip(&whole.views) {
        assert_eq!((part.camera.width, part.camera.height), (region.width, region.height));
        let moved = [0, 1].map(|axis| whole.camera.principal[axis] - [region.left, region.top][axis] as f64);
        assert_eq!(part.camera.principal, moved);
    }
    let mut file = IncrementalDecoder::new(Some(bytes.len() as u64), true, Limits::default());
    file.set_reduction(reduction);
    for (view, [width, height]) in sizes().enumerate() {
        for region in [Some(inside(width, height)), None, Some(Region { left: width - 1, top: 0, width: 1, height })] {
            file.set_region(region);
            let photograph = loop {
                match file.view(view).unwrap() {
                    Poll::NeedRanges(ranges) => ranges.iter().for_each(|range| {
                        file.feed(range.start, &bytes[range.start as usize..range.end as usize]).unwrap();
                    }),
                    Poll::Ready(ViewStatus::Decoded(photograph)) => break photograph,
                    Poll::Ready(_) => {}
                }
            };
            let expected = region.map_or_else(|| whole.photographs[view].clone(), |region| cropped(view, region));
            assert_same(&[expected], &[Some(photograph)], &format!("{what}, view {view}, {region:?}"));
        }
        file.set_region(Some(Region { left: 1, top: 0, width, height }));
        let refused = file.view(view).unwrap_err().to_string();
        assert!(refused.contains(&format!("has {width} x {height} pixels")), "{what}: {refused}");
    }
}

/// Of small tiles a region reads only some, and less of smaller photographs.
#[test]
fn a_region_reads_the_tiles_that_it_takes() {
    let bytes =
        std::fs::read(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("spec/vectors/ring-tiles.tsuya")).unwrap();
    for reduction in 0..4 {
        check_regions(&bytes, reduction, &mut Random(11), "ring-tiles");
    }
    let read = |reduction: u8, region: Option<Region>| {
        let mut file = Container::open_slice(&bytes, Limits::default()).unwrap();
        let selection = ViewSelection::Views(vec![0]);
        let options = DecodeOptions { selection, reduction, region, photographs_only: true, ..Default::default() };
        let asset = decode_from(&mut file, &options).unwrap();
        assert!(asset.charts.is_none() && asset.reflectance.is_none() && !asset.mesh.triangles.is_empty());
        file.bytes_read()
    };
    let at = |left: u32, width: u32| Some(Region { left, top: 60, width, height: width });
    let (whole, some, few) = (read(0, None), read(0, at(50, 40)), read(0, at(60, 4)));
    assert!(few < some && some < whole, "{few}, {some} and {whole} bytes");
    // Nothing of the finest level.
    assert!(read(1, at(30, 2)) < few && read(1, None) < whole);
    for (region, said) in [
        (Region { left: 0, top: 0, width: 0, height: 4 }, "is 0 x 4 pixels from column 0 and row 0"),
        (Region { left: 1, top: u32::MAX, width: 1, height: 1 }, "is 1 x 1 pixels from column 1 and row 4294967295"),
    ] {
        let refused = decode(&bytes, &DecodeOptions { region: Some(region), ..Default::default() }).unwrap_err();
        assert!(matches!(&refused, tsuya::Error::Parameter(text) if text.contains(said)), "{refused}");
    }
}

fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

fn whole(bytes: &[u8]) -> Asset {
    decode(bytes, &DecodeOptions::default()).unwrap()
}

/// Each view by itself out of one open file.
fn by_selection(bytes: &[u8], count: usize, random: &mut Random) -> Vec<Option<Photograph>> {
    let mut photographs = vec![None; count];
    let mut file = Container::open_slice(bytes, Limits::default()).unwrap();
    for view in random.order(count) {
        let options = DecodeOptions { selection: ViewSelection::Views(vec![view]), ..Default::default() };
        let mut asset = decode_from(&mut file, &options).unwrap();
        assert_eq!(asset.photographs.iter().flatten().count(), 1, "only the view that was asked for");
        photographs[view] = asset.photographs[view].take();
    }
    photographs
}

/// One decoder of a file of which any range can be had; what is asked for comes in pieces, the last one first.
fn by_ranges(bytes: &[u8], count: usize, random: &mut Random) -> Vec<Option<Photograph>> {
    let mut file = IncrementalDecoder::new(Some(bytes.len() as u64), true, Limits::default());
    let mut cuts = random.clone();
    view_by_view(&mut file, random.order(count), |file, wanted| {
        for range in wanted.iter().rev() {
            let (start, end) = (range.start as usize, range.end as usize);
            let cut = start + cuts.below(end - start + 1);
            file.feed(cut as u64, &bytes[cut..end])?;
            file.feed(start as u64, &bytes[start..cut])?;
        }
        Ok(())
    })
}

/// One decoder of a file that comes from its start, in pieces of any size, and whose length is known at its end.
fn from_a_stream(bytes: &[u8], count: usize, random: &mut Random) -> Vec<Option<Photograph>> {
    let mut file = IncrementalDecoder::new(None, false, Limits::default());
    let (mut cuts, mut at) = (random.clone(), 0);
    view_by_view(&mut file, random.order(count), |file, _| {
        let next = bytes.len().min(at + 1 + cuts.below(400));
        file.feed(at as u64, &bytes[at..next])?;
        at = next;
        if at == bytes.len() {
            file.set_length(at as u64);
        }
        Ok(())
    })
}

/// Asks for views in an order, each twice; `fetch` hands over some of what is missing.
fn view_by_view(
    file: &mut IncrementalDecoder,
    order: Vec<usize>,
    mut fetch: impl FnMut(&mut IncrementalDecoder, Vec<std::ops::Range<u64>>) -> Result<()>,
) -> Vec<Option<Photograph>> {
    let mut photographs = vec![None; order.len()];
    for view in order.iter().chain(&order).copied() {
        let photograph = loop {
            match file.view(view).unwrap() {
                Poll::NeedRanges(wanted) => fetch(file, wanted).unwrap(),
                Poll::Ready(ViewStatus::InProgress) => {}
                Poll::Ready(ViewStatus::Decoded(photograph)) => break photograph,
                Poll::Ready(ViewStatus::Absent) => panic!("the file holds photographs"),
            }
        };
        if let Some(before) = photographs[view].replace(photograph) {
            assert_same(&[Some(before)], &photographs[view..=view], &format!("view {view} again"));
        }
    }
    photographs
}

fn assert_same(expected: &[Option<Photograph>], found: &[Option<Photograph>], what: &str) {
    assert_eq!(expected.len(), found.len(), "{what}");
    for (view, pair) in expected.iter().zip(found).enumerate() {
        let (Some(expected), Some(found)) = pair else { panic!("{what}: view {view} is missing") };
        assert!(expected.mask == found.mask, "{what}: view {view} has another mask");
        assert_eq!(expected.images.len(), found.images.len(), "{what}: view {view}");
        for (component, (expected, found)) in expected.images.iter().zip(&found.images).enumerate() {
            let bits = |pixel: &[f32; 3]| pixel.map(f32::to_bits);
            let differ = expected.data.iter().zip(&found.data).filter(|(a, b)| bits(a) != bits(b)).count();
            assert_eq!(differ, 0, "{what}: pixels that differ in view {view}, component {component}");
        }
    }
}

/// The decoded photographs are as far from the captured ones as the encoder found and the file states.
fn check_error(mut capture: Capture, asset: &Asset, encoded: &EncodedFile, what: &str) {
    let observations = separate(&mut capture).unwrap();
    let mut total = PhotographError::default();
    for ((frame, view), decoded) in observations.views.into_iter().zip(&asset.views).zip(&asset.photographs) {
        let covered = rasterise(&asset.mesh, &view.camera).coverage();
        let mask = frame.mask.unwrap_or_else(|| covered.clone());
        let original = Photograph { mask, images: frame.images };
        let decoded = decoded.as_ref().unwrap();
        total.merge(&PhotographError::compare(&original, decoded, &asset.components, &covered, asset.white));
    }
    let measured = total.psnr();
    assert_eq!(measured, encoded.image_psnr, "{what}: the encoder found another error");
    let stated = Metadata(asset.metadata.clone()).achieved_error().unwrap();
    let figures = [
        (stated.diffuse_psnr_db, measured.diffuse),
        (stated.specular_psnr_db, measured.specular),
        (stated.sum_psnr_db, measured.sum),
    ];
    let rounded = |db: Option<f64>| db.map(|db| (db * 100.0).round() / 100.0);
    for (stated, measured) in figures {
        assert_eq!(stated, rounded(measured), "{what}: dB stated in the file, and measured");
    }
    assert!(measured.sum.unwrap() > 20.0, "{what}: {measured:?}");
}

/// A linear congruential generator (Knuth's MMIX), so that every run is the same.
#[derive(Clone)]
struct Random(u64);

impl Random {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((self.0 >> 33) % count as u64) as usize
    }
    /// The numbers below `count`, shuffled (Fisher and Yates).
    fn order(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        (1..count).rev().for_each(|last| order.swap(last, self.below(last + 1)));
        order
    }
}
