//! Gaussian estimates of a material from a few measured values, and the directions that would tell most about it.
//!
//! The logarithm of a material is the population's mean plus its principal components, their factors normal, plus a remainder of known
//! variance at each direction. Given measured values with their noise, the factors stay normal (Rasmussen and Williams 2006, equation
//! 2.8). Errors of `ln(1 + f cos)` follow with the slopes that the estimated material itself has, so that the best next directions depend on
//! what was measured: a matt material needs none at a highlight that it does not have.

use super::choose::{PEAK, error_metric, gain, observe};
use super::{NOISE, PlannedAngles, PopulationComponents, principal};
use crate::brdf::compact::terms;
use crate::brdf::{BrdfSample, HalfDifference, MeasuredSample};
use crate::error::{Error, Result};
use crate::vector::dot_slices;

/// Statistics of a population at the cells of a coarse table: the state of knowledge before anything was measured.
#[derive(Debug, Clone)]
pub struct MaterialPrior {
    pub(super) components: PopulationComponents,
    pub(super) angles: Vec<HalfDifference>,
    pub(super) cosines: Vec<[f64; 2]>,
    /// Mean of the logarithm at each cell.
    pub(super) mean: Vec<f64>,
    /// Components at each cell.
    pub(super) along: Vec<Vec<f64>>,
    /// Variance that the components leave over at each cell.
    pub(super) left: Vec<f64>,
    /// Mean over the population of the squared slope of `ln(1 + f cos)` by `ln(f + floor)` at each cell; empty where it is not known.
    pub(super) weights: Vec<f64>,
    /// Factor of the squared errors that are expected.
    pub(super) discrepancy: f64,
    /// Whether a cell can be measured.
    pub(super) candidates: Vec<bool>,
}

/// Weight of errors within 5 degrees of the highlight's centre when the next directions are chosen. Larger than that of plans, which
/// know nothing of the material's highlight. Found by cross-validation.
const NEXT_PEAK_IMPORTANCE: f64 = 0.1;

/// Knowledge of a material after some values were measured.
#[derive(Debug, Clone)]
pub struct MaterialPosterior<'a> {
    prior: &'a MaterialPrior,
    /// Coefficients of red, green and blue.
    coefficients: [Vec<f64>; 3],
    /// Covariance of the components' factors, for each colour.
    covariance: [Vec<Vec<f64>>; 3],
    /// Greatest measured value.
    highest: f64,
    /// Mean squared residual over its expectation, at least 1.
    misfit: f64,
    /// Cells that were measured.
    taken: Vec<usize>,
}

/// Directions to measure next.
#[derive(Debug, Clone, PartialEq)]
pub struct NextAngles {
    /// The angles, the most telling first.
    pub angles: Vec<PlannedAngles>,
    /// Log RMSE that is expected after each of them.
    pub expected_log_rmse: Vec<f64>,
}

impl MaterialPrior {
    /// Returns mean and components of the population.
    pub fn components(&self) -> &PopulationComponents {
        &self.components
    }

    /// Index of the cell nearest to angles.
    pub(super) fn nearest(&self, to: HalfDifference) -> usize {
        nearest(self.angles.iter().map(coordinates), to)
    }

