//! The reflection model of the `wavelet-texture` profile as coded numbers: `K_d` at each sample, `K_s` and `sigma` at each vertex.

use super::layout::{PatchLayout, interpolate_grid};
use super::stream::{VolumeModels, code_volume};
use crate::elementary;
use crate::entropy::{BitCoder, NumberModel};
use crate::quantise::dead_zone::DeadZone;
use crate::reflectance::TorranceSparrowLobe;
use crate::surface::patches::PatchPoint;
use crate::transform::colour::{self, ColourRotation};
use crate::transform::daubechies::{self, VolumeShape};
use crate::vector::direction;
use crate::vector::dot;
use crate::views::View;

/// Smallest cosine of the angle of view that the model divides by.
const MIN_COSINE: f64 = 0.05;
/// Levels of `sqrt(K_s)`.
const SPECULAR_LEVELS: f32 = 255.0;
/// Levels of `ln sigma`.
const SIGMA_LEVELS: u8 = 63;
/// `ln sigma` of the level 0, `ln 0.02`: 0xC07A5E96.
const MIN_LOG_SIGMA: f32 = -3.912_023;
/// From one level of `ln sigma` to the next, `ln 40 / 63`: 0x3D6FD5F2.
const LOG_SIGMA_STEP: f32 = 0.058_553_644;

/// The model as the file holds it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CodedReflectionModel {
    /// `K_d` of the signal 1.
    pub diffuse_scale: f32,
    /// Step of the wavelet coefficients of `sqrt(K_d / diffuse_scale)`.
    pub diffuse_step: f32,
    /// Colour axes of `sqrt(K_d / diffuse_scale)`.
    pub rotation: ColourRotation,
    /// For each patch three planes of wavelet levels, one a colour axis.
    pub diffuse: Vec<[Vec<i32>; 3]>,
    /// `K_s` of the highest level.
    pub specular_scale: f32,
    /// For each vertex the levels of `sqrt(K_s / specular_scale)` and of `ln sigma`; empty without a specular component.
    pub lobes: Vec<[u8; 4]>,
}

/// The model, decoded.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReflectionModel {
    /// Whether the lights were known; if not `diffuse` is a radiance and there are no lobes.
    pub relightable: bool,
    /// `K_d` (or the mean radiance) at each sample of each patch, in rows.
    pub diffuse: Vec<Vec<[f32; 3]>>,
    /// The lobe at each vertex; empty without a specular component.
    pub lobes: Vec<VertexLobe>,
}

/// Highlight at a vertex, as it is interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VertexLobe {
    /// `K_s`, red, green, blue, not negative.
    pub specular: [f32; 3],
    /// Natural logarithm of `sigma` in radians.
    pub log_sigma: f32,
}

