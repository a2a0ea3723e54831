//! The mesh as glTF wants it: one vertex for each corner that differs, with normal, tangent and texture coordinate.

use crate::asset::{Asset, Charts, Mesh};
use crate::error::{Error, Result};
use crate::surface::raster::vertex_normals;
use crate::vector::{cross, dot};
use std::collections::HashMap;

/// Vertices in the order in which the triangles name them.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Geometry {
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// Direction of growing u, and the sign with which normal x tangent is the direction up in the picture.
    pub tangents: Vec<[f32; 4]>,
    pub coordinates: Vec<[f32; 2]>,
    pub triangles: Vec<[u32; 3]>,
}

/// The charts of an asset with a mesh and an atlas that belong together.
pub(super) fn charts(asset: &Asset) -> Result<&Charts> {
    let mesh = &asset.mesh;
    let Some(charts) = asset.charts.as_ref().filter(|_| !mesh.triangles.is_empty()) else {
        let message =
            "the file has no mesh with an atlas (profile paper?), which a glTF mesh needs for texture coordinates";
        return Err(Error::Unsupported(message.into()));
    };
    let of_mesh = charts.chart_of_triangle.len() == mesh.triangles.len()
        && charts.chart_of_triangle.iter().all(|&chart| (chart as usize) < charts.charts.len())
        && mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.positions.len());
    if !of_mesh || charts.width == 0 || charts.height == 0 {
        return Err(Error::parameter("mesh and charts do not belong together"));
    }
    Ok(charts)
}

/// Splits the vertices where charts meet.
pub(super) fn split(mesh: &Mesh, charts: &Charts) -> Geometry {
    let smooth = vertex_normals(mesh);
    let mut geometry = Geometry::default();
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
                geometry.coordinates.push(std::array::from_fn(|c| (at[k][c] / size[c]).clamp(0.0, 1.0) as f32));
                geometry.positions.len() as u32 - 1
            })
        });
        geometry.triangles.push(triangle);
    }
    geometry
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
