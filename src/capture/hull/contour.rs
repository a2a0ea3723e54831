//! Marching cubes. The polygons of each of the 256 cases come from one rule for the sides of a cell, which two neighbours share: corners inside are
//! cut off one by one where they lie opposite each other. So the surface is closed, each edge between two triangles.

use super::field::{FieldGrid, meets};
use super::silhouette::Silhouette;
use crate::error::Result;
use crate::input::FileAccess;
use crate::mesh::Mesh;
use crate::parallel;
use glam::{DVec3, Vec3};
use std::path::Path;

/// Cells along a side of a block.
const BLOCK: usize = 8;

/// Edges of a cell as pairs of corners, whose bits are x, y and z: four along each axis.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

/// Corners of a polygon whose diagonals all lie within its cell, at most. Those of larger ones may lie on a side, where the neighbour's may, too:
/// they have a vertex in their middle.
const MAX_FAN: usize = 5;
/// Stands for a vertex within a cell, where the axis of an edge would.
const INTERIOR: usize = 3;

/// Polygons of a case as lists of edges.
type Polygons = Vec<Vec<usize>>;

fn edge_between(a: usize, b: usize) -> usize {
    let pair = (a.min(b), a.max(b));
    EDGES.iter().position(|edge| *edge == pair).unwrap_or(0)
}

/// The four corners of a side of a cell, counter-clockwise from outside.
fn side_corners(axis: usize, high: bool) -> [usize; 4] {
    let (b, c) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = usize::from(high) << axis;
    if high { [base, base | b, base | b | c, base | c] } else { [base, base | c, base | b | c, base | b] }
}

/// The polygons of a case, whose bits are the corners inside; counter-clockwise from outside.
fn polygons(case: usize) -> Polygons {
    let inside = |corner: usize| case >> corner & 1 == 1;
    let mut next = [None; 12];
    for corners in (0..3).flat_map(|axis| [side_corners(axis, false), side_corners(axis, true)]) {
        let pair = |k: usize| (corners[k % 4], corners[(k + 1) % 4]);
        for k in 0..4 {
            let (a, b) = pair(k);
            if inside(a) || !inside(b) {
                continue;
            }
            // From where the side's outline comes in to where it first goes out again.
            let leaves = (k + 1..k + 4).map(pair).find(|&(a, b)| inside(a) && !inside(b));
            next[edge_between(a, b)] = leaves.map(|(a, b)| edge_between(a, b));
        }
    }
    let mut all = Polygons::new();
    for start in 0..12 {
        let mut polygon = Vec::new();
        let mut edge = start;
        while let Some(following) = next[edge].take() {
            polygon.push(edge);
            edge = following;
        }
        if !polygon.is_empty() {
            all.push(polygon);
        }
    }
    all
}

/// A part of the surface: vertices by the edges of the grid that they lie on.
#[derive(Default)]
struct Patch {
    vertices: Vec<(u64, [f32; 3])>,
    triangles: Vec<[u64; 3]>,
}

/// The surface of the field in a grid.
pub(super) fn extract(path: &Path, grid: &FieldGrid, views: &[Silhouette], access: &FileAccess) -> Result<Mesh> {
    let cases: Vec<Polygons> = (0..256).map(polygons).collect();
    let blocks = grid.cells.map(|cells| cells.div_ceil(BLOCK));
    let mut all = Patch::default();
    let mut held = access.reserve(path, "visual hull", 0)?;
    for z in 0..blocks[2] {
        let layer = parallel::map(blocks[0] * blocks[1], |k| {
            block(grid, views, &cases, [k % blocks[0], k / blocks[0], z].map(|at| at * BLOCK))
        });
        for patch in layer {
            // Both lists may have grown to twice their need; the mesh takes as much again.
            let bytes = 2 * 48 * (patch.vertices.len() + patch.triangles.len());
            held.grow("visual hull", bytes as u64).map_err(|e| e.in_file(path))?;
            all.vertices.extend(patch.vertices);
            all.triangles.extend(patch.triangles);
        }
    }
    let most = access.budget().limits().mesh_elements;
    crate::limits::check("triangles of the visual hull", all.triangles.len() as u64, u64::from(most))?;
    Ok(all.joined())
}

impl Patch {
    /// A mesh in which each edge of the grid has one vertex.
    fn joined(mut self) -> Mesh {
        self.vertices.sort_unstable_by_key(|(edge, _)| *edge);
        self.vertices.dedup_by_key(|(edge, _)| *edge);
        let index = |edge: u64| self.vertices.partition_point(|(other, _)| *other < edge) as u32;
        let triangles = self.triangles.iter().map(|corners| corners.map(index)).collect();
        Mesh { positions: self.vertices.iter().map(|(_, position)| *position).collect(), triangles }
    }
}

