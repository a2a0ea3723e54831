//! The cell that a pair of directions falls into, and interpolation between cells.

use super::super::{Brdf, HalfDifference};
use super::{MerlTable, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use std::f64::consts::{FRAC_PI_2, PI};

/// Coordinates in bins: whole numbers where a bin begins.
fn coordinates(angles: HalfDifference) -> [f64; 3] {
    [
        (angles.theta_h / FRAC_PI_2).max(0.0).sqrt() * THETA_H_BINS as f64,
        angles.theta_d / FRAC_PI_2 * THETA_D_BINS as f64,
        angles.phi_d / PI * PHI_D_BINS as f64,
    ]
}

/// The cell that angles fall into.
pub(super) fn cell_index(angles: HalfDifference) -> usize {
    let [h, d, p] = coordinates(angles);
    let bin = |x: f64, bins: usize| (x as usize).min(bins - 1);
    (bin(h, THETA_H_BINS) * THETA_D_BINS + bin(d, THETA_D_BINS)) * PHI_D_BINS + bin(p, PHI_D_BINS)
}

/// A table whose values are interpolated linearly between the middles of its cells, invalid cells left out.
#[derive(Debug, Clone, Copy)]
pub struct InterpolatedMerl<'a> {
    pub(super) table: &'a MerlTable,
}

impl Brdf for InterpolatedMerl<'_> {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        let angles = HalfDifference::from_directions(incoming, outgoing);
        let [h, d, p] = coordinates(angles);
        let clamped = |x: f64, bins: usize| {
            let x = (x - 0.5).clamp(0.0, (bins - 1) as f64);
            let low = (x as usize).min(bins - 2);
            ([low, low + 1], x - low as f64)
        };
        let (theta_h, at_h) = clamped(h, THETA_H_BINS);
        let (theta_d, at_d) = clamped(d, THETA_D_BINS);
        // Azimuth goes round: half a turn exchanges the two directions.
        let p = p - 0.5 + PHI_D_BINS as f64;
        let phi_d = [p as usize % PHI_D_BINS, (p as usize + 1) % PHI_D_BINS];
        let at_p = p.fract();
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for (i, &bin_h) in theta_h.iter().enumerate() {
            for (j, &bin_d) in theta_d.iter().enumerate() {
                for (k, &bin_p) in phi_d.iter().enumerate() {
                    let part = |at: f64, upper: usize| if upper == 1 { at } else { 1.0 - at };
                    let weight = part(at_h, i) * part(at_d, j) * part(at_p, k);
                    if weight <= 0.0 {
                        continue;
                    }
                    let Some(value) = self.table.cell((bin_h * THETA_D_BINS + bin_d) * PHI_D_BINS + bin_p) else {
                        continue;
                    };
                    weights += weight;
                    (0..3).for_each(|c| sum[c] += weight * value[c]);
                }
            }
        }
        if weights > 0.0 { sum.map(|x| x / weights) } else { [0.0; 3] }
    }
}
