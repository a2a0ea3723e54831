//! The metallic-roughness model of glTF (appendix B of its specification, with `KHR_materials_specular`).

use crate::brdf::Brdf;
use crate::{Error, Result};
use std::f64::consts::PI;

/// Reflectance at normal incidence of every dielectric whose `ior` is not said.
pub(crate) const DIELECTRIC: f64 = 0.04;
/// Least `alpha = roughness^2`: viewers clamp about here.
pub(crate) const MIN_ALPHA: f64 = 0.002;

/// A glTF material at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Microfacets {
    /// Base colour, linear, 0 to 1.
    pub base_colour: [f64; 3],
    /// 0 dielectric, 1 metal.
    pub metallic: f64,
    /// Perceptual roughness, 0 to 1; its square is the width `alpha` of the distribution.
    pub roughness: f64,
    /// Colour of the dielectric's reflection in units of 0.04, linear (`specularColorFactor` times its texture).
    pub specular_colour: [f64; 3],
}

impl Microfacets {
    /// Checks that every parameter is within its range.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if one is not.
    pub fn check(&self) -> Result<()> {
        let Microfacets { base_colour, metallic, roughness, specular_colour } = self;
        let shares = base_colour.iter().chain([metallic, roughness]);
        if shares.into_iter().all(|x| (0.0..=1.0).contains(x))
            && specular_colour.iter().all(|x| (0.0..=1e6).contains(x))
        {
            return Ok(());
        }
        let message =
            "metallic-roughness: base colour, metalness and roughness are 0 to 1, the specular colour 0 to 1000000";
        Err(Error::parameter(message))
    }
}

impl Brdf for Microfacets {
    /// Trowbridge-Reitz distribution, Smith's masking with both directions correlated, Schlick's Fresnel term.
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let (cos_in, cos_out) = (incoming[2], outgoing[2]);
        if cos_in <= 0.0 || cos_out <= 0.0 {
            return [0.0; 3];
        }
        let sum: [f64; 3] = std::array::from_fn(|k| incoming[k] + outgoing[k]);
        let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
        let cos_half = sum[2] / length;
        let out_half = (0..3).map(|k| outgoing[k] * sum[k]).sum::<f64>() / length;
        let square = (self.roughness * self.roughness).max(MIN_ALPHA).powi(2);
        let bottom = cos_half * cos_half * (square - 1.0) + 1.0;
        let distribution = square / (PI * bottom * bottom);
        let masking = |one: f64, other: f64| one * (other * other * (1.0 - square) + square).sqrt();
        let specular = distribution * 0.5 / (masking(cos_in, cos_out) + masking(cos_out, cos_in));
        let grazing = (1.0 - out_half.abs()).max(0.0).powi(5);
        let fresnel = |normal: f64| normal + (1.0 - normal) * grazing;
        let dielectric = self.specular_colour.map(|s| fresnel((DIELECTRIC * s).min(1.0)));
        let passed = 1.0 - dielectric.iter().fold(0.0f64, |a, &b| a.max(b));
        std::array::from_fn(|c| {
            let plastic = self.base_colour[c] / PI * passed + specular * dielectric[c];
            let metal = specular * fresnel(self.base_colour[c]);
            let value = plastic + self.metallic * (metal - plastic);
            if value.is_finite() { value } else { 0.0 }
        })
    }
}
