//! Shape-adaptive 9/7 wavelet transform of a masked picture (Li & Li 2000; Cohen, Daubechies & Feauveau 1992).
//!
//! Every run of mask pixels in a row or column is transformed on its own, with as many coefficients as pixels: pixels
//! outside the mask cost nothing. Parity is that of the picture, so neighbouring runs stay aligned. Four channels go
//! together, one in each lane. `f32` with `+ *` only, in the order written: the same on every platform (normative,
//! `spec/planes.md`).

use crate::image::Mask;

/// Four channels of one pixel.
pub type Pixel = [f32; 4];

/// Lifting steps of the 9/7 filter.
const LIFT: [f32; 4] = [-1.586_134_3, -0.052_980_12, 0.882_911_1, 0.443_506_85];
/// Scale of low and high coefficients, which makes the transform nearly orthonormal.
const LOW: f32 = 1.149_604_4;
const HIGH: f32 = 0.869_864_46;
/// Scale of a run of a single pixel, which is always a low coefficient: the low pass's gain for a constant.
const SINGLE: f32 = std::f32::consts::SQRT_2;

/// Most levels of a transform.
pub const MAX_LEVELS: usize = 5;

/// A run of pixels along a row or a column.
#[derive(Debug, Clone, Copy)]
struct Run {
    line: u32,
    start: u32,
    length: u32,
}

/// Which coefficients of one subband exist.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Level: 1 is the finest.
    pub level: usize,
    /// Which band of its level.
    pub orientation: Orientation,
    /// Positions that hold a coefficient.
    pub mask: Mask,
}

/// Direction of a subband's detail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// Low in both directions (coarsest level only).
    Low = 0,
    /// High along rows.
    Horizontal = 1,
    /// High along columns.
    Vertical = 2,
    /// High in both.
    Diagonal = 3,
}

/// Everything about the transform that follows from the mask alone.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    width: usize,
    height: usize,
    levels: Vec<Level>,
    bands: Vec<Band>,
}

#[derive(Debug, Clone)]
struct Level {
    width: usize,
    height: usize,
    rows: Vec<Run>,
    /// Columns of the low and of the high half.
    columns: [Vec<Run>; 2],
}

/// Number of levels for a picture: the largest up to [`MAX_LEVELS`] that leaves at least 4 rows and columns.
pub fn level_count(width: usize, height: usize) -> usize {
    let side = width.min(height);
    (0..=MAX_LEVELS).rev().find(|&levels| side >> levels >= 4).unwrap_or(0)
}

fn runs(mask: &Mask, along_rows: bool) -> Vec<Run> {
    let (lines, length) = if along_rows { (mask.height, mask.width) } else { (mask.width, mask.height) };
    let set = |line: usize, at: usize| if along_rows { *mask.at(at, line) } else { *mask.at(line, at) };
    let mut runs = Vec::new();
    for line in 0..lines {
        let mut at = 0;
        while at < length {
            if !set(line, at) {
                at += 1;
                continue;
            }
            let start = at;
            while at < length && set(line, at) {
                at += 1;
            }
            runs.push(Run { line: line as u32, start: start as u32, length: (at - start) as u32 });
        }
    }
    runs
}

/// Masks of the low and the high half after transforming `runs`.
fn halves(runs: &[Run], width: usize, height: usize, along_rows: bool) -> [Mask; 2] {
    let (w, h) = if along_rows { (width.div_ceil(2), height) } else { (width, height.div_ceil(2)) };
    let mut halves = [Mask::filled(w, h, false), Mask::filled(w, h, false)];
    for run in runs {
        for at in run.start..run.start + run.length {
            let half = if run.length == 1 { 0 } else { at % 2 };
            let (x, y) = if along_rows { (at / 2, run.line) } else { (run.line, at / 2) };
            *halves[half as usize].at_mut(x as usize, y as usize) = true;
        }
    }
    halves
}

impl Plan {
    /// Plans the transform of a mask's pixels over [`level_count`] levels.
    pub fn new(mask: &Mask) -> Self {
        let (width, height) = (mask.width, mask.height);
        let mut levels = Vec::new();
        let mut bands = Vec::new();
        let mut low = mask.clone();
        for level in 1..=level_count(width, height) {
            let rows = runs(&low, true);
            let [left, right] = halves(&rows, low.width, low.height, true);
            let columns = [runs(&left, false), runs(&right, false)];
            let [next, vertical] = halves(&columns[0], left.width, left.height, false);
            let [horizontal, diagonal] = halves(&columns[1], right.width, right.height, false);
            levels.push(Level { width: low.width, height: low.height, rows, columns });
            bands.push(Band { level, orientation: Orientation::Diagonal, mask: diagonal });
            bands.push(Band { level, orientation: Orientation::Vertical, mask: vertical });
            bands.push(Band { level, orientation: Orientation::Horizontal, mask: horizontal });
            low = next;
        }
        bands.push(Band { level: levels.len(), orientation: Orientation::Low, mask: low });
        bands.reverse();
        Plan { width, height, levels, bands }
    }

