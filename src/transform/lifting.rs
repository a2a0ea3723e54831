//! The 9/7 filter on one run of pixels, by lifting (Cohen, Daubechies & Feauveau 1992).
//!
//! `f32` with `+ *` only, in the order written: the same on every platform (normative, `spec/planes.md`).

use glam::Vec4;
use std::ops::Range;

/// Four channels of one pixel.
pub type ColourLanes = [f32; 4];

/// A run of pixels along a row or a column.
#[derive(Debug, Clone, Copy)]
pub struct PixelRun {
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
pub(super) fn scatter(
    line: &[ColourLanes],
    run: &PixelRun,
    halves: &mut [&mut [ColourLanes]; 2],
    first: usize,
    stride: usize,
) {
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

/// `value + factor * (before + after)`, channel by channel.
#[inline(always)]
fn lifted(value: Vec4, factor: f32, before: Vec4, after: Vec4) -> Vec4 {
    value + Vec4::splat(factor) * (before + after)
}

/// One lifting step on the pixels of one parity of two or more: adds `factor` times the sum of both neighbours; at an end of the run
/// the only neighbour counts twice.
#[inline(always)]
fn lift(line: &mut [ColourLanes], first: usize, factor: f32) {
    let lifted = |value: &ColourLanes, before: &ColourLanes, after: &ColourLanes| {
        let [value, before, after] = [value, before, after].map(|pixel| Vec4::from_array(*pixel));
        lifted(value, factor, before, after).to_array()
    };
    if let ([value, after, ..], 0) = (&mut *line, first) {
        *value = lifted(value, after, after);
    }
    // From one neighbour to the next.
    let Some((before, inner)) = line[1 - first..].split_first_mut() else { return };
    let mut before = *before;
    let (pairs, last) = inner.as_chunks_mut::<2>();
    for [value, after] in pairs {
        *value = lifted(value, &before, after);
        before = *after;
    }
    for value in last {
        *value = lifted(value, &before, &before);
    }
}

/// Scales the pixels of the parity of the first one, and the others.
#[inline(always)]
fn scale(line: &mut [ColourLanes], [first, second]: [f32; 2]) {
    let (pairs, rest) = line.as_chunks_mut::<2>();
    for [a, b] in pairs {
        *a = a.map(|value| value * first);
        *b = b.map(|value| value * second);
    }
    rest.iter_mut().for_each(|last| *last = last.map(|value| value * first));
}

/// Transforms a run that starts at a position of parity `start % 2`; even positions become low.
pub(super) fn analyse(line: &mut [ColourLanes], start: u32) {
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

/// Slots whose coefficients a pixel depends on before the one with which it is settled.
pub(super) const STATE_SLOTS: isize = 4;

/// The inverse of [`analyse`] for one run, as a stream of slots: the same steps backwards, subtracted.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Synthesiser {
    start: isize,
    end: isize,
    /// Slots to be taken: all, or those that some of the pixels take.
    first: isize,
    behind: isize,
    /// Slot `k - 1`: the high coefficient scaled, the low one lifted once.
    high: Vec4,
    low: Vec4,
    /// Slot `k - 2`: the high coefficient lifted once, the low one lifted twice.
    lifted_high: Vec4,
    lifted_low: Vec4,
}

impl Synthesiser {
    /// For all pixels of a run.
    pub(super) fn new(run: &PixelRun) -> Self {
        Synthesiser::within(run, &(0..usize::MAX / 2))
    }
    /// For the pixels of a run that lie in a range, of which there is one at least. The first slots only bring the filter to where it would
    /// be if it came from the run's start: the pixels that are settled with them are not to be used.
    pub(super) fn within(run: &PixelRun, range: &Range<usize>) -> Self {
        let (start, end) = (run.start as isize, (run.start + run.length) as isize);
        // The slot with which a pixel is settled, and the slots before the first one that its state comes from.
        let settles = |at: isize| (at + 3) / 2;
        let first = settles(start.max(range.start as isize)) - STATE_SLOTS;
        let behind = settles(end.min(range.end as isize) - 1) + 1;
        Synthesiser { start, end, first: first.max(start / 2 - 2), behind, ..Default::default() }
    }
    /// Where the inner slots of the whole run begin and end.
    fn inner_of_run(&self) -> [isize; 2] {
        let first = (self.start + 1) / 2 + 2;
        [first, first.max(self.end / 2)]
    }
    /// Slots whose coefficients, and the pixels that are settled with them, all lie in the run.
    #[inline(always)]
    pub(super) fn inner(&self) -> Range<usize> {
        let [first, end] = self.inner_of_run();
        let first = first.max(self.first);
        first as usize..end.min(self.behind).max(first) as usize
    }
    /// The pixels at `2 slot - 3` and `2 slot - 2`, from the coefficients of an inner slot; they are taken one after the other.
    #[inline(always)]
    pub(super) fn next(&mut self, low: ColourLanes, high: ColourLanes) -> [ColourLanes; 2] {
        let high = Vec4::from_array(high) * (1.0 / HIGH);
        let low = lifted(Vec4::from_array(low) * (1.0 / LOW), -LIFT[3], self.high, high);
        let lifted_high = lifted(self.high, -LIFT[2], self.low, low);
        let lifted_low = lifted(self.low, -LIFT[1], self.lifted_high, lifted_high);
        let odd = lifted(self.lifted_high, -LIFT[0], self.lifted_low, lifted_low);
        *self = Synthesiser { high, low, lifted_high, lifted_low, ..*self };
        [odd.to_array(), lifted_low.to_array()]
    }
    /// Synthesises the slots before the inner ones. `coefficients` gives those of a slot, `put` takes the pixel of a position.
    pub(super) fn synthesise_start(
        &mut self,
        coefficients: impl Fn(usize) -> [ColourLanes; 2],
        put: impl FnMut(usize, ColourLanes),
    ) {
        self.near_an_end(self.first..self.inner_of_run()[0].min(self.behind), coefficients, put);
    }
    /// Synthesises the slots after the inner ones.
    pub(super) fn synthesise_end(
        &mut self,
        coefficients: impl Fn(usize) -> [ColourLanes; 2],
        put: impl FnMut(usize, ColourLanes),
    ) {
        self.near_an_end(self.inner_of_run()[1].max(self.first)..self.behind, coefficients, put);
    }
    fn near_an_end(
        &mut self,
        slots: Range<isize>,
        coefficients: impl Fn(usize) -> [ColourLanes; 2],
        mut put: impl FnMut(usize, ColourLanes),
    ) {
        let (start, end) = (self.start, self.end);
        if end - start == 1 {
            if slots.contains(&(start / 2)) {
                put(start as usize, coefficients(start as usize / 2)[0].map(|value| value * (1.0 / SINGLE)));
            }
            return;
        }
        // Beyond its ends the run goes on as its mirror image: the only neighbour counts twice.
        let mirrored = |mut at: isize| {
            while at < start || at >= end {
                at = if at < start { 2 * start - at } else { 2 * (end - 1) - at };
            }
            at as usize / 2
        };
        for slot in slots {
            let low = coefficients(mirrored(2 * slot))[0];
            let high = coefficients(mirrored(2 * slot + 1))[1];
            let settled = self.next(low, high);
            for (at, pixel) in (2 * slot - 3..).zip(settled) {
                if at >= start && at < end {
                    put(at as usize, pixel);
                }
            }
        }
    }
}
