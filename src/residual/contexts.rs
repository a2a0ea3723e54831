//! Contexts of wavelet coefficients: the neighbourhood of a position before it is coded, and its classes.
//!
//! All numbers here are part of the format (`spec/planes.md`).

use crate::entropy::{BitCoder, NumberModel};
use crate::image::Mask;
use crate::quantise::bands::{MAX_MAGNITUDE, Quantiser, RateDistortion};
use crate::transform::shape_adaptive::ColourLanes;

/// Side of a block, in positions.
pub(super) const BLOCK: usize = 4;

/// Context modelling of coefficients: neighbourhood and adaptive models.
pub(super) trait ContextModel: Clone + std::fmt::Debug + Send + Sync {
    /// Magnitudes of the three colours at a position.
    type Magnitudes: Copy + Default + Send + Sync;
    /// Neighbourhood of a position.
    type Neighbourhood;

    /// Initial models.
    fn new() -> Self;
    /// Magnitudes of what was coded at a position.
    fn magnitudes(values: &[i32; 3]) -> Self::Magnitudes;
    /// Magnitudes of a predicted coefficient; `inverse` is four over the step.
    fn prediction_magnitude(predicted: &ColourLanes, inverse: f32) -> Self::Magnitudes;
    /// Gathers the neighbourhood of a position.
    fn neighbourhood(bands: &CodedBands<Self::Magnitudes>, x: usize, y: usize) -> Self::Neighbourhood;
    /// The values with the least squared error plus rate among those near `wanted`, which are given in steps.
    fn choose(
        &self,
        wanted: [f32; 3],
        quantiser: &Quantiser,
        choice: RateDistortion,
        place: &BandClass,
        around: &Self::Neighbourhood,
    ) -> [i32; 3];
}

/// Context models whose values a coder can code.
pub(super) trait CoefficientCoder<C: BitCoder>: ContextModel {
    /// Codes the three colours of a position. `prediction` is what they will be added to, `inverse` one over the step.
    fn code(
        &mut self,
        coder: &mut C,
        place: &BandClass,
        around: &Self::Neighbourhood,
        prediction: &[f32; 3],
        inverse: f32,
        wanted: [i32; 3],
    ) -> [i32; 3];
    /// Codes which blocks of the row that begins at `y` hold anything but zeros, if the model distinguishes them. `occupied` holds it for
    /// the row above, all true at first, and then of this one; `is_wanted` of positions that the encoder has.
    fn code_blocks(
        &mut self,
        _coder: &mut C,
        _bands: &CodedBands<Self::Magnitudes>,
        _part: &BandPart,
        _y: usize,
        _occupied: &mut [bool],
        _is_wanted: impl Fn(&[[usize; 2]]) -> bool,
    ) {
    }
}

/// A rectangle of a band, in positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct BandArea {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// The part of a band that one stream holds. Positions are counted from its left upper corner.
#[derive(Clone, Copy)]
pub(super) struct BandPart<'a> {
    mask: &'a Mask,
    pub(super) area: BandArea,
}

impl<'a> BandPart<'a> {
    pub(super) fn new(mask: &'a Mask, area: BandArea) -> Self {
        BandPart { mask, area }
    }
    /// A band as a whole.
    pub(super) fn whole(mask: &'a Mask) -> Self {
        BandPart { mask, area: BandArea { left: 0, top: 0, width: mask.width, height: mask.height } }
    }
    /// A row of the mask.
    #[inline(always)]
    pub(super) fn row(&self, y: usize) -> &'a [bool] {
        &self.mask.row(self.area.top + y)[self.area.left..][..self.area.width]
    }
    /// Index of a position in the band.
    #[inline(always)]
    pub(super) fn index_in_band(&self, x: usize, y: usize) -> usize {
        (self.area.top + y) * self.mask.width + self.area.left + x
    }
}

/// A part of a band and those coded before it.
#[derive(Clone, Copy)]
pub(super) struct CodedBands<'a, T> {
    pub(super) here: &'a CodedBand<T>,
    /// The band of this orientation one level coarser.
    pub(super) parent: Option<ParentBand<'a, T>>,
    /// Those of this level.
    pub(super) siblings: &'a [CodedBand<T>],
}

/// The part of the coarser band that lies above a part of a band.
pub(super) struct ParentBand<'a, T> {
    band: &'a CodedBand<T>,
    /// Index of what lies above the first position.
    first: usize,
}

impl<T> Clone for ParentBand<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for ParentBand<'_, T> {}

