//! Eight contexts of each decision, mixed.
//!
//! All numbers here are part of the format (`spec/planes.md`).

use super::contexts::{
    BandClass, CLASSES, CodedBand, CodedBands, CoefficientCoder, ContextModel, bucket_4, bucket_8, bucket_12,
    code_escaped, log2_bucket,
};
use super::gains;
use crate::entropy::mixer::{INPUTS, Mixer, MixerContext, bit_cost};
use crate::entropy::{BitCoder, BitModel, NumberModel};
use crate::quantise::bands::{MAX_MAGNITUDE, Quantiser, RateDistortion, candidate_magnitudes};
use crate::transform::shape_adaptive::ColourLanes;

/// Magnitudes of the three colours, at most 255 or, of the prediction in quarter steps, 8191; the fourth lane is unused.
type MagnitudeLanes = [i16; 4];

/// Eight contexts of each decision, mixed.
#[derive(Debug, Clone)]
pub(super) struct MixedModel {
    /// Whether any of the three colours is not zero.
    any: Mixer,
    /// Whether a magnitude is larger.
    magnitude: Mixer,
    sign: Vec<BitModel>,
    escape: NumberModel,
}

/// Magnitudes from here on are coded by [`Number`].
const ESCAPE: u32 = 14;
/// Decisions that have slots of their own: larger than 0, than 1, than 2 or more.
const KINDS: usize = 3;

impl ContextModel for MixedModel {
    type Magnitudes = MagnitudeLanes;
    type Neighbourhood = MixedNeighbourhood;

    fn new() -> Self {
        let base = CLASSES * KINDS;
        let any =
            Mixer::new([8 * 12 * 9, 8 * 12 * 12, 6 * 24, 8 * 8 * 8, 8 * 9 * 8, 256 * 4, 32 * 4, 9 * 9 * 8], [16, 16]);
        let magnitude = Mixer::new(
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
        );
        MixedModel { any, magnitude, sign: vec![BitModel::default(); 8 * 7 * 9], escape: NumberModel::default() }
    }

    #[inline(always)]
    fn magnitudes(values: &[i32; 3]) -> MagnitudeLanes {
        let value = |k: usize| values[k].unsigned_abs().min(255) as i16;
        [value(0), value(1), value(2), 0]
    }

    #[inline(always)]
    fn prediction_magnitude(predicted: &ColourLanes, inverse: f32) -> MagnitudeLanes {
        std::array::from_fn(|k| (predicted[k].abs() * inverse).min(8191.0) as i16)
    }

    #[inline(always)]
    fn neighbourhood(bands: &CodedBands<MagnitudeLanes>, x: usize, y: usize) -> MixedNeighbourhood {
        let CodedBands { here, parent, siblings } = bands;
        let at = here.index(x, y);
        let parent = parent.map_or([0; 4], |parent| parent.above(x, y));
        let mut sibling = [0i16; 4];
        for other in *siblings {
            let other = &other.values[at];
            (0..4).for_each(|k| sibling[k] += other[k]);
        }
        MixedNeighbourhood::new(here, at, parent, sibling)
    }

    /// Each colour's among the nearest and those nearer to zero, then these together or none.
    #[inline(always)]
    fn choose(
        &self,
        wanted: [f32; 3],
        quantiser: &Quantiser,
        choice: RateDistortion,
        place: &BandClass,
        around: &MixedNeighbourhood,
    ) -> [i32; 3] {
        if wanted.iter().all(|w| w.abs() < 0.5) {
            return [0; 3];
        }
        let probability = self.any.probability(&any_context(place, around));
        let mut values = [0i32; 3];
        let mut together = choice.lambda * bit_cost(probability, true);
        let mut none = choice.lambda * bit_cost(probability, false);
        for colour in 0..3 {
            let magnitude = wanted[colour].abs().min(MAX_MAGNITUDE as f32 - 1.0);
            none += magnitude * magnitude;
            let (lowest, nearest) = candidate_magnitudes(magnitude).into_inner();
            let context = magnitude_context(place, around, colour, &values);
            let implied = colour == 2 && values[0] == 0 && values[1] == 0;
            let mut bits = 0.0;
            let mut best = (f32::INFINITY, 0);
            for index in 0..=nearest.min(ESCAPE) {
                let probability = self.magnitude.probability(&decision(&context, index));
                let (stop, go) = if implied && index == 0 {
                    (0.0, 0.0)
                } else {
                    (bit_cost(probability, false), bit_cost(probability, true))
                };
                if index >= lowest || index == ESCAPE {
                    let candidate = if index == ESCAPE { nearest } else { index };
                    let rate = bits + if candidate < ESCAPE { stop } else { 0.0 } + (candidate > 0) as u32 as f32;
                    let error = magnitude - quantiser.dequantise(candidate as i32, 1.0);
                    let value = error * error + choice.lambda * rate;
                    if value < best.0 {
                        best = (value, candidate);
                    }
                }
                bits += go;
            }
            together += best.0;
            values[colour] = if wanted[colour] < 0.0 { -(best.1 as i32) } else { best.1 as i32 };
        }
        if none <= together { [0; 3] } else { values }
    }
}

