//! Summing the light of an environment at surface points: what the still and the real-time renderer ask of either evaluator.

#[cfg(feature = "encode")]
use super::appearance::ShadingModel;
use super::appearance::{Highlights, ShadingParameters};
use super::environment_light::DistantLight;
use super::scene::ShadingPoint;
use super::shadow::ShadowMap;
use glam::Vec3;
use std::borrow::Cow;

/// Light from all around an object, summed at points of its surface.
pub(super) trait Evaluator: Send + Sync {
    /// Returns the radiance towards the camera, diffuse and specular, exact as far as the method goes.
    fn radiance(&self, point: &ShadingPoint, parameters: &ShadingParameters) -> [Vec3; 2];

    /// Returns the irradiance at every sample of the surface, without [`Self::distant_lights`].
    fn sample_irradiance(&self) -> Cow<'_, [Vec3]>;

    /// Returns the specular radiance towards the camera, without [`Self::distant_lights`], by the parts' tables where they have one.
    fn tabulated_specular(&self, point: &ShadingPoint, highlights: &Highlights) -> Vec3;

    /// Adds the light that the object sends to itself.
    #[cfg(feature = "encode")]
    fn add_interreflection(&mut self, shading: &dyn ShadingModel);

    /// Returns the compact sources that are summed apart from the rest; none where the rest has all light.
    fn distant_lights(&self) -> &[ShadowedLight];
}

/// A distant light and the depth map of the object as seen from it; without a map it reaches everything.
pub(super) struct ShadowedLight {
    pub(super) light: DistantLight,
    pub(super) map: Option<ShadowMap>,
}