/// The surface in a block whose first cell is `first`.
fn block(grid: &FieldGrid, views: &[Silhouette], cases: &[Polygons], first: [usize; 3]) -> Patch {
    let sides: [usize; 3] = std::array::from_fn(|k| BLOCK.min(grid.cells[k] - first[k]));
    let radius = 0.5 * grid.cell * (DVec3::from_array(sides.map(|side| side as f64))).length();
    let last = std::array::from_fn(|k| first[k] + sides[k]);
    let centre = 0.5 * (grid.corner(first) + grid.corner(last));
    let at_side = (0..3).any(|k| first[k] == 0 || last[k] == grid.cells[k]);
    match meets(views, centre, radius) {
        None => return Patch::default(),
        Some(true) if !at_side => return Patch::default(),
        Some(_) => {}
    }
    let counts = sides.map(|side| side + 1);
    let global = |at: [usize; 3]| -> [usize; 3] { std::array::from_fn(|k| first[k] + at[k]) };
    let corners = (0..counts.iter().product()).map(|k: usize| {
        grid.value(views, global([k % counts[0], k / counts[0] % counts[1], k / (counts[0] * counts[1])]))
    });
    let values: Vec<f64> = corners.collect();
    let cells = CellBlock {
        values: &values,
        sides,
        key: &|at, axis| edge_key(grid, global(at), axis),
        position: &|at| grid.corner(global(at)),
    };
    cells.contour(cases)
}

/// The field's values at the corners of some cells, x fastest, and what their edges are called and where their corners are.
struct CellBlock<'a> {
    values: &'a [f64],
    sides: [usize; 3],
    key: &'a dyn Fn([usize; 3], usize) -> u64,
    position: &'a dyn Fn([usize; 3]) -> DVec3,
}

impl CellBlock<'_> {
    fn value(&self, [x, y, z]: [usize; 3]) -> f64 {
        let counts = self.sides.map(|side| side + 1);
        self.values[(z * counts[1] + y) * counts[0] + x]
    }

    fn contour(&self, cases: &[Polygons]) -> Patch {
        let mut patch = Patch::default();
        for k in 0..self.sides.iter().product() {
            let cell = [k % self.sides[0], k / self.sides[0] % self.sides[1], k / (self.sides[0] * self.sides[1])];
            let corner = |c: usize| -> [usize; 3] { std::array::from_fn(|i| cell[i] + (c >> i & 1)) };
            let case = (0..8).filter(|&c| self.value(corner(c)) > 0.0).fold(0, |case, c| case | 1 << c);
            for polygon in &cases[case] {
                let edges: Vec<u64> = polygon.iter().map(|&edge| (self.key)(corner(EDGES[edge].0), edge / 4)).collect();
                for (&edge, &key) in polygon.iter().zip(&edges) {
                    let (a, b) = (corner(EDGES[edge].0), corner(EDGES[edge].1));
                    let (low, high) = (self.value(a), self.value(b));
                    let position = (self.position)(a).lerp((self.position)(b), low / (low - high));
                    patch.vertices.push((key, position.as_vec3().to_array()));
                }
                if edges.len() <= MAX_FAN {
                    patch.triangles.extend((1..edges.len() - 1).map(|k| [edges[0], edges[k], edges[k + 1]]));
                    continue;
                }
                // At most one polygon of a cell is as large.
                let middle = (self.key)(cell, INTERIOR);
                let around = (0..edges.len()).map(|k| [edges[k], edges[(k + 1) % edges.len()], middle]);
                patch.triangles.extend(around);
                let corners = &patch.vertices[patch.vertices.len() - edges.len()..];
                let sum: Vec3 = corners.iter().map(|(_, position)| Vec3::from_array(*position)).sum();
                patch.vertices.push((middle, (sum / edges.len() as f32).to_array()));
            }
        }
        patch.vertices.sort_unstable_by_key(|(edge, _)| *edge);
        patch.vertices.dedup_by_key(|(edge, _)| *edge);
        patch
    }
}

/// The surface of values on a grid of so many corners along each side.
#[cfg(test)]
pub(super) fn contour_values(values: &[f64], side: usize) -> Mesh {
    let cases: Vec<Polygons> = (0..256).map(polygons).collect();
    let cells = CellBlock {
        values,
        sides: [side - 1; 3],
        key: &|[x, y, z], axis| (((z * side + y) * side + x) * 4 + axis) as u64,
        position: &|at| DVec3::from_array(at.map(|k| k as f64)),
    };
    cells.contour(&cases).joined()
}

/// A number of its own for each edge of the grid, and each cell.
fn edge_key(grid: &FieldGrid, [x, y, z]: [usize; 3], axis: usize) -> u64 {
    let [nx, ny, _] = grid.cells.map(|cells| cells as u64 + 1);
    ((z as u64 * ny + y as u64) * nx + x as u64) * 4 + axis as u64
}
