//! Signed distances by rays: the mesh on the octahedral grid as seen from a vertex, the edges of the visible set found by bisection.

use crate::mesh::Mesh;
use crate::sphere::octahedral;
use crate::surface::occluders::Occluders;
use obvhs::triangle::Triangle;

/// A mesh made ready for rays from its own surface.
pub struct MeshRays {
    occluders: Occluders,
    positions: Vec<[f32; 3]>,
    /// Unit normals of the triangles at each vertex, one list after the other.
    normals: Vec<[f32; 3]>,
    first_normal: Vec<u32>,
    ground_up: Option<[f32; 3]>,
    /// Distance below which a ray takes no notice of the mesh: the triangles it starts on.
    bias: f32,
}

/// Rays start to count at this share of the bounding box's diagonal.
const BIAS: f64 = 1e-4;
/// A ray is known to enter the solid if its direction lies this far below every triangle at the vertex.
const BELOW: f32 = -1e-4;
/// Halvings of the angle between a visible and a blocked direction.
const HALVINGS: usize = 3;

impl MeshRays {
    /// Builds the hierarchy. With `ground_up` an endless plane across that direction closes the lower half of the world. Rays
    /// start at the vertices of `cut`: the mesh itself, or the mesh cut finer. Triangles and vertices must be finite, corners inside the
    /// vertex list.
    pub fn new(mesh: &Mesh, cut: &Mesh, ground_up: Option<[f64; 3]>) -> Self {
        let occluders = Occluders::new(mesh);
        let bias = (BIAS * mesh.diagonal()) as f32;
        let mesh = cut;
        let mut count = vec![0u32; mesh.positions.len() + 1];
        let of_triangle: Vec<[f32; 3]> = (mesh.triangles.iter())
            .map(|corners| {
                let [v0, v1, v2] = corners.map(|v| mesh.positions[v as usize].into());
                Triangle { v0, v1, v2 }.compute_normal().to_array()
            })
            .collect();
        let usable = |k: usize| of_triangle[k] != [0.0; 3];
        for (_, corners) in mesh.triangles.iter().enumerate().filter(|(k, _)| usable(*k)) {
            corners.iter().for_each(|&v| count[v as usize + 1] += 1);
        }
        for v in 1..count.len() {
            count[v] += count[v - 1];
        }
        let mut normals = vec![[0.0; 3]; count.last().copied().unwrap_or(0) as usize];
        let mut next = count.clone();
        for (k, corners) in mesh.triangles.iter().enumerate().filter(|(k, _)| usable(*k)) {
            for &v in corners {
                normals[next[v as usize] as usize] = of_triangle[k];
                next[v as usize] += 1;
            }
        }
        MeshRays {
            occluders,
            positions: mesh.positions.clone(),
            normals,
            first_normal: count,
            ground_up: ground_up.map(|up| up.map(|x| x as f32)),
            bias,
        }
    }

    /// Number of samples that rays start from.
    pub fn places(&self) -> usize {
        self.positions.len()
    }

