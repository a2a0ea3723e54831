//! Raw images of polarisation cameras, whose pixels have linear polarisers at four angles, and on colour cameras a filter, too.

use crate::image::{Grid, Mask, RgbImage};

/// Colour filters of a mosaic: each covers a cell of 2 x 2 polarisers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MosaicColours {
    /// None.
    Monochrome,
    /// Colours, 0 to 2, of the cells at the upper left, upper right, lower left and lower right; two of them green, one red, one blue.
    Bayer([u8; 4]),
}

/// Arrangement of a polarisation camera's pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolarisationMosaic {
    /// Angles of the polarisers at the upper left, upper right, lower left and lower right of a cell, in degrees; all different modulo 180.
    pub angles: [f64; 4],
    /// Colour filters.
    pub colours: MosaicColours,
}

impl PolarisationMosaic {
    /// Sony's sensors IMX250MZR, IMX253MZR and IMX264MZR.
    pub const SONY: Self = PolarisationMosaic { angles: [90.0, 45.0, 135.0, 0.0], colours: MosaicColours::Monochrome };

    /// Pixels after which the arrangement begins anew.
    pub(super) fn period(&self) -> usize {
        match self.colours {
            MosaicColours::Monochrome => 2,
            MosaicColours::Bayer(_) => 4,
        }
    }

    /// Upper left pixels of the lattices that show a colour through the polariser of this number.
    fn lattices(&self, polariser: usize, colour: u8) -> Vec<[usize; 2]> {
        let within = [polariser % 2, polariser / 2];
        match self.colours {
            MosaicColours::Monochrome => vec![within],
            MosaicColours::Bayer(cells) => {
                let shows = |cell: &usize| cells[*cell] == colour;
                let place = |cell: usize| [2 * (cell % 2) + within[0], 2 * (cell / 2) + within[1]];
                (0..4).filter(shows).map(place).collect()
            }
        }
    }

    /// Returns the image through the polariser of this number, interpolated (bilinear) at all pixels, or with `step` 2 at the middles of cells.
    /// The raw image has at least one period each way.
    pub(super) fn image(&self, polariser: usize, raw: &Grid<f32>, step: usize) -> RgbImage {
        let colours: &[u8] = if self.colours == MosaicColours::Monochrome { &[0] } else { &[0, 1, 2] };
        let lattices: Vec<_> = colours.iter().map(|&colour| self.lattices(polariser, colour)).collect();
        let (width, height) = (raw.width / step, raw.height / step);
        // Twice the position, in pixels of the raw image.
        let twice = |k: usize| 2 * step * k + step - 1;
        let at = |lattice: &[usize; 2], x: usize, y: usize| {
            let columns = taps(twice(x), lattice[0], self.period(), raw.width);
            let rows = taps(twice(y), lattice[1], self.period(), raw.height);
            let along = |row: usize| columns.iter().map(|&(x, weight)| weight * raw.value_at(x, row)).sum::<f32>();
            rows.iter().map(|&(y, weight)| weight * along(y)).sum::<f32>()
        };
        let pixel = |index: usize| {
            let (x, y) = (index % width, index / width);
            let colour = |c: usize| {
                let lattices = &lattices[c.min(lattices.len() - 1)];
                lattices.iter().map(|lattice| at(lattice, x, y)).sum::<f32>() / lattices.len() as f32
            };
            std::array::from_fn(colour)
        };
        RgbImage { width, height, data: (0..width * height).map(pixel).collect() }
    }

    /// Returns which pixels of the interpolated images have clipped ones within a cell of them.
    pub(super) fn clipped(&self, raw: &Mask, step: usize) -> Mask {
        let (width, height, reach) = (raw.width / step, raw.height / step, self.period() - 1);
        let mut clipped = Mask::filled(width, height, false);
        for (index, _) in raw.data.iter().enumerate().filter(|(_, set)| **set) {
            let (x, y) = (index % raw.width, index / raw.width);
            let reached =
                |k: usize, side: usize| (k.saturating_sub(reach) / step).min(side)..((k + reach) / step + 1).min(side);
            for row in reached(y, height) {
                clipped.data[row * width..][reached(x, width)].fill(true);
            }
        }
        clipped
    }
}

/// The two pixels of a lattice around half of `twice`, and their weights; beyond the outermost one it counts alone.
fn taps(twice: usize, first: usize, period: usize, side: usize) -> [(usize, f32); 2] {
    let last = first + (side - 1 - first) / period * period;
    if twice <= 2 * first {
        return [(first, 1.0), (first, 0.0)];
    }
    let before = first + (twice / 2 - first) / period * period;
    if before >= last {
        return [(last, 1.0), (last, 0.0)];
    }
    let weight = (twice - 2 * before) as f32 / (2 * period) as f32;
    [(before, 1.0 - weight), (before + period, weight)]
}
