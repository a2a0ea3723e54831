//! Fitting classical models to tables.
//!
//! Levenberg-Marquardt on logarithms of colours and shape, from several widths; the best is kept. What is minimised is a choice: most
//! cells of a table lie near the highlight, many at grazing angles, so that the best log RMSE and the best picture are far apart where
//! a model can't follow the material.

use super::{ClassicalForm, ClassicalModel, ScatteringAngles};
use crate::brdf::merl::{MerlGrid, MerlTable, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use crate::brdf::{BrdfSample, MeasuredSample};
use crate::optimise::levenberg_marquardt::{Minimum, minimise};
use crate::{Error, Result};
use std::f64::consts::PI;

/// Error that a fit minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FitObjective {
    /// Log RMSE of the error report: the mean square of `ln(1 + f cos) - ln(1 + f' cos)` over valid cells, colours together.
    Logarithm,
    /// The mean square of differences as a picture shows them: of `(x / (x + white))^(1/2.2)`, `x = f cos`, each cell with the area of
    /// half vectors and difference vectors that it stands for.
    Picture,
    /// The first plus 30 times the second, which makes them about equal.
    #[default]
    Both,
}

impl FitObjective {
    /// Weights of the two mean squares.
    fn weights(self) -> [f64; 2] {
        match self {
            FitObjective::Logarithm => [1.0, 0.0],
            FitObjective::Picture => [0.0, 1.0],
            FitObjective::Both => [1.0, 30.0],
        }
    }
}

/// A cell as the fit sees it.
struct FitSample {
    geometry: ScatteringAngles,
    /// The BRDF, red, green, blue.
    value: [f64; 3],
    /// Area of half vectors and difference vectors that it stands for, to a common factor.
    area: f64,
    /// Factor of both weights, 0 to 1: less where the value is noisy.
    certainty: f64,
    /// The measured signals, see [`FitSignal`].
    signals: [[f64; 3]; 2],
    /// Their weights.
    weights: [f64; 2],
}

/// Function of `f cos` whose differences are minimised.
#[derive(Clone, Copy)]
enum FitSignal {
    Logarithm,
    Picture { white: f64 },
}

impl FitSignal {
    /// The signal and its derivative.
    fn with_derivative(self, x: f64) -> (f64, f64) {
        match self {
            FitSignal::Logarithm => (x.ln_1p(), 1.0 / (1.0 + x)),
            FitSignal::Picture { white } => {
                const GAMMA: f64 = 1.0 / 2.2;
                let x = x.max(1e-4 * white);
                let share = x / (x + white);
                let signal = share.powf(GAMMA);
                (signal, GAMMA * signal / share * white / ((x + white) * (x + white)))
            }
        }
    }
}

/// A pair of directions with the value measured there, for materials whose azimuth matters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredPair {
    /// Unit vector to the light.
    pub incoming: [f64; 3],
    /// Unit vector to the viewer.
    pub outgoing: [f64; 3],
    /// The BRDF, per steradian, red, green, blue.
    pub value: [f64; 3],
}

/// Fits a model to a table. Tables are isotropic: an anisotropic form sees them at many azimuths and finds two equal widths.
///
/// # Errors
/// [`Error::Parameter`] where the table has too few valid cells.
pub fn fit_classical(table: &MerlTable, form: ClassicalForm, objective: FitObjective) -> Result<ClassicalModel> {
    let mut samples = gather(table, [3, 3, 30]);
    if form.is_anisotropic() {
        for (n, sample) in samples.iter_mut().enumerate() {
            // Azimuths of the half vector as even as can be, by the golden section.
            let (sine, cosine) = (n as f64 * 0.618_033_988_749_895 * 2.0 * PI).sin_cos();
            let [x, y] = sample.geometry.half;
            sample.geometry.half = [cosine * x - sine * y, sine * x + cosine * y];
        }
    }
    fit_samples(samples, form, objective)
}

