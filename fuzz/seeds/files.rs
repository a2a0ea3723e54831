//! Whole files: small captures through the encoder, with what else a file may hold.

use crate::{Seeds, models, scene};
use tsuya::Limits;
use tsuya::Mesh;
use tsuya::capture::{Capture, CaptureFrame};
use tsuya::container::{ContainerWriter, SectionCodec, Tag, with_sections};
use tsuya::encoder::{encode, encode_materials};
use tsuya::image::Grid;
use tsuya::{DecodeSpeed, EncodeOptions, EncodeTarget, Profile, SpecularModel};

/// What a capture consists of.
#[derive(Clone, Copy)]
struct Kind {
    polarised: bool,
    mixed: bool,
    masked: bool,
    lit: bool,
}

/// A capture of three photographs.
fn capture(mesh: Mesh, kind: Kind) -> Capture {
    let mut views = scene::views_of(&scene::sizes(kind.mixed));
    if !kind.lit {
        views.iter_mut().for_each(|view| view.light = None);
    }
    let photographs = scene::photographs(&mesh, &views, scene::components(kind.polarised), kind.masked);
    let frames = views.into_iter().zip(photographs).map(|(view, taken)| {
        let mut images = taken.images.into_iter();
        let first = images.next().expect("a component");
        let mask = kind.masked.then_some(taken.mask);
        match images.next() {
            None => CaptureFrame { view, photograph: first, cross: None, mask },
            Some(specular) => {
                let sum = first.data.iter().zip(&specular.data).map(|(d, s)| [d[0] + s[0], d[1] + s[1], d[2] + s[2]]);
                let photograph = Grid { width: first.width, height: first.height, data: sum.collect() };
                CaptureFrame { view, photograph, cross: Some(first), mask }
            }
        }
    });
    Capture {
        name: "seed".into(),
        frames: frames.collect(),
        mesh,
        origin: [0.0; 3],
        white: scene::WHITE,
        beta: kind.polarised.then_some([1.0; 3]),
        color_space: "linear-rec709".into(),
        warnings: Vec::new(),
        skipped_frames: 0,
        missing_pixels: 0,
        clipping: Default::default(),
    }
}

fn options(quality: f64) -> EncodeOptions {
    EncodeOptions { target: Some(EncodeTarget::Quality(quality)), ..Default::default() }
}

/// Puts files for the targets that take whole ones.
pub fn put(seeds: &Seeds) {
    let mut all: Vec<(String, Vec<u8>)> = Vec::new();
    let file = |mesh: Mesh, kind: Kind, options: &EncodeOptions| {
        encode(capture(mesh, kind), options).expect("a small capture can be encoded").bytes
    };
    let modes = [("small", DecodeSpeed::Normal), ("fast", DecodeSpeed::Fast), ("fastest", DecodeSpeed::Fastest)];
    for (mode, decoding) in modes {
        for number in 0..4usize {
            let kind =
                Kind { polarised: number % 2 == 0, mixed: number / 2 == 1, masked: number != 1, lit: number != 3 };
            let options = EncodeOptions { decode_speed: decoding, ..options(if number < 2 { 70.0 } else { 40.0 }) };
            let mesh = if number == 0 { scene::mesh() } else { scene::sphere(1) };
            all.push((format!("tuned-{mode}-{number}"), file(mesh, kind, &options)));
        }
    }
    let plain = Kind { polarised: true, mixed: false, masked: true, lit: true };
    let dsbrdf = EncodeOptions { specular: SpecularModel::Dsbrdf, ..options(60.0) };
    all.push(("dsbrdf".into(), file(scene::sphere(1), plain, &dsbrdf)));
    let signed = EncodeOptions { signed_specular: true, ..options(60.0) };
    all.push(("signed".into(), file(scene::mesh(), plain, &signed)));
    for number in 0..4usize {
        let kind = Kind { polarised: number % 2 == 0, mixed: number / 2 == 1, masked: number != 1, lit: number != 3 };
        let target = Some(EncodeTarget::KeepPercent([5.0, 20.0, 1.0, 5.0][number]));
        let options = EncodeOptions { profile: Profile::WaveletTexture, target, ..Default::default() };
        let mesh = if number == 0 { scene::mesh() } else { scene::sphere(1) };
        all.push((format!("paper-{number}"), file(mesh, kind, &options)));
    }
    // What stands beside photographs, and alone.
    let own = |tag, bytes: Vec<u8>| (tag, SectionCodec::Own, bytes);
    let octahedron = file(scene::mesh(), plain, &options(40.0));
    let mesh = tsuya::decoder::decode(&octahedron, &Default::default()).expect("our own file").mesh;
    let materials = models::materials();
    let binding = tsuya::brdf::TriangleBinding::whole("ward", mesh.triangles.len());
    let beside = [
        own(Tag::VISIBILITY, models::visibility(&mesh, 24)),
        own(Tag::LIGHT, models::light(8)),
        own(Tag::MATERIALS, tsuya::brdf::encode_materials(&materials).expect("materials")),
        own(Tag::BINDING, tsuya::brdf::encode_binding(&binding).expect("a binding")),
    ];
    let whole = with_sections(&octahedron, &beside, Limits::default()).expect("our own file");
    all.push(("everything".into(), whole));
    all.push(("materials".into(), encode_materials(&materials, &Default::default()).expect("two materials")));
    let mut writer = ContainerWriter::new(Vec::new()).expect("memory");
    writer.write_section(Tag::LIGHT, SectionCodec::Own, &beside[1].2).expect("a light");
    all.push(("light".into(), writer.finish().expect("memory")));
    // Predicted from a surface and its lobes, which takes more views to find: the golden file.
    all.push(("surface".into(), include_bytes!("../../spec/vectors/dome-surface.tsuya").to_vec()));
    for (name, content) in &all {
        seeds.put("container", name, content);
        seeds.put("whole_decode", name, content);
    }
}
