//! Wavelet coefficients as bits: contexts from the neighbours, the coarser band, the other colours and the prediction.
//!
//! One function serves both directions, so that they can't disagree. Normative text: `spec/planes.md`.

use super::gains::{self, BAND_CLASSES, GainModels, GainSums, Gains};
use crate::entropy::mixer::{INPUTS, Mixer, SELECTORS, cost};
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
    magnitude: Mixer,
    sign: Vec<BitModel>,
    escape: Number,
    gains: GainModels,
}

const KINDS: usize = 3;
const CLASSES: usize = 8 * 3;

impl Default for Models {
    fn default() -> Self {
        let base = CLASSES * KINDS;
        Models {
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

/// Magnitudes of one band with a margin of two columns on both sides and two rows above, so that neighbours need no checks.
struct Magnitudes {
    stride: usize,
    values: Vec<[i16; 4]>,
}

impl Magnitudes {
    fn new(band: &Band) -> Self {
        let stride = band.mask.width + 4;
        Magnitudes { stride, values: vec![[0; 4]; stride * (band.mask.height + 3)] }
    }
    #[inline(always)]
    fn index(&self, x: usize, y: usize) -> usize {
        (y + 2) * self.stride + x + 2
    }
}

/// Classes of a non-negative sum, finer where it is small: 0, 1, 2, 3, 4, 5-6, 7-8, 9-11, 12-15, 16-22, 23-36, 37 and more.
#[inline(always)]
fn class_12(value: u32) -> u32 {
    const TABLE: [u8; 40] = [
        0, 1, 2, 3, 4, 5, 5, 6, 6, 7, 7, 7, 8, 8, 8, 8, 9, 9, 9, 9, 9, 9, 9, 10, 10, 10, 10, 10, 10, 10, 10, 10, 10,
        10, 10, 10, 10, 11, 11, 11,
    ];
    TABLE[value.min(39) as usize] as u32
}

/// 0, 1, 2, 3-4, 5-7, 8-12, 13-24, 25 and more.
#[inline(always)]
fn class_8(value: u32) -> u32 {
    const TABLE: [u8; 26] = [0, 1, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 7];
    TABLE[value.min(25) as usize] as u32
}

/// Half-octave classes up to `most`.
#[inline(always)]
fn logarithmic(value: u32, most: u32) -> u32 {
    if value < 2 {
        return value;
    }
    let top = 31 - value.leading_zeros();
    (2 * top + (value >> (top - 1) & 1)).min(most)
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
                    hints.values[at] = std::array::from_fn(|k| (p[k].abs() * inverse) as i16);
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
        let orientation_class = (band.orientation == Orientation::Diagonal) as usize;
        let low = band.orientation == Orientation::Low;
        for y in 0..band.mask.height {
            for x in 0..band.mask.width {
                let flat = y * band.mask.width + x;
                if !band.mask.data[flat] {
                    continue;
                }
                let at = here.index(x, y);
                for colour in 0..3 {
                    let (prediction, hint) = match predicted {
                        Some(predicted) => {
                            let p = predicted[index][flat][colour];
                            let gain = gains[class][colour][gains::bucket(p.abs() / step)];
                            (p * (gain as f32 * (1.0 / gains::UNITY as f32)), hints.values[at][colour] as u32)
                        }
                        None if low => (neighbour_mean(&out, band, x, y, colour), 0),
                        None => (0.0, 0),
                    };
                    let context = Context::new(
                        &here,
                        at,
                        &hints,
                        predicted.is_some(),
                        hint,
                        colour,
                        parent.map_or(0, |p| {
                            let m: &Magnitudes = &magnitudes[p];
                            m.values[m.index(x / 2, y / 2)][colour] as u32
                        }),
                        (1..=siblings).map(|s| magnitudes[index - s].values[at][colour] as u32).sum(),
                        level_class * 2 + orientation_class,
                        if low { 0 } else { band.level },
                    );
                    let sign_context = context.sign(&here, at, colour, &out[flat], prediction, step);
                    let value = match target {
                        Some((target, choice)) if !C::DECODES => {
                            let wanted = (target[index][flat][colour] - prediction) / step;
                            choose(wanted, quantiser, choice, &models.magnitude, &context)
                        }
                        _ => 0,
                    };
                    let value = code_value(coder, models, &context, sign_context, value);
                    here.values[at][colour] = value.unsigned_abs().min(255) as i16;
                    out[flat][colour] = prediction + quantiser.dequantise(value, step);
                    if value < 0 {
                        here.values[at][3] |= 1 << colour;
                    }
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

/// Everything that predicts one coefficient's magnitude.
struct Context {
    slots: [u32; INPUTS],
    strides: [u32; INPUTS],
    selectors: [u32; SELECTORS],
    band_class: usize,
}

impl Context {
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn new(
        here: &Magnitudes,
        at: usize,
        hints: &Magnitudes,
        is_predicted: bool,
        hint: u32,
        colour: usize,
        parent: u32,
        siblings: u32,
        band_class: usize,
        level: usize,
    ) -> Self {
        let stride = here.stride;
        let m = |offset: usize| here.values[offset][colour] as u32;
        let (w, n, nw, ne) = (m(at - 1), m(at - stride), m(at - stride - 1), m(at - stride + 1));
        let (ww, nn) = (m(at - 2), m(at - 2 * stride));
        let near = 2 * (w + n) + nw + ne;
        let colours: u32 = (0..colour).map(|k| here.values[at][k] as u32).sum();
        let other = |offset: usize| {
            let v = &here.values[offset];
            v[0] as u32 + v[1] as u32 + v[2] as u32 - v[colour] as u32
        };
        let others_near = other(at - 1) + other(at - stride);
        let p = |offset: usize| hints.values[offset][colour] as u32;
        let hints_near = p(at - 1) + p(at + 1) + p(at - stride) + p(at + stride);
        let hint_class = if is_predicted { class_8(hint / 2) } else { 8 };
        let wide = 3 * near + 2 * (ww + nn) + 3 * parent + 2 * siblings;
        let total = wide + 4 * colours + hint;
        let class = (band_class * 3 + colour) as u32;
        let c = colour as u32;
        let tight = w.min(3) * 64 + n.min(3) * 16 + ne.min(3) * 4 + nw.min(3);
        let kinds = KINDS as u32;
        let slots = [
            (class * kinds * 12 + class_12(near)) * 9 + hint_class,
            (class * kinds * 12 + class_12(near)) * 8 + class_8(2 * colours + others_near / 2),
            (c * 6 + level as u32) * kinds * 24 + logarithmic(wide, 23),
            (class * kinds * 8 + class_8(2 * parent)) * 8 + class_8(siblings * 2 + ww + nn),
            (class * kinds * 9 + hint_class) * 8 + class_8(hints_near / 4),
            (c * kinds * 256 + tight) * 4 + class_8(hint / 2).min(6) / 2,
            (c * kinds * 32 + logarithmic(2 * total, 31)) * 4 + band_class as u32 / 2,
            ((c * kinds * 8 + class_8(colours * 2)) * 8 + class_8(others_near)) * 4 + class_8(near / 2).min(6) / 2,
        ];
        let strides = [12 * 9, 12 * 8, 24, 8 * 8, 9 * 8, 256 * 4, 32 * 4, 8 * 8 * 4];
        let set = if is_predicted { 1 } else { 0 };
        let selectors = [(set * CLASSES as u32 + class) * kinds, logarithmic(total, 15)];
        Context { slots, strides, selectors, band_class }
    }

    /// Contexts of the decision whether the magnitude is larger than `index`.
    #[inline(always)]
    fn decision(&self, index: u32) -> ([u32; INPUTS], [u32; SELECTORS]) {
        let kind = index.min(KINDS as u32 - 1);
        let slots = std::array::from_fn(|k| self.slots[k] + kind * self.strides[k]);
        (slots, [self.selectors[0] + kind, self.selectors[1] + kind * 16])
    }

    /// Context of the sign: the prediction's sign and size, and the signs of the colours before.
    #[inline(always)]
    fn sign(&self, here: &Magnitudes, at: usize, colour: usize, _out: &Pixel, prediction: f32, step: f32) -> usize {
        let size = gains::bucket(prediction.abs() / step * 2.0) + 1;
        let signed = if prediction > 0.0 {
            3 + size
        } else if prediction < 0.0 {
            3 - size
        } else {
            3
        };
        let other = |k: usize| {
            if k >= colour || here.values[at][k] == 0 { 0 } else { 1 + (here.values[at][3] >> k & 1) as usize }
        };
        (self.band_class * 7 + signed) * 9 + other(0) * 3 + other(1)
    }
}

/// The quantised value with the least squared error plus rate, among the nearest and those nearer to zero.
#[inline(always)]
fn choose(wanted: f32, quantiser: &Quantiser, choice: Choice, mixer: &Mixer, context: &Context) -> i32 {
    let magnitude = wanted.abs().min(LARGEST as f32 - 1.0);
    let nearest = (magnitude + 0.5) as u32;
    if nearest == 0 {
        return 0;
    }
    let lowest = nearest.saturating_sub(if nearest <= 2 { 2 } else { 1 });
    let mut bits = 0.0;
    let mut best = (f32::INFINITY, 0);
    for index in 0..=nearest.min(ESCAPE) {
        let (slots, selectors) = context.decision(index);
        let probability = mixer.probability(&slots, &selectors);
        if index >= lowest || index == ESCAPE {
            let candidate = if index == ESCAPE { nearest } else { index };
            let rate =
                bits + if candidate < ESCAPE { cost(probability, false) } else { 0.0 } + (candidate > 0) as u32 as f32;
            let error = magnitude - quantiser.dequantise(candidate as i32, 1.0);
            let value = error * error + choice.lambda * rate;
            if value < best.0 {
                best = (value, candidate);
            }
        }
        bits += cost(probability, true);
    }
    if wanted < 0.0 { -(best.1 as i32) } else { best.1 as i32 }
}

/// Codes one quantised value.
#[inline(always)]
fn code_value<C: BitCoder>(
    coder: &mut C,
    models: &mut Models,
    context: &Context,
    sign_context: usize,
    value: i32,
) -> i32 {
    let wanted = value.unsigned_abs();
    let mut magnitude = 0;
    while magnitude < ESCAPE {
        let (slots, selectors) = context.decision(magnitude);
        if !models.magnitude.code(coder, &slots, &selectors, magnitude < wanted) {
            break;
        }
        magnitude += 1;
    }
    if magnitude == 0 {
        return 0;
    }
    if magnitude == ESCAPE {
        magnitude = ESCAPE.saturating_add(models.escape.code(coder, wanted.wrapping_sub(ESCAPE))).min(LARGEST);
    }
    let negative = models.sign[sign_context].code(coder, value < 0);
    if negative { -(magnitude as i32) } else { magnitude as i32 }
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
