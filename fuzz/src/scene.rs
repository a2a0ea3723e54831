//! A small object, its cameras and its photographs, for sections that need them and for seeds.

use tsuya::Mesh;
use tsuya::{Camera, Component, Photograph, PointLight, View};
use tsuya::{Chart, Charts};
use tsuya::{image::RgbImage, internals};

/// White board of the scene.
pub const WHITE: [f64; 3] = [1.0, 0.9, 0.8];

/// An octahedron.
pub fn mesh() -> Mesh {
    Mesh {
        positions: vec![[1., 0., 0.], [-1., 0., 0.], [0., 1., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]],
        triangles: vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    }
}

/// A bumpy sphere: the octahedron, each triangle cut into four `times` times.
pub fn sphere(times: usize) -> Mesh {
    let mut mesh = mesh();
    for _ in 0..times {
        let mut middles = std::collections::HashMap::new();
        let mut cut = Vec::new();
        for [a, b, c] in std::mem::take(&mut mesh.triangles) {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to)| {
                *middles.entry((from.min(to), from.max(to))).or_insert_with(|| {
                    let [p, q] = [from, to].map(|vertex| mesh.positions[vertex as usize]);
                    let sum: [f32; 3] = std::array::from_fn(|k| p[k] + q[k]);
                    let length = sum.iter().map(|x| x * x).sum::<f32>().sqrt();
                    mesh.positions.push(sum.map(|x| x / length));
                    mesh.positions.len() as u32 - 1
                })
            });
            cut.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        mesh.triangles = cut;
    }
    for [x, y, z] in &mut mesh.positions {
        let scale = 1.0 + 0.1 * (5.0 * *x).sin() * (4.0 * *y).cos();
        [*x, *y, *z] = [*x * scale, *y * scale, *z * scale];
    }
    mesh
}

/// Cameras on a ring, each with a light beside it.
pub fn views(count: usize, width: u32, height: u32) -> Vec<View> {
    views_of(&vec![(width, height); count])
}

/// The same with photographs of the given sizes.
pub fn views_of(sizes: &[(u32, u32)]) -> Vec<View> {
    let view = |(i, &(width, height)): (usize, &(u32, u32))| {
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
    };
    sizes.iter().enumerate().map(view).collect()
}

/// Sizes of three photographs: all alike, or each another.
pub fn sizes(mixed: bool) -> [(u32, u32); 3] {
    if mixed { [(32, 32), (40, 33), (21, 30)] } else { [(32, 32); 3] }
}

/// Photographs of a mesh: a texture that the views share, light from each camera, a highlight in the specular component, and masks that
/// are what the mesh covers but for some pixels where `odd`.
pub fn photographs(mesh: &Mesh, views: &[View], components: &[Component], odd: bool) -> Vec<Photograph> {
    let normals = internals::surface::vertex_normals(mesh);
    let take = |(index, view): (usize, &View)| {
        let raster = internals::surface::rasterise(mesh, &view.camera);
        let mut mask = raster.coverage();
        for (at, inside) in mask.data.iter_mut().enumerate() {
            *inside ^= odd && (at * 7 + index * 3) % 61 < 4;
        }
        let radiance = |component: Component, at: usize| -> [f32; 3] {
            if !raster.is_covered(at) {
                return [0.02 * (at % 5) as f32; 3];
            }
            let corners = mesh.triangles[raster.triangle[at] as usize].map(|vertex| vertex as usize);
            let [b, c] = raster.barycentric[at].map(f64::from);
            let weights = [1.0 - b - c, b, c];
            let blend = |of: &dyn Fn(usize) -> [f64; 3]| -> [f64; 3] {
                std::array::from_fn(|k| (0..3).map(|n| weights[n] * of(corners[n])[k]).sum())
            };
            let place = blend(&|vertex| mesh.positions[vertex].map(f64::from));
            let normal = blend(&|vertex| normals[vertex]);
            let centre = view.camera.centre();
            let towards: [f64; 3] = std::array::from_fn(|k| centre[k] - place[k]);
            let length = towards.iter().map(|x| x * x).sum::<f64>().sqrt();
            let cosine = (0..3).map(|k| normal[k] * towards[k] / length).sum::<f64>().max(0.0);
            let texture = |k: usize| 0.5 + 0.4 * (9.0 * place[k] + 5.0 * place[(k + 1) % 3]).sin();
            let highlight = 0.8 * cosine.powi(40);
            std::array::from_fn(|k| match component {
                Component::Diffuse => (texture(k) * cosine) as f32,
                Component::Specular => (highlight - 0.01 * (at % 3) as f64) as f32,
                Component::Combined => (texture(k) * cosine + highlight) as f32,
            })
        };
        let image = |&component: &Component| RgbImage {
            width: mask.width,
            height: mask.height,
            data: (0..mask.data.len()).map(|at| radiance(component, at)).collect(),
        };
        let images = components.iter().map(image).collect();
        Photograph { mask, images }
    };
    views.iter().enumerate().map(take).collect()
}

/// The components of a capture with polarisers, or of one without.
pub fn components(polarised: bool) -> &'static [Component] {
    if polarised { &[Component::Diffuse, Component::Specular] } else { &[Component::Combined] }
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