impl<'a, T: Copy + Default> ParentBand<'a, T> {
    /// `band`, in which `(x, y)` lies above the first position.
    pub(super) fn new(band: &'a CodedBand<T>, [x, y]: [usize; 2]) -> Self {
        ParentBand { band, first: band.index(x, y) }
    }
    /// What lies above a position.
    #[inline(always)]
    pub(super) fn above(&self, x: usize, y: usize) -> T {
        self.band.values[self.first + y / 2 * self.band.stride + x / 2]
    }
    /// `count` positions of the coarser band from `(x, y)`, counted there from what lies above the first position.
    pub(super) fn coarse(&self, x: usize, y: usize, count: usize) -> &'a [T] {
        let at = self.first + y * self.band.stride + x;
        self.band.values.get(at..at + count).unwrap_or_default()
    }
}

/// A part of a band during coding: magnitudes of coded values and of the prediction, with a margin of two columns and rows before the first
/// and of as many behind the last as a block may reach, so that neighbours need no checks.
pub(super) struct CodedBand<T> {
    pub(super) stride: usize,
    pub(super) values: Vec<T>,
    /// Empty where there is no prediction.
    prediction_magnitudes: Vec<T>,
}

impl<T: Copy + Default> CodedBand<T> {
    /// A part of which nothing is coded; with a prediction, it is a whole band.
    pub(super) fn new(area: &BandArea, predicted: Option<&[ColourLanes]>, hint: impl Fn(&ColourLanes) -> T) -> Self {
        let BandArea { width, height, .. } = *area;
        let stride = width + 2 + BLOCK;
        let empty = vec![T::default(); stride * (height + 1 + BLOCK)];
        let mut known = CodedBand { stride, values: empty, prediction_magnitudes: Vec::new() };
        if let Some(predicted) = predicted {
            known.prediction_magnitudes = vec![T::default(); known.values.len()];
            for y in 0..height {
                let at = known.index(0, y);
                for (place, p) in known.prediction_magnitudes[at..].iter_mut().zip(&predicted[y * width..][..width]) {
                    *place = hint(p);
                }
            }
        }
        known
    }
    /// Index of a position.
    #[inline(always)]
    pub(super) fn index(&self, x: usize, y: usize) -> usize {
        (y + 2) * self.stride + x + 2
    }
    /// The prediction's magnitudes, 0 without one.
    #[inline(always)]
    pub(super) fn prediction_magnitude(&self, at: usize) -> T {
        self.prediction_magnitudes.get(at).copied().unwrap_or_default()
    }
}

/// Classes of bands by level and direction, for each colour.
pub(super) const CLASSES: usize = 8 * 3;

/// Codes a magnitude that is at least `least`, and at most [`MAX_GAIN`].
pub(super) fn code_escaped<C: BitCoder>(coder: &mut C, number: &mut NumberModel, least: u32, goal: u32) -> u32 {
    least.saturating_add(number.code(coder, goal.wrapping_sub(least))).min(MAX_MAGNITUDE)
}

/// Classes that all positions of a band share.
pub(super) struct BandClass {
    pub(super) is_predicted: bool,
    pub(super) band_class: usize,
    pub(super) level: usize,
}

/// Classes of a non-negative sum, finer where it is small: 0, 1, 2, 3, 4, 5-6, 7-8, 9-11, 12-15, 16-22, 23-36, 37 and more.
#[inline(always)]
pub(super) fn bucket_12(value: u32) -> u32 {
    const TABLE: [u8; 40] = [
        0, 1, 2, 3, 4, 5, 5, 6, 6, 7, 7, 7, 8, 8, 8, 8, 9, 9, 9, 9, 9, 9, 9, 10, 10, 10, 10, 10, 10, 10, 10, 10, 10,
        10, 10, 10, 10, 11, 11, 11,
    ];
    TABLE[value.min(39) as usize] as u32
}

/// 0, 1, 2, 3-4, 5-7, 8-12, 13-24, 25 and more.
#[inline(always)]
pub(super) fn bucket_8(value: u32) -> u32 {
    const TABLE: [u8; 26] = [0, 1, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 7];
    TABLE[value.min(25) as usize] as u32
}

/// 0 and 1, 2-4, 5-12, 13 and more.
#[inline(always)]
pub(super) fn bucket_4(value: u32) -> u32 {
    bucket_8(value).min(6) / 2
}

/// Half-octave classes up to `most`.
#[inline(always)]
pub(super) fn log2_bucket(value: u32, most: u32) -> u32 {
    if value < 2 {
        return value;
    }
    let top = 31 - value.leading_zeros();
    (2 * top + (value >> (top - 1) & 1)).min(most)
}
