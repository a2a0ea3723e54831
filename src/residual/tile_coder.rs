//! Coefficients of tiles, those of a level side by side: each by models that start from those of the tile above it.

use super::band::{BandTask, code_band};
use super::contexts::{BandArea, BandPart, CodedBand, CoefficientCoder, ContextModel, ParentBand};
use super::gains;
use super::task::{CoefficientState, PictureTask, StreamCoder};
use super::tiles::{ORIENTATIONS, Tile, TileRows};
use crate::parallel;
use crate::quantise::bands::RateDistortion;
use crate::transform::masked::Coefficients;
use crate::transform::shape_adaptive::ColourLanes;
use std::ops::Range;
use std::sync::Arc;

/// What tiles start from: the base, or the tile above them.
struct StartingPoint<K: ContextModel> {
    models: Arc<CoefficientState<K>>,
    /// The bands one level coarser; none where there is no such level, or nothing in it.
    bands: Vec<CodedBand<K::Magnitudes>>,
    area: BandArea,
}

/// A tile to be coded, and what came of it.
struct TileJob<'o, K: ContextModel> {
    rows: TileRows<'o>,
    /// The stream in encoding, and what the tiles below start from, if there are any.
    coded: Option<(Vec<u8>, Option<StartingPoint<K>>)>,
}

/// Codes the tiles of the levels above `task.finest_level`, those of `streams` in decoding; returns the streams in encoding, `None` where
/// one in decoding does not end with the last coefficient. `base` are the models as the base has left them, and the coarser level's bands.
pub(super) fn code_tiles<'s, C: StreamCoder<'s>, K: CoefficientCoder<C>>(
    (models, bands): (&CoefficientState<K>, Vec<CodedBand<K::Magnitudes>>),
    task: &PictureTask,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    streams: &[&'s [u8]],
    coefficients: &mut Coefficients,
) -> Option<Vec<Vec<u8>>> {
    let tiling = task.tiling;
    let mut written = Vec::new();
    if tiling.levels() <= task.finest_level {
        return Some(written);
    }
    let base = StartingPoint { models: Arc::new(models.clone()), bands, area: BandArea::default() };
    let (mut above, mut above_columns) = (vec![base], 1);
    for (index, level) in tiling.levels.iter().enumerate().skip(task.finest_level).rev() {
        let range = task.plan.level_bands(index + 1);
        let is_top = index + 1 == tiling.levels();
        let mask = &task.plan.bands()[range.start].mask;
        let parts = level.cut(coefficients.three_bands_mut(range.start, mask.data.len()), mask.width);
        let mut jobs: Vec<TileJob<K>> = parts.into_iter().map(|rows| TileJob { rows, coded: None }).collect();
        parallel::for_each_chunk(&mut jobs, 1, |k, job| {
            let [job] = job else { return };
            let (x, y) = (k % level.columns, k / level.columns);
            let start = if is_top { &above[0] } else { &above[y / 2 * above_columns + x / 2] };
            let stream = streams.get(level.first + k).copied().unwrap_or_default();
            let coded = code_tile::<C, K>(start, &level.tiles[k], task, target, (range.clone(), stream), &mut job.rows);
            job.coded = coded.map(|(written, below)| (written, (index > task.finest_level).then_some(below)));
        });
        let coded: Option<Vec<_>> = jobs.into_iter().map(|job| job.coded).collect();
        let (streams, starts): (Vec<_>, Vec<_>) = coded?.into_iter().unzip();
        (above, above_columns) = (starts.into_iter().flatten().collect(), level.columns);
        written.extend(streams);
    }
    Some(written)
}

/// Codes one tile; `range` are the bands of its level.
fn code_tile<'s, C: StreamCoder<'s>, K: CoefficientCoder<C>>(
    start: &StartingPoint<K>,
    tile: &Tile,
    task: &PictureTask,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    (range, stream): (Range<usize>, &'s [u8]),
    rows: &mut TileRows,
) -> Option<(Vec<u8>, StartingPoint<K>)> {
    if tile.is_empty {
        let nothing = StartingPoint { models: start.models.clone(), bands: Vec::new(), area: tile.area };
        return stream.is_empty().then_some((Vec::new(), nothing));
    }
    let mut coder = C::open(stream);
    let mut models = CoefficientState::clone(&start.models);
    let above = [tile.area.left / 2 - start.area.left, tile.area.top / 2 - start.area.top];
    let mut bands: Vec<CodedBand<K::Magnitudes>> = Vec::with_capacity(ORIENTATIONS);
    for (index, out) in range.zip(rows) {
        let band = &task.plan.bands()[index];
        let step = task.quantiser.band_step(band);
        let band_task = BandTask {
            band,
            part: BandPart::new(&band.mask, tile.area),
            predicted: None,
            gains: &gains::NONE,
            target: target.map(|(target, choice)| (&target[index][..], choice)),
            step,
            inverse: 1.0 / step,
        };
        let parent = start.bands.get(bands.len()).map(|band| ParentBand::new(band, above));
        let here = code_band(&mut coder, &mut models.values, task.quantiser, &band_task, parent, &bands, out);
        bands.push(here);
    }
    Some((coder.close()?, StartingPoint { models: Arc::new(models), bands, area: tile.area }))
}
