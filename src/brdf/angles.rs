//! Half and difference angles (Rusinkiewicz 1998).

use crate::vector::dot;
use std::f64::consts::PI;

/// An isotropic pair of directions by its half vector `h = (i + o) / |i + o|` and difference vector `d = R_y(-theta_h) R_z(-phi_h) i`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfDifference {
    /// Angle between normal and half vector, 0 to pi/2.
    pub theta_h: f64,
    /// Angle between half vector and either direction, 0 to pi/2.
    pub theta_d: f64,
    /// Azimuth of the difference vector about the half vector, 0 (included) to pi (excluded): both directions may be exchanged.
    pub phi_d: f64,
}

impl HalfDifference {
    /// Angles of a pair of unit directions, `z` along the normal.
    pub fn from_directions(incoming: [f64; 3], outgoing: [f64; 3]) -> Self {
        let sum = [0, 1, 2].map(|k| incoming[k] + outgoing[k]);
        let length = dot(sum, sum).sqrt();
        // Opposite directions have no half vector: they graze from both sides, half vector along the normal.
        let h = if length > 1e-12 { sum.map(|x| x / length) } else { [0.0, 0.0, 1.0] };
        let sine = h[0].hypot(h[1]);
        let (cos_phi, sin_phi) = if sine > 1e-12 { (h[0] / sine, h[1] / sine) } else { (1.0, 0.0) };
        let [x, y, z] = incoming;
        let (x, y) = (cos_phi * x + sin_phi * y, cos_phi * y - sin_phi * x);
        let (x, z) = (h[2] * x - sine * z, sine * x + h[2] * z);
        let mut phi_d = y.atan2(x);
        if phi_d < 0.0 {
            phi_d += PI;
        }
        if phi_d >= PI {
            phi_d -= PI;
        }
        HalfDifference { theta_h: sine.atan2(h[2]), theta_d: x.hypot(y).atan2(z), phi_d }
    }

    /// The pair of directions (incoming, outgoing) with the half vector at azimuth 0.
    pub fn directions(self) -> ([f64; 3], [f64; 3]) {
        let (sin_h, cos_h) = self.theta_h.sin_cos();
        let (sin_d, cos_d) = self.theta_d.sin_cos();
        let (sin_p, cos_p) = self.phi_d.sin_cos();
        let turn = |x: f64, y: f64, z: f64| [cos_h * x + sin_h * z, y, cos_h * z - sin_h * x];
        (turn(sin_d * cos_p, sin_d * sin_p, cos_d), turn(-sin_d * cos_p, -sin_d * sin_p, cos_d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_and_angles_are_inverse_and_reciprocal() {
        for [theta_h, theta_d, phi_d] in [[0.3, 0.4, 1.0], [1.2, 0.1, 3.0], [0.7, 0.9, 0.0], [1e-3, 1.3, 2.0]] {
            let angles = HalfDifference { theta_h, theta_d, phi_d };
            let (incoming, outgoing) = angles.directions();
            for again in [
                HalfDifference::from_directions(incoming, outgoing),
                HalfDifference::from_directions(outgoing, incoming),
            ] {
                for (a, b) in [(again.theta_h, theta_h), (again.theta_d, theta_d), (again.phi_d, phi_d)] {
                    let apart = (a - b).abs();
                    assert!(apart < 1e-9 || (apart - PI).abs() < 1e-9, "{again:?} for {angles:?}");
                }
            }
        }
    }
}
