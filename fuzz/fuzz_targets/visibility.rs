//! Any bytes as section `vISB` of an octahedron.

use tsuya::{Budget, Limits, internals};
use tsuya_fuzz::scene;

pub fn fuzz(bytes: &[u8]) {
    let budget = Budget::new(Limits { memory_bytes: 1 << 24, ..Limits::default() });
    if let Ok(visibility) = internals::visibility::decode(bytes, &scene::mesh(), &budget) {
        assert_eq!(visibility.places().vertices(), 6);
        for place in 0..=visibility.places().count() {
            assert!(visibility.signed_distance(place, [0.48, -0.6, 0.64]).abs() <= 3.15);
        }
    }
}
