//! How long the sample capture takes: `cargo bench -p tsuya-bench --bench speed`. Encode, decode all views or one, render, verify; bake visibility, fit light.

#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::path::Path;
use tsuya::EncodeOptions;
use tsuya::capture::{self, CaptureReadOptions};
use tsuya::container::{Container, verify};
use tsuya::decoder::{DecodeOptions, ViewSelection, decode, decode_from};
use tsuya::encoder::encode;
use tsuya::lighting::{EnvironmentMap, LobeFitOptions};
use tsuya::relight::{AssetRenderer, RenderOptions};
use tsuya::visibility::{BakeOptions, bake};
use tsuya::{Limits, lighting};

fn speed(criterion: &mut Criterion) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/sample-spot");
    let Ok(captured) = capture::read(&path, &CaptureReadOptions::default()) else { return };
    let options = EncodeOptions::default();
    let Ok(encoded) = encode(captured.clone(), &options) else { return };
    let bytes = &encoded.bytes;
    let mut group = criterion.benchmark_group("sample-spot");
    group.sample_size(10);
    group.bench_function("encode", |b| b.iter(|| encode(captured.clone(), &options)));
    group.bench_function("decode", |b| b.iter(|| decode(black_box(bytes), &DecodeOptions::default())));
    let one = DecodeOptions { selection: ViewSelection::Views(vec![5]), ..Default::default() };
    group.bench_function("decode one view", |b| {
        b.iter(|| {
            Container::open_slice(black_box(bytes), Limits::default()).and_then(|mut f| decode_from(&mut f, &one))
        })
    });
    group.bench_function("verify", |b| b.iter(|| verify(black_box(&bytes[..]), Limits::default())));
    let Ok(asset) = decode(bytes, &DecodeOptions::default()) else { return };
    let Ok(renderer) = AssetRenderer::new(&asset) else { return };
    group.bench_function("render", |b| b.iter(|| renderer.render(&asset.views[3].camera, &RenderOptions::default())));
    group.bench_function("bake visibility", |b| b.iter(|| bake(black_box(&asset.mesh), &BakeOptions::default())));
    group.finish();
}

/// An environment of 512 x 256 pixels with a sun, a sky and a ground.
fn light(criterion: &mut Criterion) {
    let environment = EnvironmentMap::from_fn(512, |d| {
        let sun = 300.0 * (900.0 * (0.48 * d[0] + 0.6 * d[1] + 0.64 * d[2] - 1.0)).exp();
        let (sky, ripple) = (0.4 + 0.6 * d[1].max(0.0), 0.2 + 0.1 * (40.0 * d[0]).sin());
        if d[1] > 0.0 { [sun + 0.5 * sky, sun + 0.7 * sky, sun + sky] } else { [ripple; 3] }.map(|x| x as f32)
    });
    let mut group = criterion.benchmark_group("environment 512 x 256");
    group.sample_size(10);
    let lobes = lighting::fit(&environment, &LobeFitOptions::default(), None);
    group.bench_function("fit lobes", |b| {
        b.iter(|| lighting::fit(black_box(&environment), &LobeFitOptions::default(), None))
    });
    let turned = environment.rotated_y(2.0);
    group.bench_function("update lobes", |b| {
        b.iter(|| lighting::fit(&turned, &LobeFitOptions::default(), Some(&lobes)))
    });
    group.bench_function("levels", |b| b.iter(|| lighting::prefiltered_maps(black_box(&environment), 512)));
    group.finish();
}

criterion_group!(benches, speed, light);
criterion_main!(benches);
