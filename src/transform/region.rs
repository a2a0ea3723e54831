//! Synthesis of a rectangle of a picture, level by level, from the coefficients that it depends on.
//!
//! Each level is that of a picture cut around what is wanted of it, so wide that no pixel that is wanted depends on where the cut is: the
//! same bits come out as of the whole.

use super::masked::{Coefficients, MaskedPixels, PixelScratch};
use super::rectangle::Rectangle;
use super::shape_adaptive::{ColourLanes, Subband, WaveletPlan, row_runs};
use crate::image::Mask;

/// The masks of a level's three bands within a rectangle of positions; `mask` is that of the picture, and these masks may be one column and one
/// row larger than the rectangle.
pub(crate) fn band_masks(mask: &Mask, positions: &Rectangle) -> [Mask; 3] {
    let size = [mask.width, mask.height];
    let pixels = positions.map(|axis, range| {
        let end = (2 * range.end + 2).min(size[axis]);
        (2 * range.start).min(end)..end
    });
    let masks = super::band_masks::LevelMasks::new(&pixels.crop_mask(mask));
    [masks.horizontal, masks.vertical, masks.diagonal]
}

/// The last levels of the inverse transform, of a rectangle of a picture.
#[derive(Debug)]
pub(crate) struct RegionTransform {
    /// From the coarsest on.
    levels: Vec<RegionLevel>,
    mask: Mask,
}

#[derive(Debug)]
struct RegionLevel {
    /// The level of a picture around the wanted pixels.
    plan: WaveletPlan,
    /// The positions of its low band, in that of the whole picture.
    low: Rectangle,
    /// The positions of its other bands, in the stored parts of these.
    stored: Rectangle,
    /// What is wanted of it.
    pixels: Rectangle,
}

impl RegionTransform {
    /// Plans the levels down to a picture, of which a rectangle is wanted. `masks` are those of the picture and of the low bands after each level but
    /// the last; `stored` are the positions of each level's bands that will be given, from the finest level on.
    pub(crate) fn new(masks: &[Mask], wanted: &Rectangle, stored: &[Rectangle]) -> Self {
        let mask = masks.first().map(|mask| wanted.crop_mask(mask)).unwrap_or_default();
        let (mut levels, mut wanted) = (Vec::with_capacity(masks.len()), wanted.clone());
        for (mask, stored) in masks.iter().zip(stored) {
            let size = [mask.width, mask.height];
            let low = wanted.coefficients(size);
            let around = low.map(|axis, range| 2 * range.start..(2 * range.end).min(size[axis]));
            levels.push(RegionLevel {
                plan: WaveletPlan::with_levels(around.crop_mask(mask), 1),
                stored: low.from(stored.corner()),
                pixels: wanted.from(around.corner()),
                low: low.clone(),
            });
            wanted = low;
        }
        levels.reverse();
        RegionTransform { levels, mask }
    }
    /// The mask in the rectangle.
    pub(crate) fn mask(&self) -> &Mask {
        &self.mask
    }
    /// The pixels of the rectangle, from the low band after all levels and the stored parts of the bands, of which `first` is that of the coarsest
    /// level; `bands` are these with their masks.
    pub(crate) fn inverse(
        &self,
        low: &MaskedPixels,
        (coefficients, first): (&Coefficients, usize),
        bands: &[Subband],
    ) -> MaskedPixels {
        let mut sides = [(); 2].map(|()| PixelScratch::default());
        let (mut low, mut width) = (low.pixels().to_vec(), low.width());
        let mut corner = [0, 0];
        for (index, level) in self.levels.iter().enumerate() {
            let stored = |k: usize| {
                let mask = &bands[3 * index + k].mask;
                level.stored.crop(coefficients.band(first + 3 * index + k, mask.data.len()), mask.width)
            };
            let [horizontal, vertical, diagonal] = [0, 1, 2].map(stored);
            let quarter: Vec<ColourLanes> = level.low.from(corner).crop(&low, width);
            let across = level.plan.columns_after(0);
            let mut pixels = PixelScratch::default().into_pixels(level.pixels.rows.len() * across);
            let quarters = [&quarter[..], &horizontal, &vertical, &diagonal];
            level.plan.synthesise_rows(0, quarters, level.pixels.rows.clone(), &mut sides, &mut pixels);
            let rows = 0..level.pixels.rows.len();
            low = Rectangle { rows, ..level.pixels.clone() }.crop(&pixels, across);
            width = level.pixels.columns.len();
            // The next level's low band is this rectangle.
            corner = self.levels.get(index + 1).map_or([0, 0], |next| next.low.corner());
        }
        MaskedPixels::new(self.mask.width, row_runs(&self.mask), low)
    }
}

