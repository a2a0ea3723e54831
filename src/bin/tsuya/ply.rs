//! Meshes as binary PLY files.

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
    for coordinate in mesh.positions.iter().flatten() {
        bytes.extend_from_slice(&coordinate.to_le_bytes());
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        triangle.iter().for_each(|corner| bytes.extend_from_slice(&corner.to_le_bytes()));
    }
    bytes
}
