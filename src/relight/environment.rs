//! An object under light from all around: chooses the evaluator.

use super::appearance::ShadingModel;
use super::environment_light::PreparedEnvironment;
use super::scene::{
    EnvironmentOptions, EnvironmentRender, EnvironmentScene, Evaluator, RenderObject, SampledView, ShadingPoint,
    shade_samples,
};
use super::shadow::ShadowMap;
use super::{filtered, spherical_gaussian};
use crate::error::{Error, Result};
use crate::lighting;
use crate::views::Camera;

impl<'a> EnvironmentScene<'a> {
    /// Prepares the light on an object.
    pub fn new(
        object: &'a RenderObject<'a>,
        surround: &'a PreparedEnvironment,
        light: Option<&'a lighting::EnvironmentLobes>,
        options: EnvironmentOptions,
    ) -> Result<Self> {
        if options.evaluator == Evaluator::SphericalGaussian && light.is_none() {
            return Err(Error::parameter("the published evaluator needs light fitted as lobes and levels"));
        }
        if options.shadows && object.occlusion.is_none() {
            return Err(Error::parameter("shadows need the mesh's visibility: tsuya bake"));
        }
        if !(1..=8).contains(&options.samples) || options.taps == 0 {
            return Err(Error::parameter("a picture needs 1 to 8 samples a side and at least one tap"));
        }
        let better = options.evaluator == Evaluator::Filtered;
        let irradiance = if better { filtered::irradiance(object, surround, options.shadows) } else { Vec::new() };
        let (middle, radius) = object.mesh.bounding_sphere();
        let shadows = surround.distant.iter().filter(|_| better && options.shadows).map(|light| {
            let position = std::array::from_fn(|k| middle[k] + 40.0 * radius * light.direction[k] as f64);
            ShadowMap::for_distant_light(object.mesh, position)
        });
        let shadows = shadows.collect();
        Ok(EnvironmentScene { object, surround, light, options, irradiance, shadows })
    }

    /// Renders one picture.
    pub fn render(&self, camera: &Camera, look: &dyn ShadingModel) -> Result<EnvironmentRender> {
        let drawn = SampledView::new(self.object, camera, self.options.samples)?;
        Ok(shade_samples(self.object, &drawn, |point: &ShadingPoint, _| {
            let appearance = look.parameters_at(point.triangle, point.weights, point.position);
            match self.options.evaluator {
                Evaluator::SphericalGaussian => spherical_gaussian::radiance(self, point, &appearance),
                Evaluator::Filtered => filtered::radiance(self, point, &appearance),
            }
        }))
    }
}
