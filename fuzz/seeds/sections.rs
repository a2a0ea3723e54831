//! Sections for the targets that read one of them, made for the mesh and the views that these targets have.

use crate::{Seeds, models, scene};
use tsuya::internals::MaskedPhotographs;
use tsuya::internals::predictive::{PlaneEncoder, PlaneQuality};
use tsuya::internals::reflectance::{MapSteps, ReflectanceSources};
use tsuya::internals::views::ViewsSection;
use tsuya::mesh::{MeshOptions, encode};
use tsuya::{DecodeSpeed, SpecularModel};
use tsuya::{Mesh, internals};

/// Puts sections.
pub fn put(seeds: &Seeds) {
    meshes(seeds);
    for polarised in [true, false] {
        for mixed in [true, false] {
            let white = scene::WHITE;
            let mut all = scene::views_of(&scene::sizes(mixed));
            all[1].name = "photograph 9.exr".into();
            if !polarised {
                all[2].light = None;
            }
            let section = ViewsSection { white, components: scene::components(polarised).to_vec(), views: all };
            let bytes = internals::views::encode(&section, &scene::mesh().positions).expect("views");
            seeds.put("views", &format!("{polarised}-{mixed}"), bytes);
            photographs(seeds, polarised, mixed);
        }
    }
    let mesh = scene::mesh();
    seeds.put("charts", "two", internals::surface::charts::encode(&mesh, &scene::charts()).expect("charts"));
    for density in [3.0, 8.0, 30.0] {
        let layout = internals::surface::atlas::layout(&mesh, density).expect("a layout");
        seeds.put(
            "charts",
            &format!("density-{density}"),
            internals::surface::charts::encode(&mesh, &layout).expect("charts"),
        );
    }
    for (levels, step) in [(0, 0.01), (2, 0.002)] {
        // As many as a mesh of these triangles has vertices, and more.
        let values: Vec<f64> = (0..6 << (2 * levels)).map(|k| 0.05 * (k as f64).sin()).collect();
        let displacements = internals::surface::displacement::Displacements { levels, values: &values, step };
        let (bytes, _) =
            internals::surface::displacement::encode(&displacements, &mesh, &scene::charts()).expect("a surface");
        seeds.put("displacement", &format!("{levels}"), bytes);
    }
    seeds.put("visibility", "vertices", models::visibility(&mesh, 0));
    seeds.put("visibility", "places", models::visibility(&mesh, 40));
    seeds.put("lighting", "small", models::light(8));
    seeds.put("lighting", "large", models::light(32));
    let materials = models::materials();
    for count in 0..=materials.len() {
        let bytes = tsuya::brdf::encode_materials(&materials[..count]).expect("materials");
        seeds.put("materials", &format!("{count}"), bytes);
    }
    let of_triangle = (0..500).map(|triangle| [1, 2, 0, 3][triangle / 60 % 4]).collect();
    let binding = tsuya::brdf::TriangleBinding { names: ["a", "b", "lobes"].map(String::from).to_vec(), of_triangle };
    seeds.put("materials", "binding", tsuya::brdf::encode_binding(&binding).expect("a binding"));
    atlases(seeds);
}

/// Closed, open, cut into parts, with an edge of three triangles, with both windings.
fn meshes(seeds: &Seeds) {
    let open = |mesh: Mesh, keep: usize| Mesh { triangles: mesh.triangles.into_iter().step_by(keep).collect(), ..mesh };
    let mut fin = scene::mesh();
    fin.positions.push([0.5, 0.5, 2.0]);
    fin.triangles.push([0, 2, 6]);
    let mut turned = scene::mesh();
    turned.triangles[3].swap(1, 2);
    let all = [
        ("octahedron", scene::mesh()),
        ("sphere", scene::sphere(1)),
        ("finer", scene::sphere(2)),
        ("open", open(scene::sphere(1), 3)),
        ("parts", open(scene::mesh(), 2)),
        ("fin", fin),
        ("turned", turned),
    ];
    for (name, mesh) in all {
        for position_bits in [6, 12] {
            let coded = encode(&mesh, &MeshOptions { position_bits }).expect("a mesh");
            seeds.put("mesh", &format!("{name}-{position_bits}"), coded.bytes);
        }
    }
}

