//! An object under light from all around: chooses the evaluator.

use super::appearance::Look;
use super::environment_light::Surround;
use super::scene::{Drawn, EnvironmentOptions, Evaluator, Object, Point, Relit, Scene, draw};
use super::shadow::ShadowMap;
use super::{filtered, spherical_gaussian};
use crate::error::{Error, Result};
use crate::lighting;
use crate::views::Camera;

impl<'a> Scene<'a> {
    /// Prepares the light on an object.
    pub fn new(
        object: &'a Object<'a>,
        surround: &'a Surround,
        light: Option<&'a lighting::Light>,
        options: EnvironmentOptions,
    ) -> Result<Self> {
        if options.evaluator == Evaluator::Published && light.is_none() {
            return Err(Error::parameter("the published evaluator needs light fitted as lobes and levels"));
        }
        if options.shadows && object.occlusion.is_none() {
            return Err(Error::parameter("shadows need the mesh's visibility: tsuya bake"));
        }
        if !(1..=8).contains(&options.samples) || options.taps == 0 {
            return Err(Error::parameter("a picture needs 1 to 8 samples a side and at least one tap"));
        }
        let better = options.evaluator == Evaluator::Better;
        let irradiance = if better { filtered::irradiance(object, surround, options.shadows) } else { Vec::new() };
        let (middle, radius) = object.mesh.bounding_sphere();
        let shadows = surround.distant.iter().filter(|_| better && options.shadows).map(|light| {
            let position = std::array::from_fn(|k| middle[k] + 40.0 * radius * light.direction[k] as f64);
            ShadowMap::distant(object.mesh, position)
        });
        let shadows = shadows.collect();
        Ok(Scene { object, surround, light, options, irradiance, shadows })
    }

    /// Renders one picture.
    pub fn render(&self, camera: &Camera, look: &dyn Look) -> Result<Relit> {
        let drawn = Drawn::new(self.object, camera, self.options.samples)?;
        Ok(draw(self.object, &drawn, |point: &Point, _| {
            let appearance = look.at(point.triangle, point.weights, point.position);
            match self.options.evaluator {
                Evaluator::Published => spherical_gaussian::radiance(self, point, &appearance),
                Evaluator::Better => filtered::radiance(self, point, &appearance),
            }
        }))
    }
}
