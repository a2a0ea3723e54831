//! A compact material as bytes.

use super::prior::{CONTINUE_PROBABILITIES, LEVELS, ORDINARY};
use super::{CompactHeader, CompactMaterial, TermDegrees, degrees};
use crate::container::Tag;
use crate::entropy::{BitCoder, RangeDecoder, RangeEncoder, code_end, code_raw};
use crate::error::{Error, Result};

/// Largest magnitude of a quantised coefficient. Part of the format.
pub(super) const MAX_MAGNITUDE: u32 = (1 << 20) - 1;
/// Quotients from this on are coded as an Elias-gamma number. Part of the format.
const UNARY: usize = 12;

impl CompactMaterial {
    /// The coded material.
    pub fn encode(&self) -> Vec<u8> {
        let mut coder = RangeEncoder::new();
        let copy = code(&mut coder, Some(self));
        debug_assert!(copy.is_some());
        coder.finish()
    }

    /// Reads what [`CompactMaterial::encode`] wrote. Takes memory and time for at most [`crate::brdf::compact::COMPACT_DEGREES`]' product of coefficients.
    /// # Errors
    /// [`Error::Format`] where the bytes end too early or too late, or a coefficient is out of range.
    pub fn decode(bytes: &[u8], section: Tag) -> Result<Self> {
        let mut coder = RangeDecoder::new(bytes);
        let material = code(&mut coder, None).ok_or_else(|| {
            Error::format(section, 0, "a coefficient of a compact material is out of range, or it is cut")
        })?;
        if !coder.ends_as_written(0) {
            return Err(Error::format(section, 0, "a compact material doesn't end where its bytes end"));
        }
        Ok(material)
    }
}

/// Both directions: codes `material` where there is one, else what the coder reads. `None` where a number is out of range.
fn code<C: BitCoder>(coder: &mut C, material: Option<&CompactMaterial>) -> Option<CompactMaterial> {
    let given = material.map(|m| m.header);
    let mut raw = |count: u32, of: fn(CompactHeader) -> u8| code_raw(coder, count, given.map_or(0, of) as u32) as u8;
    let header = CompactHeader {
        reciprocal: raw(1, |h| h.reciprocal as u8) == 1,
        step: raw(6, |h| h.step),
        floor: raw(5, |h| h.floor),
        ceiling: raw(7, |h| h.ceiling),
        gains: [raw(5, |h| h.gains[0]), raw(5, |h| h.gains[1]), raw(5, |h| h.gains[2])],
    };
    let mut coefficients = [vec![], vec![], vec![]];
    for c in 0..3 {
        for (n, &of) in degrees(header.reciprocal).iter().enumerate() {
            let value = material.and_then(|m| m.coefficients[c].get(n)).copied().unwrap_or(0);
            coefficients[c].push(code_coefficient(coder, level(of, c, header.gains[c]), value)?);
        }
    }
    code_end(coder).then(|| CompactMaterial::new(header, coefficients))
}

/// Expected magnitude of a coefficient in steps, as half octaves.
pub(super) fn level(degrees: TermDegrees, channel: usize, gain: u8) -> i32 {
    let table = &LEVELS[(channel > 0) as usize];
    gain as i32 - table.0[degrees[0]] as i32 - table.1[degrees[1]] as i32 - table.2[degrees[2]] as i32
}

/// Returns how a level is coded: the number of equiprobable low bits, and the row of [`CONTINUE_PROBABILITIES`] for the rest.
fn row_of(level: i32) -> (u32, usize) {
    let last = CONTINUE_PROBABILITIES.len() as i32 - 1;
    let index = level + ORDINARY;
    if index <= last {
        return (0, index.max(0) as usize);
    }
    let shift = (index - last + 1) / 2;
    (shift as u32, (index - 2 * shift) as usize)
}

fn code_coefficient<C: BitCoder>(coder: &mut C, level: i32, value: i32) -> Option<i32> {
    let (shift, row) = row_of(level);
    let magnitude = value.unsigned_abs();
    let quotient = (magnitude >> shift) as usize;
    let mut read = 0;
    while read < UNARY && coder.bit(CONTINUE_PROBABILITIES[row][read] as u32, quotient > read) {
        read += 1;
    }
    let mut high = read as u32;
    if read == UNARY {
        let plus = (quotient.max(UNARY) - UNARY) as u32 + 1;
        let wanted = 31 - plus.leading_zeros();
        let mut length = 0;
        while length < 20 && coder.bit(1 << 15, length < wanted) {
            length += 1;
        }
        high += (1 << length) - 1 + code_raw(coder, length, plus & ((1 << length) - 1));
    }
    let low = code_raw(coder, shift, magnitude & ((1 << shift) - 1));
    let magnitude = high.checked_shl(shift).filter(|m| m >> shift == high)? | low;
    if magnitude > MAX_MAGNITUDE {
        return None;
    }
    let negative = magnitude > 0 && coder.bit(1 << 15, value < 0);
    Some(if negative { -(magnitude as i32) } else { magnitude as i32 })
}

/// Bits that a coefficient takes; only the encoder's choices use it.
#[cfg(feature = "encode")]
pub(super) fn cost(level: i32, magnitude: u32) -> f64 {
    let (shift, row) = row_of(level);
    let quotient = (magnitude >> shift) as usize;
    let bits = &COSTS[row];
    let mut sum = bits.1[quotient.min(UNARY)];
    if quotient < UNARY {
        sum += bits.0[quotient];
    } else {
        sum += 2.0 * ((quotient - UNARY + 1) as f64).log2().floor() + 1.0;
    }
    sum + shift as f64 + (magnitude > 0) as u32 as f64
}

/// For each row: the bits of stopping at a quotient, and those of getting there.
#[cfg(feature = "encode")]
static COSTS: std::sync::LazyLock<Vec<([f64; UNARY], [f64; UNARY + 1])>> = std::sync::LazyLock::new(|| {
    let of = |row: &[u16; UNARY]| {
        let mut bits = ([0.0; UNARY], [0.0; UNARY + 1]);
        for n in 0..UNARY {
            let further = row[n] as f64 / 65536.0;
            bits.0[n] = -(1.0 - further).log2();
            bits.1[n + 1] = bits.1[n] - further.log2();
        }
        bits
    };
    CONTINUE_PROBABILITIES.iter().map(of).collect()
});
