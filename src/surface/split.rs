//! The mesh as renderers want it: one vertex for each corner that differs, with normal, tangent and texture coordinate.

use super::atlas::atlas_position;
use super::charts::Charts;
use super::displacement::DisplacedMesh;
use super::raster::vertex_normals;
use crate::mesh::Mesh;
use crate::vector::{cross, dot};
use glam::DVec3;
use std::collections::HashMap;

/// Vertices in the order in which the triangles name them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RenderMesh {
    /// Positions in the world of the mesh.
    pub positions: Vec<[f32; 3]>,
    /// Smooth unit normals.
    pub normals: Vec<[f32; 3]>,
    /// Direction of growing u, and the sign with which normal x tangent is the direction up in the picture.
    pub tangents: Vec<[f32; 4]>,
    /// Atlas coordinates, 0 to 1, v downwards.
    pub coordinates: Vec<[f32; 2]>,
    /// For each vertex its number in the mesh; of a finer surface, that of the nearest vertex of its triangle.
    pub sources: Vec<u32>,
    /// Of a finer surface for each vertex the three of the mesh that it lies between, and their shares of it; otherwise empty.
    pub between: Vec<([u32; 3], [f32; 3])>,
    /// Triangles of these vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl RenderMesh {
    /// Returns the vertices of a mesh without an atlas, with smooth normals.
    pub fn without_atlas(mesh: &Mesh) -> Self {
        RenderMesh {
            positions: mesh.positions.clone(),
            normals: vertex_normals(mesh)
                .iter()
                .map(|normal| unit_or(*normal, || [0.0; 3]).map(|x| x as f32))
                .collect(),
            tangents: Vec::new(),
            coordinates: Vec::new(),
            sources: (0..mesh.positions.len() as u32).collect(),
            between: Vec::new(),
            triangles: mesh.triangles.clone(),
        }
    }

    /// Returns the vertices of a mesh with an atlas, split where charts meet.
    pub fn with_atlas(mesh: &Mesh, charts: &Charts) -> Self {
        let smooth = vertex_normals(mesh);
        let mut geometry = RenderMesh::default();
        let mut number: HashMap<(u32, u32), u32> = HashMap::new();
        let size = [charts.width as f64, charts.height as f64];
        for (index, corners) in mesh.triangles.iter().enumerate() {
            let chart = charts.chart_of_triangle[index];
            let facing = charts.charts[chart as usize].facing;
            let at = charts.corners(mesh, index);
            let triangle = std::array::from_fn(|k| {
                let vertex = corners[k];
                *number.entry((vertex, chart)).or_insert_with(|| {
                    let normal = unit_or(smooth[vertex as usize], || face_normal(mesh, corners));
                    geometry.positions.push(mesh.positions[vertex as usize]);
                    geometry.normals.push(normal.map(|x| x as f32));
                    geometry.tangents.push(tangent(normal, facing));
                    geometry.sources.push(vertex);
                    geometry.coordinates.push(std::array::from_fn(|c| (at[k][c] / size[c]).clamp(0.0, 1.0) as f32));
                    geometry.positions.len() as u32 - 1
                })
            });
            geometry.triangles.push(triangle);
        }
        geometry
    }

    /// Returns the vertices of a mesh's finer surface with the mesh's atlas, split where charts meet. Normals are those of the surface; a
    /// place of it has the atlas position of the same place on the mesh. `None` if the surface is that of another mesh.
    pub fn of_surface(mesh: &Mesh, charts: &Charts, surface: &DisplacedMesh) -> Option<Self> {
        if !surface.is_of(mesh) {
            return None;
        }
        let fine = surface.mesh();
        let mut geometry = RenderMesh::default();
        let mut number: HashMap<(u32, u32), u32> = HashMap::new();
        let size = [charts.width as f64, charts.height as f64];
        for (index, corners) in fine.triangles.iter().enumerate() {
            let triangle = std::array::from_fn(|k| {
                let weights = std::array::from_fn(|corner| if corner == k { 1.0 } else { 0.0 });
                let (base, weights) = surface.coarser(index, weights);
                let (chart, ends) = (charts.chart_of_triangle[base], mesh.triangles[base]);
                let vertex = corners[k];
                *number.entry((vertex, chart)).or_insert_with(|| {
                    let ends_at = ends.map(|end| DVec3::from_array(mesh.positions[end as usize].map(f64::from)));
                    let place: DVec3 = ends_at.into_iter().zip(weights).map(|(end, weight)| weight * end).sum();
                    let at = atlas_position(charts, base, place);
                    let normal = unit_or(surface.normals()[vertex as usize], || face_normal(fine, corners));
                    let nearest = (0..3).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or(0);
                    geometry.positions.push(fine.positions[vertex as usize]);
                    geometry.normals.push(normal.map(|x| x as f32));
                    geometry.tangents.push(tangent(normal, charts.charts[chart as usize].facing));
                    geometry.sources.push(ends[nearest]);
                    geometry.between.push((ends, weights.map(|weight| weight as f32)));
                    geometry.coordinates.push(std::array::from_fn(|c| (at[c] / size[c]).clamp(0.0, 1.0) as f32));
                    geometry.positions.len() as u32 - 1
                })
            });
            geometry.triangles.push(triangle);
        }
        Some(geometry)
    }
}

