//! Filtered importance sampling (Krivanek & Colbert 2008): specular light from several directions of the lobe, each read from a map that is
//! blurred as far as the direction's share of the lobe goes; diffuse light summed over the whole sphere at each sample of the surface; compact
//! sources apart, with exact shadows.

#[cfg(feature = "encode")]
use super::appearance::ShadingModel;
use super::appearance::{Highlights, PreparedSpecular, ShadingParameters};
use super::environment_light::{PreparedEnvironment, log2};
use super::evaluator::{Evaluator, ShadowedLight};
#[cfg(feature = "encode")]
use super::interreflection::Interreflection;
use super::occlusion::visibility_ramp;
use super::octahedral_map::{texel_direction, to_square};
#[cfg(feature = "encode")]
use super::scene::between;
use super::scene::{RenderObject, ShadingPoint};
use super::shadow::ShadowMap;
use crate::sphere::octahedral::solid_angles;
use glam::Vec3;
use std::borrow::Cow;
use std::f32::consts::PI;
use std::sync::Arc;

/// Side of the grid that diffuse light is summed over where there is no visibility with a grid of its own.
const SIDE: usize = 32;

/// The evaluator of [`super::EvaluatorKind::Filtered`].
pub(super) struct FilteredEvaluator<'a> {
    object: &'a RenderObject<'a>,
    environment: Arc<PreparedEnvironment>,
    shadows: bool,
    /// At every sample of the surface, without the distant lights.
    irradiance: Vec<Vec3>,
    lights: Vec<ShadowedLight>,
    /// Mean radiance of what blocks the light at each place with visibility; empty where it is taken for black.
    blocked_radiance: Vec<Vec3>,
}

impl<'a> FilteredEvaluator<'a> {
    pub(super) fn new(object: &'a RenderObject<'a>, environment: Arc<PreparedEnvironment>, shadows: bool) -> Self {
        let irradiance =
            irradiance(object, &object.normals, |sample| object.around_sample(sample), &environment, shadows);
        let (middle, radius) = object.mesh.bounding_sphere();
        let map = |direction: [f32; 3]| {
            let position = std::array::from_fn(|k| middle[k] + 40.0 * radius * direction[k] as f64);
            ShadowMap::for_distant_light(object.mesh, position)
        };
        let shadowed = |&light| ShadowedLight { light, map: if shadows { map(light.direction) } else { None } };
        let lights = environment.distant.iter().map(shadowed).collect();
        FilteredEvaluator { object, environment, shadows, irradiance, lights, blocked_radiance: Vec::new() }
    }

    /// Specular reflection of everything but the distant lights: half vectors drawn from the lobes, each with the light around its own
    /// direction averaged over the solid angle that it stands for. `brdf` gets the half vector, its cosine to either direction, and the
    /// incoming and outgoing direction, all in the tangent frame.
    #[inline]
    fn reflected(
        &self,
        point: &ShadingPoint,
        prepared: &PreparedSpecular,
        brdf: impl Fn(Vec3, f32, Vec3, Vec3) -> Vec3,
    ) -> Vec3 {
        let frame = point.basis_for(prepared);
        let outgoing = frame.transpose() * point.outgoing;
        let occlusion = self.object.occlusion.filter(|_| self.shadows);
        let count = prepared.taps.len() as f32;
        let is_black = self.blocked_radiance.is_empty();
        let blocked = if is_black { Vec3::ZERO } else { point.between_places(&self.blocked_radiance) };
        let mut sum = Vec3::ZERO;
        for &(half, density, level) in &prepared.taps {
            let cosine = half.dot(outgoing);
            let incoming = 2.0 * cosine * half - outgoing;
            if cosine <= 1e-4 || incoming.z <= 0.0 || half.z <= 0.0 {
                continue;
            }
            let world = frame * incoming;
            if self.shadows && point.geometric.dot(world) <= 0.0 {
                continue;
            }
            // Of i = 2 (o.h) h - o the density is that of h over 4 (o.h).
            let density = density / (4.0 * cosine) * count;
            let sharpness = 2.0 * PI * density;
            let square = to_square(world);
            let seen = occlusion.map_or(1.0, |o| visibility_ramp(point.distance(o, square), sharpness));
            if seen <= 0.0 && self.blocked_radiance.is_empty() {
                continue;
            }
            // The tap's level is that of the half vector's density; the turn to the reflected one makes it coarser.
            let light =
                seen * self.environment.filtered_radiance(square, level + 0.5 * log2(cosine)) + (1.0 - seen) * blocked;
            sum += light * brdf(half, cosine, incoming, outgoing) * (incoming.z / density);
        }
        sum
    }
}