impl CodedReflectionModel {
    fn quantiser(&self) -> DeadZone {
        DeadZone { threshold: 0.5 * self.diffuse_step, step: self.diffuse_step }
    }
    /// Codes everything but the scales and steps. In decoding the vectors have their final lengths already, all zero.
    pub(super) fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        layout: &PatchLayout,
        healthy: impl Fn(&C) -> bool,
    ) -> bool {
        let mut models = VolumeModels::new(1);
        for (planes, &side_log2) in self.diffuse.iter_mut().zip(&layout.side_log2) {
            code_volume(coder, &mut models, planes, 1, VolumeShape { side_log2, views: 1, view_levels: 0 });
            if !healthy(coder) {
                return false;
            }
        }
        if !self.lobes.is_empty() {
            // Each vertex is predicted by the mean of those neighbours that have been coded.
            let mut adjacent = vec![([0u32; 4], 0u32); self.lobes.len()];
            let mut order: Vec<(u32, u32)> = Vec::with_capacity(layout.mesh.triangles.len() * 3);
            for v in &layout.mesh.triangles {
                for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
                    order.push((a.min(b), a.max(b)));
                }
            }
            order.sort_unstable();
            order.dedup();
            let mut numbers: [NumberModel; 4] = Default::default();
            let mut edges = order.into_iter().peekable();
            let mut last = [0u8; 4];
            for vertex in 0..self.lobes.len() {
                let (sum, count) = adjacent[vertex];
                for k in 0..4 {
                    let predicted = (sum[k] + count / 2).checked_div(count).unwrap_or(last[k] as u32) as i32;
                    let difference = numbers[k].code_signed(coder, self.lobes[vertex][k] as i32 - predicted);
                    self.lobes[vertex][k] = predicted.wrapping_add(difference).clamp(0, 255) as u8;
                }
                last = self.lobes[vertex];
                while let Some((_, other)) = edges.next_if(|edge| edge.0 as usize == vertex) {
                    if let Some((sum, count)) = adjacent.get_mut(other as usize) {
                        (0..4).for_each(|k| sum[k] += last[k] as u32);
                        *count += 1;
                    }
                }
                if !healthy(coder) {
                    return false;
                }
            }
        }
        true
    }
    /// The numbers that the levels stand for.
    pub fn dequantise(&self, layout: &PatchLayout, relightable: bool) -> ReflectionModel {
        let mut scratch = Vec::new();
        let quantiser = self.quantiser();
        let diffuse = self.diffuse.iter().zip(&layout.side_log2).map(|(planes, &side_log2)| {
            let shape = VolumeShape { side_log2, views: 1, view_levels: 0 };
            let mut grid: Vec<[f32; 3]> = (0..shape.area())
                .map(|i| std::array::from_fn(|c| quantiser.dequantise(planes[c].get(i).copied().unwrap_or(0))))
                .collect();
            daubechies::inverse(&mut grid, shape, &mut scratch);
            grid.iter_mut().for_each(|axes| {
                let roots = colour::inverse(&self.rotation, *axes);
                *axes = roots.map(|s| s.max(0.0) * s.max(0.0) * self.diffuse_scale);
            });
            grid
        });
        let lobe = |levels: &[u8; 4]| {
            let root = |q: u8| q as f32 / SPECULAR_LEVELS;
            VertexLobe {
                specular: std::array::from_fn(|c| root(levels[c]) * root(levels[c]) * self.specular_scale),
                log_sigma: MIN_LOG_SIGMA + LOG_SIGMA_STEP * levels[3].min(SIGMA_LEVELS) as f32,
            }
        };
        ReflectionModel { relightable, diffuse: diffuse.collect(), lobes: self.lobes.iter().map(lobe).collect() }
    }
    /// Quantises a model; `diffuse_step` is the step of the signal `sqrt(K_d / max K_d)`.
    #[cfg(feature = "encode")]
    pub fn quantise(model: &ReflectionModel, layout: &PatchLayout, diffuse_step: f32) -> CodedReflectionModel {
        let diffuse_scale = 1.2 * high(model.diffuse.iter().flatten().flatten().copied());
        let specular_scale = 1.2 * high(model.lobes.iter().flat_map(|l| l.specular));
        let roots = |diffuse: &[f32; 3]| diffuse.map(|k| (k / diffuse_scale).min(1.0).sqrt());
        let mut moments = [[0.0f64; 3]; 3];
        for s in model.diffuse.iter().flatten().map(roots) {
            (0..9).for_each(|k| moments[k / 3][k % 3] += s[k / 3] as f64 * s[k % 3] as f64);
        }
        let rotation = colour::principal_axes(moments);
        let mut coded =
            CodedReflectionModel { diffuse_scale, diffuse_step, rotation, specular_scale, ..Default::default() };
        let quantiser = coded.quantiser();
        let mut scratch = Vec::new();
        for (grid, &side_log2) in model.diffuse.iter().zip(&layout.side_log2) {
            let shape = VolumeShape { side_log2, views: 1, view_levels: 0 };
            let mut axes: Vec<[f32; 3]> = grid.iter().map(|k| colour::forward(&rotation, roots(k))).collect();
            daubechies::forward(&mut axes, shape, &mut scratch);
            coded.diffuse.push(std::array::from_fn(|c| axes.iter().map(|a| quantiser.quantise(a[c])).collect()));
        }
        for lobe in &model.lobes {
            let specular =
                lobe.specular.map(|k| ((k / specular_scale).min(1.0).sqrt() * SPECULAR_LEVELS).round() as u8);
            let sigma = ((lobe.log_sigma - MIN_LOG_SIGMA) / LOG_SIGMA_STEP).round() as u8;
            coded.lobes.push([specular[0], specular[1], specular[2], sigma.min(SIGMA_LEVELS)]);
        }
        coded
    }
}

