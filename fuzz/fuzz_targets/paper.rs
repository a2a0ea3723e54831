//! Any bytes as section `PAPR` of a small object.

use tsuya::{Budget, Limits};
use tsuya::{Component, internals};
use tsuya_fuzz::scene;

pub fn fuzz(bytes: &[u8]) {
    let Some((&count, bytes)) = bytes.split_first() else { return };
    let components = [[Component::Diffuse, Component::Specular], [Component::Combined; 2]][count as usize % 2];
    let components = &components[..2 - count as usize % 2];
    let budget = Budget::new(Limits { memory_bytes: 1 << 25, ..Limits::default() });
    let (mesh, views) = (scene::mesh(), scene::views(1 + count as usize / 2 % 5, 8, 8));
    if let Ok(decoded) = internals::wavelet_texture::decode(bytes, &mesh, components, views.len(), &budget) {
        let hit = |x: usize, y: usize| Some(((x + y) as u32 % 8, [0.25, 0.25, 0.5]));
        for (index, view) in views.iter().enumerate() {
            assert_eq!(decoded.photograph(index, view, hit).images.len(), components.len());
        }
    }
}