impl Evaluator for FilteredEvaluator<'_> {
    fn radiance(&self, point: &ShadingPoint, parameters: &ShadingParameters) -> [Vec3; 2] {
        let irradiance = point.between_samples(&self.irradiance);
        let mut directed = Vec3::ZERO;
        let basis = point.basis();
        let outgoing = basis.transpose() * point.outgoing;
        let mut shine = Vec3::ZERO;
        for ShadowedLight { light, map } in &self.lights {
            let direction = Vec3::from_array(light.direction);
            let cosine = point.normal.dot(direction);
            if cosine <= 0.0 || (self.shadows && point.geometric.dot(direction) <= 0.0) {
                continue;
            }
            let visibility = map.as_ref().map_or(1.0, |map| {
                let (position, normal) = (point.position.as_dvec3(), point.geometric.as_dvec3());
                let radius = PreparedEnvironment::disc_radius(light);
                map.soft_visibility(position.to_array(), normal.to_array(), radius) as f32
            });
            let arriving = Vec3::from_array(light.irradiance) * (cosine * visibility);
            directed += arriving * parameters.entering(cosine);
            if visibility > 0.0 {
                let fresnel = parameters.highlights.fresnel(0.5 * (direction + point.outgoing).length());
                for (scale, part) in parameters.highlights.iter() {
                    shine += fresnel * scale * arriving * evaluate_brdf(part, basis.transpose() * direction, outgoing);
                }
            }
        }
        for (scale, part) in parameters.highlights.iter() {
            let reflected = |_, cosine, incoming, outgoing| {
                evaluate_brdf(part, incoming, outgoing) * parameters.highlights.fresnel(cosine)
            };
            shine += scale * self.reflected(point, part, reflected);
        }
        [parameters.diffuse(irradiance, directed, point.normal.dot(point.outgoing)), shine]
    }

    fn sample_irradiance(&self) -> Cow<'_, [Vec3]> {
        Cow::Borrowed(&self.irradiance)
    }

    fn tabulated_specular(&self, point: &ShadingPoint, highlights: &Highlights) -> Vec3 {
        let reflected = |(scale, part): (Vec3, &PreparedSpecular)| {
            scale
                * self.reflected(point, part, |half, cosine, incoming, outgoing| {
                    let value = match &part.table {
                        Some(table) => {
                            let sine = (1.0 - half.z * half.z).max(0.0).sqrt();
                            let value =
                                table.distribution(sine) * table.remainder(sine, cosine, incoming.z - outgoing.z);
                            value / (incoming.z * outgoing.z)
                        }
                        None => evaluate_brdf(part, incoming, outgoing),
                    };
                    value * highlights.fresnel(cosine)
                })
        };
        highlights.iter().map(reflected).sum()
    }

    #[cfg(feature = "encode")]
    fn add_interreflection(&mut self, shading: &dyn ShadingModel) {
        let object = self.object;
        let itself = |place: usize| ([place as u32; 3], Vec3::X);
        let at_places = match object.samples_are_places() {
            true => Cow::Borrowed(&self.irradiance),
            false => Cow::Owned(irradiance(object, object.place_normals(), itself, &self.environment, self.shadows)),
        };
        let received = Interreflection::new(object, shading, &at_places, &self.lights);
        for (sample, sum) in self.irradiance.iter_mut().enumerate() {
            *sum += between(object.around_sample(sample), &received.irradiance);
        }
        self.blocked_radiance = received.radiance;
    }

    fn distant_lights(&self) -> &[ShadowedLight] {
        &self.lights
    }
}

/// Returns the irradiance of surface points with these normals, from everything but the distant lights; `around` gives the places with
/// visibility around a point and their shares.
fn irradiance(
    object: &RenderObject,
    normals: &[Vec3],
    around: impl Fn(usize) -> ([u32; 3], Vec3) + Sync + Send,
    surround: &PreparedEnvironment,
    shadows: bool,
) -> Vec<Vec3> {
    let occlusion = object.occlusion.filter(|_| shadows);
    let side = occlusion.map_or(SIDE, |o| o.side());
    let cells = surround.cell_flux(side);
    let directions: Vec<Vec3> = (0..side * side).map(|k| texel_direction(side, k % side, k / side)).collect();
    // A cell as a lobe of its solid angle.
    let sharpness: Vec<f32> = solid_angles(side).into_iter().map(|a| 2.0 * PI / a as f32).collect();
    crate::parallel::map(normals.len(), |point| {
        let normal = normals[point];
        let (places, shares) = around(point);
        let mut sum = Vec3::ZERO;
        for k in 0..cells.len() {
            let cosine = normal.dot(directions[k]);
            if cosine <= 0.0 {
                continue;
            }
            let seen = occlusion
                .map_or(1.0, |o| visibility_ramp(o.cell_distance(places, shares, [k % side, k / side]), sharpness[k]));
            sum += cells[k] * (cosine * seen);
        }
        sum
    })
}

/// The reflection function between two directions in the tangent frame.
pub(super) fn evaluate_brdf(prepared: &PreparedSpecular, incoming: Vec3, outgoing: Vec3) -> Vec3 {
    let f = prepared.specular.brdf.evaluate(incoming.as_dvec3().to_array(), outgoing.as_dvec3().to_array());
    Vec3::from_array(f.map(|x| x as f32))
}
