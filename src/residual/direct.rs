//! Symbols of 16 values, each predicted from two contexts: one for the three colours of a position together, and others for magnitudes that
//! beyond its range.
//!
//! All numbers here are part of the format (`spec/planes.md`).

use super::contexts::{
    BLOCK, BandClass, BandPart, CLASSES, CodedBand, CodedBands, CoefficientCoder, ContextModel, bucket_4, bucket_8,
    bucket_12, code_escaped, log2_bucket,
};
use crate::entropy::average::AverageModel;
use crate::entropy::mixer::bit_cost;
use crate::entropy::symbol::{SYMBOL_VALUES, SymbolModel, SymbolStarts, interval};
use crate::entropy::{NumberModel, SymbolCoder};
use crate::quantise::bands::{MAX_MAGNITUDE, Quantiser, RateDistortion, candidate_magnitudes};
use crate::transform::shape_adaptive::ColourLanes;

/// Magnitudes of the three colours and their sum, each at most 255, in 16 bits each, the first lowest; of the prediction in half steps.
/// Sums of a few of them are sums in each lane.
type PackedMagnitudes = u64;

/// Neighbourhood of a position; zero beyond the margins of the bands.
#[derive(Default)]
pub(super) struct DirectNeighbourhood {
    parent: PackedMagnitudes,
    hint: PackedMagnitudes,
    /// `2 (west + north) + north_west + north_east`.
    near: PackedMagnitudes,
    /// `near` of the sums and what is farther off.
    wide: u32,
}

/// Symbols of 16 values.
#[derive(Debug, Clone)]
pub(super) struct DirectModel {
    /// The three magnitudes of a position, each up to [`MAX_IN_PATTERN`].
    pattern: SymbolModel,
    /// By how much a magnitude is larger.
    more: SymbolModel,
    /// Magnitudes beyond the symbols' range.
    escape: NumberModel,
    /// Whether a block has anything but zeros.
    block: AverageModel,
}

/// Lane of the sum.
const SUM: usize = 3;
/// Largest magnitude that a pattern distinguishes for each colour, and its weight in the pattern.
const MAX_IN_PATTERN: [u32; 3] = [3, 1, 1];
const WEIGHTS: [u32; 3] = [1, 4, 8];
/// The symbol of magnitudes beyond the symbols' range.
const ESCAPE: u32 = SYMBOL_VALUES as u32 - 1;

#[inline(always)]
fn with_sum([a, b, c]: [u32; 3]) -> PackedMagnitudes {
    (a | b << 16) as u64 | ((c | (a + b + c).min(255) << 16) as u64) << 32
}

#[inline(always)]
fn lane(lanes: PackedMagnitudes, k: usize) -> u32 {
    (lanes >> (16 * k)) as u32 & 0xffff
}

/// The pattern of magnitudes.
#[inline(always)]
fn pattern(magnitudes: [u32; 3]) -> u32 {
    (0..3).map(|k| magnitudes[k].min(MAX_IN_PATTERN[k]) * WEIGHTS[k]).sum()
}

/// Cost of a symbol, in bits.
fn symbol_cost(starts: &SymbolStarts, symbol: u32) -> f32 {
    let [_, size] = interval(starts, symbol as usize);
    bit_cost(size as u32, true)
}

impl DirectModel {
    /// Contexts of a position's pattern.
    #[inline(always)]
    fn pattern_contexts(place: &BandClass, around: &DirectNeighbourhood) -> [u32; 2] {
        let class = place.band_class as u32;
        let hint = lane(around.hint, SUM);
        let hint_class = if place.is_predicted { bucket_8(hint) } else { 8 };
        let total = around.wide + 4 * hint;
        [
            (class * 12 + bucket_12(lane(around.near, SUM))) * 9 + hint_class,
            (class * 32 + log2_bucket(2 * total, 31)) * 4 + bucket_4(lane(around.near, 1) + lane(around.near, 2)),
        ]
    }

    /// Contexts of the excess of a magnitude over its pattern's; `before` are the magnitudes of the colours before it.
    #[inline(always)]
    fn more_contexts(place: &BandClass, around: &DirectNeighbourhood, colour: usize, before: u32) -> [u32; 2] {
        let [near, hint, parent] = [around.near, around.hint, around.parent].map(|lanes| lane(lanes, colour));
        let class = (place.band_class * 3 + colour) as u32;
        let total = 3 * near + 3 * parent + 4 * before + 2 * hint;
        [
            (class * 12 + bucket_12(near)) * 8 + bucket_8(hint),
            (class * 8 + bucket_8(2 * before)) * 16 + log2_bucket(total + around.wide / 4, 15),
        ]
    }
}

