//! Any bytes as a mesh file of the kind that the first byte says, cleaned and coded.
#![no_main]
use libfuzzer_sys::fuzz_target;
use tsuya::mesh::{clean, codec, read};
use tsuya_fuzz::{folder, values};

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let extension = read::EXTENSIONS[kind as usize % read::EXTENSIONS.len()];
    let path = folder::file(&format!("mesh.{extension}"), bytes);
    let coordinates = read::texture_coordinates(&path, &folder::access());
    let Ok(mesh) = read::read(&path, &folder::access()) else { return };
    assert!(mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.positions.len()));
    assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
    if let Ok(coordinates) = coordinates {
        assert!(coordinates.is_empty() || coordinates.len() == mesh.triangles.len());
    }
    let (mesh, _) = clean::clean(mesh);
    if !mesh.triangles.is_empty()
        && mesh.triangles.len() < 1000
        && let Ok(coded) = codec::encode(&mesh, &codec::MeshOptions { position_bits: 12 })
    {
        assert!(codec::decode(&coded.bytes, &values::budget()).expect("our own mesh") == coded.mesh);
    }
});
