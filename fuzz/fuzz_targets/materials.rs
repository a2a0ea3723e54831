//! Any bytes as section `mATl`, and as section `bIND` of a file of some materials.

use tsuya::brdf::{self, Brdf, ClassicalLobe, ClassicalModel, FittedMaterial, NamedMaterial};
use tsuya::{Budget, Limits};

/// Triangles of a mesh whose materials the bytes may be.
const TRIANGLES: usize = 500;

pub fn fuzz(bytes: &[u8]) {
    let budget = Budget::new(Limits { memory_bytes: 1 << 24, ..Limits::default() });
    let model = ClassicalModel { diffuse: [0.5; 3], specular: [0.0; 3], lobe: ClassicalLobe::Lambert };
    let named = |name: &str| NamedMaterial { name: name.into(), material: FittedMaterial::Classical(model.clone()) };
    let held = ["a", "b", "lobes"].map(named);
    if let Ok(binding) = brdf::decode_binding(bytes, TRIANGLES, &held, &budget) {
        assert!(binding.counts().iter().sum::<usize>() <= TRIANGLES);
        let again = brdf::encode_binding(&binding).expect("a binding that was read");
        assert!(brdf::decode_binding(&again, TRIANGLES, &held, &budget).expect("our own binding") == binding);
    }
    if let Ok(all) = brdf::decode_materials(bytes, &budget) {
        for named in &all {
            let value = named.material.evaluate([0.6, 0.0, 0.8], [-0.28, 0.0, 0.96]);
            assert!(value.iter().all(|v| !v.is_nan() && *v >= 0.0));
        }
        // What decodes can be written, and comes back. The bytes may be others: fuzzing gets past wrong ends of streams.
        let again = brdf::encode_materials(&all).expect("materials that were read");
        assert!(brdf::decode_materials(&again, &budget).expect("our own materials") == all);
    }
}
