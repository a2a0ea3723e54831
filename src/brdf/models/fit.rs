//! Fitting classical models to tables.
//!
//! Levenberg-Marquardt on logarithms of colours and shape, from several widths; the best is kept. What is minimised is a choice: most
//! cells of a table lie near the highlight, many at grazing angles, so that the best log RMSE and the best picture are far apart where
//! a model can't follow the material.

use super::{ClassicalModel, Geometry, Lobe};
use crate::brdf::merl::{CellGrid, MerlTable, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use crate::reflectance::levenberg_marquardt::{Minimum, minimise};
use crate::{Error, Result};
use std::f64::consts::PI;

/// The models that can be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Diffuse alone.
    Lambert,
    /// See [`Lobe::BlinnPhong`].
    BlinnPhong,
    /// See [`Lobe::CookTorranceBeckmann`].
    CookTorranceBeckmann,
    /// See [`Lobe::CookTorranceGgx`].
    CookTorranceGgx,
    /// See [`Lobe::Ward`]; on an isotropic table the anisotropic one has nothing more to fit.
    Ward,
    /// See [`Lobe::AshikhminShirley`], with one exponent.
    AshikhminShirley,
    /// See [`Lobe::Lafortune`].
    Lafortune,
}

impl Form {
    /// All of them.
    pub const ALL: [Form; 7] = [
        Form::Lambert,
        Form::BlinnPhong,
        Form::CookTorranceBeckmann,
        Form::CookTorranceGgx,
        Form::Ward,
        Form::AshikhminShirley,
        Form::Lafortune,
    ];

    /// Its name, which is the lobe's.
    pub fn name(self) -> &'static str {
        self.lobe(&[0.0; 2]).name()
    }

    /// The form of a name.
    pub fn of_name(name: &str) -> Option<Self> {
        Form::ALL.into_iter().find(|form| form.name() == name)
    }

    /// The lobe of two numbers on the whole line: logarithm of the width, and a second one where there is one.
    fn lobe(self, shape: &[f64; 2]) -> Lobe {
        let roughness = shape[0].exp();
        // A Gaussian of slopes and a power of the cosine with the same curvature at the top.
        let exponent = 2.0 / (roughness * roughness);
        let reflectance = 1.0 / (1.0 + (-shape[1]).exp());
        match self {
            Form::Lambert => Lobe::Lambert,
            Form::BlinnPhong => Lobe::BlinnPhong { exponent },
            Form::CookTorranceBeckmann => Lobe::CookTorranceBeckmann { roughness, reflectance },
            Form::CookTorranceGgx => Lobe::CookTorranceGgx { roughness, reflectance },
            Form::Ward => Lobe::Ward { roughness },
            Form::AshikhminShirley => Lobe::AshikhminShirley { exponents: [exponent; 2], reflectance },
            Form::Lafortune => Lobe::Lafortune { xy: -1.0, z: shape[1].exp(), exponent: 0.25 * exponent },
        }
    }

    /// Where the second number starts, and its range.
    fn second(self) -> (f64, (f64, f64)) {
        match self {
            Form::Lafortune => (0.0, (-1.0, 1.0)),
            Form::CookTorranceBeckmann | Form::CookTorranceGgx | Form::AshikhminShirley => (-2.0, (-6.0, 6.0)),
            _ => (0.0, (0.0, 0.0)),
        }
    }
}

/// What a fit makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Objective {
    /// What the error report calls log RMSE: the mean square of `ln(1 + f cos) - ln(1 + f' cos)` over valid cells, colours together.
    Logarithm,
    /// The mean square of differences as a picture shows them: of `(x / (x + white))^(1/2.2)`, `x = f cos`, each cell with the area of
    /// half vectors and difference vectors that it stands for.
    Picture,
    /// The first plus 30 times the second, which makes them about equal.
    #[default]
    Both,
}

impl Objective {
    /// Weights of the two mean squares.
    fn weights(self) -> [f64; 2] {
        match self {
            Objective::Logarithm => [1.0, 0.0],
            Objective::Picture => [0.0, 1.0],
            Objective::Both => [1.0, 30.0],
        }
    }
}

/// A cell as the fit sees it.
struct Sample {
    geometry: Geometry,
    /// The BRDF, red, green, blue.
    value: [f64; 3],
    /// The measured signals, see [`Signal`].
    signals: [[f64; 3]; 2],
    /// Their weights.
    weights: [f64; 2],
}

/// What is compared, a function of `f cos`.
#[derive(Clone, Copy)]
enum Signal {
    Logarithm,
    Picture { white: f64 },
}

impl Signal {
    /// The signal and its derivative.
    fn of(self, x: f64) -> (f64, f64) {
        match self {
            Signal::Logarithm => (x.ln_1p(), 1.0 / (1.0 + x)),
            Signal::Picture { white } => {
                const GAMMA: f64 = 1.0 / 2.2;
                let x = x.max(1e-4 * white);
                let share = x / (x + white);
                let signal = share.powf(GAMMA);
                (signal, GAMMA * signal / share * white / ((x + white) * (x + white)))
            }
        }
    }
}

/// Fits a model to a table.
///
/// # Errors
/// [`Error::Parameter`] where the table has too few valid cells.
pub fn fit(table: &MerlTable, form: Form, objective: Objective) -> Result<ClassicalModel> {
    let mut samples = gather(table, [3, 3, 30]);
    if samples.len() < 100 {
        return Err(Error::parameter("the table has too few valid cells for a fit"));
    }
    let signals = prepare(&mut samples, objective);
    let coarse: Vec<&Sample> = samples.iter().step_by(7).collect();
    let all: Vec<&Sample> = samples.iter().collect();
    let widths: &[f64] = if form == Form::Lambert { &[1.0] } else { &[0.02, 0.06, 0.2, 0.5] };
    let mut best: Option<Minimum<PARAMETERS>> = None;
    for &width in widths {
        let found = improve(form, &start(form, &coarse, width), &coarse, signals, 25);
        if best.is_none_or(|best| found.cost < best.cost) {
            best = Some(found);
        }
    }
    let best = best.map(|best| improve(form, &best.parameters, &all, signals, 30));
    let best = best.ok_or_else(|| Error::parameter("nothing to fit"))?;
    Ok(model(form, &best.parameters))
}

