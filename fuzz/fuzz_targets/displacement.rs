//! Any bytes as section `DISP` of a small object with an atlas.

use tsuya::internals;
use tsuya::{Budget, Limits};
use tsuya_fuzz::scene;

pub fn fuzz(bytes: &[u8]) {
    let (mesh, budget) = (scene::mesh(), Budget::new(Limits { memory_bytes: 1 << 23, ..Limits::default() }));
    if let Ok(surface) = internals::surface::displacement::decode(bytes, &mesh, &scene::charts(), &budget) {
        assert!(surface.mesh().positions.iter().flatten().all(|x| x.is_finite()));
        assert_eq!(surface.mesh().positions.len(), surface.normals().len());
    }
}
