//! Round trips and hostile streams on a small synthetic scene.

use super::decode::{DecodedPhotograph, PlaneDecoder, decode};
use super::encode::{EncodedPlanes, PlaneEncoder, PlaneQuality};
use super::header::{PREFIX_BYTES, PlaneHeader};
use super::model::PredictionModel;
use crate::image::{Mask, RgbImage};
use crate::limits::{Budget, Limits};
use crate::mesh::Mesh;
use crate::options::DecodeSpeed;
use crate::separate::MaskedPhotographs;
use crate::surface::raster::coverage_runs;
use crate::views::{Camera, Component, Photograph, PointLight, View};
use std::ops::Range;

pub(super) const COMPONENTS: [Component; 2] = [Component::Diffuse, Component::Specular];

fn encode(
    (mesh, views, photographs): (&Mesh, &[View], &[Photograph]),
    signed: bool,
    quality: &PlaneQuality,
) -> EncodedPlanes {
    encode_with_model((mesh, views, photographs), signed, quality, None)
}

pub(super) fn encode_with_model(
    (mesh, views, photographs): (&Mesh, &[View], &[Photograph]),
    signed: bool,
    quality: &PlaneQuality,
    model: Option<PredictionModel>,
) -> EncodedPlanes {
    let photographs = &photographs.iter().collect::<Vec<_>>();
    let covered = &coverage_runs(mesh, views)[..];
    let source = MaskedPhotographs { mesh, views, components: &COMPONENTS, white: WHITE, covered, photographs };
    let encoder = PlaneEncoder::new(&source, signed).unwrap();
    encoder.encode_each(quality, model, |_, _, decoded| decoded).unwrap()
}

pub(super) fn octahedron() -> Mesh {
    Mesh {
        positions: vec![[1., 0., 0.], [-1., 0., 0.], [0., 1., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]],
        triangles: vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    }
}

/// A view of 72 x 60 pixels at an angle of the turntable, its light beside it.
pub(super) fn turned_view(number: usize, angle: f64) -> View {
    let (sin, cos) = angle.sin_cos();
    let camera = Camera {
        width: 72,
        height: 60,
        focal: [90.0, 90.0],
        principal: [36.0, 30.0],
        rotation: [[cos, 0.0, -sin], [0.0, -1.0, 0.0], [-sin, 0.0, -cos]],
        translation: [0.0, 0.0, 4.0],
    };
    let light = Some(PointLight { position: [4.0 * sin, 1.0, 4.0 * cos], intensity: [50.0; 3] });
    View { name: format!("{number:03}"), camera, light }
}

/// A textured octahedron on a turntable, its pictures drawn by projecting a pattern, with ragged masks, which in every other view leave
/// out most of one side: other views look for it there, far from the mask.
fn scene(count: usize) -> (Mesh, Vec<View>, Vec<Photograph>) {
    let mesh = octahedron();
    let (mut views, mut photographs) = (Vec::new(), Vec::new());
    for i in 0..count {
        let view = turned_view(i, i as f64 * std::f64::consts::TAU / count as f64);
        let camera = view.camera;
        let raster = crate::surface::raster::rasterise(&mesh, &camera);
        let mut mask = Mask::filled(72, 60, false);
        let mut images = vec![RgbImage::filled(72, 60, [0.0; 3]); 2];
        for at in 0..72 * 60 {
            let shifted = at % 72 > 0 && raster.is_covered(at - 1);
            mask.data[at] = raster.is_covered(at) || (shifted && at % 3 == 0);
            mask.data[at] &= i % 2 == 0 || at % 72 > 30;
            if !mask.data[at] {
                continue;
            }
            let ray = camera.ray([(at % 72) as f64 + 0.5, (at / 72) as f64 + 0.5]);
            let point = [0, 1, 2].map(|k| camera.centre()[k] + raster.depth[at] * ray[k]);
            let pattern = ((point[0] * 9.0).sin() * (point[1] * 7.0).cos() + 1.2) as f32 * 0.3;
            images[0].data[at] = [pattern, pattern * 0.8, 0.2 + 0.1 * pattern];
            let highlight = (-((at % 72) as f32 - 36.0).powi(2) / 40.0).exp() * 2.0 - 0.001;
            images[1].data[at] = [highlight, highlight, highlight];
        }
        views.push(view);
        photographs.push(Photograph { mask, images });
    }
    (mesh, views, photographs)
}

pub(super) const WHITE: [f64; 3] = [1.0, 0.9, 0.8];

