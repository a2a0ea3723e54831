//! A region of a photograph: of the levels that are cut into tiles, only what it takes.

use super::PlaneCoding;
use crate::image::{Mask, Region};
use crate::residual::tiles::TileSelection;
use crate::transform::masked::{Coefficients, MaskedPixels};
use crate::transform::rectangle::Rectangle;
use crate::transform::region::{RegionTransform, band_masks, crop_pixels};
use crate::transform::shape_adaptive::{Orientation, Subband, WaveletPlan};
use crate::transform::window::Window;

/// Bytes for each position of the tiles that a region takes, and component: three coefficients, their magnitudes and masks.
const POSITION_BYTES: u64 = 100;
/// Bytes for each pixel of a region, and component.
const PIXEL_BYTES: u64 = 64;

/// The rectangle of a region.
pub(super) fn rectangle(region: &Region) -> Rectangle {
    Rectangle { columns: region.columns(), rows: region.rows() }
}

/// Bytes of what a region takes of a window of a photograph while it is decoded, beyond what later views are predicted from.
pub(super) fn coding_bytes(region: &Region, tiles: &TileSelection, window: &Window, coding: &PlaneCoding) -> u64 {
    let stored = |level: usize| tiles.stored(level, window.corner(), window.low_band(level).size()).area() as u64;
    let positions: u64 = (tiles.finest_level() + 1..=tiles.levels()).map(stored).sum();
    let pixels = rectangle(region).area() as u64;
    (positions.saturating_mul(POSITION_BYTES).saturating_add(pixels.saturating_mul(PIXEL_BYTES)))
        .saturating_mul(coding.components.len() as u64)
}

/// What a region takes of a view's window.
#[derive(Debug)]
pub(super) struct RegionPart {
    /// Where the region shows the window, in the window and in the region.
    within: Rectangle,
    window: Window,
    size: [usize; 2],
    /// The mask there.
    inside: Mask,
    /// The parts of the bands that its tiles hold, from the coarsest level on.
    bands: Vec<Subband>,
    /// Levels below the picture that later views are predicted from; none where the region takes none of them.
    transform: Option<RegionTransform>,
}

impl RegionPart {
    /// Plans a region of the photograph that is left after `reduction` levels. `finer` are the masks of the window and of its low bands before the one that
    /// `plan` begins with.
    pub(super) fn new(
        (region, reduction): (&Region, usize),
        tiles: &TileSelection,
        window: &Window,
        finer: &[Mask],
        plan: &WaveletPlan,
    ) -> Self {
        let low = window.low_band(reduction);
        let place = Rectangle { columns: low.left..low.left + low.width, rows: low.top..low.top + low.height };
        let shown = rectangle(region).intersection(&place);
        let mut part = RegionPart {
            within: Rectangle { columns: 0..0, rows: 0..0 },
            window: Window::default(),
            size: rectangle(region).size(),
            inside: Mask::default(),
            bands: Vec::new(),
            transform: None,
        };
        if shown.is_empty() {
            return part;
        }
        let [width, height] = shown.size();
        let [left, top] = shown.from(rectangle(region).corner()).corner();
        part.window = Window { left, top, width, height };
        part.within = shown.from(place.corner());
        let Some(finer) = finer.get(reduction..).filter(|finer| !finer.is_empty()) else {
            part.inside = part.within.crop_mask(&plan.low_mask(reduction));
            return part;
        };
        let stored = |level: usize| tiles.stored(level, window.corner(), window.low_band(level).size());
        let stored: Vec<Rectangle> = (reduction + 1..=reduction + finer.len()).map(stored).collect();
        for (k, (mask, stored)) in finer.iter().zip(&stored).enumerate().rev() {
            let level = reduction + 1 + k;
            let orientations = [Orientation::Horizontal, Orientation::Vertical, Orientation::Diagonal];
            let masks = band_masks(mask, stored).into_iter().zip(orientations);
            part.bands.extend(masks.map(|(mask, orientation)| Subband { level, orientation, mask }));
        }
        let transform = RegionTransform::new(finer, &part.within, &stored);
        part.inside = transform.mask().clone();
        part.transform = Some(transform);
        part
    }
    /// The parts of the bands that its tiles hold, from the coarsest level on; none where it takes none.
    pub(super) fn bands(&self) -> &[Subband] {
        &self.bands
    }
    /// Whether it takes tiles.
    pub(super) fn has_tiles(&self) -> bool {
        self.transform.is_some()
    }
    /// The region's pixels from the picture that later views are predicted from and the bands below, of which `first` is the index of the
    /// first; or from the photograph.
    pub(super) fn pixels(&self, picture: &MaskedPixels, coefficients: &Coefficients, first: usize) -> MaskedPixels {
        match &self.transform {
            Some(transform) => transform.inverse(picture, (coefficients, first), &self.bands),
            None => crop_pixels(picture, &self.within, &self.inside),
        }
    }
    /// Where the region shows the view's window.
    pub(super) fn window(&self) -> Window {
        self.window
    }
    /// The mask of the region.
    pub(super) fn mask(&self) -> Mask {
        let [width, height] = self.size;
        let mut mask = Mask::filled(width, height, false);
        let Window { left, top, .. } = self.window;
        for y in 0..self.inside.height {
            let start = (top + y) * width + left;
            mask.data[start..start + self.inside.width].copy_from_slice(self.inside.row(y));
        }
        mask
    }
}
