//! Tangents of a mesh's corners from its texture coordinates. Specified in `spec/rendering.md`.

use crate::mesh::{CornerCoordinates, Mesh};
use glam::{DVec2, DVec3, Vec3};
use std::collections::HashMap;

/// Tangents of each triangle's corners, not of unit length between them; zero where the coordinates say none.
pub(super) fn corner_tangents(mesh: &Mesh, normals: &[Vec3], coordinates: &[CornerCoordinates]) -> Vec<[Vec3; 3]> {
    // Corners at one vertex with one coordinate, on one side of a mirrored picture, share a tangent.
    let key = |vertex: u32, [u, v]: [f32; 2], is_mirrored: bool| (vertex, u.to_bits(), v.to_bits(), is_mirrored);
    let mut shared: HashMap<(u32, u32, u32, bool), DVec3> = HashMap::new();
    let triangles = || mesh.triangles.iter().zip(coordinates);
    for (triangle, uv) in triangles() {
        let Some((along, is_mirrored)) = direction(mesh, triangle, uv) else { continue };
        let corners = triangle.map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
        for k in 0..3 {
            let normal = normals[triangle[k] as usize].as_dvec3();
            let flat = (along - normal * normal.dot(along)).normalize_or_zero();
            let (a, b) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
            let angle = a.normalize_or_zero().dot(b.normalize_or_zero()).clamp(-1.0, 1.0).acos();
            *shared.entry(key(triangle[k], uv[k], is_mirrored)).or_default() += angle * flat;
        }
    }
    let tangents = |(triangle, uv): (&[u32; 3], &CornerCoordinates)| {
        let is_mirrored = direction(mesh, triangle, uv).is_some_and(|(_, is_mirrored)| is_mirrored);
        std::array::from_fn(|k| {
            let sum = shared.get(&key(triangle[k], uv[k], is_mirrored)).copied().unwrap_or_default();
            sum.normalize_or_zero().as_vec3()
        })
    };
    triangles().map(tangents).collect()
}

/// The direction of growing `u` in a triangle, and whether its picture is mirrored; `None` where its coordinates have no area.
fn direction(mesh: &Mesh, triangle: &[u32; 3], uv: &CornerCoordinates) -> Option<(DVec3, bool)> {
    let [p, q, r] = triangle.map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
    let [a, b, c] = uv.map(|uv| DVec2::from_array(uv.map(f64::from)));
    let (one, two) = (b - a, c - a);
    let area = one.perp_dot(two);
    let along = ((q - p) * two.y - (r - p) * one.y) * area.signum();
    (area != 0.0 && along.length_squared() > 0.0).then(|| (along.normalize_or_zero(), area < 0.0))
}
