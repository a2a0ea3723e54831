//! Wavelet coefficients as bits: contexts from the neighbours, the coarser band, the other colours and the prediction.
//!
//! One function serves both directions, so that they can't disagree. Normative text: `spec/planes.md`.

use super::contexts::{BLOCK, BandClass, CodedBand, CodedBands, CoefficientCoder, ContextModel};
use super::direct::DirectModel;
use super::gains::{self, BAND_CLASSES, GainModels, GainSums, PredictionGains};
use super::mixed::MixedModel;
use crate::entropy::{BitCoder, RangeDecoder, RansDecoder};
#[cfg(feature = "encode")]
use crate::entropy::{RangeEncoder, RansEncoder};
use crate::quantise::bands::{Quantiser, RateDistortion, saves_cost};
use crate::transform::masked::Coefficients;
use crate::transform::shape_adaptive::{ColourLanes, Orientation, Subband, WaveletPlan};

/// Entropy modelling of a picture's coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Modelling {
    /// Eight contexts of each decision, mixed: the smallest files.
    #[default]
    Mixed = 0,
    /// Symbols of 16 values, each from two contexts: decoded several times faster.
    Direct = 1,
}

/// Adaptive state of one component; handed from a picture to those coded after it.
#[derive(Debug, Clone)]
pub struct CoefficientModels(ModellingState);

#[derive(Debug, Clone)]
enum ModellingState {
    Mixed(Box<CoefficientState<MixedModel>>),
    Direct(Box<CoefficientState<DirectModel>>),
}

impl CoefficientModels {
    /// Fresh models.
    pub fn new(modelling: Modelling) -> Self {
        CoefficientModels(match modelling {
            Modelling::Mixed => ModellingState::Mixed(Box::new(CoefficientState::new())),
            Modelling::Direct => ModellingState::Direct(Box::new(CoefficientState::new())),
        })
    }
}

#[derive(Debug, Clone)]
struct CoefficientState<K> {
    values: K,
    gains: GainModels,
}

impl<K: ContextModel> CoefficientState<K> {
    fn new() -> Self {
        CoefficientState { values: K::new(), gains: GainModels::default() }
    }
}

/// Writes the coefficients of one picture, three colours together, as a stream; returns them as the decoder has them, too.
///
/// `predicted` are the coefficients of the prediction (none for a picture coded alone), `target` those of the picture. Bands are those of
/// `plan`.
#[cfg(feature = "encode")]
pub fn encode(
    models: &mut CoefficientModels,
    plan: &WaveletPlan,
    quantiser: &Quantiser,
    predicted: Option<&[Vec<ColourLanes>]>,
    target: &[Vec<ColourLanes>],
    choice: RateDistortion,
) -> (Vec<u8>, Coefficients) {
    let target = Some((target, choice));
    match &mut models.0 {
        ModellingState::Mixed(state) => {
            let mut coder = RangeEncoder::new();
            let decoded = code_with(&mut coder, state, plan, quantiser, predicted, target, Coefficients::default());
            (coder.finish(), decoded)
        }
        ModellingState::Direct(state) => {
            let mut coder = RansEncoder::new();
            let decoded = code_with(&mut coder, state, plan, quantiser, predicted, target, Coefficients::default());
            (coder.finish(), decoded)
        }
    }
}

/// Reads what [`encode`] has written; `None` where the stream does not end with the last coefficient. `scratch` is memory to use again:
/// what an earlier call has returned.
pub fn decode(
    stream: &[u8],
    models: &mut CoefficientModels,
    plan: &WaveletPlan,
    quantiser: &Quantiser,
    predicted: Option<&[Vec<ColourLanes>]>,
    scratch: Coefficients,
) -> Option<Coefficients> {
    let (coefficients, is_whole) = match &mut models.0 {
        ModellingState::Mixed(state) => {
            let mut coder = RangeDecoder::new(stream);
            let decoded = code_with(&mut coder, state, plan, quantiser, predicted, None, scratch);
            (decoded, coder.ends_as_written(0))
        }
        ModellingState::Direct(state) => {
            let mut coder = RansDecoder::new(stream);
            let decoded = code_with(&mut coder, state, plan, quantiser, predicted, None, scratch);
            (decoded, coder.ends_as_written())
        }
    };
    is_whole.then_some(coefficients)
}

