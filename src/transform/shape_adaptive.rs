//! Shape-adaptive 9/7 wavelet transform of a masked picture (Li & Li 2000; Cohen, Daubechies & Feauveau 1992).
//!
//! Every run of mask pixels in a row or column is transformed on its own, with as many coefficients as pixels: pixels
//! outside the mask cost nothing. Parity is that of the picture, so neighbouring runs stay aligned. Four channels go
//! together, one in each lane. `f32` with `+ *` only, in the order written: the same on every platform (normative,
//! `spec/planes.md`).

use super::band_masks::LevelMasks;
pub use super::lifting::ColourLanes;
pub(crate) use super::lifting::PixelRun;
use super::lifting::{analyse, scatter};
use super::masked::{Coefficients, MaskedPixels, PixelScratch, RowRuns};
use crate::image::Mask;
use std::ops::Range;

/// Most levels of a transform.
pub(crate) const MAX_LEVELS: usize = 5;

/// A subband: which of its coefficients exist.
#[derive(Debug, Clone, PartialEq)]
pub struct Subband {
    /// Level: 1 is the finest.
    pub level: usize,
    /// Orientation within its level.
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
#[derive(Debug, Clone)]
pub struct WaveletPlan {
    pub(super) levels: Vec<PlanLevel>,
    pub(super) bands: Vec<Subband>,
    /// Runs along rows of the picture and of the low band after each level.
    pub(super) rows: Vec<RowRuns>,
}

#[derive(Debug, Clone)]
pub(super) struct PlanLevel {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Columns of the low and of the high half, in the order of their starts.
    pub(super) columns: [Vec<PixelRun>; 2],
}

/// Number of levels for a picture: the largest up to [`MAX_LEVELS`] that leaves at least 4 rows and columns.
pub(crate) fn level_count(width: usize, height: usize) -> usize {
    let side = width.min(height);
    (0..=MAX_LEVELS).rev().find(|&levels| side >> levels >= 4).unwrap_or(0)
}

/// Runs along rows, from top to bottom and from left to right.
pub(super) fn row_runs(mask: &Mask) -> RowRuns {
    let mut runs = Vec::new();
    for y in 0..mask.height {
        let row = mask.row(y);
        let mut at = 0;
        while let Some(skipped) = row[at..].iter().position(|&set| set) {
            let start = at + skipped;
            let length = row[start..].iter().position(|&set| !set).unwrap_or(row.len() - start);
            runs.push(PixelRun { line: y as u32, start: start as u32, length: length as u32 });
            at = start + length;
        }
    }
    runs.into()
}

/// Runs along columns, in the order of their starts.
fn column_runs(mask: &Mask) -> Vec<PixelRun> {
    let mut runs = Vec::new();
    // How far the run reaches up that each column is in.
    let mut lengths = vec![0u32; mask.width];
    for y in 0..=mask.height {
        let row = if y < mask.height { mask.row(y) } else { &[] };
        for (x, length) in lengths.iter_mut().enumerate() {
            if row.get(x) == Some(&true) {
                *length += 1;
            } else if *length > 0 {
                runs.push(PixelRun { line: x as u32, start: y as u32 - *length, length: *length });
                *length = 0;
            }
        }
    }
    runs.sort_unstable_by_key(|run| (run.start, run.line));
    runs
}

impl WaveletPlan {
    /// Plans the transform of a mask's pixels over [`level_count`] levels.
    pub fn new(mask: &Mask) -> Self {
        WaveletPlan::with_levels(mask.clone(), level_count(mask.width, mask.height))
    }

    /// Plans the transform of a mask's pixels.
    pub fn with_levels(mask: Mask, count: usize) -> Self {
        WaveletPlan::above(&[], mask, count)
    }