#[test]
fn what_the_encoder_saw_is_what_the_decoder_gives_for_all_or_one() {
    check_round_trip(DecodeSpeed::Normal);
}

#[test]
fn the_same_for_files_that_decode_fast() {
    [DecodeSpeed::Fast, DecodeSpeed::Fastest].into_iter().for_each(check_round_trip);
}

#[test]
fn the_same_with_tiles_of_all_sides() {
    for side in [4, 5, 6, 12] {
        check_round_trip_with(PlaneQuality {
            decode_speed: DecodeSpeed::Fastest,
            tile_side_log2: side,
            ..PlaneQuality::default()
        });
    }
}

fn check_round_trip(decoding: DecodeSpeed) {
    check_round_trip_with(PlaneQuality { decode_speed: decoding, ..PlaneQuality::default() });
}

fn check_round_trip_with(quality: PlaneQuality) {
    let (mesh, views, photographs) = scene(9);
    let [coarse, fine] = [0.08, 0.01].map(|step| {
        let quality = PlaneQuality { step, ..quality };
        encode((&mesh, &views, &photographs), true, &quality)
    });
    assert!(fine.bytes.len() > 2 * coarse.bytes.len());
    let budget = Budget::new(Limits::default());
    let header = PlaneHeader::parse(&fine.bytes, &views, 2, &budget).unwrap();
    let body = &fine.bytes[PREFIX_BYTES + PlaneHeader::head_bytes(&fine.bytes).unwrap() as usize..];
    assert_eq!(body.len() as u64, header.stream_bytes());
    let read_from = |bytes: &mut usize, range: Range<u64>| {
        *bytes += (range.end - range.start) as usize;
        Ok(Some(body[range.start as usize..range.end as usize].to_vec()))
    };
    let mut all = 0;
    let decoded =
        decode(&header, &mesh, (&views, WHITE), |_| true, |range| read_from(&mut all, range), &budget).unwrap();
    assert_eq!(all, body.len());
    for ((decoded, encoded), photograph) in decoded.iter().zip(&fine.photographs).zip(&photographs) {
        let decoded = decoded.as_ref().unwrap();
        assert!(decoded == encoded && decoded.mask == photograph.mask);
        for (image, wanted) in decoded.images.iter().zip(&photograph.images) {
            for (a, b) in image.data.iter().zip(&wanted.data) {
                assert!((0..3).all(|k| (a[k].max(0.0).sqrt() - b[k].max(0.0).sqrt()).abs() < 0.06), "{a:?} {b:?}");
            }
        }
    }
    let mut some = 0;
    let one =
        decode(&header, &mesh, (&views, WHITE), |v| v == 4, |range| read_from(&mut some, range), &budget).unwrap();
    assert_eq!(one[4], decoded[4]);
    assert!(one.iter().flatten().count() == 1 && some < all, "{some} of {all} bytes");
    // Of the views that it is predicted from only what is predicted.
    let order = header.order();
    let needed = super::order::closure(&order, |v| v == 4).into_iter().map(|index| {
        let level = if order[index].view == 4 { 0 } else { 3 };
        header.entries[index].stream_bytes_above(level) as usize
    });
    assert_eq!(some, needed.sum::<usize>());
}

