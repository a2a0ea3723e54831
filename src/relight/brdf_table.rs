//! A specular reflection function as tables in single precision, for images in motion.
//!
//! `f = D(h) R / ((n.i) (n.o))`: `D` over the half vector's angle finely, what is left, `R`, coarsely over the half vector's angle, the
//! difference angle and the azimuth of the latter, where it is smooth for every model whose peak lies in `D`.

use crate::brdf::Brdf;
use glam::Vec3;

/// Places over the square root of the half vector's sine, of `D` and of `R`.
const FINE: usize = 768;
const HALF: usize = 24;
/// Places of `R` over the cosine of the difference angle, and over the cosine of its azimuth.
const DIFFERENCE: usize = 16;
const AZIMUTH: usize = 6;
/// Least cosine of a direction at which the function is looked at.
const MIN_COSINE: f64 = 2e-3;

/// The tables of an isotropic function.
pub(super) struct SpecularTable {
    distribution: Vec<f32>,
    /// By azimuth, then difference, then half vector, slowest to fastest.
    remainder: Vec<Vec3>,
    /// Greatest number of `rest`.
    max_remainder: f32,
}

/// Largest relative error (root mean square) with which tables are used.
const MAX_ERROR: f64 = 0.02;

impl SpecularTable {
    /// `None` for functions that change when the surface is turned about its normal, or that the tables miss by more than 2 %.
    pub(super) fn new(brdf: &dyn Brdf) -> Option<Self> {
        if !is_isotropic(brdf) {
            return None;
        }
        let fine = |k: usize| (k as f64 / (FINE - 1) as f64).powi(2);
        let distribution: Vec<f64> = (0..FINE)
            .map(|k| {
                let places = [(0.98, 0.0), (0.9, 0.5), (0.7, 0.0), (0.7, 1.0), (0.45, 0.5)];
                places.iter().map(|&(cosine, azimuth)| sample(brdf, fine(k), cosine, azimuth).element_sum()).sum()
            })
            .collect();
        let at = |sine: f64| {
            let place = sine.sqrt() * (FINE - 1) as f64;
            let first = (place as usize).min(FINE - 2);
            distribution[first] + (place - first as f64) * (distribution[first + 1] - distribution[first])
        };
        let mut rest = Vec::with_capacity(HALF * DIFFERENCE * AZIMUTH);
        for azimuth in 0..AZIMUTH {
            for difference in 0..DIFFERENCE {
                for half in 0..HALF {
                    let share = |k: usize, of: usize| k as f64 / (of - 1) as f64;
                    let sine = share(half, HALF).powi(2);
                    let d = at(sine);
                    let value = sample(brdf, sine, share(difference, DIFFERENCE), share(azimuth, AZIMUTH));
                    rest.push(if d > 1e-30 { (value / d).as_vec3() } else { Vec3::ZERO });
                }
            }
        }
        let most = rest.iter().map(|r| r.max_element()).fold(0.0, f32::max);
        let distribution = distribution.into_iter().map(|d| d as f32).collect();
        let gloss = SpecularTable { distribution, remainder: rest, max_remainder: most };
        (gloss.error(brdf) < MAX_ERROR).then_some(gloss)
    }

    /// Root mean square error over the root mean square of `f (n.i) (n.o)`, half of the pairs of directions near the mirror's.
    fn error(&self, brdf: &dyn Brdf) -> f64 {
        let (mut wrong, mut all) = (0.0, 1e-30);
        for k in 0..400 {
            let at = |step: f64| (k as f64 * step).fract();
            let (theta_i, theta_o) = (1.4 * at(0.7549), 1.4 * at(0.5698));
            let phi = std::f64::consts::PI * (1.0 - at(0.6180) * if k % 2 == 0 { 0.1 } else { 1.0 });
            let i = [theta_i.sin(), 0.0, theta_i.cos()];
            let o = [theta_o.sin() * phi.cos(), theta_o.sin() * phi.sin(), theta_o.cos()];
            let exact = glam::DVec3::from_array(brdf.evaluate(i, o)) * (i[2] * o[2]);
            let h = glam::DVec3::new(i[0] + o[0], i[1] + o[1], i[2] + o[2]);
            let (sine, cosine) = ((h.x.hypot(h.y) / h.length()) as f32, (0.5 * h.length()) as f32);
            let found = self.distribution(sine) * self.remainder(sine, cosine, (i[2] - o[2]) as f32);
            wrong += (found.as_dvec3() - exact).length_squared();
            all += exact.length_squared();
        }
        (wrong / all).sqrt()
    }

    /// Greatest number that [`Self::remainder`] gives.
    pub(super) fn max_remainder(&self) -> f32 {
        self.max_remainder
    }

