//! Angles as a goniometer needs them: where its arms stand for each measurement, in an order that moves them little.

use super::PlannedAngles;
use std::fmt::Write;

/// Where the arms of a goniometer stand for one measurement.
///
/// The azimuth of the light is 0: the material is isotropic. Angles are multiples of a thousandth of a degree, and the vectors theirs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoniometerAngles {
    /// Position in the plan, from 0; methods that choose put the most telling first.
    pub rank: usize,
    /// Angle between normal and light, degrees, 0 to 90.
    pub theta_i_deg: f64,
    /// Azimuth of the light, degrees: 0.
    pub phi_i_deg: f64,
    /// Angle between normal and viewer, degrees, 0 to 90.
    pub theta_o_deg: f64,
    /// Azimuth of the viewer, degrees, -180 (excluded) to 180.
    pub phi_o_deg: f64,
}

impl GoniometerAngles {
    /// Finds the arms' angles of a pair of directions.
    fn new(rank: usize, planned: &PlannedAngles) -> Self {
        let (incoming, outgoing) = planned.half_difference().directions();
        let degrees = |radians: f64| (radians.to_degrees() * 1e3).round() / 1e3 + 0.0;
        let polar = |v: [f64; 3]| degrees(v[0].hypot(v[1]).atan2(v[2]));
        let azimuth = |v: [f64; 3]| if v[0].hypot(v[1]) > 1e-9 { v[1].atan2(v[0]) } else { 0.0 };
        let mut between = degrees(azimuth(outgoing) - azimuth(incoming));
        if between > 180.0 {
            between -= 360.0;
        } else if between <= -180.0 {
            between += 360.0;
        }
        GoniometerAngles {
            rank,
            theta_i_deg: polar(incoming),
            phi_i_deg: 0.0,
            theta_o_deg: polar(outgoing),
            phi_o_deg: between,
        }
    }

    /// The unit vectors to the light and to the viewer, `z` along the normal.
    pub fn directions(&self) -> ([f64; 3], [f64; 3]) {
        let vector = |theta: f64, phi: f64| {
            let ((sine, cosine), (y, x)) = (theta.to_radians().sin_cos(), phi.to_radians().sin_cos());
            [sine * x, sine * y, cosine]
        };
        (vector(self.theta_i_deg, self.phi_i_deg), vector(self.theta_o_deg, self.phi_o_deg))
    }

    /// Degrees by which the arm that moves most moves.
    fn travel(&self, to: &GoniometerAngles) -> f64 {
        let turn = (self.phi_o_deg - to.phi_o_deg).abs();
        let arms = (self.theta_i_deg - to.theta_i_deg).abs() + (self.theta_o_deg - to.theta_o_deg).abs();
        arms + turn.min(360.0 - turn)
    }
}

/// Most angles whose order is improved after the first try; the work grows with the square.
const MAX_IMPROVED: usize = 1500;
/// Rounds of improvement.
const ROUNDS: usize = 20;

/// Angles of a plan for a goniometer. The order is a short way of the arms: from the least angle of the light always to the nearest, then
/// parts of the way are reversed while that shortens it (Croes 1958).
pub fn goniometer_rows(angles: &[PlannedAngles]) -> Vec<GoniometerAngles> {
    let all: Vec<GoniometerAngles> =
        angles.iter().enumerate().map(|(rank, a)| GoniometerAngles::new(rank, a)).collect();
    let mut left: Vec<usize> = (0..all.len()).collect();
    let mut way: Vec<usize> = Vec::with_capacity(all.len());
    let mut at = GoniometerAngles { rank: 0, theta_i_deg: 0.0, phi_i_deg: 0.0, theta_o_deg: 0.0, phi_o_deg: 0.0 };
    while !left.is_empty() {
        let near = |&(_, a): &(usize, &usize), &(_, b): &(usize, &usize)| {
            at.travel(&all[*a]).total_cmp(&at.travel(&all[*b])).then(a.cmp(b))
        };
        let Some((place, _)) = left.iter().enumerate().min_by(near) else { break };
        let next = left.swap_remove(place);
        at = all[next];
        way.push(next);
    }
    if way.len() <= MAX_IMPROVED {
        shorten(&mut way, &all);
    }
    way.into_iter().map(|index| all[index]).collect()
}