/// The value that one in 500 exceeds: few points seen at grazing angles only shall not coarsen the levels of all.
#[cfg(feature = "encode")]
fn high(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.filter(|v| v.is_finite() && *v > 0.0).collect();
    if values.is_empty() {
        return 1e-12;
    }
    let rank = (values.len() - 1) - values.len() / 500;
    *values.select_nth_unstable_by(rank, f32::total_cmp).1
}

impl ReflectionModel {
    /// Modelled radiance of the diffuse (or only) component at a grid sample.
    pub(super) fn diffuse_sample(
        &self,
        layout: &PatchLayout,
        patch: usize,
        index: usize,
        point: &PatchPoint,
        view: &View,
    ) -> [f32; 3] {
        self.shade(layout, patch, point, view, self.diffuse[patch][index])
    }
    /// Modelled radiance of the diffuse (or only) component anywhere on a patch.
    pub(super) fn diffuse_at(
        &self,
        layout: &PatchLayout,
        patch: usize,
        point: &PatchPoint,
        at: [f64; 2],
        view: &View,
    ) -> [f32; 3] {
        let diffuse = interpolate_grid(layout.side_log2[patch], at, &self.diffuse[patch]);
        self.shade(layout, patch, point, view, diffuse.map(|k| k.max(0.0)))
    }
    fn shade(
        &self,
        layout: &PatchLayout,
        patch: usize,
        point: &PatchPoint,
        view: &View,
        diffuse: [f32; 3],
    ) -> [f32; 3] {
        match (self.relightable, &view.light) {
            (false, _) => diffuse,
            (true, None) => [0.0; 3],
            (true, Some(light)) => {
                let (position, normal) = layout.position_and_normal(patch, point);
                let (to_light, squared) = direction(position, light.position);
                let cosine = dot(normal, to_light);
                if cosine > 0.0 {
                    std::array::from_fn(|c| (diffuse[c] as f64 * (light.intensity[c] / squared) * cosine) as f32)
                } else {
                    [0.0; 3]
                }
            }
        }
    }
    /// Modelled radiance of the specular component, `K_s E / cos(theta_r) exp(-alpha^2 / (2 sigma^2))`; zero where the light or the
    /// camera is behind the surface.
    pub(super) fn specular_at(&self, layout: &PatchLayout, patch: usize, point: &PatchPoint, view: &View) -> [f32; 3] {
        let (Some(light), false) = (&view.light, self.lobes.is_empty()) else { return [0.0; 3] };
        let (position, normal) = layout.position_and_normal(patch, point);
        let (to_light, squared) = direction(position, light.position);
        let (to_view, _) = direction(position, view.camera.centre());
        let (cos_light, cos_view) = (dot(normal, to_light), dot(normal, to_view));
        if !(cos_light > 0.0 && cos_view > 0.0) {
            return [0.0; 3];
        }
        let half: [f64; 3] = std::array::from_fn(|i| to_light[i] + to_view[i]);
        let squared_angle = elementary::squared_angle(dot(normal, half) / dot(half, half).sqrt());
        let lobe = self.interpolate(layout, patch, point);
        let sharpness = elementary::exp(-2.0 * lobe.log_sigma as f64);
        let cos_view = if cos_view > MIN_COSINE { cos_view } else { MIN_COSINE };
        let shape = elementary::exp(-0.5 * squared_angle * sharpness) / cos_view;
        std::array::from_fn(|c| (lobe.specular[c] as f64 * (light.intensity[c] / squared) * shape) as f32)
    }
    /// The lobe at a point.
    pub fn lobe_at(&self, layout: &PatchLayout, patch: usize, point: &PatchPoint) -> TorranceSparrowLobe {
        let VertexLobe { specular, log_sigma } = self.interpolate(layout, patch, point);
        TorranceSparrowLobe { specular, sigma: elementary::exp(log_sigma as f64) as f32 }
    }
    fn interpolate(&self, layout: &PatchLayout, patch: usize, point: &PatchPoint) -> VertexLobe {
        let mut lobe = VertexLobe::default();
        for (corner, weight) in layout.patches[patch].corners.iter().zip(point.weights) {
            let weight = weight as f32;
            let at = self.lobes[*corner as usize];
            (0..3).for_each(|c| lobe.specular[c] += weight * at.specular[c]);
            lobe.log_sigma += weight * at.log_sigma;
        }
        lobe
    }
}
