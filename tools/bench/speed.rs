//! How long the sample capture takes: `cargo bench`. Encode, decode all views or one, render, verify.

#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::path::Path;
use tsuya::Limits;
use tsuya::capture::{self, ReadOptions};
use tsuya::container::{Container, verify};
use tsuya::decoder::{DecodeOptions, Selection, decode, decode_from};
use tsuya::encoder::encode;
use tsuya::options::EncodeOptions;
use tsuya::relight::{RenderOptions, Renderer};

fn speed(criterion: &mut Criterion) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sample-spot");
    let Ok(captured) = capture::read(&path, &ReadOptions::default()) else { return };
    let options = EncodeOptions::default();
    let Ok(encoded) = encode(captured.clone(), &options) else { return };
    let bytes = &encoded.bytes;
    let mut group = criterion.benchmark_group("sample-spot");
    group.sample_size(10);
    group.bench_function("encode", |b| b.iter(|| encode(captured.clone(), &options)));
    group.bench_function("decode", |b| b.iter(|| decode(black_box(bytes), &DecodeOptions::default())));
    let one = DecodeOptions { selection: Selection::Views(vec![5]), ..Default::default() };
    group.bench_function("decode one view", |b| {
        b.iter(|| {
            Container::open_slice(black_box(bytes), Limits::default()).and_then(|mut f| decode_from(&mut f, &one))
        })
    });
    group.bench_function("verify", |b| b.iter(|| verify(black_box(&bytes[..]), Limits::default())));
    let Ok(asset) = decode(bytes, &DecodeOptions::default()) else { return };
    let Ok(renderer) = Renderer::new(&asset) else { return };
    group.bench_function("render", |b| b.iter(|| renderer.render(&asset.views[3].camera, &RenderOptions::default())));
    group.finish();
}

criterion_group!(benches, speed);
criterion_main!(benches);
