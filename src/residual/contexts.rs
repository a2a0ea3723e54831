//! Contexts of wavelet coefficients: what is known around a position before it is coded, and its classes.
//!
//! All numbers here are part of the format (`spec/planes.md`).

use super::gains;
use crate::entropy::Predictor;
use crate::transform::shape_adaptive::{Band, Pixel};

/// Side of a block, in positions.
pub(super) const BLOCK: usize = 4;

/// What tells bits apart: contexts, and what learns their probabilities.
pub(super) trait Contexts {
    /// What predicts a decision.
    type Predictor: Predictor + Clone + std::fmt::Debug;
    /// Magnitudes of the three colours at a position.
    type Lanes: Copy + Default;
    /// What is known around a position.
    type Around;
    /// What is known before a coefficient.
    type Magnitude;

    /// Predictors of the decisions whether any colour is not zero, and whether a magnitude is larger.
    fn predictors() -> [Self::Predictor; 2];
    /// Magnitudes of what was coded at a position.
    fn lanes(values: &[i32; 3]) -> Self::Lanes;
    /// Magnitudes of a predicted coefficient; `inverse` is four over the step.
    fn hint(predicted: &Pixel, inverse: f32) -> Self::Lanes;
    /// What predicts whether a block of the finest bands is all zero; `None` where there are no blocks.
    fn blocks() -> Option<Self::Predictor>;
    /// Context of the decision whether a block ([`BLOCK`] positions square, counted by `x` and `y`) has anything but zeros.
    /// `beside` says it of the block before it and the one above it.
    fn block(
        parent: Option<&Known<Self::Lanes>>,
        siblings: &[Known<Self::Lanes>],
        beside: [bool; 2],
        x: usize,
        y: usize,
    ) -> <Self::Predictor as Predictor>::Context;
    /// Gathers what is known around a position. `parent` is the same band one level coarser, `siblings` those of the same level.
    fn around(
        here: &Known<Self::Lanes>,
        parent: Option<&Known<Self::Lanes>>,
        siblings: &[Known<Self::Lanes>],
        x: usize,
        y: usize,
    ) -> Self::Around;
    /// Context of the decision whether any of the three colours is not zero.
    fn any(place: &Place, around: &Self::Around) -> <Self::Predictor as Predictor>::Context;
    /// What predicts the magnitude of a colour; `before` are the values of the colours before it.
    fn magnitude(place: &Place, around: &Self::Around, colour: usize, before: &[i32; 3]) -> Self::Magnitude;
    /// Context of the decision whether the magnitude is larger than `index`.
    fn decision(magnitude: &Self::Magnitude, index: u32) -> <Self::Predictor as Predictor>::Context;
}

/// What is known of a band: magnitudes of what was coded and of the prediction, with a margin of two columns and rows before the first
/// and of as many behind the last as a block may reach, so that neighbours need no checks.
pub(super) struct Known<T> {
    pub(super) stride: usize,
    pub(super) values: Vec<T>,
    /// Empty where there is no prediction.
    hints: Vec<T>,
}

impl<T: Copy + Default> Known<T> {
    /// A band of which nothing is coded.
    pub(super) fn new(band: &Band, predicted: Option<&[Pixel]>, hint: impl Fn(&Pixel) -> T) -> Self {
        let (width, height) = (band.mask.width, band.mask.height);
        let stride = width + 2 + BLOCK;
        let empty = vec![T::default(); stride * (height + 1 + BLOCK)];
        let mut known = Known { stride, values: empty, hints: Vec::new() };
        if let Some(predicted) = predicted {
            known.hints = vec![T::default(); known.values.len()];
            for y in 0..height {
                let at = known.index(0, y);
                for (place, p) in known.hints[at..].iter_mut().zip(&predicted[y * width..][..width]) {
                    *place = hint(p);
                }
            }
        }
        known
    }
    /// Where a position stands.
    #[inline(always)]
    pub(super) fn index(&self, x: usize, y: usize) -> usize {
        (y + 2) * self.stride + x + 2
    }
    /// The prediction's magnitudes, 0 without one.
    #[inline(always)]
    pub(super) fn hint(&self, at: usize) -> T {
        self.hints.get(at).copied().unwrap_or_default()
    }
}

/// Decisions that have slots of their own: larger than 0, than 1, than 2 or more.
pub(super) const KINDS: usize = 3;
/// Classes of bands by level and direction, for each colour.
pub(super) const CLASSES: usize = 8 * 3;

/// What is the same for a whole band.
pub(super) struct Place {
    pub(super) is_predicted: bool,
    pub(super) band_class: usize,
    pub(super) level: usize,
}

/// Classes of a non-negative sum, finer where it is small: 0, 1, 2, 3, 4, 5-6, 7-8, 9-11, 12-15, 16-22, 23-36, 37 and more.
#[inline(always)]
pub(super) fn class_12(value: u32) -> u32 {
    const TABLE: [u8; 40] = [
        0, 1, 2, 3, 4, 5, 5, 6, 6, 7, 7, 7, 8, 8, 8, 8, 9, 9, 9, 9, 9, 9, 9, 10, 10, 10, 10, 10, 10, 10, 10, 10, 10,
        10, 10, 10, 10, 11, 11, 11,
    ];
    TABLE[value.min(39) as usize] as u32
}

/// 0, 1, 2, 3-4, 5-7, 8-12, 13-24, 25 and more.
#[inline(always)]
pub(super) fn class_8(value: u32) -> u32 {
    const TABLE: [u8; 26] = [0, 1, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 7];
    TABLE[value.min(25) as usize] as u32
}

/// 0 and 1, 2-4, 5-12, 13 and more.
#[inline(always)]
pub(super) fn few(value: u32) -> u32 {
    class_8(value).min(6) / 2
}

/// Half-octave classes up to `most`.
#[inline(always)]
pub(super) fn logarithmic(value: u32, most: u32) -> u32 {
    if value < 2 {
        return value;
    }
    let top = 31 - value.leading_zeros();
    (2 * top + (value >> (top - 1) & 1)).min(most)
}

/// Context of the sign: the prediction's sign and size, and the signs of the colours before.
#[inline(always)]
pub(super) fn sign_context(place: &Place, colour: usize, before: &[i32; 3], prediction: f32, inverse: f32) -> usize {
    let size = gains::bucket(prediction.abs() * inverse * 2.0) + 1;
    let signed = if prediction > 0.0 {
        3 + size
    } else if prediction < 0.0 {
        3 - size
    } else {
        3
    };
    let other = |k: usize| match before[k] {
        _ if k >= colour => 0,
        0 => 0,
        v if v > 0 => 1,
        _ => 2,
    };
    (place.band_class * 7 + signed) * 9 + other(0) * 3 + other(1)
}
