//! Reflection as Lambert's under a dielectric surface, and highlights as a sum of five GGX lobes of fixed roughness.
//!
//! Diffuse: `K_d E cos(theta_i) (1 - F(theta_i)) (1 - F(theta_r))` with Schlick's Fresnel term `F` (1994) of a refractive index of 1.5.
//! Specular: `E sum_k W_k D_k G_k / (4 cos(theta_r))`, Trowbridge-Reitz distribution `D` and Smith's `G` (Walter et al. 2007, equations
//! 33 and 34), with the light's irradiance `E`, times Schlick's Fresnel term over its value at normal incidence, the sum of the weights
//! ([`grazing_gain`]). Only `+ - * /` and square roots, so that every platform computes the same bits.

#[cfg(feature = "encode")]
pub(crate) mod equations;
#[cfg(feature = "encode")]
mod kinds;
#[cfg(feature = "encode")]
pub(crate) mod share;

use super::{ReflectionGeometry, TorranceSparrowLobe};

/// Number of lobes.
pub(crate) const LOBES: usize = 5;
/// Roughness `alpha` of each lobe. Part of the format.
pub(crate) const ROUGHNESS: [f64; LOBES] = [0.05, 0.09, 0.16, 0.28, 0.5];
/// Reflectance at normal incidence of the surface above the diffuse layer.
pub(crate) const NORMAL_REFLECTANCE: f64 = 0.04;
/// Smallest cosine of the view that a lobe is evaluated at.
const MIN_COS_VIEW: f64 = 0.05;

/// Share of the light that passes the surface at the cosine of an angle, `1 - F`, and its derivative.
#[inline(always)]
pub(crate) fn transmission(cosine: f64) -> (f64, f64) {
    let x = 1.0 - cosine.clamp(0.0, 1.0);
    let fourth = x * x * x * x;
    let scale = 1.0 - NORMAL_REFLECTANCE;
    (scale - scale * fourth * x, 5.0 * scale * fourth)
}

/// Cosines at a surface point: of the angles between normal and light, normal and view, normal and half vector.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct LobeCosines {
    pub light: f64,
    pub view: f64,
    pub half: f64,
}

impl From<&ReflectionGeometry> for LobeCosines {
    fn from(geometry: &ReflectionGeometry) -> Self {
        let [light, view, half] = [geometry.cos_light, geometry.cos_view, geometry.cos_half].map(f64::from);
        LobeCosines { light, view, half }
    }
}

/// Values of the lobes: radiance for an irradiance of 1 and a weight of 1. The light and the view are above the surface.
#[inline]
pub(crate) fn lobe_values(cosines: &LobeCosines) -> [f64; LOBES] {
    let view = if cosines.view < MIN_COS_VIEW { MIN_COS_VIEW } else { cosines.view };
    std::array::from_fn(|k| {
        let [a, rest] = [ROUGHNESS[k] * ROUGHNESS[k], 1.0 - ROUGHNESS[k] * ROUGHNESS[k]];
        let t = 1.0 - cosines.half * cosines.half * rest;
        let light_root = (a + rest * cosines.light * cosines.light).sqrt();
        let view_root = (a + rest * view * view).sqrt();
        a / (std::f64::consts::PI * t * t) * (cosines.light / (cosines.light + light_root)) / (view + view_root)
    })
}

/// Specular radiance of a light at a surface point, for the weights of each lobe; zero where light or view is behind the surface.
pub(crate) fn evaluate(weights: &[[f32; 3]; LOBES], geometry: &ReflectionGeometry) -> [f32; 3] {
    if geometry.cos_light <= 0.0 || geometry.cos_view <= 0.0 {
        return [0.0; 3];
    }
    let values = lobe_values(&LobeCosines::from(geometry));
    let (gain, share) = (grazing_gain(weights), grazing_share(geometry.cos_difference));
    std::array::from_fn(|c| {
        let sum: f64 = (0..LOBES).map(|k| weights[k][c] as f64 * values[k]).sum();
        (sum * (1.0 + gain[c] as f64 * share as f64) * geometry.irradiance[c] as f64) as f32
    })
}

/// How much more than along the normal a surface reflects at grazing incidence: of Schlick's Fresnel term `F0 + (1 - F0) s`, with the sum of
/// the weights for `F0`, what stands before `s` over `F0`. As `F0` at least that of a dielectric surface is taken.
pub(crate) fn grazing_gain(weights: &[[f32; 3]; LOBES]) -> [f32; 3] {
    std::array::from_fn(|c| {
        let sum = (0..LOBES).fold(0.0, |sum, k| sum + weights[k][c]);
        let normal = if sum > NORMAL_REFLECTANCE as f32 { sum } else { NORMAL_REFLECTANCE as f32 };
        if normal < 1.0 { 1.0 / normal - 1.0 } else { 0.0 }
    })
}

/// The share `s = (1 - cos)^5` of Schlick's Fresnel term, by the cosine between the half vector and either direction.
#[inline(always)]
pub(crate) fn grazing_share(cos_difference: f32) -> f32 {
    let x = 1.0 - cos_difference;
    let squared = x * x;
    squared * squared * x
}

