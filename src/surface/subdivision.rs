//! Linear subdivision: each triangle becomes four, new vertices in the middles of its edges. The surface stays what it was.

use crate::mesh::Mesh;
use std::collections::HashMap;

/// A mesh subdivided so often, and the two vertices that each new one lies between, in order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SubdividedMesh {
    /// The finer mesh: the vertices of the coarser one first, the children of triangle `t` at `4^levels t` and after it.
    pub mesh: Mesh,
    /// For each vertex beyond those of the coarser mesh the ends of its edge, which come before it.
    pub ends: Vec<[u32; 2]>,
}

/// Subdivides a mesh `levels` times. Vertices are numbered in the order of the triangles, so the same everywhere.
pub(crate) fn subdivide(mesh: &Mesh, levels: u32) -> SubdividedMesh {
    let mut result = SubdividedMesh { mesh: mesh.clone(), ends: Vec::new() };
    for _ in 0..levels {
        let Mesh { positions, triangles } = &mut result.mesh;
        let mut middles: HashMap<(u32, u32), u32> = HashMap::with_capacity(2 * triangles.len());
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for &[a, b, c] in triangles.iter() {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to)| {
                *middles.entry((from.min(to), from.max(to))).or_insert_with(|| {
                    let ends = [from.min(to), from.max(to)];
                    let [p, q] = ends.map(|end| positions[end as usize]);
                    positions.push(std::array::from_fn(|k| (0.5 * (p[k] as f64 + q[k] as f64)) as f32));
                    result.ends.push(ends);
                    (positions.len() - 1) as u32
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        *triangles = finer;
    }
    result
}

/// Mean length of the triangles' edges.
#[cfg(feature = "encode")]
pub(crate) fn mean_edge(mesh: &Mesh) -> f64 {
    let length = |a: u32, b: u32| {
        let [a, b] = [a, b].map(|v| mesh.positions[v as usize]);
        (0..3).map(|k| (a[k] as f64 - b[k] as f64).powi(2)).sum::<f64>().sqrt()
    };
    let sum: f64 = mesh.triangles.iter().map(|&[a, b, c]| length(a, b) + length(b, c) + length(c, a)).sum();
    sum / (3 * mesh.triangles.len()).max(1) as f64
}

impl SubdividedMesh {
    /// Continues values linearly to all vertices; those of the coarser mesh, or of it after fewer subdivisions, are given.
    pub(crate) fn interpolate<T: Copy>(&self, coarse: &[T], middle: impl Fn(T, T) -> T) -> Vec<T> {
        let first = self.mesh.positions.len() - self.ends.len();
        let mut values = coarse.to_vec();
        values.reserve(self.mesh.positions.len().saturating_sub(coarse.len()));
        for &[a, b] in self.ends.get(coarse.len() - first..).unwrap_or_default() {
            values.push(middle(values[a as usize], values[b as usize]));
        }
        values
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use crate::surface::atlas::tests::bumpy_sphere;
    use crate::surface::subdivision::*;

    #[test]
    fn every_triangle_becomes_four_and_no_edge_opens() {
        let coarse = bumpy_sphere(8);
        let fine = subdivide(&coarse, 2);
        // Euler's formula of a closed surface: V - F / 2 = 2.
        assert_eq!(fine.mesh.triangles.len(), 16 * coarse.triangles.len());
        assert_eq!(fine.mesh.positions.len(), fine.mesh.triangles.len() / 2 + 2);
        assert_eq!(fine.ends.len() + coarse.positions.len(), fine.mesh.positions.len());
        let x: Vec<f32> = coarse.positions.iter().map(|p| p[0]).collect();
        let x = fine.interpolate(&x, |a, b| (0.5 * (a as f64 + b as f64)) as f32);
        assert!(x.iter().zip(&fine.mesh.positions).all(|(x, p)| *x == p[0]));
    }
}
