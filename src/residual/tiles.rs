//! Tiles: bands of the finest levels cut by a grid, each tile with streams of its own.
//!
//! A tile of level `l` at `(X, Y)` stands below the tile of level `l + 1` at `(X / 2, Y / 2)`, whose models it starts from: tiles of one level
//! do not depend on each other. Normative text: `spec/planes.md`.

use super::contexts::BandArea;
use crate::transform::rectangle::Rectangle;
use crate::transform::shape_adaptive::{ColourLanes, Subband, level_count};

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

/// The tiles of a picture that are coded.
#[derive(Debug, Clone)]
pub(crate) struct TileSelection {
    grid: TileGrid,
    /// Levels of which there are none: the finest ones.
    finest_level: usize,
    /// Columns and rows of tiles, of the levels above these; none where all are.
    needed: Option<Vec<Rectangle>>,
}

impl TileSelection {
    /// All tiles but those of the first `finest_level` levels.
    pub(crate) fn above(grid: TileGrid, finest_level: usize) -> Self {
        TileSelection { grid, finest_level: finest_level.min(grid.levels), needed: None }
    }
    /// The tiles that a region takes of the low band after `reduction` levels: those that hold coefficients that it depends on, and those
    /// above these, whose models they start from.
    pub(crate) fn of_region(grid: TileGrid, region: &Rectangle, reduction: usize) -> Self {
        let finest_level = reduction.min(grid.levels);
        let mut wanted = region.clone();
        let mut needed: Vec<Rectangle> = Vec::new();
        for level in finest_level..grid.levels {
            wanted = wanted.coefficients(grid.size.map(|size| size.div_ceil(1 << level)));
            let mut tiles =
                wanted.map(|_, range| range.start >> grid.side_log2..range.end.div_ceil(1 << grid.side_log2));
            if let Some(below) = needed.last() {
                let below = [&below.columns, &below.rows];
                tiles = tiles.map(|axis, range| {
                    range.start.min(below[axis].start / 2)..range.end.max(below[axis].end.div_ceil(2))
                });
            }
            needed.push(tiles);
        }
        TileSelection { grid, finest_level, needed: Some(needed) }
    }
    /// Columns and rows of the tiles of a level above those that are left out.
    fn tiles(&self, level: usize) -> Rectangle {
        let needed = self.needed.as_ref().and_then(|needed| needed.get(level - self.finest_level - 1));
        needed.cloned().unwrap_or_else(|| Rectangle::whole(self.grid.level_tiles(level)))
    }
    /// Whether each tile is among them, in the order of the streams.
    pub(crate) fn includes(&self) -> impl Iterator<Item = bool> {
        (1..=self.grid.levels).rev().flat_map(move |level| {
            let [columns, rows] = self.grid.level_tiles(level);
            let tiles = (level > self.finest_level).then(|| self.tiles(level));
            (0..columns * rows).map(move |index| {
                let within = |tiles: &Rectangle| {
                    tiles.columns.contains(&(index % columns)) && tiles.rows.contains(&(index / columns))
                };
                tiles.as_ref().is_some_and(within)
            })
        })
    }
    /// Levels that are left out.
    pub(crate) fn finest_level(&self) -> usize {
        self.finest_level
    }
    /// Levels that are cut into tiles, with those that are left out.
    pub(crate) fn levels(&self) -> usize {
        self.grid.levels
    }
    /// Where a tile begins and ends in the bands of a window of a picture, whose first pixel is at `origin` and whose bands are of `size`.
    fn area(&self, [x, y]: [usize; 2], level: usize, origin: [usize; 2], size: [usize; 2]) -> Rectangle {
        let at = |index: usize, axis: usize| {
            (index << self.grid.side_log2).saturating_sub(origin[axis] >> level).min(size[axis])
        };
        Rectangle { columns: at(x, 0)..at(x + 1, 0), rows: at(y, 1)..at(y + 1, 1) }
    }
    /// The positions of a level's bands that its tiles hold; as [`TileSelection::area`].
    pub(crate) fn stored(&self, level: usize, origin: [usize; 2], size: [usize; 2]) -> Rectangle {
        let Rectangle { columns, rows } = self.tiles(level);
        let first = self.area([columns.start, rows.start], level, origin, size);
        let last = self.area([columns.end.saturating_sub(1), rows.end.saturating_sub(1)], level, origin, size);
        Rectangle { columns: first.columns.start..last.columns.end, rows: first.rows.start..last.rows.end }
    }
}

