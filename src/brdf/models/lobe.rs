//! The lobes. Each is evaluated without its colour; angles are those of half vector and directions to the normal.

use crate::brdf::HalfDifference;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Least cosines to viewer and light by which a Torrance-Sparrow lobe is divided; the first is that of reflectance maps.
const MIN_COSINES: [f64; 2] = [0.05f32 as f64, 1e-3];

/// Cosines and half vector that lobes depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScatteringAngles {
    /// Cosine of the incident light's angle to the normal.
    pub cos_incoming: f64,
    /// Cosine of the viewer's angle to the normal.
    pub cos_outgoing: f64,
    /// Cosine of the half vector's angle to the normal.
    pub cos_half: f64,
    /// Cosine of the angle between half vector and either direction.
    pub cos_difference: f64,
    /// The half vector's components in the surface.
    pub half: [f64; 2],
}

impl ScatteringAngles {
    /// Computes them from a pair of unit directions.
    pub fn from_directions(incoming: [f64; 3], outgoing: [f64; 3]) -> Self {
        let sum: [f64; 3] = std::array::from_fn(|k| incoming[k] + outgoing[k]);
        let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt().max(1e-12);
        ScatteringAngles {
            cos_incoming: incoming[2],
            cos_outgoing: outgoing[2],
            cos_half: sum[2] / length,
            cos_difference: 0.5 * length,
            half: [sum[0] / length, sum[1] / length],
        }
    }

    /// Computes them from half and difference angles; the half vector has azimuth 0.
    pub fn from_half_difference(angles: HalfDifference) -> Self {
        let ((sin_h, cos_h), (sin_d, cos_d)) = (angles.theta_h.sin_cos(), angles.theta_d.sin_cos());
        let side = sin_h * sin_d * angles.phi_d.cos();
        ScatteringAngles {
            cos_incoming: cos_h * cos_d - side,
            cos_outgoing: cos_h * cos_d + side,
            cos_half: cos_h,
            cos_difference: cos_d,
            half: [sin_h, 0.0],
        }
    }

    /// Square of the tangent of `theta_h`, exact near the normal.
    fn tan2_half(&self) -> f64 {
        (self.half[0] * self.half[0] + self.half[1] * self.half[1]) / (self.cos_half * self.cos_half).max(1e-18)
    }

    /// Product of the two directions' cosines, kept from 0.
    fn cosines(&self) -> f64 {
        (self.cos_incoming * self.cos_outgoing).max(1e-9)
    }
}

/// A lobe and its shape, the colour apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ClassicalLobe {
    /// None.
    Lambert,
    /// `(n + 2) / (2 pi) cos^n(theta_h)` (Blinn 1977).
    BlinnPhong {
        /// `n`.
        exponent: f64,
    },
    /// `F D G / (4 cos cos)` with Beckmann's distribution and V-shaped grooves (Cook and Torrance 1982).
    CookTorranceBeckmann {
        /// Root mean square slope.
        roughness: f64,
        /// Schlick's reflectance at normal incidence.
        reflectance: f64,
    },
    /// `F D G / (4 cos cos)` with the GGX distribution and Smith's shadowing (Walter and others 2007).
    CookTorranceGgx {
        /// Width.
        roughness: f64,
        /// Schlick's reflectance at normal incidence.
        reflectance: f64,
    },
    /// `exp(-tan^2(theta_h) / a^2) / (4 pi a^2 sqrt(cos cos))` (Ward 1992).
    Ward {
        /// `a`.
        roughness: f64,
    },
    /// Lobe of the previous variant with two widths.
    WardAnisotropic {
        /// Along the surface's first and second axis.
        roughness: [f64; 2],
    },
    /// `sqrt((n + 1) (m + 1)) / (8 pi) F cos^e(theta_h) / (cos(theta_d) max(cos, cos))` (Ashikhmin and Shirley 2000).
    AshikhminShirley {
        /// `n` and `m`, along the surface's first and second axis.
        exponents: [f64; 2],
        /// Schlick's reflectance at normal incidence.
        reflectance: f64,
    },
    /// `(n + 2) / (2 pi) (b / max(|xy|, |z|))^n`, `b = xy (i_x o_x + i_y o_y) + z i_z o_z` (Lafortune and others 1997).
    Lafortune {
        /// Factor of the product within the surface, negative for a mirror's direction.
        xy: f64,
        /// Factor of the product along the normal.
        z: f64,
        /// `n`.
        exponent: f64,
    },
    /// `exp(-theta_h^2 / (2 sigma^2)) / (cos cos)` (Miyazaki 2007, equation 8, over the irradiance of the surface).
    TorranceSparrow {
        /// `sigma`, radians.
        sigma: f64,
    },
    /// `F D G / (pi cos cos)` with the shifted gamma distribution (Bagher, Soler, Holzschuch 2012).
    ShiftedGamma(Box<ShiftedGamma>),
}

