//! Figures of images under an environment: a ball over a plate.

use super::job_material::JobMaterial;
use super::sampled_view::render_evenly;
use super::scene::ShadingPoint;
use super::*;
use crate::lighting::{self, EnvironmentMap};
use crate::mesh::Mesh;
use crate::surface::displacement::DisplacedMesh;
use crate::surface::samples::SurfaceSamples;
use crate::visibility::bake::{BakeOptions, bake};
use std::sync::Arc;

/// A ball of radius 1 over a square plate with `side` vertices along each side.
fn ball_over_plate(side: usize) -> Mesh {
    let (rings, sectors) = (20, 32);
    let mut mesh = Mesh::default();
    for k in 0..rings * sectors {
        let theta = (k / sectors) as f32 / (rings - 1) as f32 * std::f32::consts::PI;
        let (s, c) = ((k % sectors) as f32 / sectors as f32 * std::f32::consts::TAU).sin_cos();
        mesh.positions.push([theta.sin() * c, 1.3 + theta.cos(), theta.sin() * s]);
    }
    let at = |ring: usize, sector: usize| (ring * sectors + sector % sectors) as u32;
    for (ring, sector) in (0..rings - 1).flat_map(|r| (0..sectors).map(move |s| (r, s))) {
        let [a, b, c, d] = [at(ring, sector), at(ring, sector + 1), at(ring + 1, sector + 1), at(ring + 1, sector)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    let first = mesh.positions.len();
    let place = |k: usize| 5.0 * k as f32 / (side - 1) as f32 - 2.5;
    mesh.positions.extend((0..side * side).map(|k| [place(k % side), 0.0, place(k / side)]));
    let at = |x: usize, y: usize| (first + y * side + x) as u32;
    for (x, y) in (0..side - 1).flat_map(|x| (0..side - 1).map(move |y| (x, y))) {
        let [a, b, c, d] = [at(x, y), at(x, y + 1), at(x + 1, y + 1), at(x + 1, y)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

fn material(text: &str) -> Material {
    serde_json::from_str::<JobMaterial>(text).unwrap().uniform().unwrap()
}

const GLOSSY: &str = r#"{"model": "cook-torrance", "diffuse": 0.3, "roughness": 0.2, "reflectance": 0.5}"#;

fn psnr(a: &RgbImage, b: &RgbImage) -> f64 {
    let encoded = |x: f32| (x.clamp(0.0, 1.0) as f64).powf(1.0 / 2.2);
    let (a, b) = (a.data.as_flattened(), b.data.as_flattened());
    let sum: f64 = a.iter().zip(b).map(|(&x, &y)| (encoded(x) - encoded(y)).powi(2)).sum();
    -10.0 * (sum / a.len() as f64).log10()
}

#[test]
fn an_even_sky_gives_every_point_the_albedo() {
    let mesh = ball_over_plate(16);
    let object = RenderObject::new(&mesh, None).unwrap();
    let environment = EnvironmentMap::from_fn(64, |_| [1.0, 0.5, 2.0]);
    let surround = Arc::new(PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default()));
    let light = Arc::new(lighting::EnvironmentLobes {
        diffuse: lighting::fit::fit(&environment, &lighting::fit::LobeFitOptions { lobes: 2, evaluations: 150 }, None),
        prefiltered: lighting::levels::prefiltered_maps(&environment, 64),
    });
    let camera = look_at([0.0, 1.3, 6.0], [0.0, 1.3, 0.0], [0.0, 1.0, 0.0], 60.0, 40, 40);
    let look = UniformMaterial::new(material(r#"{"model": "lambert", "diffuse": [0.5, 0.5, 0.1]}"#), 1);
    // The cosine as a lobe is 8 % too bright.
    for (evaluator, expected, within) in
        [(EvaluatorKind::Filtered, 0.5, 0.01), (EvaluatorKind::SphericalGaussian, 0.54, 0.03)]
    {
        let options = EnvironmentOptions { evaluator, shadows: false, samples: 1, ..EnvironmentOptions::default() };
        let scene = EnvironmentScene::new(&object, surround.clone(), Some(light.clone()), options).unwrap();
        let pixel = scene.render(&camera, &look).unwrap().image.value_at(20, 20).map(f64::from);
        let moving = RealtimeRenderer::new(scene).render(&camera, &look).unwrap().image.value_at(20, 20).map(f64::from);
        for pixel in [pixel, moving] {
            assert!((pixel[0] - expected).abs() < within, "{evaluator:?}: {pixel:?}");
            assert!((pixel[1] / pixel[0] - 0.5).abs() < 0.01 && (pixel[2] / pixel[0] - 0.4).abs() < 0.01);
        }
    }
    let options = ReferenceOptions { samples: 1, shadows: false, ..ReferenceOptions::default() };
    let exact = reference(&object, &environment, &camera, &look, &options).unwrap();
    assert!((exact.image.value_at(20, 20)[0] - 0.5).abs() < 0.01);
}

/// An image with as many samples of each pixel.
fn evenly(scene: &EnvironmentScene, camera: &Camera, look: &dyn ShadingModel, samples: u32) -> EnvironmentRender {
    let radiance = |point: &ShadingPoint, _| scene.evaluator.radiance(point, &point.reflectance(look));
    render_evenly(scene.object, camera, samples, radiance).unwrap()
}

#[test]
fn outlines_are_drawn_with_more_samples() {
    let mesh = ball_over_plate(4);
    let object = RenderObject::new(&mesh, None).unwrap();
    let environment = EnvironmentMap::from_fn(64, |d| [1.0 + d[1] as f32; 3]);
    let surround = Arc::new(PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default()));
    let options = EnvironmentOptions { shadows: false, ..EnvironmentOptions::default() };
    let scene = EnvironmentScene::new(&object, surround, None, options).unwrap();
    let camera = look_at([1.0, 3.0, 6.0], [0.0, 0.8, 0.0], [0.0, 1.0, 0.0], 90.0, 96, 72);
    let look = UniformMaterial::new(material(r#"{"model": "lambert", "diffuse": 0.5}"#), 1);
    let [exact, four, two] = [8, 4, 2].map(|samples| evenly(&scene, &camera, &look, samples).image);
    let still = scene.render(&camera, &look).unwrap().image;
    // Most of what two samples lack is at the outline, where it has four.
    let [four, two, still] = [four, two, still].map(|image| psnr(&image, &exact));
    assert!(still > two + 4.0 && still > four - 1.0, "{two} {still} {four}");
}

#[test]
fn evaluators_come_near_brute_force_and_motion_near_them() {
    let mesh = ball_over_plate(16);
    let baked = bake(&mesh, &BakeOptions { terms: [16, 16], ..BakeOptions::default() }).unwrap();
    let occlusion = Occlusion::from_visibility(&baked.visibility);
    let object = RenderObject::new(&mesh, Some(&occlusion)).unwrap();
    let environment = EnvironmentMap::from_fn(128, |d| {
        let sun = (400.0 * (d[0] * 0.6 + d[1] * 0.64 + d[2] * 0.48 - 1.0)).exp() as f32;
        [0.3 + 40.0 * sun, 0.4 + 0.3 * d[1] as f32 + 35.0 * sun, 0.5 + 25.0 * sun]
    });
    let surround = Arc::new(PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default()));
    let light = Arc::new(lighting::EnvironmentLobes {
        diffuse: lighting::fit::fit(&environment, &Default::default(), None),
        prefiltered: lighting::levels::prefiltered_maps(&environment, 128),
    });
    let camera = look_at([1.0, 3.0, 6.0], [0.0, 0.8, 0.0], [0.0, 1.0, 0.0], 90.0, 96, 72);
    let look = UniformMaterial::new(material(GLOSSY), 24);
    let exact = reference(&object, &environment, &camera, &look, &ReferenceOptions::default()).unwrap().image;
    let mut found = Vec::new();
    for evaluator in [EvaluatorKind::Filtered, EvaluatorKind::SphericalGaussian] {
        let options = EnvironmentOptions { evaluator, samples: 2, ..EnvironmentOptions::default() };
        let scene = EnvironmentScene::new(&object, surround.clone(), Some(light.clone()), options).unwrap();
        let still = scene.render(&camera, &look).unwrap();
        // One sample a pixel on both sides.
        let single = EnvironmentOptions { samples: 1, ..options };
        let single = EnvironmentScene::new(&object, surround.clone(), Some(light.clone()), single).unwrap();
        let one = single.render(&camera, &look).unwrap();
        let even = evenly(&scene, &camera, &look, 2);
        let (mut motion, mut fine) = (RealtimeRenderer::new(single), RealtimeRenderer::new(scene));
        let (moving, fine) = (motion.render(&camera, &look).unwrap(), fine.render(&camera, &look).unwrap());
        assert_eq!(moving.coverage, one.coverage);
        assert!(fine.coverage.data.iter().zip(&even.coverage.data).all(|(a, b)| (a - b).abs() < 1e-6));
        found.push((psnr(&still.image, &exact), psnr(&moving.image, &one.image), psnr(&fine.image, &even.image)));
    }
    println!("against brute force, against stills: {found:?}");
    assert!(found[0].0 > 35.0 && found.iter().all(|f| f.1 > 34.0 && f.2 > 34.0), "{found:?}");
    assert!(found[0].0 > found[1].0 + 2.0, "filtered is not nearer: {found:?}");
}

#[test]
fn places_between_the_vertices_give_large_triangles_their_shadows() {
    let mesh = ball_over_plate(2);
    let environment = EnvironmentMap::from_fn(128, |d| [(1.0 + d[1]) as f32; 3]);
    let surround = Arc::new(PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default()));
    let camera = look_at([1.0, 3.0, 6.0], [0.0, 0.8, 0.0], [0.0, 1.0, 0.0], 90.0, 96, 72);
    let look = UniformMaterial::new(material(r#"{"model": "lambert", "diffuse": [0.5, 0.5, 0.5]}"#), 1);
    let error = |places: usize| {
        let baked = bake(&mesh, &BakeOptions { places, ..BakeOptions::default() }).unwrap();
        let occlusion = Occlusion::from_visibility(&baked.visibility);
        let object = RenderObject::new(&mesh, Some(&occlusion)).unwrap();
        let exact = reference(&object, &environment, &camera, &look, &ReferenceOptions::default()).unwrap().image;
        let scene = EnvironmentScene::new(&object, surround.clone(), None, EnvironmentOptions::default()).unwrap();
        let still = psnr(&scene.render(&camera, &look).unwrap().image, &exact);
        let single = EnvironmentOptions { samples: 1, ..EnvironmentOptions::default() };
        let single = EnvironmentScene::new(&object, surround.clone(), None, single).unwrap();
        let one = single.render(&camera, &look).unwrap();
        let moving = psnr(&RealtimeRenderer::new(single).render(&camera, &look).unwrap().image, &one.image);
        (occlusion.places().count(), still, moving)
    };
    let (vertices, places) = (error(0), error(3000));
    println!("places, against brute force, motion against stills: {vertices:?} {places:?}");
    assert!(vertices.0 == mesh.positions.len() && (1000..=3000).contains(&places.0));
    assert!(places.1 > 33.0 && places.1 > vertices.1 + 6.0 && places.2 > 40.0);
}

/// The lower half of a ball of radius 1, open at the top.
pub(super) fn bowl() -> Mesh {
    let (rings, sectors) = (24, 48);
    let mut mesh = Mesh { positions: vec![[0.0, -1.0, 0.0]], triangles: Vec::new() };
    for ring in 1..=rings {
        let theta = ring as f32 / rings as f32 * std::f32::consts::FRAC_PI_2;
        mesh.positions.extend((0..sectors).map(|k| {
            let (s, c) = (k as f32 / sectors as f32 * std::f32::consts::TAU).sin_cos();
            [theta.sin() * c, -theta.cos(), theta.sin() * s]
        }));
    }
    let at =
        |ring: usize, sector: usize| if ring == 0 { 0 } else { (1 + (ring - 1) * sectors + sector % sectors) as u32 };
    for (ring, sector) in (0..rings).flat_map(|r| (0..sectors).map(move |s| (r, s))) {
        let [a, b, c, d] = [at(ring, sector), at(ring + 1, sector), at(ring + 1, sector + 1), at(ring, sector + 1)];
        mesh.triangles.push([a, c, b]);
        if ring > 0 {
            mesh.triangles.push([a, d, c]);
        }
    }
    mesh
}

/// Every point of half a ball sees its other points and the sky by the same half of its irradiance, whatever its place.
#[test]
fn a_bowl_lights_itself() {
    let mesh = bowl();
    let baked = bake(&mesh, &BakeOptions { terms: [16, 16], ..BakeOptions::default() }).unwrap();
    let occlusion = Occlusion::from_visibility(&baked.visibility);
    let object = RenderObject::new(&mesh, Some(&occlusion)).unwrap();
    let environment = EnvironmentMap::from_fn(64, |_| [1.0; 3]);
    let surround = Arc::new(PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default()));
    let camera = look_at([0.0, 3.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], 30.0, 33, 33);
    let look = UniformMaterial::new(material(r#"{"model": "lambert", "diffuse": 0.8}"#), 1);
    let scene = || EnvironmentScene::new(&object, surround.clone(), None, EnvironmentOptions::default()).unwrap();
    let bounced = scene().with_interreflection(&look);
    let middle = |image: &RgbImage| (0..121).map(|k| image.value_at(11 + k % 11, 11 + k / 11)[0]).sum::<f32>() / 121.0;
    let alone = middle(&scene().render(&camera, &look).unwrap().image);
    let both = middle(&bounced.render(&camera, &look).unwrap().image);
    let moving = middle(&RealtimeRenderer::new(bounced).render(&camera, &look).unwrap().image);
    assert!((alone - 0.4).abs() < 0.02, "{alone}");
    assert!((both - alone - 0.8 * 0.5 * alone).abs() < 0.01, "{alone} {both}");
    assert!((moving - both).abs() < 0.01, "{moving} {both}");
}

#[test]
fn a_surface_is_drawn_in_place_of_its_mesh() {
    let mesh = ball_over_plate(16);
    let wave = |_: usize, _: usize, [x, y, z]: [f64; 3]| 0.02 * (17.0 * x + 13.0 * y + 11.0 * z).sin();
    let surface = DisplacedMesh::new(&mesh, 2, wave).unwrap();
    let baked = bake(&mesh, &BakeOptions { terms: [16, 16], ..BakeOptions::default() }).unwrap();
    let occlusion = Occlusion::from_visibility(&baked.visibility);
    let environment = EnvironmentMap::from_fn(128, |d| [0.2 + (20.0 * (d[1] - 1.0)).exp() as f32 * 8.0; 3]);
    let surround = Arc::new(PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default()));
    let camera = look_at([1.0, 3.0, 6.0], [0.0, 0.8, 0.0], [0.0, 1.0, 0.0], 90.0, 96, 72);
    let look = UniformMaterial::new(material(GLOSSY), 24);
    fn scene<'a>(
        object: &'a RenderObject<'a>,
        surround: &Arc<PreparedEnvironment>,
        shadows: bool,
    ) -> EnvironmentScene<'a> {
        let options = EnvironmentOptions { shadows, ..EnvironmentOptions::default() };
        EnvironmentScene::new(object, surround.clone(), None, options).unwrap()
    }
    let drawn = RenderObject::with_surface(&mesh, &surface, Some(&occlusion)).unwrap();
    // Without shadows it is no more than a finer mesh, and behind it the coarse one where that stands out.
    let render = |object: &RenderObject| evenly(&scene(object, &surround, false), &camera, &look, 2);
    let plain = |mesh: &Mesh| render(&RenderObject::new(mesh, None).unwrap());
    let (both, fine, coarse) = (render(&drawn), plain(surface.mesh()), plain(&mesh));
    let mut standing_out = 0;
    for (k, &covered) in both.coverage.data.iter().enumerate() {
        let image = both.image.data[k];
        if covered == fine.coverage.data[k] {
            assert_eq!(image, fine.image.data[k]);
        } else {
            standing_out += 1;
            assert!(image.iter().all(|&x| x > 0.0), "{image:?}");
        }
        assert!(covered >= fine.coverage.data[k].max(coarse.coverage.data[k]));
    }
    assert!(standing_out > 20, "{standing_out} pixels");
    let image = |object: &RenderObject| scene(object, &surround, true).render(&camera, &look).unwrap().image;
    let exact = reference(&drawn, &environment, &camera, &look, &ReferenceOptions::default()).unwrap().image;
    let flat = RenderObject::new(&mesh, Some(&occlusion)).unwrap();
    let (with, without) = (psnr(&image(&drawn), &exact), psnr(&image(&flat), &exact));
    println!("against brute force: {with} with the surface, {without} with its mesh");
    assert!(with > 33.0 && with > without + 6.0, "{with} {without}");
    let other = ball_over_plate(4);
    assert!(RenderObject::with_surface(&other, &surface, None).is_err(), "surface of another mesh");
}

#[test]
fn what_is_missing_is_an_error_and_pictures_are_put_together() {
    let mesh = ball_over_plate(16);
    let object = RenderObject::new(&mesh, None).unwrap();
    let surround = Arc::new(PreparedEnvironment::new(
        &EnvironmentMap::from_fn(32, |_| [1.0; 3]),
        &PreparedEnvironmentOptions::default(),
    ));
    let scene =
        |options: EnvironmentOptions| EnvironmentScene::new(&object, surround.clone(), None, options).map(|_| ());
    let unshadowed = EnvironmentOptions { shadows: false, ..EnvironmentOptions::default() };
    assert!(scene(unshadowed).is_ok());
    assert!(scene(EnvironmentOptions::default()).is_err(), "no visibility");
    assert!(
        scene(EnvironmentOptions { evaluator: EvaluatorKind::SphericalGaussian, ..unshadowed }).is_err(),
        "no lobes"
    );
    assert!(scene(EnvironmentOptions { samples: 0, ..unshadowed }).is_err());
    let other = Occlusion::new(4, SurfaceSamples::at_vertices(3), |_| vec![1.0; 16]);
    assert!(RenderObject::new(&mesh, Some(&other)).is_err(), "visibility of another mesh");
    // Half covered: half of the object's share, half of the ground in its shadow.
    let filled = |value: f32| RgbImage::filled(2, 1, [value; 3]);
    let coverage = crate::image::Grid { width: 2, height: 1, data: vec![0.5, 0.0] };
    let relit = EnvironmentRender { image: filled(0.2), diffuse: filled(0.2), coverage };
    let together = composite(&filled(1.0), &relit, &filled(0.4)).unwrap();
    assert!((together.data[0][0] - (0.2 + 0.5 * 0.4)).abs() < 1e-6 && (together.data[1][0] - 0.6).abs() < 1e-6);
    assert!(composite(&RgbImage::filled(1, 1, [1.0; 3]), &relit, &filled(1.0)).is_err());
}
