//! Wavelet coefficients as bits: contexts from the neighbours, the coarser band, the other colours and the prediction.
//!
//! One function serves both directions, so that they can't disagree. Normative text: `spec/planes.md`.

use super::contexts::{BLOCK, Contexts, Known, Place, sign_context};
use super::direct::Direct;
use super::gains::{self, BAND_CLASSES, GainModels, GainSums, Gains};
use super::mixed::Mixed;
use crate::entropy::mixer::cost;
use crate::entropy::{BitCoder, BitModel, Number, Predictor};
use crate::image::Mask;
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

/// How a picture's decisions are predicted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Modelling {
    /// Eight contexts of each decision, mixed: the smallest files.
    #[default]
    Mixed = 0,
    /// Two contexts of each decision, averaged: decoded several times faster.
    Direct = 1,
}

/// Adaptive state of one component; handed from a picture to those coded after it.
#[derive(Debug, Clone)]
pub struct Models(Kind);

#[derive(Debug, Clone)]
enum Kind {
    Mixed(Box<State<Mixed>>),
    Direct(Box<State<Direct>>),
}

impl Models {
    /// Fresh models.
    pub fn new(modelling: Modelling) -> Self {
        Models(match modelling {
            Modelling::Mixed => Kind::Mixed(Box::new(State::new())),
            Modelling::Direct => Kind::Direct(Box::new(State::new())),
        })
    }
}

impl Default for Models {
    fn default() -> Self {
        Models::new(Modelling::default())
    }
}

#[derive(Debug, Clone)]
struct State<K: Contexts> {
    /// Whether any of the three colours is not zero.
    any: K::Predictor,
    magnitude: K::Predictor,
    /// Whether a block has anything but zeros.
    block: Option<K::Predictor>,
    sign: Vec<BitModel>,
    escape: Number,
    gains: GainModels,
}

impl<K: Contexts> State<K> {
    fn new() -> Self {
        let [any, magnitude] = K::predictors();
        let sign = vec![BitModel::default(); 8 * 7 * 9];
        State { any, magnitude, block: K::blocks(), sign, escape: Number::default(), gains: GainModels::default() }
    }
}

/// Codes the coefficients of one picture, three colours together, and returns them as the decoder has them.
///
/// `predicted` are the coefficients of the prediction (none for a picture coded alone), `target` those of the picture
/// (encoding only). Bands are those of `plan`; outside their masks a coefficient may be anything. `room` is memory to use again:
/// what an earlier call has returned.
pub fn code<C: BitCoder>(
    coder: &mut C,
    models: &mut Models,
    plan: &Plan,
    quantiser: &Quantiser,
    predicted: Option<&[Vec<Pixel>]>,
    target: Option<(&[Vec<Pixel>], Choice)>,
    room: Vec<Vec<Pixel>>,
) -> Vec<Vec<Pixel>> {
    match &mut models.0 {
        Kind::Mixed(state) => code_with(coder, state, plan, quantiser, predicted, target, room),
        Kind::Direct(state) => code_with(coder, state, plan, quantiser, predicted, target, room),
    }
}

fn code_with<C: BitCoder, K: Contexts>(
    coder: &mut C,
    models: &mut State<K>,
    plan: &Plan,
    quantiser: &Quantiser,
    predicted: Option<&[Vec<Pixel>]>,
    target: Option<(&[Vec<Pixel>], Choice)>,
    mut room: Vec<Vec<Pixel>>,
) -> Vec<Vec<Pixel>> {
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
    room.resize_with(bands.len(), Vec::new);
    let mut decoded = room;
    let mut known: Vec<Known<K::Lanes>> = Vec::with_capacity(bands.len());
    for (index, band) in bands.iter().enumerate() {
        let step = quantiser.band_step(band);
        let predicted = predicted.and_then(|predicted| predicted.get(index));
        let quarters = 4.0 / step;
        let mut here = Known::new(band, predicted.map(|predicted| &predicted[..]), |p| K::hint(p, quarters));
        let mut out = std::mem::take(&mut decoded[index]);
        out.resize(band.mask.data.len(), [0.0; 4]);
        let parent = (band.orientation != Orientation::Low && index > 3).then(|| &known[index - 3]);
        // Already coded bands of the same level.
        let siblings = match band.orientation {
            Orientation::Vertical => 1,
            Orientation::Diagonal => 2,
            _ => 0,
        };
        let siblings = &known[index - siblings..];
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
        let width = band.mask.width;
        let of_prediction = |flat: usize, out: &[Pixel]| -> [f32; 3] {
            match predicted {
                Some(predicted) => std::array::from_fn(|colour| {
                    let p = predicted[flat][colour];
                    let gain = gains[class][colour][gains::bucket(p.abs() * inverse)];
                    p * (gain as f32 * (1.0 / gains::UNITY as f32))
                }),
                None if low => std::array::from_fn(|k| neighbour_mean(out, band, flat % width, flat / width, k)),
                None => [0.0; 3],
            }
        };
        let wanted = |flat: usize, prediction: &[f32; 3]| -> Option<[f32; 3]> {
            let (target, _) = target.filter(|_| !C::DECODES)?;
            Some(std::array::from_fn(|k| (target[index][flat][k] - prediction[k]) * inverse))
        };
        // Blocks of the finest bands that hold only zeros.
        let mut blocks = if !low && band.level == 1 { models.block.take() } else { None };
        let mut occupied = vec![false; if blocks.is_some() { width.div_ceil(BLOCK) } else { 0 }];
        for y in 0..band.mask.height {
            if let Some(blocks) = blocks.as_mut().filter(|_| y % BLOCK == 0) {
                let context = |block: usize, beside| K::block(parent, siblings, beside, block, y / BLOCK);
                let is_wanted = |places: &[usize]| {
                    let wanted = places.iter().filter_map(|&flat| wanted(flat, &of_prediction(flat, &out)));
                    target.is_some_and(|(_, choice)| is_worth(wanted, choice))
                };
                code_blocks(coder, blocks, &band.mask, y, &mut occupied, context, is_wanted);
            }
            let mut x = 0;
            while x < width {
                let flat = y * width + x;
                if !band.mask.data[flat] {
                    x += 1;
                    continue;
                }
                let prediction = of_prediction(flat, &out);
                let is_empty = occupied.get(x / BLOCK) == Some(&false);
                if is_empty && predicted.is_none() {
                    let behind = ((x / BLOCK + 1) * BLOCK).min(width);
                    out[flat..flat + behind - x].fill([0.0; 4]);
                    x = behind;
                    continue;
                }
                let mut values = [0; 3];
                if !is_empty {
                    let around = K::around(&here, parent, siblings, x, y);
                    let wanted = match (wanted(flat, &prediction), target) {
                        (Some(wanted), Some((_, choice))) => choose(wanted, quantiser, choice, models, &place, &around),
                        _ => [0; 3],
                    };
                    values = code_values(coder, models, &place, &around, &prediction, inverse, wanted);
                    let at = here.index(x, y);
                    here.values[at] = K::lanes(&values);
                }
                for colour in 0..3 {
                    out[flat][colour] = prediction[colour] + quantiser.dequantise(values[colour], step);
                }
                x += 1;
            }
        }
        if blocks.is_some() {
            models.block = blocks;
        }
        decoded[index] = out;
        known.push(here);
    }
    decoded
}

