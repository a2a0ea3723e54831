//! Wavelet coefficients as bits: contexts from the neighbours, the coarser band, the other colours and the prediction.
//!
//! One function serves both directions, so that they can't disagree. Normative text: `spec/planes.md`.

use super::contexts::{Around, CLASSES, KINDS, MagnitudeContext, Magnitudes, Place, any_context, sign_context};
use super::gains::{self, BAND_CLASSES, GainModels, GainSums, Gains};
use crate::entropy::mixer::{Mixer, cost};
use crate::entropy::{BitCoder, BitModel, Number};
use crate::transform::shape_adaptive::{Band, Orientation, Pixel, Plan};

/// Magnitudes from here on are coded by [`Number`].
const ESCAPE: u32 = 14;
/// Largest magnitude of a quantised coefficient.
const LARGEST: u32 = 1 << 20;

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
    fn band_step(&self, band: &Band) -> f32 {
        let level = if band.orientation == Orientation::Low { 5 } else { band.level.max(1) };
        self.step * LEVEL_STEPS[level - 1]
    }
    #[inline(always)]
    fn dequantise(&self, value: i32, step: f32) -> f32 {
        match value {
            0 => 0.0,
            1 | -1 => value as f32 * (step * (1.0 - self.shrink[0])),
            _ => {
                let magnitude = value.unsigned_abs() as f32 - self.shrink[1];
                if value < 0 { -(magnitude * step) } else { magnitude * step }
            }
        }
    }
}

/// What the encoder wants.
#[derive(Debug, Clone, Copy)]
pub struct Choice {
    /// Value of a bit in squared steps.
    pub lambda: f32,
}

/// Adaptive state of one component; handed from a picture to those coded after it.
#[derive(Debug, Clone)]
pub struct Models {
    /// Whether any of the three colours is not zero.
    any: Mixer,
    magnitude: Mixer,
    sign: Vec<BitModel>,
    escape: Number,
    gains: GainModels,
}

impl Default for Models {
    fn default() -> Self {
        let base = CLASSES * KINDS;
        Models {
            any: Mixer::new(
                [8 * 12 * 9, 8 * 12 * 12, 6 * 24, 8 * 8 * 8, 8 * 9 * 8, 256 * 4, 32 * 4, 9 * 9 * 8],
                [16, 16],
            ),
            magnitude: Mixer::new(
                [
                    base * 12 * 9,
                    base * 12 * 8,
                    KINDS * 3 * 6 * 24,
                    base * 8 * 8,
                    base * 9 * 8,
                    KINDS * 3 * 256 * 4,
                    KINDS * 3 * 32 * 4,
                    KINDS * 3 * 8 * 8 * 4,
                ],
                [2 * base, KINDS * 16],
            ),
            sign: vec![BitModel::default(); 8 * 7 * 9],
            escape: Number::default(),
            gains: GainModels::default(),
        }
    }
}

