//! Small pictures, and a capture's files without what describes them.

use crate::{folder, scene};
use std::fmt::Write;

/// Sizes of the photographs in the folder.
pub const SIDE: u32 = 8;

/// A grey picture in the plain form of NetPBM's cousin that needs no library: an uncompressed TIFF of 8 bits.
pub fn tiff(width: u32, height: u32, grey: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    let entries: [(u16, u16, u32, u32); 8] = [
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 1, 8),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1, 8 + 2 + 8 * 12 + 4),
        (278, 4, 1, height),
        (279, 4, 1, width * height),
    ];
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_le_bytes().into_iter().chain(kind.to_le_bytes()));
        bytes.extend(count.to_le_bytes().into_iter().chain(value.to_le_bytes()));
    }
    bytes.extend([0; 4]);
    bytes.extend((0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| grey(x, y)));
    bytes
}

/// The scene's mesh as PLY.
pub fn ply() -> String {
    let mesh = scene::mesh();
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {triangles}\nproperty list uchar int vertex_indices\nend_header\n"
    );
    for [x, y, z] in mesh.positions {
        let _ = writeln!(text, "{x} {y} {z}");
    }
    for [a, b, c] in mesh.triangles {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    text
}

/// Puts photographs, a mask and a mesh into the folder of this process.
pub fn put_capture() {
    folder::file("m.ply", ply().as_bytes());
    folder::file("a.tif", &tiff(SIDE, SIDE, |x, y| (20 * x + 10 * y) as u8));
    folder::file("b.tif", &tiff(SIDE, SIDE, |x, y| (10 * x + 10 * y) as u8));
    folder::file("mask.tif", &tiff(SIDE, SIDE, |x, y| if x + y > 4 { 255 } else { 0 }));
}
