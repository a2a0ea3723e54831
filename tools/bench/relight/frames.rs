//! Relighting in figures: `TSUYA_DATA=DATA cargo bench -p tsuya-bench --bench relight -- [bake] [light] [frames] [ar]`. DATA holds meshes/ and envmaps/;
//! all parts without any name.
//!
//! - bake: visibility of the bunny with about as many vertices as the published meshes, and finer ones.
//! - light: lobes and levels of an environment of 512 x 256, and their update while it turns, with errors.
//! - frames: the bunny of about 6,000 vertices at 640 x 480 while the camera goes round it, one sample a pixel; "of stills" is the PSNR of
//!   the object's pixels against still pictures of the same evaluator (sRGB, white = 1), which compare.py sets beside another renderer's.
//! - ar: the same bunny put on a marker that moves, 640 x 480, step by step, under light that stays and under light that turns.

#![allow(missing_docs)]

#[path = "../../../tests/support/markers.rs"]
mod markers;

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use tsuya::Camera;
use tsuya::Mesh;
use tsuya::internals::visibility::{DirectionGrid, MeshRays, RayScratch};
use tsuya::lighting::{EnvironmentLobes, EnvironmentMap};
use tsuya::relight::{
    EnvironmentOptions, EnvironmentScene, EvaluatorKind, JobMaterial, Occlusion, PreparedEnvironment,
    PreparedEnvironmentOptions, RealtimeRenderer, RenderObject, UniformMaterial, look_at,
};
use tsuya::visibility::{BakeOptions, Visibility, bake};
use tsuya::{
    internals,
    lighting::{self, LightFollower},
};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let asked: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wants = |part: &str| asked.is_empty() || asked.iter().any(|a| a == part);
    let data = std::env::var("TSUYA_DATA")?;
    let data = Path::new(&data);
    let bunny = tsuya::mesh::clean(tsuya::mesh::read(data.join("meshes/stanford-bunny.obj"), &Default::default())?).0;
    let environments = ["museum.exr", "KernerEnvLatLong.exr", "studio.exr"];
    if wants("bake") {
        baking(&bunny)?;
    }
    if wants("light") {
        for name in environments {
            light(name, &environment(data, name)?);
        }
    }
    if wants("frames") {
        for name in &environments[..2] {
            frames(&clustered(&bunny, 6_000), name, &environment(data, name)?)?;
        }
    }
    if wants("ar") {
        for name in &environments[..2] {
            placing(&clustered(&bunny, 6_000), name, &environment(data, name)?)?;
        }
    }
    Ok(())
}

