//! Meshes as binary PLY files.

use byteorder::{ByteOrder, LittleEndian};
use tsuya::Mesh;

/// The file: vertex positions as 32-bit floats, triangles as lists of 32-bit indices, little-endian.
pub fn write(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment written by tsuya\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    let positions = mesh.positions.as_flattened();
    let start = bytes.len();
    bytes.resize(start + size_of_val(positions), 0);
    LittleEndian::write_f32_into(positions, &mut bytes[start..]);
    for triangle in &mesh.triangles {
        let mut face = [3; 13];
        LittleEndian::write_u32_into(triangle, &mut face[1..]);
        bytes.extend_from_slice(&face);
    }
    bytes
}