    /// Whether light from a unit direction reaches a vertex. Directions below all triangles at the vertex are blocked by them.
    #[inline]
    pub fn sees(&self, vertex: usize, direction: [f32; 3]) -> bool {
        let dot = |n: &[f32; 3]| n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2];
        if self.ground_up.as_ref().is_some_and(|up| dot(up) < 0.0) {
            return false;
        }
        let around = &self.normals[self.first_normal[vertex] as usize..self.first_normal[vertex + 1] as usize];
        if !around.is_empty() && around.iter().all(|n| dot(n) < BELOW) {
            return false;
        }
        self.occluders.is_free_beyond(self.bias, self.positions[vertex], direction)
    }

    /// The signed spherical distance of every cell's direction to the edge of what the vertex sees, -pi/2 to pi/2. The edge is
    /// a chain of great arcs between points that bisection finds on the lines between neighbouring cells.
    pub fn signed_distances(&self, vertex: usize, grid: &DirectionGrid, scratch: &mut RayScratch) {
        let RayScratch { visible, point_of_pair, edge, links, cosine, nearest, distances } = scratch;
        visible.clear();
        visible.extend(grid.directions.iter().map(|&d| self.sees(vertex, d)));
        // 1. Points of the edge.
        edge.clear();
        point_of_pair.clear();
        for &(a, b) in &grid.neighbours {
            let (a, b) = (a as usize, b as usize);
            let crossed = visible[a] != visible[b];
            point_of_pair.push(if crossed { edge.len() as u32 } else { NONE });
            if crossed {
                edge.push(self.crossing(vertex, visible[a], grid.directions[a], grid.directions[b]));
            }
        }
        // 2. Arcs between them: round a corner of the grid the edge goes from pair to pair.
        links.clear();
        links.resize(edge.len(), [NONE; 2]);
        for corner in &grid.corners {
            let mut points = [NONE; 4];
            let mut count = 0;
            for &pair in corner {
                let point = point_of_pair[pair as usize];
                if point != NONE {
                    points[count] = point;
                    count += 1;
                }
            }
            for ends in points[..count].chunks_exact(2) {
                for (from, to) in [(ends[0], ends[1]), (ends[1], ends[0])] {
                    let link = &mut links[from as usize];
                    link[(link[0] != NONE) as usize] = to;
                }
            }
        }
        // 3. The nearest point for every cell, then the arcs that meet there.
        let count = grid.directions.len();
        cosine.clear();
        cosine.resize(count, -1.0);
        nearest.clear();
        nearest.resize(count, NONE);
        let [x, y, z] = &grid.axes;
        for (point, &[ex, ey, ez]) in edge.iter().enumerate() {
            let cells = cosine.iter_mut().zip(nearest.iter_mut());
            for ((((best, nearest), x), y), z) in cells.zip(x).zip(y).zip(z) {
                let here = ex * x + ey * y + ez * z;
                let nearer = here > *best;
                *best = if nearer { here } else { *best };
                *nearest = if nearer { point as u32 } else { *nearest };
            }
        }
        distances.clear();
        for cell in 0..count {
            let mut best = cosine[cell];
            if nearest[cell] != NONE {
                let point = nearest[cell] as usize;
                for &other in links[point].iter().filter(|&&other| other != NONE) {
                    best = best.max(cosine_to_arc(grid.directions[cell], edge[point], edge[other as usize]));
                }
            }
            // Beyond a right angle no lobe sees a difference.
            let angle = best.clamp(0.0, 1.0).acos();
            distances.push(if visible[cell] { angle } else { -angle });
        }
    }

    /// Finds the direction at which visibility changes between two directions, the first of which is of the kind `kind`.
    fn crossing(&self, vertex: usize, kind: bool, mut near: [f32; 3], mut far: [f32; 3]) -> [f32; 3] {
        for _ in 0..HALVINGS {
            let middle = between(near, far);
            if self.sees(vertex, middle) == kind {
                near = middle;
            } else {
                far = middle;
            }
        }
        between(near, far)
    }
}

/// No point, no pair.
const NONE: u32 = u32::MAX;