fn placing(mesh: &Mesh, name: &str, environment: &EnvironmentMap) -> Outcome {
    use tsuya::ar::{ArObject, ArOptions, LightSource, Placement, Plate, Session};
    use tsuya::capture::{Calibration, Lens};
    use tsuya::marker::Rig;
    const FRAMES: usize = 60;
    const PLANE: [usize; 2] = [640, 480];
    let baked = bake(mesh, &BakeOptions::default())?;
    let occlusion = Occlusion::from_visibility(&baked.visibility);
    let camera = markers::camera(PLANE[0] as u32, PLANE[1] as u32, 600.0);
    let calibration = Calibration { camera, lens: Lens::Pinhole };
    let scale = 0.2 / (2.0 * mesh.bounding_sphere().1);
    let placement = Placement::on_ground(mesh, None, 0.0, scale, [0.0; 3])?;
    let shots: Vec<Plate> = (0..FRAMES)
        .map(|k| {
            let t = 0.1 * k as f64;
            let pose = markers::posed([-50.0 + 5.0 * t.sin(), 10.0 * t.cos(), 0.0], [0.0, 0.05, 0.55 + 0.03 * t.sin()]);
            let grey = markers::draw(&camera, &Lens::Pinhole, &markers::TAG36H11_0, &pose, k as u32);
            Plate::Display(grey.map(|&v| [v; 3]))
        })
        .collect();
    println!("{name}, {} vertices, the object 0.2 high at 0.55, {} frames of {PLANE:?}", mesh.positions.len(), FRAMES);
    println!(
        "| material | light | samples | pose | light | render | composite | frames a second |\n|---|---|---|---|---|---|---|---|"
    );
    let materials = [
        ("rough", r#"{"model": "cook-torrance", "diffuse": 0.2, "roughness": 0.35, "reflectance": 0.3}"#),
        ("glossy", r#"{"model": "cook-torrance", "diffuse": 0.1, "roughness": 0.12, "reflectance": 0.7}"#),
    ];
    // As many columns as `tsuya ar` gives sequences, turned before the clock runs.
    let moving: Vec<EnvironmentMap> =
        (1..=FRAMES).map(|k| environment.resized(256, 128).rotated_y(3.0 * k as f64)).collect();
    for (material, text) in materials {
        for (moves, samples) in [(false, 1), (false, 2), (true, 1), (true, 2)] {
            let look = UniformMaterial::new(serde_json::from_str::<JobMaterial>(text)?.uniform()?, 7);
            let object = RenderObject::new(mesh, Some(&occlusion))?;
            let object = ArObject { object, shading: &look, placement, detail: None };
            let options = ArOptions { samples, ..ArOptions::default() };
            let light = if moves { LightSource::PerFrame } else { LightSource::Fixed(environment) };
            let mut session = Session::new(
                &object,
                &calibration,
                Rig::parse("tag36h11:0:0.1", &Default::default())?,
                light,
                options,
            )?;
            let mut sums = [0.0; 5];
            let mut count = 0;
            for (plate, turned) in shots.iter().zip(&moving) {
                let report = session.frame(&mut plate.clone(), None, Some(turned).filter(|_| moves))?;
                // The first frames fill the caches.
                if report.frame >= 5 && report.estimate.is_some() {
                    let t = report.times;
                    sums = std::array::from_fn(|k| sums[k] + [t.whole, t.pose, t.light, t.render, t.composite][k]);
                    count += 1;
                }
            }
            let [whole, pose, light, render, composite] = sums.map(|s| 1e3 * s / count as f64);
            println!(
                "| {material} | {} | {samples} | {pose:.1} ms | {light:.1} ms | {render:.1} ms | {composite:.1} ms | {:.1} |",
                if moves { "turns" } else { "stays" },
                1e3 / whole
            );
        }
    }
    Ok(())
}

fn environment(data: &Path, name: &str) -> Result<EnvironmentMap, Box<dyn std::error::Error>> {
    Ok(lighting::read_environment(&[data.join("envmaps").join(name)], &lighting::EnvironmentReadOptions::default())?
        .0
        .resized(512, 256))
}

fn baking(bunny: &Mesh) -> Outcome {
    println!(
        "| vertices | triangles | places | bake, 48 terms | bytes a place | error of the angle | wrong signs | between places |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (wanted, places) in [(830, 0), (830, 8_000), (5_734, 0), (usize::MAX, 0), (50_000, 0)] {
        let mesh = match wanted {
            usize::MAX => bunny.clone(),
            50_000 => subdivided(&clustered(bunny, 12_500)),
            _ => clustered(bunny, wanted),
        };
        let baked = bake(&mesh, &BakeOptions { places, ..BakeOptions::default() })?;
        let (error, places) = (baked.visibility.error(), baked.visibility.places().count());
        let (between, signs) = between(&mesh, &baked.visibility);
        println!(
            "| {} | {} | {places} | {:.2} s | {:.1} | {:.2} degrees | {:.2} % | {:.2} degrees, {:.2} % |",
            mesh.positions.len(),
            mesh.triangles.len(),
            baked.seconds,
            baked.bytes.len() as f64 / places as f64,
            error.rms_radians.to_degrees(),
            100.0 * error.wrong_signs,
            between.to_degrees(),
            100.0 * signs
        );
    }
    Ok(())
}

/// In the middles of triangles, where the weights of the places are interpolated: root mean square error of the angle, radians, and share
/// of wrong signs.
fn between(mesh: &Mesh, visibility: &Visibility) -> (f64, f64) {
    const TRIANGLES: usize = 96;
    // The middles as vertices of the same surface, in triangles cut in three.
    let mut cut = mesh.clone();
    let chosen: Vec<usize> = (0..TRIANGLES).map(|k| k * mesh.triangles.len() / TRIANGLES).collect();
    for &k in &chosen {
        let [a, b, c] = mesh.triangles[k];
        let corners = [a, b, c].map(|v| mesh.positions[v as usize]);
        let middle = cut.positions.len() as u32;
        cut.positions.push(std::array::from_fn(|i| corners.iter().map(|p| p[i]).sum::<f32>() / 3.0));
        cut.triangles[k] = [a, b, middle];
        cut.triangles.extend([[b, c, middle], [c, a, middle]]);
    }
    let (surroundings, grid, size) = (MeshRays::new(mesh, &cut, None), DirectionGrid::new(90), 90);
    let (angles, directions) = (internals::sphere::solid_angles(size), internals::sphere::directions(size));
    let (mut scratch, mut weights) = (RayScratch::default(), vec![0.0; visibility.terms()]);
    let (mut squares, mut wrong, mut all) = (0.0, 0.0, 0.0);
    for (number, &k) in chosen.iter().enumerate() {
        surroundings.signed_distances(mesh.positions.len() + number, &grid, &mut scratch);
        let (places, shares) = visibility.places().interpolation(k, mesh.triangles[k], [1.0 / 3.0; 3]);
        visibility.interpolate(places, shares, &mut weights);
        for ((&direction, &exact), &angle) in directions.iter().zip(&scratch.distances).zip(&angles) {
            let found = visibility.signed_distance_of_weights(&weights, direction);
            squares += angle * (found - (exact as f64).clamp(-FRAC_PI_2, FRAC_PI_2)).powi(2);
            wrong += if (found > 0.0) == (exact > 0.0) { 0.0 } else { angle };
            all += angle;
        }
    }
    ((squares / all).sqrt(), wrong / all)
}

fn light(name: &str, environment: &EnvironmentMap) {
    const LOBES: usize = 10;
    const FRAMES: usize = 20;
    let clock = Instant::now();
    let diffuse = lighting::fit(environment, &lighting::LobeFitOptions::default(), None);
    let first = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let sharp = lighting::prefiltered_maps(environment, 512);
    println!("{name}: lobes in {first:.3} s, levels in {:.3} s", clock.elapsed().as_secs_f64());
    let percents = |errors: &[f64]| errors.iter().map(|e| format!("{:.1}", 100.0 * e)).collect::<Vec<_>>().join(" ");
    let errors = |environment: &EnvironmentMap, light: &EnvironmentLobes| {
        let levels = lighting::prefiltered_errors(environment, &light.prefiltered, 200);
        format!(
            "irradiance {:.2} %, levels {} %",
            100.0 * lighting::irradiance_error(environment, &light.diffuse),
            percents(&levels)
        )
    };
    println!("  error: {}", errors(environment, &EnvironmentLobes { diffuse, prefiltered: sharp }));
    let mut follower = LightFollower::new(LOBES);
    let turned: Vec<EnvironmentMap> = (0..FRAMES).map(|k| environment.rotated_y(3.0 * k as f64)).collect();
    follower.update(&turned[0]);
    let clock = Instant::now();
    for environment in &turned[1..] {
        follower.update(environment);
    }
    let seconds = clock.elapsed().as_secs_f64() / (FRAMES - 1) as f64;
    println!("  update, 3 degrees a frame: {:.1} ms, {:.0} a second", 1e3 * seconds, 1.0 / seconds);
    println!("  error of the last: {}", errors(&turned[FRAMES - 1], follower.light()));
}

fn frames(mesh: &Mesh, name: &str, environment: &EnvironmentMap) -> Outcome {
    const FRAMES: usize = 60;
    let baked = bake(mesh, &BakeOptions::default())?;
    let occlusion = Occlusion::from_visibility(&baked.visibility);
    let object = RenderObject::new(mesh, Some(&occlusion))?;
    let surround = Arc::new(PreparedEnvironment::new(environment, &PreparedEnvironmentOptions::default()));
    let light = Arc::new(EnvironmentLobes {
        diffuse: lighting::fit(environment, &lighting::LobeFitOptions::default(), None),
        prefiltered: lighting::prefiltered_maps(environment, 256),
    });
    println!("{name}, {} vertices, {} distant lights", mesh.positions.len(), surround.distant_lights().len());
    println!(
        "| material | evaluator | taps | frames a second | pixels of the object | of stills |\n|---|---|---|---|---|---|"
    );
    let materials = [
        ("lambert", r#"{"model": "lambert", "diffuse": 0.7}"#),
        ("blinn-phong", r#"{"model": "blinn-phong", "diffuse": 0.3, "specular": 0.3, "exponent": 60}"#),
        ("rough", r#"{"model": "cook-torrance", "diffuse": 0.2, "roughness": 0.35, "reflectance": 0.3}"#),
        ("glossy", r#"{"model": "cook-torrance", "diffuse": 0.1, "roughness": 0.12, "reflectance": 0.7}"#),
    ];
    for (material, text) in materials {
        let material_of =
            || serde_json::from_str::<JobMaterial>(text).map_err(Box::from).and_then(|m| Ok(m.uniform()?));
        for (evaluator, taps) in
            [(EvaluatorKind::SphericalGaussian, 7), (EvaluatorKind::Filtered, 7), (EvaluatorKind::Filtered, 24)]
        {
            let named: Result<_, Box<dyn std::error::Error>> = material_of();
            let look = UniformMaterial::new(named?, taps);
            let scene_of = |taps: usize, samples: u32| {
                let options = EnvironmentOptions { evaluator, taps, samples, ..EnvironmentOptions::default() };
                EnvironmentScene::new(&object, surround.clone(), Some(light.clone()), options)
            };
            let scene = scene_of(taps, 1)?;
            let mut motion = RealtimeRenderer::new(scene);
            motion.render(&camera(mesh, 0), &look)?;
            let (clock, mut pixels) = (Instant::now(), 0);
            for k in 0..FRAMES {
                let covered = &motion.render(&camera(mesh, k), &look)?.coverage.data;
                pixels += covered.iter().filter(|&&covered| covered > 0.0).count();
            }
            let seconds = clock.elapsed().as_secs_f64() / FRAMES as f64;
            let named: Result<_, Box<dyn std::error::Error>> = material_of();
            let still = scene_of(24, 1)?.render(&camera(mesh, 7), &UniformMaterial::new(named?, 24))?.image;
            let moving = motion.render(&camera(mesh, 7), &look)?;
            let (mut squares, mut count) = (0.0, 0);
            for (k, _) in moving.coverage.data.iter().enumerate().filter(|&(_, &covered)| covered > 0.0) {
                for c in 0..3 {
                    squares += (encoded(moving.image.data[k][c]) - encoded(still.data[k][c])).powi(2);
                    count += 1;
                }
            }
            println!(
                "| {material} | {evaluator:?} | {taps} | {:.1} | {} | {:.1} dB |",
                1.0 / seconds,
                pixels / FRAMES,
                -10.0 * (squares / count as f64).log10()
            );
        }
    }
    Ok(())
}

/// Round the object, which fills most of the picture's height.
fn camera(mesh: &Mesh, k: usize) -> Camera {
    let (middle, radius) = mesh.bounding_sphere();
    let turn = 0.1 * k as f64;
    let eye = [middle[0] + 3.2 * radius * turn.sin(), middle[1] + 0.8 * radius, middle[2] + 3.2 * radius * turn.cos()];
    look_at(eye, middle, [0.0, 1.0, 0.0], 740.0, 640, 480)
}

fn encoded(x: f32) -> f64 {
    tsuya::image::to_srgb(x.clamp(0.0, 1.0) as f64)
}

/// About `wanted` vertices: those within a cube become their mean.
fn clustered(mesh: &Mesh, wanted: usize) -> Mesh {
    let (middle, radius) = mesh.bounding_sphere();
    let cluster = |side: f64| {
        let mut numbers = HashMap::new();
        let mut sums: Vec<([f64; 3], f64)> = Vec::new();
        let of: Vec<u32> = (mesh.positions.iter())
            .map(|p| {
                let cube: [i64; 3] = std::array::from_fn(|k| ((p[k] as f64 - middle[k]) / side).floor() as i64);
                let number = *numbers.entry(cube).or_insert_with(|| {
                    sums.push(([0.0; 3], 0.0));
                    sums.len() - 1
                });
                (0..3).for_each(|k| sums[number].0[k] += p[k] as f64);
                sums[number].1 += 1.0;
                number as u32
            })
            .collect();
        let positions = sums.iter().map(|(sum, count)| sum.map(|x| (x / count) as f32)).collect();
        let triangles = mesh.triangles.iter().map(|t| t.map(|v| of[v as usize]));
        let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
        Mesh { positions, triangles }
    };
    let (mut fine, mut coarse) = (radius * 1e-3, radius);
    for _ in 0..24 {
        let side = (fine * coarse).sqrt();
        if cluster(side).positions.len() > wanted { fine = side } else { coarse = side }
    }
    tsuya::mesh::clean(cluster(coarse)).0
}

/// Each triangle in four.
fn subdivided(mesh: &Mesh) -> Mesh {
    let mut positions = mesh.positions.clone();
    let mut middles = HashMap::new();
    let mut triangles = Vec::with_capacity(4 * mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
            *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                let (p, q) = (mesh.positions[p as usize], mesh.positions[q as usize]);
                positions.push(std::array::from_fn(|k| 0.5 * (p[k] + q[k])));
                positions.len() as u32 - 1
            })
        });
        triangles.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
    }
    Mesh { positions, triangles }
}
