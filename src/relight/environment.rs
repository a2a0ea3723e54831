//! An object under light from all around: chooses the evaluator and renders images by it.

use super::appearance::ShadingModel;
use super::environment_light::PreparedEnvironment;
use super::evaluator::Evaluator;
use super::filtered::FilteredEvaluator;
use super::sampled_view::render_samples;
use super::scene::{EnvironmentOptions, EnvironmentRender, EvaluatorKind, RenderObject, ShadingPoint};
use super::spherical_gaussian::SgEvaluator;
use crate::error::{Error, Result};
use crate::lighting::EnvironmentLobes;
use crate::views::Camera;
use std::sync::Arc;

/// An object under an environment, with all that does not depend on the camera. Renders images one by one; for many a second there is
/// [`RealtimeRenderer`](super::RealtimeRenderer).
pub struct EnvironmentScene<'a> {
    pub(super) object: &'a RenderObject<'a>,
    pub(super) options: EnvironmentOptions,
    pub(super) evaluator: Box<dyn Evaluator + 'a>,
}

impl<'a> EnvironmentScene<'a> {
    /// Prepares the light on an object. [`EvaluatorKind::SphericalGaussian`] takes it from `light`, [`EvaluatorKind::Filtered`] from
    /// `environment`.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for spherical Gaussians without `light`, for shadows of an object without an
    /// [`Occlusion`](super::Occlusion), and for samples or taps out of range.
    pub fn new(
        object: &'a RenderObject<'a>,
        environment: Arc<PreparedEnvironment>,
        light: Option<Arc<EnvironmentLobes>>,
        options: EnvironmentOptions,
    ) -> Result<Self> {
        let EnvironmentOptions { evaluator, shadows, samples, taps } = options;
        if shadows && object.occlusion.is_none() {
            return Err(Error::parameter("shadows need the mesh's visibility"));
        }
        if !(1..=8).contains(&samples) || taps == 0 {
            return Err(Error::parameter("an image needs 1 to 8 samples a side and at least one tap"));
        }
        let evaluator: Box<dyn Evaluator> = match (evaluator, light) {
            (EvaluatorKind::Filtered, _) => Box::new(FilteredEvaluator::new(object, environment, shadows)),
            (EvaluatorKind::SphericalGaussian, Some(light)) => {
                Box::new(SgEvaluator::new(object, environment, light, shadows))
            }
            (EvaluatorKind::SphericalGaussian, None) => {
                return Err(Error::parameter("spherical Gaussians need light fitted as lobes and prefiltered maps"));
            }
        };
        Ok(EnvironmentScene { object, options, evaluator })
    }

    /// Adds the light that the object sends to itself, by its reflectance: one bounce, all reflection taken as diffuse, of light that the
    /// visibility lets through. Nothing without shadows, and with [`EvaluatorKind::SphericalGaussian`].
    #[cfg(feature = "encode")]
    pub fn with_interreflection(mut self, shading: &dyn ShadingModel) -> Self {
        if self.options.shadows {
            self.evaluator.add_interreflection(shading);
        }
        self
    }

    /// Renders one image.
    ///
    /// # Errors
    ///
    /// [`Error::Limits`] where drawing the mesh at this size is too much work.
    pub fn render(&self, camera: &Camera, shading: &dyn ShadingModel) -> Result<EnvironmentRender> {
        render_samples(self.object, camera, self.options.samples, |point: &ShadingPoint, _| {
            self.evaluator.radiance(point, &point.reflectance(shading))
        })
    }
}
