//! Rectangles of pictures and of bands.

use crate::image::Mask;
use std::ops::Range;

/// Pixels beside a pixel, each way, whose coefficients it depends on, and some to spare, so that a run that is cut is cut farther away.
const REACH: usize = 6;

/// A rectangle of a picture or of a band.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Rectangle {
    pub(crate) columns: Range<usize>,
    pub(crate) rows: Range<usize>,
}

impl Rectangle {
    /// All of a picture.
    pub(crate) fn whole([width, height]: [usize; 2]) -> Self {
        Rectangle { columns: 0..width, rows: 0..height }
    }
    /// Applies a function to both ranges, across and down.
    pub(crate) fn map(&self, f: impl Fn(usize, &Range<usize>) -> Range<usize>) -> Self {
        Rectangle { columns: f(0, &self.columns), rows: f(1, &self.rows) }
    }
    /// Width and height.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.columns.len(), self.rows.len()]
    }
    /// Whether it holds nothing.
    pub(crate) fn is_empty(&self) -> bool {
        self.columns.is_empty() || self.rows.is_empty()
    }
    /// Number of its pixels.
    pub(crate) fn area(&self) -> usize {
        self.columns.len() * self.rows.len()
    }
    /// The same place counted from another one.
    pub(crate) fn from(&self, [left, top]: [usize; 2]) -> Self {
        self.map(|axis, range| {
            let origin = [left, top][axis];
            range.start - origin..range.end - origin
        })
    }
    /// Its first column and row.
    pub(crate) fn corner(&self) -> [usize; 2] {
        [self.columns.start, self.rows.start]
    }
    /// What lies in both.
    pub(crate) fn intersection(&self, other: &Self) -> Self {
        let other = [&other.columns, &other.rows];
        self.map(|axis, range| {
            let start = range.start.max(other[axis].start);
            start..range.end.min(other[axis].end).max(start)
        })
    }
    /// The part of row-major `data` of `width` columns that it holds.
    pub(crate) fn crop<T: Copy>(&self, data: &[T], width: usize) -> Vec<T> {
        let mut part = Vec::with_capacity(self.area());
        for y in self.rows.clone() {
            part.extend_from_slice(&data[y * width..][self.columns.clone()]);
        }
        part
    }
    /// The part of a mask that it holds.
    pub(crate) fn crop_mask(&self, mask: &Mask) -> Mask {
        Mask { width: self.columns.len(), height: self.rows.len(), data: self.crop(&mask.data, mask.width) }
    }
    /// The positions of a level's bands that these pixels depend on; the picture is of `size`.
    pub(crate) fn coefficients(&self, size: [usize; 2]) -> Self {
        self.map(|axis, range| {
            range.start.saturating_sub(REACH) / 2..(range.end + REACH).div_ceil(2).min(size[axis].div_ceil(2))
        })
    }
}
