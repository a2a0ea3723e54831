//! Light of a lamp that comes to a captured object from its own parts.

use super::appearance::ShadingModel;
use super::prepared_asset::{PreparedAsset, SurfacePoint};
use super::scene::between;
use super::shadow::ShadowMap;
use crate::views::{Camera, Component, PointLight};
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Share of it that the diffuse layer, fitted to photographs that hold such light, too, has where the lamp lights a place.
const HELD_BY_DIFFUSE: f32 = 0.5;
/// Lamps under which it is kept for further images, at most.
#[cfg(feature = "encode")]
const MAX_KEPT: usize = 4;

/// What an object sends to itself under one lamp.
pub(super) struct ObjectLight {
    /// Irradiance of the mesh's vertices.
    irradiance: Arc<[Vec3]>,
}

impl ObjectLight {
    /// Finds it among that of the last lamps, or casts the rays; `None` of an object without reflectance.
    #[cfg(feature = "encode")]
    pub(super) fn under(renderer: &PreparedAsset, light: &PointLight, map: Option<&ShadowMap>) -> Option<Self> {
        let last = || renderer.object_light.lock().ok();
        let found = last()?.iter().find(|(known, _)| known == light).map(|(_, own)| own.clone());
        if let Some(irradiance) = found {
            return Some(ObjectLight { irradiance });
        }
        let visibility = |at: DVec3, cosine: f64| map.map_or(1.0, |map| map.visibility(at.to_array(), cosine));
        let (mesh, normals, occluders) = (&renderer.asset.mesh, renderer.mesh_normals(), renderer.occluders());
        let shading = renderer.shading()?;
        let irradiance: Arc<[Vec3]> =
            super::interreflection::from_point_light(mesh, occluders, &normals, shading, light, visibility).into();
        let mut last = last()?;
        last.truncate(MAX_KEPT - 1);
        last.insert(0, (*light, irradiance.clone()));
        Some(ObjectLight { irradiance })
    }

    /// `None`: rays are cast where feature `encode` is.
    #[cfg(not(feature = "encode"))]
    pub(super) fn under(_: &PreparedAsset, _: &PointLight, _: Option<&ShadowMap>) -> Option<Self> {
        None
    }

    /// Radiance, diffuse and specular, that a surface point reflects of it towards a camera, less what the model holds of it where the share
    /// `lit` of the lamp's light falls.
    pub(super) fn reflected(
        &self,
        renderer: &PreparedAsset,
        camera: &Camera,
        surface: &SurfacePoint,
        lit: f32,
    ) -> ReflectedObjectLight {
        let Some(shading) = renderer.shading() else { return ReflectedObjectLight::default() };
        let weights = surface.weights.map(|weight| weight as f32);
        let irradiance = between((renderer.asset.mesh.triangles[surface.base], weights.into()), &self.irradiance);
        let towards = DVec3::from_array(camera.centre()) - DVec3::from_array(surface.point);
        let cos_view = towards.normalize_or_zero().dot(DVec3::from_array(surface.normal)) as f32;
        let parameters = shading.parameters_at(surface.base, weights, surface.on_mesh.map(|x| x as f32));
        let specular = (parameters.hemispherical() - parameters.hemispherical_diffuse()).max(Vec3::ZERO);
        ReflectedObjectLight {
            diffuse: parameters.diffuse(irradiance, Vec3::ZERO, cos_view) * (1.0 - HELD_BY_DIFFUSE * lit),
            specular: specular * irradiance * ((1.0 - lit) / std::f32::consts::PI),
        }
    }
}

/// Radiance by the part of reflection.
#[derive(Clone, Copy, Default)]
pub(super) struct ReflectedObjectLight {
    diffuse: Vec3,
    specular: Vec3,
}

impl ReflectedObjectLight {
    /// That of a part.
    pub(super) fn of(&self, part: Component) -> [f32; 3] {
        let radiance = match part {
            Component::Diffuse => self.diffuse,
            Component::Specular => self.specular,
            Component::Combined => self.diffuse + self.specular,
        };
        radiance.to_array()
    }
}