/// Parameters of the shifted gamma distribution, each for red, green, blue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShiftedGamma {
    /// Width.
    pub alpha: [f64; 3],
    /// Exponent of the tail.
    pub p: [f64; 3],
    /// Reflectance at normal incidence.
    pub f0: [f64; 3],
    /// Factor of the cosine that is taken from Schlick's form.
    pub f1: [f64; 3],
    /// Factor that normalises the distribution.
    pub normalisation: [f64; 3],
    /// Height of the fitted shadowing.
    pub lambda: [f64; 3],
    /// Rate of the fitted shadowing.
    pub c: [f64; 3],
    /// Exponent of the fitted shadowing.
    pub k: [f64; 3],
    /// Angle where shadowing begins, radians.
    pub theta0: [f64; 3],
}

impl ShiftedGamma {
    /// All parameters, in the order of a file.
    pub(in crate::brdf) fn lists(&self) -> [&[f64; 3]; 9] {
        let ShiftedGamma { alpha, p, f0, f1, normalisation, lambda, c, k, theta0 } = self;
        [alpha, p, f0, f1, normalisation, lambda, c, k, theta0]
    }

    fn evaluate(&self, g: &ScatteringAngles) -> [f64; 3] {
        let angle = |cosine: f64| cosine.clamp(-1.0, 1.0).acos();
        let (theta_i, theta_o) = (angle(g.cos_incoming), angle(g.cos_outgoing));
        let cos4 = g.cos_half.powi(4).max(1e-18);
        std::array::from_fn(|c| {
            let at = self.alpha[c] + g.tan2_half() / self.alpha[c];
            let distribution = self.normalisation[c] * (-at).exp() / at.powf(self.p[c]) / (PI * cos4);
            let fresnel = schlick(self.f0[c], g.cos_difference) - self.f1[c] * g.cos_difference;
            let unshadowed = |theta: f64| {
                let beyond = theta - self.theta0[c];
                if beyond <= 0.0 {
                    return 1.0;
                }
                (1.0 + self.lambda[c] * (1.0 - (self.c[c] * beyond.powf(self.k[c])).exp())).clamp(0.0, 1.0)
            };
            fresnel.max(0.0) * distribution * unshadowed(theta_i) * unshadowed(theta_o) / (PI * g.cosines())
        })
    }
}

fn schlick(reflectance: f64, cosine: f64) -> f64 {
    let m = (1.0 - cosine).clamp(0.0, 1.0);
    reflectance + (1.0 - reflectance) * m * m * m * m * m
}