/// Codes the coefficients of a picture without a prediction, by fresh models, among what else a coder takes. `target` is for encoding.
pub(crate) fn code_alone<C: BitCoder>(
    coder: &mut C,
    plan: &WaveletPlan,
    quantiser: &Quantiser,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
) -> Coefficients {
    code_with(coder, &mut CoefficientState::<MixedModel>::new(), plan, quantiser, None, target, Coefficients::default())
}

fn code_with<C: BitCoder, K: CoefficientCoder<C>>(
    coder: &mut C,
    models: &mut CoefficientState<K>,
    plan: &WaveletPlan,
    quantiser: &Quantiser,
    predicted: Option<&[Vec<ColourLanes>]>,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    mut coefficients: Coefficients,
) -> Coefficients {
    let bands = plan.bands();
    let mut gains = *models.gains.last();
    if let Some(predicted) = predicted {
        if let Some((target, choice)) = target {
            choose_gains(&mut gains, bands, quantiser, predicted, target, choice);
        }
        let mut used = [false; BAND_CLASSES];
        for band in &bands[..predicted.len()] {
            used[gains::band_class(band)] = true;
        }
        models.gains.code(coder, &mut gains, &used);
    }
    coefficients.reset(bands.len());
    let mut known: Vec<CodedBand<K::Magnitudes>> = Vec::with_capacity(bands.len());
    for (index, band) in bands.iter().enumerate() {
        let step = quantiser.band_step(band);
        let task = BandTask {
            band,
            predicted: predicted.and_then(|predicted| predicted.get(index)).map(Vec::as_slice),
            gains: &gains[gains::band_class(band)],
            target: target.map(|(target, choice)| (&target[index][..], choice)),
            step,
            inverse: 1.0 / step,
        };
        let parent = (band.orientation != Orientation::Low && index > 3).then(|| &known[index - 3]);
        // Already coded bands of the same level.
        let siblings = match band.orientation {
            Orientation::Vertical => 1,
            Orientation::Diagonal => 2,
            _ => 0,
        };
        let siblings = &known[index - siblings..];
        let out = coefficients.band_mut(index, band.mask.data.len());
        let here = code_band(coder, &mut models.values, quantiser, &task, parent, siblings, out);
        known.push(here);
    }
    coefficients
}

/// One band of a picture, as it is to be coded.
struct BandTask<'a> {
    band: &'a Subband,
    predicted: Option<&'a [ColourLanes]>,
    /// Gains of the prediction, by colour and bucket.
    gains: &'a [[i32; gains::BUCKETS]; 3],
    /// In encoding.
    target: Option<(&'a [ColourLanes], RateDistortion)>,
    step: f32,
    inverse: f32,
}

