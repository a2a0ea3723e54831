//! The photographs' say: how the error at each vertex changes with its normal and its displacement.
//!
//! Residuals are `a sqrt(s(n)) - Q_D(x)` and `sqrt(h(n) + floor) - Q_S(x)` with the roots `Q` of the photographs' radiance at the
//! vertex's position `x`, the shading `s` of Lambert's model under a dielectric surface and the lobes' sum `h`. Cauchy's loss bounds the
//! influence of what the model does not hold. The root of the albedo `a` is eliminated (Schur complement).

use super::signal_view::{SPECULAR_FLOOR, Sighting, SignalView};
use crate::parallel;
use crate::reflectance::lobes::{LOBES, LobeCosines, transmission, weighted_lobes};

/// Least cosine of a view that counts.
pub(super) const MIN_COS_VIEW: f64 = 0.2;
/// Share of the specular component's error.
const SPECULAR_SHARE: f64 = 0.5;
/// Least root of an albedo.
const MIN_ROOT: f64 = 0.02;
/// Views that must show a vertex before its diffuse part counts.
const MIN_VIEWS: usize = 3;
/// Vertices to a task.
const RUN: usize = 256;

/// Normal equations of one vertex: unknown are the three numbers of its normal, not constrained, and its displacement.
#[derive(Clone, Copy, Default)]
pub(super) struct VertexEvidence {
    /// Upper triangle, row by row.
    pub(super) hessian: [f32; 10],
    pub(super) gradient: [f64; 4],
    /// Root of the albedo over white; 0 where too few views show the vertex.
    pub(super) root: f32,
    /// Losses of the diffuse and the specular component, and the sum of the weights.
    pub(super) loss: [f64; 3],
}

/// A surface as far as it is known.
pub(super) struct SurfaceState<'a> {
    pub(super) points: &'a [[f64; 3]],
    pub(super) normals: &'a [[f64; 3]],
    /// Directions of displacement.
    pub(super) along: &'a [[f64; 3]],
    /// Lobes of each vertex.
    pub(super) weights: &'a [[[f32; LOBES]; 1]],
}

/// Scales of the losses, of the roots of radiance: beyond them a residual is an outlier.
#[derive(Clone, Copy)]
pub(super) struct LossScales {
    pub(super) diffuse: f64,
    pub(super) specular: f64,
}

/// Diffuse part of a sighting: root of the shading with its derivatives by the normal, root of the photograph's radiance and its
/// derivative by the displacement.
struct DiffuseResidual {
    shading: f64,
    by_normal: [f64; 3],
    seen: f64,
    seen_slope: f64,
    weight: f64,
}

/// Gathers the evidence of all vertices; `roots` are those of the albedo from the last time, or empty.
pub(super) fn gather(
    views: &[SignalView],
    state: &SurfaceState,
    roots: &[f32],
    scales: LossScales,
) -> Vec<VertexEvidence> {
    let count = state.points.len();
    let runs = parallel::map(count.div_ceil(RUN), |run| {
        let mut diffuse = Vec::with_capacity(views.len());
        let range = run * RUN..((run + 1) * RUN).min(count);
        range
            .map(|vertex| {
                diffuse.clear();
                let mut evidence = VertexEvidence::default();
                let mut hessian = [[0.0; 4]; 4];
                for view in views {
                    let (point, normal) = (state.points[vertex], state.normals[vertex]);
                    let Some(sighting) = view.sight(point, normal, MIN_COS_VIEW) else { continue };
                    let seen = view.roots(&sighting);
                    let slopes = view.slopes(&sighting, state.along[vertex]);
                    diffuse.push(diffuse_residual(&sighting, seen[0], slopes[0]));
                    let (residual, by_normal) = specular_residual(&sighting, seen[1], &state.weights[vertex][0]);
                    let jacobian = [by_normal[0], by_normal[1], by_normal[2], -slopes[1]];
                    let (weight, loss) = cauchy(residual, scales.specular, SPECULAR_SHARE * sighting.weight);
                    evidence.loss[1] += loss;
                    evidence.loss[2] += sighting.weight;
                    add(&mut hessian, &mut evidence.gradient, &jacobian, residual, weight);
                }
                if diffuse.len() >= MIN_VIEWS {
                    let start = roots.get(vertex).copied().unwrap_or(0.0) as f64;
                    add_diffuse(&diffuse, start, scales.diffuse, &mut hessian, &mut evidence);
                }
                let mut packed = (0..4).flat_map(|i| (i..4).map(move |j| (i, j)));
                evidence.hessian = std::array::from_fn(|_| packed.next().map_or(0.0, |(i, j)| hessian[i][j] as f32));
                evidence
            })
            .collect::<Vec<_>>()
    });
    runs.concat()
}

