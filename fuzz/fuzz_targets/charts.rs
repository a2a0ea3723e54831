//! Any bytes as section `CHRT` of a small object, and the atlas that they lay out.

use tsuya::internals;
use tsuya::{Budget, Limits};
use tsuya_fuzz::scene;

pub fn fuzz(bytes: &[u8]) {
    let limits = Limits { memory_bytes: 1 << 22, image_side: 512, ..Limits::default() };
    let (mesh, budget) = (scene::mesh(), Budget::new(limits));
    if let Ok(charts) = internals::surface::charts::decode(bytes, &mesh, &budget) {
        let _ = internals::surface::atlas::rasterise_atlas_within(&mesh, &charts, &budget);
    }
}
