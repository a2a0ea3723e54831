//! Spherical Gaussians throughout (Sonoda 2011, equations 13 and 15): the light's lobes for diffuse reflection, the material's lobes
//! against prefiltered maps for specular reflection.

#[cfg(feature = "encode")]
use super::appearance::ShadingModel;
use super::appearance::{Highlights, PreparedSpecular, ShadingParameters};
use super::environment_light::{PreparedEnvironment, exp, level_of, log2};
use super::evaluator::{Evaluator, ShadowedLight};
use super::occlusion::Occlusion;
use super::octahedral_map::to_square;
use super::scene::{RenderObject, ShadingPoint};
use crate::lighting::{EnvironmentLobes, SphericalGaussian};
use crate::sphere::gaussian::{CLAMPED_COSINE, half_space_share_wang};
use glam::Vec3;
use std::borrow::Cow;
use std::f32::consts::{LN_2, PI};
use std::sync::Arc;

/// The evaluator of [`super::EvaluatorKind::SphericalGaussian`].
pub(super) struct SgEvaluator<'a> {
    object: &'a RenderObject<'a>,
    light: Arc<EnvironmentLobes>,
    /// The light's maps as the renderer reads them.
    maps: Arc<PreparedEnvironment>,
    shadows: bool,
}

impl<'a> SgEvaluator<'a> {
    /// `environment` is taken for the light's maps where it is made of such.
    pub(super) fn new(
        object: &'a RenderObject<'a>,
        environment: Arc<PreparedEnvironment>,
        light: Arc<EnvironmentLobes>,
        shadows: bool,
    ) -> Self {
        let maps = match environment.is_stored {
            true => environment,
            false => Arc::new(PreparedEnvironment::from_prefiltered(&light.prefiltered)),
        };
        SgEvaluator { object, light, maps, shadows }
    }

    fn occlusion(&self) -> Option<&'a Occlusion> {
        self.object.occlusion.filter(|_| self.shadows)
    }

    /// The light's lobes.
    fn lobes(&self) -> impl Iterator<Item = SgLobe> {
        self.light.diffuse.iter().map(|lobe| SgLobe {
            axis: single(lobe.axis),
            sharpness: lobe.sharpness as f32,
            amplitude: single(lobe.amplitude),
        })
    }

    /// Specular reflection: the material's lobes, warped, times the clamped cosine, cut by the visibility, through the maps (15).
    fn specular(&self, point: &ShadingPoint, prepared: &PreparedSpecular) -> Vec3 {
        let occlusion = self.occlusion();
        let cosine = SphericalGaussian::clamped_cosine(point.normal.as_dvec3().to_array());
        let basis = point.basis_for(prepared);
        let outgoing = (basis.transpose() * point.outgoing).as_dvec3().to_array();
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
            let world = SphericalGaussian { axis: (basis * single(axis)).as_dvec3().to_array(), ..lobe };
            let product = cosine.product(&world);
            let distance = occlusion.map(|o| point.distance(o, to_square(single(product.axis))) as f64);
            let shadowed = match distance {
                Some(distance) => product.shadowed_wang(distance),
                None => product,
            };
            let mean = self.light.prefiltered_radiance(product.axis, product.sharpness);
            shine += smooth * single(shadowed.integral()) * Vec3::from_array(mean);
        }
        shine
    }

    /// Takes what is smooth beside the distribution at the mirror direction, and lobes as round.
    fn tabulated(&self, point: &ShadingPoint, prepared: &PreparedSpecular) -> Vec3 {
        let Some(table) = &prepared.table else { return self.specular(point, prepared) };
        let occlusion = self.occlusion();
        let cosine = point.normal.dot(point.outgoing).max(1e-4);
        let axis = 2.0 * cosine * point.normal - point.outgoing;
        let smooth = table.distribution(0.0) * table.remainder(0.0, cosine, 0.0) / (cosine * cosine) / prepared.peak;
        let mut sum = 0.0 * smooth;
        for &(sharpness, amplitude) in &prepared.lobes {
            let sharpness = sharpness / (4.0 * cosine);
            let (cosine_sharpness, cosine_amplitude) = (CLAMPED_COSINE.0 as f32, CLAMPED_COSINE.1 as f32);
            let together = (sharpness * axis + cosine_sharpness * point.normal) / (sharpness + cosine_sharpness);
            let length = together.length();
            let exponent = (sharpness + cosine_sharpness) * (length - 1.0);
            let (axis, sharpness) = (together / length, (sharpness + cosine_sharpness) * length);
            let whole = 2.0 * PI / sharpness * one_minus_exp(2.0 * sharpness);
            let square = to_square(axis);
            let log = log2(sharpness) * LN_2;
            let visible = occlusion.map_or(1.0, |o| {
                let distance = point.distance(o, square);
                half_space_share_wang(log, distance) / half_space_share_wang(log, 0.5 * PI)
            });
            let scale = amplitude * cosine_amplitude * exponent.exp() * whole * visible;
            sum += self.maps.filtered_radiance(square, level_of(sharpness)) * scale;
        }
        sum * smooth
    }
}

impl Evaluator for SgEvaluator<'_> {
    fn radiance(&self, point: &ShadingPoint, parameters: &ShadingParameters) -> [Vec3; 2] {
        let occlusion = self.occlusion();
        let distance = |axis: Vec3| occlusion.map(|occlusion| point.distance(occlusion, to_square(axis)));
        let irradiance: Vec3 = self.lobes().map(|lobe| lobe.irradiance(point.normal, distance)).sum();
        let shine: Vec3 = parameters.highlights.iter().map(|(scale, part)| scale * self.specular(point, part)).sum();
        let shine = shine * parameters.highlights.fresnel(point.normal.dot(point.outgoing).max(0.0));
        [parameters.diffuse(irradiance, Vec3::ZERO, point.normal.dot(point.outgoing)), shine]
    }

    fn sample_irradiance(&self) -> Cow<'_, [Vec3]> {
        let normals = &self.object.normals;
        let lobes: Vec<SgLobe> = self.lobes().collect();
        let occlusion = self.occlusion();
        Cow::Owned(crate::parallel::map(normals.len(), |place| {
            let (places, shares) = self.object.around_sample(place);
            let distance = |axis: Vec3| occlusion.map(|o| o.interpolated_distance(places, shares, to_square(axis)));
            lobes.iter().map(|lobe| lobe.irradiance(normals[place], distance)).sum()
        }))
    }

    fn tabulated_specular(&self, point: &ShadingPoint, highlights: &Highlights) -> Vec3 {
        let sum: Vec3 = highlights.iter().map(|(scale, part)| scale * self.tabulated(point, part)).sum();
        sum * highlights.fresnel(point.normal.dot(point.outgoing).max(1e-4))
    }

    /// Its diffuse light is summed at each point: what the object sends would have to be, too.
    #[cfg(feature = "encode")]
    fn add_interreflection(&mut self, _: &dyn ShadingModel) {}

    fn distant_lights(&self) -> &[ShadowedLight] {
        &[]
    }
}

/// A spherical Gaussian in single precision.
struct SgLobe {
    axis: Vec3,
    sharpness: f32,
    amplitude: Vec3,
}

impl SgLobe {
    /// Times the clamped cosine and cut by the visibility, whose signed distance is given for a direction (13):
    /// [`SphericalGaussian::product`] and [`SphericalGaussian::visible_wang`].
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

/// `1 - exp(-x)`.
#[inline]
fn one_minus_exp(x: f32) -> f32 {
    1.0 - exp(-x)
}

fn single(v: [f64; 3]) -> Vec3 {
    Vec3::from_array(v.map(|x| x as f32))
}