/// Reverses parts of a way while that shortens it.
fn shorten(way: &mut [usize], all: &[GoniometerAngles]) {
    let travel = |a: usize, b: usize| all[a].travel(&all[b]);
    for _ in 0..ROUNDS {
        let mut shorter = false;
        for i in 0..way.len().saturating_sub(2) {
            for j in i + 2..way.len() {
                // The step from i and, unless j is the last, the one from j change.
                let after = way.get(j + 1);
                let before_cost = travel(way[i], way[i + 1]) + after.map_or(0.0, |&n| travel(way[j], n));
                let cost = travel(way[i], way[j]) + after.map_or(0.0, |&n| travel(way[i + 1], n));
                if cost < before_cost - 1e-9 {
                    way[i + 1..=j].reverse();
                    shorter = true;
                }
            }
        }
        if !shorter {
            break;
        }
    }
}

/// A table of a plan's angles, one row for each measurement in the order of [`goniometer_rows`]: `theta_i,phi_i,theta_o,phi_o` in degrees, the
/// unit vectors `wi_x` to `wo_z` (`z` along the normal), and `rank`, the position in the plan from 1. With columns `r,g,b` added it is what
/// [`crate::brdf::MeasuredSamples`] reads.
pub fn goniometer_csv(angles: &[PlannedAngles]) -> String {
    let mut text = String::from("theta_i,phi_i,theta_o,phi_o,wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,rank\n");
    for row in goniometer_rows(angles) {
        let ([a, b, c], [d, e, f]) = row.directions();
        let GoniometerAngles { theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg, rank } = row;
        let _ = write!(text, "{theta_i_deg:.3},{phi_i_deg:.3},{theta_o_deg:.3},{phi_o_deg:.3}");
        // A zero has no sign.
        [a, b, c, d, e, f].into_iter().for_each(|x| {
            let _ = write!(text, ",{:.7}", if x.abs() < 5e-8 { 0.0 } else { x });
        });
        let _ = writeln!(text, ",{}", rank + 1);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::HalfDifference;

    #[test]
    fn rows_are_the_planned_angles_on_a_short_way() {
        let part = |n: usize, step: f64| (n as f64 * step).fract();
        let planned: Vec<PlannedAngles> = (0..60)
            .map(|n| PlannedAngles {
                theta_h_deg: 40.0 * part(n, 0.618),
                theta_d_deg: 45.0 * part(n, 0.755),
                phi_d_deg: 180.0 * part(n, 0.57),
                variance: 0.1,
            })
            .collect();
        let rows = goniometer_rows(&planned);
        let mut ranks: Vec<usize> = rows.iter().map(|row| row.rank).collect();
        for row in &rows {
            let (incoming, outgoing) = row.directions();
            let found = HalfDifference::from_directions(incoming, outgoing);
            let wanted = planned[row.rank].half_difference();
            for (a, b) in [(found.theta_h, wanted.theta_h), (found.theta_d, wanted.theta_d)] {
                assert!((a - b).abs() < 1e-4, "{row:?} {found:?} {wanted:?}");
            }
            // The azimuth means little where directions are close to each other, or the half vector to the normal.
            let apart = (found.phi_d - wanted.phi_d).abs();
            let scale = wanted.theta_d.sin() * wanted.theta_h.sin();
            assert!(apart.min(std::f64::consts::PI - apart) * scale < 1e-4, "{row:?} {found:?} {wanted:?}");
        }
        let travel = |rows: &[GoniometerAngles]| rows.windows(2).map(|pair| pair[0].travel(&pair[1])).sum::<f64>();
        let short = travel(&rows);
        let mut planned_order = rows.clone();
        planned_order.sort_by_key(|row| row.rank);
        assert!(short < 0.4 * travel(&planned_order), "{short} of {}", travel(&planned_order));
        ranks.sort_unstable();
        assert_eq!(ranks, (0..60).collect::<Vec<_>>());
        let text = goniometer_csv(&planned);
        assert_eq!(text.lines().count(), 61);
        assert!(text.starts_with("theta_i,phi_i,theta_o,phi_o,wi_x"), "{text}");
    }
}
