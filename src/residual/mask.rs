//! Masks as bits, given where the mesh is.
//!
//! A photograph's mask follows the silhouette of the mesh to a pixel or two, so the mesh's coverage, known on both sides,
//! is the context: far from its border a mask costs next to nothing. Normative text: `spec/planes.md`.

use crate::entropy::mixer::{INPUTS, Mixer, MixerContext};
use crate::entropy::{BitCoder, BitModel};
use crate::image::Mask;

/// Adaptive state, handed from a mask to those coded after it.
#[derive(Debug, Clone)]
pub struct MaskModels {
    border: Mixer,
    /// Whether some pixel of a row differs from its surroundings where these are all alike.
    differs: BitModel,
    /// Pixels whose surroundings are alike: covered and not.
    plain: [BitModel; 2],
}

impl Default for MaskModels {
    fn default() -> Self {
        MaskModels {
            border: Mixer::new([1 << 9, 1 << 10, 1 << 10, 1 << 10, 1 << 9, 1 << 6, 1 << 8, 1 << 6], [1 << 4, 1 << 5]),
            differs: BitModel::default(),
            plain: Default::default(),
        }
    }
}

/// A grid of bits with a margin of three, so that neighbours need no checks.
struct PaddedMask {
    stride: usize,
    bits: Vec<u8>,
}

const MARGIN: usize = 3;