/// Fits a model to values at any pairs of directions, each of the same importance to a picture. Pairs below the horizon and values that are
/// negative or not finite are left out.
///
/// # Errors
/// [`Error::Parameter`] where fewer than [`ClassicalForm::min_samples`] pairs remain.
pub fn fit_classical_pairs(
    pairs: &[MeasuredPair],
    form: ClassicalForm,
    objective: FitObjective,
) -> Result<ClassicalModel> {
    let usable = |pair: &&MeasuredPair| {
        pair.incoming[2] > 0.0 && pair.outgoing[2] > 0.0 && pair.value.iter().all(|x| x.is_finite() && *x >= 0.0)
    };
    let sample = |pair: &MeasuredPair| {
        let geometry = ScatteringAngles::from_directions(pair.incoming, pair.outgoing);
        FitSample::new(geometry, pair.value, 1.0)
    };
    fit_samples(pairs.iter().filter(usable).map(sample).collect(), form, objective)
}

/// Standard deviation of the logarithm that a model is wrong by: noise below it counts little.
const MODEL_DEVIATION: f64 = 0.1;

/// Fits a model to measured values, weighted by their noise, and to values that are only probable, which together count as much.
///
/// # Errors
/// [`Error::Parameter`] for fewer measured values than [`ClassicalForm::min_samples`].
pub(in crate::brdf) fn fit_classical_measured(
    measured: &[MeasuredSample],
    probable: &[BrdfSample],
    form: ClassicalForm,
    objective: FitObjective,
) -> Result<ClassicalModel> {
    check_count(measured.len(), form)?;
    let brightness = |value: [f64; 3]| value.into_iter().fold(0.0, f64::max);
    let of_measured = |sample: &MeasuredSample| {
        let geometry = ScatteringAngles::from_directions(sample.incoming, sample.outgoing);
        let noise = brightness(sample.deviation) / brightness(sample.value).max(1e-6);
        let certainty = 1.0 / (1.0 + (noise / MODEL_DEVIATION).powi(2));
        FitSample { certainty, ..FitSample::new(geometry, sample.value, 1.0) }
    };
    let mut samples: Vec<FitSample> = measured.iter().map(of_measured).collect();
    let certainty = measured.len() as f64 / probable.len().max(1) as f64;
    samples.extend(probable.iter().map(|sample| FitSample { certainty, ..FitSample::of_isotropic(sample) }));
    fit_samples(samples, form, objective)
}

/// Fits an isotropic model to values at angles.
///
/// # Errors
/// [`Error::Parameter`] for fewer than [`ClassicalForm::min_samples`].
pub(in crate::brdf) fn fit_classical_samples(
    samples: &[BrdfSample],
    form: ClassicalForm,
    objective: FitObjective,
) -> Result<ClassicalModel> {
    let usable = samples.iter().filter(|s| s.value.iter().all(|x| x.is_finite() && *x >= 0.0));
    fit_samples(usable.map(FitSample::of_isotropic).collect(), form, objective)
}

impl FitSample {
    fn new(geometry: ScatteringAngles, value: [f64; 3], area: f64) -> Self {
        FitSample { geometry, value, area, certainty: 1.0, signals: [[0.0; 3]; 2], weights: [0.0; 2] }
    }

    fn of_isotropic(sample: &BrdfSample) -> Self {
        let (sin_h, sin_d) = (sample.theta_h.sin(), sample.theta_d.sin());
        let geometry = ScatteringAngles {
            cos_incoming: sample.cos_incoming,
            cos_outgoing: sample.cos_outgoing,
            cos_half: sample.theta_h.cos(),
            cos_difference: sample.theta_d.cos(),
            half: [sin_h, 0.0],
        };
        // Bins of theta_h are as wide as the root of theta_h is large.
        FitSample::new(geometry, sample.value, sin_h * sample.theta_h.sqrt() * sin_d * sample.theta_d.cos())
    }
}

fn check_count(count: usize, form: ClassicalForm) -> Result<()> {
    let needed = form.min_samples();
    if count < needed {
        let message = format!("{count} valid values are too few for a fit: form {} takes {needed}", form.name());
        return Err(Error::parameter(message));
    }
    Ok(())
}

