//! The published evaluator (Sonoda 2011, equations 13 and 15): spherical Gaussians throughout.

use super::appearance::{PreparedSpecular, ShadingParameters};
use super::environment_light::{exp, log2};
use super::octahedral_map::to_square;
use super::scene::{EnvironmentScene, ShadingPoint};
use crate::lighting::SphericalGaussian;
use crate::sphere::gaussian::{CLAMPED_COSINE, half_space_share_wang};
use glam::Vec3;
use std::f32::consts::{LN_2, PI};

/// Radiance towards the camera, diffuse and specular.
pub(super) fn radiance(scene: &EnvironmentScene, point: &ShadingPoint, appearance: &ShadingParameters) -> [Vec3; 2] {
    let irradiance = irradiance_at(scene, point.normal, point.places, point.shares);
    let specular = appearance.specular.filter(|_| appearance.specular_scale.max_element() > 0.0);
    let shine = specular.map_or(Vec3::ZERO, |prepared| reflected(scene, point, prepared));
    [appearance.albedo * irradiance / PI, appearance.specular_scale * shine]
}

/// Irradiance of every place.
pub(super) fn irradiance(scene: &EnvironmentScene) -> Vec<Vec3> {
    let normals = &scene.object.normals;
    let lobes: Vec<SgLobe> = lobes(scene).collect();
    let occlusion = scene.object.occlusion.filter(|_| scene.options.shadows);
    crate::parallel::map(normals.len(), |place| {
        let distance = |axis: Vec3| occlusion.map(|occlusion| occlusion.place_distance(place, to_square(axis)));
        lobes.iter().map(|lobe| lobe.irradiance(normals[place], distance)).sum()
    })
}

/// Irradiance between places.
fn irradiance_at(scene: &EnvironmentScene, normal: Vec3, places: [u32; 3], shares: Vec3) -> Vec3 {
    let occlusion = scene.object.occlusion.filter(|_| scene.options.shadows);
    let distance = |axis: Vec3| occlusion.map(|occlusion| occlusion.distance_towards(places, shares, axis));
    lobes(scene).map(|lobe| lobe.irradiance(normal, distance)).sum()
}

/// The light's lobes.
fn lobes(scene: &EnvironmentScene) -> impl Iterator<Item = SgLobe> {
    scene.light.into_iter().flat_map(|light| &light.diffuse).map(|lobe| SgLobe {
        axis: single(lobe.axis),
        sharpness: lobe.sharpness as f32,
        amplitude: single(lobe.amplitude),
    })
}

/// A spherical Gaussian in single precision.
struct SgLobe {
    axis: Vec3,
    sharpness: f32,
    amplitude: Vec3,
}

impl SgLobe {
    /// Times the clamped cosine and cut by the visibility, whose signed distance is given for a direction (13):
    /// [`SphericalGaussian::product`] and [`SphericalGaussian::visible_published`].
    #[inline]
    fn irradiance(&self, normal: Vec3, distance: impl Fn(Vec3) -> Option<f32>) -> Vec3 {
        let (cosine_sharpness, cosine_amplitude) = (CLAMPED_COSINE.0 as f32, CLAMPED_COSINE.1 as f32);
        let sum = cosine_sharpness * normal + self.sharpness * self.axis;
        let product = sum.length().max(1e-3);
        // Of the lengths' difference, without cancellation.
        let both = cosine_sharpness + self.sharpness;
        let exponent = 2.0 * cosine_sharpness * self.sharpness * (normal.dot(self.axis) - 1.0) / (product + both);
        let share = match distance(sum / product) {
            Some(distance) => half_space_share_wang(log2(product) * LN_2, distance) * one_minus_exp(product),
            None => one_minus_exp(2.0 * product),
        };
        self.amplitude * (cosine_amplitude * exp(exponent) * share * 2.0 * PI / product)
    }
}

/// Specular reflection: the material's lobes, warped, times the clamped cosine, cut by the visibility, through the levels (15).
pub(super) fn reflected(scene: &EnvironmentScene, point: &ShadingPoint, prepared: &PreparedSpecular) -> Vec3 {
    let Some(light) = scene.light else { return Vec3::ZERO };
    let occlusion = scene.object.occlusion.filter(|_| scene.options.shadows);
    let cosine = SphericalGaussian::clamped_cosine(point.normal.as_dvec3().to_array());
    let frame = point.basis();
    let outgoing = (frame.transpose() * point.outgoing).as_dvec3().to_array();
    let mut shine = Vec3::ZERO;
    for lobe in prepared.specular.lobes.iter().flat_map(|lobe| lobe.warp_isotropic(outgoing)) {
        let axis = lobe.axis;
        if axis[2] <= 0.0 {
            continue;
        }
        // What is smooth beside the distribution, at the axis: masking, Fresnel's term.
        let half = std::array::from_fn(|k| axis[k] + outgoing[k]);
        let length = half.iter().map(|x: &f64| x * x).sum::<f64>().sqrt().max(1e-12);
        let half = half.map(|x| x / length);
        let distribution: f64 = prepared.specular.lobes.iter().map(|l| l.evaluate(half)).sum();
        let smooth = single(prepared.specular.brdf.evaluate(axis, outgoing)) / distribution.max(1e-30) as f32;
        let world = SphericalGaussian { axis: (frame * single(axis)).as_dvec3().to_array(), ..lobe };
        let product = cosine.product(&world);
        let distance = occlusion.map(|o| o.distance_towards(point.places, point.shares, single(product.axis)) as f64);
        let shadowed = match distance {
            Some(distance) => product.shadowed_wang(distance),
            None => product,
        };
        let mean = light.prefiltered_radiance(product.axis, product.sharpness);
        shine += smooth * single(shadowed.integral()) * Vec3::from_array(mean);
    }
    shine
}

/// `1 - exp(-x)`.
#[inline]
pub(super) fn one_minus_exp(x: f32) -> f32 {
    1.0 - exp(-x)
}

fn single(v: [f64; 3]) -> Vec3 {
    Vec3::from_array(v.map(|x| x as f32))
}
