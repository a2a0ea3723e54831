//! A folder with what `tsuya ar` takes.

use super::markers::{TAG36H11_0, camera, draw, posed};
use super::support::{encoded_sample, output, text};
use tsuya::capture::Lens;

/// The sample's file with visibility, an even sky, a calibration for 640 x 480 and frames of a marker that moves, in a folder.
pub fn stage() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("plain.tsuya"), &encoded_sample().bytes).unwrap();
    output(&["bake", text(&at("plain.tsuya")), "-o", text(&at("asset.tsuya")), "--resolution", "12"]);
    let sky = r#"{"w": 640, "h": 480, "fl_x": 600, "camera_model": "PINHOLE"}"#;
    std::fs::write(at("camera.json"), sky).unwrap();
    let environment = image::RgbImage::from_fn(64, 32, |x, y| {
        if y < 16 { image::Rgb([200, 210, if x < 20 { 255 } else { 220 }]) } else { image::Rgb([120, 110, 100]) }
    });
    environment.save(at("sky.png")).unwrap();
    std::fs::create_dir(at("skies")).unwrap();
    std::fs::create_dir(at("frames")).unwrap();
    for frame in 0..4u32 {
        let pose = posed([-50.0, 3.0 * frame as f64, 0.0], [0.0, 0.02, 0.6 + 0.01 * frame as f64]);
        let drawn = draw(&camera(640, 480, 600.0), &Lens::Pinhole, &TAG36H11_0, &pose, frame);
        image::GrayImage::from_raw(640, 480, drawn.data).unwrap().save(at(&format!("frames/{frame}.png"))).unwrap();
        environment.save(at(&format!("skies/{frame}.png"))).unwrap();
    }
    folder
}
