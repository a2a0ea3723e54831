//! Memory that is used again for the next picture, and what may be read of it.
//!
//! Pictures are worked on in memory that is not cleared. So that nobody reads what an earlier picture has left there, memory
//! to be used again has no values ([`PixelScratch`]), a picture has those of its mask alone ([`MaskedPixels`]), and all of it has
//! values only once what lies outside the mask is set to 0 ([`MaskedPixels::zero_outside`]). In tests and fuzzing the memory
//! holds NaN at first, which no comparison survives.

use super::lifting::{ColourLanes, PixelRun};
use std::ops::Range;
use std::sync::Arc;

/// Whether memory that is used again is filled with NaN first, so that whatever is read of it unwritten is found.
const IS_POISONED: bool = cfg!(any(test, fuzzing, debug_assertions));

/// Memory for pixels, to be used again: what it held is not to be had.
#[derive(Debug, Default)]
pub struct PixelScratch(Vec<ColourLanes>);

impl PixelScratch {
    /// Room for `length` pixels, which are to be written before they are read.
    pub(super) fn into_pixels(mut self, length: usize) -> Vec<ColourLanes> {
        self.pixels(length);
        self.0.truncate(length);
        self.0
    }
    /// The first `length` pixels, which are to be written before they are read.
    pub(super) fn pixels(&mut self, length: usize) -> &mut [ColourLanes] {
        if IS_POISONED {
            self.0.fill([f32::NAN; 4]);
        }
        if self.0.len() < length {
            self.0.resize(length, if IS_POISONED { [f32::NAN; 4] } else { [0.0; 4] });
        }
        &mut self.0[..length]
    }
    /// Bytes of memory that it takes.
    pub fn bytes(&self) -> u64 {
        (self.0.capacity() * size_of::<ColourLanes>()) as u64
    }
    /// Returns the first `length` pixels, as written since [`PixelScratch::pixels`].
    pub(super) fn written(&self, length: usize) -> &[ColourLanes] {
        &self.0[..length]
    }
}

impl From<Vec<ColourLanes>> for PixelScratch {
    fn from(pixels: Vec<ColourLanes>) -> Self {
        PixelScratch(pixels)
    }
}

/// Runs of a mask along rows, from top to bottom and from left to right.
pub(crate) type RowRuns = Arc<[PixelRun]>;

/// A picture of which only the pixels of a mask can be read.
#[derive(Debug, Clone)]
pub struct MaskedPixels {
    width: usize,
    rows: RowRuns,
    pixels: Vec<ColourLanes>,
}

impl MaskedPixels {
    /// Row-major `pixels`, of which those of `rows` have been written.
    pub(crate) fn new(width: usize, rows: RowRuns, pixels: Vec<ColourLanes>) -> Self {
        MaskedPixels { width, rows, pixels }
    }
    /// The mask's runs in a range of lines with their pixels.
    pub fn runs(&self, lines: &Range<usize>) -> impl Iterator<Item = (&PixelRun, &[ColourLanes])> {
        runs(runs_within(&self.rows, lines), 0, self.width, &self.pixels)
    }
    /// Columns.
    pub(super) fn width(&self) -> usize {
        self.width
    }
    /// All pixels, of which those of the mask are to be read.
    pub(super) fn pixels(&self) -> &[ColourLanes] {
        &self.pixels
    }
    /// Bytes of memory that its pixels take.
    pub fn bytes(&self) -> u64 {
        (self.pixels.capacity() * size_of::<ColourLanes>()) as u64
    }
    /// The mask's runs.
    pub fn rows(&self) -> &RowRuns {
        &self.rows
    }
    /// The whole picture, 0 outside the mask.
    pub fn zero_outside(mut self) -> Vec<ColourLanes> {
        let mut end = 0;
        for run in self.rows.iter() {
            let start = run.line as usize * self.width + run.start as usize;
            self.pixels[end..start].fill([0.0; 4]);
            end = start + run.length as usize;
        }
        self.pixels[end..].fill([0.0; 4]);
        self.pixels
    }
    /// Its memory, to be used again.
    pub fn into_scratch(self) -> PixelScratch {
        PixelScratch(self.pixels)
    }
}

/// The runs in a range of lines, of runs in the order of their lines.
pub(crate) fn runs_within<'a>(runs: &'a [PixelRun], lines: &Range<usize>) -> &'a [PixelRun] {
    let [start, end] = [lines.start, lines.end].map(|line| runs.partition_point(|run| (run.line as usize) < line));
    &runs[start..end]
}

/// Runs of a picture of `width` columns with their pixels; `pixels` begin with line `first`.
pub(crate) fn runs<'a>(
    rows: &'a [PixelRun],
    first: usize,
    width: usize,
    pixels: &'a [ColourLanes],
) -> impl Iterator<Item = (&'a PixelRun, &'a [ColourLanes])> {
    rows.iter().map(move |run| {
        let at = (run.line as usize - first) * width + run.start as usize;
        (run, &pixels[at..at + run.length as usize])
    })
}

/// Coefficients of one picture by band, row-major, written within the bands' masks; only the transform reads them.
#[derive(Debug, Default)]
pub struct Coefficients(Vec<PixelScratch>);

impl Coefficients {
    /// Bytes of memory that they take.
    pub fn bytes(&self) -> u64 {
        self.0.iter().map(PixelScratch::bytes).sum()
    }
    /// Room for `count` bands, of which nothing is written; what was in it is not to be had.
    pub fn reset(&mut self, count: usize) {
        self.0.resize_with(count, PixelScratch::default);
    }
    /// A band's `length` positions, which are to be written within its mask before they are read.
    pub fn band_mut(&mut self, index: usize, length: usize) -> &mut [ColourLanes] {
        self.0[index].pixels(length)
    }
    /// The positions of three bands from `first` on, each of `length`; as [`Coefficients::band_mut`].
    pub fn three_bands_mut(&mut self, first: usize, length: usize) -> [&mut [ColourLanes]; 3] {
        let mut bands = self.0.iter_mut().skip(first);
        [(); 3].map(|()| bands.next().map_or(&mut [][..], |band| band.pixels(length)))
    }
    /// Returns the written coefficients of a band of `length` positions.
    pub(super) fn band(&self, index: usize, length: usize) -> &[ColourLanes] {
        self.0[index].written(length)
    }
}

impl From<Vec<Vec<ColourLanes>>> for Coefficients {
    fn from(bands: Vec<Vec<ColourLanes>>) -> Self {
        Coefficients(bands.into_iter().map(PixelScratch).collect())
    }
}
