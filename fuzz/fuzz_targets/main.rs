//! All fuzz targets, one program: what it consists of is compiled and linked once. `TSUYA_FUZZ_TARGET` names the one that runs.

#![no_main]

mod calibration;
mod charts;
mod colmap;
mod container;
mod directions;
mod displacement;
mod entropy;
mod gltf;
mod imports;
mod job;
mod lighting;
mod materials;
mod merl;
mod mesh;
mod mesh_file;
mod paper;
mod photograph;
mod plan;
mod planes;
mod reflectance;
mod rgl;
mod transforms;
mod typed_file;
mod typed_round_trip;
mod typed_sections;
mod views;
mod visibility;
mod whole_decode;

use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

/// Pairs of the names of targets and what they do with bytes.
macro_rules! targets {
    ($($name:ident),* $(,)?) => {
        [$((stringify!($name), $name::fuzz as fn(&[u8]))),*]
    };
}

static TARGET: LazyLock<fn(&[u8])> = LazyLock::new(|| {
    let targets = targets![
        calibration,
        charts,
        colmap,
        container,
        directions,
        displacement,
        entropy,
        gltf,
        imports,
        job,
        lighting,
        materials,
        merl,
        mesh,
        mesh_file,
        paper,
        photograph,
        plan,
        planes,
        reflectance,
        rgl,
        transforms,
        typed_file,
        typed_round_trip,
        typed_sections,
        views,
        visibility,
        whole_decode,
    ];
    let wanted = std::env::var("TSUYA_FUZZ_TARGET").unwrap_or_default();
    let named = targets.into_iter().find(|(name, _)| *name == wanted);
    let names = || targets.map(|(name, _)| name).join(" ");
    named.unwrap_or_else(|| panic!("TSUYA_FUZZ_TARGET names no target {wanted:?}; there are: {}", names())).1
});

fuzz_target!(
    init: {
        tsuya_fuzz::pictures::put_capture();
        LazyLock::force(&TARGET);
    },
    |bytes: &[u8]| TARGET(bytes)
);
