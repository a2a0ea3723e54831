//! Wavelet levels as bits: significance by contexts, signs and magnitudes, through the adaptive binary range coder.
//!
//! One function serves both directions. Its order of bits and its contexts are part of the format (`spec/wavelet-texture.md`).

use crate::entropy::{BitCoder, BitModel, NumberModel};
use crate::quantise::dead_zone::MAX_INDEX;
use crate::transform::daubechies::VolumeShape;

/// Distinct view bands of a volume: one low and at most 7 levels.
const VIEW_BANDS: usize = 8;
/// Distinct levels of a patch: one low and at most 4.
const PATCH_LEVELS: usize = 5;

/// Adaptive models of one kind of volume, for each of its components.
pub(super) struct VolumeModels {
    components: Vec<ComponentModels>,
}

struct ComponentModels {
    /// Whether a band holds anything: by view band, patch level, parents' flags and the first component's flag.
    band: Vec<BitModel>,
    /// Significance by colour, neighbours and earlier colours.
    near: Vec<BitModel>,
    /// Significance by band, orientation, colour and parents.
    parents: Vec<BitModel>,
    /// Signs, by the signs of the earlier colours.
    sign: [BitModel; 9],
    /// Magnitudes, by what is around.
    magnitude: [NumberModel; 6],
}

impl VolumeModels {
    pub(super) fn new(components: usize) -> Self {
        let component = || ComponentModels {
            band: vec![BitModel::default(); VIEW_BANDS * PATCH_LEVELS * 8],
            near: vec![BitModel::default(); 3 * 8 * 9 * 3],
            parents: vec![BitModel::default(); VIEW_BANDS * PATCH_LEVELS * 3 * 3 * 9],
            sign: [BitModel::default(); 9],
            magnitude: Default::default(),
        };
        VolumeModels { components: (0..components).map(|_| component()).collect() }
    }
}

/// Codes the planes of one patch: three colour axes for each component, component slowest, each `shape.len()` levels.
/// In decoding the planes come in as zeros.
pub(super) fn code_volume<C: BitCoder>(
    coder: &mut C,
    models: &mut VolumeModels,
    planes: &mut [Vec<i32>],
    components: usize,
    shape: VolumeShape,
) {
    let mut flags = vec![false; components * VIEW_BANDS * PATCH_LEVELS];
    for component in 0..components {
        let Some(planes) = planes.get_mut(component * 3..component * 3 + 3) else { return };
        for view_band in 0..=shape.view_levels as usize {
            for level in 0..=shape.side_log2 as usize {
                let flag_at = |component: usize, view_band: usize, level: usize| {
                    (component * VIEW_BANDS + view_band) * PATCH_LEVELS + level
                };
                let band = VolumeBand::new(shape, view_band, level);
                let context = (level > 0 && flags[flag_at(component, view_band, level - 1)]) as usize
                    + 2 * (view_band > 0 && flags[flag_at(component, view_band - 1, level)]) as usize
                    + 4 * (component > 0 && flags[flag_at(0, view_band, level)]) as usize;
                let holds = !C::DECODES && band.positions().any(|at| planes.iter().any(|plane| plane[at.index] != 0));
                let models = &mut models.components[component];
                let model = &mut models.band[(view_band * PATCH_LEVELS + level) * 8 + context];
                let holds = model.code(coder, holds);
                flags[flag_at(component, view_band, level)] = holds;
                if holds {
                    for position in band.positions() {
                        code_position(coder, models, planes, &band, position);
                    }
                }
            }
        }
    }
}

/// The three colour axes of one position.
fn code_position<C: BitCoder>(
    coder: &mut C,
    models: &mut ComponentModels,
    planes: &mut [Vec<i32>],
    band: &VolumeBand,
    position: VolumePosition,
) {
    let at = position.index;
    for order in 0..3 {
        let plane = &planes[order];
        let size = |index: Option<usize>| index.map_or(0, |i| plane[i].unsigned_abs().min(2)) as usize;
        let near = 2 * size(position.left) + 2 * size(position.up) + size(position.before) + size(position.diagonal);
        let near = [0, 1, 2, 3, 4, 5, 5, 6, 6, 6, 7, 7, 7][near.min(12)];
        let earlier = |k: usize| if k < order { planes[k][at] } else { 0 };
        let (one, two) = (earlier(0), earlier(1));
        let colours = one.unsigned_abs().min(2) as usize * 3 + two.unsigned_abs().min(2) as usize;
        let parents = size(position.parent) * 3 + size(position.view_parent);

        let near_model = &mut models.near[((order * 8 + near) * 9 + colours) * 3 + position.orientation];
        let parent_model = &mut models.parents
            [(((band.view_band * PATCH_LEVELS + band.level) * 3 + position.orientation) * 3 + order) * 9 + parents];
        let probability = (near_model.probability() + parent_model.probability()) / 2;
        let significant = coder.bit(probability, plane[at] != 0);
        near_model.update(significant);
        parent_model.update(significant);
        if !significant {
            continue;
        }
        let side = |x: i32| if x == 0 { 0 } else { 1 + (x < 0) as usize };
        let negative = models.sign[side(one) * 3 + side(two)].code(coder, plane[at] < 0);
        let around = (near / 2 + (colours > 0) as usize + (parents > 0) as usize).min(5);
        let more = models.magnitude[around].code(coder, plane[at].unsigned_abs().wrapping_sub(1));
        let level = (more.min(MAX_INDEX as u32 - 1) + 1) as i32;
        planes[order][at] = if negative { -level } else { level };
    }
}

