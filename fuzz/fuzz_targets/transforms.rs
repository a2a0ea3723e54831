//! Any bytes as a capture's `transforms.json`, beside photographs, a mask and a mesh; what can be read is read.

use tsuya::capture::{CaptureReadOptions, describe, read};
use tsuya_fuzz::folder;

pub fn fuzz(bytes: &[u8]) {
    let path = folder::file("transforms.json", bytes);
    if let Ok(description) = describe(&path, &folder::access()) {
        assert!(description.frames.iter().all(|frame| {
            let camera = &frame.view.camera;
            camera.rotation.iter().flatten().chain(&camera.translation).all(|x| x.is_finite())
        }));
        if description.frames.len() <= 16
            && let Ok(capture) =
                read(&path, &CaptureReadOptions { limits: folder::limits(), ..CaptureReadOptions::default() })
        {
            assert!(!capture.frames.is_empty() && !capture.mesh.triangles.is_empty());
        }
    }
}
