//! Any bytes as section `mATl`.
#![no_main]
use libfuzzer_sys::fuzz_target;
use tsuya::brdf::{self, Brdf};
use tsuya::{Budget, Limits};

fuzz_target!(|bytes: &[u8]| {
    let budget = Budget::new(Limits { memory_bytes: 1 << 24, ..Limits::default() });
    if let Ok(all) = brdf::decode_materials(bytes, &budget) {
        for named in &all {
            let value = named.material.evaluate([0.6, 0.0, 0.8], [-0.28, 0.0, 0.96]);
            assert!(value.iter().all(|v| !v.is_nan() && *v >= 0.0));
        }
        // What decodes can be written, and comes back. The bytes may be others: fuzzing gets past wrong ends of streams.
        let again = brdf::encode_materials(&all).expect("materials that were read");
        assert!(brdf::decode_materials(&again, &budget).expect("our own materials") == all);
    }
});
