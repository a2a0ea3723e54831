//! The lobe form DSBRDF: sums of hemispherical exponential-power lobes of the half angle, one set for each slice of the
//! difference angle, for each colour.
//!
//! A lobe is `amplitude (exp(kappa cos^gamma theta_h) - 1)`, `kappa > 0`, `gamma >= 0`: `gamma` near 0 is constant (Lambertian), a large one
//! mirror-like. Between the middles of slices the logarithms of the parameters follow a monotone cubic (Fritsch and Butland 1984); beyond
//! the first and last middle they stay.

mod codec;
mod fit;
mod spline;

pub(in crate::brdf) use fit::half_angles;
pub use fit::{DsbrdfFitOptions, LobeCount, LobeError, fit_dsbrdf};

use super::Brdf;
use std::f64::consts::FRAC_PI_2;

/// One lobe, `amplitude (exp(kappa cos^gamma theta_h) - 1)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DsbrdfLobe {
    /// `ln(1 + peak)` for amplitude 1; above 0.
    pub kappa: f64,
    /// Narrowness, 0 or more.
    pub gamma: f64,
    /// Factor, 1 in the form of its authors.
    pub amplitude: f64,
}

impl DsbrdfLobe {
    /// Value at the cosine of the half angle, 0 to 1.
    pub fn value_at(&self, cos_half: f64) -> f64 {
        self.amplitude * (self.kappa * cos_half.max(0.0).powf(self.gamma)).exp_m1()
    }
}

/// Most lobes of a material.
pub(crate) const MAX_LOBES: usize = 5;
/// Most slices of a material.
pub(crate) const MAX_SLICES: usize = 90;
/// Parameters are kept in this part of their natural logarithm. Part of the format.
const STEP: f64 = 1.0 / 64.0;
/// Least and greatest quantised logarithm: `e^-16` to `e^16`. Part of the format.
const RANGE: i32 = 1024;

fn is_in_range(quantised: &i32) -> bool {
    (-RANGE..=RANGE).contains(quantised)
}

/// A material as lobes.
#[derive(Debug, Clone, PartialEq)]
pub struct DsbrdfMaterial {
    slices: usize,
    lobes: usize,
    amplitudes: bool,
    /// Logarithms of `kappa`, `gamma` and, where there are amplitudes, those, in steps: `[colour][lobe][parameter][slice]`.
    quantised: Vec<i32>,
    /// Splines of the logarithms, in the same order of the first three.
    curves: Vec<spline::MonotoneCubic>,
}

impl DsbrdfMaterial {
    /// Material of quantised logarithms of `kappa`, `gamma` and, where there are `amplitudes`, those, in 1/64:
    /// `[colour][lobe][parameter][slice]`. `None` where their number or values are out of range.
    pub fn new(slices: usize, lobes: usize, amplitudes: bool, quantised: Vec<i32>) -> Option<Self> {
        let parameters = 2 + amplitudes as usize;
        let sized = (1..=MAX_SLICES).contains(&slices) && (1..=MAX_LOBES).contains(&lobes);
        if !sized || quantised.len() != 3 * lobes * parameters * slices || !quantised.iter().all(is_in_range) {
            return None;
        }
        let curve = |q: &[i32]| spline::MonotoneCubic::new(q.iter().map(|&q| q as f64 * STEP).collect());
        let curves = quantised.chunks_exact(slices).map(curve).collect();
        Some(DsbrdfMaterial { slices, lobes, amplitudes, quantised, curves })
    }

    /// Number of slices of `theta_d`, equal parts of 0 to 90 degrees.
    pub fn slices(&self) -> usize {
        self.slices
    }

    /// Lobes of each colour.
    pub fn lobe_count(&self) -> usize {
        self.lobes
    }

    /// Numbers that the form consists of: colours x lobes x parameters x slices.
    pub fn parameter_count(&self) -> usize {
        self.quantised.len()
    }

    /// The lobes of a colour (0 red, 1 green, 2 blue) at a difference angle in radians.
    pub fn lobes(&self, colour: usize, theta_d: f64) -> impl Iterator<Item = DsbrdfLobe> + '_ {
        let at = theta_d / FRAC_PI_2 * self.slices as f64 - 0.5;
        let parameters = 2 + self.amplitudes as usize;
        let curves = self.curves.chunks_exact(parameters).skip(colour * self.lobes).take(self.lobes);
        curves.map(move |of| {
            let value = |k: usize| of.get(k).map_or(1.0, |curve| curve.value_at(at).exp());
            DsbrdfLobe { kappa: value(0), gamma: value(1), amplitude: value(2) }
        })
    }

    /// Value at the half and difference angles, radians.
    pub fn value_at(&self, theta_h: f64, theta_d: f64) -> [f64; 3] {
        let cos_half = theta_h.cos();
        [0, 1, 2].map(|colour| self.lobes(colour, theta_d).map(|lobe| lobe.value_at(cos_half)).sum())
    }
}

impl Brdf for DsbrdfMaterial {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        let angles = super::HalfDifference::from_directions(incoming, outgoing);
        self.value_at(angles.theta_h, angles.theta_d)
    }

    fn evaluate_row(&self, theta_h: f64, theta_d: f64, pairs: &[[[f64; 3]; 2]], values: &mut Vec<[f64; 3]>) {
        if !pairs.is_empty() {
            let value = self.value_at(theta_h, theta_d);
            values.extend(pairs.iter().map(|_| value));
        }
    }
}

#[cfg(test)]
mod tests;
