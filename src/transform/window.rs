//! The bounding window of a mask.

use super::shape_adaptive::MAX_LEVELS;
use crate::image::Mask;

/// A rectangle of an image that holds its mask: pixels around it take neither time nor memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Window {
    /// First column; a multiple of `2^MAX_LEVELS`, so that parities stay at every level.
    pub left: usize,
    /// First row; likewise.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Window {
    /// Returns the smallest window that holds a mask and `margin` pixels around it, as far as the picture goes.
    pub(crate) fn around_mask(mask: &Mask, margin: usize) -> Self {
        let mut rows = (0..mask.height).filter(|&y| mask.row(y).contains(&true));
        let Some(first) = rows.next() else { return Window::default() };
        let last = rows.next_back().unwrap_or(first);
        let (mut left, mut right) = (mask.width, 0);
        for y in first..=last {
            let row = mask.row(y);
            // Only what lies beyond the rows before.
            left = row[..left].iter().position(|&set| set).unwrap_or(left);
            right = row[right..].iter().rposition(|&set| set).map_or(right, |at| right + at + 1);
        }
        let start = |at: usize| at.saturating_sub(margin) >> MAX_LEVELS << MAX_LEVELS;
        let (left, top) = (start(left), start(first));
        let (right, bottom) = ((right + margin).min(mask.width), (last + 1 + margin).min(mask.height));
        Window { left, top, width: right - left, height: bottom - top }
    }
    /// Its first pixel.
    pub(crate) fn corner(&self) -> [usize; 2] {
        [self.left, self.top]
    }
    /// Width and height.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }
    /// Number of its pixels.
    pub(crate) fn pixel_count(&self) -> u64 {
        self.width as u64 * self.height as u64
    }
    /// Returns the window of the low band after some levels.
    pub(crate) fn low_band(&self, levels: usize) -> Self {
        let size = |size: usize| size.div_ceil(1 << levels);
        let (width, height) = (size(self.width), size(self.height));
        Window { left: self.left >> levels, top: self.top >> levels, width, height }
    }
    /// Returns the part of an image of `width` columns that lies in the window.
    pub(crate) fn crop<T: Copy>(&self, picture: &[T], width: usize) -> Vec<T> {
        let mut part = Vec::with_capacity(self.width * self.height);
        for y in self.top..self.top + self.height {
            part.extend_from_slice(&picture[y * width + self.left..][..self.width]);
        }
        part
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_holds_the_mask_and_its_margin_at_the_same_parities() {
        let mut mask = Mask::filled(200, 150, false);
        *mask.value_at_mut(70, 40) = true;
        *mask.value_at_mut(121, 90) = true;
        let window = Window::around_mask(&mask, 8);
        assert_eq!(window, Window { left: 32, top: 32, width: 98, height: 67 });
        assert_eq!(window.low_band(2), Window { left: 8, top: 8, width: 25, height: 17 });
        let part = window.crop(&mask.data, 200);
        assert!(part[8 * 98 + 38] && part[58 * 98 + 89] && part.iter().filter(|&&set| set).count() == 2);
        assert_eq!(Window::around_mask(&Mask::filled(9, 9, false), 3), Window::default());
    }
}
