//! Any bytes as a mesh file of the kind that the first byte says, cleaned and coded.

use tsuya::mesh;
use tsuya_fuzz::{folder, values};

pub fn fuzz(bytes: &[u8]) {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let extension = mesh::EXTENSIONS[kind as usize % mesh::EXTENSIONS.len()];
    let path = folder::file(&format!("mesh.{extension}"), bytes);
    let coordinates = mesh::texture_coordinates(&path, &folder::access());
    let Ok(mesh) = mesh::read(&path, &folder::access()) else { return };
    assert!(mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.positions.len()));
    assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
    if let Ok(coordinates) = coordinates {
        assert!(coordinates.is_empty() || coordinates.len() == mesh.triangles.len());
    }
    let (mesh, _) = mesh::clean(mesh);
    if !mesh.triangles.is_empty()
        && mesh.triangles.len() < 1000
        && let Ok(coded) = mesh::encode(&mesh, &mesh::MeshOptions { position_bits: 12 })
    {
        assert!(mesh::decode(&coded.bytes, &values::budget()).expect("our own mesh") == coded.mesh);
    }
}
