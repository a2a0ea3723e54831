//! The angles of a table's cells.

use super::{HalfDifference, MERL_CELLS, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use crate::brdf::BrdfSample;
use std::f64::consts::{FRAC_PI_2, PI};

/// A valid cell of a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MerlCell {
    /// Index in the file.
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
pub struct MerlGrid {
    theta_h: Vec<BinAngle>,
    theta_d: Vec<BinAngle>,
    phi_d: Vec<BinAngle>,
}

#[derive(Debug, Clone, Copy)]
struct BinAngle {
    radians: f64,
    sine: f64,
    cosine: f64,
}

impl BinAngle {
    fn new(radians: f64) -> Self {
        let (sine, cosine) = radians.sin_cos();
        BinAngle { radians, sine, cosine }
    }
}

impl Default for MerlGrid {
    fn default() -> Self {
        Self::new()
    }
}

impl MerlGrid {
    /// The grid of every table.
    pub fn new() -> Self {
        let middle = |i: usize, bins: usize| (i as f64 + 0.5) / bins as f64;
        MerlGrid {
            theta_h: (0..THETA_H_BINS).map(|i| BinAngle::new(middle(i, THETA_H_BINS).powi(2) * FRAC_PI_2)).collect(),
            theta_d: (0..THETA_D_BINS).map(|i| BinAngle::new(middle(i, THETA_D_BINS) * FRAC_PI_2)).collect(),
            phi_d: (0..PHI_D_BINS).map(|i| BinAngle::new(middle(i, PHI_D_BINS) * PI)).collect(),
        }
    }

    /// Angles at the middle of a cell; `index` below `MERL_CELLS`.
    pub fn angles(&self, index: usize) -> HalfDifference {
        let [h, d, p] = self.bin_angles(index);
        HalfDifference { theta_h: h.radians, theta_d: d.radians, phi_d: p.radians }
    }

    /// The directions (incoming, outgoing) at the middle of a cell if both are above the horizon.
    pub fn directions_above(&self, index: usize) -> Option<([f64; 3], [f64; 3])> {
        let [h, d, p] = self.bin_angles(index);
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
        let [h, d, _] = self.bin_angles(first);
        [h.radians, d.radians]
    }

    /// A cell with its angles, if both directions are above the horizon.
    pub fn cell(&self, index: usize, value: [f64; 3]) -> Option<MerlCell> {
        let [h, d, p] = self.bin_angles(index);
        let (middle, side) = (h.cosine * d.cosine, h.sine * d.sine * p.cosine);
        let (cos_incoming, cos_outgoing) = (middle - side, middle + side);
        let angles = HalfDifference { theta_h: h.radians, theta_d: d.radians, phi_d: p.radians };
        (cos_incoming > 0.0 && cos_outgoing > 0.0).then_some(MerlCell {
            index,
            angles,
            cos_incoming,
            cos_outgoing,
            value,
        })
    }

    fn bin_angles(&self, index: usize) -> [BinAngle; 3] {
        debug_assert!(index < MERL_CELLS);
        [
            self.theta_h[index / (THETA_D_BINS * PHI_D_BINS)],
            self.theta_d[index / PHI_D_BINS % THETA_D_BINS],
            self.phi_d[index % PHI_D_BINS],
        ]
    }
}

#[cfg(feature = "encode")]
impl From<MerlCell> for BrdfSample {
    fn from(cell: MerlCell) -> Self {
        BrdfSample {
            theta_h: cell.angles.theta_h,
            theta_d: cell.angles.theta_d,
            cos_incoming: cell.cos_incoming,
            cos_outgoing: cell.cos_outgoing,
            value: cell.value,
        }
    }
}