fn face_normal(mesh: &Mesh, corners: &[u32; 3]) -> [f64; 3] {
    let [a, b, c] = corners.map(|v| mesh.positions[v as usize].map(f64::from));
    cross([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]])
}

/// The vector at unit length; where it has none, of another one; up where neither has.
fn unit_or(v: [f64; 3], other: impl FnOnce() -> [f64; 3]) -> [f64; 3] {
    let unit = |v: [f64; 3]| {
        let length = dot(v, v).sqrt();
        (length > 1e-12).then(|| v.map(|x| x / length))
    };
    unit(v).or_else(|| unit(other())).unwrap_or([0.0, 0.0, 1.0])
}

/// The chart's u direction in the tangent plane. Charts are never mirrored: u x v is outward, and v goes down in the picture.
fn tangent(normal: [f64; 3], facing: u8) -> [f32; 4] {
    let axis = [1, 2, 0][(facing / 2).min(2) as usize];
    let sign = if facing.is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut along = [0.0; 3];
    along[axis] = sign;
    let lift = dot(along, normal);
    let flat: [f64; 3] = std::array::from_fn(|k| along[k] - lift * normal[k]);
    let least = (0..3).min_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())).unwrap_or(0);
    let mut any = [0.0; 3];
    any[least] = 1.0;
    let [x, y, z] = unit_or(flat, || cross(normal, any)).map(|x| x as f32);
    [x, y, z, -1.0]
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::surface::atlas::layout;
    use crate::surface::atlas::tests::bumpy_sphere;

    #[test]
    fn a_surface_has_the_meshs_atlas() {
        let mesh = bumpy_sphere(8);
        let charts = layout(&mesh, 12.0).unwrap();
        let surface = DisplacedMesh::new(&mesh, 2, |_, _, place| 0.02 * place[0]).unwrap();
        let [coarse, fine] =
            [RenderMesh::with_atlas(&mesh, &charts), RenderMesh::of_surface(&mesh, &charts, &surface).unwrap()];
        assert_eq!(fine.triangles.len(), 16 * coarse.triangles.len());
        for (index, triangle) in fine.triangles.iter().enumerate() {
            for vertex in triangle.map(|vertex| vertex as usize) {
                let (ends, weights) = fine.between[vertex];
                assert!(ends.contains(&fine.sources[vertex]) && (weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                let corners = coarse.triangles[index / 16];
                let end = |k: usize| corners.into_iter().find(|&c| coarse.sources[c as usize] == ends[k]);
                // Of a vertex on an edge the triangle on the other side may have been met first.
                let Some(ends) = [end(0), end(1), end(2)].into_iter().collect::<Option<Vec<u32>>>() else { continue };
                for axis in 0..2 {
                    let at: f32 = (0..3).map(|k| weights[k] * coarse.coordinates[ends[k] as usize][axis]).sum();
                    assert!((at - fine.coordinates[vertex][axis]).abs() < 1e-6);
                }
            }
        }
        assert_eq!(RenderMesh::of_surface(&bumpy_sphere(6), &charts, &surface), None);
    }
}
