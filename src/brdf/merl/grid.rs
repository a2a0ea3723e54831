//! The angles of a table's cells.

use super::{CELLS, HalfDifference, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use crate::brdf::Sample;
use std::f64::consts::{FRAC_PI_2, PI};

/// A valid cell of a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Its place in the file.
    pub index: usize,
    /// Angles at its middle.
    pub angles: HalfDifference,
    /// Cosine of the incident light's angle there, above 0.
    pub cos_incoming: f64,
    /// Cosine of the viewer's angle there, above 0.
    pub cos_outgoing: f64,
    /// The BRDF, per steradian, red, green, blue.
    pub value: [f64; 3],
}

/// The angles at the middles of all cells, with their sines and cosines.
///
/// The middle is taken in the coordinates of the bins: bin `i` of `theta_h` has it at `((i + 0.5) / 90)^2 * 90` degrees, the others at
/// `i + 0.5` degrees. It is where looking a table up cell by cell and a smooth function of the angles agree without bias.
#[derive(Debug, Clone)]
pub struct CellGrid {
    theta_h: Vec<Angle>,
    theta_d: Vec<Angle>,
    phi_d: Vec<Angle>,
}

#[derive(Debug, Clone, Copy)]
struct Angle {
    radians: f64,
    sine: f64,
    cosine: f64,
}

impl Angle {
    fn new(radians: f64) -> Self {
        let (sine, cosine) = radians.sin_cos();
        Angle { radians, sine, cosine }
    }
}

impl Default for CellGrid {
    fn default() -> Self {
        Self::new()
    }
}

impl CellGrid {
    /// The grid of every table.
    pub fn new() -> Self {
        let middle = |i: usize, bins: usize| (i as f64 + 0.5) / bins as f64;
        CellGrid {
            theta_h: (0..THETA_H_BINS).map(|i| Angle::new(middle(i, THETA_H_BINS).powi(2) * FRAC_PI_2)).collect(),
            theta_d: (0..THETA_D_BINS).map(|i| Angle::new(middle(i, THETA_D_BINS) * FRAC_PI_2)).collect(),
            phi_d: (0..PHI_D_BINS).map(|i| Angle::new(middle(i, PHI_D_BINS) * PI)).collect(),
        }
    }

    /// Angles at the middle of a cell; `index` below [`CELLS`].
    pub fn angles(&self, index: usize) -> HalfDifference {
        let [h, d, p] = self.of(index);
        HalfDifference { theta_h: h.radians, theta_d: d.radians, phi_d: p.radians }
    }

    /// The directions (incoming, outgoing) at the middle of a cell if both are above the horizon.
    pub fn directions_above(&self, index: usize) -> Option<([f64; 3], [f64; 3])> {
        let [h, d, p] = self.of(index);
        let turn = |x: f64, y: f64, z: f64| [h.cosine * x + h.sine * z, y, h.cosine * z - h.sine * x];
        let (x, y) = (d.sine * p.cosine, d.sine * p.sine);
        let (incoming, outgoing) = (turn(x, y, d.cosine), turn(-x, -y, d.cosine));
        (incoming[2] > 0.0 && outgoing[2] > 0.0).then_some((incoming, outgoing))
    }

    /// The cells of a row, which share `theta_h` and `theta_d` (returned, radians), that lie above the horizon: their indices and
    /// directions (incoming, outgoing) at their middles replace what the lists held. `row` below `CELLS / PHI_D_BINS`.
    pub fn row(&self, row: usize, indices: &mut Vec<usize>, pairs: &mut Vec<[[f64; 3]; 2]>) -> [f64; 2] {
        indices.clear();
        pairs.clear();
        let first = row * PHI_D_BINS;
        for index in first..first + PHI_D_BINS {
            if let Some((incoming, outgoing)) = self.directions_above(index) {
                indices.push(index);
                pairs.push([incoming, outgoing]);
            }
        }
        let [h, d, _] = self.of(first);
        [h.radians, d.radians]
    }

    /// A cell with its angles, if both directions are above the horizon.
    pub fn cell(&self, index: usize, value: [f64; 3]) -> Option<Cell> {
        let [h, d, p] = self.of(index);
        let (middle, side) = (h.cosine * d.cosine, h.sine * d.sine * p.cosine);
        let (cos_incoming, cos_outgoing) = (middle - side, middle + side);
        let angles = HalfDifference { theta_h: h.radians, theta_d: d.radians, phi_d: p.radians };
        (cos_incoming > 0.0 && cos_outgoing > 0.0).then_some(Cell { index, angles, cos_incoming, cos_outgoing, value })
    }

    fn of(&self, index: usize) -> [Angle; 3] {
        debug_assert!(index < CELLS);
        [
            self.theta_h[index / (THETA_D_BINS * PHI_D_BINS)],
            self.theta_d[index / PHI_D_BINS % THETA_D_BINS],
            self.phi_d[index % PHI_D_BINS],
        ]
    }
}

#[cfg(feature = "encode")]
impl From<Cell> for Sample {
    fn from(cell: Cell) -> Self {
        Sample {
            theta_h: cell.angles.theta_h,
            theta_d: cell.angles.theta_d,
            cos_incoming: cell.cos_incoming,
            cos_outgoing: cell.cos_outgoing,
            value: cell.value,
        }
    }
}