impl PaddedMask {
    fn new(width: usize, height: usize) -> Self {
        let stride = width + 2 * MARGIN;
        PaddedMask { stride, bits: vec![0; stride * (height + 2 * MARGIN)] }
    }
    fn index(&self, x: usize, y: usize) -> usize {
        (y + MARGIN) * self.stride + x + MARGIN
    }
    /// Bits at the given offsets (columns, rows), first offset highest.
    #[inline(always)]
    fn bits_at(&self, at: usize, offsets: &[(isize, isize)]) -> u32 {
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

/// Pixels of a row that are looked at together.
const PART: usize = 64;

/// What bytes of 0 and 1 have in common, eight at a time.
struct Common {
    any: u64,
    all: u64,
}

impl Default for Common {
    fn default() -> Self {
        Common { any: 0, all: ONES }
    }
}

const ONES: u64 = 0x0101_0101_0101_0101;

impl Common {
    #[inline(always)]
    fn add(&mut self, bits: &[u8]) {
        let (words, rest) = bits.as_chunks::<8>();
        for word in words {
            let word = u64::from_ne_bytes(*word);
            self.any |= word;
            self.all &= word;
        }
        for &bit in rest {
            self.any |= u64::from(bit);
            self.all &= u64::from(bit) * ONES;
        }
    }
    /// The bits' value if they are all the same.
    fn value(&self) -> Option<u8> {
        match (self.any, self.all) {
            (0, _) => Some(0),
            (_, ONES) => Some(1),
            _ => None,
        }
    }
}

/// Pixels of a row whose surroundings are alike: each a byte of 0 or 1, for the sides outside and inside. Of the coded
/// neighbours only those of the rows above count.
struct PlainPixels([Vec<u8>; 2]);

impl PlainPixels {
    fn new(width: usize) -> Self {
        PlainPixels([vec![0; width], vec![0; width]])
    }

    /// Looks at a row, part by part: of most parts all that is around is alike.
    fn scan_row(&mut self, coded: &PaddedMask, covered: &PaddedMask, y: usize) {
        let PlainPixels([outside, inside]) = self;
        let parts = outside.chunks_mut(PART).zip(inside.chunks_mut(PART));
        for (k, (outside, inside)) in parts.enumerate() {
            let at = covered.index(k * PART, y);
            let rows = [(coded, [-2, -1].as_slice()), (covered, &[-1, 0, 1, 2])];
            let around = rows.into_iter().flat_map(|(grid, rows)| rows.iter().map(move |dy| (grid, dy)));
            let mut common = Common::default();
            for (grid, dy) in around {
                let first = (at as isize + dy * grid.stride as isize) as usize - MARGIN;
                common.add(&grid.bits[first..first + outside.len() + 2 * MARGIN]);
            }
            if let Some(side) = common.value() {
                outside.fill(1 - side);
                inside.fill(side);
                continue;
            }
            outside.fill(0);
            inside.fill(1);
            let parts = CAUSAL.iter().filter(|(_, dy)| *dy < 0).map(|offset| (coded, offset));
            for (grid, (dx, dy)) in parts.chain(COVERAGE.iter().map(|offset| (covered, offset))) {
                let at = (at as isize + dy * grid.stride as isize + dx) as usize;
                for ((outside, inside), bit) in outside.iter_mut().zip(inside.iter_mut()).zip(&grid.bits[at..]) {
                    *outside |= bit;
                    *inside &= bit;
                }
            }
            outside.iter_mut().for_each(|any| *any ^= 1);
        }
    }
}

/// Codes a mask; in decoding `mask` is `None` and the read one is returned.
pub fn code_mask<C: BitCoder>(coder: &mut C, models: &mut MaskModels, coverage: &Mask, mask: Option<&Mask>) -> Mask {
    let (width, height) = (coverage.width, coverage.height);
    let mut covered = PaddedMask::new(width, height);
    for y in 0..height {
        let at = covered.index(0, y);
        for (bit, set) in covered.bits[at..at + width].iter_mut().zip(coverage.row(y)) {
            *bit = *set as u8;
        }
    }
    let mut coded = PaddedMask::new(width, height);
    let mut out = Mask::filled(width, height, false);
    let mut plain = PlainPixels::new(width);
    for y in 0..height {
        if coder.is_exhausted() {
            break;
        }
        plain.scan_row(&coded, &covered, y);
        let start = covered.index(0, y);
        let wanted = |x: usize| mask.is_some_and(|m| *m.value_at(x, y));
        // The side of a pixel without a border around it; `before` are the two coded before it, the nearer one first.
        let side = |x: usize, before: [u8; 2]| (0..2).find(|&side| plain.0[side][x] == 1 && before == [side as u8; 2]);
        let differs = mask.is_some_and(|mask| {
            let row = mask.row(y);
            let before = |x: usize| [1, 2].map(|back| x.checked_sub(back).is_some_and(|x| row[x]) as u8);
            (0..width).any(|x| side(x, before(x)).is_some_and(|side| row[x] != (side == 1)))
        });
        let differs = models.differs.code(coder, differs);
        let mut x = 0;
        while x < width {
            let at = start + x;
            let bit = match side(x, [coded.bits[at - 1], coded.bits[at - 2]]) {
                Some(side) if !differs => {
                    // All as far as nothing else comes.
                    let run = plain.0[side][x..].iter().position(|&plain| plain == 0).unwrap_or(width - x);
                    coded.bits[at..at + run].fill(side as u8);
                    x += run;
                    continue;
                }
                Some(side) => models.plain[side].code(coder, wanted(x)),
                None => {
                    let causal = coded.bits_at(at, &CAUSAL);
                    let around = covered.bits_at(at, &COVERAGE);
                    let past = covered.bits_at(at, &CAUSAL[..6]);
                    let slots: [u32; INPUTS] = [
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
                    models.border.code(coder, &MixerContext { slots, selectors }, wanted(x))
                }
            };
            coded.bits[at] = bit as u8;
            x += 1;
        }
        for (out, bit) in out.data[y * width..][..width].iter_mut().zip(&coded.bits[start..]) {
            *out = *bit == 1;
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
                *mask.value_at_mut(x, y) = (dx * dx + dy * dy).sqrt() < edge;
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
                code_mask(&mut encoder, &mut models, coverage, Some(&mask));
            }
            let bytes = encoder.finish();
            let mut decoder = RangeDecoder::new(&bytes);
            let mut models = MaskModels::default();
            for _ in 0..8 {
                assert_eq!(code_mask(&mut decoder, &mut models, coverage, None), mask);
            }
            bytes.len()
        };
        let (known, unknown) = (bytes_given(&disc(40.0, 0.0)), bytes_given(&Mask::filled(120, 100, false)));
        assert!(known < 360 && known * 3 < unknown * 2, "{known} bytes, without the mesh {unknown}");
    }
}
