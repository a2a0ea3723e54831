//! Any bytes as a section of views.

use tsuya::internals;
use tsuya::{Budget, Limits};

pub fn fuzz(bytes: &[u8]) {
    let limits = Limits { memory_bytes: 1 << 22, views: 256, image_side: 1024, ..Limits::default() };
    if let Ok(section) = internals::views::decode(bytes, &Budget::new(limits)) {
        for view in &section.views {
            let camera = &view.camera;
            assert!(camera.rotation.iter().flatten().chain(&camera.translation).all(|x| x.is_finite()));
            assert!(camera.width <= 1024 && camera.height <= 1024);
        }
    }
}
