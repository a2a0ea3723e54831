//! Coefficients of tiles, those of a level side by side: each by models that start from those of the tile above it.

use super::band::{BandTask, code_band};
use super::contexts::{BandPart, CodedBand, CoefficientCoder, ContextModel, ParentBand};
use super::gains;
use super::task::{CoefficientState, PictureTask, StreamCoder};
use super::tiles::{ORIENTATIONS, Tile, TileRows};
use crate::parallel;
use crate::quantise::bands::RateDistortion;
use crate::transform::masked::Coefficients;
use crate::transform::shape_adaptive::{ColourLanes, Subband};
use std::sync::Arc;

/// What tiles start from: the base, or the tile above them.
struct StartingPoint<K: ContextModel> {
    models: Arc<CoefficientState<K>>,
    /// The bands one level coarser; none where there is no such level, or nothing in it.
    bands: Vec<CodedBand<K::Magnitudes>>,
    /// Where its part of these begins in the window's bands.
    corner: [usize; 2],
}

/// A tile to be coded, and what came of it.
struct TileJob<'o, K: ContextModel> {
    rows: TileRows<'o>,
    /// The stream in encoding, and what the tiles below start from, if there are any.
    coded: Option<(Vec<u8>, Option<StartingPoint<K>>)>,
}

/// Codes the tiles of `task.tiling`, from those of `streams` in decoding; returns the streams in encoding, `None` where one in decoding does not
/// end with the last coefficient. `base` are the models as the base has left them, and the coarser level's bands.
pub(super) fn code_tiles<'s, C: StreamCoder<'s>, K: CoefficientCoder<C>>(
    (models, bands): (&CoefficientState<K>, Vec<CodedBand<K::Magnitudes>>),
    task: &PictureTask,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    streams: &[&'s [u8]],
    coefficients: &mut Coefficients,
) -> Option<Vec<Vec<u8>>> {
    let levels = &task.tiling.levels;
    let mut written = Vec::new();
    if levels.is_empty() {
        return Some(written);
    }
    let base = StartingPoint { models: Arc::new(models.clone()), bands, corner: [0, 0] };
    let mut above = vec![base];
    for (index, level) in levels.iter().enumerate() {
        let range = ORIENTATIONS * index..ORIENTATIONS * (index + 1);
        let bands = &task.tiled_bands[range.clone()];
        let mask = &bands[0].mask;
        let first = task.base_bands() + range.start;
        let parts = level.cut(coefficients.three_bands_mut(first, mask.data.len()), mask.width);
        let mut jobs: Vec<TileJob<K>> = parts.into_iter().map(|rows| TileJob { rows, coded: None }).collect();
        let coarser = index.checked_sub(1).map(|coarser| &levels[coarser]);
        let is_finest = index + 1 == levels.len();
        parallel::for_each_chunk(&mut jobs, 1, |k, job| {
            let [job] = job else { return };
            let start = &above[coarser.map_or(0, |coarser| coarser.above(level.place(k)))];
            let stream = streams.get(level.stream(k)).copied().unwrap_or_default();
            let tile = (&level.tiles[k], level.corner);
            let target = target.map(|(target, choice)| (&target[first..first + ORIENTATIONS], choice));
            let coded = code_tile::<C, K>(start, tile, task, target, (bands, stream), &mut job.rows);
            job.coded = coded.map(|(written, below)| (written, (!is_finest).then_some(below)));
        });
        let coded: Option<Vec<_>> = jobs.into_iter().map(|job| job.coded).collect();
        let (streams, starts): (Vec<_>, Vec<_>) = coded?.into_iter().unzip();
        above = starts.into_iter().flatten().collect();
        written.extend(streams);
    }
    Some(written)
}

/// Codes one tile; `bands` and `target` are those of its level, which begin at `corner` in the window's bands.
fn code_tile<'s, C: StreamCoder<'s>, K: CoefficientCoder<C>>(
    start: &StartingPoint<K>,
    (tile, corner): (&Tile, [usize; 2]),
    task: &PictureTask,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    (bands, stream): (&[Subband], &'s [u8]),
    rows: &mut TileRows,
) -> Option<(Vec<u8>, StartingPoint<K>)> {
    let corner = [corner[0] + tile.area.left, corner[1] + tile.area.top];
    if tile.is_empty {
        let nothing = StartingPoint { models: start.models.clone(), bands: Vec::new(), corner };
        return stream.is_empty().then_some((Vec::new(), nothing));
    }
    let mut coder = C::open(stream);
    let mut models = CoefficientState::clone(&start.models);
    let above = [0, 1].map(|axis| corner[axis] / 2 - start.corner[axis]);
    let mut coded: Vec<CodedBand<K::Magnitudes>> = Vec::with_capacity(ORIENTATIONS);
    for (band, out) in bands.iter().zip(rows) {
        let step = task.quantiser.band_step(band);
        let band_task = BandTask {
            band,
            part: BandPart::new(&band.mask, tile.area),
            predicted: None,
            gains: &gains::NONE,
            target: target.map(|(target, choice)| (&target[coded.len()][..], choice)),
            step,
            inverse: 1.0 / step,
        };
        let parent = start.bands.get(coded.len()).map(|band| ParentBand::new(band, above));
        let here = code_band(&mut coder, &mut models.values, task.quantiser, &band_task, parent, &coded, out);
        coded.push(here);
    }
    Some((coder.close()?, StartingPoint { models: Arc::new(models), bands: coded, corner }))
}