impl ContextModel for DirectModel {
    type Magnitudes = PackedMagnitudes;
    type Neighbourhood = DirectNeighbourhood;

    fn new() -> Self {
        DirectModel {
            pattern: SymbolModel::new([8 * 12 * 9, 8 * 32 * 4]),
            more: SymbolModel::new([CLASSES * 12 * 8, CLASSES * 8 * 16]),
            escape: NumberModel::default(),
            block: AverageModel::new([3 * 4 * 12, 4 * 3 * 8 * 4]),
        }
    }

    #[inline(always)]
    fn magnitudes(values: &[i32; 3]) -> PackedMagnitudes {
        with_sum(values.map(|value| value.unsigned_abs().min(255)))
    }

    #[inline(always)]
    fn prediction_magnitude(predicted: &ColourLanes, inverse: f32) -> PackedMagnitudes {
        with_sum([0, 1, 2].map(|k| (predicted[k].abs() * (0.5 * inverse)).min(255.0) as u32))
    }

    #[inline(always)]
    fn neighbourhood(bands: &CodedBands<PackedMagnitudes>, x: usize, y: usize) -> DirectNeighbourhood {
        let CodedBands { here, parent, siblings } = bands;
        let at = here.index(x, y);
        let stride = here.stride;
        let rows: [&[u64]; 3] =
            [at - 2 * stride, at - stride - 1, at - 2].map(|at| here.values.get(at..).unwrap_or_default());
        let [north_north, ..] = rows[0] else { return DirectNeighbourhood::default() };
        let [north_west, north, north_east, ..] = rows[1] else { return DirectNeighbourhood::default() };
        let [west_west, west, ..] = rows[2] else { return DirectNeighbourhood::default() };
        let parent = parent.map_or(0, |parent| parent.above(x, y));
        let siblings: u64 = siblings.iter().map(|other| other.values[at]).sum();
        let near = 2 * (west + north) + north_west + north_east;
        let wide = lane(3 * near + 2 * (west_west + north_north) + 3 * parent + 2 * siblings, SUM);
        let hint = here.prediction_magnitude(at);
        DirectNeighbourhood { parent, hint, near, wide }
    }

    /// All values together: each colour's among the nearest and those nearer to zero.
    fn choose(
        &self,
        wanted: [f32; 3],
        quantiser: &Quantiser,
        choice: RateDistortion,
        place: &BandClass,
        around: &DirectNeighbourhood,
    ) -> [i32; 3] {
        let wanted_magnitudes = wanted.map(|w| w.abs().min(MAX_MAGNITUDE as f32 - 1.0));
        if wanted_magnitudes.iter().all(|&w| w < 0.5) {
            return [0; 3];
        }
        let patterns = self.pattern.starts(Self::pattern_contexts(place, around));
        let value_of = |colour: usize, magnitude: u32, before: u32| {
            let error = wanted_magnitudes[colour] - quantiser.dequantise(magnitude as i32, 1.0);
            let mut bits = (magnitude > 0) as u32 as f32;
            if magnitude >= MAX_IN_PATTERN[colour] {
                let more = self.more.starts(Self::more_contexts(place, around, colour, before));
                bits += symbol_cost(&more, (magnitude - MAX_IN_PATTERN[colour]).min(ESCAPE));
            }
            error * error + choice.lambda * bits
        };
        let mut best = (f32::INFINITY, [0; 3]);
        let mut consider = |magnitudes: [u32; 3], value: f32| {
            let value = value + choice.lambda * symbol_cost(&patterns, pattern(magnitudes));
            if value < best.0 {
                best = (value, magnitudes);
            }
        };
        // The all-zero pattern is always a candidate.
        consider([0; 3], wanted_magnitudes.iter().map(|w| w * w).sum());
        for first in candidate_magnitudes(wanted_magnitudes[0]) {
            let of_first = value_of(0, first, 0);
            for second in candidate_magnitudes(wanted_magnitudes[1]) {
                let of_second = of_first + value_of(1, second, first.min(255));
                for third in candidate_magnitudes(wanted_magnitudes[2]) {
                    let before = first.min(255) + second.min(255);
                    consider([first, second, third], of_second + value_of(2, third, before));
                }
            }
        }
        let sign = |k: usize| if wanted[k] < 0.0 { -1 } else { 1 };
        std::array::from_fn(|k| best.1[k] as i32 * sign(k))
    }
}

