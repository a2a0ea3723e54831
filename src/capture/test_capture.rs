//! Captures that the tests read.

use super::*;
use std::fs;

pub(super) fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sample-spot")
}

/// A small capture in a folder of its own: three frames of 16 x 12 pixels, a triangle in view.
pub(super) struct Small {
    pub(super) folder: tempfile::TempDir,
    pub(super) keys: String,
    pub(super) frames: Vec<String>,
}

pub(super) const POSE: &str = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]";

impl Small {
    pub(super) fn new(crossed: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let small = Small { keys: String::new(), frames: Vec::new(), folder };
        fs::write(small.path("mesh.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let mut small = small;
        for index in 0..3 {
            let name = format!("{index}.exr");
            small.picture(&name, |x, y| (x as f32, y as f32, index as f32));
            let mut frame = format!("\"file_path\": \"{name}\", \"transform_matrix\": {POSE}");
            if crossed {
                small.picture(&format!("c{name}"), |x, _| (0.4 * x as f32, 0.0, 0.1));
                frame += &format!(", \"cross_file_path\": \"c{name}\"");
            }
            small.frames.push(frame);
        }
        if crossed {
            small.picture("white.exr", |_, _| (2.0, 2.0, 4.0));
            small.picture("white_cross.exr", |_, _| (1.0, 0.8, 1.0));
            small.keys =
                ", \"white_reference\": {\"file_path\": \"white.exr\", \"cross_file_path\": \"white_cross.exr\"}"
                    .into();
        }
        small
    }
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
    pub(super) fn picture(&self, name: &str, pixel: impl Fn(usize, usize) -> (f32, f32, f32) + Sync) {
        exr::prelude::write_rgb_file(self.path(name), 16, 12, pixel).unwrap();
    }
    pub(super) fn mask(&self, name: &str, width: u32, height: u32, lit: bool) {
        image::GrayImage::from_pixel(width, height, image::Luma([lit as u8 * 255])).save(self.path(name)).unwrap();
    }
    /// Reads it as it is: its masks are not its mesh's.
    pub(super) fn read(&self, options: &CaptureReadOptions) -> Result<Capture> {
        let options = &CaptureReadOptions { unchecked: true, ..options.clone() };
        let frames: Vec<_> = self.frames.iter().map(|frame| format!("{{{frame}}}")).collect();
        let frames = frames.join(",\n");
        let text = format!("{{\"w\": 16, \"h\": 12, \"fl_x\": 20{}, \"frames\": [\n{frames}]}}", self.keys);
        fs::write(self.path("transforms.json"), text).unwrap();
        read(self.folder.path(), options)
    }
    pub(super) fn error(&self) -> String {
        self.read(&CaptureReadOptions::default()).unwrap_err().to_string()
    }
}
