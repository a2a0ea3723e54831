//! Any bytes as section `RFLC` of a small atlas.
#![no_main]
mod scene;
use libfuzzer_sys::fuzz_target;
use tsuya::{Budget, Limits, reflectance};

fuzz_target!(|bytes: &[u8]| {
    let budget = Budget::new(Limits { memory_bytes: 1 << 24, ..Limits::default() });
    if let Ok(maps) = reflectance::code::decode(bytes, &scene::mesh(), &scene::charts(), &budget) {
        assert!(maps.diffuse.data.iter().chain(&maps.specular.data).flatten().all(|x| x.is_finite() && *x >= 0.0));
        assert!(maps.sigma.data.iter().all(|x| (0.019..=0.81).contains(x)));
    }
});