    /// The subbands, coarse to fine: low, then horizontal, vertical and diagonal of each level.
    pub fn bands(&self) -> &[Band] {
        &self.bands
    }

    /// Coefficients of all bands, parallel to [`Plan::bands`]; positions outside a band's mask are 0.
    /// `pixels` is row-major, of the mask's size; values outside the mask are ignored.
    pub fn forward(&self, pixels: Vec<Pixel>) -> Vec<Vec<Pixel>> {
        let mut coefficients = Vec::with_capacity(self.bands.len());
        let mut low = pixels;
        let mut line = Vec::new();
        for level in &self.levels {
            let half = level.width.div_ceil(2);
            let mut sides = [vec![[0.0; 4]; half * level.height], vec![[0.0; 4]; half * level.height]];
            for run in &level.rows {
                let at = run.line as usize * level.width + run.start as usize;
                line.clear();
                line.extend_from_slice(&low[at..at + run.length as usize]);
                analyse(&mut line, run.start);
                scatter(&line, run, &mut sides, run.line as usize * half, 1);
            }
            let half_height = level.height.div_ceil(2);
            let mut quarters = Vec::with_capacity(4);
            for (side, columns) in sides.iter().zip(&level.columns) {
                let mut out = [vec![[0.0; 4]; half * half_height], vec![[0.0; 4]; half * half_height]];
                for run in columns {
                    line.clear();
                    line.extend(
                        (run.start..run.start + run.length).map(|y| side[y as usize * half + run.line as usize]),
                    );
                    analyse(&mut line, run.start);
                    scatter(&line, run, &mut out, run.line as usize, half);
                }
                quarters.extend(out);
            }
            // low-low, vertical, horizontal, diagonal
            let mut quarters = quarters.into_iter();
            low = quarters.next().unwrap_or_default();
            let vertical = quarters.next().unwrap_or_default();
            let horizontal = quarters.next().unwrap_or_default();
            let diagonal = quarters.next().unwrap_or_default();
            coefficients.extend([diagonal, vertical, horizontal]);
        }
        coefficients.push(low);
        coefficients.reverse();
        coefficients
    }

    /// Pixels from coefficients as [`Plan::forward`] gives them; 0 outside the mask.
    pub fn inverse(&self, coefficients: &[Vec<Pixel>]) -> Vec<Pixel> {
        let mut low = coefficients.first().cloned().unwrap_or_default();
        let mut line = Vec::new();
        for (index, level) in self.levels.iter().enumerate().rev() {
            let first = 1 + 3 * (self.levels.len() - 1 - index);
            let [horizontal, vertical, diagonal] = [0, 1, 2].map(|k| &coefficients[first + k]);
            let half = level.width.div_ceil(2);
            let mut sides = [vec![[0.0; 4]; half * level.height], vec![[0.0; 4]; half * level.height]];
            let quarters = [[&low, vertical], [horizontal, diagonal]];
            for ((side, columns), quarter) in sides.iter_mut().zip(&level.columns).zip(quarters) {
                for run in columns {
                    gather(&mut line, run, quarter, run.line as usize, half);
                    synthesise(&mut line, run.start);
                    for (y, value) in (run.start..).zip(&line) {
                        side[y as usize * half + run.line as usize] = *value;
                    }
                }
            }
            let mut pixels = vec![[0.0; 4]; level.width * level.height];
            for run in &level.rows {
                gather(&mut line, run, sides.each_ref(), run.line as usize * half, 1);
                synthesise(&mut line, run.start);
                let at = run.line as usize * level.width + run.start as usize;
                pixels[at..at + line.len()].copy_from_slice(&line);
            }
            low = pixels;
        }
        debug_assert_eq!(low.len(), self.width * self.height);
        low
    }
}

/// Puts each coefficient of a transformed run into its half, low or high; the line's place for slot `k` is `first + k * stride`.
#[inline(always)]
fn scatter(line: &[Pixel], run: &Run, halves: &mut [Vec<Pixel>; 2], first: usize, stride: usize) {
    let start = run.start as usize;
    if let [single] = line {
        halves[0][first + start / 2 * stride] = *single;
        return;
    }
    for (at, value) in (start..).zip(line) {
        halves[at % 2][first + at / 2 * stride] = *value;
    }
}

