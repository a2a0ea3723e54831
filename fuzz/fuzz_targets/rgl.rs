//! Any bytes as an RGL material.

use tsuya::brdf::{Brdf, RglMaterial};

pub fn fuzz(bytes: &[u8]) {
    if let Ok(material) = RglMaterial::from_bytes(bytes, "fuzz.bsdf") {
        let directions = [[0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, 0.0, 1.0], [-0.6, 0.0, 0.8], [0.0, -1.0, 1e-9]];
        for incoming in directions {
            for outgoing in directions {
                let value = material.evaluate(incoming, outgoing);
                assert!(value.iter().all(|x| !x.is_nan() && *x >= 0.0), "{value:?}");
            }
        }
    }
}
