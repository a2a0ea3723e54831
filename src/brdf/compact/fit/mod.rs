//! Fitting the compact form: weighted least squares, then a choice of integers under a limit of bytes.

mod moments;
mod quantise;

use super::{CompactHeader, CompactMaterial, codec, degrees, floor_size};
use crate::brdf::BrdfSample;
use crate::error::{Error, Result};
use moments::{Moments, WeightedSample};
use quantise::CompactNormalEquations;

/// Treatment of the order of incoming and outgoing direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FitDirections {
    /// Exchanging the directions changes nothing; what the samples say against it is averaged. A MERL table keeps one value of both
    /// orders.
    #[default]
    Reciprocal,
    /// The samples' incoming and outgoing cosines tell the order, and the fit follows where measurements are not reciprocal.
    AsMeasured,
}

/// Options of [`fit_compact`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompactFitOptions {
    /// Most bytes of the coded material, at least 32.
    pub bytes: usize,
    /// Treatment of the order of incoming and outgoing direction.
    pub direction: FitDirections,
    /// Weight of errors as a rendered sphere shows them, against those of `ln(1 + f cos)` over the samples.
    pub picture_weight: f64,
}

impl Default for CompactFitOptions {
    fn default() -> Self {
        CompactFitOptions { bytes: 256, direction: FitDirections::default(), picture_weight: 3.0 }
    }
}

/// Fits a material to samples (in any order; fastest where equal `theta_h`, then equal `theta_d`, follow each other).
/// # Errors
/// [`Error::Parameter`] without usable samples, or where the limit of bytes is too small.
pub fn fit_compact(samples: &[BrdfSample], options: &CompactFitOptions) -> Result<CompactMaterial> {
    let reciprocal = options.direction == FitDirections::Reciprocal;
    let usable = |s: &&BrdfSample| {
        s.value.iter().all(|v| v.is_finite() && *v >= 0.0) && s.cos_incoming > 0.0 && s.cos_outgoing > 0.0
    };
    let samples: Vec<BrdfSample> = samples.iter().filter(usable).copied().collect();
    if samples.is_empty() {
        return Err(Error::parameter("no sample to fit: all are negative, not finite or below the horizon"));
    }
    let white = white(&samples);
    let floor = (-(white / 256.0).log2()).round().clamp(0.0, 31.0) as u8;
    let weights = weights(&samples, options.picture_weight, white, floor_size(floor));
    let mut moments = Moments::new(reciprocal);
    let mut highest = f64::NEG_INFINITY;
    for (sample, weight) in samples.iter().zip(weights) {
        let logarithm = sample.value.map(|f| (f + floor_size(floor)).ln());
        highest = logarithm.into_iter().fold(highest, f64::max);
        moments.add(&WeightedSample { sample, weight, logarithm });
    }
    let ceiling = ((highest + 8.0) * 4.0).ceil().clamp(0.0, 127.0) as u8;
    let (matrix, sides) = moments.finish(degrees(reciprocal));
    let normal = CompactNormalEquations::new(matrix, sides, degrees(reciprocal));
    // The finest step that fits.
    let (mut low, mut high) = (0u8, 63u8);
    let mut best = None;
    while low <= high {
        let step = (low + high) / 2;
        let channels = [0, 1, 2].map(|c| normal.quantise(c, step));
        let gains = [0, 1, 2].map(|c: usize| channels[c].1);
        let coefficients = channels.map(|(whole, _)| whole);
        let material = CompactMaterial::new(CompactHeader { reciprocal, step, floor, ceiling, gains }, coefficients);
        if material.encode().len() <= options.bytes {
            best = Some(material);
            if step == 0 {
                break;
            }
            high = step - 1;
        } else {
            low = step + 1;
        }
    }
    best.ok_or_else(|| Error::parameter(format!("{} bytes are too few for this material", options.bytes)))
}

/// Coefficients of red, green and blue of `ln(f + floor)` by plain least squares, not quantised, for a reciprocal material.
pub(in crate::brdf) fn coefficients(samples: &[BrdfSample], floor: f64) -> [Vec<f64>; 3] {
    let mut moments = Moments::new(true);
    for sample in samples {
        moments.add(&WeightedSample { sample, weight: 1.0, logarithm: sample.value.map(|f| (f + floor).ln()) });
    }
    let (matrix, sides) = moments.finish(degrees(true));
    let normal = CompactNormalEquations::new(matrix, sides, degrees(true));
    let [mean, red_blue, green] = [0, 1, 2].map(|c| normal.solution(c));
    let combine = |signs: [f64; 2]| {
        (0..mean.len()).map(|n| mean[n] + signs[0] * red_blue[n] + signs[1] * green[n]).collect::<Vec<f64>>()
    };
    [combine([1.0, 1.0]), combine([0.0, -2.0]), combine([-1.0, 1.0])]
}

/// Returns the density of a rendered sphere's pixels at a sample's angles.
fn density(sample: &BrdfSample) -> f64 {
    (2.0 * sample.theta_d).sin() * sample.theta_h.sin() * sample.theta_h.sqrt() * sample.cos_outgoing
}

/// Estimates the white of a rendered sphere: about the 95th percentile of `f cos_i`.
fn white(samples: &[BrdfSample]) -> f64 {
    let mut shown: Vec<(f64, f64)> = (samples.iter().filter(|s| s.theta_d < 1.0))
        .map(|s| (s.value.into_iter().fold(0.0, f64::max) * s.cos_incoming, density(s)))
        .collect();
    shown.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut left = 0.95 * shown.iter().map(|s| s.1).sum::<f64>();
    let at = shown.iter().find(|s| {
        left -= s.1;
        left <= 0.0
    });
    at.map_or(0.3, |s| s.0).clamp(1e-4, 1e2)
}

/// Returns the weights of squared errors of the logarithm: those of `ln(1 + f cos_i)`, and those of a sphere's display values, by how often its
/// pixels show such angles. Mean about `1 + picture_weight`.
fn weights(samples: &[BrdfSample], picture_weight: f64, white: f64, floor: f64) -> Vec<f64> {
    let each: Vec<[f64; 2]> = samples
        .iter()
        .map(|s| {
            let mean = (s.value[0] + s.value[1] + s.value[2]) / 3.0;
            let (cos, slope) = (s.cos_incoming, mean + floor);
            let of_logarithm = slope * cos / (1.0 + mean * cos);
            let radiance = mean * cos / white;
            let display = if radiance < 0.0031308 { 12.92 } else { 0.44 * radiance.max(1e-4).powf(1.0 / 2.4 - 1.0) };
            let display = display * cos / white * slope * (1.0 / radiance.max(1e-6)).min(1.0);
            [of_logarithm * of_logarithm, display * display * (density(s) + 0.01)]
        })
        .collect();
    let mean = |k: usize| (each.iter().map(|e| e[k]).sum::<f64>() / each.len() as f64).max(1e-300);
    let (of_logarithm, of_picture) = (mean(0), mean(1));
    each.iter().map(|e| e[0] / of_logarithm + picture_weight * e[1] / of_picture + 0.003).collect()
}
