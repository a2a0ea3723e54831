//! The atlas: which point of the surface each texel is, and reading between texels.

use super::charts::Charts;
use super::charts::NONE;
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::image::{Grid, Mask};
use crate::limits::Budget;
use crate::mesh::Mesh;
use glam::{DVec2, DVec3};

#[cfg(feature = "encode")]
pub use super::layout::layout;
#[cfg(feature = "encode")]
pub(crate) use super::layout::{layout_within, position_bits, texels_per_unit};

/// The surface point of every texel that bilinear reading anywhere on the surface may touch.
///
/// Texels whose centre no triangle covers (the border of a chart) take the nearest point of their chart.
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasRaster {
    /// Triangle of each texel, [`NONE`] for unused ones. Row by row.
    pub triangle: Grid<u32>,
    /// Weights of the triangle's second and third corner.
    pub barycentric: Grid<[f32; 2]>,
}

impl AtlasRaster {
    /// Texels in use.
    pub fn mask(&self) -> Mask {
        self.triangle.map(|&t| t != NONE)
    }
    /// Weights of the three corners at a texel.
    pub fn weights(&self, texel: usize) -> [f64; 3] {
        let [b, c] = self.barycentric.data[texel].map(f64::from);
        [1.0 - b - c, b, c]
    }
    /// World position of a texel in use.
    pub(crate) fn position(&self, mesh: &Mesh, texel: usize) -> DVec3 {
        let corners = mesh.triangles[self.triangle.data[texel] as usize];
        let weights = self.weights(texel);
        (0..3).map(|k| weights[k] * DVec3::from_array(mesh.positions[corners[k] as usize].map(f64::from))).sum()
    }
}

/// Normal between a triangle's corners.
pub(crate) fn smooth_normal(corners: [u32; 3], weights: [f64; 3], normals: &[[f64; 3]]) -> DVec3 {
    (0..3).map(|k| weights[k] * DVec3::from_array(normals[corners[k] as usize])).sum::<DVec3>().normalize_or_zero()
}

/// Atlas position, in texels, of a surface point on a triangle.
pub(crate) fn atlas_position(charts: &Charts, triangle: usize, point: DVec3) -> [f64; 2] {
    let chart = charts.charts[charts.chart_of_triangle[triangle] as usize];
    let (u, v) = match chart.facing / 2 {
        0 => (point.y, point.z),
        1 => (point.z, point.x),
        _ => (point.x, point.y),
    };
    let u = if chart.facing.is_multiple_of(2) { u } else { -u };
    let scale = charts.texels_per_unit;
    [u * scale + chart.offset[0] as f64, v * scale + chart.offset[1] as f64]
}

/// The four texels around an atlas position, `(index, weight)`; positions outside are moved to the border.
pub(crate) fn bilinear_taps(width: usize, height: usize, at: [f64; 2]) -> [(usize, f64); 4] {
    let ([x0, y0], [x1, y1], [s, t]) = bilinear_place(width, height, at);
    [
        (y0 * width + x0, (1.0 - s) * (1.0 - t)),
        (y0 * width + x1, s * (1.0 - t)),
        (y1 * width + x0, (1.0 - s) * t),
        (y1 * width + x1, s * t),
    ]
}

/// Columns and rows of the texels around an atlas position: the first and the last, and how far it lies between them.
#[inline(always)]
pub(crate) fn bilinear_place(width: usize, height: usize, at: [f64; 2]) -> ([usize; 2], [usize; 2], [f64; 2]) {
    let x = (at[0] - 0.5).clamp(0.0, (width - 1) as f64);
    let y = (at[1] - 0.5).clamp(0.0, (height - 1) as f64);
    let (x0, y0) = ((x as usize).min(width.saturating_sub(2)), (y as usize).min(height.saturating_sub(2)));
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    ([x0, y0], [x1, y1], [x - x0 as f64, y - y0 as f64])
}

/// Bilinear reading of colours.
pub(crate) fn sample_colour(grid: &Grid<[f32; 3]>, at: [f64; 2]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (index, weight) in bilinear_taps(grid.width, grid.height, at) {
        for c in 0..3 {
            sum[c] += weight * grid.data[index][c] as f64;
        }
    }
    sum
}

