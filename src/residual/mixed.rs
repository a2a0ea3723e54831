//! Eight contexts of each decision, mixed.
//!
//! All numbers here are part of the format (`spec/planes.md`).

use super::contexts::{CLASSES, Contexts, KINDS, Known, Place, class_8, class_12, few, logarithmic};
use crate::entropy::mixer::{Context, INPUTS, Mixer, SELECTORS};
use crate::transform::shape_adaptive::Pixel;

/// Magnitudes of the three colours, at most 255 or, of the prediction in quarter steps, 8191; the fourth lane is unused.
type Lanes = [i16; 4];

/// Eight contexts of each decision, mixed.
#[derive(Debug, Clone)]
pub(super) enum Mixed {}

impl Contexts for Mixed {
    type Predictor = Mixer;
    type Lanes = Lanes;
    type Around = Around;
    type Magnitude = Context;

    fn predictors() -> [Mixer; 2] {
        let base = CLASSES * KINDS;
        [
            Mixer::new([8 * 12 * 9, 8 * 12 * 12, 6 * 24, 8 * 8 * 8, 8 * 9 * 8, 256 * 4, 32 * 4, 9 * 9 * 8], [16, 16]),
            Mixer::new(
                [
                    base * 12 * 9,
                    base * 12 * 8,
                    KINDS * 3 * 6 * 24,
                    base * 8 * 8,
                    base * 9 * 8,
                    KINDS * 3 * 256 * 4,
                    KINDS * 3 * 32 * 4,
                    KINDS * 3 * 8 * 8 * 4,
                ],
                [2 * base, KINDS * 16],
            ),
        ]
    }

    #[inline(always)]
    fn lanes(values: &[i32; 3]) -> Lanes {
        let value = |k: usize| values[k].unsigned_abs().min(255) as i16;
        [value(0), value(1), value(2), 0]
    }

    #[inline(always)]
    fn hint(predicted: &Pixel, inverse: f32) -> Lanes {
        std::array::from_fn(|k| (predicted[k].abs() * inverse).min(8191.0) as i16)
    }

    fn blocks() -> Option<Mixer> {
        None
    }

    fn block(_: Option<&Known<Lanes>>, _: &[Known<Lanes>], _: [bool; 2], _: usize, _: usize) -> Context {
        Context { slots: [0; INPUTS], selectors: [0; SELECTORS] }
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
        let parent = parent.map_or([0; 4], |parent| parent.values[parent.index(x / 2, y / 2)]);
        let mut sibling = [0i16; 4];
        for other in siblings {
            let other = &other.values[at];
            (0..4).for_each(|k| sibling[k] += other[k]);
        }
        Around::new(here, at, parent, sibling)
    }

    #[inline(always)]
    fn any(place: &Place, around: &Around) -> Context {
        any_context(place, around)
    }

    #[inline(always)]
    fn magnitude(place: &Place, around: &Around, colour: usize, before: &[i32; 3]) -> Context {
        magnitude_context(place, around, colour, before)
    }

    #[inline(always)]
    fn decision(magnitude: &Context, index: u32) -> Context {
        let kind = index.min(KINDS as u32 - 1);
        let Context { slots, selectors } = magnitude;
        Context {
            slots: std::array::from_fn(|k| slots[k] + kind * STRIDES[k]),
            selectors: [selectors[0] + kind, selectors[1] + kind * 16],
        }
    }
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
    fn new(here: &Known<Lanes>, at: usize, parent: [i16; 4], siblings: [i16; 4]) -> Self {
        let (v, stride) = (&here.values, here.stride);
        let (west, north) = (v[at - 1], v[at - stride]);
        let (north_west, north_east) = (v[at - stride - 1], v[at - stride + 1]);
        let (ww, nn) = (v[at - 2], v[at - 2 * stride]);
        let far: [i16; 4] = std::array::from_fn(|k| ww[k] + nn[k]);
        let near: [i16; 4] = std::array::from_fn(|k| 2 * (west[k] + north[k]) + north_west[k] + north_east[k]);
        let wide = std::array::from_fn(|k| {
            3 * near[k] as i32 + 2 * far[k] as i32 + 3 * parent[k] as i32 + 2 * siblings[k] as i32
        });
        let [a, b, c, d] = [at - 1, at + 1, at - stride, at + stride].map(|at| here.hint(at));
        let hints_near = std::array::from_fn(|k| a[k] as i32 + b[k] as i32 + c[k] as i32 + d[k] as i32);
        let hint = here.hint(at);
        Around { west, north, north_west, north_east, far, parent, siblings, hint, hints_near, near, wide }
    }
}

/// All three colours of a lane together.
#[inline(always)]
fn sum(lanes: [i16; 4]) -> u32 {
    (lanes[0] as i32 + lanes[1] as i32 + lanes[2] as i32) as u32
}

/// Context of the decision whether any of the three colours is not zero.
#[inline(always)]
fn any_context(place: &Place, around: &Around) -> Context {
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

/// How far the slots of the decision "larger than 1" lie from those of "larger than 0", and so on.
const STRIDES: [u32; INPUTS] = [12 * 9, 12 * 8, 24, 8 * 8, 9 * 8, 256 * 4, 32 * 4, 8 * 8 * 4];

/// What predicts one coefficient's magnitude once its place is known not to be empty, as the context of its first decision.
/// `before` are the values of the colours before it.
#[inline(always)]
fn magnitude_context(place: &Place, around: &Around, colour: usize, before: &[i32; 3]) -> Context {
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
    Context { slots, selectors }
}
