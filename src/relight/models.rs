//! Reflection functions of files: the specular model of reflectance maps, and measured materials taken apart.

use crate::brdf::Brdf;
use crate::brdf::{ClassicalLobe, HalfDifference, ScatteringAngles};
use crate::reflectance::lobes::{self, LobeCosines};
use crate::reflectance::palette::PaletteTables;
use std::sync::Arc;

/// `exp(-alpha^2 / (2 sigma^2)) / ((n.i) (n.o))` (Miyazaki 2007, equation 8, over the irradiance of the surface).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorranceSparrow {
    /// `sigma`, radians.
    pub sigma: f64,
}

impl Brdf for TorranceSparrow {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        let lobe = ClassicalLobe::TorranceSparrow { sigma: self.sigma };
        lobe.evaluate(&ScatteringAngles::from_directions(incoming, outgoing))
    }
}

/// A GGX lobe of fixed roughness and the weight 1: see [`crate::reflectance::lobes`].
#[derive(Debug, Clone, Copy)]
pub(super) struct GgxLobe {
    /// Number of the lobe, below [`lobes::LOBES`].
    pub(super) lobe: usize,
}

impl Brdf for GgxLobe {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let (light, view) = (incoming[2], outgoing[2]);
        if light <= 0.0 || view <= 0.0 {
            return [0.0; 3];
        }
        let half = glam::DVec3::from_array(incoming) + glam::DVec3::from_array(outgoing);
        let cosines = LobeCosines { light, view, half: half.z / half.length() };
        [lobes::lobe_values(&cosines)[self.lobe] / light; 3]
    }
}

/// The shape that a palette of measured lobes gives highlights of one width.
#[derive(Debug, Clone)]
pub(super) struct PaletteHighlight {
    /// Not empty.
    pub(super) palette: Arc<PaletteTables>,
    /// `sigma`, radians, above 0.
    pub(super) sigma: f32,
}

impl Brdf for PaletteHighlight {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        let angles = HalfDifference::from_directions(incoming, outgoing);
        self.palette.shape(self.sigma, angles.theta_h, angles.theta_d)
    }
}

/// A function without its Lambertian part.
struct WithoutConstantPart {
    brdf: Box<dyn Brdf + Send>,
    constant: [f64; 3],
}

impl Brdf for WithoutConstantPart {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let f = self.brdf.evaluate(incoming, outgoing);
        std::array::from_fn(|c| (f[c] - self.constant[c]).max(0.0))
    }
}

/// A function as the albedo of its Lambertian part, for each colour its least value up to 75 degrees from the normal, and what is left.
pub(super) fn split_constant_part(brdf: Box<dyn Brdf + Send>) -> ([f64; 3], Box<dyn Brdf + Send>) {
    const STEPS: usize = 7;
    let direction = |theta: f64, phi: f64| [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
    let angle = |k: usize| (75.0 * k as f64 / (STEPS - 1) as f64).to_radians();
    let mut least = [f64::INFINITY; 3];
    for k in 0..STEPS * STEPS * STEPS {
        let phi = std::f64::consts::PI * (k / STEPS / STEPS) as f64 / (STEPS - 1) as f64;
        let f = brdf.evaluate(direction(angle(k % STEPS), 0.0), direction(angle(k / STEPS % STEPS), phi));
        (0..3).for_each(|c| least[c] = least[c].min(f[c]));
    }
    let least = least.map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 });
    (least.map(|x| x * std::f64::consts::PI), Box::new(WithoutConstantPart { brdf, constant: least }))
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::brdf::BrdfSample;
    use crate::brdf::dsbrdf::{DsbrdfFitOptions, fit_dsbrdf};
    use crate::reflectance::palette::{self, PaletteEntry};
    use crate::reflectance::{ReflectionGeometry, TorranceSparrowLobe};
    use crate::views::PointLight;

    /// An environment's light goes through the same function as a point light's.
    #[test]
    fn palettes_reflect_point_lights_and_environments_alike() {
        let model = |sigma: f64| {
            let samples = BrdfSample::tabulate(&TorranceSparrow { sigma }, [60, 12, 3]);
            fit_dsbrdf(&samples, &DsbrdfFitOptions { slices: 6, min_theta_h_deg: 0.0, ..DsbrdfFitOptions::default() })
                .unwrap()
        };
        let palette =
            vec![PaletteEntry { level: 90, lobes: model(0.07) }, PaletteEntry { level: 170, lobes: model(0.23) }];
        for sigma in [0.05f32, 0.12, 0.4] {
            let highlight = PaletteHighlight { palette: Arc::new(PaletteTables::new(&palette)), sigma };
            let lobe = TorranceSparrowLobe { specular: [1.0, 0.5, 0.25], sigma };
            for (o, i) in [([0.1, 0.2, 0.9f64], [0.0, -0.1, 1.0f64]), ([0.6, 0.0, 0.7], [-0.4, 0.1, 0.8])] {
                let light = PointLight { position: i, intensity: [3.0; 3] };
                let geometry = ReflectionGeometry::new([0.0; 3], [0.0, 0.0, 1.0], o, &light);
                let seen = palette::evaluate(&palette, &lobe, &geometry);
                let unit = |v: [f64; 3]| {
                    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
                    v.map(|x| x / length)
                };
                let (f, cosine) = (highlight.evaluate(unit(i), unit(o)), geometry.cos_light as f64);
                for c in 0..3 {
                    let expected = lobe.specular[c] as f64 * geometry.irradiance[c] as f64 * cosine * f[c];
                    assert!(expected > 0.0 && (seen[c] as f64 / expected - 1.0).abs() < 0.01, "{seen:?} {expected}");
                }
            }
            assert_eq!(highlight.evaluate([0.0, 0.0, 1.0], [0.6, 0.0, -0.8]), [0.0; 3]);
        }
    }
}
