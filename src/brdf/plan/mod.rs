//! Measurement plans: angles for a budget of samples, chosen from a population of measured materials, and materials from such samples.
//!
//! Three methods. **Uniform**: equal steps of `theta_h` in equal slices of `theta_d`. **Variance** (DSBRDF, equations 10 and 11): steps
//! of `theta_h` that shrink where the materials' `ln(1 + f)` varies more, `theta'_i = 90 deg A_i / A_89` with `A_i = sum 1 / sigma_k^2`.
//! **Optimal**: one sample after the other, each where it lowers the expected error most (Bayesian A-optimal design, Chaloner and
//! Verdinelli 1995), given the principal components of the population's logarithms; after Nielsen, Jensen and Ramamoorthi 2015 and Xu
//! et al. 2016, who choose samples by the condition of such a basis. A plan of any method carries the components, so that
//! [`MeasurementPlan::reconstruct`] gives a whole material from a few samples by the same Gaussian estimate.

mod choose;
mod classical;
mod goniometer;
mod population;
mod principal;
mod prior;

pub use goniometer::{GoniometerAngles, goniometer_csv, goniometer_rows};
pub use population::Population;
pub use prior::{MaterialPosterior, MaterialPrior, NextAngles};

use super::BrdfSample;
use super::compact::{TERMS, terms};
use crate::error::{Error, Result};
use crate::vector::dot_slices;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Method by which angles are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlanMethod {
    /// By the population's variance along `theta_h`.
    #[serde(alias = "published")]
    Variance,
    /// In equal steps.
    Uniform,
    /// By the error that is expected after each sample.
    Optimal,
}

/// A pair of directions to measure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedAngles {
    /// Angle between normal and half vector, degrees.
    pub theta_h_deg: f64,
    /// Angle between half vector and either direction, degrees.
    pub theta_d_deg: f64,
    /// Azimuth of the difference vector, degrees.
    pub phi_d_deg: f64,
    /// Variance of the logarithm there that the components leave over.
    pub variance: f64,
}

impl PlannedAngles {
    /// Returns the angles in radians.
    pub fn half_difference(&self) -> super::HalfDifference {
        let [theta_h, theta_d, phi_d] = [self.theta_h_deg, self.theta_d_deg, self.phi_d_deg].map(f64::to_radians);
        super::HalfDifference { theta_h, theta_d, phi_d }
    }

    fn from_angles(angles: super::HalfDifference, variance: f64) -> Self {
        PlannedAngles {
            theta_h_deg: angles.theta_h.to_degrees(),
            theta_d_deg: angles.theta_d.to_degrees(),
            phi_d_deg: angles.phi_d.to_degrees(),
            variance,
        }
    }

    /// The terms of the logarithm there; `None` where a direction is not above the horizon.
    fn terms(&self) -> Option<Vec<f64>> {
        let angles = self.half_difference();
        let (incoming, outgoing) = angles.directions();
        let above = incoming[2] > 0.0 && outgoing[2] > 0.0;
        above.then(|| terms(angles.theta_h, angles.theta_d, incoming[2], outgoing[2]))
    }
}

/// Mean and principal components of a population's `ln(f + floor)`, as coefficients of the compact form's terms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PopulationComponents {
    /// Floor added to the BRDF before its logarithm is taken.
    pub floor: f64,
    /// Coefficients of the mean.
    pub mean: Vec<f64>,
    /// Coefficients of each component.
    pub components: Vec<Vec<f64>>,
    /// Variance of the population along each component.
    pub variances: Vec<f64>,
}

/// Angles to measure, and what is needed to make a material of the values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasurementPlan {
    /// File format, [`PLAN_FORMAT`].
    pub format: String,
    /// Method by which the angles were chosen.
    pub method: PlanMethod,
    /// Materials that the plan was made from.
    pub materials: usize,
    /// Log RMSE that is expected of a material like those, reconstructed from these samples.
    pub expected_log_rmse: f64,
    /// The angles.
    pub angles: Vec<PlannedAngles>,
    /// Mean and principal components of the population.
    pub components: PopulationComponents,
}

/// First field of a plan.
pub const PLAN_FORMAT: &str = "tsuya-brdf-plan-1";
/// Bounds of what a plan file may hold.
const MAX_ANGLES: usize = 100_000;
const MAX_COMPONENTS: usize = 256;
/// Added to every variance: no measurement is exact.
const NOISE: f64 = 1e-3;

impl MeasurementPlan {
    /// Reads a plan's JSON.
    /// # Errors
    /// [`Error::Parameter`] where it isn't JSON of this format, or numbers are out of range.
    pub fn from_json(text: &[u8]) -> Result<Self> {
        let plan: MeasurementPlan =
            serde_json::from_slice(text).map_err(|e| Error::parameter(format!("not a sampling plan: {e}")))?;
        let wrong = |what: &str| Err(Error::parameter(format!("not a sampling plan of this version: {what}")));
        if plan.format != PLAN_FORMAT {
            return wrong(&format!("its format is '{}', '{PLAN_FORMAT}' expected", plan.format));
        }
        let of = &plan.components;
        if plan.angles.len() > MAX_ANGLES || of.components.len() > MAX_COMPONENTS {
            return wrong("too many angles or components");
        }
        let sized = of.mean.len() == TERMS && of.components.iter().all(|c| c.len() == TERMS);
        if !sized || of.variances.len() != of.components.len() {
            return wrong(&format!(
                "mean and components have {TERMS} coefficients each, and each component a variance"
            ));
        }
        let finite = of.mean.iter().chain(of.components.iter().flatten()).all(|x| x.is_finite() && x.abs() < 1e6);
        let positive = |x: &f64| x.is_finite() && *x > 0.0 && *x < 1e12;
        let angles = |a: &PlannedAngles| {
            (0.0..=90.0).contains(&a.theta_h_deg)
                && (0.0..=90.0).contains(&a.theta_d_deg)
                && (0.0..=180.0).contains(&a.phi_d_deg)
        };
        if !finite || !of.variances.iter().all(positive) || !positive(&of.floor) {
            return wrong("coefficients, variances and floor are finite, the latter two above 0");
        }
        if !plan.angles.iter().all(|a| angles(a) && a.variance.is_finite() && a.variance >= 0.0) {
            return wrong("angles are 0 to 90 degrees, phi_d 0 to 180, variances 0 or more");
        }
        Ok(plan)
    }

