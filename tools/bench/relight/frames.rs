//! How long a picture under an environment takes: `cargo bench --bench relight`. A mesh of about 6,000 vertices, 640 x 480 pixels.

#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use tsuya::asset::Mesh;
use tsuya::lighting::Environment;
use tsuya::relight::{
    EnvironmentOptions, Object, Occlusion, Scene, Surround, SurroundOptions, Uniform, job::JobMaterial, look_at,
};
use tsuya::visibility::bake::{BakeOptions, bake};

/// A bumpy ball.
fn ball() -> Mesh {
    let (rings, sectors) = (55, 110);
    let vertex = |k: usize| {
        let (theta, phi) = (
            (k / sectors) as f32 / (rings - 1) as f32 * std::f32::consts::PI,
            (k % sectors) as f32 / sectors as f32 * std::f32::consts::TAU,
        );
        let radius = 1.0 + 0.15 * (5.0 * theta).sin() * (6.0 * phi).sin();
        [radius * theta.sin() * phi.cos(), radius * theta.cos(), radius * theta.sin() * phi.sin()]
    };
    let at = |ring: usize, sector: usize| (ring * sectors + sector % sectors) as u32;
    let quad = |k: usize| {
        let (ring, sector) = (k / sectors, k % sectors);
        let (a, b, c, d) = (at(ring, sector), at(ring, sector + 1), at(ring + 1, sector + 1), at(ring + 1, sector));
        [[a, b, c], [a, c, d]]
    };
    Mesh {
        positions: (0..rings * sectors).map(vertex).collect(),
        triangles: (0..(rings - 1) * sectors).flat_map(quad).collect(),
    }
}

fn relight(criterion: &mut Criterion) {
    let mesh = ball();
    let sun = |d: [f64; 3]| if d[0] * 0.6 + d[1] * 0.64 + d[2] * 0.48 > 0.9995 { 500.0 } else { 0.0 };
    let environment = Environment::from_fn(512, |d| [0.3 + sun(d), 0.4 + d[1].max(0.0) as f32 + sun(d), 0.5 + sun(d)]);
    let Ok(baked) = bake(&mesh, &BakeOptions::default()) else { return };
    let occlusion = Occlusion::of(&baked.visibility);
    let surround = Surround::new(&environment, &SurroundOptions::default());
    let Ok(object) = Object::new(&mesh, Some(&occlusion)) else { return };
    let mut group = criterion.benchmark_group("relight");
    group.sample_size(20);
    group.bench_function("take in an environment", |b| {
        b.iter(|| Surround::new(&environment, &SurroundOptions::default()))
    });
    for (name, taps, material) in [
        ("frame, lambert", 1, r#"{"model": "lambert"}"#),
        (
            "frame, glossy, 7 taps",
            7,
            r#"{"model": "cook-torrance", "diffuse": 0.3, "roughness": 0.15, "reflectance": 0.5}"#,
        ),
    ] {
        let Ok(material) = serde_json::from_str::<JobMaterial>(material) else { return };
        let Ok(material) = material.uniform() else { return };
        let look = Uniform::new(material, taps);
        let options = EnvironmentOptions { samples: 1, taps, fast: true, ..EnvironmentOptions::default() };
        let Ok(scene) = Scene::new(&object, &surround, None, options) else { return };
        let mut turn = 0.0f64;
        group.bench_function(name, |b| {
            b.iter(|| {
                turn += 0.1;
                let eye = [3.6 * turn.sin(), 1.0, 3.6 * turn.cos()];
                scene.render(&look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 640.0, 640, 480), &look)
            })
        });
    }
    group.finish();
}

criterion_group!(benches, relight);
criterion_main!(benches);
