//! Tiles: bands of the finest levels cut by a grid, each tile with streams of its own.
//!
//! A tile of level `l` at `(X, Y)` stands below the tile of level `l + 1` at `(X / 2, Y / 2)`, whose models it starts from: tiles of one level
//! do not depend on each other. Normative text: `spec/planes.md`.

use super::contexts::BandArea;
use crate::transform::shape_adaptive::{ColourLanes, WaveletPlan, level_count};

/// Binary logarithms of the sides that a tile may have, in positions of its bands. Part of the format.
pub(crate) const TILE_SIDES_LOG2: std::ops::RangeInclusive<u8> = 4..=12;
/// Bands of a level.
pub(super) const ORIENTATIONS: usize = 3;

/// The tiles of a picture of a certain size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileGrid {
    size: [usize; 2],
    levels: usize,
    side_log2: u8,
}

impl TileGrid {
    /// The grid of a picture of `size` pixels, of which the bands of the first `prediction_level` levels are cut into tiles.
    pub fn new(size: [usize; 2], prediction_level: u8, side_log2: u8) -> Self {
        let levels = level_count(size[0], size[1]).min(prediction_level as usize);
        TileGrid { size, levels, side_log2 }
    }
    /// Levels that are cut into tiles: the finest ones.
    pub fn levels(&self) -> usize {
        self.levels
    }
    /// Columns and rows of the tiles of a level.
    pub fn level_tiles(&self, level: usize) -> [usize; 2] {
        self.size.map(|size| size.div_ceil(1 << level).div_ceil(1 << self.side_log2))
    }
    /// The level of each tile, in the order of their streams: from the coarsest, in each row by row.
    pub fn tile_levels(&self) -> impl Iterator<Item = usize> {
        let grid = *self;
        (1..=self.levels).rev().flat_map(move |level| {
            let [columns, rows] = grid.level_tiles(level);
            std::iter::repeat_n(level, columns * rows)
        })
    }
    /// Number of tiles.
    pub fn tile_count(&self) -> u64 {
        (1..=self.levels).map(|level| self.level_tiles(level)).map(|[columns, rows]| (columns * rows) as u64).sum()
    }
}

/// The tiles of a picture's plan, which may be that of a window of the picture.
#[derive(Debug, Clone, Default)]
pub struct Tiling {
    /// From level 1 on.
    pub(super) levels: Vec<TilingLevel>,
}

#[derive(Debug, Clone)]
pub(super) struct TilingLevel {
    /// Index of the first tile in the order of the streams.
    pub(super) first: usize,
    pub(super) columns: usize,
    pub(super) tiles: Vec<Tile>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    /// Its part of the bands of the plan.
    pub(super) area: BandArea,
    /// Whether that holds no position of a mask.
    pub(super) is_empty: bool,
}

impl Tiling {
    /// The tiles of a plan whose first pixel is `[left, top]` in the picture of `grid`, multiples of `2^MAX_LEVELS`.
    pub fn new(grid: &TileGrid, [left, top]: [usize; 2], plan: &WaveletPlan) -> Self {
        let side = 1 << grid.side_log2;
        let mut first = grid.tile_count() as usize;
        let levels = (1..=grid.levels).map(|level| {
            let [columns, rows] = grid.level_tiles(level);
            first -= columns * rows;
            let bands = &plan.bands()[plan.level_bands(level)];
            let (width, height) = (bands[0].mask.width, bands[0].mask.height);
            // Where a tile begins and ends in the plan's bands.
            let within = |index: usize, origin: usize, size: usize| {
                let at = |index: usize| (index * side).saturating_sub(origin >> level).min(size);
                at(index)..at(index + 1)
            };
            let tile = |index: usize| {
                let (x, y) = (within(index % columns, left, width), within(index / columns, top, height));
                let area = BandArea { left: x.start, top: y.start, width: x.len(), height: y.len() };
                let has_positions =
                    bands.iter().any(|band| y.clone().any(|row| band.mask.row(row)[x.clone()].contains(&true)));
                Tile { area, is_empty: !has_positions }
            };
            TilingLevel { first, columns, tiles: (0..columns * rows).map(tile).collect() }
        });
        Tiling { levels: levels.collect() }
    }
    /// Levels that are cut into tiles: the finest ones.
    pub(super) fn levels(&self) -> usize {
        self.levels.len()
    }
}

impl TilingLevel {
    /// Cuts the bands of the level, row by row, into what each tile writes.
    pub(super) fn cut<'o>(&self, bands: [&'o mut [ColourLanes]; ORIENTATIONS], width: usize) -> Vec<TileRows<'o>> {
        let mut parts: Vec<TileRows> = self.tiles.iter().map(|_| Default::default()).collect();
        for (orientation, band) in bands.into_iter().enumerate() {
            let (tiles, mut parts) = (self.tiles.chunks(self.columns), parts.chunks_mut(self.columns));
            let mut rows = band.chunks_mut(width.max(1));
            for tiles in tiles {
                let Some(parts) = parts.next() else { break };
                for mut row in rows.by_ref().take(tiles[0].area.height) {
                    for (tile, part) in tiles.iter().zip(parts.iter_mut()) {
                        let (piece, rest) = std::mem::take(&mut row).split_at_mut(tile.area.width);
                        part[orientation].push(piece);
                        row = rest;
                    }
                }
            }
        }
        parts
    }
}

/// Rows of a tile in each of its bands.
pub(super) type TileRows<'o> = [Vec<&'o mut [ColourLanes]>; ORIENTATIONS];