impl<C: BitCoder> CoefficientCoder<C> for MixedModel {
    #[inline(always)]
    fn code(
        &mut self,
        coder: &mut C,
        place: &BandClass,
        around: &MixedNeighbourhood,
        prediction: &[f32; 3],
        inverse: f32,
        wanted: [i32; 3],
    ) -> [i32; 3] {
        if !self.any.code(coder, &any_context(place, around), wanted != [0; 3]) {
            return [0; 3];
        }
        let mut values = [0i32; 3];
        for colour in 0..3 {
            let context = magnitude_context(place, around, colour, &values);
            // Some colour is not zero: if the first two are, the last one is not.
            let mut magnitude = (colour == 2 && values[0] == 0 && values[1] == 0) as u32;
            let goal = wanted[colour].unsigned_abs();
            while magnitude < ESCAPE {
                if !self.magnitude.code(coder, &decision(&context, magnitude), magnitude < goal) {
                    break;
                }
                magnitude += 1;
            }
            if magnitude == ESCAPE {
                magnitude = code_escaped(coder, &mut self.escape, ESCAPE, goal);
            }
            if magnitude > 0 {
                let sign = sign_context(place, colour, &values, prediction[colour], inverse);
                let negative = self.sign[sign].code(coder, wanted[colour] < 0);
                values[colour] = if negative { -(magnitude as i32) } else { magnitude as i32 };
            }
        }
        values
    }
}

/// Context of the decision whether a magnitude is larger than `index`, from that of the first one.
#[inline(always)]
fn decision(first: &MixerContext, index: u32) -> MixerContext {
    let kind = index.min(KINDS as u32 - 1);
    let MixerContext { slots, selectors } = first;
    MixerContext {
        slots: std::array::from_fn(|k| slots[k] + kind * STRIDES[k]),
        selectors: [selectors[0] + kind, selectors[1] + kind * 16],
    }
}