/// The tiles of a window of a picture.
#[derive(Debug, Clone, Default)]
pub struct Tiling {
    /// Levels that are cut into tiles, with those of which none are coded.
    pub(super) count: usize,
    /// The levels of which tiles are coded, from the coarsest on.
    pub(super) levels: Vec<TilingLevel>,
}

#[derive(Debug, Clone)]
pub(super) struct TilingLevel {
    /// Index of the level's first tile in the order of the streams, and number of its columns.
    first: usize,
    grid_columns: usize,
    /// Columns and rows of the tiles that are coded.
    pub(super) coded: Rectangle,
    /// Where the given masks of its bands begin in the window's bands.
    pub(super) corner: [usize; 2],
    pub(super) tiles: Vec<Tile>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    /// Its part of the given bands.
    pub(super) area: BandArea,
    /// Whether that holds no position of a mask.
    pub(super) is_empty: bool,
}

impl Tiling {
    /// The tiles of a window whose first pixel is `origin` in the picture, multiples of `2^MAX_LEVELS`, and whose bands after each level are of
    /// the size that `size` returns. `bands` are those of the levels above the selection's finest, from the coarsest on: all of each, or the
    /// [stored](TileSelection::stored) part of it.
    pub(crate) fn new(
        selection: &TileSelection,
        origin: [usize; 2],
        size: impl Fn(usize) -> [usize; 2],
        bands: &[Subband],
    ) -> Self {
        let grid = &selection.grid;
        let mut first = 0;
        let mut levels = Vec::new();
        for (level, bands) in (selection.finest_level + 1..=grid.levels).rev().zip(bands.chunks(ORIENTATIONS)) {
            let coded = selection.tiles(level);
            let stored = selection.stored(level, origin, size(level));
            let corner = if selection.needed.is_some() { stored.corner() } else { [0, 0] };
            let tile = |place: [usize; 2]| {
                let Rectangle { columns, rows } = selection.area(place, level, origin, size(level)).from(corner);
                let has_positions = bands
                    .iter()
                    .any(|band| rows.clone().any(|row| band.mask.row(row)[columns.clone()].contains(&true)));
                let area = BandArea { left: columns.start, top: rows.start, width: columns.len(), height: rows.len() };
                Tile { area, is_empty: !has_positions }
            };
            let places = coded.rows.clone().flat_map(|y| coded.columns.clone().map(move |x| [x, y]));
            let tiles = places.map(tile).collect();
            let [grid_columns, grid_rows] = grid.level_tiles(level);
            levels.push(TilingLevel { first, grid_columns, coded, corner, tiles });
            first += grid_columns * grid_rows;
        }
        Tiling { count: grid.levels, levels }
    }
}

impl TilingLevel {
    /// Columns of its coded tiles.
    pub(super) fn columns(&self) -> usize {
        self.coded.columns.len().max(1)
    }
    /// Index of a coded tile in the order of the streams.
    pub(super) fn stream(&self, index: usize) -> usize {
        let [x, y] = self.place(index);
        self.first + y * self.grid_columns + x
    }
    /// Column and row of a coded tile in the grid of its level.
    pub(super) fn place(&self, index: usize) -> [usize; 2] {
        [self.coded.columns.start + index % self.columns(), self.coded.rows.start + index / self.columns()]
    }
    /// Index of the coded tile above one of the next finer level.
    pub(super) fn above(&self, [x, y]: [usize; 2]) -> usize {
        (y / 2 - self.coded.rows.start) * self.columns() + x / 2 - self.coded.columns.start
    }
    /// Cuts the bands of the level, row by row, into what each tile writes.
    pub(super) fn cut<'o>(&self, bands: [&'o mut [ColourLanes]; ORIENTATIONS], width: usize) -> Vec<TileRows<'o>> {
        let mut parts: Vec<TileRows> = self.tiles.iter().map(|_| Default::default()).collect();
        for (orientation, band) in bands.into_iter().enumerate() {
            let (tiles, mut parts) = (self.tiles.chunks(self.columns()), parts.chunks_mut(self.columns()));
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
