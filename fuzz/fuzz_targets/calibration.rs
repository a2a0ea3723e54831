//! Any bytes as a camera's calibration, as a rig of markers, and as a marker's pattern.

use tsuya::capture;
use tsuya::marker::{MarkerPattern, Rig};
use tsuya_fuzz::folder;

pub fn fuzz(bytes: &[u8]) {
    let path = folder::file("calibration.yaml", bytes);
    if let Ok(calibration) = capture::read_calibration(&path, &folder::access()) {
        let camera = &calibration.camera;
        assert!(camera.width > 0 && camera.height > 0);
        assert!(camera.focal.iter().all(|f| f.is_finite() && *f > 0.0));
        assert!(camera.principal.iter().all(|x| x.is_finite()));
    }
    if let Ok(rig) = Rig::read(&path, &folder::access()) {
        assert!(!rig.families().is_empty());
        let _ = rig.describe();
    }
    if let Ok(mut pattern) = MarkerPattern::read(&path, &folder::access()) {
        assert!((16..=64).contains(&pattern.side()));
        pattern.set_border(0.2).expect("a width");
    }
    // Those of ARToolKit name files of their own.
    if let Ok(text) = std::str::from_utf8(bytes)
        && !text.to_ascii_lowercase().contains("artoolkit")
    {
        let _ = Rig::parse(text, &folder::access());
    }
}
