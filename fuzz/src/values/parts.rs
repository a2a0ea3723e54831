//! Everything but photographs.

use super::{budget, number, positive};
use crate::scene;
use arbitrary::{Result, Unstructured};
use serde_json::{Map, Value};
use tsuya::Charts;
use tsuya::Mesh;
use tsuya::PaletteEntry;
use tsuya::ReflectanceMaps;
use tsuya::brdf::{
    ClassicalLobe, ClassicalModel, DsbrdfMaterial, FittedMaterial, Microfacets, NamedMaterial, ShiftedGamma,
    TriangleBinding,
};
use tsuya::container::Metadata;
use tsuya::image::Grid;
use tsuya::internals::reflectance::MapSteps;
use tsuya::lighting::{self, EnvironmentLobes, PrefilteredMap, SphericalGaussian};
use tsuya::visibility::{BakeOptions, bake};
use tsuya::{PointLight, View};
use tsuya::{
    brdf::{self, CompactMaterial},
    container, internals, mesh,
};

/// A mesh as a decoder has it, and its section.
pub fn mesh(u: &mut Unstructured) -> Result<(Mesh, Vec<u8>)> {
    let mut mesh = match u.int_in_range(0..=3)? {
        0 => scene::mesh(),
        1 => scene::sphere(1),
        _ => any_mesh(u)?,
    };
    if u.ratio(1, 4)? {
        let count = mesh.triangles.len();
        mesh.triangles.truncate(u.int_in_range(1..=count)?);
    }
    let options = mesh::MeshOptions { position_bits: u.int_in_range(1..=24)? };
    let coded = match mesh::encode(&mesh, &options) {
        Ok(coded) => coded,
        // Positions that no lattice holds, or too few bits for so many.
        Err(_) => {
            mesh::encode(&scene::mesh(), &mesh::MeshOptions { position_bits: 12 }).expect("an octahedron can be coded")
        }
    };
    let again = mesh::decode(&coded.bytes, &budget()).expect("our own mesh");
    assert!(again == coded.mesh, "the mesh comes back another");
    Ok((coded.mesh, coded.bytes))
}

/// Any triangles of few vertices: edges of many triangles, both windings, vertices of no triangle.
fn any_mesh(u: &mut Unstructured) -> Result<Mesh> {
    let vertices = u.int_in_range(3..=12)?;
    let lattice = u.ratio(3, 4)?;
    let coordinate = |u: &mut Unstructured| -> Result<f32> {
        if lattice { Ok(u.int_in_range(-8..=8)? as f32 / 8.0) } else { number(u) }
    };
    let mut mesh = Mesh::default();
    for _ in 0..vertices {
        mesh.positions.push([coordinate(u)?, coordinate(u)?, coordinate(u)?]);
    }
    for _ in 0..u.int_in_range(1..=20)? {
        let mut corner = || u.int_in_range(0..=vertices as u32 - 1);
        let triangle = [corner()?, corner()?, corner()?];
        if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
            mesh.triangles.push(triangle);
        }
    }
    if mesh.triangles.is_empty() {
        mesh.triangles.push([0, 1, 2]);
    }
    Ok(mesh)
}

