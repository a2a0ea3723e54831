//! Quantiser of wavelet bands, and what the encoder weighs errors and bits with.
//!
//! Normative text: `spec/planes.md`, section 7.

use crate::transform::shape_adaptive::{Orientation, Subband};

/// Largest magnitude of a quantised coefficient.
pub(crate) const MAX_MAGNITUDE: u32 = 1 << 20;

/// Quantiser of one picture.
#[derive(Debug, Clone, Copy)]
pub struct Quantiser {
    /// Step of each band class of level 1, 2 and coarser is `step * LEVEL_STEPS`.
    pub step: f32,
    /// Reconstruction of magnitude 1 and of larger ones lies this far below the middle of its interval, in steps.
    pub shrink: [f32; 2],
}

/// Steps by level, finest first, relative to the picture's step. Part of the format.
const LEVEL_STEPS: [f32; 5] = [1.08, 0.95, 0.9, 0.85, 0.85];

impl Quantiser {
    /// A band's step.
    pub fn band_step(&self, band: &Subband) -> f32 {
        let level = if band.orientation == Orientation::Low { 5 } else { band.level.max(1) };
        self.step * LEVEL_STEPS[level - 1]
    }
    /// Middle of a value's interval, or what lies nearer to zero.
    #[inline(always)]
    pub fn dequantise(&self, value: i32, step: f32) -> f32 {
        let magnitude = value.unsigned_abs();
        let shrink = [0.0, self.shrink[0], self.shrink[1]][magnitude.min(2) as usize];
        let size = (magnitude as f32 - shrink) * step;
        if value < 0 { -size } else { size }
    }
}

/// Rate-distortion trade-off.
#[derive(Debug, Clone, Copy)]
pub struct RateDistortion {
    /// Value of a bit in squared steps.
    pub lambda: f32,
}

/// Magnitudes to choose from for a coefficient of `magnitude` steps: the nearest, and one or two nearer to zero.
pub(crate) fn candidate_magnitudes(magnitude: f32) -> std::ops::RangeInclusive<u32> {
    let nearest = (magnitude + 0.5) as u32;
    nearest.saturating_sub(if nearest <= 2 { 2 } else { 1 })..=nearest
}

/// Whether coding a block lowers its squared error by more than the estimated cost of its bits.
pub(crate) fn saves_cost(wanted: impl Iterator<Item = [f32; 3]>, choice: RateDistortion) -> bool {
    let (mut gain, mut bits) = (0.0, 2.0);
    for wanted in wanted.flatten().map(f32::abs).filter(|wanted| *wanted >= 0.5) {
        let left = wanted - (wanted + 0.5).floor();
        gain += wanted * wanted - left * left;
        bits += BITS_OF_A_COEFFICIENT;
    }
    gain > choice.lambda * bits
}

/// Approximate cost of a coefficient that is not zero, in bits, for [`saves_cost`]. The encoder's choice.
const BITS_OF_A_COEFFICIENT: f32 = 6.0;
