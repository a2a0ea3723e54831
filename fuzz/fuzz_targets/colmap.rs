//! Any bytes as a COLMAP model, binary or text: the first byte says which, the next two how long the file of cameras is.

use tsuya::capture::{CaptureReadOptions, describe, read};
use tsuya_fuzz::folder;

pub fn fuzz(bytes: &[u8]) {
    let Some((&[kind, low, high], rest)) = bytes.split_first_chunk::<3>() else { return };
    let (cameras, images) = rest.split_at(rest.len().min(u16::from_le_bytes([low, high]) as usize));
    let kinds = ["txt", "bin"];
    for (index, extension) in kinds.into_iter().enumerate() {
        for (name, content) in [("cameras", cameras), ("images", images)] {
            let path = folder::path().join(format!("{name}.{extension}"));
            if index == kind as usize % 2 {
                std::fs::write(&path, content).expect("room for a temporary file");
            } else {
                let _ = std::fs::remove_file(&path);
            }
        }
    }
    if let Ok(description) = describe(folder::path(), &folder::access())
        && description.frames.len() <= 16
    {
        let _ = read(folder::path(), &CaptureReadOptions { limits: folder::limits(), ..CaptureReadOptions::default() });
    }
}
