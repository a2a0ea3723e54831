//! Two contexts of each decision, averaged.
//!
//! All numbers here are part of the format (`spec/planes.md`).

use super::contexts::{BLOCK, CLASSES, Contexts, KINDS, Known, Place, class_8, class_12, few, logarithmic};
use crate::entropy::average::Average;
use crate::transform::shape_adaptive::Pixel;

/// Magnitudes of the three colours and their sum, each at most 255; of the prediction in half steps.
type Lanes = [u8; 4];

/// What surrounds a position.
pub(super) struct Around {
    west: Lanes,
    north: Lanes,
    north_west: Lanes,
    north_east: Lanes,
    parent: Lanes,
    hint: Lanes,
    /// `2 (west + north) + north_west + north_east` of the sums.
    near: u32,
    /// `near` and what is farther off.
    wide: u32,
}

/// Two contexts of each decision, averaged.
#[derive(Debug, Clone)]
pub(super) enum Direct {}

/// Lane of the sum.
const SUM: usize = 3;

#[inline(always)]
fn with_sum([a, b, c]: [u8; 3]) -> Lanes {
    [a, b, c, a.saturating_add(b).saturating_add(c)]
}

impl Contexts for Direct {
    type Predictor = Average;
    type Lanes = Lanes;
    type Around = Around;
    type Magnitude = [u32; 2];

    fn predictors() -> [Average; 2] {
        [Average::new([8 * 12 * 9, 8 * 32 * 4]), Average::new([CLASSES * KINDS * 12 * 8, KINDS * CLASSES * 8 * 16])]
    }

    #[inline(always)]
    fn lanes(values: &[i32; 3]) -> Lanes {
        with_sum(values.map(|value| value.unsigned_abs().min(255) as u8))
    }

    #[inline(always)]
    fn hint(predicted: &Pixel, inverse: f32) -> Lanes {
        with_sum([0, 1, 2].map(|k| (predicted[k].abs() * (0.5 * inverse)).min(255.0) as u8))
    }

    fn blocks() -> Option<Average> {
        Some(Average::new([3 * 4 * 12, 4 * 3 * 8 * 4]))
    }

    #[inline(always)]
    fn block(
        parent: Option<&Known<Lanes>>,
        siblings: &[Known<Lanes>],
        beside: [bool; 2],
        x: usize,
        y: usize,
    ) -> [u32; 2] {
        let total = |known: &Known<Lanes>, side: usize| -> u32 {
            let rows = (y * side..(y + 1) * side).map(|y| known.index(x * side, y));
            let rows = rows.filter_map(|at| known.values.get(at..at + side));
            rows.flatten().map(|lanes| lanes[SUM] as u32).sum()
        };
        let parent = parent.map_or(0, |parent| total(parent, BLOCK / 2));
        let siblings_total: u32 = siblings.iter().map(|known| total(known, BLOCK)).sum();
        let beside = beside[0] as u32 + 2 * beside[1] as u32;
        let orientation = siblings.len() as u32;
        [
            (orientation * 4 + beside) * 12 + class_12(parent),
            ((beside * 3 + orientation) * 8 + class_8(siblings_total)) * 4 + few(parent),
        ]
    }

    #[inline(always)]
    fn around(
        here: &Known<Lanes>,
        parent: Option<&Known<Lanes>>,
        siblings: &[Known<Lanes>],
        x: usize,
        y: usize,
    ) -> Around {
        let at = here.index(x, y);
        let (v, stride) = (&here.values, here.stride);
        let lanes = |at: usize| v.get(at).copied().unwrap_or_default();
        let [west_west, west] = v.get(at - 2..).and_then(|row| row.first_chunk()).copied().unwrap_or_default();
        let [north_west, north, north_east] =
            v.get(at - stride - 1..).and_then(|row| row.first_chunk()).copied().unwrap_or_default();
        let sum = |lanes: Lanes| lanes[SUM] as u32;
        let parent = parent.map_or([0; 4], |parent| parent.values[parent.index(x / 2, y / 2)]);
        let siblings: u32 = siblings.iter().map(|other| sum(other.values[at])).sum();
        let hint = here.hint(at);
        let near = 2 * (sum(west) + sum(north)) + sum(north_west) + sum(north_east);
        let far = sum(west_west) + sum(lanes(at - 2 * stride));
        let wide = 3 * near + 2 * far + 3 * sum(parent) + 2 * siblings;
        Around { west, north, north_west, north_east, parent, hint, near, wide }
    }

    #[inline(always)]
    fn any(place: &Place, around: &Around) -> [u32; 2] {
        let class = place.band_class as u32;
        let hint = around.hint[SUM] as u32;
        let hint_class = if place.is_predicted { class_8(hint) } else { 8 };
        let total = around.wide + 4 * hint;
        [
            (class * 12 + class_12(around.near)) * 9 + hint_class,
            (class * 32 + logarithmic(2 * total, 31)) * 4 + few(around.parent[SUM] as u32),
        ]
    }

    #[inline(always)]
    fn magnitude(place: &Place, around: &Around, colour: usize, before: &[i32; 3]) -> [u32; 2] {
        let lane = |lanes: &Lanes| lanes[colour] as u32;
        let near = 2 * (lane(&around.west) + lane(&around.north)) + lane(&around.north_west) + lane(&around.north_east);
        let colours: u32 = before[..colour].iter().map(|v| v.unsigned_abs().min(255)).sum();
        let class = (place.band_class * 3 + colour) as u32;
        let kinds = KINDS as u32;
        let hint = lane(&around.hint);
        let total = 3 * near + 3 * lane(&around.parent) + 4 * colours + 2 * hint;
        [
            (class * kinds * 12 + class_12(near)) * 8 + class_8(hint),
            (class * kinds * 8 + class_8(2 * colours)) * 16 + logarithmic(total + around.wide / 4, 15),
        ]
    }

    #[inline(always)]
    fn decision(magnitude: &[u32; 2], index: u32) -> [u32; 2] {
        let kind = index.min(KINDS as u32 - 1);
        [magnitude[0] + kind * 12 * 8, magnitude[1] + kind * 8 * 16]
    }
}
