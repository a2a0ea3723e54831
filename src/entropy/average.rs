//! The mean of two adaptive predictions of one bit: a fraction of a mixer's work.
//!
//! Normative text: `spec/entropy.md`.

use super::BitCoder;
use super::slot::ProbabilitySlot;

/// See [`ProbabilitySlot::update`]. Part of the format.
const SLOWEST: u32 = 120;

/// Mean of two probabilities, in 1/65536.
#[inline(always)]
fn average(a: ProbabilitySlot, b: ProbabilitySlot) -> u32 {
    ((a.probability::<22>() + b.probability::<22>()) >> 7).clamp(16, 65520)
}

/// Predicts bits of one kind from two contexts.
#[derive(Debug, Clone)]
pub struct AverageModel {
    slots: [Vec<ProbabilitySlot>; 2],
}

impl AverageModel {
    /// For contexts below `contexts[k]`.
    pub fn new(contexts: [usize; 2]) -> Self {
        AverageModel { slots: contexts.map(ProbabilitySlot::fresh) }
    }
    /// Codes one bit and learns from it.
    #[inline(always)]
    pub fn code<C: BitCoder>(&mut self, coder: &mut C, context: &[u32; 2], bit: bool) -> bool {
        let [a, b] = &mut self.slots;
        let (a, b) = (&mut a[context[0] as usize], &mut b[context[1] as usize]);
        let bit = coder.bit(average(*a, *b), bit);
        a.update::<SLOWEST>(bit);
        b.update::<SLOWEST>(bit);
        bit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::{RangeDecoder, RangeEncoder};

    #[test]
    fn comes_back_and_two_contexts_cost_less_than_either() {
        let mut state = 7u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 16
        };
        // Both contexts tell how likely the bit is.
        let bits: Vec<([u32; 2], bool)> = (0..40_000)
            .map(|_| {
                let context = [random() % 4, random() % 4];
                (context, random() % 8 <= context[0] + context[1])
            })
            .collect();
        let cost = |keep: [u32; 2]| {
            let used = |context: &[u32; 2]| [context[0] * keep[0], context[1] * keep[1]];
            let (mut encoder, mut model) = (RangeEncoder::new(), AverageModel::new([4, 4]));
            for (context, bit) in &bits {
                model.code(&mut encoder, &used(context), *bit);
            }
            let bytes = encoder.finish();
            let (mut decoder, mut model) = (RangeDecoder::new(&bytes), AverageModel::new([4, 4]));
            for (context, bit) in &bits {
                assert_eq!(model.code(&mut decoder, &used(context), false), *bit);
            }
            bytes.len()
        };
        let (both, first, second) = (cost([1, 1]), cost([1, 0]), cost([0, 1]));
        assert!(both * 25 < first * 24 && both * 25 < second * 24, "{both}, with one context {first} and {second}");
    }
}
