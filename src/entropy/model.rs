//! Adaptive models on top of the range coder: one bit, and numbers made of such bits.

use super::BitCoder;

/// Probability of a 1 in 16 bits, with a rate that starts fast and settles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BitModel {
    /// The probability less a half, so that fresh models are zeros.
    offset: i16,
    count: u16,
}

/// Fastest and slowest adaptation: the n-th bit moves the probability by `1 / (n + 1.5)`, no slower than `1 / 2^RATE`.
/// Part of the format.
const SLOWEST: u16 = 40;

impl BitModel {
    /// The probability of a 1, out of 65536, in `32..=65504`.
    #[inline(always)]
    pub fn probability(&self) -> u32 {
        (self.exact() as u32).clamp(32, 65504)
    }
    #[inline(always)]
    fn exact(&self) -> i32 {
        self.offset as i32 + (1 << 15)
    }
    /// Learns from one bit.
    #[inline(always)]
    pub fn update(&mut self, bit: bool) {
        let target = if bit { 65535 } else { 0 };
        let twice = (target - self.exact()) * 2;
        // Nearly every model has settled: a division by a constant is a product.
        let step = match self.count {
            SLOWEST => twice / (2 * SLOWEST as i32 + 3),
            count => twice / (2 * count as i32 + 3),
        };
        self.offset = (self.offset as i32 + step) as i16;
        self.count = (self.count + 1).min(SLOWEST);
    }
    /// Codes one bit and learns from it.
    #[inline(always)]
    pub fn code<C: BitCoder>(&mut self, coder: &mut C, bit: bool) -> bool {
        let bit = coder.bit(self.probability(), bit);
        self.update(bit);
        bit
    }
}

/// An unsigned number up to 2^32 - 2 as an adaptive Elias-gamma code: the length of `value + 1` in unary, then its lower bits.
/// The two highest lower bits are modelled, the others are equiprobable.
#[derive(Debug, Clone, Default)]
pub struct NumberModel {
    length: [BitModel; 32],
    bits: [[BitModel; 3]; 32],
}

impl NumberModel {
    /// Codes a number in `0..=2^32 - 2`. In decoding `value` is ignored.
    pub fn code<C: BitCoder>(&mut self, coder: &mut C, value: u32) -> u32 {
        let plus = value as u64 + 1;
        let mut length = 0;
        let wanted = 63 - plus.leading_zeros() as usize;
        while length < 31 && self.length[length].code(coder, length < wanted) {
            length += 1;
        }
        let mut result = 1u64;
        for k in (0..length).rev() {
            let bit = plus >> k & 1 == 1;
            let depth = length - 1 - k;
            let bit = match depth {
                0 => self.bits[length][0].code(coder, bit),
                1 => {
                    let context = 1 + (result & 1) as usize;
                    self.bits[length][context].code(coder, bit)
                }
                _ => coder.bit(1 << 15, bit),
            };
            result = result << 1 | bit as u64;
        }
        (result - 1) as u32
    }
    /// Codes a signed number by folding: 0, -1, 1, -2, 2 ...
    pub fn code_signed<C: BitCoder>(&mut self, coder: &mut C, value: i32) -> i32 {
        let folded = self.code(coder, ((value << 1) ^ (value >> 31)) as u32);
        (folded >> 1) as i32 ^ -((folded & 1) as i32)
    }
}

/// Codes the lowest `count` (at most 32) bits of a number as equiprobable bits, the highest first.
pub(crate) fn code_raw<C: BitCoder>(coder: &mut C, count: u32, value: u32) -> u32 {
    (0..count).rev().fold(0, |result, k| result << 1 | coder.bit(1 << 15, value >> k & 1 == 1) as u32)
}

/// Mark coded by [`code_end`]. Part of the format.
const END_MARK: u32 = 0x5aa5;

/// Codes 16 fixed bits at the end of a stream; false where they are others: the stream is cut or damaged.
pub fn code_end<C: BitCoder>(coder: &mut C) -> bool {
    code_raw(coder, 16, END_MARK) == END_MARK
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::{RangeDecoder, RangeEncoder};

    #[test]
    fn numbers_come_back_and_cost_little() {
        let values: Vec<i32> = (0..20_000).map(|i| (i * i % 7 - 3) * if i % 500 == 0 { 70_000 } else { 1 }).collect();
        let mut encoder = RangeEncoder::new();
        let mut number = NumberModel::default();
        for &v in &values {
            number.code_signed(&mut encoder, v);
        }
        let bytes = encoder.finish();
        assert!(bytes.len() < 20_000 * 21 / 80, "{} bytes", bytes.len());
        let mut decoder = RangeDecoder::new(&bytes);
        let mut number = NumberModel::default();
        for &v in &values {
            assert_eq!(number.code_signed(&mut decoder, 0), v);
        }
        assert!(decoder.ends_as_written(0));
    }

    #[test]
    fn extremes_come_back() {
        for value in [0, 1, u32::MAX - 1, 1 << 31, 65_535] {
            let mut encoder = RangeEncoder::new();
            NumberModel::default().code(&mut encoder, value);
            let bytes = encoder.finish();
            assert_eq!(NumberModel::default().code(&mut RangeDecoder::new(&bytes), 0), value);
        }
    }
}
