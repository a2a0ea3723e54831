//! Gains: how far a predicted wavelet coefficient is to be trusted.
//!
//! A prediction is right in its coarse bands and large coefficients and little more than noise in the fine and small
//! ones, so it is scaled by a least-squares gain for each class of band, colour and magnitude before it is subtracted.

use crate::entropy::{BitCoder, NumberModel};
use crate::transform::shape_adaptive::{Orientation, Subband};

/// Classes of magnitude of a predicted coefficient, in quantiser steps.
pub(crate) const BUCKETS: usize = 3;
/// Classes of bands: horizontal and vertical together, diagonal, for each level, and the low band.
pub(crate) const BAND_CLASSES: usize = 11;
/// A gain is this many times smaller than its stored number.
pub(crate) const UNITY: i32 = 16;
/// Largest stored gain.
const MAX_GAIN: i32 = 24;

/// Class of a band among [`BAND_CLASSES`].
pub(crate) fn band_class(band: &Subband) -> usize {
    match band.orientation {
        Orientation::Low => 10,
        Orientation::Horizontal | Orientation::Vertical => 2 * (band.level - 1),
        Orientation::Diagonal => 2 * (band.level - 1) + 1,
    }
}

/// Bucket of a predicted coefficient of `steps` quantiser steps (absolute).
#[inline(always)]
pub(crate) fn bucket(steps: f32) -> usize {
    (steps > 0.75) as usize + (steps > 2.5) as usize
}

/// A predicted coefficient times the gain of its bucket; `inverse` is one over the band's step.
#[inline(always)]
pub(super) fn scale(predicted: f32, gains: &[i32; BUCKETS], inverse: f32) -> f32 {
    let gain = gains[bucket(predicted.abs() * inverse)];
    predicted * (gain as f32 * (1.0 / UNITY as f32))
}

/// Gains of one picture: `[band class][colour][bucket]`, in 1/[`UNITY`].
pub(crate) type PredictionGains = [[[i32; BUCKETS]; 3]; BAND_CLASSES];

/// Adaptive models of the gains, and the gains of the picture before.
#[derive(Debug, Clone)]
pub(crate) struct GainModels {
    last: PredictionGains,
    difference: [NumberModel; BUCKETS],
}

/// Gains of a band that is not predicted; not used.
pub(super) const NONE: [[i32; BUCKETS]; 3] = [[0; BUCKETS]; 3];

impl Default for GainModels {
    fn default() -> Self {
        let mut last = [[[UNITY / 2; BUCKETS]; 3]; BAND_CLASSES];
        last[10] = [[UNITY; BUCKETS]; 3];
        GainModels { last, difference: Default::default() }
    }
}

impl GainModels {
    /// The gains of the picture before, which the encoder falls back to.
    pub(crate) fn last(&self) -> &PredictionGains {
        &self.last
    }
    /// Codes the gains of the classes for which `used` is true.
    pub(crate) fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        gains: &mut PredictionGains,
        used: &[bool; BAND_CLASSES],
    ) {
        for class in (0..BAND_CLASSES).filter(|&c| used[c]) {
            for colour in 0..3 {
                for bucket in 0..BUCKETS {
                    let last = &mut self.last[class][colour][bucket];
                    let difference = gains[class][colour][bucket].wrapping_sub(*last);
                    let difference = self.difference[bucket].code_signed(coder, difference);
                    *last = last.wrapping_add(difference).clamp(0, MAX_GAIN);
                    gains[class][colour][bucket] = *last;
                }
            }
        }
    }
}

/// Sums over one class's coefficients, for the least-squares gain.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct GainSums {
    /// Sum of target times prediction.
    pub cross: f64,
    /// Sum of squared predictions.
    pub square: f64,
}

impl GainSums {
    /// The gain of least squares; `None` where nothing is predicted.
    pub(crate) fn best(&self) -> Option<f64> {
        let most = MAX_GAIN as f64 / UNITY as f64;
        (self.square > 0.0).then(|| (self.cross / self.square).clamp(0.0, most))
    }
    /// The stored gain of least squares; `last` where it gains less than about the bits of a change, valued at `lambda`
    /// (squared error a bit).
    pub(crate) fn choose(&self, last: i32, lambda: f64) -> i32 {
        if self.square <= 0.0 {
            return last;
        }
        let best = ((self.cross / self.square * UNITY as f64).round() as i32).clamp(0, MAX_GAIN);
        let error = |gain: i32| {
            let g = gain as f64 / UNITY as f64;
            g * g * self.square - 2.0 * g * self.cross
        };
        let bits = 2.0 * ((best - last).unsigned_abs() as f64 + 1.0).log2();
        if error(best) + lambda * bits < error(last) { best } else { last }
    }
}
