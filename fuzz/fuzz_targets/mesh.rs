//! Any bytes as a mesh section.

use tsuya::{Budget, Limits, mesh};

pub fn fuzz(bytes: &[u8]) {
    let limits = Limits { memory_bytes: 1 << 24, mesh_elements: 1 << 14, ..Limits::default() };
    if let Ok(mesh) = mesh::decode(bytes, &Budget::new(limits)) {
        assert!(mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.positions.len()));
        assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
    }
}