/// Views as a decoder has them, and their section.
pub fn views(u: &mut Unstructured, mesh: &Mesh) -> Result<(internals::views::ViewsSection, Vec<u8>)> {
    let count = u.int_in_range(1..=4)?;
    let mut sizes = Vec::new();
    for _ in 0..count {
        sizes.push(if u.ratio(3, 4)? { (16, 16) } else { (u.int_in_range(1..=40)?, u.int_in_range(1..=40)?) });
    }
    let mut all = scene::views_of(&sizes);
    for view in &mut all {
        change(u, view)?;
    }
    let components = scene::components(u.arbitrary()?).to_vec();
    let mut white = scene::WHITE;
    if u.ratio(1, 8)? {
        white[1] = number(u)? as f64;
    }
    let section = internals::views::ViewsSection { white, components, views: all };
    let (section, bytes) = match internals::views::encode(&section, &mesh.positions) {
        Ok(bytes) => (section, bytes),
        Err(_) => {
            let views = scene::views_of(&sizes);
            let section = internals::views::ViewsSection { white: scene::WHITE, components: section.components, views };
            let bytes = internals::views::encode(&section, &scene::mesh().positions).expect("plain views can be coded");
            (section, bytes)
        }
    };
    let again = internals::views::decode(&bytes, &budget()).expect("our own views");
    assert_eq!((&again.components, again.views.len()), (&section.components, section.views.len()));
    for (again, view) in again.views.iter().zip(&section.views) {
        assert_eq!(
            (&again.name, again.camera.width, again.camera.height),
            (&view.name, view.camera.width, view.camera.height)
        );
        assert_eq!(again.light.is_some(), view.light.is_some());
    }
    Ok((again, bytes))
}

/// Another name, place or light.
fn change(u: &mut Unstructured, view: &mut View) -> Result<()> {
    if u.ratio(1, 4)? {
        view.name = u.arbitrary()?;
    }
    if u.ratio(1, 4)? {
        let camera = &mut view.camera;
        camera.translation[u.int_in_range(0..=2)?] = number(u)? as f64;
        camera.focal[u.int_in_range(0..=1)?] *= positive(u)? as f64;
        camera.principal[u.int_in_range(0..=1)?] += number(u)? as f64;
    }
    match u.int_in_range(0..=7)? {
        0 => view.light = None,
        1 => {
            let mut three = || -> Result<[f64; 3]> { Ok([number(u)? as f64, number(u)? as f64, number(u)? as f64]) };
            view.light = Some(PointLight { position: three()?, intensity: three()? });
        }
        _ => {}
    }
    Ok(())
}

