//! The specular model of a file's reflectance maps as a reflection function.

use crate::brdf::Brdf;
use crate::reflectance::geometry::LEAST_COS_VIEW;

/// `exp(-alpha^2 / (2 sigma^2)) / ((n.i) (n.o))` (Miyazaki 2007, equation 8, over the irradiance of the surface).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorranceSparrow {
    /// `sigma`, radians.
    pub sigma: f64,
}

impl Brdf for TorranceSparrow {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let (light, view) = (incoming[2], outgoing[2]);
        if light <= 0.0 || view <= 0.0 {
            return [0.0; 3];
        }
        let sum: [f64; 3] = std::array::from_fn(|k| incoming[k] + outgoing[k]);
        let alpha = sum[0].hypot(sum[1]).atan2(sum[2]) / self.sigma;
        [(-0.5 * alpha * alpha).exp() / (view.max(LEAST_COS_VIEW as f64) * light.max(1e-3)); 3]
    }
}