/// Codes the coefficients of one picture, three colours together, and returns them as the decoder has them.
///
/// `predicted` are the coefficients of the prediction (none for a picture coded alone), `target` those of the picture
/// (encoding only). Bands are those of `plan`.
pub fn code<C: BitCoder>(
    coder: &mut C,
    models: &mut Models,
    plan: &Plan,
    quantiser: &Quantiser,
    predicted: Option<&[Vec<Pixel>]>,
    target: Option<(&[Vec<Pixel>], Choice)>,
) -> Vec<Vec<Pixel>> {
    let bands = plan.bands();
    let mut gains = *models.gains.last();
    if let Some(predicted) = predicted {
        if let Some((target, choice)) = target {
            choose_gains(&mut gains, bands, quantiser, predicted, target, choice);
        }
        let mut used = [false; BAND_CLASSES];
        for band in bands {
            used[gains::band_class(band)] = true;
        }
        models.gains.code(coder, &mut gains, &used);
    }
    let mut decoded: Vec<Vec<Pixel>> = Vec::with_capacity(bands.len());
    let mut magnitudes: Vec<Magnitudes> = Vec::with_capacity(bands.len());
    for (index, band) in bands.iter().enumerate() {
        let step = quantiser.band_step(band);
        let mut here = Magnitudes::new(band);
        let mut out = vec![[0.0f32; 4]; band.mask.data.len()];
        // Magnitudes of the prediction in quarter steps, in the same layout.
        let mut hints = Magnitudes::new(band);
        if let Some(predicted) = predicted {
            let inverse = 4.0 / step;
            for y in 0..band.mask.height {
                for x in 0..band.mask.width {
                    let at = hints.index(x, y);
                    let p = &predicted[index][y * band.mask.width + x];
                    hints.values[at] = std::array::from_fn(|k| (p[k].abs() * inverse).min(8191.0) as i16);
                }
            }
        }
        let parent = (band.orientation != Orientation::Low && index > 3).then(|| index - 3);
        // Already coded bands of the same level.
        let siblings = match band.orientation {
            Orientation::Vertical => 1,
            Orientation::Diagonal => 2,
            _ => 0,
        };
        let class = gains::band_class(band);
        let level_class = match band.orientation {
            Orientation::Low => 3,
            _ => band.level.min(3) - 1,
        };
        let place = Place {
            is_predicted: predicted.is_some(),
            band_class: level_class * 2 + (band.orientation == Orientation::Diagonal) as usize,
            level: if band.orientation == Orientation::Low { 0 } else { band.level },
        };
        let low = band.orientation == Orientation::Low;
        let inverse = 1.0 / step;
        for y in 0..band.mask.height {
            for x in 0..band.mask.width {
                let flat = y * band.mask.width + x;
                if !band.mask.data[flat] {
                    continue;
                }
                let at = here.index(x, y);
                let prediction: [f32; 3] = match predicted {
                    Some(predicted) => std::array::from_fn(|colour| {
                        let p = predicted[index][flat][colour];
                        let gain = gains[class][colour][gains::bucket(p.abs() * inverse)];
                        p * (gain as f32 * (1.0 / gains::UNITY as f32))
                    }),
                    None if low => std::array::from_fn(|colour| neighbour_mean(&out, band, x, y, colour)),
                    None => [0.0; 3],
                };
                let parent = parent.map_or([0; 4], |p| {
                    let m: &Magnitudes = &magnitudes[p];
                    m.values[m.index(x / 2, y / 2)]
                });
                let mut sibling = [0i16; 4];
                for s in 1..=siblings {
                    let other = &magnitudes[index - s].values[at];
                    (0..4).for_each(|k| sibling[k] += other[k]);
                }
                let around = Around::new(&here, &hints, at, parent, sibling);
                let wanted = match target {
                    Some((target, choice)) if !C::DECODES => {
                        let wanted = std::array::from_fn(|k| (target[index][flat][k] - prediction[k]) * inverse);
                        choose(wanted, quantiser, choice, models, &place, &around)
                    }
                    _ => [0; 3],
                };
                let values = code_values(coder, models, &place, &around, &prediction, inverse, wanted);
                for colour in 0..3 {
                    here.values[at][colour] = values[colour].unsigned_abs().min(255) as i16;
                    out[flat][colour] = prediction[colour] + quantiser.dequantise(values[colour], step);
                }
            }
        }
        decoded.push(out);
        magnitudes.push(here);
    }
    decoded
}

/// Mean of the decoded neighbours left and above, for the low band of a picture coded alone.
fn neighbour_mean(out: &[Pixel], band: &Band, x: usize, y: usize, colour: usize) -> f32 {
    let (width, mask) = (band.mask.width, &band.mask);
    let left = x > 0 && *mask.at(x - 1, y);
    let above = y > 0 && *mask.at(x, y - 1);
    match (left, above) {
        (true, true) => (out[y * width + x - 1][colour] + out[(y - 1) * width + x][colour]) * 0.5,
        (true, false) => out[y * width + x - 1][colour],
        (false, true) => out[(y - 1) * width + x][colour],
        (false, false) => 0.0,
    }
}

