//! The decoder against `tools/reference`, which was written from `spec/` alone: the same pictures, bit for bit.

use crate::support;
use std::path::Path;
use std::process::Command;
use tsuya::decoder::{DecodeOptions, decode};
use tsuya::encoder::encode;
use tsuya::image::Mask;
use tsuya::{Component, Photograph};
use tsuya::{DecodeSpeed, EncodeOptions, EncodeTarget, Profile};

fn python() -> Option<String> {
    let name = std::env::var("TSUYA_PYTHON").unwrap_or_else(|_| "python3".into());
    let found = Command::new(&name).args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success());
    found.then_some(name)
}

/// Pixels of a little-endian portable float map, rows from the top.
fn read_pfm(path: &Path) -> Vec<[u32; 3]> {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = bytes.splitn(4, |&b| b == b'\n');
    let size = lines.nth(1).unwrap();
    let width: usize = std::str::from_utf8(size).unwrap().split(' ').next().unwrap().parse().unwrap();
    let data = lines.nth(1).unwrap();
    let value = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let pixels: Vec<[u32; 3]> = data.chunks(12).map(|p| [value(p), value(&p[4..]), value(&p[8..])]).collect();
    pixels.chunks(width).rev().flatten().copied().collect()
}

/// Pixels of a portable grey map that are set.
fn read_pgm(path: &Path) -> Vec<bool> {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    bytes.splitn(4, |&b| b == b'\n').nth(3).unwrap().iter().map(|&value| value > 0).collect()
}

fn compare(photograph: &Photograph, name: &str, components: &[Component], folder: &Path) {
    assert!(photograph.mask.data == read_pgm(&folder.join(format!("{name}-mask.pgm"))), "{name}: another mask");
    for (image, component) in photograph.images.iter().zip(components) {
        let kind = format!("{component:?}").to_lowercase();
        let other = read_pfm(&folder.join(format!("{name}-{kind}.pfm")));
        assert_eq!(other.len(), image.data.len());
        for (at, (a, b)) in image.data.iter().zip(&other).enumerate() {
            let same = (0..3).all(|k| a[k].to_bits() == b[k] || (a[k] == 0.0 && f32::from_bits(b[k]) == 0.0));
            let b = b.map(f32::from_bits);
            assert!(same, "{name} {kind}, pixel {at}: {a:?}, the reference decoder has {b:?}");
        }
    }
}

