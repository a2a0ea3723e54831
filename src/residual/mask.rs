//! Masks as bits, given where the mesh is.
//!
//! A photograph's mask follows the silhouette of the mesh to a pixel or two, so the mesh's coverage, known on both sides,
//! is the context: far from its border a mask costs next to nothing. Normative text: `spec/planes.md`.

use crate::entropy::mixer::{INPUTS, Mixer};
use crate::entropy::{BitCoder, BitModel};
use crate::image::Mask;

/// Adaptive state, handed from a mask to those coded after it.
#[derive(Debug, Clone)]
pub struct MaskModels {
    border: Mixer,
    /// Where nothing around tells of a border: covered and not.
    plain: [BitModel; 2],
}

impl Default for MaskModels {
    fn default() -> Self {
        MaskModels {
            border: Mixer::new([1 << 9, 1 << 10, 1 << 10, 1 << 10, 1 << 9, 1 << 6, 1 << 8, 1 << 6], [1 << 4, 1 << 5]),
            plain: Default::default(),
        }
    }
}

/// A grid of bits with a margin of three, so that neighbours need no checks.
struct Padded {
    stride: usize,
    bits: Vec<u8>,
}

const MARGIN: usize = 3;

impl Padded {
    fn new(width: usize, height: usize) -> Self {
        let stride = width + 2 * MARGIN;
        Padded { stride, bits: vec![0; stride * (height + 2 * MARGIN)] }
    }
    fn index(&self, x: usize, y: usize) -> usize {
        (y + MARGIN) * self.stride + x + MARGIN
    }
    /// Bits at the given offsets (columns, rows), first offset highest.
    #[inline(always)]
    fn read(&self, at: usize, offsets: &[(isize, isize)]) -> u32 {
        offsets.iter().fold(0, |bits, &(dx, dy)| {
            let index = at as isize + dy * self.stride as isize + dx;
            bits << 1 | self.bits[index as usize] as u32
        })
    }
}

/// Already coded neighbours in the mask, nearest first.
const CAUSAL: [(isize, isize); 10] =
    [(-1, 0), (0, -1), (-1, -1), (1, -1), (-2, 0), (0, -2), (-2, -1), (2, -1), (-1, -2), (1, -2)];
/// Coverage around, nearest first.
const COVERAGE: [(isize, isize); 10] =
    [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (2, 0), (0, 2), (3, 0)];

/// The value that all neighbours of [`CAUSAL`] and [`COVERAGE`] have, where they have the same.
#[inline(always)]
fn plain(coded: &Padded, covered: &Padded, at: usize) -> Option<usize> {
    // Columns from -3 to 4 of a row, a byte each.
    let row = |grid: &Padded, row: isize| {
        let start = (at as isize - MARGIN as isize + row * grid.stride as isize) as usize;
        grid.bits.get(start..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u64::from_le_bytes(*bytes))
    };
    const fn columns(first: isize, last: isize) -> u64 {
        let (first, last) = (first + MARGIN as isize, last + MARGIN as isize);
        (u64::MAX >> (8 * (7 - last))) & (u64::MAX << (8 * first)) & 0x0101_0101_0101_0101
    }
    let parts = [
        (row(coded, -2), columns(-1, 1)),
        (row(coded, -1), columns(-2, 2)),
        (row(coded, 0), columns(-2, -1)),
        (row(covered, -1), columns(0, 0)),
        (row(covered, 0), columns(-1, 3)),
        (row(covered, 1), columns(-1, 1)),
        (row(covered, 2), columns(0, 0)),
    ];
    let (mut any, mut missing) = (0, 0);
    for (bits, wanted) in parts {
        any |= bits & wanted;
        missing |= !bits & wanted;
    }
    match (any, missing) {
        (0, _) => Some(0),
        (_, 0) => Some(1),
        _ => None,
    }
}

/// Codes a mask; in decoding `mask` is `None` and the read one is returned.
pub fn code<C: BitCoder>(coder: &mut C, models: &mut MaskModels, coverage: &Mask, mask: Option<&Mask>) -> Mask {
    let (width, height) = (coverage.width, coverage.height);
    let mut covered = Padded::new(width, height);
    for y in 0..height {
        let at = covered.index(0, y);
        for (bit, set) in covered.bits[at..at + width].iter_mut().zip(coverage.row(y)) {
            *bit = *set as u8;
        }
    }
    let mut coded = Padded::new(width, height);
    let mut out = Mask::filled(width, height, false);
    for y in 0..height {
        for x in 0..width {
            let at = covered.index(x, y);
            let wanted = mask.is_some_and(|m| *m.at(x, y));
            let bit = if let Some(side) = plain(&coded, &covered, at) {
                models.plain[side].code(coder, wanted)
            } else {
                let causal = coded.read(at, &CAUSAL);
                let around = covered.read(at, &COVERAGE);
                let past = covered.read(at, &CAUSAL[..6]);
                let contexts: [u32; INPUTS] = [
                    (causal >> 6) << 5 | around >> 5,
                    causal,
                    around,
                    (causal >> 4) << 4 | past >> 2,
                    (causal >> 6) << 5 | ((causal >> 6 ^ past >> 2) & 15) << 1 | around >> 9,
                    (causal >> 4) & 63,
                    (causal >> 6) << 4 | past >> 2,
                    ((causal ^ past << 4) >> 4) & 63,
                ];
                let selectors = [causal >> 6, around >> 5];
                models.border.code(coder, &contexts, &selectors, wanted)
            };
            coded.bits[at] = bit as u8;
            *out.at_mut(x, y) = bit;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::{RangeDecoder, RangeEncoder};

    fn disc(radius: f64, wobble: f64) -> Mask {
        let mut mask = Mask::filled(120, 100, false);
        for y in 0..100 {
            for x in 0..120 {
                let (dx, dy) = (x as f64 - 60.0, y as f64 - 50.0);
                let edge = radius + wobble * (dy.atan2(dx) * 9.0).sin();
                *mask.at_mut(x, y) = (dx * dx + dy * dy).sqrt() < edge;
            }
        }
        mask
    }

    #[test]
    fn comes_back_and_the_silhouette_saves_most_of_it() {
        let mask = disc(40.0, 0.8);
        let bytes_given = |coverage: &Mask| {
            let mut encoder = RangeEncoder::new();
            let mut models = MaskModels::default();
            for _ in 0..8 {
                code(&mut encoder, &mut models, coverage, Some(&mask));
            }
            let bytes = encoder.finish();
            let mut decoder = RangeDecoder::new(&bytes);
            let mut models = MaskModels::default();
            for _ in 0..8 {
                assert_eq!(code(&mut decoder, &mut models, coverage, None), mask);
            }
            bytes.len()
        };
        let (known, unknown) = (bytes_given(&disc(40.0, 0.0)), bytes_given(&Mask::filled(120, 100, false)));
        assert!(known < 360 && known * 3 < unknown * 2, "{known} bytes, without the mesh {unknown}");
    }
}