    /// Plans the coarser levels of `count`: from and to the low band whose mask is `low`. Of the picture and the low bands before it, whose masks
    /// are `finer`, nothing is planned.
    pub fn above(finer: &[Mask], mut low: Mask, count: usize) -> Self {
        let mut rows: Vec<RowRuns> = vec![Vec::new().into(); finer.len()];
        let left_out = |mask: &Mask| PlanLevel { width: mask.width, height: mask.height, columns: Default::default() };
        let mut levels: Vec<PlanLevel> = finer.iter().map(left_out).collect();
        let mut bands = Vec::new();
        rows.push(row_runs(&low));
        for level in finer.len() + 1..=count {
            let LevelMasks { halves, low: next, horizontal, vertical, diagonal } = LevelMasks::new(&low);
            levels.push(PlanLevel {
                width: low.width,
                height: low.height,
                columns: halves.each_ref().map(column_runs),
            });
            bands.push(Subband { level, orientation: Orientation::Diagonal, mask: diagonal });
            bands.push(Subband { level, orientation: Orientation::Vertical, mask: vertical });
            bands.push(Subband { level, orientation: Orientation::Horizontal, mask: horizontal });
            low = next;
            rows.push(row_runs(&low));
        }
        bands.push(Subband { level: levels.len(), orientation: Orientation::Low, mask: low });
        bands.reverse();
        WaveletPlan { levels, bands, rows }
    }

    /// Runs of the low band after `level` levels, 0 the picture itself, row by row and from left to right.
    pub fn row_runs(&self, level: usize) -> &[PixelRun] {
        self.rows.get(level).map_or(&[], |rows| rows)
    }

    /// Bytes of memory that it takes.
    pub fn bytes(&self) -> u64 {
        let runs = self.levels.iter().flat_map(|level| &level.columns).map(Vec::len).sum::<usize>()
            + self.rows.iter().map(|rows| rows.len()).sum::<usize>();
        (self.bands.iter().map(|band| band.mask.data.len()).sum::<usize>() + runs * size_of::<PixelRun>()) as u64
    }

    /// The mask of the low band after `level` levels, 0 the picture itself.
    pub fn low_mask(&self, level: usize) -> Mask {
        let (width, height) = match self.levels.get(level) {
            Some(level) => (level.width, level.height),
            None => (self.bands[0].mask.width, self.bands[0].mask.height),
        };
        let mut mask = Mask::filled(width, height, false);
        for run in self.row_runs(level) {
            let at = run.line as usize * width + run.start as usize;
            mask.data[at..at + run.length as usize].fill(true);
        }
        mask
    }

    /// The subbands, coarse to fine: low, then horizontal, vertical and diagonal of each level.
    pub fn bands(&self) -> &[Subband] {
        &self.bands
    }

    /// Indices of the subbands of a level, horizontal, vertical and diagonal.
    pub fn level_bands(&self, level: usize) -> Range<usize> {
        let first = 1 + 3 * (self.levels.len() - level);
        first..first + 3
    }

    /// Columns of the low band after `level` levels, 0 the picture itself.
    pub(super) fn columns_after(&self, level: usize) -> usize {
        self.levels.get(level).map_or(self.bands[0].mask.width, |level| level.width)
    }

    /// Coefficients of all bands, parallel to [`WaveletPlan::bands`]; positions outside a band's mask are 0.
    /// `pixels` is row-major, of the mask's size; values outside the mask are ignored.
    pub fn forward(&self, pixels: Vec<ColourLanes>) -> Vec<Vec<ColourLanes>> {
        self.forward_from(0, pixels)
    }