/// The quantised values with the least squared error plus rate: each colour's among the nearest and those nearer to zero,
/// then these together or none.
#[inline(always)]
fn choose(
    wanted: [f32; 3],
    quantiser: &Quantiser,
    choice: Choice,
    models: &Models,
    place: &Place,
    around: &Around,
) -> [i32; 3] {
    if wanted.iter().all(|w| w.abs() < 0.5) {
        return [0; 3];
    }
    let any = any_context(place, around);
    let probability = models.any.probability(&any.slots, &any.selectors);
    let mut values = [0i32; 3];
    let mut together = choice.lambda * cost(probability, true);
    let mut none = choice.lambda * cost(probability, false);
    for colour in 0..3 {
        let magnitude = wanted[colour].abs().min(LARGEST as f32 - 1.0);
        none += magnitude * magnitude;
        let nearest = (magnitude + 0.5) as u32;
        let lowest = nearest.saturating_sub(if nearest <= 2 { 2 } else { 1 });
        let context = MagnitudeContext::new(place, around, colour, &values);
        let implied = colour == 2 && values[0] == 0 && values[1] == 0;
        let mut bits = 0.0;
        let mut best = (f32::INFINITY, 0);
        for index in 0..=nearest.min(ESCAPE) {
            let decision = context.decision(index);
            let probability = models.magnitude.probability(&decision.slots, &decision.selectors);
            let (stop, go) =
                if implied && index == 0 { (0.0, 0.0) } else { (cost(probability, false), cost(probability, true)) };
            if index >= lowest || index == ESCAPE {
                let candidate = if index == ESCAPE { nearest } else { index };
                let rate = bits + if candidate < ESCAPE { stop } else { 0.0 } + (candidate > 0) as u32 as f32;
                let error = magnitude - quantiser.dequantise(candidate as i32, 1.0);
                let value = error * error + choice.lambda * rate;
                if value < best.0 {
                    best = (value, candidate);
                }
            }
            bits += go;
        }
        together += best.0;
        values[colour] = if wanted[colour] < 0.0 { -(best.1 as i32) } else { best.1 as i32 };
    }
    if none <= together { [0; 3] } else { values }
}

/// Codes the three colours of a position.
#[inline(always)]
fn code_values<C: BitCoder>(
    coder: &mut C,
    models: &mut Models,
    place: &Place,
    around: &Around,
    prediction: &[f32; 3],
    inverse: f32,
    wanted: [i32; 3],
) -> [i32; 3] {
    let any = any_context(place, around);
    if !models.any.code(coder, &any.slots, &any.selectors, wanted != [0; 3]) {
        return [0; 3];
    }
    let mut values = [0i32; 3];
    for colour in 0..3 {
        let context = MagnitudeContext::new(place, around, colour, &values);
        // Some colour is not zero: if the first two are, the last one is not.
        let mut magnitude = (colour == 2 && values[0] == 0 && values[1] == 0) as u32;
        let goal = wanted[colour].unsigned_abs();
        while magnitude < ESCAPE {
            let decision = context.decision(magnitude);
            if !models.magnitude.code(coder, &decision.slots, &decision.selectors, magnitude < goal) {
                break;
            }
            magnitude += 1;
        }
        if magnitude == ESCAPE {
            magnitude = ESCAPE.saturating_add(models.escape.code(coder, goal.wrapping_sub(ESCAPE))).min(LARGEST);
        }
        if magnitude > 0 {
            let sign = sign_context(place, colour, &values, prediction[colour], inverse);
            let negative = models.sign[sign].code(coder, wanted[colour] < 0);
            values[colour] = if negative { -(magnitude as i32) } else { magnitude as i32 };
        }
    }
    values
}

fn choose_gains(
    gains: &mut Gains,
    bands: &[Band],
    quantiser: &Quantiser,
    predicted: &[Vec<Pixel>],
    target: &[Vec<Pixel>],
    choice: Choice,
) {
    let mut sums = [[[GainSums::default(); gains::BUCKETS]; 3]; BAND_CLASSES];
    for (index, band) in bands.iter().enumerate() {
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
