//! Any bytes as section `lIGt`.

use tsuya::{Budget, Limits, lighting};

pub fn fuzz(bytes: &[u8]) {
    let budget = Budget::new(Limits { memory_bytes: 1 << 24, ..Limits::default() });
    if let Ok(light) = lighting::decode(bytes, &budget) {
        for level in &light.prefiltered {
            assert!(level.cells().iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
        }
        for sharpness in [0.1, 40.0, 1e5] {
            assert!(light.prefiltered_radiance([0.48, -0.6, 0.64], sharpness).iter().all(|x| x.is_finite()));
        }
    }
}
