//! The 9/7 filter on one run of pixels, by lifting (Cohen, Daubechies & Feauveau 1992).
//!
//! `f32` with `+ *` only, in the order written: the same on every platform (normative, `spec/planes.md`).

use glam::Vec4;

/// Four channels of one pixel.
pub type Pixel = [f32; 4];

/// A run of pixels along a row or a column.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// The row or column.
    pub line: u32,
    /// First pixel in it.
    pub start: u32,
    /// Pixels, at least one.
    pub length: u32,
}

/// Lifting steps of the 9/7 filter.
const LIFT: [f32; 4] = [-1.586_134_3, -0.052_980_12, 0.882_911_1, 0.443_506_85];
/// Scale of low and high coefficients, which makes the transform nearly orthonormal.
const LOW: f32 = 1.149_604_4;
const HIGH: f32 = 0.869_864_46;
/// Scale of a run of a single pixel, which is always a low coefficient: the low pass's gain for a constant.
const SINGLE: f32 = std::f32::consts::SQRT_2;

/// Puts each coefficient of a transformed run into its half, low or high; the line's place for slot `k` is `first + k * stride`.
#[inline(always)]
pub(super) fn scatter(line: &[Pixel], run: &Run, halves: &mut [Vec<Pixel>; 2], first: usize, stride: usize) {
    let start = run.start as usize;
    if let [single] = line {
        halves[0][first + start / 2 * stride] = *single;
        return;
    }
    for parity in 0..2 {
        // The first slot of the parity, and where the line holds it.
        let slot = (start + 1 - parity) / 2;
        let skipped = 2 * slot + parity - start;
        let places = halves[parity].iter_mut().skip(first + slot * stride).step_by(stride);
        for (place, value) in places.zip(line[skipped..].iter().step_by(2)) {
            *place = *value;
        }
    }
}

/// The inverse of [`scatter`].
#[inline(always)]
pub(super) fn gather(line: &mut [Pixel], run: &Run, halves: [&Vec<Pixel>; 2], first: usize, stride: usize) {
    let start = run.start as usize;
    if let [single] = line {
        *single = halves[0][first + start / 2 * stride];
        return;
    }
    for parity in 0..2 {
        let slot = (start + 1 - parity) / 2;
        let skipped = 2 * slot + parity - start;
        let places = halves[parity].iter().skip(first + slot * stride).step_by(stride);
        for (value, place) in line[skipped..].iter_mut().step_by(2).zip(places) {
            *value = *place;
        }
    }
}

/// `value + factor * (before + after)`, channel by channel.
#[inline(always)]
fn lifted(value: Pixel, factor: f32, before: Pixel, after: Pixel) -> Pixel {
    let [value, before, after] = [value, before, after].map(Vec4::from_array);
    (value + Vec4::splat(factor) * (before + after)).to_array()
}

/// One lifting step on the pixels of one parity of two or more: adds `factor` times the sum of both neighbours; at an end of the run
/// the only neighbour counts twice.
#[inline(always)]
fn lift(line: &mut [Pixel], first: usize, factor: f32) {
    if let ([value, after, ..], 0) = (&mut *line, first) {
        *value = lifted(*value, factor, *after, *after);
    }
    // From one neighbour to the next.
    let Some((before, inner)) = line[1 - first..].split_first_mut() else { return };
    let mut before = *before;
    let (pairs, last) = inner.as_chunks_mut::<2>();
    for [value, after] in pairs {
        *value = lifted(*value, factor, before, *after);
        before = *after;
    }
    for value in last {
        *value = lifted(*value, factor, before, before);
    }
}

/// Scales the pixels of the parity of the first one, and the others.
#[inline(always)]
fn scale(line: &mut [Pixel], [first, second]: [f32; 2]) {
    let (pairs, rest) = line.as_chunks_mut::<2>();
    for [a, b] in pairs {
        *a = a.map(|value| value * first);
        *b = b.map(|value| value * second);
    }
    rest.iter_mut().for_each(|last| *last = last.map(|value| value * first));
}

/// Transforms a run that starts at a position of parity `start % 2`; even positions become low.
pub(super) fn analyse(line: &mut [Pixel], start: u32) {
    if line.len() == 1 {
        return scale(line, [SINGLE; 2]);
    }
    let (even, odd) = ((start % 2) as usize, 1 - (start % 2) as usize);
    lift(line, odd, LIFT[0]);
    lift(line, even, LIFT[1]);
    lift(line, odd, LIFT[2]);
    lift(line, even, LIFT[3]);
    scale(line, if even == 0 { [LOW, HIGH] } else { [HIGH, LOW] });
}

/// Inverse of [`analyse`]: the same steps backwards, subtracted.
pub(super) fn synthesise(line: &mut [Pixel], start: u32) {
    if line.len() == 1 {
        return scale(line, [1.0 / SINGLE; 2]);
    }
    let (even, odd) = ((start % 2) as usize, 1 - (start % 2) as usize);
    scale(line, if even == 0 { [1.0 / LOW, 1.0 / HIGH] } else { [1.0 / HIGH, 1.0 / LOW] });
    lift(line, even, -LIFT[3]);
    lift(line, odd, -LIFT[2]);
    lift(line, even, -LIFT[1]);
    lift(line, odd, -LIFT[0]);
}