/// Sets weights and measured signals.
fn prepare(samples: &mut [Sample], objective: Objective) -> [Signal; 2] {
    let area = |g: &Geometry| {
        let (sin_h, sin_d) = (g.half[0], (1.0 - g.cos_difference * g.cos_difference).max(0.0).sqrt());
        // Bins of theta_h are as wide as the root of theta_h is large.
        sin_h * sin_h.atan2(g.cos_half).sqrt() * sin_d * g.cos_difference
    };
    let mut bright: Vec<(f64, f64)> = (samples.iter())
        .map(|s| (s.value.iter().copied().fold(0.0, f64::max) * s.geometry.cos_incoming, area(&s.geometry)))
        .collect();
    bright.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total = bright.iter().map(|(_, area)| area).sum::<f64>();
    let mut left = 0.95 * total;
    let white = bright.iter().find(|(_, area)| {
        left -= area;
        left <= 0.0
    });
    let signals = [Signal::Logarithm, Signal::Picture { white: white.map_or(1.0, |&(x, _)| x.max(1e-6)) }];
    let [log, picture] = objective.weights();
    let count = samples.len() as f64;
    for sample in samples {
        let signal = |signal: Signal| sample.value.map(|f| signal.of(f * sample.geometry.cos_incoming).0);
        sample.signals = signals.map(signal);
        sample.weights = [log / count, picture * area(&sample.geometry) / total.max(1e-30)];
    }
    signals
}

/// Logarithms of diffuse and specular colours, then the shape.
const PARAMETERS: usize = 8;

fn model(form: Form, p: &[f64; PARAMETERS]) -> ClassicalModel {
    let lobe = form.lobe(&[p[6], p[7]]);
    let specular = if form == Form::Lambert { [0.0; 3] } else { [3, 4, 5].map(|i| p[i].exp()) };
    ClassicalModel { diffuse: [0, 1, 2].map(|i| p[i].exp()), specular, lobe }
}

/// Cells at regular steps of the three angles, the first at half a step: the whole table in small.
fn gather(table: &MerlTable, steps: [usize; 3]) -> Vec<Sample> {
    let grid = CellGrid::new();
    let middles = |step: usize, bins: usize| (step / 2..bins).step_by(step);
    let mut samples = Vec::new();
    for h in middles(steps[0], THETA_H_BINS) {
        for d in middles(steps[1], THETA_D_BINS) {
            for p in middles(steps[2], PHI_D_BINS) {
                let index = (h * THETA_D_BINS + d) * PHI_D_BINS + p;
                if let Some(cell) = table.cell(index).and_then(|value| grid.cell(index, value)) {
                    let geometry = Geometry::of_angles(cell.angles);
                    samples.push(Sample { geometry, value: cell.value, signals: [[0.0; 3]; 2], weights: [0.0; 2] });
                }
            }
        }
    }
    samples
}

/// Diffuse from what is seen away from the highlight, specular from the rest near it.
fn start(form: Form, samples: &[&Sample], width: f64) -> [f64; PARAMETERS] {
    let lobe = form.lobe(&[width.ln(), form.second().0]);
    let mut p = [0.0; PARAMETERS];
    for c in 0..3 {
        let value = |s: &Sample| s.value[c];
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
    form: Form,
    from: &[f64; PARAMETERS],
    samples: &[&Sample],
    signals: [Signal; 2],
    evaluations: u32,
) -> Minimum<PARAMETERS> {
    const STEP: f64 = 1e-4;
    let second = form.second().1;
    let mut bounds = [(-14.0, 3.0); PARAMETERS];
    bounds[3..6].fill((-16.0, 8.0));
    bounds[6] = (0.002f64.ln(), 1.5f64.ln());
    bounds[7] = second;
    if form == Form::Lambert {
        (3..8).for_each(|i| bounds[i] = (0.0, 0.0));
    }
    minimise(*from, &bounds, evaluations, |p, equations| {
        let found = model(form, p);
        let wider = form.lobe(&[p[6] + STEP, p[7]]);
        let other = form.lobe(&[p[6], p[7] + STEP]);
        let varies = second.0 < second.1;
        for sample in samples {
            let g = &sample.geometry;
            let lobe = found.lobe.scalar(g);
            let by_width = (wider.scalar(g) - lobe) / STEP;
            let by_second = if varies { (other.scalar(g) - lobe) / STEP } else { 0.0 };
            for c in 0..3 {
                let diffuse = found.diffuse[c] / PI;
                let specular = found.specular[c] * lobe;
                for k in (0..2).filter(|&k| sample.weights[k] > 0.0) {
                    let (signal, slope) = signals[k].of((diffuse + specular) * g.cos_incoming);
                    let scaled = g.cos_incoming * slope;
                    let mut derivatives = [0.0; PARAMETERS];
                    derivatives[c] = scaled * diffuse;
                    derivatives[3 + c] = scaled * specular;
                    derivatives[6] = scaled * found.specular[c] * by_width;
                    derivatives[7] = scaled * found.specular[c] * by_second;
                    equations.add(signal - sample.signals[k][c], &derivatives, sample.weights[k]);
                }
            }
        }
    })
}
