//! Light that reaches a surface from the object itself: one bounce, all reflection taken as diffuse.

use super::appearance::ShadingModel;
use super::evaluator::ShadowedLight;
use super::scene::RenderObject;
use crate::surface::occluders::Occluders;
use glam::Vec3;
use std::borrow::Cow;
use std::f32::consts::PI;

/// Rays of a place, least and most, and of all places together.
const RAYS: [usize; 2] = [16, 128];
const ALL_RAYS: usize = 8 << 20;

/// What the object sends to the places of its surface.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Interreflection {
    /// Irradiance from the object, by place.
    pub(super) irradiance: Vec<Vec3>,
    /// Mean radiance of what blocks the light at a place; 0 where nothing does.
    pub(super) radiance: Vec<Vec3>,
}

impl Interreflection {
    /// Casts rays from each place of an object whose visibility is known. `irradiance` is that of its places without the distant `lights`.
    pub(super) fn new(
        object: &RenderObject,
        shading: &dyn ShadingModel,
        irradiance: &[Vec3],
        lights: &[ShadowedLight],
    ) -> Self {
        let mesh = object.base();
        let normals = object.place_normals();
        let cut = object.occlusion.map_or(Cow::Borrowed(mesh), |occlusion| occlusion.places().subdivided(mesh));
        let sent: Vec<Vec3> = crate::parallel::map(mesh.positions.len(), |vertex| {
            let (position, normal) = (Vec3::from_array(mesh.positions[vertex]), normals[vertex]);
            let distant = lights.iter().map(|ShadowedLight { light, map }| {
                let cosine = normal.dot(Vec3::from_array(light.direction)).max(0.0);
                let reach = match map {
                    Some(map) if cosine > 0.0 => map.visibility(position.as_dvec3().to_array(), cosine as f64) as f32,
                    _ => 1.0,
                };
                Vec3::from_array(light.irradiance) * (cosine * reach)
            });
            (irradiance[vertex] + distant.sum::<Vec3>()) / PI
        });
        let occluders = Occluders::new(mesh);
        let rays = (ALL_RAYS / normals.len().max(1)).clamp(RAYS[0], RAYS[1]);
        let received = crate::parallel::map(normals.len(), |k| {
            let (position, normal) = (cut.positions[k], normals[k]);
            let (tangent, bitangent) = normal.any_orthonormal_pair();
            let (mut sum, mut hits) = (Vec3::ZERO, 0);
            for ray in 0..rays {
                // Even over the disc, so that rays stand for equal shares of the irradiance; turned from place to place.
                let radius = ((ray as f32 + 0.5) / rays as f32).sqrt();
                let (sine, cosine) = (2.399_963_2 * ray as f32 + 2.618_034 * (k % 4096) as f32).sin_cos();
                let up = (1.0 - radius * radius).max(0.0).sqrt();
                let direction = tangent * (radius * cosine) + bitangent * (radius * sine) + normal * up;
                let Some((triangle, weights)) = occluders.first_hit_from(position, direction.to_array()) else {
                    continue;
                };
                hits += 1;
                let corners = mesh.triangles[triangle as usize];
                let weights = weights.map(|w| w as f32);
                let between =
                    |value: &dyn Fn(u32) -> Vec3| (0..3).map(|i| value(corners[i]) * weights[i]).sum::<Vec3>();
                let at = between(&|v| Vec3::from_array(mesh.positions[v as usize]));
                let reflectance = shading.parameters_at(triangle as usize, weights, at.to_array()).hemispherical();
                sum += reflectance * between(&|v| sent[v as usize]);
            }
            (sum * (PI / rays as f32), if hits > 0 { sum / hits as f32 } else { Vec3::ZERO })
        });
        let (irradiance, radiance) = received.into_iter().unzip();
        Interreflection { irradiance, radiance }
    }
}