impl<C: SymbolCoder> CoefficientCoder<C> for DirectModel {
    #[inline(always)]
    fn code(
        &mut self,
        coder: &mut C,
        place: &BandClass,
        around: &DirectNeighbourhood,
        _prediction: &[f32; 3],
        _inverse: f32,
        wanted: [i32; 3],
    ) -> [i32; 3] {
        let goals = wanted.map(i32::unsigned_abs);
        let pattern = self.pattern.code(coder, Self::pattern_contexts(place, around), pattern(goals) as usize) as u32;
        if pattern == 0 {
            return [0; 3];
        }
        let mut magnitudes: [u32; 3] = std::array::from_fn(|k| (pattern / WEIGHTS[k]) & MAX_IN_PATTERN[k]);
        let mut before = 0;
        for colour in 0..3 {
            if magnitudes[colour] == MAX_IN_PATTERN[colour] {
                let contexts = Self::more_contexts(place, around, colour, before);
                let goal = goals[colour].wrapping_sub(MAX_IN_PATTERN[colour]);
                let mut more = self.more.code(coder, contexts, goal.min(ESCAPE) as usize) as u32;
                if more == ESCAPE {
                    more = code_escaped(coder, &mut self.escape, ESCAPE, goal);
                }
                magnitudes[colour] += more;
            }
            before += magnitudes[colour].min(255);
        }
        // A sign for each that is not zero, the last colour's lowest.
        let (mut count, mut signs) = (0, 0);
        for colour in 0..3 {
            let is_there = (goals[colour] > 0) as u32;
            signs = signs << is_there | (wanted[colour] < 0) as u32;
            count += (magnitudes[colour] > 0) as u32;
        }
        let mut signs = coder.equiprobable(count, signs);
        let mut values = [0; 3];
        for colour in (0..3).rev() {
            let is_there = (magnitudes[colour] > 0) as u32;
            let negative = (signs & is_there) as i32;
            signs >>= is_there;
            values[colour] = (magnitudes[colour] as i32 ^ -negative) + negative;
        }
        values
    }

    fn code_blocks(
        &mut self,
        coder: &mut C,
        bands: &CodedBands<PackedMagnitudes>,
        part: &BandPart,
        y: usize,
        occupied: &mut [bool],
        is_wanted: impl Fn(&[[usize; 2]]) -> bool,
    ) {
        if y == 0 {
            occupied.fill(false);
        }
        let mut before = false;
        let rows = y..(y + BLOCK).min(part.area.height);
        for (block, occupied) in occupied.iter_mut().enumerate() {
            let columns = block * BLOCK..((block + 1) * BLOCK).min(part.area.width);
            *occupied = rows.clone().any(|y| part.row(y)[columns.clone()].contains(&true)) && {
                let wanted = !C::DECODES && {
                    let places = rows.clone().flat_map(|y| columns.clone().map(move |x| [x, y]));
                    is_wanted(&places.filter(|&[x, y]| part.row(y)[x]).collect::<Vec<_>>())
                };
                self.block.code(coder, &block_contexts(bands, [before, *occupied], block, y / BLOCK), wanted)
            };
            before = *occupied;
        }
    }
}

/// Contexts of the decision whether a block ([`BLOCK`] positions square, counted by `x` and `y`) has anything but zeros. `beside` says it
/// of the block before it and the one above it.
fn block_contexts(bands: &CodedBands<PackedMagnitudes>, beside: [bool; 2], x: usize, y: usize) -> [u32; 2] {
    let total = |values: &[PackedMagnitudes]| -> u32 { values.iter().map(|&lanes| lane(lanes, SUM)).sum() };
    let parent = bands.parent.map_or(0, |parent| {
        const SIDE: usize = BLOCK / 2;
        (y * SIDE..(y + 1) * SIDE).map(|y| total(parent.coarse(x * SIDE, y, SIDE))).sum()
    });
    let of_sibling = |known: &CodedBand<PackedMagnitudes>| -> u32 {
        let rows = (y * BLOCK..(y + 1) * BLOCK).map(|y| known.index(x * BLOCK, y));
        rows.map(|at| total(known.values.get(at..at + BLOCK).unwrap_or_default())).sum()
    };
    let siblings: u32 = bands.siblings.iter().map(of_sibling).sum();
    let beside = beside[0] as u32 + 2 * beside[1] as u32;
    let orientation = bands.siblings.len() as u32;
    [
        (orientation * 4 + beside) * 12 + bucket_12(parent),
        ((beside * 3 + orientation) * 8 + bucket_8(siblings)) * 4 + bucket_4(parent),
    ]
}
