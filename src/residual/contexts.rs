//! Contexts of wavelet coefficients: what is known around a position before it is coded.
//!
//! All numbers here are part of the format (`spec/planes.md`).

use super::gains;
use crate::entropy::mixer::{INPUTS, SELECTORS};
use crate::transform::shape_adaptive::Band;

/// Decisions that have slots of their own: larger than 0, than 1, than 2 or more.
pub(super) const KINDS: usize = 3;
/// Classes of bands by level and direction, for each colour.
pub(super) const CLASSES: usize = 8 * 3;

/// Magnitudes of one band, at most 255, with a margin of two columns on both sides and two rows above, so that neighbours need no checks.
pub(super) struct Magnitudes {
    pub(super) stride: usize,
    pub(super) values: Vec<[i16; 4]>,
}

impl Magnitudes {
    pub(super) fn new(band: &Band) -> Self {
        let stride = band.mask.width + 4;
        Magnitudes { stride, values: vec![[0; 4]; stride * (band.mask.height + 3)] }
    }
    #[inline(always)]
    pub(super) fn index(&self, x: usize, y: usize) -> usize {
        (y + 2) * self.stride + x + 2
    }
}

/// Classes of a non-negative sum, finer where it is small: 0, 1, 2, 3, 4, 5-6, 7-8, 9-11, 12-15, 16-22, 23-36, 37 and more.
#[inline(always)]
fn class_12(value: u32) -> u32 {
    const TABLE: [u8; 40] = [
        0, 1, 2, 3, 4, 5, 5, 6, 6, 7, 7, 7, 8, 8, 8, 8, 9, 9, 9, 9, 9, 9, 9, 10, 10, 10, 10, 10, 10, 10, 10, 10, 10,
        10, 10, 10, 10, 11, 11, 11,
    ];
    TABLE[value.min(39) as usize] as u32
}

/// 0, 1, 2, 3-4, 5-7, 8-12, 13-24, 25 and more.
#[inline(always)]
fn class_8(value: u32) -> u32 {
    const TABLE: [u8; 26] = [0, 1, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 7];
    TABLE[value.min(25) as usize] as u32
}

/// Half-octave classes up to `most`.
#[inline(always)]
fn logarithmic(value: u32, most: u32) -> u32 {
    if value < 2 {
        return value;
    }
    let top = 31 - value.leading_zeros();
    (2 * top + (value >> (top - 1) & 1)).min(most)
}

/// What is the same for a whole band.
pub(super) struct Place {
    pub(super) is_predicted: bool,
    pub(super) band_class: usize,
    pub(super) level: usize,
}

/// What surrounds a position, each for three colours (the fourth lane is unused).
pub(super) struct Around {
    west: [i16; 4],
    north: [i16; 4],
    north_west: [i16; 4],
    north_east: [i16; 4],
    /// Second neighbours west and north.
    far: [i16; 4],
    parent: [i16; 4],
    siblings: [i16; 4],
    /// Magnitude of the prediction in quarter steps.
    hint: [i16; 4],
    /// That of the four neighbours together.
    hints_near: [i32; 4],
    /// `2 (west + north) + north_west + north_east`.
    near: [i16; 4],
    /// `3 near + 2 far + 3 parent + 2 siblings`.
    wide: [i32; 4],
}

impl Around {
    #[inline(always)]
    pub(super) fn new(here: &Magnitudes, hints: &Magnitudes, at: usize, parent: [i16; 4], siblings: [i16; 4]) -> Self {
        let (v, h, stride) = (&here.values, &hints.values, here.stride);
        let (west, north) = (v[at - 1], v[at - stride]);
        let (north_west, north_east) = (v[at - stride - 1], v[at - stride + 1]);
        let (ww, nn) = (v[at - 2], v[at - 2 * stride]);
        let far: [i16; 4] = std::array::from_fn(|k| ww[k] + nn[k]);
        let near: [i16; 4] = std::array::from_fn(|k| 2 * (west[k] + north[k]) + north_west[k] + north_east[k]);
        let wide = std::array::from_fn(|k| {
            3 * near[k] as i32 + 2 * far[k] as i32 + 3 * parent[k] as i32 + 2 * siblings[k] as i32
        });
        let (a, b, c, d) = (h[at - 1], h[at + 1], h[at - stride], h[at + stride]);
        let hints_near = std::array::from_fn(|k| a[k] as i32 + b[k] as i32 + c[k] as i32 + d[k] as i32);
        let hint = h[at];
        Around { west, north, north_west, north_east, far, parent, siblings, hint, hints_near, near, wide }
    }
}

/// All three colours of a lane together.
#[inline(always)]
fn sum(lanes: [i16; 4]) -> u32 {
    (lanes[0] as i32 + lanes[1] as i32 + lanes[2] as i32) as u32
}

/// Contexts of one decision of a mixer.
pub(super) struct Context {
    pub(super) slots: [u32; INPUTS],
    pub(super) selectors: [u32; SELECTORS],
}