/// Bilinear reading of numbers.
pub(crate) fn sample_number(grid: &Grid<f32>, at: [f64; 2]) -> f64 {
    bilinear_taps(grid.width, grid.height, at).iter().map(|&(index, weight)| weight * grid.data[index] as f64).sum()
}

/// Finds the triangle and surface point of every texel. `+ - * /` in double in the order written, so that all decoders agree on the
/// mask. Charts that cover their atlas many times over (no encoder makes them) are refused.
pub fn rasterise_atlas(mesh: &Mesh, charts: &Charts) -> Result<AtlasRaster> {
    let (width, height) = (charts.width as usize, charts.height as usize);
    let mut triangle = Grid::filled(width, height, NONE);
    let mut barycentric = Grid::filled(width, height, [0f32; 2]);
    let mut distance = vec![f64::INFINITY; width * height];
    let allowed = 16 * (width * height) as u64 + 64 * (mesh.triangles.len() as u64 + 1);
    let mut work = 0u64;
    for t in 0..mesh.triangles.len() {
        let corners = charts.corners(mesh, t);
        let low = corners.iter().map(|c| c[1]).fold(f64::INFINITY, f64::min);
        let high = corners.iter().map(|c| c[1]).fold(f64::NEG_INFINITY, f64::max);
        // Texel centres within one texel of the triangle, each way.
        let first = (low - 1.5).floor().max(0.0) as usize;
        let last = ((high + 0.5).ceil().max(0.0) as usize).min(height);
        for y in first..last {
            let centre = y as f64 + 0.5;
            let Some([left, right]) = span(&corners, centre - 1.0, centre + 1.0) else { continue };
            let start = (left - 1.5).floor().max(0.0) as usize;
            let end = ((right + 0.5).ceil().max(0.0) as usize).min(width);
            work += end.saturating_sub(start) as u64 + 1;
            if work > allowed {
                return Err(Error::format(Tag::CHARTS, 0u64, "the charts cover their atlas many times over"));
            }
            for x in start..end {
                let column = x as f64 + 0.5;
                if column <= left - 1.0 || column >= right + 1.0 {
                    continue;
                }
                let (weights, square) = nearest(&corners, [column, centre]);
                let index = y * width + x;
                if square < distance[index] {
                    distance[index] = square;
                    triangle.data[index] = t as u32;
                    barycentric.data[index] = [weights[1] as f32, weights[2] as f32];
                }
            }
        }
    }
    Ok(AtlasRaster { triangle, barycentric })
}

impl Charts {
    /// Returns the texels of the atlas that lie on a triangle of `mesh`, the mesh that the charts were laid out for.
    /// # Errors
    /// [`Error::Format`] for charts that cover their atlas many times over.
    pub fn atlas_mask(&self, mesh: &Mesh) -> Result<Mask> {
        Ok(rasterise_atlas(mesh, self)?.mask())
    }
}

/// [`rasterise_atlas`] for charts out of a file: the texels are charged first.
pub fn rasterise_atlas_within(mesh: &Mesh, charts: &Charts, budget: &Budget) -> Result<AtlasRaster> {
    let texels = charts.width as u64 * charts.height as u64;
    // Triangle 4, barycentric 8, and while it runs distance 8 bytes.
    budget.charge_items("atlas texels", texels, 20)?;
    let result = rasterise_atlas(mesh, charts);
    budget.release(texels * 8);
    result
}