/// The inverse of [`scatter`].
#[inline(always)]
fn gather(line: &mut Vec<Pixel>, run: &Run, [low, high]: [&Vec<Pixel>; 2], first: usize, stride: usize) {
    line.clear();
    let (start, end) = (run.start as usize, (run.start + run.length) as usize);
    if run.length == 1 {
        line.push(low[first + start / 2 * stride]);
        return;
    }
    let place = |slot: usize| first + slot * stride;
    if start % 2 == 1 {
        line.push(high[place(start / 2)]);
    }
    line.extend((start.div_ceil(2)..end / 2).flat_map(|slot| [low[place(slot)], high[place(slot)]]));
    if end % 2 == 1 {
        line.push(low[place(end / 2)]);
    }
}

/// One lifting step on the pixels of one parity of two or more: adds `factor` times the sum of both neighbours; at an end of the run
/// the only neighbour counts twice.
#[inline(always)]
fn lift(line: &mut [Pixel], first: usize, factor: f32) {
    let count = line.len();
    let add = |pixel: &mut Pixel, before: Pixel, after: Pixel| {
        for k in 0..4 {
            pixel[k] += factor * (before[k] + after[k]);
        }
    };
    if first == 0 {
        let after = line[1];
        add(&mut line[0], after, after);
    }
    let mut at = if first == 0 { 2 } else { 1 };
    while let Some([before, pixel, after]) = line.get_mut(at - 1..at + 2) {
        add(pixel, *before, *after);
        at += 2;
    }
    if at + 1 == count {
        let before = line[at - 1];
        add(&mut line[at], before, before);
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
fn analyse(line: &mut [Pixel], start: u32) {
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
fn synthesise(line: &mut [Pixel], start: u32) {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn blob(width: usize, height: usize, dots: f32) -> (Mask, Vec<Pixel>) {
        let mut state = width as u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut mask = Mask::filled(width, height, false);
        let pixels = (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as f32 - width as f32 / 2.0, (i / width) as f32 - height as f32 / 2.0);
                mask.data[i] = x * x + 2.0 * y * y < (width * height) as f32 / 6.0 || random() < dots;
                std::array::from_fn(|k| (x * 0.2 + k as f32).sin() * 100.0 + random())
            })
            .collect();
        (mask, pixels)
    }

    #[test]
    fn reconstructs_any_shape_with_as_many_coefficients_as_pixels() {
        for (width, height) in [(64, 48), (37, 91), (5, 4), (3, 9), (1, 1)] {
            let (mask, pixels) = blob(width, height, 0.1);
            let plan = Plan::new(&mask);
            assert_eq!(plan.bands().iter().map(|b| b.mask.count()).sum::<usize>(), mask.count());
            let back = plan.inverse(&plan.forward(pixels.clone()));
            for i in (0..width * height).filter(|&i| mask.data[i]) {
                for k in 0..4 {
                    assert!((back[i][k] - pixels[i][k]).abs() < 1e-3, "{width} x {height}, pixel {i}");
                }
            }
        }
    }

    #[test]
    fn nearly_orthonormal_and_compacts_energy() {
        let (mask, pixels) = blob(128, 96, 0.0);
        let plan = Plan::new(&mask);
        let energy = |values: &[Pixel], mask: &Mask| -> f64 {
            values.iter().zip(&mask.data).filter(|(_, m)| **m).map(|(v, _)| (v[0] as f64).powi(2)).sum()
        };
        let bands = |pixels: &[Pixel]| -> Vec<f64> {
            plan.forward(pixels.to_vec()).iter().zip(plan.bands()).map(|(c, b)| energy(c, &b.mask)).collect()
        };
        let smooth = bands(&pixels);
        let finest: f64 = smooth[smooth.len() - 3..].iter().sum();
        assert!(finest < 0.01 * energy(&pixels, &mask), "finest bands hold {smooth:?}");
        let mut state = 1u32;
        let noise: Vec<Pixel> = (0..128 * 96)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                [(state >> 8) as f32 / (1 << 24) as f32 - 0.5; 4]
            })
            .collect();
        let ratio = bands(&noise).iter().sum::<f64>() / energy(&noise, &mask);
        assert!((ratio - 1.0).abs() < 0.1, "energy ratio {ratio}");
    }
}
