//! Images in memory: linear RGB, integer planes and masks. Row-major, origin at the top left, pixel centres at +0.5.

#[cfg(feature = "encode")]
pub(crate) mod bracket;
mod fill;
mod orientation;
#[cfg(feature = "encode")]
pub(crate) mod read;

pub use orientation::ImageOrientation;
#[cfg(feature = "encode")]
pub use read::{ColorSpace, read_linear_image, read_radiance};
#[cfg(feature = "encode")]
pub(crate) use read::{parse_linear_image, parse_size};

/// A grid of `width * height` values in rows.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Grid<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values, row by row.
    pub data: Vec<T>,
}

impl<T: Clone> Grid<T> {
    /// A grid filled with one value.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Grid { width, height, data: vec![value; width * height] }
    }
    /// The value at column `x`, row `y`.
    pub fn value_at(&self, x: usize, y: usize) -> &T {
        &self.data[y * self.width + x]
    }
    /// The value at column `x`, row `y`, to write.
    pub fn value_at_mut(&mut self, x: usize, y: usize) -> &mut T {
        &mut self.data[y * self.width + x]
    }
    /// One row.
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..(y + 1) * self.width]
    }
    /// Returns the part in a region, which lies within the grid.
    pub fn cropped(&self, region: &Region) -> Grid<T> {
        let rows = region.rows().flat_map(|y| &self.row(y)[region.columns()]);
        Grid { width: region.width as usize, height: region.height as usize, data: rows.cloned().collect() }
    }
    /// Returns width and height.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }
    /// Returns the grid of the mapped values.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Grid<U> {
        Grid { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }
}

/// A rectangle of an image, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Region {
    /// Whether it holds a pixel, and none that an image of this size does not have.
    pub fn is_within(&self, width: u32, height: u32) -> bool {
        let fits =
            |start: u32, length: u32, size: u32| length > 0 && start.checked_add(length).is_some_and(|end| end <= size);
        fits(self.left, self.width, width) && fits(self.top, self.height, height)
    }
    /// Its columns.
    pub fn columns(&self) -> std::ops::Range<usize> {
        self.left as usize..self.left as usize + self.width as usize
    }
    /// Its rows.
    pub fn rows(&self) -> std::ops::Range<usize> {
        self.top as usize..self.top as usize + self.height as usize
    }
}

/// Linear radiance, red, green, blue (Rec. 709 unless the capture states other primaries); may be negative, NaN marks a missing pixel.
pub type RgbImage = Grid<[f32; 3]>;

/// Pixels that show the object.
pub type Mask = Grid<bool>;

impl Mask {
    /// Number of pixels set.
    pub fn count(&self) -> usize {
        self.data.iter().filter(|&&m| m).count()
    }
}

/// A mask as the lengths of its runs of equal pixels, row after row; the first run is of pixels that are not set.
#[cfg(feature = "encode")]
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MaskRuns {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) lengths: Vec<u32>,
}

#[cfg(feature = "encode")]
impl MaskRuns {
    /// Returns the runs of a mask.
    pub(crate) fn new(mask: &Mask) -> Self {
        let first = if mask.data.first() == Some(&true) { Some(0) } else { None };
        let runs = mask.data.chunk_by(|a, b| a == b).map(|run| run.len() as u32);
        MaskRuns { width: mask.width, height: mask.height, lengths: first.into_iter().chain(runs).collect() }
    }

    /// Returns the mask.
    pub(crate) fn mask(&self) -> Mask {
        let pixels = self.width * self.height;
        let mut data = Vec::with_capacity(pixels);
        for (run, &length) in self.lengths.iter().enumerate() {
            data.resize((data.len() + length as usize).min(pixels), run % 2 == 1);
        }
        data.resize(pixels, false);
        Mask { width: self.width, height: self.height, data }
    }
}

/// Weights of four samples in a row for a position `t` of the way from the second to the third (Catmull and Rom 1974).
pub(crate) fn catmull_rom(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, 0.5 * t3 - 0.5 * t2]
}

/// Linear 0 to 1 as an sRGB signal, 0 to 1 (IEC 61966-2-1).
pub fn to_srgb(linear: f64) -> f64 {
    if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// An sRGB signal, 0 to 1, as linear 0 to 1.
pub fn from_srgb(signal: f64) -> f64 {
    if signal <= 0.04045 { signal / 12.92 } else { ((signal + 0.055) / 1.055).powf(2.4) }
}
