//! Any bytes as a GLB or glTF document: read, looked at, edited, written.

use tsuya::gltf::{self, GltfDocument, MaterialBinding};
use tsuya::{Budget, Error, Limits};
use tsuya_fuzz::scene;

pub fn fuzz(bytes: &[u8]) {
    let small = || Limits { memory_bytes: 1 << 26, ..Limits::default() };
    let budget = || Budget::new(small());
    let Ok(mut document) = GltfDocument::parse("-", bytes, &budget()) else { return };
    let files = |name: &str| Err(Error::parameter(name));
    let taken = gltf::extract(&document, 0, &files);
    let binding = taken.map_or_else(|_| MaterialBinding::default(), |taken| taken.binding);
    let _ = gltf::document_materials(&document, &files, &tsuya::input::FileAccess::new(small()));
    let _ = gltf::compare_mesh(&document, &[0], &binding, &scene::mesh(), &scene::charts(), &files, &budget());
    let material = gltf::find_material(&document, "", None).unwrap_or(0);
    if let Ok((index, _)) = gltf::inject(&mut document, material, b"another stream", vec![3, 14], None) {
        let written = document.to_bytes().unwrap();
        let again = GltfDocument::parse("-", &written, &Budget::new(Limits::default())).unwrap();
        assert_eq!(gltf::extract(&again, index, &files).unwrap().stream, b"another stream");
    }
    let _ = gltf::strip(&mut document);
    document.to_bytes().unwrap();
}