    /// [`WaveletPlan::forward`] of a low band after `level` levels: the coarser bands.
    pub fn forward_from(&self, level: usize, low: Vec<ColourLanes>) -> Vec<Vec<ColourLanes>> {
        let mut coefficients = Vec::with_capacity(self.bands.len());
        let mut low = low;
        let mut work = TransformScratch::default();
        let longest = self.levels.get(level).map_or(0, |level| level.width.max(level.height));
        let mut line = vec![[0.0; 4]; longest];
        for (level, rows) in self.levels.iter().zip(&self.rows).skip(level) {
            let half = level.width.div_ceil(2);
            let mut sides = work.sides(half * level.height);
            for run in rows.iter() {
                let at = run.line as usize * level.width + run.start as usize;
                let line = &mut line[..run.length as usize];
                line.copy_from_slice(&low[at..at + run.length as usize]);
                analyse(line, run.start);
                scatter(line, run, &mut sides, run.line as usize * half, 1);
            }
            let half_height = level.height.div_ceil(2);
            let mut quarters = [const { Vec::new() }; 4];
            for ((side, columns), quarter) in sides.iter().zip(&level.columns).zip(quarters.as_chunks_mut::<2>().0) {
                *quarter = [(); 2].map(|()| vec![[0.0; 4]; half * half_height]);
                for run in columns {
                    let line = &mut line[..run.length as usize];
                    let first = run.start as usize * half + run.line as usize;
                    for (value, place) in line.iter_mut().zip(side[first..].iter().step_by(half)) {
                        *value = *place;
                    }
                    analyse(line, run.start);
                    scatter(line, run, &mut quarter.each_mut().map(Vec::as_mut_slice), run.line as usize, half);
                }
            }
            let [next, vertical, horizontal, diagonal] = quarters;
            low = next;
            coefficients.extend([diagonal, vertical, horizontal]);
        }
        coefficients.push(low);
        coefficients.reverse();
        coefficients
    }

    /// Pixels from coefficients as [`WaveletPlan::forward`] gives them; 0 outside the mask.
    pub fn inverse(&self, coefficients: &Coefficients) -> Vec<ColourLanes> {
        self.inverse_keeping(coefficients, [0, 0], &mut TransformScratch::default()).0.zero_outside()
    }

    /// The low bands after `wanted` levels, 0 the picture itself, and after `kept` ones, if these are more; both known within their masks
    /// alone. Bands of the first `wanted` levels are not read.
    pub fn inverse_keeping(
        &self,
        coefficients: &Coefficients,
        [wanted, kept]: [usize; 2],
        work: &mut TransformScratch,
    ) -> (MaskedPixels, Option<MaskedPixels>) {
        let band = |index: usize| coefficients.band(index, self.bands[index].mask.data.len());
        let mut low = band(0).to_vec();
        let mut keep = None;
        for (index, level) in self.levels.iter().enumerate().skip(wanted).rev() {
            let first = self.level_bands(index + 1).start;
            let [horizontal, vertical, diagonal] = [0, 1, 2].map(|k| band(first + k));
            let mut pixels = work.take_buffer(index, level.width * level.height);
            let bands = [&low[..], horizontal, vertical, diagonal];
            self.synthesise_rows(index, bands, 0..level.height, &mut work.sides, &mut pixels);
            let low = std::mem::replace(&mut low, pixels);
            if index + 1 == kept && kept > wanted {
                keep = Some(MaskedPixels::new(self.columns_after(kept), self.rows[kept].clone(), low));
            } else {
                work.recycle(index + 1, low.into());
            }
        }
        (MaskedPixels::new(self.columns_after(wanted), self.rows[wanted].clone(), low), keep)
    }
}

/// Memory that a transform works in, for all its levels and for the next picture.
#[derive(Debug, Default)]
pub struct TransformScratch {
    /// A picture's left and right half.
    sides: [PixelScratch; 2],
    /// The picture, and the low band after each level.
    pictures: Vec<PixelScratch>,
}

impl TransformScratch {
    /// Bytes of memory that it takes.
    pub fn bytes(&self) -> u64 {
        self.sides.iter().chain(&self.pictures).map(PixelScratch::bytes).sum()
    }
    fn take_buffer(&mut self, level: usize, length: usize) -> Vec<ColourLanes> {
        self.pictures.get_mut(level).map(std::mem::take).unwrap_or_default().into_pixels(length)
    }
    /// Takes a picture, or the low band after `level` levels, to be used again.
    pub fn recycle(&mut self, level: usize, picture: PixelScratch) {
        if self.pictures.len() <= level {
            self.pictures.resize_with(level + 1, PixelScratch::default);
        }
        self.pictures[level] = picture;
    }
    fn sides(&mut self, length: usize) -> [&mut [ColourLanes]; 2] {
        self.sides.each_mut().map(|side| side.pixels(length))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blob(width: usize, height: usize, dots: f32) -> (Mask, Vec<ColourLanes>) {
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
            let plan = WaveletPlan::new(&mask);
            assert_eq!(plan.bands().iter().map(|b| b.mask.count()).sum::<usize>(), mask.count());
            let back = plan.inverse(&plan.forward(pixels.clone()).into());
            for i in (0..width * height).filter(|&i| mask.data[i]) {
                for k in 0..4 {
                    assert!((back[i][k] - pixels[i][k]).abs() < 1e-3, "{width} x {height}, pixel {i}");
                }
            }
        }
    }