/// Neighbourhood of a position, for three colours each (the fourth lane is unused).
pub(super) struct MixedNeighbourhood {
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

impl MixedNeighbourhood {
    #[inline(always)]
    fn new(here: &CodedBand<MagnitudeLanes>, at: usize, parent: [i16; 4], siblings: [i16; 4]) -> Self {
        let (v, stride) = (&here.values, here.stride);
        let (west, north) = (v[at - 1], v[at - stride]);
        let (north_west, north_east) = (v[at - stride - 1], v[at - stride + 1]);
        let (ww, nn) = (v[at - 2], v[at - 2 * stride]);
        let far: [i16; 4] = std::array::from_fn(|k| ww[k] + nn[k]);
        let near: [i16; 4] = std::array::from_fn(|k| 2 * (west[k] + north[k]) + north_west[k] + north_east[k]);
        let wide = std::array::from_fn(|k| {
            3 * near[k] as i32 + 2 * far[k] as i32 + 3 * parent[k] as i32 + 2 * siblings[k] as i32
        });
        let [a, b, c, d] = [at - 1, at + 1, at - stride, at + stride].map(|at| here.prediction_magnitude(at));
        let hints_near = std::array::from_fn(|k| a[k] as i32 + b[k] as i32 + c[k] as i32 + d[k] as i32);
        let hint = here.prediction_magnitude(at);
        MixedNeighbourhood { west, north, north_west, north_east, far, parent, siblings, hint, hints_near, near, wide }
    }
}

/// All three colours of a lane together.
#[inline(always)]
fn sum(lanes: [i16; 4]) -> u32 {
    (lanes[0] as i32 + lanes[1] as i32 + lanes[2] as i32) as u32
}

/// Context of the decision whether any of the three colours is not zero.
#[inline(always)]
fn any_context(place: &BandClass, around: &MixedNeighbourhood) -> MixerContext {
    let near = sum(around.near);
    let hint_class = |steps: u32| if place.is_predicted { bucket_8(steps) } else { 8 };
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
    MixerContext {
        slots: [
            (class * 12 + bucket_12(near)) * 9 + hint_class(hint / 2),
            (class * 12 + bucket_12(around.near[0] as u32)) * 12 + bucket_12(others(around.near)),
            place.level as u32 * 24 + log2_bucket(wide, 23),
            (class * 8 + bucket_8(2 * sum(around.parent))) * 8 + bucket_8(2 * sum(around.siblings) + sum(around.far)),
            (class * 9 + hint_class(first_hint / 2)) * 8 + bucket_8(hints_near / 4),
            tight * 4 + bucket_4(hint / 2),
            log2_bucket(2 * total, 31) * 4 + class / 2,
            (hint_class(first_hint) * 9 + hint_class(others(around.hint))) * 8 + bucket_8(near / 2),
        ],
        selectors: [place.is_predicted as u32 * 8 + class, log2_bucket(total, 15)],
    }
}

/// Distance of the slots of the decision "larger than 1" from those of "larger than 0", and so on.
const STRIDES: [u32; INPUTS] = [12 * 9, 12 * 8, 24, 8 * 8, 9 * 8, 256 * 4, 32 * 4, 8 * 8 * 4];

/// Context of the first decision on one coefficient's magnitude at a position that is known not to be empty.
/// `before` are the values of the colours before it.
#[inline(always)]
fn magnitude_context(place: &BandClass, around: &MixedNeighbourhood, colour: usize, before: &[i32; 3]) -> MixerContext {
    let colours: u32 = before[..colour].iter().map(|v| v.unsigned_abs().min(255)).sum();
    let lane = |lanes: &[i16; 4]| lanes[colour] as u32;
    let other = |lanes: [i16; 4]| sum(lanes) - lanes[colour] as u32;
    let others_near = other(around.west) + other(around.north);
    let (near, hint) = (lane(&around.near), lane(&around.hint));
    let hint_class = if place.is_predicted { bucket_8(hint / 2) } else { 8 };
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
        (class * kinds * 12 + bucket_12(near)) * 9 + hint_class,
        (class * kinds * 12 + bucket_12(near)) * 8 + bucket_8(2 * colours + others_near / 2),
        (c * 6 + place.level as u32) * kinds * 24 + log2_bucket(wide, 23),
        (class * kinds * 8 + bucket_8(2 * lane(&around.parent))) * 8
            + bucket_8(lane(&around.siblings) * 2 + lane(&around.far)),
        (class * kinds * 9 + hint_class) * 8 + bucket_8(around.hints_near[colour] as u32 / 4),
        (c * kinds * 256 + tight) * 4 + bucket_4(hint / 2),
        (c * kinds * 32 + log2_bucket(2 * total, 31)) * 4 + place.band_class as u32 / 2,
        ((c * kinds * 8 + bucket_8(colours * 2)) * 8 + bucket_8(others_near)) * 4 + bucket_4(near / 2),
    ];
    let set = place.is_predicted as u32;
    let selectors = [(set * CLASSES as u32 + class) * kinds, log2_bucket(total, 15)];
    MixerContext { slots, selectors }
}

/// Context of the sign: the prediction's sign and size, and the signs of the colours before.
#[inline(always)]
fn sign_context(place: &BandClass, colour: usize, before: &[i32; 3], prediction: f32, inverse: f32) -> usize {
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