/// Codes which blocks of the block row that begins at row `y` hold anything but zeros; `occupied` says it of the block row above, and
/// then of this one.
fn code_blocks<C: BitCoder, P: Predictor>(
    coder: &mut C,
    predictor: &mut P,
    mask: &Mask,
    y: usize,
    occupied: &mut [bool],
    context: impl Fn(usize, [bool; 2]) -> P::Context,
    is_wanted: impl Fn(&[usize]) -> bool,
) {
    let mut before = false;
    let mut places = Vec::with_capacity(BLOCK * BLOCK);
    for (block, occupied) in occupied.iter_mut().enumerate() {
        places.clear();
        for y in y..(y + BLOCK).min(mask.height) {
            let row = y * mask.width;
            let columns = block * BLOCK..((block + 1) * BLOCK).min(mask.width);
            places.extend(columns.map(|x| row + x).filter(|&flat| mask.data[flat]));
        }
        *occupied = !places.is_empty() && {
            let wanted = !C::DECODES && is_wanted(&places);
            predictor.code(coder, &context(block, [before, *occupied]), wanted)
        };
        before = *occupied;
    }
}

/// Whether what coding a block takes off its squared error is worth the bits, as far as can be told before it is coded.
fn is_worth(wanted: impl Iterator<Item = [f32; 3]>, choice: Choice) -> bool {
    let (mut gain, mut bits) = (0.0, 2.0);
    for wanted in wanted.flatten().map(f32::abs).filter(|wanted| *wanted >= 0.5) {
        let left = wanted - (wanted + 0.5).floor();
        gain += wanted * wanted - left * left;
        bits += BITS_OF_A_COEFFICIENT;
    }
    gain > choice.lambda * bits
}

/// What a coefficient that is not zero costs about, in [`is_worth`]. The encoder's choice.
const BITS_OF_A_COEFFICIENT: f32 = 6.0;

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
fn choose<K: Contexts>(
    wanted: [f32; 3],
    quantiser: &Quantiser,
    choice: Choice,
    models: &State<K>,
    place: &Place,
    around: &K::Around,
) -> [i32; 3] {
    if wanted.iter().all(|w| w.abs() < 0.5) {
        return [0; 3];
    }
    let probability = models.any.probability(&K::any(place, around));
    let mut values = [0i32; 3];
    let mut together = choice.lambda * cost(probability, true);
    let mut none = choice.lambda * cost(probability, false);
    for colour in 0..3 {
        let magnitude = wanted[colour].abs().min(LARGEST as f32 - 1.0);
        none += magnitude * magnitude;
        let nearest = (magnitude + 0.5) as u32;
        let lowest = nearest.saturating_sub(if nearest <= 2 { 2 } else { 1 });
        let context = K::magnitude(place, around, colour, &values);
        let implied = colour == 2 && values[0] == 0 && values[1] == 0;
        let mut bits = 0.0;
        let mut best = (f32::INFINITY, 0);
        for index in 0..=nearest.min(ESCAPE) {
            let probability = models.magnitude.probability(&K::decision(&context, index));
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
fn code_values<C: BitCoder, K: Contexts>(
    coder: &mut C,
    models: &mut State<K>,
    place: &Place,
    around: &K::Around,
    prediction: &[f32; 3],
    inverse: f32,
    wanted: [i32; 3],
) -> [i32; 3] {
    if !models.any.code(coder, &K::any(place, around), wanted != [0; 3]) {
        return [0; 3];
    }
    let mut values = [0i32; 3];
    for colour in 0..3 {
        let context = K::magnitude(place, around, colour, &values);
        // Some colour is not zero: if the first two are, the last one is not.
        let mut magnitude = (colour == 2 && values[0] == 0 && values[1] == 0) as u32;
        let goal = wanted[colour].unsigned_abs();
        while magnitude < ESCAPE {
            if !models.magnitude.code(coder, &K::decision(&context, magnitude), magnitude < goal) {
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
