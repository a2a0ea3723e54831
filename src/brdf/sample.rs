//! One measured value of a material.

use super::Brdf;

/// A value with the angles at which it was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrdfSample {
    /// Angle between normal and half vector, 0 to pi/2.
    pub theta_h: f64,
    /// Angle between half vector and either direction, 0 to pi/2.
    pub theta_d: f64,
    /// Cosine of the incident light's angle, above 0.
    pub cos_incoming: f64,
    /// Cosine of the viewer's angle, above 0.
    pub cos_outgoing: f64,
    /// The BRDF, per steradian, red, green, blue.
    pub value: [f64; 3],
}

impl BrdfSample {
    /// Evaluates a material at the middles of `theta_h x theta_d x phi_d` bins, those of `theta_h` growing with its square, in the order
    /// of a MERL table. Only where both directions are above the horizon.
    pub fn tabulate(material: &impl Brdf, bins: [usize; 3]) -> Vec<BrdfSample> {
        use std::f64::consts::{FRAC_PI_2, PI};
        let middle = |i: usize, bins: usize| (i as f64 + 0.5) / bins as f64;
        let mut samples = Vec::new();
        for h in 0..bins[0] {
            for d in 0..bins[1] {
                for p in 0..bins[2] {
                    let (theta_h, theta_d) = (middle(h, bins[0]).powi(2) * FRAC_PI_2, middle(d, bins[1]) * FRAC_PI_2);
                    let angles = super::HalfDifference { theta_h, theta_d, phi_d: middle(p, bins[2]) * PI };
                    let (incoming, outgoing) = angles.directions();
                    if incoming[2] > 0.0 && outgoing[2] > 0.0 {
                        let value = material.evaluate(incoming, outgoing);
                        let (cos_incoming, cos_outgoing) = (incoming[2], outgoing[2]);
                        samples.push(BrdfSample { theta_h, theta_d, cos_incoming, cos_outgoing, value });
                    }
                }
            }
        }
        samples
    }
}

/// The mean of the values measured at a pair of directions, as a goniometer gives them: any azimuths, with their noise.
#[cfg(feature = "encode")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredSample {
    /// Unit vector to the light, `z` along the normal and above 0.
    pub incoming: [f64; 3],
    /// Unit vector to the viewer, `z` above 0.
    pub outgoing: [f64; 3],
    /// The BRDF, per steradian, red, green, blue; finite, 0 or more.
    pub value: [f64; 3],
    /// Standard deviation of each, per steradian, 0 or more.
    pub deviation: [f64; 3],
}

#[cfg(feature = "encode")]
impl MeasuredSample {
    /// Returns the value with its isotropic angles.
    pub fn isotropic(&self) -> BrdfSample {
        let angles = super::HalfDifference::from_directions(self.incoming, self.outgoing);
        BrdfSample {
            theta_h: angles.theta_h,
            theta_d: angles.theta_d,
            cos_incoming: self.incoming[2],
            cos_outgoing: self.outgoing[2],
            value: self.value,
        }
    }
}
