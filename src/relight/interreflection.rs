//! Light that reaches a surface from the object itself: one bounce, all reflection taken as diffuse.

use super::appearance::ShadingModel;
use super::evaluator::ShadowedLight;
use super::scene::{RenderObject, between};
use crate::mesh::Mesh;
use crate::surface::occluders::Occluders;
use crate::views::PointLight;
use glam::{DVec3, Vec3};
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
        let sent = |corners: ([u32; 3], Vec3), _: Vec3| between(corners, &sent);
        let received = gather(mesh, &Occluders::new(mesh), &cut.positions, normals, shading, sent);
        let (irradiance, radiance) = received.into_iter().unzip();
        Interreflection { irradiance, radiance }
    }
}

/// Returns the irradiance of the vertices of a mesh from the object itself under a light at a place. `visibility` is the share of the light that
/// reaches a point, by the cosine of its angle there.
pub(super) fn from_point_light(
    mesh: &Mesh,
    occluders: &Occluders,
    normals: &[Vec3],
    shading: &dyn ShadingModel,
    light: &PointLight,
    visibility: impl Fn(DVec3, f64) -> f64 + Sync + Send,
) -> Vec<Vec3> {
    let intensity = DVec3::from_array(light.intensity);
    let sent = |corners: ([u32; 3], Vec3), at: Vec3| {
        let normal = between(corners, normals).normalize_or_zero().as_dvec3();
        let towards = DVec3::from_array(light.position) - at.as_dvec3();
        let cosine = normal.dot(towards.normalize_or_zero());
        if cosine <= 0.0 {
            return Vec3::ZERO;
        }
        let reach = cosine * visibility(at.as_dvec3(), cosine) / towards.length_squared();
        (intensity * reach).as_vec3() / PI
    };
    let received = gather(mesh, occluders, &mesh.positions, normals, shading, sent);
    received.into_iter().map(|(irradiance, _)| irradiance).collect()
}

/// Casts rays from places with these normals; returns the irradiance that they bring, and the mean radiance of those that meet the object.
/// `sent` is the radiance of white at a place between three vertices of these weights.
fn gather(
    mesh: &Mesh,
    occluders: &Occluders,
    positions: &[[f32; 3]],
    normals: &[Vec3],
    shading: &dyn ShadingModel,
    sent: impl Fn(([u32; 3], Vec3), Vec3) -> Vec3 + Sync + Send,
) -> Vec<(Vec3, Vec3)> {
    let rays = (ALL_RAYS / normals.len().max(1)).clamp(RAYS[0], RAYS[1]);
    crate::parallel::map(normals.len(), |k| {
        let (position, normal) = (positions[k], normals[k]);
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
            let (triangle, weights) = (triangle as usize, weights.map(|w| w as f32));
            let corners = mesh.triangles[triangle];
            let at = (0..3).map(|i| Vec3::from_array(mesh.positions[corners[i] as usize]) * weights[i]).sum::<Vec3>();
            let sent = sent((corners, weights.into()), at);
            if sent != Vec3::ZERO {
                sum += shading.parameters_at(triangle, weights, at.to_array()).hemispherical() * sent;
            }
        }
        (sum * (PI / rays as f32), if hits > 0 { sum / hits as f32 } else { Vec3::ZERO })
    })
}