    /// `D` for the sine of the half vector's angle.
    #[inline]
    pub(super) fn distribution(&self, sine: f32) -> f32 {
        let place = sine.sqrt() * (FINE - 1) as f32;
        let first = (place as usize).min(FINE - 2);
        self.distribution[first] + (place - first as f32) * (self.distribution[first + 1] - self.distribution[first])
    }

    /// `R`, by the sine of the half vector's angle, the cosine of the difference angle and the difference of both directions' cosines to
    /// the normal.
    #[inline]
    pub(super) fn remainder(&self, sine: f32, cos_difference: f32, cosines_apart: f32) -> Vec3 {
        let sin_difference = (1.0 - cos_difference * cos_difference).max(0.0).sqrt();
        let azimuth = cosines_apart.abs() / (2.0 * sine * sin_difference).max(1e-9);
        let place = |t: f32, of: usize| {
            let t = t.clamp(0.0, 1.0) * (of - 1) as f32;
            let first = (t as usize).min(of - 2);
            (first, t - first as f32)
        };
        let ((h, a), (d, b), (z, c)) =
            (place(sine.sqrt(), HALF), place(cos_difference, DIFFERENCE), place(azimuth, AZIMUTH));
        let first = (z * DIFFERENCE + d) * HALF + h;
        let line = |at: usize| self.remainder[at] + (self.remainder[at + 1] - self.remainder[at]) * a;
        let plane = |at: usize| line(at) * (1.0 - b) + line(at + HALF) * b;
        plane(first) * (1.0 - c) + plane(first + DIFFERENCE * HALF) * c
    }
}

/// `f (n.i) (n.o)` at a half vector's sine, cosine of the difference angle, and cosine of its azimuth; beyond the horizon at the azimuth
/// that is still above it. The mean of both orders of the directions.
fn sample(brdf: &dyn Brdf, sine: f64, cos_difference: f64, azimuth: f64) -> glam::DVec3 {
    let sine = sine.min(1.0 - 1e-5);
    let cosine = (1.0 - sine * sine).sqrt();
    let cos_difference = cos_difference.clamp(MIN_COSINE / cosine.max(0.05), 1.0);
    let sin_difference = (1.0 - cos_difference * cos_difference).sqrt();
    let limit = ((cosine * cos_difference - MIN_COSINE) / (sine * sin_difference).max(1e-9)).max(0.0);
    let x = azimuth.min(limit);
    let y = (1.0 - x * x).max(0.0).sqrt();
    // About the half vector, then turned by its angle in the plane of x and z.
    let turned = |d: [f64; 3]| [cosine * d[0] + sine * d[2], d[1], cosine * d[2] - sine * d[0]];
    let i = turned([sin_difference * x, sin_difference * y, cos_difference]);
    let o = turned([-sin_difference * x, -sin_difference * y, cos_difference]);
    let both = [brdf.evaluate(i, o), brdf.evaluate(o, i)].map(glam::DVec3::from_array);
    let mean = 0.5 * (both[0] + both[1]) * (i[2] * o[2]);
    if mean.is_finite() { mean } else { glam::DVec3::ZERO }
}

fn is_isotropic(brdf: &dyn Brdf) -> bool {
    let direction = |theta: f64, phi: f64| [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
    let value = |turn: f64, theta: f64| brdf.evaluate(direction(theta, turn), direction(0.3, turn + 2.0))[1];
    [0.1, 0.35, 0.6].into_iter().all(|theta| {
        let first = value(0.0, theta);
        [0.8, 1.6, 2.3].into_iter().all(|turn| (value(turn, theta) - first).abs() <= 1e-6 * (first.abs() + 1e-12))
    })
}

#[cfg(test)]
mod tests {
    use crate::brdf::models::{ClassicalLobe, ClassicalModel};
    use crate::relight::brdf_table::*;

    #[test]
    fn tables_are_the_function() {
        let model = |lobe: ClassicalLobe| ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe };
        for lobe in [
            ClassicalLobe::BlinnPhong { exponent: 60.0 },
            ClassicalLobe::CookTorranceBeckmann { roughness: 0.12, reflectance: 0.7 },
            ClassicalLobe::CookTorranceBeckmann { roughness: 0.35, reflectance: 0.04 },
            ClassicalLobe::CookTorranceGgx { roughness: 0.2, reflectance: 0.5 },
            ClassicalLobe::Ward { roughness: 0.2 },
        ] {
            let model = model(lobe);
            let gloss = SpecularTable::new(&model).unwrap();
            let error = gloss.error(&model);
            assert!(error < 0.015, "{:?}: {error}", model.lobe);
        }
        assert!(SpecularTable::new(&model(ClassicalLobe::WardAnisotropic { roughness: [0.1, 0.3] })).is_none());
    }
}
