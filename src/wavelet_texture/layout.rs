//! The patches of a mesh with the sizes of their grids.

use crate::mesh::Mesh;
use crate::reflectance::ReflectionGeometry;
use crate::surface::patches::{PatchPoint, SurfacePatch, pair_triangles, unit, vertex_normals};

/// A mesh's patches, made ready for evaluation.
#[derive(Debug, Clone, Default)]
pub struct PatchLayout {
    /// The patches.
    pub patches: Vec<SurfacePatch>,
    /// Binary logarithm of each patch's side, `1..=4`.
    pub side_log2: Vec<u8>,
    /// For each triangle the index of its patch.
    pub patch_of_triangle: Vec<u32>,
    /// The mesh.
    pub mesh: Mesh,
    /// Its positions in double precision.
    pub positions: Vec<[f64; 3]>,
    /// Its smooth unit normals.
    pub normals: Vec<[f64; 3]>,
}

impl PatchLayout {
    /// Pairs the triangles; sides are still to be set (all 2 x 2).
    pub fn new(mesh: &Mesh) -> Self {
        let patches = pair_triangles(mesh);
        let mut patch_of_triangle = vec![0; mesh.triangles.len()];
        for (index, patch) in (0u32..).zip(&patches) {
            patch_of_triangle[patch.first as usize] = index;
            if let Some(second) = patch.second {
                patch_of_triangle[second as usize] = index;
            }
        }
        PatchLayout {
            side_log2: vec![1; patches.len()],
            patches,
            patch_of_triangle,
            positions: mesh.positions.iter().map(|p| p.map(|x| x as f64)).collect(),
            normals: vertex_normals(mesh),
            mesh: mesh.clone(),
        }
    }
    /// Samples of one view, over all patches, that lie on triangles.
    pub fn samples_per_view(&self) -> usize {
        let held = |(patch, &log2): (&SurfacePatch, &u8)| {
            let side = 1usize << log2;
            if patch.second.is_some() { side * side } else { side * (side + 1) / 2 }
        };
        self.patches.iter().zip(&self.side_log2).map(held).sum()
    }
    /// The grid point at `(column, row)` of a patch.
    pub fn grid_point(&self, patch: usize, column: usize, row: usize) -> Option<PatchPoint> {
        let side = (1u32 << self.side_log2[patch]) as f64;
        if !self.patches[patch].holds(column, row, self.side_log2[patch]) {
            return None;
        }
        let (u, v) = ((column as f64 + 0.5) / side, (row as f64 + 0.5) / side);
        self.patches[patch].point(u, v)
    }
    /// World position and unit normal of a point.
    pub fn position_and_normal(&self, patch: usize, point: &PatchPoint) -> ([f64; 3], [f64; 3]) {
        let patch = &self.patches[patch];
        (patch.interpolate(&self.positions, point), unit(patch.interpolate(&self.normals, point)))
    }
    /// Patch and point of a place on a triangle, and where it lies on the patch's square.
    pub fn locate(&self, triangle: u32, barycentric: [f64; 3]) -> Option<(usize, PatchPoint, [f64; 2])> {
        let index = *self.patch_of_triangle.get(triangle as usize)? as usize;
        let patch = self.patches.get(index)?;
        let [u, v] = patch.locate(&self.mesh, triangle, barycentric);
        let weights =
            if triangle == patch.first { [1.0 - u - v, u, v, 0.0] } else { [0.0, 1.0 - v, 1.0 - u, u + v - 1.0] };
        Some((index, PatchPoint { triangle, weights }, [u, v]))
    }
    /// Light and view at a point of a patch.
    pub fn geometry(
        &self,
        patch: usize,
        point: &PatchPoint,
        camera_centre: [f64; 3],
        light: &crate::views::PointLight,
    ) -> ReflectionGeometry {
        let (position, normal) = self.position_and_normal(patch, point);
        ReflectionGeometry::new(position, normal, camera_centre, light)
    }
}

/// Reads a patch's grid (in rows) at `(u, v)` by cubic convolution (Catmull-Rom); beyond the outermost samples the grid is
/// continued linearly.
pub(crate) fn interpolate_grid(side_log2: u8, [u, v]: [f64; 2], grid: &[[f32; 3]]) -> [f32; 3] {
    let side = 1usize << side_log2;
    let (columns, rows) = (taps(u, side), taps(v, side));
    let mut sum = [0.0f32; 3];
    for (row, wy) in rows {
        for (column, wx) in columns {
            let x = grid[row * side + column];
            (0..3).for_each(|c| sum[c] += wx * wy * x[c]);
        }
    }
    sum
}

/// Four samples along an axis and their weights at `x` in `0..=1`.
fn taps(x: f64, side: usize) -> [(usize, f32); 4] {
    let x = x * side as f64 - 0.5;
    let cell = (x.floor().max(0.0) as usize).min(side - 2);
    let t = (x - cell as f64) as f32;
    if !(0.0..=1.0).contains(&t) {
        return [(cell, 1.0 - t), (cell + 1, t), (cell, 0.0), (cell, 0.0)];
    }
    let s = 1.0 - t;
    // Keys' kernel, a = -1/2.
    let (mut before, mut first, mut second, mut after) =
        (-0.5 * t * s * s, 1.0 - t * t * (2.5 - 1.5 * t), 1.0 - s * s * (2.5 - 1.5 * s), -0.5 * s * t * t);
    // A missing outer sample is continued: 2 x1 - x2.
    let left = if cell == 0 {
        first += 2.0 * before;
        second -= before;
        before = 0.0;
        cell
    } else {
        cell - 1
    };
    let right = if cell + 2 >= side {
        second += 2.0 * after;
        first -= after;
        after = 0.0;
        cell + 1
    } else {
        cell + 2
    };
    [(left, before), (cell, first), (cell + 1, second), (right, after)]
}

#[cfg(test)]
mod tests {
    use crate::wavelet_texture::layout::*;

    #[test]
    fn grids_are_read_as_planes() {
        // A linear function of (u, v) comes back everywhere, the borders included.
        let value = |i: usize| ((i % 4) as f32 + 0.5) / 4.0 * 2.0 - ((i / 4) as f32 + 0.5) / 4.0;
        let grid: Vec<[f32; 3]> = (0..16).map(|i| [value(i); 3]).collect();
        for (u, v) in [(0.0, 0.0), (1.0, 0.3), (0.51, 0.77), (1.0, 1.0)] {
            assert!((interpolate_grid(2, [u, v], &grid)[1] as f64 - (2.0 * u - v)).abs() < 1e-6);
        }
    }
}
