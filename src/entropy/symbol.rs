//! Symbols of 16 values, predicted by the mean of two adaptive distributions.
//!
//! Normative text: `spec/entropy.md`.

use super::SymbolCoder;
use wide::i16x16;

/// Number of values.
pub(crate) const SYMBOL_VALUES: usize = 16;

/// Starts of the values' intervals out of 65536, less 32768: the first is -32768.
pub(crate) type SymbolStarts = [i16; SYMBOL_VALUES];

/// A distribution's total.
const TOTAL: usize = 1 << 15;
/// Least size of an interval.
const MIN_INTERVAL: usize = 2;

/// Starts, less half of the total, that the model moves towards after a value: it gets all of the total but the smallest sizes of the others.
const TARGETS: [SymbolStarts; SYMBOL_VALUES] = {
    let mut targets = [[0; SYMBOL_VALUES]; SYMBOL_VALUES];
    let mut value = 0;
    while value < SYMBOL_VALUES {
        let mut k = 0;
        while k < SYMBOL_VALUES {
            let start = if k <= value { k * MIN_INTERVAL } else { TOTAL - (SYMBOL_VALUES - k) * MIN_INTERVAL };
            targets[value][k] = (start as i32 - TOTAL as i32 / 2) as i16;
            k += 1;
        }
        value += 1;
    }
    targets
};

/// The n-th update moves a distribution by `1 / 2^RATES[n - 1]`, later ones as the last: about one over the number of updates so far, down
/// to 1/128.
const RATES: [u8; 80] = {
    let mut rates = [0; 80];
    let mut n = 0;
    while n < rates.len() {
        rates[n] = match n {
            0 => 1,
            1..4 => 2,
            4..9 => 3,
            9..19 => 4,
            19..39 => 5,
            39..79 => 6,
            _ => 7,
        };
        n += 1;
    }
    rates
};

/// Adaptive distributions, by context.
#[derive(Debug, Clone)]
struct SymbolDistributions {
    starts: Vec<SymbolStarts>,
    /// Updates of each context, at most 255.
    counts: Vec<u8>,
}

impl SymbolDistributions {
    fn new(contexts: usize) -> Self {
        let even = std::array::from_fn(|k| (k * TOTAL / SYMBOL_VALUES) as i16 - (TOTAL / 2) as i16);
        SymbolDistributions { starts: vec![even; contexts], counts: vec![0; contexts] }
    }
    #[inline(always)]
    fn update(&mut self, context: usize, value: usize) {
        let count = &mut self.counts[context];
        let rate = RATES[(*count as usize).min(RATES.len() - 1)];
        *count = count.saturating_add(1);
        let (starts, target) = (i16x16::new(self.starts[context]), i16x16::new(TARGETS[value & 15]));
        self.starts[context] = (starts + ((target - starts) >> rate as u32)).to_array();
    }
}

/// Predicts symbols of one kind from two contexts.
#[derive(Debug, Clone)]
pub struct SymbolModel([SymbolDistributions; 2]);

impl SymbolModel {
    /// For contexts below `contexts[k]`.
    pub fn new(contexts: [usize; 2]) -> Self {
        SymbolModel(contexts.map(SymbolDistributions::new))
    }
    /// Twice the mean of both distributions.
    #[inline(always)]
    pub fn starts(&self, context: [u32; 2]) -> SymbolStarts {
        let starts = |k: usize| i16x16::new(self.0[k].starts[context[k] as usize]);
        (starts(0) + starts(1)).to_array()
    }
    /// Codes a symbol and learns from it.
    #[inline(always)]
    pub fn code<C: SymbolCoder>(&mut self, coder: &mut C, context: [u32; 2], value: usize) -> usize {
        let value = coder.symbol(&self.starts(context), value);
        self.0[0].update(context[0] as usize, value);
        self.0[1].update(context[1] as usize, value);
        value
    }
}

/// A value's interval out of 65536: where it starts, and its size.
#[inline(always)]
pub(crate) fn interval(starts: &SymbolStarts, value: usize) -> [u16; 2] {
    // Behind the last value comes 65536, which is 0 here.
    let [start, end] = [value, value + 1].map(|k| starts[k & 15] as u16);
    [start ^ 0x8000, end.wrapping_sub(start)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::{RansDecoder, RansEncoder};

    #[test]
    fn symbols_come_back_and_cost_little_more_than_their_entropy() {
        let mut state = 7u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 16
        };
        // Geometric, with a rate that both contexts tell half of.
        let (mut symbols, mut entropy) = (Vec::new(), 0.0);
        for _ in 0..60_000 {
            let context = [random() % 4, random() % 4];
            let stop = (context[0] + context[1] + 2) as f64 / 10.0;
            let go = |value: usize| stop * (1.0 - stop).powi(value as i32);
            let mut value = 0;
            while value < SYMBOL_VALUES - 1 && random() as f64 / 65536.0 >= stop {
                value += 1;
            }
            let p = if value < SYMBOL_VALUES - 1 { go(value) } else { 1.0 - (0..value).map(go).sum::<f64>() };
            entropy -= p.log2() / 8.0;
            symbols.push((context, value));
        }
        let (mut encoder, mut model) = (RansEncoder::new(), SymbolModel::new([4, 4]));
        for &(context, value) in &symbols {
            model.code(&mut encoder, context, value);
        }
        let bytes = encoder.finish();
        assert!((bytes.len() as f64) < 1.06 * entropy, "{} bytes, entropy {entropy:.0}", bytes.len());
        let (mut decoder, mut model) = (RansDecoder::new(&bytes), SymbolModel::new([4, 4]));
        for &(context, value) in &symbols {
            assert_eq!(model.code(&mut decoder, context, 0), value);
        }
    }

    #[test]
    fn no_value_becomes_impossible() {
        // What comes again and again leaves the others their least sizes, whatever was before.
        let mut model = SymbolModel::new([1, 1]);
        for value in [3, 15, 0, 7] {
            for _ in 0..5000 {
                model.code(&mut RansEncoder::new(), [0, 0], value);
            }
            let sizes: Vec<u16> = (0..SYMBOL_VALUES).map(|k| interval(&model.starts([0, 0]), k)[1]).collect();
            assert!(sizes.iter().all(|&size| size as usize >= 2 * MIN_INTERVAL), "{sizes:?}");
            assert_eq!(sizes.iter().map(|&size| size as u32).sum::<u32>(), 65536);
            assert!(sizes[value] > 65_000, "{sizes:?}");
        }
    }
}
