//! Writes the test vectors of `spec/vectors`: small inputs and outputs of clauses, and golden files with the checksums of what they decode
//! to. `cargo run --release --features internals --example vectors [FOLDER]`
//!
//! The bitstream may change until version 0.2; then this makes the vectors anew. Encoding uses the machine's own functions, so that other
//! machines may write other golden files; they decode alike everywhere.

#[path = "../platforms/src/checksums.rs"]
mod checksums;
mod clauses;

use std::path::{Path, PathBuf};
use tsuya::brdf::{BrdfSample, ClassicalLobe, ClassicalModel};
use tsuya::container::{ContainerWriter, SectionCodec, Tag};
use tsuya::encoder::encode;
use tsuya::lighting::{EnvironmentLobes, PrefilteredMap, SphericalGaussian};
use tsuya::visibility::{BakeOptions, bake};
use tsuya::{DecodeSpeed, EncodeOptions, EncodeTarget, Profile, Refinement, SpecularModel};
use tsuya::{
    brdf::{self, FittedMaterial, NamedMaterial},
    container,
};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// The format's version, as the files say it.
const VERSION: &str = "0.1";

/// Bundled captures, how many of their first views, and how they are encoded.
fn captures() -> Vec<(&'static str, &'static str, usize, EncodeOptions)> {
    let tuned = |decoding, quality| EncodeOptions {
        decode_speed: decoding,
        target: Some(EncodeTarget::Quality(quality)),
        ..EncodeOptions::default()
    };
    let paper = |percent| EncodeOptions {
        profile: Profile::WaveletTexture,
        target: Some(EncodeTarget::KeepPercent(percent)),
        ..EncodeOptions::default()
    };
    let palette = EncodeOptions { specular: SpecularModel::Dsbrdf, ..tuned(DecodeSpeed::Normal, 30.0) };
    let surface = EncodeOptions {
        refine: Refinement::Surface,
        specular: SpecularModel::GgxLobes,
        ..tuned(DecodeSpeed::Normal, 10.0)
    };
    vec![
        ("ring-small", "sample-spot", 3, tuned(DecodeSpeed::Normal, 30.0)),
        ("ring-fast", "sample-spot", 3, tuned(DecodeSpeed::Fast, 30.0)),
        ("ring-fastest", "sample-spot", 3, tuned(DecodeSpeed::Fastest, 30.0)),
        ("ring-tiles", "sample-spot", 3, EncodeOptions { tile_side: 16, ..tuned(DecodeSpeed::Fastest, 30.0) }),
        ("ring-palette", "sample-spot", 2, palette),
        ("ring-paper", "sample-spot", 2, paper(1.0)),
        ("dome-small", "dome", 3, tuned(DecodeSpeed::Normal, 40.0)),
        ("dome-surface", "dome", 19, surface),
        ("dome-paper", "dome", 3, paper(1.0)),
        ("unpolarised-small", "unpolarised", 3, tuned(DecodeSpeed::Normal, 40.0)),
        ("unpolarised-paper", "unpolarised", 3, paper(2.0)),
        ("lens-fastest", "lens", 2, tuned(DecodeSpeed::Fastest, 40.0)),
        ("sizes-small", "sizes", 3, tuned(DecodeSpeed::Normal, 50.0)),
    ]
}

/// A light of made-up lobes and levels.
fn light() -> Outcome<Vec<u8>> {
    let lobe = |x: f64| SphericalGaussian {
        axis: [x, (1.0 - x * x).sqrt(), 0.0],
        sharpness: 3.5 + x,
        amplitude: [1.0, 0.25, 2e3 * (1.0 + x)],
    };
    let level = |sharpness: f64, size: usize| {
        let cell = |k: usize| [0.2 + 0.01 * (k % size) as f32, (k / size) as f32, 40.0 / (1 + k % 7) as f32];
        PrefilteredMap::new(sharpness, size, (0..size * size).map(cell).collect()).ok_or("not a level")
    };
    let light =
        EnvironmentLobes { diffuse: vec![lobe(0.5), lobe(-0.25)], prefiltered: vec![level(80.0, 16)?, level(5.0, 8)?] };
    Ok(tsuya::lighting::encode(&light, &Default::default())?.0)
}

/// One material in each form.
fn two_materials() -> Outcome<Vec<u8>> {
    let model = ClassicalModel {
        diffuse: [0.3, 0.2, 0.1],
        specular: [0.1, 0.1, 0.12],
        lobe: ClassicalLobe::Ward { roughness: 0.2 },
    };
    let samples = BrdfSample::tabulate(&model, [30, 18, 4]);
    let named = |name: &str, material| NamedMaterial { name: name.into(), material };
    Ok(brdf::encode_materials(&[
        named("lobes", FittedMaterial::Dsbrdf(brdf::fit_dsbrdf(&samples, &Default::default())?)),
        named("compact", FittedMaterial::Compact(brdf::fit_compact(&samples, &Default::default())?)),
    ])?)
}

fn golden(name: &str, capture: &str, frames: usize, options: &EncodeOptions) -> Outcome<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(capture);
    let mut capture = tsuya::capture::read(&folder, &Default::default())?;
    capture.frames.truncate(frames);
    let file = encode(capture, options)?.bytes;
    // Without the thumbnail, which is another format's business.
    let mut container = tsuya::container::Container::open_slice(&file, Default::default())?;
    let mut writer = ContainerWriter::new(Vec::new())?;
    for section in container.sections().to_vec() {
        if section.tag != Tag::THUMBNAIL {
            writer.write_section(section.tag, section.codec, &container.read_section(section.tag)?)?;
        }
    }
    let file = writer.finish()?;
    if name != "dome-small" {
        return Ok(file);
    }
    // What the surface sees, in two groups, with places between the vertices.
    let mesh = tsuya::decoder::decode(&file, &Default::default())?.mesh;
    let options = BakeOptions { size: 8, terms: [3, 2], places: mesh.positions.len() * 3, ..Default::default() };
    let section = (Tag::VISIBILITY, SectionCodec::Own, bake(&mesh, &options)?.bytes);
    Ok(container::with_sections(&file, &[section], Default::default())?)
}

fn main() -> Outcome<()> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("spec/vectors");
    let folder = std::env::args_os().nth(1).map_or(default, PathBuf::from);
    std::fs::create_dir_all(&folder)?;
    for (name, clauses) in clauses::all()? {
        clauses::write(&folder, VERSION, name, &clauses)?;
    }
    let mut files = Vec::new();
    for (name, capture, frames, options) in captures() {
        files.push((name, golden(name, capture, frames, &options)?));
    }
    let alone = |tag, content: &[u8]| -> Outcome<Vec<u8>> {
        let mut writer = ContainerWriter::new(Vec::new())?;
        writer.write_section(tag, SectionCodec::Own, content)?;
        Ok(writer.finish()?)
    };
    files.push(("light", alone(Tag::LIGHT, &light()?)?));
    let section = two_materials()?;
    files.push(("materials", alone(Tag::MATERIALS, &section)?));
    clauses::write(&folder, VERSION, "materials", &clauses::materials(&section)?)?;
    let mut bytes = 0;
    for (name, file) in files {
        let text = format!("tsuya {VERSION}, {name}\n{}", checksums::checksums_of(&file));
        bytes += file.len() + text.len();
        std::fs::write(folder.join(format!("{name}.tsuya")), &file)?;
        std::fs::write(folder.join(format!("{name}.txt")), text)?;
    }
    println!("{} bytes of golden files in {}", bytes, folder.display());
    Ok(())
}
