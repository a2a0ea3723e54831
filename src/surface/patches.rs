//! Surface patches of the `wavelet-texture` profile: two triangles with a common edge make a square of N x N samples.
//!
//! The first triangle fills the right triangle `u + v <= 1` of the unit square, the second the other half; their common
//! edge is the diagonal. A triangle without a partner fills its half alone. Sample `(column, row)` lies at
//! `u = (column + 0.5) / N`, `v = (row + 0.5) / N`. The pairing follows from the mesh, so that a file need not store it.

use crate::mesh::Mesh;
use crate::vector::{cross, dot};
use std::collections::BTreeSet;

/// Largest binary logarithm of a patch's side: 16 samples.
pub(crate) const MAX_SIDE_LOG2: u8 = 4;

/// One or two triangles on the unit square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SurfacePatch {
    /// Index of the triangle with `u + v <= 1`.
    pub first: u32,
    /// Index of the triangle with `u + v > 1`, if there is one.
    pub second: Option<u32>,
    /// Vertices at (0, 0), (1, 0), (0, 1) and (1, 1); the last repeats the first where there is no second triangle.
    pub corners: [u32; 4],
}

/// A point of a patch: its corners' weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchPoint {
    /// Triangle of the mesh.
    pub triangle: u32,
    /// Weights of the patch's four corners; one of the first and the last is zero.
    pub weights: [f64; 4],
}

impl SurfacePatch {
    /// The point at `(u, v)`; `None` in the empty half of a single triangle.
    pub fn point(&self, u: f64, v: f64) -> Option<PatchPoint> {
        if u + v <= 1.0 {
            Some(PatchPoint { triangle: self.first, weights: [1.0 - u - v, u, v, 0.0] })
        } else {
            let triangle = self.second?;
            Some(PatchPoint { triangle, weights: [0.0, 1.0 - v, 1.0 - u, u + v - 1.0] })
        }
    }
    /// Whether the sample at `(column, row)` of a grid of `1 << side_log2` lies on a triangle.
    pub fn holds(&self, column: usize, row: usize, side_log2: u8) -> bool {
        self.second.is_some() || column + row < 1 << side_log2
    }
    /// `(u, v)` of a point given by its barycentric coordinates in one of the patch's triangles.
    pub fn locate(&self, mesh: &Mesh, triangle: u32, barycentric: [f64; 3]) -> [f64; 2] {
        let vertices = mesh.triangles[triangle as usize];
        let weight =
            |vertex: u32| -> f64 { vertices.iter().position(|&v| v == vertex).map_or(0.0, |index| barycentric[index]) };
        let (b, c) = (weight(self.corners[1]), weight(self.corners[2]));
        if triangle == self.first { [b, c] } else { [1.0 - c, 1.0 - b] }
    }
    /// Interpolates values of the vertices.
    pub fn interpolate(&self, values: &[[f64; 3]], point: &PatchPoint) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (corner, weight) in self.corners.iter().zip(point.weights) {
            let value = values[*corner as usize];
            for axis in 0..3 {
                sum[axis] += weight * value[axis];
            }
        }
        sum
    }
}

