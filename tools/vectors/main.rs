//! Writes the test vectors of `spec/vectors`: small inputs and outputs of clauses, and golden files with the checksums of what they decode
//! to. `cargo run --release --features internals --example vectors [FOLDER]`
//!
//! The bitstream may change until version 0.2; then this makes the vectors anew. Encoding uses the machine's own functions, so that other
//! machines may write other golden files; they decode alike everywhere.

#[path = "../platforms/src/checksums.rs"]
mod checksums;
mod clauses;

use std::path::{Path, PathBuf};
use tsuya::brdf::{BrdfSample, ClassicalLobe, ClassicalModel, Microfacets, ShiftedGamma, TriangleBinding};
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

/// Every model that a section holds by its numbers.
fn models() -> Outcome<Vec<u8>> {
    let three = |x: f64| [x, 0.75 * x, 0.5 * x];
    let shape = ShiftedGamma {
        alpha: three(0.1),
        p: three(0.7),
        f0: three(0.2),
        f1: three(0.01),
        normalisation: three(0.9),
        lambda: three(2.0),
        c: three(1.0),
        k: three(1.5),
        theta0: three(0.3),
    };
    let lobes = [
        ClassicalLobe::Lambert,
        ClassicalLobe::BlinnPhong { exponent: 40.0 },
        ClassicalLobe::CookTorranceBeckmann { roughness: 0.25, reflectance: 0.04 },
        ClassicalLobe::CookTorranceGgx { roughness: 0.2, reflectance: 0.9 },
        ClassicalLobe::Ward { roughness: 0.3 },
        ClassicalLobe::WardAnisotropic { roughness: [0.2, 0.4] },
        ClassicalLobe::AshikhminShirley { exponents: [60.0, 20.0], reflectance: 0.1 },
        ClassicalLobe::Lafortune { xy: -1.0, z: 0.95, exponent: 20.0 },
        ClassicalLobe::TorranceSparrow { sigma: 0.2 },
        ClassicalLobe::ShiftedGamma(Box::new(shape)),
    ];
    let named = |lobe: ClassicalLobe| {
        let specular = if lobe == ClassicalLobe::Lambert { [0.0; 3] } else { [0.5, 0.6, 0.7] };
        let name = lobe.name().to_owned();
        NamedMaterial {
            name,
            material: FittedMaterial::Classical(ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular, lobe }),
        }
    };
    let mut all: Vec<NamedMaterial> = lobes.into_iter().map(named).collect();
    for (name, metallic) in [("plastic", 0.0), ("brass", 0.9)] {
        let (base_colour, specular_colour) = ([0.9, 0.6, 0.2], [1.0, 0.5, 2.0]);
        let material = Microfacets { base_colour, metallic, roughness: 0.4, specular_colour };
        all.push(NamedMaterial { name: name.into(), material: FittedMaterial::MetallicRoughness(material) });
    }
    Ok(brdf::encode_materials(&all)?)
}

/// A mesh whose lower part is of one of these materials, its upper part of another, and a piece of none.
fn modelled(materials: &[u8]) -> Outcome<Vec<u8>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/lens/scan.ply");
    let (mesh, _) = tsuya::mesh::clean(tsuya::mesh::read(path, &Default::default())?);
    let coded = tsuya::mesh::encode(&mesh, &tsuya::mesh::MeshOptions { position_bits: 10 })?;
    let [low, high] = coded.mesh.bounding_box().ok_or("a mesh")?;
    let height = |triangle: &[u32; 3]| {
        let sum: f32 = triangle.iter().map(|&vertex| coded.mesh.positions[vertex as usize][1] - low[1]).sum();
        sum / 3.0 / (high[1] - low[1])
    };
    let part = |triangle: &[u32; 3]| match height(triangle) {
        ..0.4 => 2,
        0.7..0.8 => 0,
        _ => 1,
    };
    let names = vec!["brass".to_owned(), "ward-anisotropic".to_owned()];
    let binding = TriangleBinding { names, of_triangle: coded.mesh.triangles.iter().map(part).collect() };
    let mut writer = ContainerWriter::new(Vec::new())?;
    writer.write_section(Tag::MESH, SectionCodec::Own, &coded.bytes)?;
    writer.write_section(Tag::MATERIALS, SectionCodec::Own, materials)?;
    writer.write_section(Tag::BINDING, SectionCodec::Own, &brdf::encode_binding(&binding)?)?;
    // Around the upright axis, with a seam where it begins anew, and one where the parts meet.
    let coordinates = |(triangle, part): (&[u32; 3], &u16)| {
        let turns = triangle.map(|vertex| {
            let [x, y, z] = coded.mesh.positions[vertex as usize];
            [z.atan2(x) / std::f32::consts::TAU, y + f32::from(*part)]
        });
        let first = turns[0][0];
        turns.map(|[u, v]| [u - (u - first).round(), v])
    };
    let all: Vec<_> = coded.mesh.triangles.iter().zip(&binding.of_triangle).map(coordinates).collect();
    let section = tsuya::mesh::encode_coordinates(&all, &coded.mesh, 11)?.0;
    writer.write_section(Tag::COORDINATES, SectionCodec::Own, &section)?;
    Ok(writer.finish()?)
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
    let section = models()?;
    files.push(("modelled", modelled(&section)?));
    clauses::write(&folder, VERSION, "models", &clauses::materials(&section)?)?;
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