    /// Estimates a material from values.
    /// # Errors
    /// [`Error::Parameter`] without any.
    pub fn posterior(&self, samples: &[MeasuredSample]) -> Result<MaterialPosterior<'_>> {
        let of = &self.components;
        let count = of.components.len();
        let mut matrix = [(); 3].map(|()| vec![vec![0.0; count]; count]);
        let mut sides = [(); 3].map(|()| vec![0.0; count]);
        let mut known = Vec::with_capacity(samples.len());
        let cells: Vec<[f64; 3]> = self.angles.iter().map(coordinates).collect();
        for sample in samples {
            let at = sample.isotropic();
            let angles = HalfDifference::from_directions(sample.incoming, sample.outgoing);
            let terms = terms(at.theta_h, at.theta_d, at.cos_incoming, at.cos_outgoing);
            let along: Vec<f64> = of.components.iter().map(|c| dot_slices(c, &terms)).collect();
            let (mean, cell) = (dot_slices(&of.mean, &terms), nearest(cells.iter().copied(), angles));
            let rest = sample.value.map(|f| (f + of.floor).ln() - mean);
            let variance = [0, 1, 2].map(|c| {
                let noise = sample.deviation[c] / (sample.value[c] + of.floor);
                self.left[cell] + NOISE + noise * noise
            });
            for c in 0..3 {
                let weight = 1.0 / variance[c];
                for i in 0..count {
                    let scaled = weight * along[i];
                    sides[c][i] += scaled * rest[c];
                    (0..=i).for_each(|j| matrix[c][i][j] += scaled * along[j]);
                }
            }
            known.push((along, rest, variance, cell));
        }
        if known.is_empty() {
            return Err(Error::parameter("no measured value"));
        }
        let inverse = matrix.map(|mut matrix| {
            (0..count).for_each(|i| matrix[i][i] += 1.0 / of.variances[i]);
            principal::inverse(matrix)
        });
        let places = [0, 1, 2].map(|c| inverse[c].iter().map(|row| dot_slices(row, &sides[c])).collect::<Vec<f64>>());
        let coefficients = places.each_ref().map(|place| {
            let mut sum = of.mean.clone();
            for (component, place) in of.components.iter().zip(place) {
                sum.iter_mut().zip(component).for_each(|(sum, x)| *sum += x * place);
            }
            sum
        });
        // Residuals beyond what the population leaves over: the material is not one of these.
        let square = |(along, rest, variance, _): &(Vec<f64>, [f64; 3], [f64; 3], usize)| {
            (0..3).map(|c| (rest[c] - dot_slices(along, &places[c])).powi(2) / variance[c]).sum::<f64>()
        };
        let squares: f64 = known.iter().map(square).sum::<f64>() / 3.0;
        let misfit = ((squares + PRIOR_FREEDOM) / (known.len() as f64 + PRIOR_FREEDOM)).max(1.0);
        let highest = samples.iter().flat_map(|s| s.value).fold(0.0f64, f64::max);
        let taken = known.into_iter().map(|(.., cell)| cell).collect();
        Ok(MaterialPosterior { prior: self, coefficients, covariance: inverse, highest, misfit, taken })
    }
}

/// Samples that the expected residual counts for beside the measured ones.
const PRIOR_FREEDOM: f64 = 8.0;

/// Coordinates in which distances between angles are measured.
pub(super) fn coordinates(angles: &HalfDifference) -> [f64; 3] {
    [angles.theta_h.sqrt(), angles.theta_d, angles.phi_d]
}

/// Index of the nearest of [`coordinates`].
pub(super) fn nearest(all: impl Iterator<Item = [f64; 3]>, to: HalfDifference) -> usize {
    let to = coordinates(&to);
    let apart = |a: [f64; 3]| (0..3).map(|k| (a[k] - to[k]) * (a[k] - to[k])).sum::<f64>();
    let mut best = (f64::INFINITY, 0);
    for (index, angles) in all.enumerate() {
        let distance = apart(angles);
        if distance < best.0 {
            best = (distance, index);
        }
    }
    best.1
}

impl<'a> MaterialPosterior<'a> {
    /// The most probable material as samples of `bins` of `theta_h`, `theta_d` and `phi_d`, to be fitted in any form.
    pub fn reconstruct(&self, bins: [usize; 3]) -> Vec<BrdfSample> {
        let mut samples = BrdfSample::tabulate(&super::NoBrdf, bins);
        for s in &mut samples {
            s.value = self.value_at(s.theta_h, s.theta_d, s.cos_incoming, s.cos_outgoing);
        }
        samples
    }