/// Pairs the triangles of a mesh whose indices are valid: those with the fewest free neighbours first, each with the free
/// neighbour whose common edge comes nearest to a hypotenuse. Patches are in the order of their first triangles.
pub(crate) fn pair_triangles(mesh: &Mesh) -> Vec<SurfacePatch> {
    let neighbours = neighbours(mesh);
    let count = mesh.triangles.len();
    let mut partner: Vec<Option<(u32, u8)>> = vec![None; count];
    let mut free = vec![true; count];
    let mut degree: Vec<u8> = neighbours.iter().map(|edges| edges.iter().flatten().count() as u8).collect();
    let mut queue: BTreeSet<(u8, u32)> = degree.iter().zip(0u32..).map(|(&d, t)| (d, t)).collect();
    while let Some((_, triangle)) = queue.pop_first() {
        let here = triangle as usize;
        free[here] = false;
        let mut best: Option<(f64, u8, u32)> = None;
        for edge in 0..3u8 {
            let Some(other) = neighbours[here][edge as usize] else { continue };
            if !free[other as usize] {
                continue;
            }
            let score = hypotenuse_score(mesh, triangle, edge, other);
            if best.is_none_or(|(least, ..)| score > least) {
                best = Some((score, edge, other));
            }
        }
        let mut taken = vec![here];
        if let Some((_, edge, other)) = best {
            partner[here] = Some((other, edge));
            free[other as usize] = false;
            queue.remove(&(degree[other as usize], other));
            taken.push(other as usize);
        }
        for t in taken {
            for &n in neighbours[t].iter().flatten() {
                let n = n as usize;
                if free[n] && queue.remove(&(degree[n], n as u32)) {
                    degree[n] = degree[n].saturating_sub(1);
                    queue.insert((degree[n], n as u32));
                }
            }
        }
    }
    let mut owned = vec![false; count];
    for (other, _) in partner.iter().flatten() {
        owned[*other as usize] = true;
    }
    (0..count)
        .filter(|&t| !owned[t])
        .map(|t| match partner[t] {
            Some((other, edge)) => {
                let v = mesh.triangles[t];
                // Edge e joins vertices e and e + 1; the vertex opposite is e + 2.
                let (b, c, a) = (edge as usize, (edge as usize + 1) % 3, (edge as usize + 2) % 3);
                let far = mesh.triangles[other as usize];
                let d = far.iter().copied().find(|&x| x != v[b] && x != v[c]).unwrap_or(v[a]);
                SurfacePatch { first: t as u32, second: Some(other), corners: [v[a], v[b], v[c], d] }
            }
            None => {
                let v = mesh.triangles[t];
                SurfacePatch { first: t as u32, second: None, corners: [v[0], v[1], v[2], v[0]] }
            }
        })
        .collect()
}

/// For each triangle and each of its edges (edge `e` joins its vertices `e` and `e + 1`) the one other triangle that
/// shares it; `None` on borders and where more than two meet.
pub(crate) fn neighbours(mesh: &Mesh) -> Vec<[Option<u32>; 3]> {
    let mut edges: Vec<(u32, u32, u32, u8)> = Vec::with_capacity(mesh.triangles.len() * 3);
    for (t, v) in (0u32..).zip(&mesh.triangles) {
        for e in 0..3 {
            let (a, b) = (v[e], v[(e + 1) % 3]);
            if a != b {
                edges.push((a.min(b), a.max(b), t, e as u8));
            }
        }
    }
    edges.sort_unstable();
    let mut result = vec![[None; 3]; mesh.triangles.len()];
    for group in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        if let [x, y] = group
            && x.2 != y.2
        {
            result[x.2 as usize][x.3 as usize] = Some(y.2);
            result[y.2 as usize][y.3 as usize] = Some(x.2);
        }
    }
    result
}

/// Nearness of the common edge to the hypotenuse of two right triangles: its squared length over the sum of the other
/// four.
fn hypotenuse_score(mesh: &Mesh, triangle: u32, edge: u8, other: u32) -> f64 {
    let squared = |a: u32, b: u32| -> f64 {
        let (p, q) = (mesh.positions[a as usize], mesh.positions[b as usize]);
        (0..3).map(|i| (p[i] as f64 - q[i] as f64) * (p[i] as f64 - q[i] as f64)).sum()
    };
    let perimeter = |t: u32| -> f64 {
        let v = mesh.triangles[t as usize];
        squared(v[0], v[1]) + squared(v[1], v[2]) + squared(v[2], v[0])
    };
    let v = mesh.triangles[triangle as usize];
    let common = squared(v[edge as usize], v[(edge as usize + 1) % 3]);
    let rest = perimeter(triangle) + perimeter(other) - 2.0 * common;
    if rest > 0.0 { common / rest } else { 0.0 }
}