/// Factor of Lambert's model for light that enters and leaves a diffuse layer through its surface.
pub(crate) fn layer_factor(geometry: &ReflectionGeometry) -> f32 {
    (transmission(geometry.cos_light as f64).0 * transmission(geometry.cos_view as f64).0) as f32
}

/// Share of an even light from all around that passes the surface: the mean of [`transmission`], weighted by the cosine.
pub(crate) const MEAN_TRANSMISSION: f32 = 0.9142857;

/// Returns the lobe of Torrance and Sparrow with the weights' energy and mean width, for what takes one lobe only.
pub(crate) fn single_lobe(weights: &[[f32; 3]; LOBES]) -> TorranceSparrowLobe {
    // Half the peak's height at the same angle as a GGX lobe.
    const WIDTH: f64 = 0.5466;
    let energy: [f64; LOBES] = std::array::from_fn(|k| weights[k].iter().map(|&w| w as f64).sum());
    let total: f64 = energy.iter().sum();
    if total <= 0.0 {
        return TorranceSparrowLobe { specular: [0.0; 3], sigma: (WIDTH * ROUGHNESS[2]) as f32 };
    }
    let sigma = (0..LOBES).map(|k| energy[k] * WIDTH * ROUGHNESS[k]).sum::<f64>() / total;
    let scale = 1.0 / (8.0 * std::f64::consts::PI * sigma * sigma);
    let specular = std::array::from_fn(|c| ((0..LOBES).map(|k| weights[k][c] as f64).sum::<f64>() * scale) as f32);
    TorranceSparrowLobe { specular, sigma: sigma as f32 }
}

/// Returns the weighted sum of the lobes and its derivatives by the three cosines.
#[inline]
pub(crate) fn weighted_lobes(cosines: &LobeCosines, weights: &[f32; LOBES]) -> (f64, LobeCosines) {
    let view = if cosines.view < MIN_COS_VIEW { MIN_COS_VIEW } else { cosines.view };
    let (mut sum, mut slope) = (0.0, LobeCosines::default());
    for k in 0..LOBES {
        let [a, rest] = [ROUGHNESS[k] * ROUGHNESS[k], 1.0 - ROUGHNESS[k] * ROUGHNESS[k]];
        let t = 1.0 - cosines.half * cosines.half * rest;
        let light_root = (a + rest * cosines.light * cosines.light).sqrt();
        let view_root = (a + rest * view * view).sqrt();
        let [lit, seen] = [cosines.light + light_root, view + view_root];
        let distribution = weights[k] as f64 * a / (std::f64::consts::PI * t * t);
        let value = distribution * (cosines.light / lit) / seen;
        sum += value;
        slope.half += value * 4.0 * cosines.half * rest / t;
        slope.light += distribution * a / (light_root * lit * lit) / seen;
        slope.view -= value * (1.0 + rest * view / view_root) / seen;
    }
    (sum, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grazing_light_is_reflected_whole() {
        let mut weights = [[0.0f32; 3]; LOBES];
        weights[1] = [0.02, 0.3, 0.9];
        weights[3] = [0.03, 0.2, 0.6];
        let gain = grazing_gain(&weights);
        for (gain, expected) in gain.into_iter().zip([1.0 / 0.05, 1.0 / 0.5, 1.0]) {
            assert!((1.0 + gain * grazing_share(0.0) - expected).abs() < 1e-5 * expected && grazing_share(1.0) == 0.0);
        }
        // Schlick's term in between, and no more than a dielectric's where hardly anything was seen.
        assert!((1.0 + gain[0] * grazing_share(0.5) - (0.05 + 0.95 / 32.0) / 0.05).abs() < 1e-4);
        assert!((grazing_gain(&[[0.0; 3]; LOBES])[0] - 24.0).abs() < 1e-4);
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        let weights = [0.02, 0.1, 0.0, 0.3, 0.2];
        let value = |c: &LobeCosines| {
            lobe_values(c).iter().zip(&weights).map(|(value, weight)| value * *weight as f64).sum::<f64>()
        };
        let at = LobeCosines { light: 0.8, view: 0.55, half: 0.97 };
        let (sum, slope) = weighted_lobes(&at, &weights);
        assert!((sum - value(&at)).abs() < 1e-12);
        let h = 1e-6;
        let by = |change: fn(&mut LobeCosines, f64)| {
            let [mut low, mut high] = [at; 2];
            change(&mut low, -h);
            change(&mut high, h);
            (value(&high) - value(&low)) / (2.0 * h)
        };
        for (expected, found) in [
            (by(|c, h| c.light += h), slope.light),
            (by(|c, h| c.view += h), slope.view),
            (by(|c, h| c.half += h), slope.half),
        ] {
            assert!((expected - found).abs() < 1e-5 * expected.abs(), "{expected} {found}");
        }
        let (low, high) = (transmission(0.5 - h).0, transmission(0.5 + h).0);
        assert!(((high - low) / (2.0 * h) - transmission(0.5).1).abs() < 1e-6);
    }
}