fn fit_samples(mut samples: Vec<FitSample>, form: ClassicalForm, objective: FitObjective) -> Result<ClassicalModel> {
    check_count(samples.len(), form)?;
    let signals = prepare(&mut samples, objective);
    let coarse: Vec<&FitSample> = samples.iter().step_by(samples.len().div_ceil(1000).min(7)).collect();
    let all: Vec<&FitSample> = samples.iter().collect();
    let widths: &[f64] = if form == ClassicalForm::Lambert { &[1.0] } else { &[0.02, 0.06, 0.2, 0.5] };
    // A few steps from each width, on some of the samples; then the best two go on, and the better of them on all.
    let mut begun: Vec<Minimum<PARAMETERS>> =
        (widths.iter()).map(|&width| improve(form, &start(form, &coarse, width), &coarse, signals, 8)).collect();
    begun.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let further = begun.iter().take(2).map(|from| improve(form, &from.parameters, &coarse, signals, 17));
    let best = further.min_by(|a, b| a.cost.total_cmp(&b.cost));
    let best = best.map(|best| improve(form, &best.parameters, &all, signals, 30));
    let best = best.ok_or_else(|| Error::parameter("nothing to fit"))?;
    Ok(model(form, &best.parameters))
}

/// Sets weights and measured signals.
fn prepare(samples: &mut [FitSample], objective: FitObjective) -> [FitSignal; 2] {
    let mut bright: Vec<(f64, f64)> = (samples.iter())
        .map(|s| (s.value.iter().copied().fold(0.0, f64::max) * s.geometry.cos_incoming, s.area))
        .collect();
    bright.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total = bright.iter().map(|(_, area)| area).sum::<f64>();
    let mut left = 0.95 * total;
    let white = bright.iter().find(|(_, area)| {
        left -= area;
        left <= 0.0
    });
    let signals = [FitSignal::Logarithm, FitSignal::Picture { white: white.map_or(1.0, |&(x, _)| x.max(1e-6)) }];
    let [log, picture] = objective.weights();
    let count = samples.len() as f64;
    for sample in samples {
        let signal =
            |signal: FitSignal| sample.value.map(|f| signal.with_derivative(f * sample.geometry.cos_incoming).0);
        sample.signals = signals.map(signal);
        sample.weights = [log / count, picture * sample.area / total.max(1e-30)].map(|w| w * sample.certainty);
    }
    signals
}

/// Logarithms of diffuse and specular colours, then the shape.
const PARAMETERS: usize = 9;

fn model(form: ClassicalForm, p: &[f64; PARAMETERS]) -> ClassicalModel {
    let lobe = form.lobe(&[p[6], p[7], p[8]]);
    let specular = if form == ClassicalForm::Lambert { [0.0; 3] } else { [3, 4, 5].map(|i| p[i].exp()) };
    ClassicalModel { diffuse: [0, 1, 2].map(|i| p[i].exp()), specular, lobe }
}

/// Cells at regular steps of the three angles, the first at half a step: the whole table in small.
fn gather(table: &MerlTable, steps: [usize; 3]) -> Vec<FitSample> {
    let grid = MerlGrid::new();
    let middles = |step: usize, bins: usize| (step / 2..bins).step_by(step);
    let mut samples = Vec::new();
    for h in middles(steps[0], THETA_H_BINS) {
        for d in middles(steps[1], THETA_D_BINS) {
            for p in middles(steps[2], PHI_D_BINS) {
                let index = (h * THETA_D_BINS + d) * PHI_D_BINS + p;
                if let Some(cell) = table.cell(index).and_then(|value| grid.cell(index, value)) {
                    let geometry = ScatteringAngles::from_half_difference(cell.angles);
                    let (sin_h, sin_d) = (cell.angles.theta_h.sin(), cell.angles.theta_d.sin());
                    // Bins of theta_h are as wide as the root of theta_h is large.
                    let area = sin_h * cell.angles.theta_h.sqrt() * sin_d * cell.angles.theta_d.cos();
                    samples.push(FitSample::new(geometry, cell.value, area));
                }
            }
        }
    }
    samples
}