    /// The most probable value at angles (radians) and cosines, which are above 0.
    pub fn value_at(&self, theta_h: f64, theta_d: f64, cos_incoming: f64, cos_outgoing: f64) -> [f64; 3] {
        let of = &self.prior.components;
        super::bounded_value(&terms(theta_h, theta_d, cos_incoming, cos_outgoing), &self.coefficients, of, self.highest)
    }

    /// Squared slope of `ln(1 + f cos)` by `ln(f + floor)` at each cell, for each colour.
    fn weights(&self) -> Vec<[f64; 3]> {
        let cells = self.prior.angles.iter().zip(&self.prior.cosines);
        cells
            .map(|(angles, &[cos_incoming, cos_outgoing])| {
                let value = self.value_at(angles.theta_h, angles.theta_d, cos_incoming, cos_outgoing);
                value.map(|f| ((f + self.prior.components.floor) * cos_incoming / (1.0 + f * cos_incoming)).powi(2))
            })
            .collect()
    }

    /// Log RMSE over a whole table that is expected of the most probable material.
    pub fn expected_log_rmse(&self) -> f64 {
        self.expected(&self.weights(), &self.covariance)
    }

    fn expected(&self, weights: &[[f64; 3]], covariance: &[Vec<Vec<f64>>; 3]) -> f64 {
        let each = crate::parallel::map(weights.len(), |n| {
            let along = &self.prior.along[n];
            let variance = |c: usize| {
                let spread: f64 = covariance[c].iter().zip(along).map(|(row, a)| a * dot_slices(row, along)).sum();
                self.misfit * self.prior.discrepancy * (spread + self.prior.left[n])
            };
            (0..3).map(|c| weights[n][c] * variance(c)).sum::<f64>() / 3.0
        });
        (each.iter().sum::<f64>() / each.len().max(1) as f64).max(0.0).sqrt()
    }

    /// The `count` directions that lower the expected error most, one after the other, and the error after each. A direction near a
    /// measured one is not measured again.
    /// # Errors
    /// [`Error::Parameter`] where that many directions are not left.
    pub fn next(&self, count: usize) -> Result<NextAngles> {
        let prior = self.prior;
        let weights = self.weights();
        let mut open = prior.candidates.clone();
        self.taken.iter().for_each(|&cell| open[cell] = false);
        if count > open.iter().filter(|open| **open).count() / 4 {
            return Err(Error::parameter(format!("{count} directions are more than can be told apart")));
        }
        let cell = |(n, (along, angles)): (usize, (&'a Vec<f64>, &HalfDifference))| {
            let peak = if angles.theta_h < PEAK { NEXT_PEAK_IMPORTANCE } else { 1.0 };
            // Half as the estimate says, half as for any material: the estimate may be wrong where nothing was measured.
            let estimated = weights[n].iter().sum::<f64>() / 3.0;
            (along, peak * (estimated + prior.weights.get(n).unwrap_or(&estimated)))
        };
        let cells = prior.along.iter().zip(&prior.angles).enumerate().map(cell);
        let metric = error_metric(prior.components.components.len(), cells);
        let mut covariance = self.covariance.clone();
        let mut next = NextAngles { angles: Vec::new(), expected_log_rmse: Vec::new() };
        for _ in 0..count {
            let gains = crate::parallel::map(open.len(), |n| {
                if open[n] { gain(&metric, &covariance[1], &prior.along[n], prior.left[n]) } else { 0.0 }
            });
            let best =
                (0..open.len()).filter(|&n| open[n]).max_by(|&a, &b| gains[a].total_cmp(&gains[b]).then(b.cmp(&a)));
            let Some(n) = best else { break };
            open[n] = false;
            for one in &mut covariance {
                observe(one, &prior.along[n], prior.left[n]);
            }
            next.angles.push(PlannedAngles::from_angles(prior.angles[n], prior.left[n]));
            next.expected_log_rmse.push(self.expected(&weights, &covariance));
        }
        Ok(next)
    }
}
