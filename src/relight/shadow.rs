//! Which surface points a point light reaches: a depth map drawn from the light.

use super::cameras::{bounds, look_at};
use crate::asset::{Camera, Mesh};
use crate::surface::raster::rasterise;

/// Width and height of the depth map.
const SIDE: u32 = 1024;
/// A point is in shadow where the mesh is nearer to the light by this many widths of a depth-map pixel.
const MARGIN_PIXELS: f64 = 5.0;
/// The same where the mesh itself is shaded and casts the shadow, not a surface that was photographed.
const NARROW_MARGIN_PIXELS: f64 = 1.5;

/// The mesh as a light sees it.
pub(super) struct ShadowMap {
    camera: Camera,
    /// Depth of the nearest surface; infinite where there is none.
    depth: Vec<f32>,
    margin_pixels: f64,
}

impl ShadowMap {
    /// `None` for a light within the sphere around the mesh: nothing is shadowed then.
    pub(super) fn new(mesh: &Mesh, light: [f64; 3]) -> Option<Self> {
        let (middle, radius) = bounds(mesh);
        let gap: [f64; 3] = std::array::from_fn(|k| light[k] - middle[k]);
        let squared = gap.iter().map(|x| x * x).sum::<f64>();
        let clear = squared - 1.05 * radius * radius;
        // Any direction across the light's serves as up.
        let least = (0..3).min_by(|&a, &b| gap[a].abs().total_cmp(&gap[b].abs())).unwrap_or(0);
        let up = std::array::from_fn(|k| if k == least { 1.0 } else { 0.0 });
        (clear > 0.0 && radius > 0.0).then(|| {
            let focal = SIDE as f64 / 2.0 * clear.sqrt() / radius;
            let camera = look_at(light, middle, up, focal, SIDE, SIDE);
            let raster = rasterise(mesh, &camera);
            let depth = |k: usize| if raster.is_covered(k) { raster.depth[k] as f32 } else { f32::INFINITY };
            let depth = (0..raster.depth.len()).map(depth).collect();
            ShadowMap { camera, depth, margin_pixels: MARGIN_PIXELS }
        })
    }

    /// As [`Self::new`], for a light so far away that all its rays are nearly parallel, with a narrow margin.
    pub(super) fn distant(mesh: &Mesh, light: [f64; 3]) -> Option<Self> {
        Self::new(mesh, light).map(|map| ShadowMap { margin_pixels: NARROW_MARGIN_PIXELS, ..map })
    }

    /// Share of the light that reaches a surface point, 0 to 1: bilinear between the four depth tests around it.
    pub(super) fn reach(&self, point: [f64; 3], cos_light: f64) -> f64 {
        let Some((at, depth)) = self.camera.project(point) else { return 1.0 };
        let (x, y) = ((at[0] - 0.5).floor(), (at[1] - 0.5).floor());
        if !(x >= 0.0 && y >= 0.0 && x + 1.0 < SIDE as f64 && y + 1.0 < SIDE as f64) {
            return 1.0;
        }
        let (s, t) = (at[0] - 0.5 - x, at[1] - 0.5 - y);
        let margin = self.margin_pixels * depth / self.camera.focal[0] / cos_light.clamp(0.2, 1.0);
        let first = y as usize * SIDE as usize + x as usize;
        let lit = |index: usize| (self.depth[index] as f64 > depth - margin) as u8 as f64;
        let upper = lit(first) * (1.0 - s) + lit(first + 1) * s;
        let lower = lit(first + SIDE as usize) * (1.0 - s) + lit(first + SIDE as usize + 1) * s;
        upper * (1.0 - t) + lower * t
    }
}