/// Encodes the first frames of a bundled capture, decodes them twice and compares.
fn check(name: &str, frames: usize, options: &EncodeOptions, masks: impl Fn(&mut Option<Mask>)) {
    let Some(python) = python() else {
        println!("skipped: needs Python with NumPy");
        return;
    };
    let mut capture = support::read(&support::bundled(name)).unwrap();
    capture.frames.truncate(frames);
    capture.frames.iter_mut().for_each(|frame| masks(&mut frame.mask));
    let encoded = encode(capture, options).unwrap();
    let asset = decode(&encoded.bytes, &DecodeOptions::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sample.tsuya");
    std::fs::write(&file, &encoded.bytes).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/reference/decode.py");
    // Of many photographs the first has to do.
    let shown = if frames > 4 { 1 } else { frames };
    let mut command = Command::new(&python);
    command.arg(&script).arg(&file).arg("-o").arg(folder.path());
    command.args((0..shown).flat_map(|view| ["--view".to_owned(), view.to_string()]));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Profile paper has its reflectance within the photographs' section.
    let none = Default::default();
    let maps = asset.reflectance.as_ref().unwrap_or(&none);
    // Under unknown lights there is no specular map.
    let map_file = |name: &str| folder.path().join(format!("reflectance-{name}.pfm"));
    let read_map =
        |name: &str| Some(map_file(name)).filter(|file| file.exists()).map_or(vec![], |file| read_pfm(&file));
    let lobes = maps.lobes.iter().enumerate().map(|(number, map)| (format!("lobe-{number}"), map));
    for (name, map) in [("diffuse".into(), &maps.diffuse), ("specular".into(), &maps.specular)].into_iter().chain(lobes)
    {
        let other = read_map(&name);
        let same = map.data.iter().zip(&other).filter(|(a, b)| a.map(f32::to_bits) == **b).count();
        assert_eq!((same, other.len()), (map.data.len(), map.data.len()), "map of the {name} reflectance");
    }
    let sigma = read_map("sigma").iter().map(|pixel| pixel[0]).collect::<Vec<u32>>();
    assert_eq!(maps.sigma.data.iter().map(|sigma| sigma.to_bits()).collect::<Vec<u32>>(), sigma, "map of sigma");
    if let Some(surface) = &asset.surface {
        let text = std::fs::read_to_string(folder.path().join("surface.obj")).unwrap();
        let number = |word: &str| (word.parse::<f64>().unwrap() as f32).to_bits();
        let other: Vec<Vec<u32>> = text.lines().map(|line| line.split(' ').skip(1).map(number).collect()).collect();
        let positions: Vec<Vec<u32>> =
            surface.mesh().positions.iter().map(|p| p.iter().map(|x| x.to_bits()).collect()).collect();
        assert!(positions == other, "positions of the surface");
    }
    for (view, photograph) in asset.photographs.iter().enumerate().take(shown) {
        let name = format!("{view:03}-{}", asset.views[view].name.replace('/', "_"));
        compare(photograph.as_ref().unwrap(), &name, &asset.components, folder.path());
    }
}

/// A mask that leaves the mesh: one pixel wider to the right, a hole in the middle.
fn ragged(mask: &mut Option<Mask>) {
    let Some(mask) = mask else { return };
    let (width, old) = (mask.width, mask.data.clone());
    for at in 1..old.len() {
        let (x, y) = (at % width, at / width);
        mask.data[at] = (old[at] || (x > 0 && old[at - 1])) && !(x / 3 == 20 && y / 5 == 12);
    }
}

/// Predicted pictures.
#[test]
fn the_reference_decoder_gives_the_same_bits() {
    // With a palette, which stands between the head of the reflectance and its stream.
    let specular = tsuya::SpecularModel::Dsbrdf;
    let options = EncodeOptions { target: Some(EncodeTarget::Quality(40.0)), specular, ..Default::default() };
    check("sample-spot", 2, &options, ragged);
}

/// Highlights as weights of lobes on a refined surface.
#[test]
fn the_reference_decoder_gives_the_same_bits_of_a_refined_surface() {
    let (specular, refine) = (tsuya::SpecularModel::GgxLobes, tsuya::Refinement::Surface);
    let options = EncodeOptions { target: Some(EncodeTarget::Quality(10.0)), specular, refine, ..Default::default() };
    check("sample-spot", 14, &options, |_| ());
}

/// Predictions at half the size, blocks, symbols, large magnitudes.
#[test]
fn the_reference_decoder_gives_the_same_bits_of_a_file_that_decodes_fast() {
    let options = EncodeOptions {
        target: Some(EncodeTarget::Quality(96.0)),
        decode_speed: DecodeSpeed::Fast,
        ..Default::default()
    };
    check("sample-spot", 2, &options, ragged);
}

/// Large magnitudes, negative radiance, two references, no masks.
#[test]
#[ignore = "a minute in Python"]
fn the_reference_decoder_gives_the_same_bits_at_high_quality() {
    let options =
        EncodeOptions { target: Some(EncodeTarget::Quality(100.0)), signed_specular: true, ..Default::default() };
    check("sample-spot", 3, &options, |mask| *mask = None);
}

/// All decoding modes of the first frames of a bundled capture, as it is.
fn check_all_modes(name: &str, frames: usize) {
    for decoding in [DecodeSpeed::Normal, DecodeSpeed::Fast, DecodeSpeed::Fastest] {
        let options = EncodeOptions { decode_speed: decoding, tile_side: 16, ..Default::default() };
        check(name, frames, &options, |_| ());
    }
}

/// Masks that are not what the mesh covers: pictures are read far beyond the masks of others, and views show nothing.
#[test]
fn the_reference_decoder_gives_the_same_bits_of_a_dome() {
    check_all_modes("dome", usize::MAX);
}

/// One component.
#[test]
fn the_reference_decoder_gives_the_same_bits_without_polarisers() {
    check_all_modes("unpolarised", 4);
}

/// Pictures of six sizes, one of 5 x 4 pixels, under lights that are not known.
#[test]
fn the_reference_decoder_gives_the_same_bits_of_pictures_of_many_sizes() {
    check_all_modes("sizes", 6);
}

/// Profile paper: a model with lobes under lights that are known, of two components.
#[test]
fn the_reference_decoder_gives_the_same_bits_in_profile_paper() {
    let target = Some(EncodeTarget::KeepPercent(5.0));
    let options = EncodeOptions { profile: Profile::WaveletTexture, target, ..Default::default() };
    check("sample-spot", 2, &options, |_| ());
    check("dome", 4, &options, |_| ());
}

/// Profile paper: one component, and lights that are not known.
#[test]
fn the_reference_decoder_gives_the_same_bits_in_profile_paper_of_one_component() {
    let options = EncodeOptions { profile: Profile::WaveletTexture, ..Default::default() };
    check("unpolarised", 4, &options, |_| ());
    check("sizes", 4, &options, |_| ());
}
