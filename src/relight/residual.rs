//! The residual of captured views, and reading it at surface points.

use crate::asset::{Camera, Photograph};
use crate::image::{Grid, Mask, RgbImage};
use crate::surface::raster::Raster;

/// A captured view counts less within this many pixels of its silhouettes, depth edges and missing pixels.
const FEATHER: usize = 4;
/// A surface point is hidden from a view where the mesh is nearer by this many pixel widths.
const MARGIN_PIXELS: f64 = 6.0;

/// A captured view, ready to be read.
pub(super) struct Captured<'a> {
    pub(super) camera: Camera,
    raster: Raster,
    mask: &'a Mask,
    /// Photograph minus model per component; missing where the confidence is 0.
    residual: Vec<RgbImage>,
    /// The model, likewise.
    model: Vec<RgbImage>,
    /// 0 where the view says nothing, 1 away from silhouettes.
    confidence: Grid<f32>,
}

/// One component of a captured view at a surface point.
#[derive(Clone, Copy, Default)]
pub(super) struct Shown {
    pub(super) residual: [f32; 3],
    pub(super) model: [f32; 3],
}

/// What a view says about a surface point.
pub(super) enum Sight {
    /// Not in the picture, or hidden.
    Unseen,
    /// Visible by the mesh, but the mask says that the object is not there.
    Cut,
    /// Residual and model per component, and how far they can be trusted, 0 to 1.
    Seen([Shown; 2], f32),
}

impl<'a> Captured<'a> {
    /// `residual` is NaN where the photograph is missing.
    pub(super) fn new(
        camera: Camera,
        raster: Raster,
        photograph: &'a Photograph,
        residual: Vec<RgbImage>,
        model: Vec<RgbImage>,
    ) -> Self {
        let (width, height) = (raster.width, raster.height);
        let valid = |k: usize| {
            raster.is_covered(k)
                && photograph.mask.data[k]
                && residual.iter().all(|image| image.data[k].iter().all(|x| x.is_finite()))
        };
        // Distance to the nearest pixel that is not valid, in rings; the first ring at depth edges.
        let mut ring: Vec<u8> = (0..width * height).map(|k| if valid(k) { u8::MAX } else { 0 }).collect();
        let margin = MARGIN_PIXELS / camera.focal[0].abs();
        let around = |k: usize| {
            let (x, y) = (k % width, k / width);
            [(-1, 0), (1, 0), (0, -1), (0, 1)].into_iter().filter_map(move |(dx, dy)| {
                let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
                (x < width && y < height).then_some(y * width + x)
            })
        };
        for k in 0..ring.len() {
            if ring[k] == u8::MAX {
                let depth = raster.depth[k];
                let edge = |n: usize| raster.is_covered(n) && (raster.depth[n] - depth).abs() > margin * depth;
                if around(k).any(edge) {
                    ring[k] = 1;
                }
            }
        }
        for step in 1..FEATHER as u8 {
            for k in 0..ring.len() {
                if ring[k] == u8::MAX && around(k).any(|n| ring[n] == step - 1) {
                    ring[k] = step;
                }
            }
        }
        let share = |r: u8| (r as f32 / FEATHER as f32).min(1.0);
        let confidence = Grid { width, height, data: ring.into_iter().map(share).collect() };
        Captured { camera, raster, mask: &photograph.mask, residual, model, confidence }
    }

    /// What the view shows at a surface point: cubic between pixels where all around can be read, else bilinear.
    pub(super) fn look(&self, point: [f64; 3]) -> Sight {
        let Some((at, depth)) = self.camera.project(point) else { return Sight::Unseen };
        let (width, height) = (self.raster.width, self.raster.height);
        let (left, top) = ((at[0] - 0.5).floor(), (at[1] - 0.5).floor());
        if !(left >= 0.0 && top >= 0.0 && left + 1.0 < width as f64 && top + 1.0 < height as f64) {
            return Sight::Unseen;
        }
        let (s, t) = (at[0] - 0.5 - left, at[1] - 0.5 - top);
        let (x, y) = (left as usize, top as usize);
        let margin = MARGIN_PIXELS * depth / self.camera.focal[0].abs();
        let near = |k: usize| self.raster.is_covered(k) && (self.raster.depth[k] - depth).abs() < margin;
        let readable = |k: usize| self.confidence.data[k] > 0.0 && near(k);
        let mut sum = [Shown::default(); 2];
        let mut total = 0f32;
        let mut confidence = 0f32;
        let mut add = |k: usize, weight: f32| {
            for (sum, (residual, model)) in sum.iter_mut().zip(self.residual.iter().zip(&self.model)) {
                for c in 0..3 {
                    sum.residual[c] += weight * residual.data[k][c];
                    sum.model[c] += weight * model.data[k][c];
                }
            }
            total += weight;
            confidence += weight * self.confidence.data[k];
        };
        let inner = x >= 1 && y >= 1 && x + 2 < width && y + 2 < height;
        let all = || (0..4).all(|j| (0..4).all(|i| readable((y + j - 1) * width + x + i - 1)));
        if inner && all() {
            let (columns, rows) = (catmull_rom(s), catmull_rom(t));
            for j in 0..4 {
                for i in 0..4 {
                    add((y + j - 1) * width + x + i - 1, (rows[j] * columns[i]) as f32);
                }
            }
            return Sight::Seen(sum, confidence);
        }
        let taps = [
            (y * width + x, (1.0 - s) * (1.0 - t)),
            (y * width + x + 1, s * (1.0 - t)),
            ((y + 1) * width + x, (1.0 - s) * t),
            ((y + 1) * width + x + 1, s * t),
        ];
        for (k, weight) in taps {
            if readable(k) {
                add(k, weight as f32);
            }
        }
        if total > 0.02 {
            let scaled = |x: [f32; 3]| x.map(|x| x / total);
            let sum = sum.map(|s| Shown { residual: scaled(s.residual), model: scaled(s.model) });
            return Sight::Seen(sum, confidence.max(1e-4));
        }
        let cut = taps.iter().all(|&(k, weight)| weight < 1e-6 || (near(k) && !self.mask.data[k]));
        if cut { Sight::Cut } else { Sight::Unseen }
    }
}

/// Weights of four samples in a row for a position `t` of the way from the second to the third.
fn catmull_rom(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t + 2.0 * t2 - t3), 0.5 * (2.0 - 5.0 * t2 + 3.0 * t3), 0.5 * (t + 4.0 * t2 - 3.0 * t3), 0.5 * (t3 - t2)]
}
