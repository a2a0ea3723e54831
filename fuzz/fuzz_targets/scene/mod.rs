//! A small object and its cameras, for sections that need a mesh.
#![allow(dead_code)]
use tsuya::asset::{Camera, Chart, Charts, Mesh, PointLight, View};

/// An octahedron.
pub fn mesh() -> Mesh {
    Mesh {
        positions: vec![[1., 0., 0.], [-1., 0., 0.], [0., 1., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]],
        triangles: vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    }
}

/// Cameras on a ring, each with a light beside it.
pub fn views(count: usize, width: u32, height: u32) -> Vec<View> {
    (0..count)
        .map(|i| {
            let (sin, cos) = (i as f64 * 0.4).sin_cos();
            let camera = Camera {
                width,
                height,
                focal: [width as f64 * 1.3; 2],
                principal: [width as f64 * 0.5, height as f64 * 0.5],
                rotation: [[cos, 0.0, -sin], [0.0, -1.0, 0.0], [-sin, 0.0, -cos]],
                translation: [0.0, 0.0, 4.0],
            };
            let light = Some(PointLight { position: [4.0 * sin, 1.0, 4.0 * cos], intensity: [50.0; 3] });
            View { name: format!("{i:03}"), camera, light }
        })
        .collect()
}

/// The front of the octahedron and its back beside it.
pub fn charts() -> Charts {
    let chart = |facing, x| Chart { facing, offset: [x, 10] };
    Charts {
        width: 40,
        height: 20,
        texels_per_unit: 8.0,
        charts: vec![chart(4, 10), chart(5, 30)],
        chart_of_triangle: vec![0, 0, 0, 0, 1, 1, 1, 1],
    }
}
