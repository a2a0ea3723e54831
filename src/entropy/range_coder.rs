//! Binary range coder: 32-bit interval, 16-bit probabilities, bytes shifted out as soon as they are settled.
//!
//! The interval is `[low, high]`, both 32-bit and inclusive. A bit splits it at
//! `middle = low + floor((high - low) * p / 65536)`; a 1 takes `[low, middle]`, a 0 takes `[middle + 1, high]`.
//! While the top bytes of `low` and `high` agree that byte is written and both are shifted by 8 bits.

use super::BitCoder;

/// Writes bits.
#[derive(Debug, Clone)]
pub struct RangeEncoder {
    low: u32,
    high: u32,
    bytes: Vec<u8>,
}

impl Default for RangeEncoder {
    fn default() -> Self {
        RangeEncoder { low: 0, high: u32::MAX, bytes: Vec::new() }
    }
}

impl RangeEncoder {
    /// An empty stream.
    pub fn new() -> Self {
        Self::default()
    }
    /// Ends the stream with the fewest bytes that identify its last interval; the decoder reads zeros past the end.
    pub fn finish(mut self) -> Vec<u8> {
        if let Some((count, value)) = final_value(self.low, self.high) {
            self.bytes.extend_from_slice(&value.to_be_bytes()[..count]);
        }
        self.bytes
    }
    /// Bytes written so far, the pending interval not counted.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }
    /// True before the first settled byte.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }
}

impl BitCoder for RangeEncoder {
    const DECODES: bool = false;
    #[inline(always)]
    fn bit(&mut self, probability_of_one: u32, bit: bool) -> bool {
        let middle = split(self.low, self.high, probability_of_one);
        if bit {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.bytes.push((self.high >> 24) as u8);
            self.low <<= 8;
            self.high = self.high << 8 | 0xff;
        }
        bit
    }
}

/// Bytes that a decoder is ahead of what is settled.
const AHEAD: usize = 4;

/// Reads bits from a byte slice; past its end it reads zeros, and counts them.
#[derive(Debug, Clone)]
pub struct RangeDecoder<'a> {
    low: u32,
    high: u32,
    code: u32,
    bytes: &'a [u8],
    position: usize,
}

impl<'a> RangeDecoder<'a> {
    /// Starts at the first byte.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = RangeDecoder { low: 0, high: u32::MAX, code: 0, bytes, position: 0 };
        for _ in 0..AHEAD {
            decoder.code = decoder.code << 8 | decoder.next_byte();
        }
        decoder
    }
    #[inline(always)]
    fn next_byte(&mut self) -> u32 {
        let byte = self.bytes.get(self.position).copied().unwrap_or(0);
        self.position += 1;
        byte as u32
    }
    /// True when the stream ends as [`RangeEncoder::finish`] ends it, or with zeros behind that up to `min_bytes`. After the last bit
    /// this finds bytes added, bytes missing and most damage.
    pub fn ends_as_written(&self, min_bytes: usize) -> bool {
        if cfg!(fuzzing) {
            // So that changed streams get past it.
            return !self.is_exhausted();
        }
        let Some((count, value)) = final_value(self.low, self.high) else { return false };
        let written = self.position - AHEAD + count;
        let is_filled = || self.bytes.len() == min_bytes && self.bytes[written..].iter().all(|&byte| byte == 0);
        self.code == value && (written == self.bytes.len() || (written < self.bytes.len() && is_filled()))
    }
}

impl BitCoder for RangeDecoder<'_> {
    const DECODES: bool = true;
    #[inline(always)]
    fn is_exhausted(&self) -> bool {
        self.position > self.bytes.len() + AHEAD
    }
    #[inline(always)]
    fn bit(&mut self, probability_of_one: u32, _bit: bool) -> bool {
        let middle = split(self.low, self.high, probability_of_one);
        let bit = self.code <= middle;
        if bit {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.low <<= 8;
            self.high = self.high << 8 | 0xff;
            self.code = self.code << 8 | self.next_byte();
        }
        bit
    }
}

/// The shortest byte string which, followed by zeros, lies in `low..=high`: its length and, as a 32-bit number, its value.
fn final_value(low: u32, high: u32) -> Option<(usize, u32)> {
    (0..=4usize).find_map(|count| {
        let unit = 1u64 << (32 - 8 * count);
        let value = (low as u64).div_ceil(unit) * unit;
        (value <= high as u64).then_some((count, value as u32))
    })
}

#[inline(always)]
fn split(low: u32, high: u32, probability_of_one: u32) -> u32 {
    low + (((high - low) as u64 * probability_of_one as u64) >> 16) as u32
}
