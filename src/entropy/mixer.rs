//! Logistic mixing: several adaptive predictions of one bit are weighed in the log-odds domain (Mahoney 2005).
//!
//! All tables follow from the 49 numbers of `LOGISTIC` by integer arithmetic and the mixing uses `f32` with `+ - *` in
//! the order written, so every platform reaches the same probabilities (normative, `spec/entropy.md`).

use super::BitCoder;
use super::slot::ProbabilitySlot;
use glam::Vec4;
use std::sync::LazyLock;

/// `2^20 / (1 + e^(-k / 4))`, k = 0..=48, rounded. Part of the format.
const LOGISTIC: [u32; 49] = [
    524288, 589485, 652696, 712170, 766570, 815058, 857289, 893337, 923583, 948595, 969033, 985571, 998846, 1009436,
    1017840, 1024482, 1029716, 1033829, 1037055, 1039582, 1041558, 1043102, 1044308, 1045249, 1045983, 1046556,
    1047002, 1047350, 1047621, 1047832, 1047996, 1048125, 1048224, 1048302, 1048363, 1048410, 1048447, 1048475,
    1048498, 1048515, 1048528, 1048539, 1048547, 1048554, 1048558, 1048562, 1048565, 1048568, 1048570,
];
/// Log-odds are counted in 1/256; this is the largest.
const MAX_LOG_ODDS: i32 = 3071;

/// The tables between probabilities and log-odds.
struct MixerTables {
    /// Probability in 1/65536 at log-odds `index - LARGEST`.
    squash: Vec<u16>,
    /// Log-odds of the probability `(index + 0.5) / 4096`.
    stretch: Vec<f32>,
}

static TABLES: LazyLock<MixerTables> = LazyLock::new(|| {
    let positive = |x: i32| {
        let (knot, part) = ((x / 64) as usize, (x % 64) as u32);
        (LOGISTIC[knot] * (64 - part) + LOGISTIC[(knot + 1).min(48)] * part) >> 10
    };
    let squash: Vec<u16> = (-MAX_LOG_ODDS..=MAX_LOG_ODDS)
        .map(|x| if x >= 0 { positive(x) } else { 65536 - positive(-x) }.clamp(2, 65534) as u16)
        .collect();
    let mut stretch = Vec::with_capacity(4096);
    let mut x = 0;
    for index in 0..4096u32 {
        while x + 1 < squash.len() && (squash[x] as u32) < index * 16 + 8 {
            x += 1;
        }
        stretch.push((x as i32 - MAX_LOG_ODDS) as f32 / 256.0);
    }
    MixerTables { squash, stretch }
});

/// Number of predictions that are mixed. Part of the format.
pub(crate) const INPUTS: usize = 8;
/// Number of weight vectors, each chosen by a context of its own, whose results are averaged.
pub(crate) const SELECTORS: usize = 2;
/// See [`ProbabilitySlot::update`].
const SLOWEST: u32 = 250;

/// Contexts of one decision.
#[derive(Debug, Clone, Copy)]
pub struct MixerContext {
    /// One below each of the mixer's slot counts.
    pub slots: [u32; INPUTS],
    /// One below each of its selector counts.
    pub selectors: [u32; SELECTORS],
}

/// Predicts bits of one kind from [`INPUTS`] contexts and [`SELECTORS`] weight choices.
#[derive(Debug, Clone)]
pub struct Mixer {
    slots: [Vec<ProbabilitySlot>; INPUTS],
    weights: [Vec<[f32; INPUTS]>; SELECTORS],
    rates: [Vec<f32>; SELECTORS],
}

/// Learning rate of a weight vector: starts at FAST and falls by DECAY a bit towards SLOW.
const FAST: f32 = 0.02;
const SLOW: f32 = 0.002;
const DECAY: f32 = 0.01;

impl Mixer {
    /// A mixer for contexts below `contexts[k]` and weight choices below `selectors[k]`.
    pub fn new(contexts: [usize; INPUTS], selectors: [usize; SELECTORS]) -> Self {
        Mixer {
            slots: contexts.map(ProbabilitySlot::fresh),
            weights: selectors.map(|n| vec![[0.3; INPUTS]; n]),
            rates: selectors.map(|n| vec![FAST; n]),
        }
    }

    /// Log-odds that each context predicts.
    #[inline(always)]
    fn inputs(&self, tables: &MixerTables, contexts: &[u32; INPUTS]) -> [Vec4; 2] {
        let input = |k: usize| tables.stretch[self.slots[k][contexts[k] as usize].probability::<12>() as usize];
        [Vec4::new(input(0), input(1), input(2), input(3)), Vec4::new(input(4), input(5), input(6), input(7))]
    }

