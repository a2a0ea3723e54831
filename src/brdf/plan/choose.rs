//! Choosing angles.

use super::{MIDDLE_PHI, NOISE};
use crate::brdf::HalfDifference;
use crate::vector::dot_slices;
use std::f64::consts::FRAC_PI_2;

/// Weight of errors within 5 degrees of the highlight's centre when samples are chosen: they are ten times those elsewhere, and would
/// otherwise take nearly all samples. Found by cross-validation.
const PEAK_IMPORTANCE: f64 = 0.005;
/// Angle from which errors count fully, radians.
pub(super) const PEAK: f64 = 5.0 / 180.0 * std::f64::consts::PI;
/// Largest number of slices of `theta_d`, that of DSBRDF.
const MAX_SLICES: usize = 18;

/// Returns the number of slices that leaves five samples for each, at most [`MAX_SLICES`].
pub(super) fn slices(count: usize) -> usize {
    ((count as f64 / 5.0).sqrt().round() as usize).clamp(1, MAX_SLICES)
}

/// Steps along `theta_h`.
pub(super) struct ThetaHSteps<'a> {
    /// First `theta_h`, radians.
    pub min_theta_h: f64,
    /// Variances, one a degree from 0 to 90: steps follow equations 10 and 11. Equal ones without.
    pub variance: Option<&'a [f64]>,
    /// A variance is at least this part of the greatest beyond `least_theta_h`: where all materials agree its inverse would have no bound.
    pub floor: f64,
}

impl ThetaHSteps<'_> {
    /// `A_i`, equation 10, from 0 to 1, over the variances of the range.
    fn warp(&self) -> Option<Vec<f64>> {
        let variance = self.variance?;
        let first = (self.min_theta_h / FRAC_PI_2 * variance.len() as f64).round() as usize;
        let variance = variance.get(first..).filter(|v| !v.is_empty())?;
        let greatest = variance.iter().copied().fold(1e-12, f64::max);
        let mut sum = 0.0;
        let mut sums = vec![0.0];
        for v in variance {
            sum += 1.0 / v.max(self.floor * greatest);
            sums.push(sum);
        }
        Some(sums.into_iter().map(|s| s / sum).collect())
    }

    /// Samples in equal slices of `theta_d`. Angles lie in the middle of their steps, so that none is at the centre of the highlight or on
    /// the horizon.
    pub(super) fn along_theta_h(&self, count: usize, slices: usize) -> Vec<HalfDifference> {
        let warp = self.warp();
        let mut all = Vec::with_capacity(count);
        for slice in 0..slices {
            let steps = count / slices + (slice < count % slices) as usize;
            for step in 0..steps {
                let even = (step as f64 + 0.5) / steps as f64;
                let part = match &warp {
                    None => even,
                    Some(warp) => {
                        let at = even * (warp.len() - 1) as f64;
                        let k = (at as usize).min(warp.len() - 2);
                        warp[k] + (warp[k + 1] - warp[k]) * (at - k as f64)
                    }
                };
                let theta_d = (slice as f64 + 0.5) / slices as f64 * FRAC_PI_2;
                all.push(HalfDifference {
                    theta_h: self.min_theta_h + part * (FRAC_PI_2 - self.min_theta_h),
                    theta_d,
                    phi_d: MIDDLE_PHI,
                });
            }
        }
        all
    }
}

/// Bayesian linear design: values are `components . place + noise`, places normal with the given variances.
pub(super) struct OptimalDesign<'a> {
    /// Components at each cell.
    pub along: &'a [Vec<f64>],
    /// Variance that the components leave over at each cell.
    pub left: &'a [f64],
    /// Weight of squared errors at each cell.
    pub weights: &'a [f64],
    /// Half angles of the cells, radians.
    pub theta_h: &'a [f64],
    /// Variance along each component.
    pub variances: &'a [f64],
}

impl OptimalDesign<'_> {
    /// Returns the weights of errors along the components, summed over all cells; those near the highlight's centre count `peak` times.
    fn metric(&self, peak: f64) -> Vec<Vec<f64>> {
        let weight = |(weight, &theta_h): (&f64, &f64)| if theta_h < PEAK { weight * peak } else { *weight };
        let weights = self.weights.iter().zip(self.theta_h).map(weight);
        error_metric(self.variances.len(), self.along.iter().zip(weights))
    }

    fn prior(&self) -> Vec<Vec<f64>> {
        let count = self.variances.len();
        (0..count).map(|i| (0..count).map(|j| if i == j { self.variances[i] } else { 0.0 }).collect()).collect()
    }

    /// Cells in the order in which each lowers the expected weighted squared error most. No cell twice.
    pub(super) fn optimal(&self, count: usize, candidates: &[bool]) -> Vec<usize> {
        let (metric, mut covariance) = (self.metric(PEAK_IMPORTANCE), self.prior());
        let mut open = candidates.to_vec();
        let mut chosen = Vec::with_capacity(count);
        for _ in 0..count {
            let mut best = (0.0, None);
            for n in (0..open.len()).filter(|&n| open[n]) {
                let gain = gain(&metric, &covariance, &self.along[n], self.left[n]);
                if gain > best.0 {
                    best = (gain, Some(n));
                }
            }
            let Some(n) = best.1 else { break };
            open[n] = false;
            chosen.push(n);
            observe(&mut covariance, &self.along[n], self.left[n]);
        }
        chosen
    }

    /// Log RMSE that is expected after samples with these components and variances.
    pub(super) fn expected(&self, samples: &[(Vec<f64>, f64)]) -> f64 {
        let mut covariance = self.prior();
        samples.iter().for_each(|(along, variance)| observe(&mut covariance, along, *variance));
        let metric = self.metric(1.0);
        let of_components: f64 = metric.iter().zip(&covariance).map(|(m, c)| dot_slices(m, c)).sum();
        let of_rest: f64 = self.weights.iter().zip(self.left).map(|(w, l)| w * l).sum();
        ((of_components + of_rest) / self.along.len().max(1) as f64).max(0.0).sqrt()
    }
}

/// The weights of errors along `count` components, summed over cells: the components at each, and the weight of its squared error.
pub(super) fn error_metric<'c>(count: usize, cells: impl Iterator<Item = (&'c Vec<f64>, f64)>) -> Vec<Vec<f64>> {
    let mut metric = vec![vec![0.0; count]; count];
    for (along, weight) in cells {
        for i in 0..count {
            let scaled = weight * along[i];
            (0..count).for_each(|j| metric[i][j] += scaled * along[j]);
        }
    }
    metric
}

/// By how much a sample lowers the expected weighted squared error.
pub(super) fn gain(metric: &[Vec<f64>], covariance: &[Vec<f64>], along: &[f64], left: f64) -> f64 {
    let spread = times(covariance, along);
    let variance = dot_slices(&spread, along) + left + NOISE;
    dot_slices(&times(metric, &spread), &spread) / variance
}

/// The covariance after one more sample.
pub(super) fn observe(covariance: &mut [Vec<f64>], along: &[f64], left: f64) {
    let spread = times(covariance, along);
    let variance = dot_slices(&spread, along) + left + NOISE;
    for (row, a) in covariance.iter_mut().zip(&spread) {
        row.iter_mut().zip(&spread).for_each(|(c, b)| *c -= a * b / variance);
    }
}

fn times(matrix: &[Vec<f64>], vector: &[f64]) -> Vec<f64> {
    matrix.iter().map(|row| dot_slices(row, vector)).collect()
}
