//! Synthesis of rows of a picture from the quarters of its last level: all rows, or a strip of them.

use super::lifting::{ColourLanes, PixelRun, STATE_SLOTS, Synthesiser};
use super::masked::{Coefficients, MaskedPixels, PixelScratch, runs, runs_within};
use super::shape_adaptive::WaveletPlan;
use std::ops::Range;

/// Rows of a strip.
pub(crate) const STRIP_ROWS: usize = 64;
/// Rows above a strip that the filter's state comes from.
const STATE_ROWS: usize = 2 * STATE_SLOTS as usize + 2;

impl WaveletPlan {
    /// Undoes a level, which leaves the low band after `index` levels (0 the picture itself): the given rows into `out`, known within
    /// the mask. `quarters` are low, horizontal, vertical and diagonal.
    pub(super) fn synthesise_rows(
        &self,
        index: usize,
        quarters: [&[ColourLanes]; 4],
        rows: Range<usize>,
        sides: &mut [PixelScratch; 2],
        out: &mut [ColourLanes],
    ) {
        let level = &self.levels[index];
        let half = level.width.div_ceil(2);
        let top = rows.start.saturating_sub(STATE_ROWS);
        let [low, horizontal, vertical, diagonal] = quarters;
        let mut sides = sides.each_mut().map(|side| side.pixels((rows.end + 2 - top) * half));
        for ((side, columns), quarters) in
            sides.iter_mut().zip(&level.columns).zip([[low, vertical], [horizontal, diagonal]])
        {
            synthesise_columns(columns, quarters, &rows, side, half);
        }
        for run in runs_within(&self.rows[index], &rows) {
            let y = run.line as usize;
            let [low, high] = sides.each_ref().map(|side| &side[(y - top) * half..][..half]);
            let row = &mut out[(y - rows.start) * level.width..][..level.width];
            let mut line = Synthesiser::new(run);
            let (inner, coefficients) = (line.inner(), |slot: usize| [low[slot], high[slot]]);
            line.synthesise_start(coefficients, |x, pixel| row[x] = pixel);
            let pairs = row.get_mut(2 * inner.start - 3..).unwrap_or_default().as_chunks_mut::<2>().0;
            let [low, high] = [low, high].map(|half| half.get(inner.clone()).unwrap_or_default());
            for ((pair, low), high) in pairs.iter_mut().zip(low).zip(high) {
                *pair = line.next(*low, *high);
            }
            line.synthesise_end(coefficients, |x, pixel| row[x] = pixel);
        }
    }
}

/// Undoes the transform of columns, row by row, since memory is read and written along rows. `columns` are in the order of their starts,
/// `quarters` the low and the high coefficients, rows of `width`; the first row of `side` is [`STATE_ROWS`] above the first of `rows`, or
/// the picture's first.
fn synthesise_columns(
    columns: &[PixelRun],
    quarters: [&[ColourLanes]; 2],
    rows: &Range<usize>,
    side: &mut [ColourLanes],
    width: usize,
) {
    let top = rows.start.saturating_sub(STATE_ROWS);
    let coefficients = |x: usize| move |slot: usize| quarters.map(|quarter| quarter[slot * width + x]);
    // For each column its run, and what is behind the last inner slot of it; 0 where there is no run.
    let mut lines = vec![Synthesiser::default(); width];
    let mut ends = vec![0; width];
    let is_there = |run: &&PixelRun| (run.start as usize) < rows.end && (run.start + run.length) as usize > rows.start;
    let within = columns.iter().filter(is_there);
    let mut waiting = within.map(|run| (run.line as usize, Synthesiser::within(run, rows))).peekable();
    let mut active = 0;
    let first = waiting.peek().map_or(0, |(_, line)| line.inner().start);
    for slot in first.. {
        while let Some((x, mut line)) = waiting.next_if(|(_, line)| line.inner().start == slot) {
            line.synthesise_start(coefficients(x), |y, pixel| {
                if rows.contains(&y) {
                    side[(y - top) * width + x] = pixel;
                }
            });
            (lines[x], ends[x]) = (line, line.inner().end);
            active += 1;
        }
        if active == 0 {
            match waiting.peek() {
                Some(_) => continue,
                None => break,
            }
        }
        let rest = quarters.map(|quarter| quarter.get(slot * width..).unwrap_or_default());
        let row = (2 * slot).saturating_sub(3).saturating_sub(top);
        let mut settled = side.get_mut(row * width..).unwrap_or_default().chunks_exact_mut(width);
        let (odd, even) = (settled.next().unwrap_or_default(), settled.next().unwrap_or_default());
        let pixels = odd.iter_mut().zip(even).zip(rest[0].iter().zip(rest[1]));
        for ((line, end), ((odd, even), (low, high))) in lines.iter_mut().zip(&ends).zip(pixels) {
            if slot < *end {
                [*odd, *even] = line.next(*low, *high);
            }
        }
        for x in 0..width {
            if slot == ends[x] && slot > 0 {
                lines[x].synthesise_end(coefficients(x), |y, pixel| {
                    if rows.contains(&y) {
                        side[(y - top) * width + x] = pixel;
                    }
                });
                ends[x] = 0;
                active -= 1;
            }
        }
    }
}

/// A picture of which the last level is still to be undone, strip by strip: it is never in memory as a whole.
#[derive(Debug)]
pub(crate) struct HalfPicture {
    /// The low band after level 1.
    pub(crate) low: MaskedPixels,
    /// All coefficients, of which those of level 1 are read.
    pub(crate) coefficients: Coefficients,
}

impl HalfPicture {
    /// Bytes of memory that it takes.
    pub(crate) fn bytes(&self) -> u64 {
        self.low.bytes() + self.coefficients.bytes()
    }
    /// Calls `visit` for the runs of a mask in a strip, row by row, with their pixels. `plan` is the picture's.
    pub(crate) fn for_each_run(
        &self,
        plan: &WaveletPlan,
        rows: Range<usize>,
        strip: &mut StripScratch,
        visit: impl FnMut((&PixelRun, &[ColourLanes])),
    ) {
        let level = &plan.levels[0];
        let first = plan.level_bands(1).start;
        let band = |index: usize| self.coefficients.band(index, plan.bands[index].mask.data.len());
        let [horizontal, vertical, diagonal] = [first, first + 1, first + 2].map(band);
        let out = strip.pixels.pixels(rows.len() * level.width);
        let quarters = [self.low.pixels(), horizontal, vertical, diagonal];
        plan.synthesise_rows(0, quarters, rows.clone(), &mut strip.sides, out);
        runs(runs_within(&plan.rows[0], &rows), rows.start, level.width, out).for_each(visit);
    }
}

/// Memory that strips are synthesised in.
#[derive(Debug, Default)]
pub(crate) struct StripScratch {
    sides: [PixelScratch; 2],
    pixels: PixelScratch,
}
