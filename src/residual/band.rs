//! One band of coefficients, or the part of it that lies in a tile, position by position.

use super::contexts::{BLOCK, BandClass, BandPart, CodedBand, CodedBands, CoefficientCoder, ParentBand};
use super::gains;
use crate::entropy::BitCoder;
use crate::quantise::bands::{Quantiser, RateDistortion, saves_cost};
use crate::transform::shape_adaptive::{ColourLanes, Orientation, Subband};

/// A band, or a part of one, as it is to be coded.
pub(super) struct BandTask<'a> {
    pub(super) band: &'a Subband,
    pub(super) part: BandPart<'a>,
    /// The prediction's coefficients; none of a part.
    pub(super) predicted: Option<&'a [ColourLanes]>,
    /// Gains of the prediction, by colour and bucket.
    pub(super) gains: &'a [[i32; gains::BUCKETS]; 3],
    /// In encoding: the band as it should be.
    pub(super) target: Option<(&'a [ColourLanes], RateDistortion)>,
    pub(super) step: f32,
    pub(super) inverse: f32,
}

impl BandTask<'_> {
    /// Returns the prediction of a position, which its values are added to; `out` holds the positions decoded before.
    #[inline(always)]
    fn prediction(&self, [x, y]: [usize; 2], out: &[&mut [ColourLanes]]) -> [f32; 3] {
        match self.predicted {
            Some(predicted) => {
                let predicted = &predicted[self.part.index_in_band(x, y)];
                std::array::from_fn(|colour| gains::scale(predicted[colour], &self.gains[colour], self.inverse))
            }
            None if self.band.orientation == Orientation::Low => neighbour_mean(out, &self.part, x, y),
            None => [0.0; 3],
        }
    }
    /// In encoding: what the values should be, in steps.
    #[inline(always)]
    fn wanted<C: BitCoder>(&self, [x, y]: [usize; 2], prediction: &[f32; 3]) -> Option<([f32; 3], RateDistortion)> {
        let (target, choice) = self.target.filter(|_| !C::DECODES)?;
        let target = &target[self.part.index_in_band(x, y)];
        Some((std::array::from_fn(|k| (target[k] - prediction[k]) * self.inverse), choice))
    }
    /// In encoding: whether positions are worth being coded.
    fn saves_cost<C: BitCoder>(&self, places: &[[usize; 2]], out: &[&mut [ColourLanes]]) -> bool {
        let wanted = places.iter().filter_map(|&place| self.wanted::<C>(place, &self.prediction(place, out)));
        self.target.is_some_and(|(_, choice)| saves_cost(wanted.map(|(wanted, _)| wanted), choice))
    }
    fn band_class(&self) -> BandClass {
        let (level, orientation) = (self.band.level, self.band.orientation);
        let (level, level_class) = match orientation {
            Orientation::Low => (0, 3),
            _ => (level, level.min(3) - 1),
        };
        BandClass {
            is_predicted: self.predicted.is_some(),
            band_class: level_class * 2 + (orientation == Orientation::Diagonal) as usize,
            level,
        }
    }
}

/// Codes a part of a band into `out`, its rows; returns its magnitudes. Not inlined, so that what lies in registers is what it needs.
#[inline(never)]
pub(super) fn code_band<C: BitCoder, K: CoefficientCoder<C>>(
    coder: &mut C,
    models: &mut K,
    quantiser: &Quantiser,
    task: &BandTask,
    parent: Option<ParentBand<K::Magnitudes>>,
    siblings: &[CodedBand<K::Magnitudes>],
    out: &mut [&mut [ColourLanes]],
) -> CodedBand<K::Magnitudes> {
    let BandTask { part, predicted, step, inverse, .. } = *task;
    let quarters = 4.0 / step;
    let mut here = CodedBand::new(&part.area, predicted, |p| K::prediction_magnitude(p, quarters));
    let place = task.band_class();
    let width = part.area.width;
    // By block of the row of blocks: whether it holds anything but zeros.
    let mut occupied = vec![true; width.div_ceil(BLOCK)];
    for y in 0..part.area.height {
        if coder.is_exhausted() {
            break;
        }
        if y % BLOCK == 0 && place.level == 1 {
            let is_wanted = |places: &[[usize; 2]]| task.saves_cost::<C>(places, out);
            let bands = CodedBands { here: &here, parent, siblings };
            models.code_blocks(coder, &bands, &part, y, &mut occupied, is_wanted);
        }
        let row = part.row(y);
        let mut x = 0;
        while let Some(skipped) = row[x..].iter().position(|&inside| inside) {
            x += skipped;
            let is_empty = !occupied[x / BLOCK];
            if is_empty && predicted.is_none() {
                let behind = ((x / BLOCK + 1) * BLOCK).min(width);
                out[y][x..behind].fill([0.0; 4]);
                x = behind;
                continue;
            }
            let prediction = task.prediction([x, y], out);
            let mut decoded = [prediction[0], prediction[1], prediction[2], 0.0];
            if !is_empty {
                let around = K::neighbourhood(&CodedBands { here: &here, parent, siblings }, x, y);
                let wanted = match task.wanted::<C>([x, y], &prediction) {
                    Some((wanted, choice)) => models.choose(wanted, quantiser, choice, &place, &around),
                    None => [0; 3],
                };
                let values = models.code(coder, &place, &around, &prediction, inverse, wanted);
                if values != [0; 3] {
                    let at = here.index(x, y);
                    here.values[at] = K::magnitudes(&values);
                    for colour in 0..3 {
                        decoded[colour] += quantiser.dequantise(values[colour], step);
                    }
                }
            }
            out[y][x] = decoded;
            x += 1;
        }
    }
    here
}

/// Mean of the decoded neighbours left and above, for the low band of a picture coded alone.
fn neighbour_mean(out: &[&mut [ColourLanes]], part: &BandPart, x: usize, y: usize) -> [f32; 3] {
    let left = (x > 0 && part.row(y)[x - 1]).then(|| out[y][x - 1]);
    let above = (y > 0 && part.row(y - 1)[x]).then(|| out[y - 1][x]);
    std::array::from_fn(|k| match (left, above) {
        (Some(left), Some(above)) => (left[k] + above[k]) * 0.5,
        (Some(one), None) | (None, Some(one)) => one[k],
        (None, None) => 0.0,
    })
}
