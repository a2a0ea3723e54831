//! Closed forms of reflection that a job may name. Specular parts only; Lambert's is the albedo of [`super::Material`].

use crate::brdf::Brdf;
use glam::DVec3;
use std::f64::consts::PI;

/// A specular model.
#[derive(Debug, Clone, PartialEq)]
pub enum Model {
    /// `(n + 2) / (2 pi) (n.h)^n` (Blinn 1977, normalised).
    BlinnPhong {
        /// Exponent.
        exponent: f64,
    },
    /// `D F G / (4 (n.i) (n.o))` with Schlick's Fresnel term (Cook & Torrance 1982).
    CookTorrance {
        /// Root mean square slope `m` of Beckmann's distribution, or GGX's `alpha`.
        roughness: f64,
        /// Reflectance at normal incidence.
        f0: [f64; 3],
        /// GGX with Smith's masking instead of Beckmann with V-cavities.
        ggx: bool,
    },
    /// `exp(-tan^2 (cos^2 / ax^2 + sin^2 / ay^2)) / (4 pi ax ay sqrt((n.i) (n.o)))` (Ward 1992).
    Ward {
        /// Slopes along the tangent and the bitangent.
        roughness: [f64; 2],
    },
    /// Ashikhmin & Shirley 2000, the specular part.
    AshikhminShirley {
        /// Exponents along the tangent and the bitangent.
        exponents: [f64; 2],
        /// Reflectance at normal incidence.
        f0: [f64; 3],
    },
    /// `(n + 2) / (2 pi) (cx ix ox + cy iy oy + cz iz oz)^n` (Lafortune et al. 1997).
    Lafortune {
        /// `cx, cy, cz`.
        coefficients: [f64; 3],
        /// Exponent.
        exponent: f64,
    },
    /// `exp(-alpha^2 / (2 sigma^2)) / ((n.i) (n.o))`, the model of a file's reflectance maps (Miyazaki 2007, equation 8).
    TorranceSparrow {
        /// `sigma`, radians.
        sigma: f64,
    },
}

impl Brdf for Model {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let (ci, co) = (incoming[2], outgoing[2]);
        if ci <= 0.0 || co <= 0.0 {
            return [0.0; 3];
        }
        let (i, o) = (DVec3::from_array(incoming), DVec3::from_array(outgoing));
        let h = (i + o).normalize_or(DVec3::Z);
        let oh = o.dot(h).max(1e-9);
        let z = h.z.max(1e-9);
        let schlick = |f0: [f64; 3]| f0.map(|f| f + (1.0 - f) * (1.0 - oh).max(0.0).powi(5));
        match *self {
            Model::BlinnPhong { exponent } => [(exponent + 2.0) / (2.0 * PI) * z.powf(exponent); 3],
            Model::CookTorrance { roughness, f0, ggx } => {
                let (z2, m2) = (z * z, roughness * roughness);
                let (d, g) = if ggx {
                    let smith = |c: f64| 2.0 / (1.0 + (1.0 + m2 * (1.0 / (c * c) - 1.0)).sqrt());
                    (m2 / (PI * (z2 * (m2 - 1.0) + 1.0).powi(2)), smith(ci) * smith(co))
                } else {
                    let d = (-(1.0 / z2 - 1.0) / m2).exp() / (PI * m2 * z2 * z2);
                    (d, (2.0 * z * co / oh).min(2.0 * z * ci / oh).min(1.0))
                };
                schlick(f0).map(|f| f * d * g / (4.0 * ci * co))
            }
            Model::Ward { roughness: [ax, ay] } => {
                let exponent = ((h.x / ax).powi(2) + (h.y / ay).powi(2)) / (z * z);
                [(-exponent).exp() / (4.0 * PI * ax * ay * (ci * co).sqrt()); 3]
            }
            Model::AshikhminShirley { exponents: [nx, ny], f0 } => {
                let sine = h.x * h.x + h.y * h.y;
                let exponent = if sine > 1e-18 { (nx * h.x * h.x + ny * h.y * h.y) / sine } else { nx };
                let scale = ((nx + 1.0) * (ny + 1.0)).sqrt() / (8.0 * PI) * z.powf(exponent) / (oh * ci.max(co));
                schlick(f0).map(|f| f * scale)
            }
            Model::Lafortune { coefficients: c, exponent } => {
                let inner = c[0] * i.x * o.x + c[1] * i.y * o.y + c[2] * i.z * o.z;
                [(exponent + 2.0) / (2.0 * PI) * inner.max(0.0).powf(exponent); 3]
            }
            Model::TorranceSparrow { sigma } => {
                let alpha = z.min(1.0).acos() / sigma;
                let least = crate::reflectance::geometry::LEAST_COS_VIEW as f64;
                [(-0.5 * alpha * alpha).exp() / (co.max(least) * ci.max(1e-3)); 3]
            }
        }
    }
}
