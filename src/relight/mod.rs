//! Images of an asset: from any camera, under the capture's light, any point lights, or an environment. See `spec/rendering.md`.
//!
//! An image is the reflectance model, evaluated, plus the residual (photograph minus model), interpolated between the nearest
//! captured views and lights (Miyazaki 2007, equations 12 to 16).

mod antialiasing;
mod appearance;
mod asset_renderer;
mod bound_materials;
mod brdf_table;
mod cameras;
mod capture_lights;
mod detail;
mod environment;
mod environment_light;
mod evaluator;
mod file_light;
mod filtered;
#[cfg(feature = "encode")]
mod ground;
mod hold_out;
#[cfg(feature = "encode")]
mod interreflection;
#[cfg(feature = "encode")]
pub(crate) mod job;
#[cfg(feature = "encode")]
mod job_material;
mod material;
mod models;
mod multisample;
mod object_light;
mod occlusion;
mod octahedral_map;
mod point_lighting;
mod point_lights;
mod prepared_asset;
mod realtime;
#[cfg(feature = "encode")]
mod reference;
mod residual;
mod sampled_view;
mod scene;
mod shadow;
mod spherical_gaussian;
mod tangents;
mod textures;
mod view_scene;

pub use appearance::{Highlight, Highlights, PreparedSpecular, ShadingModel, ShadingParameters, UniformMaterial};
pub use asset_renderer::AssetRenderer;
pub use cameras::{framing, look_at, orbit};
pub use detail::add_detail;
pub use environment::EnvironmentScene;
pub use environment_light::{DistantLight, PreparedEnvironment, PreparedEnvironmentOptions};
#[cfg(feature = "ar")]
pub(crate) use ground::RUN;
#[cfg(feature = "encode")]
pub use ground::{Ground, GroundShadow, ProjectedShadow, composite, ground_shadow};
pub use hold_out::{HeldOut, hold_out};
#[cfg(feature = "encode")]
pub use job::{Job, JobCamera, JobEnvironment, JobEvaluator};
#[cfg(feature = "encode")]
pub use job_material::{JobColour, JobMaterial, JobPair, JobParameter};
pub use material::{HalfLobe, Material, SpecularPart, WarpedLobe, fit_lobes};
pub use models::TorranceSparrow;
pub use occlusion::Occlusion;
pub use point_lights::{PointLightOptions, render_point_lights};
pub use realtime::{RealtimeFrame, RealtimeRenderer};
#[cfg(feature = "encode")]
pub use reference::{ReferenceOptions, reference};
pub use scene::{EnvironmentOptions, EnvironmentRender, EvaluatorKind, RenderObject};
pub use textures::{AssetShading, Texture, TexturedShading, Textures};

use crate::asset::Asset;
use crate::error::Result;
use crate::image::{Mask, RgbImage};
use crate::views::{Camera, PointLight};

/// Which light falls on the object.
#[derive(Debug, Clone, PartialEq)]
pub enum RenderLighting {
    /// The light of the nearest captured views. Of a capture under several lights (standing still or moving with the camera) the one of
    /// this number, 0 the most used.
    Capture(usize),
    /// These point lights. Only for assets whose capture's lights are known. A captured lamp from its captured camera gives the photograph,
    /// one near captured lamps takes from theirs what they have beyond the model.
    Points(Vec<PointLight>),
}

/// Parts of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RenderLayers {
    /// Diffuse reflection. The residual of a capture without polarisers is shown only if both reflections are.
    pub diffuse: bool,
    /// Specular reflection.
    pub specular: bool,
    /// The reflectance model.
    pub model: bool,
    /// Residual: photograph minus model.
    pub residual: bool,
    /// Light that the object sends to itself, under lights whose shadows are shown: one bounce, by rays, which takes feature `encode`.
    pub interreflection: bool,
}

impl Default for RenderLayers {
    fn default() -> Self {
        RenderLayers { diffuse: true, specular: true, model: true, residual: true, interreflection: true }
    }
}

/// Options of [`AssetRenderer::render`].
#[derive(Debug, Clone, PartialEq)]
pub struct RenderOptions {
    /// The light.
    pub lighting: RenderLighting,
    /// Parts shown.
    pub layers: RenderLayers,
    /// Captured views between which the residual of a surface point is interpolated, at most. 1 takes only the nearest one; with more,
    /// [`RenderLighting::Points`] takes what is near in light and view.
    pub views: usize,
    /// Whether the object shadows itself under [`RenderLighting::Points`].
    pub shadows: bool,
    /// Samples of a pixel along each side, 1 to 8: time and memory follow its square. From 2 on, pixels at the object's outline have twice as
    /// many along each side. With 1 a pixel is what the ray through its middle meets, and a captured camera gives its photograph.
    pub samples: u32,
}

impl Default for RenderOptions {
    fn default() -> Self {
        let lighting = RenderLighting::Capture(0);
        RenderOptions { lighting, layers: RenderLayers::default(), views: 3, shadows: true, samples: 1 }
    }
}

impl RenderOptions {
    /// The residual of the nearest captured view only, not interpolated.
    pub fn nearest_view() -> Self {
        RenderOptions { views: 1, ..Self::default() }
    }
}

/// Image of an asset, whole and by components.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewRender {
    /// Linear radiance of the layers asked for: the sum of the components, each not below 0. 0 where nothing is hit. Of several samples the
    /// mean.
    pub image: RgbImage,
    /// Radiance of each component, parallel to [`Asset::components`]; may be negative.
    pub components: Vec<RgbImage>,
    /// Pixels whose central ray meets the mesh; of several samples, any's.
    pub hit: Mask,
    /// Pixels that show the object: `hit` without those that the nearest captured masks cut off.
    pub coverage: Mask,
}

/// Renders one image. For several of one asset keep a [`AssetRenderer`].
pub fn render(asset: &Asset, camera: &Camera, options: &RenderOptions) -> Result<ViewRender> {
    AssetRenderer::new(asset)?.render(camera, options)
}

#[cfg(all(test, feature = "encode"))]
mod scene_tests;
#[cfg(all(test, feature = "encode"))]
pub(crate) mod test_capture;
#[cfg(all(test, feature = "encode"))]
mod tests;