    #[inline(always)]
    fn mix(&self, tables: &MixerTables, inputs: [Vec4; 2], selectors: &[u32; SELECTORS]) -> (u32, [u32; SELECTORS]) {
        let mut sum = 0.0;
        let mut each = [0; SELECTORS];
        for s in 0..SELECTORS {
            let weights = &self.weights[s][selectors[s] as usize];
            let lanes = Vec4::from_slice(&weights[..4]) * inputs[0] + Vec4::from_slice(&weights[4..]) * inputs[1];
            let odds = (lanes.x + lanes.z) + (lanes.y + lanes.w);
            sum += odds;
            each[s] = squash(tables, odds);
        }
        (squash(tables, sum * (1.0 / SELECTORS as f32)), each)
    }

    /// Probability of a 1 in 1/65536, without learning.
    #[inline(always)]
    pub fn probability(&self, MixerContext { slots, selectors }: &MixerContext) -> u32 {
        let tables = &*TABLES;
        self.mix(tables, self.inputs(tables, slots), selectors).0
    }

    /// Codes one bit and learns from it.
    #[inline(always)]
    pub fn code<C: BitCoder>(&mut self, coder: &mut C, context: &MixerContext, bit: bool) -> bool {
        let MixerContext { slots: contexts, selectors } = context;
        let tables = &*TABLES;
        let inputs = self.inputs(tables, contexts);
        let (probability, each) = self.mix(tables, inputs, selectors);
        let bit = coder.bit(probability, bit);
        let target = if bit { 65536.0 } else { 0.0 };
        for s in 0..SELECTORS {
            let rate = &mut self.rates[s][selectors[s] as usize];
            let step = *rate * ((target - each[s] as f32) * (1.0 / 65536.0));
            *rate += DECAY * (SLOW - *rate);
            let weights = &mut self.weights[s][selectors[s] as usize];
            for (half, input) in weights.chunks_exact_mut(4).zip(inputs) {
                (Vec4::from_slice(half) + Vec4::splat(step) * input).write_to_slice(half);
            }
        }
        for k in 0..INPUTS {
            self.slots[k][contexts[k] as usize].update::<SLOWEST>(bit);
        }
        bit
    }
}

#[inline(always)]
fn squash(tables: &MixerTables, odds: f32) -> u32 {
    let x = (odds * 256.0) as i32;
    tables.squash[(x.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS) + MAX_LOG_ODDS) as usize] as u32
}

/// Returns the cost of coding `bit`, in bits; the probability of a 1 is `probability_of_one / 65536`. For the encoder's choices only.
pub(crate) fn bit_cost(probability_of_one: u32, bit: bool) -> f32 {
    let p = if bit { probability_of_one } else { 65536 - probability_of_one };
    COSTS[(p >> 4).min(4095) as usize]
}

static COSTS: LazyLock<Vec<f32>> = LazyLock::new(|| (0..4096).map(|i| -((i as f32 + 0.5) / 4096.0).log2()).collect());

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::{RangeDecoder, RangeEncoder};

    #[test]
    fn the_mix_beats_its_best_input_and_comes_back() {
        // Two contexts each tell half of the truth: P(1) = sigmoid(a + b).
        let mut state = 1u32;
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state
        };
        let bits: Vec<(u32, u32, bool)> = (0..60_000)
            .map(|_| {
                let (a, b) = (random() % 8, random() % 8);
                let p = 1.0 / (1.0 + (-(a as f64 + b as f64 - 7.0)).exp());
                (a, b, (random() as f64 / u32::MAX as f64) < p)
            })
            .collect();
        let mixer = || Mixer::new([8, 8, 1, 1, 1, 1, 1, 1], [1, 1]);
        let contexts = |a, b| MixerContext { slots: [a, b, 0, 0, 0, 0, 0, 0], selectors: [0, 0] };
        let mut encoder = RangeEncoder::new();
        let mut model = mixer();
        for &(a, b, bit) in &bits {
            model.code(&mut encoder, &contexts(a, b), bit);
        }
        let bytes = encoder.finish();
        let entropy = |p: f64| -p * p.log2() - (1.0 - p) * (1.0 - p).log2();
        let bound: f64 =
            bits.iter().map(|&(a, b, _)| entropy(1.0 / (1.0 + (-(a as f64 + b as f64 - 7.0)).exp()))).sum::<f64>()
                / 8.0;
        assert!((bytes.len() as f64) < 1.05 * bound, "{} bytes, bound {bound:.0}", bytes.len());
        let mut decoder = RangeDecoder::new(&bytes);
        let mut model = mixer();
        for &(a, b, bit) in &bits {
            assert_eq!(model.code(&mut decoder, &contexts(a, b), false), bit);
        }
    }
}