/// An atlas of the mesh, and its section.
pub fn charts(u: &mut Unstructured, mesh: &Mesh) -> Result<(Charts, Vec<u8>)> {
    let longest = (0..3).map(|k| {
        let range = mesh.positions.iter().fold([f32::MAX, f32::MIN], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        (range[1] - range[0]) as f64
    });
    let longest = longest.fold(1e-6, f64::max);
    let density = u.int_in_range(1..=24)? as f64 / longest;
    let charts = match internals::surface::atlas::layout(mesh, density) {
        Ok(charts) => charts,
        Err(_) => return Ok((Charts::default(), Vec::new())),
    };
    let bytes = internals::surface::charts::encode(mesh, &charts).expect("our own layout can be coded");
    let again = internals::surface::charts::decode(&bytes, mesh, &budget()).expect("our own charts");
    assert!(again == charts, "the charts come back others");
    Ok((again, bytes))
}

/// Section `RFLC`.
pub fn reflectance(u: &mut Unstructured, mesh: &Mesh, charts: &Charts) -> Result<Option<Vec<u8>>> {
    let (width, height) = (charts.width as usize, charts.height as usize);
    if width == 0 || width * height > 1 << 14 {
        return Ok(None);
    }
    let (plain, specular): (bool, bool) = (u.arbitrary()?, u.arbitrary()?);
    let (seeds, strange) = ([positive(u)?, positive(u)?, positive(u)?], number(u)?);
    let colour = |k: usize| {
        let data = (0..width * height).map(|at| {
            let wave = if plain { 1.0 } else { ((at * (k + 2)) as f32 * 0.37).sin().abs() };
            if at % 97 == 96 { [strange, 0.0, 1.0] } else { seeds.map(|x| x * wave) }
        });
        Grid { width, height, data: data.collect() }
    };
    let mut maps = ReflectanceMaps { relightable: u.arbitrary()?, diffuse: colour(0), ..Default::default() };
    if specular {
        maps.specular = colour(1);
        let data = (0..width * height).map(|at| 0.02 + (at % 50) as f32 * 0.015);
        maps.sigma = Grid { width, height, data: data.collect() };
        let mut levels: Vec<u8> = (0..u.int_in_range(0..=3)?).map(|_| u.arbitrary()).collect::<Result<_>>()?;
        levels.sort_unstable();
        levels.dedup();
        for level in levels {
            let Some(lobes) = lobes(u)? else { continue };
            maps.palette.push(PaletteEntry { level, lobes });
        }
    }
    let steps = [positive(u)?, positive(u)?, positive(u)?].map(|step| step.clamp(0.05, 200.0));
    let steps = MapSteps { diffuse: steps[0], specular: steps[1], sigma: steps[2] };
    let Ok((bytes, decoded)) = internals::reflectance::encode(&maps, mesh, charts, &steps, 0.15) else {
        return Ok(None);
    };
    let again = internals::reflectance::decode(&bytes, mesh, charts, &budget()).expect("our own maps");
    assert!(again == decoded, "the maps come back others");
    Ok(Some(bytes))
}

fn lobes(u: &mut Unstructured) -> Result<Option<DsbrdfMaterial>> {
    let (slices, lobes) = (u.int_in_range(1..=20)?, u.int_in_range(1..=5)?);
    let amplitudes = u.arbitrary()?;
    let range = *u.choose(&[10, 300, 1024])?;
    let count = 3 * lobes * (2 + amplitudes as usize) * slices;
    let quantised = (0..count).map(|_| u.int_in_range(-range..=range)).collect::<Result<_>>()?;
    Ok(DsbrdfMaterial::new(slices, lobes, amplitudes, quantised))
}

fn tuned(u: &mut Unstructured) -> Result<Option<CompactMaterial>> {
    let reciprocal = u.arbitrary()?;
    let header = [63, 31, 127, 31, 31, 31].map(|most| u.int_in_range(0..=most));
    let [a, b, c, d, e, f] = header;
    let range = *u.choose(&[0, 3, 100, (1 << 20) - 1])?;
    let next = || u.int_in_range(-range..=range).unwrap_or(0);
    Ok(CompactMaterial::from_numbers(reciprocal, [a?, b?, c?, d?, e?, f?], next))
}

/// Materials and section `mATl`.
pub fn materials(u: &mut Unstructured) -> Result<Option<(Vec<NamedMaterial>, Vec<u8>)>> {
    let mut all = Vec::new();
    for _ in 0..u.int_in_range(0..=3)? {
        let material = match u.int_in_range(0..=3)? {
            0 => lobes(u)?.map(FittedMaterial::Dsbrdf),
            1 => tuned(u)?.map(FittedMaterial::Compact),
            2 => Some(FittedMaterial::Classical(classical(u)?)),
            _ => Some(FittedMaterial::MetallicRoughness(microfacets(u)?)),
        };
        let Some(material) = material else { continue };
        all.push(NamedMaterial { name: u.arbitrary()?, material });
    }
    let Ok(bytes) = brdf::encode_materials(&all) else { return Ok(None) };
    let again = brdf::decode_materials(&bytes, &budget()).expect("our own materials");
    assert!(again == all, "the materials come back others");
    Ok(Some((all, bytes)))
}

/// A classical model whose parameters may be out of their ranges.
fn classical(u: &mut Unstructured) -> Result<ClassicalModel> {
    let mut value = || Ok::<f64, arbitrary::Error>(positive(u)? as f64);
    let (a, b, c) = (value()?, value()?, value()?);
    let mut colour = || Ok::<[f64; 3], arbitrary::Error>([value()?, value()?, value()?]);
    let (diffuse, specular, third) = (colour()?, colour()?, colour()?);
    let reflectance = b.min(1.0);
    let lobe = match u.int_in_range(0..=9)? {
        0 => return Ok(ClassicalModel { diffuse, specular: [0.0; 3], lobe: ClassicalLobe::Lambert }),
        1 => ClassicalLobe::BlinnPhong { exponent: a },
        2 => ClassicalLobe::CookTorranceBeckmann { roughness: a, reflectance },
        3 => ClassicalLobe::CookTorranceGgx { roughness: a, reflectance },
        4 => ClassicalLobe::Ward { roughness: a },
        5 => ClassicalLobe::WardAnisotropic { roughness: [a, c] },
        6 => ClassicalLobe::AshikhminShirley { exponents: [a, c], reflectance },
        7 => ClassicalLobe::Lafortune { xy: -a, z: b, exponent: c },
        8 => ClassicalLobe::TorranceSparrow { sigma: a },
        _ => ClassicalLobe::ShiftedGamma(Box::new(ShiftedGamma {
            alpha: third,
            p: diffuse,
            f0: specular,
            f1: [a, b, c],
            normalisation: third,
            lambda: diffuse,
            c: [c, a, b],
            k: specular,
            theta0: [-a, b, c],
        })),
    };
    Ok(ClassicalModel { diffuse, specular, lobe })
}

fn microfacets(u: &mut Unstructured) -> Result<Microfacets> {
    let mut value = || Ok::<f64, arbitrary::Error>(positive(u)? as f64);
    let mut share = || Ok::<f64, arbitrary::Error>(value()?.min(1.0));
    let (base_colour, metallic, roughness) = ([share()?, share()?, share()?], share()?, share()?);
    Ok(Microfacets { base_colour, metallic, roughness, specular_colour: [value()?, value()?, value()?] })
}

/// Section `bIND` of a mesh and materials.
pub fn binding(u: &mut Unstructured, mesh: &Mesh, materials: &[NamedMaterial]) -> Result<Option<Vec<u8>>> {
    let mut names: Vec<String> = materials.iter().map(|named| named.name.clone()).collect();
    names.truncate(u.int_in_range(0..=names.len())?);
    let most = names.len() as u16;
    let mut of_triangle = Vec::new();
    for _ in &mesh.triangles {
        let number = if u.ratio(1, 3)? { u.int_in_range(0..=most)? } else { of_triangle.last().copied().unwrap_or(0) };
        of_triangle.push(number);
    }
    let binding = TriangleBinding { names, of_triangle };
    let Ok(bytes) = brdf::encode_binding(&binding) else { return Ok(None) };
    let again = brdf::decode_binding(&bytes, mesh.triangles.len(), materials, &budget()).expect("our own binding");
    assert!(again == binding, "the binding comes back another");
    Ok(Some(bytes))
}

/// Section `tCOR` of a mesh.
pub fn coordinates(u: &mut Unstructured, mesh: &Mesh) -> Result<Option<Vec<u8>>> {
    let mut all: Vec<mesh::CornerCoordinates> = Vec::new();
    let is_smooth = u.arbitrary()?;
    for triangle in &mesh.triangles {
        let own = |vertex: u32| [mesh.positions[vertex as usize][0], mesh.positions[vertex as usize][1]];
        all.push(if is_smooth {
            triangle.map(own)
        } else {
            [[number(u)?, number(u)?], own(triangle[1]), [0.5, number(u)?]]
        });
    }
    let Ok((bytes, coded)) = mesh::encode_coordinates(&all, mesh, u.int_in_range(1..=24)?) else { return Ok(None) };
    let again = mesh::decode_coordinates(&bytes, mesh, &budget()).expect("our own coordinates");
    assert!(again == coded, "the coordinates come back others");
    Ok(Some(bytes))
}

/// Section `lIGt`.
pub fn light(u: &mut Unstructured) -> Result<Option<Vec<u8>>> {
    let mut light = EnvironmentLobes::default();
    for _ in 0..u.int_in_range(0..=3)? {
        let axis = *u.choose(&[[0.0, 1.0, 0.0], [0.6, 0.0, -0.8], [0.48, -0.6, 0.64]])?;
        let amplitude = [positive(u)? as f64, positive(u)? as f64, positive(u)? as f64];
        light.diffuse.push(SphericalGaussian { axis, sharpness: positive(u)? as f64, amplitude });
    }
    for _ in 0..u.int_in_range(0..=2)? {
        let size = u.int_in_range(1..=24)?;
        let (bright, dim) = (positive(u)?, positive(u)?);
        let cells = (0..size * size).map(|at| if at % 13 == 0 { [bright, dim, 1.0] } else { [dim; 3] }).collect();
        light.prefiltered.extend(PrefilteredMap::new(positive(u)? as f64, size, cells));
    }
    let options = lighting::LightCodingOptions { step: positive(u)? };
    let Ok((bytes, decoded)) = lighting::encode(&light, &options) else { return Ok(None) };
    let again = lighting::decode(&bytes, &budget()).expect("our own light");
    assert!(again == decoded, "the light comes back another");
    Ok(Some(bytes))
}

/// Section `vISB`.
pub fn visibility(u: &mut Unstructured, mesh: &Mesh) -> Result<Option<Vec<u8>>> {
    let options = BakeOptions {
        size: u.int_in_range(8..=12)?,
        terms: [u.int_in_range(1..=4)?, u.int_in_range(0..=3)?],
        ground_up: if u.arbitrary()? { Some([0.0, 1.0, 0.0]) } else { None },
        weight_step: positive(u)?.max(1e-4) as f64,
        places: u.int_in_range(0..=64)?,
    };
    let Ok(baked) = bake(mesh, &options) else { return Ok(None) };
    let again = internals::visibility::decode(&baked.bytes, mesh, &budget()).expect("our own visibility");
    assert!(again == baked.visibility, "the visibility comes back another");
    Ok(Some(baked.bytes))
}

/// Section `mETA`, not compressed.
pub fn metadata(u: &mut Unstructured) -> Result<Vec<u8>> {
    let mut map = Map::new();
    for _ in 0..u.int_in_range(0..=4)? {
        let known = ["title", "units", "achieved_error", "color_space", "generator"];
        let key = if u.arbitrary()? { (*u.choose(&known)?).to_owned() } else { u.arbitrary()? };
        map.insert(key, value(u, 3)?);
    }
    let metadata = Metadata(map);
    let bytes = internals::container::metadata::encode(&metadata).expect("any object can be written");
    let again = internals::container::metadata::decode(&bytes, &budget()).expect("our own metadata");
    assert!(again == metadata, "the metadata comes back other");
    let _ = (again.title(), again.achieved_error());
    Ok(bytes)
}

fn value(u: &mut Unstructured, depth: usize) -> Result<Value> {
    Ok(match u.int_in_range(0..=if depth == 0 { 4 } else { 6 })? {
        0 => Value::Null,
        1 => Value::Bool(u.arbitrary()?),
        2 => u.arbitrary::<i64>()?.into(),
        3 => serde_json::Number::from_f64(f64::from_bits(u.arbitrary()?)).map_or(Value::Null, Value::Number),
        4 => Value::String(u.arbitrary()?),
        5 => (0..u.int_in_range(0..=3)?).map(|_| value(u, depth - 1)).collect::<Result<_>>()?,
        _ => {
            let mut map = Map::new();
            for _ in 0..u.int_in_range(0..=3)? {
                map.insert(u.arbitrary()?, value(u, depth - 1)?);
            }
            Value::Object(map)
        }
    })
}

/// Section `tHMB`.
pub fn thumbnail(u: &mut Unstructured) -> Result<Option<Vec<u8>>> {
    let [width, height] = [u.int_in_range(0..=1100u32)?, u.int_in_range(0..=1100u32)?];
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    png.extend(width.to_be_bytes().iter().chain(&height.to_be_bytes()));
    png.extend(u.arbitrary::<[u8; 33]>()?);
    let Ok(bytes) = container::encode_thumbnail(&png) else { return Ok(None) };
    let again = container::decode_thumbnail(bytes.clone()).expect("our own thumbnail");
    assert_eq!((again.width, again.height, again.png), (width, height, png));
    Ok(Some(bytes))
}