/// A photograph of a fraction of its size is about the means of its pixels, and of the streams only those of coarser levels are read.
#[test]
fn smaller_photographs_take_the_coarser_levels_alone() {
    let (mesh, views, photographs) = scene(5);
    for decode_speed in [DecodeSpeed::Normal, DecodeSpeed::Fast, DecodeSpeed::Fastest] {
        let quality = PlaneQuality { step: 0.01, decode_speed, tile_side_log2: 4, ..PlaneQuality::default() };
        let coded = encode((&mesh, &views, &photographs), false, &quality);
        let budget = Budget::new(Limits::default());
        let header = PlaneHeader::parse(&coded.bytes, &views, 2, &budget).unwrap();
        let body = &coded.bytes[PREFIX_BYTES + PlaneHeader::head_bytes(&coded.bytes).unwrap() as usize..];
        for levels in 1..=3 {
            let needed: u64 = header.entries.iter().map(|coded| coded.stream_bytes_above(levels)).sum();
            let mut read = 0;
            let decoder = PlaneDecoder::new(&header, &mesh, &views, WHITE).reduced_by(levels);
            let next = |range: Range<u64>| {
                read += range.end - range.start;
                Ok(Some(body[range.start as usize..range.end as usize].to_vec()))
            };
            let mut errors = Vec::new();
            let take = |given: Vec<(usize, Photograph)>| {
                for (view, small) in given {
                    let whole = &coded.photographs[view];
                    let (width, side) = (72usize.div_ceil(1 << levels), 1 << levels);
                    assert_eq!((small.mask.width, small.mask.height), (width, 60usize.div_ceil(1 << levels)));
                    for at in (0..small.mask.data.len()).filter(|&at| small.mask.data[at]) {
                        // Blocks that lie in the mask as a whole, around the pixel that the low band's stands on.
                        let (x, y, reach) = (at % width * side, at / width * side, side / 2);
                        let (x, y) = (x.saturating_sub(reach), y.saturating_sub(reach));
                        let block = || (y..=y + side).flat_map(|y| (x..=x + side).map(move |x| (x, y)));
                        if block().all(|(x, y)| x < 72 && y < 60 && whole.mask.data[y * 72 + x]) {
                            let value = |pixel: [f32; 3]| pixel[1].max(0.0).sqrt();
                            let mean: f32 = block().map(|(x, y)| value(whole.images[0].data[y * 72 + x])).sum();
                            errors.push(value(small.images[0].data[at]) - mean / block().count() as f32);
                        }
                    }
                }
                Ok(())
            };
            decoder.for_each_view(|_| true, next, &budget, take).unwrap();
            assert_eq!(read, needed, "{decode_speed:?} {levels}");
            assert!(decode_speed == DecodeSpeed::Normal || needed < header.stream_bytes() * 9 / 10, "{needed} bytes");
            let rms = (errors.iter().map(|error| error * error).sum::<f32>() / errors.len() as f32).sqrt();
            assert!(errors.len() > 4 && rms < 0.12, "{decode_speed:?} {levels}: {rms} of {}", errors.len());
        }
    }
}

#[test]
fn the_same_bytes_with_one_thread_and_with_two() {
    let (mesh, views, photographs) = scene(6);
    let bytes = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| encode((&mesh, &views, &photographs), false, &PlaneQuality::default()).bytes)
    };
    assert_eq!(bytes(1), bytes(2));
}

#[test]
fn streams_of_noise_are_refused_and_missing_ones_leave_their_views_out() {
    [DecodeSpeed::Normal, DecodeSpeed::Fast].into_iter().for_each(check_noise);
}

fn check_noise(decoding: DecodeSpeed) {
    let (mesh, views, photographs) = scene(5);
    let quality = PlaneQuality { decode_speed: decoding, ..PlaneQuality::default() };
    let good = encode((&mesh, &views, &photographs), false, &quality);
    let budget = Budget::new(Limits::default());
    let mut header = PlaneHeader::parse(&good.bytes, &views, 2, &budget).unwrap();
    let mut state = 12345u32;
    for round in 0..20 {
        let noise: Vec<Vec<u8>> = header
            .entries
            .iter_mut()
            .map(|step| {
                step.lengths = vec![40, 300, 300];
                step.tiles.iter_mut().for_each(|tile| (tile.lengths, tile.checksum) = (vec![0, 0], 0));
                let bytes: Vec<u8> = (0..640)
                    .map(|_| {
                        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        if round == 0 { 0xff } else { (state >> 24) as u8 }
                    })
                    .collect();
                step.checksum = crc32fast::hash(&bytes);
                bytes
            })
            .collect();
        let mut index = 0;
        let next = |_: Range<u64>| {
            index += 1;
            Ok(Some(noise[index - 1].clone()))
        };
        let error = decode(&header, &mesh, (&views, WHITE), |_| true, next, &budget).unwrap_err();
        assert!(error.to_string().contains("does not end with what it tells"), "{error}");
    }
    let header = PlaneHeader::parse(&good.bytes, &views, 2, &budget).unwrap();
    let first = header.entries[0].entry.view;
    let start = PREFIX_BYTES + PlaneHeader::head_bytes(&good.bytes).unwrap() as usize;
    let cut =
        |range: Range<u64>| Ok((range.start == 0).then(|| good.bytes[start..start + range.end as usize].to_vec()));
    let decoded = decode(&header, &mesh, (&views, WHITE), |_| true, cut, &budget).unwrap();
    assert!(decoded.iter().enumerate().all(|(view, p)| p.is_some() == (view == first)));
}