/// Context of the decision whether any of the three colours is not zero.
#[inline(always)]
pub(super) fn any_context(place: &Place, around: &Around) -> Context {
    let near = sum(around.near);
    let hint_class = |steps: u32| if place.is_predicted { class_8(steps) } else { 8 };
    let others = |lanes: [i16; 4]| (lanes[1] as i32 + lanes[2] as i32) as u32;
    let wide = (around.wide[0] + around.wide[1] + around.wide[2]) as u32;
    let hint = sum(around.hint);
    let first_hint = around.hint[0] as u32;
    let hints_near = (around.hints_near[0] + around.hints_near[1] + around.hints_near[2]) as u32;
    let class = place.band_class as u32;
    let least = |lanes: [i16; 4]| sum(lanes).min(3);
    let tight =
        least(around.west) << 6 | least(around.north) << 4 | least(around.north_east) << 2 | least(around.north_west);
    let total = wide + 2 * hint;
    let few = |value: u32| class_8(value).min(6) / 2;
    Context {
        slots: [
            (class * 12 + class_12(near)) * 9 + hint_class(hint / 2),
            (class * 12 + class_12(around.near[0] as u32)) * 12 + class_12(others(around.near)),
            place.level as u32 * 24 + logarithmic(wide, 23),
            (class * 8 + class_8(2 * sum(around.parent))) * 8 + class_8(2 * sum(around.siblings) + sum(around.far)),
            (class * 9 + hint_class(first_hint / 2)) * 8 + class_8(hints_near / 4),
            tight * 4 + few(hint / 2),
            logarithmic(2 * total, 31) * 4 + class / 2,
            (hint_class(first_hint) * 9 + hint_class(others(around.hint))) * 8 + class_8(near / 2),
        ],
        selectors: [place.is_predicted as u32 * 8 + class, logarithmic(total, 15)],
    }
}

/// Everything that predicts one coefficient's magnitude once its place is known not to be empty. `before` are the values of
/// the colours before it.
pub(super) struct MagnitudeContext(Context);

/// How far the slots of the decision "larger than 1" lie from those of "larger than 0", and so on.
const STRIDES: [u32; INPUTS] = [12 * 9, 12 * 8, 24, 8 * 8, 9 * 8, 256 * 4, 32 * 4, 8 * 8 * 4];

impl MagnitudeContext {
    #[inline(always)]
    pub(super) fn new(place: &Place, around: &Around, colour: usize, before: &[i32; 3]) -> Self {
        let colours: u32 = before[..colour].iter().map(|v| v.unsigned_abs().min(255)).sum();
        let lane = |lanes: &[i16; 4]| lanes[colour] as u32;
        let other = |lanes: [i16; 4]| sum(lanes) - lanes[colour] as u32;
        let others_near = other(around.west) + other(around.north);
        let (near, hint) = (lane(&around.near), lane(&around.hint));
        let hint_class = if place.is_predicted { class_8(hint / 2) } else { 8 };
        let wide = around.wide[colour] as u32;
        let total = wide + 4 * colours + hint;
        let class = (place.band_class * 3 + colour) as u32;
        let c = colour as u32;
        let least = |lanes: &[i16; 4]| lane(lanes).min(3);
        let tight = least(&around.west) << 6
            | least(&around.north) << 4
            | least(&around.north_east) << 2
            | least(&around.north_west);
        let kinds = KINDS as u32;
        let few = |value: u32| class_8(value).min(6) / 2;
        let slots = [
            (class * kinds * 12 + class_12(near)) * 9 + hint_class,
            (class * kinds * 12 + class_12(near)) * 8 + class_8(2 * colours + others_near / 2),
            (c * 6 + place.level as u32) * kinds * 24 + logarithmic(wide, 23),
            (class * kinds * 8 + class_8(2 * lane(&around.parent))) * 8
                + class_8(lane(&around.siblings) * 2 + lane(&around.far)),
            (class * kinds * 9 + hint_class) * 8 + class_8(around.hints_near[colour] as u32 / 4),
            (c * kinds * 256 + tight) * 4 + few(hint / 2),
            (c * kinds * 32 + logarithmic(2 * total, 31)) * 4 + place.band_class as u32 / 2,
            ((c * kinds * 8 + class_8(colours * 2)) * 8 + class_8(others_near)) * 4 + few(near / 2),
        ];
        let set = place.is_predicted as u32;
        let selectors = [(set * CLASSES as u32 + class) * kinds, logarithmic(total, 15)];
        MagnitudeContext(Context { slots, selectors })
    }

    /// Contexts of the decision whether the magnitude is larger than `index`.
    #[inline(always)]
    pub(super) fn decision(&self, index: u32) -> Context {
        let kind = index.min(KINDS as u32 - 1);
        let Context { slots, selectors } = &self.0;
        Context {
            slots: std::array::from_fn(|k| slots[k] + kind * STRIDES[k]),
            selectors: [selectors[0] + kind, selectors[1] + kind * 16],
        }
    }
}

/// Context of the sign: the prediction's sign and size, and the signs of the colours before.
#[inline(always)]
pub(super) fn sign_context(place: &Place, colour: usize, before: &[i32; 3], prediction: f32, inverse: f32) -> usize {
    let size = gains::bucket(prediction.abs() * inverse * 2.0) + 1;
    let signed = if prediction > 0.0 {
        3 + size
    } else if prediction < 0.0 {
        3 - size
    } else {
        3
    };
    let other = |k: usize| match before[k] {
        _ if k >= colour => 0,
        0 => 0,
        v if v > 0 => 1,
        _ => 2,
    };
    (place.band_class * 7 + signed) * 9 + other(0) * 3 + other(1)
}