/// Diffuse from what is seen away from the highlight, specular from the rest near it.
fn start(form: ClassicalForm, samples: &[&FitSample], width: f64) -> [f64; PARAMETERS] {
    let lobe = form.lobe(&[width.ln(), form.second().0, 0.0]);
    let mut p = [0.0; PARAMETERS];
    for c in 0..3 {
        let value = |s: &FitSample| s.value[c];
        let mut away: Vec<f64> = samples
            .iter()
            .filter(|s| s.geometry.cos_half < 0.9 && s.geometry.cos_incoming > 0.2)
            .map(|s| value(s))
            .collect();
        away.sort_by(f64::total_cmp);
        let diffuse = away.get(away.len() / 2).copied().unwrap_or(0.1).max(1e-5);
        let (mut product, mut square) = (0.0, 1e-30);
        for s in samples.iter().filter(|s| s.geometry.cos_incoming > 0.2) {
            let l = lobe.scalar(&s.geometry);
            // Small values as they are, large ones held down, as the logarithm does.
            let weight = 1.0 / (1.0 + l);
            product += weight * l * (value(s) - diffuse).max(0.0);
            square += weight * l * l;
        }
        p[c] = (diffuse * PI).ln();
        p[3 + c] = (product / square).clamp(1e-6, 1e3).ln();
    }
    p[6] = width.ln();
    p[7] = form.second().0;
    p
}

fn improve(
    form: ClassicalForm,
    from: &[f64; PARAMETERS],
    samples: &[&FitSample],
    signals: [FitSignal; 2],
    evaluations: u32,
) -> Minimum<PARAMETERS> {
    const STEP: f64 = 1e-4;
    let second = form.second().1;
    let mut bounds = [(-14.0, 3.0); PARAMETERS];
    bounds[3..6].fill((-16.0, 8.0));
    bounds[6] = (0.002f64.ln(), 1.5f64.ln());
    bounds[7] = second;
    bounds[8] = if form.is_anisotropic() { (-4.0, 4.0) } else { (0.0, 0.0) };
    if form == ClassicalForm::Lambert {
        (3..PARAMETERS).for_each(|i| bounds[i] = (0.0, 0.0));
    }
    minimise(*from, &bounds, evaluations, |p, equations| {
        let found = model(form, p);
        let wider = form.lobe(&[p[6] + STEP, p[7], p[8]]);
        let other = form.lobe(&[p[6], p[7] + STEP, p[8]]);
        let longer = form.lobe(&[p[6], p[7], p[8] + STEP]);
        let (varies, anisotropic) = (second.0 < second.1, form.is_anisotropic());
        for sample in samples {
            let g = &sample.geometry;
            let lobe = found.lobe.scalar(g);
            let by_width = (wider.scalar(g) - lobe) / STEP;
            let by_second = if varies { (other.scalar(g) - lobe) / STEP } else { 0.0 };
            let by_ratio = if anisotropic { (longer.scalar(g) - lobe) / STEP } else { 0.0 };
            for c in 0..3 {
                let diffuse = found.diffuse[c] / PI;
                let specular = found.specular[c] * lobe;
                for k in (0..2).filter(|&k| sample.weights[k] > 0.0) {
                    let (signal, slope) = signals[k].with_derivative((diffuse + specular) * g.cos_incoming);
                    let scaled = g.cos_incoming * slope;
                    let by_shape = [by_width, by_second, by_ratio].map(|by| found.specular[c] * by);
                    let derivatives = [diffuse, specular, by_shape[0], by_shape[1], by_shape[2]].map(|d| scaled * d);
                    let residual = signal - sample.signals[k][c];
                    equations.add_sparse(residual, [c, 3 + c, 6, 7, 8], &derivatives, sample.weights[k]);
                }
            }
        }
    })
}
