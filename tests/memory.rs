//! The encoder's memory does not follow the number of photographs.
#![cfg(all(feature = "encode", target_os = "linux"))]

use serde_json::json;
use std::fs;
use std::path::Path;
use tsuya::capture::{self, CaptureReadOptions};
use tsuya::{EncodeOptions, EncodeTarget, Profile, encode};

const WIDTH: u32 = 640;
const HEIGHT: u32 = 480;

/// A small octahedron in the middle of large photographs on a ring, as a folder.
fn write_capture(folder: &Path, views: usize) {
    let mesh = "v .1 0 0\nv -.1 0 0\nv 0 .1 0\nv 0 -.1 0\nv 0 0 .1\nv 0 0 -.1\n\
                f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n";
    fs::write(folder.join("mesh.obj"), mesh).unwrap();
    let middle = |x: u32, y: u32| x.abs_diff(WIDTH / 2).pow(2) + y.abs_diff(HEIGHT / 2).pow(2) < 12 * 12;
    let mask = image::GrayImage::from_fn(WIDTH, HEIGHT, |x, y| image::Luma([255 * u8::from(middle(x, y))]));
    mask.save(folder.join("mask.png")).unwrap();
    image::RgbImage::from_fn(WIDTH, HEIGHT, |x, y| image::Rgb([x as u8, y as u8, 90]))
        .save(folder.join("0.png"))
        .unwrap();
    let frames = (0..views).map(|k| {
        if k > 0 {
            fs::copy(folder.join("0.png"), folder.join(format!("{k}.png"))).unwrap();
        }
        let (sin, cos) = (k as f64 * std::f64::consts::TAU / views as f64).sin_cos();
        let pose =
            [[cos, 0.0, sin, 4.0 * sin], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 4.0 * cos], [0.0, 0.0, 0.0, 1.0]];
        json!({"file_path": format!("{k}.png"), "mask_path": "mask.png", "transform_matrix": pose})
    });
    let frames: Vec<_> = frames.collect();
    let description = json!({"w": WIDTH, "h": HEIGHT, "fl_x": 500.0, "mesh_file": "mesh.obj", "frames": frames});
    fs::write(folder.join("transforms.json"), description.to_string()).unwrap();
}

/// The most memory that this process had so far, in bytes.
fn peak_bytes() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    1024 * line.trim().trim_end_matches(" kB").parse::<u64>().unwrap()
}

#[test]
fn four_times_the_photographs_take_no_more_memory() {
    let peak = |views: usize| {
        let folder = tempfile::tempdir().unwrap();
        write_capture(folder.path(), views);
        for (profile, target) in [
            (Profile::Predictive, EncodeTarget::Quality(75.0)),
            (Profile::WaveletTexture, EncodeTarget::KeepPercent(5.0)),
        ] {
            let opened = capture::open(folder.path(), &CaptureReadOptions::default()).unwrap();
            assert_eq!(opened.views().len(), views);
            let options = EncodeOptions { profile, target: Some(target), ..EncodeOptions::default() };
            assert!(encode(opened, &options).unwrap().reader_memory.is_some(), "checked view by view");
        }
        peak_bytes()
    };
    let growth = [12, 48].map(peak);
    let pixels = u64::from(WIDTH * HEIGHT);
    // 36 photographs more, which were once held twice, with what the mesh covers in each. A few more are held that others are predicted from.
    assert!(growth[1] - growth[0] < 18 * 12 * pixels, "{growth:?} bytes");
}