/// Cosine of the angle to the great arc between two points, or -1 where the nearest of it is one of its ends.
fn cosine_to_arc(direction: [f32; 3], a: [f32; 3], b: [f32; 3]) -> f32 {
    let cross =
        |p: [f32; 3], q: [f32; 3]| [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    let dot = |p: [f32; 3], q: [f32; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let normal = cross(a, b);
    let squared = dot(normal, normal);
    if squared < 1e-12 || dot(cross(normal, a), direction) < 0.0 || dot(cross(b, normal), direction) < 0.0 {
        return -1.0;
    }
    let height = dot(normal, direction);
    (1.0 - height * height / squared).max(0.0).sqrt()
}

/// The unit vector half way.
fn between(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    let sum: [f32; 3] = std::array::from_fn(|k| a[k] + b[k]);
    let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
    if length > 0.0 { sum.map(|x| x / length) } else { a }
}

/// The directions of an octahedral grid.
pub struct DirectionGrid {
    /// Unit directions of the cells, row by row.
    pub directions: Vec<[f32; 3]>,
    /// Coordinates of the directions as three lists.
    axes: [Vec<f32>; 3],
    /// Pairs of cells that share an edge.
    neighbours: Vec<(u32, u32)>,
    /// For each corner where four cells meet their four pairs.
    corners: Vec<[u32; 4]>,
}

impl DirectionGrid {
    /// A grid of `size * size` cells, `size` at least 2.
    pub fn new(size: usize) -> Self {
        let directions: Vec<[f32; 3]> = octahedral::directions(size).into_iter().map(|d| d.map(|x| x as f32)).collect();
        let axes = std::array::from_fn(|k| directions.iter().map(|d| d[k]).collect());
        let mut index = std::collections::HashMap::new();
        let mut neighbours = Vec::with_capacity(2 * size * size + 2 * size);
        let mut corners = Vec::with_capacity(size * size + 2 * size);
        let n = size as isize;
        // The corner above and left of (column, row); those on the square's right and lower side fold onto its left and upper
        // ones or are named here.
        for row in 0..=n {
            for column in 0..=n {
                let outermost = |k: isize| k == 0 || k == n;
                if outermost(row) && outermost(column) && (row, column) != (0, 0) {
                    continue;
                }
                let cell = |c: isize, r: isize| octahedral::wrap(c, r, size) as u32;
                // All four corners of the square are one point of the sphere.
                let around = if (row, column) == (0, 0) {
                    [cell(0, 0), cell(n - 1, 0), cell(n - 1, n - 1), cell(0, n - 1)]
                } else {
                    [cell(column - 1, row - 1), cell(column, row - 1), cell(column, row), cell(column - 1, row)]
                };
                corners.push(std::array::from_fn(|k| {
                    let (a, b) = (around[k], around[(k + 1) % 4]);
                    *index.entry((a.min(b), a.max(b))).or_insert_with(|| {
                        neighbours.push((a, b));
                        neighbours.len() as u32 - 1
                    })
                }));
            }
        }
        DirectionGrid { directions, axes, neighbours, corners }
    }
}

/// Memory for one vertex's work, used again for the next.
#[derive(Default)]
pub struct RayScratch {
    visible: Vec<bool>,
    /// For each pair of neighbours the index of the edge's point on it.
    point_of_pair: Vec<u32>,
    edge: Vec<[f32; 3]>,
    /// Up to two points to which the edge goes on.
    links: Vec<[u32; 2]>,
    cosine: Vec<f32>,
    nearest: Vec<u32>,
    /// Signed distances of the last vertex, radians.
    pub distances: Vec<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square floor of four triangles about the origin, and a wall along x = 1 that is very high and wide.
    pub(crate) fn floor_and_wall() -> Mesh {
        let mut positions = vec![[0.0, 0.0, 0.0]];
        positions.extend([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]);
        positions.extend([[1.0, 0.0, -1e3], [1.0, 0.0, 1e3], [1.0, 1e3, 1e3], [1.0, 1e3, -1e3]]);
        let triangles = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 6, 7], [5, 7, 8]];
        Mesh { positions, triangles }
    }

    #[test]
    fn distances_are_those_to_the_edge() {
        let surroundings = MeshRays::new(&floor_and_wall(), &floor_and_wall(), None);
        // From the middle of the floor a quarter of the sphere is seen: y > 0, x < 0.
        let mut scratch = RayScratch::default();
        for size in [16, 32] {
            let grid = DirectionGrid::new(size);
            surroundings.signed_distances(0, &grid, &mut scratch);
            for (d, &found) in grid.directions.iter().zip(&scratch.distances) {
                let (x, y) = (-d[0], d[1]);
                let expected = if x >= 0.0 && y >= 0.0 {
                    x.min(y).asin()
                } else if x < 0.0 && y < 0.0 {
                    // The edge is the line of the z axis from here.
                    -(d[2].abs()).acos()
                } else {
                    let inside = x.max(y);
                    // The nearest point of the half circle lies straight above.
                    if inside >= 0.0 { x.min(y).asin() } else { 0.0 }
                };
                assert!((found - expected).abs() < 0.035, "{size} {d:?}: {found}, not {expected}");
            }
        }
    }
}