    #[test]
    fn a_low_band_is_what_its_coarser_bands_give() {
        let (mask, pixels) = blob(96, 70, 0.1);
        let plan = WaveletPlan::new(&mask);
        let coefficients = plan.forward(pixels);
        for level in 1..=plan.levels.len() {
            let coefficients_again = coefficients.clone().into();
            let mut work = TransformScratch::default();
            let low = plan.inverse_keeping(&coefficients_again, [0, level], &mut work).1.unwrap().zero_outside();
            let alone = plan.inverse_keeping(&coefficients_again, [level, level], &mut work).0.zero_outside();
            assert!(alone == low, "level {level}");
            let again = plan.forward_from(level, low);
            assert_eq!(again.len(), 1 + 3 * (plan.levels.len() - level));
            for (a, b) in again.iter().flatten().zip(coefficients.iter().flatten()) {
                assert!((0..4).all(|k| (a[k] - b[k]).abs() < 2e-3), "level {level}: {a:?} {b:?}");
            }
        }
    }

    /// Strips of any rows, of masks whose runs begin and end everywhere.
    #[test]
    fn rows_by_themselves_are_those_of_the_whole() {
        for (width, height, dots) in [(37, 91, 0.3), (40, 150, 0.0), (9, 64, 0.7)] {
            let (mask, pixels) = blob(width, height, dots);
            let plan = WaveletPlan::new(&mask);
            let coefficients: Coefficients = plan.forward(pixels).into();
            let whole = plan.inverse(&coefficients);
            let low = plan.inverse_keeping(&coefficients, [1, 1], &mut TransformScratch::default()).0;
            let half = crate::transform::synthesis::HalfPicture { low, coefficients };
            let (mut strip, mut found) = (Default::default(), 0);
            for rows in (1..12).flat_map(|rows| (0..height - rows).map(move |first| first..first + rows)) {
                half.for_each_run(&plan, rows.clone(), &mut strip, |(run, pixels)| {
                    assert!(rows.contains(&(run.line as usize)));
                    let at = run.line as usize * width + run.start as usize;
                    assert!(pixels == &whole[at..at + pixels.len()], "{width} x {height}, {rows:?}: {run:?}");
                    found += pixels.len();
                });
            }
            assert!(found > 10 * mask.count(), "{found}");
        }
    }

    #[test]
    fn nearly_orthonormal_and_compacts_energy() {
        let (mask, pixels) = blob(128, 96, 0.0);
        let plan = WaveletPlan::new(&mask);
        let energy = |values: &[ColourLanes], mask: &Mask| -> f64 {
            values.iter().zip(&mask.data).filter(|(_, m)| **m).map(|(v, _)| (v[0] as f64).powi(2)).sum()
        };
        let bands = |pixels: &[ColourLanes]| -> Vec<f64> {
            plan.forward(pixels.to_vec()).iter().zip(plan.bands()).map(|(c, b)| energy(c, &b.mask)).collect()
        };
        let smooth = bands(&pixels);
        let finest: f64 = smooth[smooth.len() - 3..].iter().sum();
        assert!(finest < 0.01 * energy(&pixels, &mask), "finest bands hold {smooth:?}");
        let mut state = 1u32;
        let noise: Vec<ColourLanes> = (0..128 * 96)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                [(state >> 8) as f32 / (1 << 24) as f32 - 0.5; 4]
            })
            .collect();
        let ratio = bands(&noise).iter().sum::<f64>() / energy(&noise, &mask);
        assert!((ratio - 1.0).abs() < 0.1, "energy ratio {ratio}");
    }
}
