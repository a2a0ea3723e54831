//! Any bytes as the cameras of Metashape, RealityCapture (table or sidecar), Meshroom or OpenMVG: the first byte says which.

use tsuya::capture::{CaptureReadOptions, describe, read};
use tsuya_fuzz::folder;

const NAMES: [&str; 5] = ["cameras.xml", "cameras.csv", "a.xmp", "cameras.sfm", "sfm_data.json"];

pub fn fuzz(bytes: &[u8]) {
    let Some((&kind, content)) = bytes.split_first() else { return };
    let path = folder::file(NAMES[kind as usize % NAMES.len()], content);
    if let Ok(description) = describe(&path, &folder::access())
        && description.frames.len() <= 16
    {
        let _ = read(&path, &CaptureReadOptions { limits: folder::limits(), ..CaptureReadOptions::default() });
    }
    let _ = std::fs::remove_file(path);
}