impl ClassicalLobe {
    /// Returns the model's name.
    pub fn name(&self) -> &'static str {
        match self {
            ClassicalLobe::Lambert => "lambert",
            ClassicalLobe::BlinnPhong { .. } => "blinn-phong",
            ClassicalLobe::CookTorranceBeckmann { .. } => "cook-torrance-beckmann",
            ClassicalLobe::CookTorranceGgx { .. } => "cook-torrance-ggx",
            ClassicalLobe::Ward { .. } => "ward",
            ClassicalLobe::WardAnisotropic { .. } => "ward-anisotropic",
            ClassicalLobe::AshikhminShirley { .. } => "ashikhmin-shirley",
            ClassicalLobe::Lafortune { .. } => "lafortune",
            ClassicalLobe::TorranceSparrow { .. } => "torrance-sparrow",
            ClassicalLobe::ShiftedGamma(_) => "shifted-gamma",
        }
    }

    /// Numbers that describe the shape.
    pub fn parameter_count(&self) -> usize {
        match self {
            ClassicalLobe::Lambert => 0,
            ClassicalLobe::BlinnPhong { .. } | ClassicalLobe::Ward { .. } | ClassicalLobe::TorranceSparrow { .. } => 1,
            ClassicalLobe::CookTorranceBeckmann { .. }
            | ClassicalLobe::CookTorranceGgx { .. }
            | ClassicalLobe::WardAnisotropic { .. } => 2,
            ClassicalLobe::AshikhminShirley { exponents: [n, m], .. } => 2 + usize::from(n != m),
            ClassicalLobe::Lafortune { .. } => 3,
            ClassicalLobe::ShiftedGamma(_) => 27,
        }
    }

    /// Checks that every parameter is finite and within its range.
    pub fn check(&self) -> Result<()> {
        let numbers: Vec<(f64, f64, f64)> = match self {
            ClassicalLobe::Lambert => vec![],
            ClassicalLobe::BlinnPhong { exponent } => vec![(*exponent, 0.0, 1e9)],
            ClassicalLobe::CookTorranceBeckmann { roughness, reflectance }
            | ClassicalLobe::CookTorranceGgx { roughness, reflectance } => {
                vec![(*roughness, 1e-6, 1e3), (*reflectance, 0.0, 1.0)]
            }
            ClassicalLobe::Ward { roughness } => vec![(*roughness, 1e-6, 1e3)],
            ClassicalLobe::WardAnisotropic { roughness: [u, v] } => vec![(*u, 1e-6, 1e3), (*v, 1e-6, 1e3)],
            ClassicalLobe::AshikhminShirley { exponents: [n, m], reflectance } => {
                vec![(*n, 0.0, 1e9), (*m, 0.0, 1e9), (*reflectance, 0.0, 1.0)]
            }
            ClassicalLobe::Lafortune { xy, z, exponent } => {
                vec![(*xy, -1e3, 1e3), (*z, -1e3, 1e3), (*exponent, 0.0, 1e9)]
            }
            ClassicalLobe::TorranceSparrow { sigma } => vec![(*sigma, 1e-6, 1e3)],
            ClassicalLobe::ShiftedGamma(shape) => {
                let widths = shape.alpha.map(|alpha| (alpha, 1e-9, 1e3));
                let others = shape.lists().into_iter().flatten().map(|&x| (x, -1e300, 1e300));
                widths.into_iter().chain(others).collect()
            }
        };
        match numbers.into_iter().find(|&(x, low, high)| !(low..=high).contains(&x)) {
            Some((x, low, high)) => {
                let message = format!("model {}: a parameter of {x} is not within {low} and {high}", self.name());
                Err(Error::Parameter(message))
            }
            None => Ok(()),
        }
    }

    /// Value at angles, red, green, blue (different for the shifted gamma distribution only), before colour.
    pub fn evaluate(&self, g: &ScatteringAngles) -> [f64; 3] {
        match self {
            ClassicalLobe::ShiftedGamma(shape) => shape.evaluate(g),
            _ => [self.scalar(g); 3],
        }
    }

    /// Value of a lobe that is the same for all colours; 0 of the others.
    pub(super) fn scalar(&self, g: &ScatteringAngles) -> f64 {
        match *self {
            ClassicalLobe::Lambert | ClassicalLobe::ShiftedGamma(_) => 0.0,
            ClassicalLobe::BlinnPhong { exponent } => (exponent + 2.0) / (2.0 * PI) * cos_power(g, exponent),
            ClassicalLobe::CookTorranceBeckmann { roughness, reflectance } => {
                let m2 = roughness * roughness;
                let distribution = (-g.tan2_half() / m2).exp() / (PI * m2 * g.cos_half.powi(4).max(1e-18));
                let groove = 2.0 * g.cos_half * g.cos_incoming.min(g.cos_outgoing) / g.cos_difference.max(1e-9);
                schlick(reflectance, g.cos_difference) * distribution * groove.min(1.0) / (4.0 * g.cosines())
            }
            ClassicalLobe::CookTorranceGgx { roughness, reflectance } => {
                let a2 = roughness * roughness;
                // cos^2 (a^2 - 1) + 1 without cancellation near the normal.
                let sin2 = g.half[0] * g.half[0] + g.half[1] * g.half[1];
                let width = g.cos_half * g.cos_half * a2 + sin2;
                let distribution = a2 / (PI * width * width);
                let unshadowed = |cosine: f64| 2.0 / (cosine + (a2 + (1.0 - a2) * cosine * cosine).max(0.0).sqrt());
                let shadowing = unshadowed(g.cos_incoming) * unshadowed(g.cos_outgoing);
                schlick(reflectance, g.cos_difference) * distribution * shadowing / 4.0
            }
            ClassicalLobe::Ward { roughness } => {
                let a2 = roughness * roughness;
                (-g.tan2_half() / a2).exp() / (4.0 * PI * a2 * g.cosines().sqrt())
            }
            ClassicalLobe::WardAnisotropic { roughness: [u, v] } => {
                let slope = ((g.half[0] / u).powi(2) + (g.half[1] / v).powi(2)) / (g.cos_half * g.cos_half).max(1e-18);
                (-slope).exp() / (4.0 * PI * u * v * g.cosines().sqrt())
            }
            ClassicalLobe::AshikhminShirley { exponents: [n, m], reflectance } => {
                let sin2 = g.half[0] * g.half[0] + g.half[1] * g.half[1];
                let exponent = if sin2 > 1e-18 && n != m {
                    (n * g.half[0] * g.half[0] + m * g.half[1] * g.half[1]) / sin2
                } else {
                    n
                };
                let denominator = g.cos_difference.max(1e-9) * g.cos_incoming.max(g.cos_outgoing).max(1e-9);
                let norm = ((n + 1.0) * (m + 1.0)).sqrt() / (8.0 * PI);
                norm * schlick(reflectance, g.cos_difference) * cos_power(g, exponent) / denominator
            }
            ClassicalLobe::Lafortune { xy, z, exponent } => {
                let along = g.cos_incoming * g.cos_outgoing;
                let within = 2.0 * g.cos_difference * g.cos_difference - 1.0 - along;
                let base = (xy * within + z * along) / xy.abs().max(z.abs()).max(1e-9);
                (exponent + 2.0) / (2.0 * PI) * base.max(0.0).powf(exponent)
            }
            ClassicalLobe::TorranceSparrow { sigma } => {
                let angle = g.half[0].hypot(g.half[1]).atan2(g.cos_half) / sigma;
                let [view, light] = [g.cos_outgoing.max(MIN_COSINES[0]), g.cos_incoming.max(MIN_COSINES[1])];
                (-0.5 * angle * angle).exp() / (view * light)
            }
        }
    }
}

/// `cos^n(theta_h)`, by the sine near the normal.
fn cos_power(g: &ScatteringAngles, exponent: f64) -> f64 {
    let sin2 = (g.half[0] * g.half[0] + g.half[1] * g.half[1]).min(1.0);
    (0.5 * exponent * (-sin2).ln_1p()).exp()
}
