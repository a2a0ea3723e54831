//! Cleaning of meshes from scanners and exporters: split seams, degenerate and repeated triangles.

use super::Mesh;
use crate::vector::cross;
use std::collections::HashMap;

/// Below this ratio of doubled area to squared longest edge a triangle is a line: far under what `f32` positions resolve.
const DEGENERATE_RATIO: f64 = 1e-9;

/// Elements that [`clean`] removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CleanReport {
    /// Vertices merged into an earlier one at bit-identical coordinates.
    pub merged_vertices: usize,
    /// Triangles with a repeated corner or without area.
    pub degenerate_triangles: usize,
    /// Triangles with the same corners in the same orientation as an earlier one.
    pub duplicate_triangles: usize,
    /// Vertices that no kept triangle names.
    pub unreferenced_vertices: usize,
}

impl CleanReport {
    /// Whether nothing was changed.
    pub fn is_clean(&self) -> bool {
        *self == CleanReport::default()
    }
}

impl std::fmt::Display for CleanReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} vertices merged, {} degenerate and {} duplicate triangles and {} unused vertices dropped",
            self.merged_vertices, self.degenerate_triangles, self.duplicate_triangles, self.unreferenced_vertices
        )
    }
}

/// Merges vertices at bit-identical coordinates (texture seams split them; -0 counts as 0), drops triangles without area
/// or with a repeated corner, repeated triangles of the same orientation, and vertices that are then unused.
///
/// Order is kept: vertices by their first appearance in the list, triangles as they were. Non-manifold meshes, double-sided
/// sheets and open borders pass through. Corner indices must lie inside the vertex list, as [`super::read::read`] assures.
pub fn clean(mesh: Mesh) -> (Mesh, CleanReport) {
    let (mesh, report, _) = clean_with_order(mesh);
    (mesh, report)
}

/// As [`clean`], with the index in the given mesh of each triangle that is kept.
pub fn clean_with_order(mesh: Mesh) -> (Mesh, CleanReport, Vec<u32>) {
    let mut report = CleanReport::default();
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|c| c + 0.0)).collect();
    let mut first_at = HashMap::with_capacity(positions.len());
    let representative: Vec<u32> = (0u32..)
        .zip(&positions)
        .map(|(index, p)| {
            let first = *first_at.entry(p.map(f32::to_bits)).or_insert(index);
            report.merged_vertices += (first != index) as usize;
            first
        })
        .collect();
    drop(first_at);

    let mut seen = std::collections::HashSet::with_capacity(mesh.triangles.len());
    let mut triangles = Vec::with_capacity(mesh.triangles.len());
    let mut order = Vec::with_capacity(mesh.triangles.len());
    for (index, triangle) in (0u32..).zip(&mesh.triangles) {
        let [a, b, c] = triangle.map(|v| representative[v as usize]);
        if a == b || b == c || c == a || is_degenerate([a, b, c].map(|v| positions[v as usize])) {
            report.degenerate_triangles += 1;
            continue;
        }
        // Same corners in the same cyclic order; the other orientation is the back of a double-sided sheet.
        let rotated = if a < b && a < c {
            [a, b, c]
        } else if b < c {
            [b, c, a]
        } else {
            [c, a, b]
        };
        if seen.insert(rotated) {
            triangles.push([a, b, c]);
            order.push(index);
        } else {
            report.duplicate_triangles += 1;
        }
    }

    let mut used = vec![false; positions.len()];
    triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let mut new_index = vec![u32::MAX; positions.len()];
    let mut kept = Vec::new();
    for (index, position) in positions.iter().enumerate() {
        if used[index] {
            new_index[index] = kept.len() as u32;
            kept.push(*position);
        } else if representative[index] == index as u32 {
            report.unreferenced_vertices += 1;
        }
    }
    triangles.iter_mut().for_each(|t| *t = t.map(|v| new_index[v as usize]));
    (Mesh { positions: kept, triangles }, report, order)
}

fn is_degenerate([a, b, c]: [[f32; 3]; 3]) -> bool {
    let edge = |p: [f32; 3], q: [f32; 3]| -> [f64; 3] { std::array::from_fn(|i| q[i] as f64 - p[i] as f64) };
    let square = |v: [f64; 3]| v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    let (u, v, w) = (edge(a, b), edge(a, c), edge(b, c));
    let normal = cross(u, v);
    let longest = square(u).max(square(v)).max(square(w));
    square(normal).sqrt() <= DEGENERATE_RATIO * longest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seams_slivers_and_repeats_go_and_order_stays() {
        let mesh = Mesh {
            positions: vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [-0.0, 0.0, 0.0], // vertex 0 again, through -0
                [9.0, 9.0, 9.0],  // unused
                [2.0, 0.0, 0.0],
                [0.0, 0.0, 1.0],
            ],
            triangles: vec![
                [0, 1, 2],
                [1, 2, 3], // the first again, rotated and split
                [2, 1, 0], // its back: stays
                [0, 1, 5], // collinear
                [0, 3, 6], // repeated corner after merging
                [0, 1, 6],
                [0, 2, 1], // the back again
            ],
        };
        let (cleaned, report) = clean(mesh);
        assert_eq!(cleaned.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(cleaned.triangles, [[0, 1, 2], [2, 1, 0], [0, 1, 3]]);
        let expected = CleanReport {
            merged_vertices: 1,
            degenerate_triangles: 2,
            duplicate_triangles: 2,
            unreferenced_vertices: 2,
        };
        assert_eq!(report, expected);
        let (again, report) = clean(cleaned.clone());
        assert!(report.is_clean());
        assert_eq!(again, cleaned);
    }

    #[test]
    fn non_manifold_edges_pass() {
        // Three triangles on one edge.
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]],
        };
        let (cleaned, report) = clean(mesh.clone());
        assert_eq!(cleaned, mesh);
        assert!(report.is_clean());
    }
}