/// One view band at one patch level of a volume.
struct VolumeBand {
    shape: VolumeShape,
    view_band: usize,
    level: usize,
}

/// A coefficient and those that have been coded around it.
#[derive(Clone, Copy)]
struct VolumePosition {
    index: usize,
    /// 0 low or diagonal, 1 across, 2 down.
    orientation: usize,
    left: Option<usize>,
    up: Option<usize>,
    diagonal: Option<usize>,
    before: Option<usize>,
    parent: Option<usize>,
    view_parent: Option<usize>,
}

impl VolumeBand {
    fn new(shape: VolumeShape, view_band: usize, level: usize) -> Self {
        VolumeBand { shape, view_band, level }
    }
    /// The band's coefficients: slice by slice, row by row.
    fn positions(&self) -> impl Iterator<Item = VolumePosition> + use<> {
        let (shape, view_band, level) = (self.shape, self.view_band, self.level);
        let (side, area) = (shape.side(), shape.area());
        let low = shape.views >> shape.view_levels;
        let (first, last) = if view_band == 0 { (0, low) } else { (low << (view_band - 1), low << view_band) };
        let (inner, outer) = if level == 0 { (0, 1) } else { (1usize << (level - 1), 1usize << level) };
        (first..last).flat_map(move |slice| {
            (0..outer).flat_map(move |row| {
                let start = if row < inner { inner } else { 0 };
                (start..outer).map(move |column| {
                    let at = |slice: usize, row: usize, column: usize| slice * area + row * side + column;
                    // Neighbours of the same band and orientation only.
                    let across = column >= inner;
                    let down = row >= inner;
                    let left =
                        (column > if across { inner } else { 0 }).then(|| at(slice, row, column.wrapping_sub(1)));
                    let up = (row > if down { inner } else { 0 }).then(|| at(slice, row.wrapping_sub(1), column));
                    let view_parent = match view_band {
                        0 => None,
                        1 => Some(slice - first),
                        _ => Some(first / 2 + (slice - first) / 2),
                    };
                    VolumePosition {
                        index: at(slice, row, column),
                        orientation: if level == 0 || (across && down) { 0 } else { 1 + down as usize },
                        left,
                        up,
                        diagonal: left.and(up).map(|u| u - 1),
                        before: (slice > first).then(|| at(slice.wrapping_sub(1), row, column)),
                        parent: (level > 0).then(|| at(slice, row / 2, column / 2)),
                        view_parent: view_parent.map(|slice| at(slice, row, column)),
                    }
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::entropy::{RangeDecoder, RangeEncoder};
    use crate::wavelet_texture::stream::*;

    #[test]
    fn every_coefficient_has_one_band_and_known_neighbours() {
        for shape in [VolumeShape::padded(3, 36, 3), VolumeShape::padded(0, 1, 0), VolumeShape::padded(2, 7, 2)] {
            let mut coded = vec![false; shape.len()];
            for view_band in 0..=shape.view_levels as usize {
                for level in 0..=shape.side_log2 as usize {
                    for p in VolumeBand::new(shape, view_band, level).positions() {
                        for near in [p.left, p.up, p.diagonal, p.before, p.parent, p.view_parent].into_iter().flatten()
                        {
                            assert!(coded[near]);
                        }
                        assert!(!std::mem::replace(&mut coded[p.index], true));
                    }
                }
            }
            assert!(coded.iter().all(|c| *c));
        }
    }

    #[test]
    fn levels_come_back() {
        let shape = VolumeShape::padded(2, 6, 1);
        let plane = |seed: usize| -> Vec<i32> {
            (0..shape.len()).map(|i| if (i * 7 + seed) % 11 < 3 { (i as i32 % 9 - 4) * 1000 } else { 0 }).collect()
        };
        let planes: Vec<Vec<i32>> = (0..6).map(plane).collect();
        let mut encoder = RangeEncoder::new();
        code_volume(&mut encoder, &mut VolumeModels::new(2), &mut planes.clone(), 2, shape);
        let bytes = encoder.finish();
        let mut decoded = vec![vec![0; shape.len()]; 6];
        let mut decoder = RangeDecoder::new(&bytes);
        code_volume(&mut decoder, &mut VolumeModels::new(2), &mut decoded, 2, shape);
        assert_eq!(decoded, planes);
        assert!(decoder.ends_as_written(0));
    }
}