/// As many views are worked on side by side as there is memory for; below what one takes it is an error.
#[test]
fn memory_is_charged_before_it_is_used() {
    let (mesh, views, photographs) = scene(9);
    let encoded = encode((&mesh, &views, &photographs), false, &PlaneQuality::default());
    let header = PlaneHeader::parse(&encoded.bytes, &views, 2, &Budget::new(Limits::default())).unwrap();
    let start = PREFIX_BYTES + PlaneHeader::head_bytes(&encoded.bytes).unwrap() as usize;
    let run = |memory_bytes: u64| {
        let read = |range: Range<u64>| {
            Ok(Some(encoded.bytes[start + range.start as usize..start + range.end as usize].to_vec()))
        };
        let budget = Budget::new(Limits { memory_bytes, ..Limits::default() });
        decode(&header, &mesh, (&views, WHITE), |_| true, read, &budget)
    };
    let mut refused = 0;
    for memory_bytes in (500_000..10_000_000).step_by(500_000) {
        match run(memory_bytes) {
            Ok(decoded) => assert!(decoded.iter().flatten().eq(&encoded.photographs)),
            Err(error) => {
                assert!(matches!(error, crate::Error::Limits { .. }), "{error}");
                refused += 1;
            }
        }
    }
    let one = crate::predictive::workspace::peak_bytes(&views[0].camera, &header.coding);
    let side_by_side = 8 * one;
    assert!(refused > 0 && refused * 500_000 < side_by_side as usize / 2, "{refused} refused, one view {one} bytes");
}

#[test]
fn views_one_at_a_time_are_those_decoded_together_even_with_little_memory() {
    [DecodeSpeed::Normal, DecodeSpeed::Fast].into_iter().for_each(check_order);
}

fn check_order(decoding: DecodeSpeed) {
    use crate::predictive::on_demand::ViewDecoder;
    use std::borrow::Cow;
    use std::sync::Arc;
    let (mesh, views, photographs) = scene(24);
    let quality = PlaneQuality { decode_speed: decoding, ..PlaneQuality::default() };
    let coded = encode((&mesh, &views, &photographs), true, &quality);
    let header = PlaneHeader::parse(&coded.bytes, &views, 2, &Budget::new(Limits::default())).unwrap();
    let body = &coded.bytes[PREFIX_BYTES + PlaneHeader::head_bytes(&coded.bytes).unwrap() as usize..];
    let run = |memory_bytes: u64| -> crate::Result<usize> {
        let budget = Arc::new(Budget::new(Limits { memory_bytes, ..Limits::default() }));
        let (mesh, views) = (Cow::Borrowed(&mesh), Cow::Borrowed(&views[..]));
        let mut decoder = ViewDecoder::new(Cow::Borrowed(&header), mesh, views, WHITE, budget.clone());
        let mut decoded = 0;
        for view in (0..48).map(|k| k * 7 % 24) {
            let steps = decoder.missing_entries(view)?;
            let mut photograph = decoder.kept(view).map(|picture| picture.photograph());
            assert_eq!(photograph.is_some(), steps.is_empty());
            for step in steps {
                let coded = &header.entries[step];
                let is_wanted = coded.entry.view == view;
                let [range] = &decoder.needed_ranges(step, is_wanted)[..] else { panic!("one range is needed") };
                let streams = &body[range.start as usize..range.end as usize];
                let take = is_wanted.then_some(|picture: DecodedPhotograph| picture.photograph());
                photograph = decoder.decode(step, streams, take)?;
                decoded += 1;
            }
            assert!(photograph.as_ref() == Some(&coded.photographs[view]), "view {view}");
        }
        assert!(decoder.missing_entries(24).is_err());
        assert!(budget.left() < memory_bytes);
        Ok(decoded)
    };
    // Each view once, but for those that nothing is predicted from and that are asked for twice. Where predictions are of a fraction of
    // the size no pictures are kept: each time a view is asked for, and some before that for others.
    let roomy = run(1 << 30).unwrap();
    let expected = if decoding == DecodeSpeed::Normal { 24..48 } else { 48..72 };
    assert!(expected.contains(&roomy), "{roomy} views decoded");
    // Room for the longest chain only: what was given up is decoded again.
    let (least, tight) = (10..200).map(|k| k * 100_000).find_map(|memory| Some((memory, run(memory).ok()?))).unwrap();
    assert!(tight > roomy, "{tight} views decoded with {least} bytes");
    assert!(matches!(run(least / 2), Err(crate::Error::Limits { .. })));
}