/// The part of a picture in a rectangle; `mask` is the mask there.
pub(crate) fn crop_pixels(pixels: &MaskedPixels, rectangle: &Rectangle, mask: &Mask) -> MaskedPixels {
    MaskedPixels::new(mask.width, row_runs(mask), rectangle.crop(pixels.pixels(), pixels.width()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transform::band_masks::low_mask;
    use crate::transform::shape_adaptive::TransformScratch;

    /// Of masks of single pixels and of large areas, wherever the rectangle lies; memory that was not written holds NaN.
    #[test]
    fn a_rectangle_is_the_same_as_in_the_whole() {
        let mut state = 7u32;
        let mut random = |below: usize| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as usize % below
        };
        for (width, height, dots) in [(97, 70, 3), (64, 64, 1000), (41, 90, 1)] {
            let data = (0..width * height).map(|at| random(10) < dots && (at % width) + at / width > 20).collect();
            let mask = Mask { width, height, data };
            let pixels = (0..width * height).map(|_| [random(1000) as f32; 4]).collect();
            let plan = WaveletPlan::new(&mask);
            let coefficients: Coefficients = plan.forward(pixels).into();
            let whole = plan.inverse(&coefficients);
            let low = plan.inverse_keeping(&coefficients, [2, 2], &mut TransformScratch::default()).0;
            let masks = [mask.clone(), low_mask(&mask)];
            let sizes = [1, 2].map(|level| [width, height].map(|size| size.div_ceil(1 << level)));
            for _ in 0..40 {
                let mut part = |size: usize| {
                    let start = random(size);
                    start..start + 1 + random(size - start)
                };
                let wanted = Rectangle { columns: part(width), rows: part(height) };
                let transform = RegionTransform::new(&masks, &wanted, &sizes.map(Rectangle::whole));
                let first = plan.level_bands(2).start;
                let found = transform.inverse(&low, (&coefficients, first), &plan.bands()[first..]);
                let mut count = 0;
                for (run, pixels) in found.runs(&(0..wanted.rows.len())) {
                    let at =
                        (wanted.rows.start + run.line as usize) * width + wanted.columns.start + run.start as usize;
                    assert!(pixels == &whole[at..at + pixels.len()], "{width} x {height}, {wanted:?}: {run:?}");
                    count += pixels.len();
                }
                assert_eq!(count, wanted.crop_mask(&mask).count());
            }
        }
    }

    #[test]
    fn parts_of_bands_have_the_masks_of_the_whole() {
        let data = (0..50 * 37).map(|at| at * at % 7 < 4 || at % 50 > 30).collect();
        let mask = Mask { width: 50, height: 37, data };
        let plan = WaveletPlan::with_levels(mask.clone(), 1);
        for positions in [(0..25, 0..19), (3..9, 4..5), (20..25, 10..19)] {
            let positions = Rectangle { columns: positions.0, rows: positions.1 };
            for (part, band) in band_masks(&mask, &positions).iter().zip(&plan.bands()[plan.level_bands(1)]) {
                for (y, row) in positions.rows.clone().enumerate() {
                    let expected = &band.mask.row(row)[positions.columns.clone()];
                    assert_eq!(&part.row(y)[..expected.len()], expected, "{:?}", band.orientation);
                }
            }
        }
    }
}
