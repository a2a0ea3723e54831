//! Captured views, photograph and model, read at surface points.

use super::capture_lights::angle;
use crate::image::{Grid, RgbImage, catmull_rom};
use crate::surface::raster::Raster;
use crate::views::{Camera, Photograph};
use glam::DVec3;
use std::sync::OnceLock;

/// A captured view counts less within this many pixels of its silhouettes, depth edges and missing pixels.
const FEATHER: usize = 4;
/// A surface point is hidden from a view where the mesh is nearer by this many pixel widths.
const MARGIN_PIXELS: f64 = 6.0;

/// A captured view, ready to be read.
pub(super) struct CapturedView<'a> {
    pub(super) camera: Camera,
    pub(super) raster: Raster,
    photograph: &'a Photograph,
    /// The model per component, on the pixels of the mask that meet the mesh.
    model: Vec<RgbImage>,
    /// 0 where the view says nothing, 1 away from silhouettes.
    confidence: Grid<f32>,
    /// Share of the view's light that reaches each pixel, 1 all over where nothing can be shadowed. Only relighting asks for it.
    reach: OnceLock<Option<Grid<f32>>>,
}

/// One component of a captured view at a surface point.
#[derive(Clone, Copy, Default)]
pub(super) struct CapturedRadiance {
    pub(super) photograph: [f32; 3],
    pub(super) model: [f32; 3],
}

/// What a captured view shows at a surface point that it sees.
#[derive(Clone, Copy)]
pub(super) struct CapturedReading {
    /// Photograph and model by component.
    pub(super) components: [CapturedRadiance; 2],
    /// How far they can be trusted, above 0 to 1.
    pub(super) confidence: f32,
    /// Share of the view's light that reaches the point, where that is known.
    pub(super) reach: f32,
}

/// Captured views by the angle at a surface point between their camera and another, the nearest first.
pub(super) fn nearest_first<'r, 'a>(
    captured: &[&'r CapturedView<'a>],
    point: [f64; 3],
    centre: [f64; 3],
) -> Vec<(f64, &'r CapturedView<'a>)> {
    let point = DVec3::from_array(point);
    let towards = |centre: [f64; 3]| (DVec3::from_array(centre) - point).normalize_or_zero();
    let wanted = towards(centre);
    let mut order: Vec<_> = captured.iter().map(|c| (angle(towards(c.camera.centre()), wanted), *c)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order
}

/// Reading of a captured view at a surface point.
pub(super) enum CapturedSample {
    /// Not in the image, or hidden.
    Unseen,
    /// Visible by the mesh, but the mask says that the object is not there.
    Cut,
    /// What it shows.
    Seen(CapturedReading),
}

impl<'a> CapturedView<'a> {
    /// Pixels that are not finite in the photograph say nothing.
    pub(super) fn new(camera: Camera, raster: Raster, photograph: &'a Photograph, model: Vec<RgbImage>) -> Self {
        let (width, height) = (raster.width, raster.height);
        let valid = |k: usize| {
            raster.is_covered(k)
                && photograph.mask.data[k]
                && photograph.images.iter().all(|image| image.data[k].iter().all(|x| x.is_finite()))
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
        CapturedView { camera, raster, photograph, model, confidence, reach: OnceLock::new() }
    }

    /// Gives the view the share of its light that reaches each pixel, unless it has it.
    pub(super) fn shadowed(&self, reach: impl FnOnce() -> Option<Grid<f32>>) {
        self.reach.get_or_init(reach);
    }

    /// Reads the view at a surface point: cubic between pixels where all around can be read, else bilinear.
    pub(super) fn sample_at(&self, point: [f64; 3]) -> CapturedSample {
        let Some((at, depth)) = self.camera.project(point) else { return CapturedSample::Unseen };
        let (width, height) = (self.raster.width, self.raster.height);
        if !(at[0] > 0.0 && at[1] > 0.0 && at[0] < width as f64 && at[1] < height as f64) {
            return CapturedSample::Unseen;
        }
        let (left, top) = ((at[0] - 0.5).floor(), (at[1] - 0.5).floor());
        let (s, t) = (at[0] - 0.5 - left, at[1] - 0.5 - top);
        let margin = MARGIN_PIXELS * depth / self.camera.focal[0].abs();
        let near = |k: usize| self.raster.is_covered(k) && (self.raster.depth[k] - depth).abs() < margin;
        let readable = |k: usize| self.confidence.data[k] > 0.0 && near(k);
        // Index of the pixel `i` right of and `j` below the upper left one of the four around.
        let pixel = |i: i64, j: i64| {
            let (x, y) = (left as i64 + i, top as i64 + j);
            (x >= 0 && y >= 0 && x < width as i64 && y < height as i64).then(|| y as usize * width + x as usize)
        };
        let mut sum = [CapturedRadiance::default(); 2];
        let mut total = 0f32;
        let mut confidence = 0f32;
        let mut reach = 0f32;
        let shares = self.reach.get().and_then(Option::as_ref);
        let mut add = |k: usize, weight: f32| {
            for (sum, (image, model)) in sum.iter_mut().zip(self.photograph.images.iter().zip(&self.model)) {
                for c in 0..3 {
                    sum.photograph[c] += weight * image.data[k][c];
                    sum.model[c] += weight * model.data[k][c];
                }
            }
            total += weight;
            confidence += weight * self.confidence.data[k];
            reach += weight * shares.map_or(1.0, |shares| shares.data[k]);
        };
        let (columns, rows) = (catmull_rom(s), catmull_rom(t));
        if (-1..3).all(|j| (-1..3).all(|i| pixel(i, j).is_some_and(readable))) {
            for (j, row) in (-1..3).zip(rows) {
                for (i, column) in (-1..3).zip(columns) {
                    if let Some(k) = pixel(i, j) {
                        add(k, (row * column) as f32);
                    }
                }
            }
            return CapturedSample::Seen(CapturedReading { components: sum, confidence, reach: reach.clamp(0.0, 1.0) });
        }
        let corners = [(0, 0, (1.0 - s) * (1.0 - t)), (1, 0, s * (1.0 - t)), (0, 1, (1.0 - s) * t), (1, 1, s * t)];
        let taps = corners.map(|(i, j, weight)| (pixel(i, j), weight));
        for (k, weight) in taps {
            if let Some(k) = k.filter(|&k| readable(k)) {
                add(k, weight as f32);
            }
        }
        if total > 0.02 {
            let scaled = |x: [f32; 3]| x.map(|x| x / total);
            let sum = sum.map(|s| CapturedRadiance { photograph: scaled(s.photograph), model: scaled(s.model) });
            let (confidence, reach) = (confidence.max(1e-4), (reach / total).clamp(0.0, 1.0));
            return CapturedSample::Seen(CapturedReading { components: sum, confidence, reach });
        }
        let masked_out = |k: usize| near(k) && !self.photograph.mask.data[k];
        let cut = taps.iter().all(|&(k, weight)| weight < 1e-6 || k.is_some_and(masked_out));
        if cut { CapturedSample::Cut } else { CapturedSample::Unseen }
    }
}