/// Unit normals of the vertices: the sum of the adjacent triangles' normals, weighted by their areas.
pub(crate) fn vertex_normals(mesh: &Mesh) -> Vec<[f64; 3]> {
    let mut normals = vec![[0.0f64; 3]; mesh.positions.len()];
    for v in &mesh.triangles {
        let normal = area_normal(mesh, *v);
        for &vertex in v {
            for axis in 0..3 {
                normals[vertex as usize][axis] += normal[axis];
            }
        }
    }
    normals.iter_mut().for_each(|n| *n = unit(*n));
    normals
}

/// Normal of a triangle, twice its area long.
pub(crate) fn area_normal(mesh: &Mesh, vertices: [u32; 3]) -> [f64; 3] {
    let p = vertices.map(|v| mesh.positions[v as usize].map(|x| x as f64));
    let a: [f64; 3] = std::array::from_fn(|i| p[1][i] - p[0][i]);
    let b: [f64; 3] = std::array::from_fn(|i| p[2][i] - p[0][i]);
    cross(a, b)
}

/// The vector over its length; zero stays zero.
pub(crate) fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.map(|x| x / length) } else { v }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat grid of `n x n` squares, two triangles each.
    fn sheet(n: u32) -> Mesh {
        let mut mesh = Mesh::default();
        for y in 0..=n {
            for x in 0..=n {
                mesh.positions.push([x as f32, y as f32, 0.0]);
            }
        }
        for y in 0..n {
            for x in 0..n {
                let a = y * (n + 1) + x;
                mesh.triangles.push([a, a + 1, a + n + 1]);
                mesh.triangles.push([a + 1, a + n + 2, a + n + 1]);
            }
        }
        mesh
    }

    #[test]
    fn triangles_pair_along_their_hypotenuses() {
        let mesh = sheet(6);
        let patches = pair_triangles(&mesh);
        assert_eq!(patches.len(), 36);
        assert!(patches.iter().all(|p| p.second.is_some()));
        let right = patches.iter().filter(|p| p.first + 1 == p.second.unwrap()).count();
        assert!(right >= 30, "{right}");
    }

    #[test]
    fn points_are_found_again() {
        let mut mesh = sheet(2);
        mesh.triangles.pop();
        let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.map(|x| x as f64)).collect();
        let mut seen = vec![0; mesh.triangles.len()];
        for patch in pair_triangles(&mesh) {
            for (u, v) in [(0.1, 0.2), (0.6, 0.3), (0.9, 0.8), (0.4, 0.65)] {
                let Some(point) = patch.point(u, v) else {
                    assert!(patch.second.is_none() && u + v > 1.0);
                    continue;
                };
                seen[point.triangle as usize] += 1;
                let place = patch.interpolate(&positions, &point);
                // Barycentric coordinates by areas.
                let v3 = mesh.triangles[point.triangle as usize];
                let corners = v3.map(|k| positions[k as usize]);
                let area = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
                    (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
                };
                let whole = area(corners[0], corners[1], corners[2]);
                let barycentric = [
                    area(place, corners[1], corners[2]) / whole,
                    area(corners[0], place, corners[2]) / whole,
                    area(corners[0], corners[1], place) / whole,
                ];
                let found = patch.locate(&mesh, point.triangle, barycentric);
                assert!((found[0] - u).abs() < 1e-9 && (found[1] - v).abs() < 1e-9, "{found:?} {u} {v}");
            }
        }
        assert!(seen.iter().all(|&n| n == 2), "{seen:?}");
    }

    #[test]
    fn odd_meshes_do_no_harm() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 1, 2], [0, 1, 2], [0, 1, 3], [1, 1, 1], [0, 1, 2]],
        };
        let covered: usize = pair_triangles(&mesh).iter().map(|p| 1 + p.second.is_some() as usize).sum();
        assert_eq!(covered, 5);
        assert!(pair_triangles(&Mesh::default()).is_empty());
    }
}
