//! Tables in the format of the MERL database (Matusik, Pfister, Brand, McMillan 2003).
//!
//! A file has three 32-bit counts, 90, 90 and 180, then three planes (red, green, blue) of 90 x 90 x 180 doubles, all little-endian. The
//! slowest axis is `theta_h`, whose bins grow with its square; then `theta_d`; then `phi_d`. Values are stored divided by 1/1500,
//! 1.15/1500 and 1.66/1500. A negative value marks a cell that was not measured or lies below the horizon.

mod file;
mod grid;
mod look_up;

pub use grid::{MerlCell, MerlGrid};
pub use look_up::InterpolatedMerl;

use super::{Brdf, HalfDifference};

/// Bins of `theta_h`, 0 to 90 degrees; bin `i` begins at `(i / 90)^2 * 90` degrees.
pub const THETA_H_BINS: usize = 90;
/// Bins of `theta_d`, one degree each.
pub const THETA_D_BINS: usize = 90;
/// Bins of `phi_d`, one degree each, 0 to 180.
pub const PHI_D_BINS: usize = 180;
/// Cells of a table.
pub const MERL_CELLS: usize = THETA_H_BINS * THETA_D_BINS * PHI_D_BINS;
/// Factors of stored red, green, blue values that make them a BRDF per steradian.
pub(crate) const MERL_SCALES: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

/// A measured isotropic material: 90 x 90 x 180 cells of red, green and blue.
///
/// As a [`Brdf`] it returns what the database's own program does, the value of the cell that the directions fall into;
/// [`MerlTable::interpolated`] interpolates. 17.5 MB.
#[derive(Debug, Clone, PartialEq)]
pub struct MerlTable {
    /// Per steradian; NaN, all three, where a cell is not valid.
    cells: Vec<[f32; 3]>,
}

impl MerlTable {
    /// A table of any material, each cell evaluated at its middle. Cells whose directions lie below the horizon there are not valid.
    pub fn tabulate(material: &impl Brdf) -> Self {
        let grid = MerlGrid::new();
        let planes = crate::parallel::map(THETA_H_BINS, |plane| {
            let (mut indices, mut pairs, mut values) = (Vec::new(), Vec::new(), Vec::new());
            let mut cells = vec![[f32::NAN; 3]; THETA_D_BINS * PHI_D_BINS];
            for row in plane * THETA_D_BINS..(plane + 1) * THETA_D_BINS {
                let [theta_h, theta_d] = grid.row(row, &mut indices, &mut pairs);
                values.clear();
                material.evaluate_row(theta_h, theta_d, &pairs, &mut values);
                for (&index, &value) in indices.iter().zip(&values) {
                    cells[index - plane * THETA_D_BINS * PHI_D_BINS] = storable(value);
                }
            }
            cells
        });
        MerlTable { cells: planes.concat() }
    }

    /// A table from its cells (per steradian, in the file's order); `None` unless there are `MERL_CELLS` of them. A cell with a negative value
    /// or one that is not finite is not valid.
    pub fn from_cells(mut cells: Vec<[f32; 3]>) -> Option<Self> {
        if cells.len() != MERL_CELLS {
            return None;
        }
        cells.iter_mut().for_each(|cell| *cell = valid_or_nan(*cell));
        Some(MerlTable { cells })
    }

    /// The value of a cell, `None` where it is not valid. Cells are counted as in the file: `(theta_h * 90 + theta_d) * 180 + phi_d`.
    pub fn cell(&self, index: usize) -> Option<[f64; 3]> {
        self.cells.get(index).filter(|cell| !cell[0].is_nan()).map(|cell| cell.map(f64::from))
    }

    /// The value of the cell that angles fall into, `None` where it is not valid.
    pub fn value_at(&self, angles: HalfDifference) -> Option<[f64; 3]> {
        self.cell(look_up::cell_index(angles))
    }

    /// Every valid cell that lies above the horizon at its middle, in the file's order.
    pub fn valid_cells<'a>(&'a self, grid: &'a MerlGrid) -> impl Iterator<Item = MerlCell> + 'a {
        self.valid_cells_of_plane(grid, 0..THETA_H_BINS)
    }

    /// Returns the valid cells of some bins of `theta_h`, so that threads can share the work.
    pub fn valid_cells_of_plane<'a>(
        &'a self,
        grid: &'a MerlGrid,
        theta_h_bins: std::ops::Range<usize>,
    ) -> impl Iterator<Item = MerlCell> + 'a {
        const PLANE: usize = THETA_D_BINS * PHI_D_BINS;
        let range = theta_h_bins.start.min(THETA_H_BINS) * PLANE..theta_h_bins.end.min(THETA_H_BINS) * PLANE;
        range.filter_map(|index| self.cell(index).and_then(|value| grid.cell(index, value)))
    }

    /// Returns the number of valid cells.
    pub fn valid_count(&self) -> usize {
        self.cells.iter().filter(|cell| !cell[0].is_nan()).count()
    }

    /// The table with values between the middles of its cells interpolated.
    pub fn interpolated(&self) -> InterpolatedMerl<'_> {
        InterpolatedMerl { table: self }
    }
}

/// A value as a cell keeps it.
fn storable(value: [f64; 3]) -> [f32; 3] {
    valid_or_nan(value.map(|x| x as f32))
}

fn valid_or_nan([r, g, b]: [f32; 3]) -> [f32; 3] {
    // NaN fails every comparison.
    let valid = |x: f32| (0.0..=f32::MAX).contains(&x);
    if valid(r) & valid(g) & valid(b) { [r, g, b] } else { [f32::NAN; 3] }
}

impl Brdf for MerlTable {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        self.value_at(HalfDifference::from_directions(incoming, outgoing)).unwrap_or([0.0; 3])
    }
}

#[cfg(test)]
mod tests;
