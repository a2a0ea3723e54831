//! Asymmetric numeral systems (Duda 2013) with 64 bits of state: what is decoded fastest where a symbol has more than two values, since
//! finding one takes no division.
//!
//! Normative text: `spec/entropy.md`.

use super::symbol::{SymbolStarts, interval};
use super::{BitCoder, SymbolCoder};
use byteorder::{ByteOrder, LittleEndian};
use wide::i16x16;

/// Bits of a probability.
const SCALE: u32 = 16;
/// States are at least this; below it 32 bits follow from the stream.
const MIN_STATE: u64 = 1 << 32;

/// Collects symbols; they are written from the last one to the first.
#[derive(Debug, Clone, Default)]
pub struct RansEncoder {
    /// Start and size of each symbol's interval.
    intervals: Vec<[u16; 2]>,
}

impl RansEncoder {
    /// An empty stream.
    pub fn new() -> Self {
        Self::default()
    }
    /// The stream: the last state, then words of 32 bits, the lowest byte first; none for no symbols.
    pub fn finish(self) -> Vec<u8> {
        if self.intervals.is_empty() {
            return Vec::new();
        }
        let mut state = MIN_STATE;
        let mut words = Vec::new();
        for [start, size] in self.intervals.into_iter().rev().map(|interval| interval.map(u64::from)) {
            if state >= size << (64 - SCALE) {
                words.push(state as u32);
                state >>= 32;
            }
            state = ((state / size) << SCALE) + state % size + start;
        }
        words.push((state >> 32) as u32);
        words.push(state as u32);
        words.reverse();
        let mut bytes = vec![0; 4 * words.len()];
        LittleEndian::write_u32_into(&words, &mut bytes);
        bytes
    }
}

impl BitCoder for RansEncoder {
    const DECODES: bool = false;
    #[inline(always)]
    fn bit(&mut self, probability_of_one: u32, bit: bool) -> bool {
        let one = probability_of_one as u16;
        self.intervals.push(if bit { [0, one] } else { [one, one.wrapping_neg()] });
        bit
    }
}

impl SymbolCoder for RansEncoder {
    fn symbol(&mut self, starts: &SymbolStarts, symbol: usize) -> usize {
        self.intervals.push(interval(starts, symbol));
        symbol
    }
    fn equiprobable(&mut self, count: u32, value: u32) -> u32 {
        if count > 0 {
            let size = 1 << (SCALE - count);
            self.intervals.push([(value * size) as u16, size as u16]);
        }
        value
    }
}

/// Reads symbols from a byte slice; past its end it reads zeros.
#[derive(Debug, Clone)]
pub struct RansDecoder<'a> {
    state: u64,
    bytes: &'a [u8],
    /// Whether it has read past the end.
    is_exhausted: bool,
}

impl<'a> RansDecoder<'a> {
    /// Starts at the first byte.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = RansDecoder { state: MIN_STATE, bytes, is_exhausted: false };
        if bytes.is_empty() {
            return decoder;
        }
        let low = decoder.word();
        decoder.state = decoder.word() << 32 | low;
        decoder
    }
    #[inline(always)]
    fn word(&mut self) -> u64 {
        let Some((word, rest)) = self.bytes.split_first_chunk::<4>() else {
            self.bytes = &[];
            self.is_exhausted = true;
            return 0;
        };
        self.bytes = rest;
        LittleEndian::read_u32(word) as u64
    }
    /// True when the stream ends as [`RansEncoder::finish`] ends it: after the last symbol every byte is consumed, and the state is the
    /// one that the encoder began with.
    pub fn ends_as_written(&self) -> bool {
        // In fuzzing only what is missing counts, so that changed streams get past it.
        !self.is_exhausted && (cfg!(fuzzing) || (self.state == MIN_STATE && self.bytes.is_empty()))
    }
    #[inline(always)]
    fn interval_position(&self) -> u16 {
        self.state as u16
    }
    /// Goes on behind a symbol whose interval, which holds the place, starts at `start`.
    #[inline(always)]
    fn advance(&mut self, start: u16, size: u32) {
        self.state = size as u64 * (self.state >> SCALE) + (self.interval_position() - start) as u64;
        if self.state < MIN_STATE {
            self.state = self.state << 32 | self.word();
        }
    }
}

impl BitCoder for RansDecoder<'_> {
    const DECODES: bool = true;
    #[inline(always)]
    fn is_exhausted(&self) -> bool {
        self.is_exhausted
    }
    #[inline(always)]
    fn bit(&mut self, probability_of_one: u32, _bit: bool) -> bool {
        let bit = (self.interval_position() as u32) < probability_of_one;
        let (start, size) =
            if bit { (0, probability_of_one) } else { (probability_of_one, 65536 - probability_of_one) };
        self.advance(start as u16, size);
        bit
    }
}

impl SymbolCoder for RansDecoder<'_> {
    #[inline(always)]
    fn symbol(&mut self, starts: &SymbolStarts, _symbol: usize) -> usize {
        let place = i16x16::splat((self.interval_position() ^ 0x8000) as i16);
        // The last whose start is not behind the place.
        let behind = i16x16::new(*starts).simd_gt(place).to_bitmask();
        let symbol = (behind | 1 << 16).trailing_zeros() as usize - 1;
        let [start, size] = interval(starts, symbol);
        self.advance(start, size as u32);
        symbol
    }
    #[inline(always)]
    fn equiprobable(&mut self, count: u32, _value: u32) -> u32 {
        let shift = SCALE - count;
        let value = self.interval_position() as u32 >> shift;
        self.advance((value << shift) as u16, 1 << shift);
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::NumberModel;
    use crate::entropy::symbol::SymbolModel;

    /// Symbols of a known distribution, numbers and raw bits in turn.
    fn code<C: SymbolCoder>(coder: &mut C, values: &[u32]) -> Vec<u32> {
        let (mut symbols, mut number) = (SymbolModel::new([3, 2]), NumberModel::default());
        let mut before = 0;
        let coded = values.iter().enumerate().map(|(k, &value)| match k % 3 {
            0 => {
                before = symbols.code(coder, [before % 3, before % 2], value as usize & 15) as u32;
                before
            }
            1 => number.code(coder, value),
            _ => coder.equiprobable(value % 7, value & ((1 << (value % 7)) - 1)),
        });
        coded.collect()
    }

    #[test]
    fn what_was_coded_comes_back_and_damage_is_borne() {
        let values: Vec<u32> = (0..9000u32).map(|k| k.wrapping_mul(k) % 977 % 16).collect();
        let mut encoder = RansEncoder::new();
        let coded = code(&mut encoder, &values);
        let bytes = encoder.finish();
        // The number of raw bits is the caller's: here by the right value, whatever comes back.
        let mut decoder = RansDecoder::new(&bytes);
        assert_eq!(code(&mut decoder, &values), coded);
        assert!(decoder.ends_as_written());
        for length in (0..bytes.len()).step_by(bytes.len() / 40) {
            let mut damaged = bytes[..length].to_vec();
            let mut decoder = RansDecoder::new(&damaged);
            code(&mut decoder, &values);
            assert!(decoder.is_exhausted() && !decoder.ends_as_written());
            damaged.resize(bytes.len(), 0xff);
            code(&mut RansDecoder::new(&damaged), &values);
        }
        assert!(RansEncoder::new().finish().is_empty());
    }
}
