//! Classical models of reflectance: a Lambertian part and one lobe.

mod codec;
#[cfg(feature = "encode")]
mod fit;
#[cfg(feature = "encode")]
mod form;
mod lobe;
mod microfacets;
#[cfg(feature = "encode")]
mod published;

#[cfg(feature = "encode")]
pub use fit::{FitObjective, MeasuredPair, fit_classical, fit_classical_pairs};
#[cfg(feature = "encode")]
pub(in crate::brdf) use fit::{fit_classical_measured, fit_classical_samples};
#[cfg(feature = "encode")]
pub use form::ClassicalForm;
pub use lobe::{ClassicalLobe, ScatteringAngles, ShiftedGamma};
pub use microfacets::Microfacets;
pub(crate) use microfacets::{DIELECTRIC, MIN_ALPHA};
#[cfg(feature = "encode")]
pub use published::{PublishedFit, read_published};

use super::Brdf;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// A classical material: `f = diffuse / pi + specular * lobe`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClassicalModel {
    /// Albedo of the Lambertian part, red, green, blue.
    pub diffuse: [f64; 3],
    /// Factor of the lobe, red, green, blue.
    pub specular: [f64; 3],
    /// The lobe and its shape.
    pub lobe: ClassicalLobe,
}

impl ClassicalModel {
    /// Checks what was read from a file: every parameter finite and within its range.
    pub fn check(&self) -> Result<()> {
        let colours = self.diffuse.iter().chain(&self.specular);
        if !colours.clone().all(|x| x.is_finite() && (0.0..=1e6).contains(x)) {
            return Err(Error::parameter("a model's colours are numbers from 0 to 1000000"));
        }
        self.lobe.check()
    }

    /// Numbers that the model has.
    pub fn parameter_count(&self) -> usize {
        match self.lobe {
            ClassicalLobe::Lambert => 3,
            _ => 6 + self.lobe.parameter_count(),
        }
    }

    /// Value at angles, per steradian.
    pub fn value_at(&self, geometry: &ScatteringAngles) -> [f64; 3] {
        let lobe = self.lobe.evaluate(geometry);
        std::array::from_fn(|c| {
            let value = self.diffuse[c] / PI + self.specular[c] * lobe[c];
            if value.is_finite() { value.max(0.0) } else { 0.0 }
        })
    }
}

impl Brdf for ClassicalModel {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        self.value_at(&ScatteringAngles::from_directions(incoming, outgoing))
    }

    fn evaluate_row(&self, theta_h: f64, theta_d: f64, pairs: &[[[f64; 3]; 2]], values: &mut Vec<[f64; 3]>) {
        let (sin_half, cos_half) = theta_h.sin_cos();
        let cos_difference = theta_d.cos();
        values.extend(pairs.iter().map(|[incoming, outgoing]| {
            let (cos_incoming, cos_outgoing) = (incoming[2], outgoing[2]);
            self.value_at(&ScatteringAngles {
                cos_incoming,
                cos_outgoing,
                cos_half,
                cos_difference,
                half: [sin_half, 0.0],
            })
        }));
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests;