/// Left and right end of the part of a triangle with `low < y < high`.
fn span(corners: &[[f64; 2]; 3], low: f64, high: f64) -> Option<[f64; 2]> {
    let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
    let mut add = |x: f64| ends = [ends[0].min(x), ends[1].max(x)];
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        if a[1] > low && a[1] < high {
            add(a[0]);
        }
        for bound in [low, high] {
            if (a[1] < bound) != (b[1] < bound) {
                add(a[0] + (bound - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
            }
        }
    }
    (ends[0] <= ends[1]).then_some(ends)
}

/// Weights of the corners at the point of a triangle nearest to `point`, and its squared distance (0 inside).
fn nearest(corners: &[[f64; 2]; 3], point: [f64; 2]) -> ([f64; 3], f64) {
    let [a, b, c] = corners.map(DVec2::from_array);
    let p = DVec2::from_array(point);
    let twice = (b - a).perp_dot(c - a);
    if twice > 0.0 {
        let v = (p - a).perp_dot(c - a) / twice;
        let w = (b - a).perp_dot(p - a) / twice;
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            return ([1.0 - v - w, v, w], 0.0);
        }
    }
    let mut best = ([1.0, 0.0, 0.0], f64::INFINITY);
    for k in 0..3 {
        let (from, to) = (DVec2::from_array(corners[k]), DVec2::from_array(corners[(k + 1) % 3]));
        let edge = to - from;
        let length = edge.dot(edge);
        let s = if length > 0.0 { ((p - from).dot(edge) / length).clamp(0.0, 1.0) } else { 0.0 };
        let gap = p - (from + s * edge);
        let square = gap.dot(gap);
        if square < best.1 {
            let mut weights = [0.0; 3];
            weights[k] = 1.0 - s;
            weights[(k + 1) % 3] = s;
            best = (weights, square);
        }
    }
    best
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A closed sphere of radius about 1 with bumps, `2 n (n - 1)` triangles.
    pub(crate) fn bumpy_sphere(n: usize) -> Mesh {
        let mut mesh = Mesh::default();
        mesh.positions.push([0.0, 1.0, 0.0]);
        for i in 1..n {
            let polar = std::f64::consts::PI * i as f64 / n as f64;
            for j in 0..n {
                let around = std::f64::consts::TAU * j as f64 / n as f64;
                let r = 1.0 + 0.06 * (5.0 * around).sin() * (4.0 * polar).sin().powi(2);
                let p = [r * polar.sin() * around.sin(), r * polar.cos(), r * polar.sin() * around.cos()];
                mesh.positions.push(p.map(|x| x as f32));
            }
        }
        mesh.positions.push([0.0, -1.0, 0.0]);
        let at = |i: usize, j: usize| (1 + (i - 1) * n + j % n) as u32;
        let end = (mesh.positions.len() - 1) as u32;
        for j in 0..n {
            mesh.triangles.push([0, at(1, j), at(1, j + 1)]);
            for i in 1..n - 1 {
                mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
            mesh.triangles.push([at(n - 1, j), end, at(n - 1, j + 1)]);
        }
        mesh
    }

    #[cfg(feature = "encode")]
    #[test]
    fn texels_lie_on_the_surface() {
        let mesh = bumpy_sphere(32);
        let charts = layout(&mesh, 50.0).unwrap();
        assert!((6..=14).contains(&charts.charts.len()), "{} charts", charts.charts.len());
        let raster = rasterise_atlas(&mesh, &charts).unwrap();
        let used = raster.mask().count() as f64;
        assert!(used > 0.55 * (charts.width * charts.height) as f64, "{used} of {}", charts.width * charts.height);
        // Reading the positions back from the texels at any surface point gives that point: no chart covers another.
        let positions = Grid {
            width: raster.triangle.width,
            height: raster.triangle.height,
            data: (0..raster.triangle.data.len())
                .map(|k| match raster.triangle.data[k] {
                    NONE => [f32::NAN; 3],
                    _ => raster.position(&mesh, k).to_array().map(|x| x as f32),
                })
                .collect(),
        };
        let mut worst = 0f64;
        for t in 0..mesh.triangles.len() {
            for weights in [[0.3, 0.3, 0.4], [0.98, 0.01, 0.01], [0.01, 0.98, 0.01]] {
                let p: DVec3 = (0..3)
                    .map(|k| {
                        let v = mesh.positions[mesh.triangles[t][k] as usize];
                        weights[k] * DVec3::from_array(v.map(f64::from))
                    })
                    .sum();
                let back = DVec3::from_array(sample_colour(&positions, atlas_position(&charts, t, p)));
                let error = (back - p).length() * charts.texels_per_unit;
                assert!(error.is_finite(), "triangle {t} reads an unused texel");
                worst = worst.max(error);
            }
        }
        assert!(worst < 2.0, "{worst} texels");
    }
}