    /// The plan as JSON.
    pub fn to_json(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|e| Error::parameter(format!("plan: {e}")))
    }

    /// The plan's statistics as knowledge of materials, for values measured anywhere: what the components leave over is known at the plan's
    /// angles, and taken from the nearest of them elsewhere.
    /// # Errors
    /// [`Error::Parameter`] for a plan without angles.
    pub fn prior(&self) -> Result<MaterialPrior> {
        if self.angles.is_empty() {
            return Err(Error::parameter("a plan without angles"));
        }
        let planned: Vec<[f64; 3]> = self.angles.iter().map(|a| prior::coordinates(&a.half_difference())).collect();
        let near = |to: super::HalfDifference| self.angles[prior::nearest(planned.iter().copied(), to)].variance;
        Ok(Population::new().prior_of(self.components.clone(), near))
    }

    /// The samples of a material at the plan's angles, as a goniometer would take them; `None` where it has no value.
    pub fn measure(&self, material: impl Fn(&PlannedAngles) -> Option<[f64; 3]>) -> Vec<Option<[f64; 3]>> {
        self.angles.iter().map(material).collect()
    }

    /// A whole material from the values at the plan's angles (in their order): the most probable one, given the population. It comes as
    /// samples of `bins` of `theta_h`, `theta_d` and `phi_d`, to be fitted in any form.
    /// # Errors
    /// [`Error::Parameter`] where no value is usable, or their number is not that of the angles.
    pub fn reconstruct(&self, values: &[Option<[f64; 3]>], bins: [usize; 3]) -> Result<Vec<BrdfSample>> {
        if values.len() != self.angles.len() {
            let message = format!("the plan has {} angles, {} values given", self.angles.len(), values.len());
            return Err(Error::parameter(message));
        }
        let of = &self.components;
        let count = of.components.len();
        let mut matrix = vec![vec![0.0; count]; count];
        let mut sides = vec![[0.0; 3]; count];
        let mut used = 0;
        for (angles, value) in self.angles.iter().zip(values) {
            let usable = value.filter(|v| v.iter().all(|x| x.is_finite() && *x >= 0.0));
            let (Some(value), Some(terms)) = (usable, angles.terms()) else { continue };
            used += 1;
            let weight = 1.0 / (angles.variance + NOISE);
            let mean = dot_slices(&of.mean, &terms);
            let along: Vec<f64> = of.components.iter().map(|c| dot_slices(c, &terms)).collect();
            let rest = value.map(|f| (f + of.floor).ln() - mean);
            for i in 0..count {
                (0..3).for_each(|c| sides[i][c] += weight * along[i] * rest[c]);
                (0..=i).for_each(|j| matrix[i][j] += weight * along[i] * along[j]);
            }
        }
        if used == 0 {
            return Err(Error::parameter("no value at the plan's angles is usable"));
        }
        (0..count).for_each(|i| matrix[i][i] += 1.0 / of.variances[i]);
        let place = principal::solve(matrix, sides);
        let coefficients = [0, 1, 2].map(|c| {
            let mut sum = of.mean.clone();
            for (component, place) in of.components.iter().zip(&place) {
                sum.iter_mut().zip(component).for_each(|(sum, x)| *sum += x * place[c]);
            }
            sum
        });
        let highest = values.iter().flatten().flatten().fold(0.0f64, |a, &b| a.max(b));
        let value = |s: &BrdfSample| {
            let terms = terms(s.theta_h, s.theta_d, s.cos_incoming, s.cos_outgoing);
            bounded_value(&terms, &coefficients, of, highest)
        };
        let mut samples = BrdfSample::tabulate(&NoBrdf, bins);
        samples.iter_mut().for_each(|s| s.value = value(s));
        Ok(samples)
    }
}

/// Value at terms; no brighter than e^2 times the brightest measured, or than the population's mean: extrapolation can't run away.
fn bounded_value(terms: &[f64], coefficients: &[Vec<f64>; 3], of: &PopulationComponents, highest: f64) -> [f64; 3] {
    let ceiling = (highest.ln() + 2.0).max(dot_slices(&of.mean, terms) + 2.0);
    [0, 1, 2].map(|c| (dot_slices(&coefficients[c], terms).min(ceiling).exp() - of.floor).max(0.0))
}

/// A black material: only its angles are wanted.
struct NoBrdf;

impl super::Brdf for NoBrdf {
    fn evaluate(&self, _: [f64; 3], _: [f64; 3]) -> [f64; 3] {
        [0.0; 3]
    }
}

/// `phi_d` at which plans along `theta_h` measure: in the middle, where the horizon cuts off least.
const MIDDLE_PHI: f64 = PI / 2.0;

#[cfg(test)]
mod tests;