impl BandTask<'_> {
    /// Returns the prediction of a position, which its values are added to; `out` holds the positions decoded before.
    #[inline(always)]
    fn prediction(&self, flat: usize, out: &[ColourLanes]) -> [f32; 3] {
        match self.predicted {
            Some(predicted) => std::array::from_fn(|colour| {
                let p = predicted[flat][colour];
                let gain = self.gains[colour][gains::bucket(p.abs() * self.inverse)];
                p * (gain as f32 * (1.0 / gains::UNITY as f32))
            }),
            None if self.band.orientation == Orientation::Low => {
                let width = self.band.mask.width;
                std::array::from_fn(|k| neighbour_mean(out, self.band, flat % width, flat / width, k))
            }
            None => [0.0; 3],
        }
    }
    /// In encoding: what the values should be, in steps.
    #[inline(always)]
    fn wanted<C: BitCoder>(&self, flat: usize, prediction: &[f32; 3]) -> Option<([f32; 3], RateDistortion)> {
        let (target, choice) = self.target.filter(|_| !C::DECODES)?;
        Some((std::array::from_fn(|k| (target[flat][k] - prediction[k]) * self.inverse), choice))
    }
    /// In encoding: whether positions are worth being coded.
    fn saves_cost<C: BitCoder>(&self, places: &[usize], out: &[ColourLanes]) -> bool {
        let wanted = places.iter().filter_map(|&flat| self.wanted::<C>(flat, &self.prediction(flat, out)));
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

/// Codes a band into `out`; returns its magnitudes. Not inlined, so that what lies in registers is what it needs.
#[inline(never)]
fn code_band<C: BitCoder, K: CoefficientCoder<C>>(
    coder: &mut C,
    models: &mut K,
    quantiser: &Quantiser,
    task: &BandTask,
    parent: Option<&CodedBand<K::Magnitudes>>,
    siblings: &[CodedBand<K::Magnitudes>],
    out: &mut [ColourLanes],
) -> CodedBand<K::Magnitudes> {
    let BandTask { band, predicted, step, inverse, .. } = *task;
    let quarters = 4.0 / step;
    let mut here = CodedBand::new(band, predicted, |p| K::prediction_magnitude(p, quarters));
    let place = task.band_class();
    let width = band.mask.width;
    // By block of the row of blocks: whether it holds anything but zeros.
    let mut occupied = vec![true; width.div_ceil(BLOCK)];
    for y in 0..band.mask.height {
        if coder.is_exhausted() {
            break;
        }
        if y % BLOCK == 0 && place.level == 1 {
            let is_wanted = |places: &[usize]| task.saves_cost::<C>(places, out);
            let bands = CodedBands { here: &here, parent, siblings };
            models.code_blocks(coder, &bands, &band.mask, y, &mut occupied, is_wanted);
        }
        let row = band.mask.row(y);
        let mut x = 0;
        while let Some(skipped) = row[x..].iter().position(|&inside| inside) {
            x += skipped;
            let flat = y * width + x;
            let is_empty = !occupied[x / BLOCK];
            if is_empty && predicted.is_none() {
                let behind = ((x / BLOCK + 1) * BLOCK).min(width);
                out[flat..flat + behind - x].fill([0.0; 4]);
                x = behind;
                continue;
            }
            let prediction = task.prediction(flat, out);
            let mut decoded = [prediction[0], prediction[1], prediction[2], 0.0];
            if !is_empty {
                let around = K::neighbourhood(&CodedBands { here: &here, parent, siblings }, x, y);
                let wanted = match task.wanted::<C>(flat, &prediction) {
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
            out[flat] = decoded;
            x += 1;
        }
    }
    here
}

/// Mean of the decoded neighbours left and above, for the low band of a picture coded alone.
fn neighbour_mean(out: &[ColourLanes], band: &Subband, x: usize, y: usize, colour: usize) -> f32 {
    let (width, mask) = (band.mask.width, &band.mask);
    let left = x > 0 && *mask.value_at(x - 1, y);
    let above = y > 0 && *mask.value_at(x, y - 1);
    match (left, above) {
        (true, true) => (out[y * width + x - 1][colour] + out[(y - 1) * width + x][colour]) * 0.5,
        (true, false) => out[y * width + x - 1][colour],
        (false, true) => out[(y - 1) * width + x][colour],
        (false, false) => 0.0,
    }
}

fn choose_gains(
    gains: &mut PredictionGains,
    bands: &[Subband],
    quantiser: &Quantiser,
    predicted: &[Vec<ColourLanes>],
    target: &[Vec<ColourLanes>],
    choice: RateDistortion,
) {
    let mut sums = [[[GainSums::default(); gains::BUCKETS]; 3]; BAND_CLASSES];
    for (index, band) in bands.iter().enumerate().take(predicted.len()) {
        let class = gains::band_class(band);
        let step = quantiser.band_step(band);
        for ((p, t), _) in predicted[index].iter().zip(&target[index]).zip(&band.mask.data).filter(|(_, m)| **m) {
            for colour in 0..3 {
                let sum = &mut sums[class][colour][gains::bucket(p[colour].abs() / step)];
                let p = p[colour] as f64;
                sum.cross += p * t[colour] as f64;
                sum.square += p * p;
            }
        }
    }
    let lambda = choice.lambda as f64 * (quantiser.step as f64).powi(2);
    for class in 0..BAND_CLASSES {
        for colour in 0..3 {
            for bucket in 0..gains::BUCKETS {
                let gain = &mut gains[class][colour][bucket];
                *gain = sums[class][colour][bucket].choose(*gain, lambda);
            }
        }
    }
}