fn diffuse_residual(sighting: &Sighting, seen: f64, seen_slope: f64) -> DiffuseResidual {
    let [cos_view, cos_light, _] = sighting.cosines;
    let (light, light_slope) = transmission(cos_light);
    let (view, view_slope) = transmission(cos_view);
    let shading = (sighting.irradiance * cos_light * light * view).sqrt();
    let scale = 0.5 / shading * sighting.irradiance;
    let by_light = scale * (light + cos_light * light_slope) * view;
    let by_view = scale * cos_light * light * view_slope;
    let [to_view, to_light, _] = sighting.directions;
    let by_normal = std::array::from_fn(|k| by_light * to_light[k] + by_view * to_view[k]);
    DiffuseResidual { shading, by_normal, seen, seen_slope, weight: sighting.weight }
}

fn specular_residual(sighting: &Sighting, seen: f64, weights: &[f32; LOBES]) -> (f64, [f64; 3]) {
    let [view, light, half] = sighting.cosines;
    let (sum, slope) = weighted_lobes(&LobeCosines { light, view, half }, weights);
    let root = (sum * sighting.irradiance + SPECULAR_FLOOR).sqrt();
    let scale = 0.5 / root * sighting.irradiance;
    let [to_view, to_light, half] = sighting.directions;
    let by_normal =
        std::array::from_fn(|k| scale * (slope.view * to_view[k] + slope.light * to_light[k] + slope.half * half[k]));
    (root - seen, by_normal)
}

/// Weight and value of Cauchy's loss.
#[inline]
fn cauchy(residual: f64, scale: f64, weight: f64) -> (f64, f64) {
    let ratio = residual / scale;
    let squared = 1.0 + ratio * ratio;
    (weight / squared, weight * scale * scale * squared.ln())
}

#[inline]
fn add(hessian: &mut [[f64; 4]; 4], gradient: &mut [f64; 4], jacobian: &[f64; 4], residual: f64, weight: f64) {
    for i in 0..4 {
        let scaled = weight * jacobian[i];
        gradient[i] += scaled * residual;
        (i..4).for_each(|j| hessian[i][j] += scaled * jacobian[j]);
    }
}

/// Root of the albedo that fits best, from `start` or, where that is 0, from least squares.
fn best_root(diffuse: &[DiffuseResidual], start: f64, scale: f64) -> f64 {
    let mut root = start;
    for pass in 0..4 {
        let (mut product, mut square) = (0.0, 0.0);
        for d in diffuse {
            let ratio = if pass == 0 && start <= 0.0 { 0.0 } else { (root * d.shading - d.seen) / scale };
            let weight = d.weight / (1.0 + ratio * ratio);
            product += weight * d.shading * d.seen;
            square += weight * d.shading * d.shading;
        }
        root = (product / square).max(MIN_ROOT);
    }
    root
}

fn add_diffuse(
    diffuse: &[DiffuseResidual],
    start: f64,
    scale: f64,
    hessian: &mut [[f64; 4]; 4],
    evidence: &mut VertexEvidence,
) {
    let root = best_root(diffuse, start, scale);
    evidence.root = root as f32;
    let (mut own, mut own_gradient, mut mixed) = (0.0, 0.0, [0.0; 4]);
    for d in diffuse {
        let residual = root * d.shading - d.seen;
        let (weight, loss) = cauchy(residual, scale, d.weight);
        evidence.loss[0] += loss;
        let [x, y, z] = d.by_normal.map(|x| root * x);
        let jacobian = [x, y, z, -d.seen_slope];
        own += weight * d.shading * d.shading;
        own_gradient += weight * d.shading * residual;
        (0..4).for_each(|i| mixed[i] += weight * d.shading * jacobian[i]);
        add(hessian, &mut evidence.gradient, &jacobian, residual, weight);
    }
    for i in 0..4 {
        evidence.gradient[i] -= mixed[i] * own_gradient / own;
        (i..4).for_each(|j| hessian[i][j] -= mixed[i] * mixed[j] / own);
    }
}

/// Losses of views under a model fitted to others: mean of both components' for a weight of 1.
pub(super) fn loss(views: &[SignalView], state: &SurfaceState, roots: &[f32], scales: LossScales) -> f64 {
    let count = state.points.len();
    let runs = parallel::map(count.div_ceil(RUN), |run| {
        let mut sum = [0.0; 2];
        for vertex in (run * RUN..((run + 1) * RUN).min(count)).filter(|&vertex| roots[vertex] > 0.0) {
            for view in views {
                let (point, normal) = (state.points[vertex], state.normals[vertex]);
                let Some(sighting) = view.sight(point, normal, MIN_COS_VIEW) else { continue };
                let seen = view.roots(&sighting);
                let d = diffuse_residual(&sighting, seen[0], 0.0);
                let diffuse = roots[vertex] as f64 * d.shading - d.seen;
                let specular = specular_residual(&sighting, seen[1], &state.weights[vertex][0]).0;
                sum[0] += cauchy(diffuse, scales.diffuse, sighting.weight).1;
                sum[0] += cauchy(specular, scales.specular, SPECULAR_SHARE * sighting.weight).1;
                sum[1] += sighting.weight;
            }
        }
        sum
    });
    let [loss, weight] = runs.iter().fold([0.0; 2], |sum, run| [sum[0] + run[0], sum[1] + run[1]]);
    if weight > 0.0 { loss / weight } else { 0.0 }
}