/// Both profiles. First bytes as the targets take them: planes, components less one and mixed sizes; paper, components and views.
fn photographs(seeds: &Seeds, polarised: bool, mixed: bool) {
    let (mesh, views) = (scene::mesh(), scene::views_of(&scene::sizes(mixed)));
    let components = scene::components(polarised);
    let photographs = scene::photographs(&mesh, &views, components, mixed);
    let covered = internals::surface::coverage_runs(&mesh, &views);
    for decoding in [DecodeSpeed::Normal, DecodeSpeed::Fast, DecodeSpeed::Fastest] {
        let source = MaskedPhotographs {
            mesh: &mesh,
            views: &views,
            components,
            white: scene::WHITE,
            covered: &covered,
            photographs: &photographs,
        };
        let encoder = PlaneEncoder::new(&source, mixed).expect("photographs in memory");
        let tile_side_log2 = if decoding == DecodeSpeed::Fastest { 4 } else { 8 };
        let quality = PlaneQuality { step: 0.03, decode_speed: decoding, tile_side_log2, ..Default::default() };
        let bytes = encoder.encode(&quality).expect("photographs").bytes;
        let kind = (components.len() - 1) as u8 | (mixed as u8) << 1;
        seeds.put("planes", &format!("{decoding:?}-{polarised}-{mixed}"), [&[kind][..], &bytes].concat());
    }
    for (number, density) in [0.3, 1.0].into_iter().enumerate() {
        let samples = internals::wavelet_texture::WaveletSamples::gather(&mesh, &views, &photographs, density)
            .expect("photographs in memory");
        let model = internals::wavelet_texture::fit_model(&samples, components);
        for model in [None, Some(&model)] {
            let options = internals::wavelet_texture::WaveletOptions {
                keep_percent: 8.0,
                view_levels: number as u8 + 1,
                ..Default::default()
            };
            let bytes =
                internals::wavelet_texture::encode(&samples, components, model, &options).expect("samples").bytes;
            let kind = 4 + (2 - components.len()) as u8;
            let name = format!("{polarised}-{mixed}-{number}-{}", model.is_some());
            seeds.put("paper", &name, [&[kind][..], &bytes].concat());
        }
    }
}

/// Reflectance on the target's atlas, with and without highlights, their palette and lights.
fn atlases(seeds: &Seeds) {
    let (mesh, charts) = (scene::mesh(), scene::charts());
    let raster = internals::surface::atlas::rasterise_atlas(&mesh, &charts).expect("an atlas");
    for (name, polarised, lit, specular) in [
        ("lobes", true, true, SpecularModel::TorranceSparrow),
        ("palette", true, true, SpecularModel::Dsbrdf),
        ("weights", true, true, SpecularModel::GgxLobes),
        ("diffuse", false, true, SpecularModel::TorranceSparrow),
        ("radiance", false, false, SpecularModel::TorranceSparrow),
    ] {
        let components = scene::components(polarised);
        let mut views = scene::views(3, 32, 32);
        if !lit {
            views.iter_mut().for_each(|view| view.light = None);
        }
        let photographs = &scene::photographs(&mesh, &views, components, false);
        let sources = ReflectanceSources {
            mesh: &mesh,
            surface: None,
            views: &views,
            components,
            photographs,
            specular,
            irradiance: None,
        };
        let maps = internals::reflectance::fit_maps(&sources, &charts, &raster).expect("photographs in memory");
        let steps = MapSteps { diffuse: 8.0, specular: 16.0, sigma: 16.0 };
        let (bytes, _) = internals::reflectance::encode(&maps, &mesh, &charts, &steps, 0.15).expect("maps");
        seeds.put("reflectance", name, bytes);
    }
}
