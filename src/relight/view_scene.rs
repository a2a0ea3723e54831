//! One image in the making: what each pixel shows.

use super::RenderOptions;
use super::capture_lights::weights;
use super::point_lighting::{PointLighting, ShownPart};
use super::prepared_asset::{PreparedAsset, SurfacePoint};
use super::residual::{CapturedRadiance, CapturedSample, CapturedView, nearest_first};
use crate::reflectance::ReflectionGeometry;
use crate::surface::raster::Raster;
use crate::views::{Camera, Component, PointLight};

/// Radiance and coverage of one pixel.
#[derive(Clone, Copy)]
pub(super) struct RenderedPixel {
    pub(super) components: [[f32; 3]; 2],
    pub(super) hit: bool,
    pub(super) coverage: bool,
}

/// The light on the object.
pub(super) enum SceneLighting<'r, 'a> {
    /// That of the capture: the nearest views under it, and where it is.
    Capture(Vec<&'r CapturedView<'a>>, Option<PointLight>),
    /// Lights given by their places.
    Points(PointLighting<'r, 'a>),
}

/// One image in the making.
pub(super) struct ViewScene<'r, 'a> {
    renderer: &'r PreparedAsset<'a>,
    options: &'r RenderOptions,
    camera: Camera,
    raster: Raster,
    lighting: &'r SceneLighting<'r, 'a>,
}

impl<'r, 'a> ViewScene<'r, 'a> {
    /// Draws what `camera` sees of an asset.
    pub(super) fn new(
        renderer: &'r PreparedAsset<'a>,
        options: &'r RenderOptions,
        camera: Camera,
        lighting: &'r SceneLighting<'r, 'a>,
    ) -> Self {
        ViewScene { renderer, options, camera, raster: renderer.draw(&camera), lighting }
    }

    pub(super) fn pixel(&self, index: usize) -> RenderedPixel {
        let mut pixel = RenderedPixel { components: [[0.0; 3]; 2], hit: false, coverage: false };
        if !self.raster.is_covered(index) {
            return pixel;
        }
        pixel.hit = true;
        let surface = self.renderer.surface_point(&self.camera, &self.raster, index);
        let parts: Vec<_> = self.renderer.asset.components.iter().map(|&component| self.part(component)).collect();
        match self.lighting {
            SceneLighting::Capture(captured, light) => {
                let (seen, coverage) = self.sight(captured, &surface, self.camera.centre());
                pixel.coverage = coverage;
                let centre = self.camera.centre();
                let geometry =
                    light.map(|light| ReflectionGeometry::new(surface.point, surface.normal, centre, &light));
                for (k, part) in parts.into_iter().enumerate() {
                    let Some((part, whole)) = part else { continue };
                    let model = self.renderer.model(part, &surface, geometry.as_ref());
                    let layers = self.options.layers;
                    let residual = if layers.residual && whole { residual(&seen, k, model, part) } else { [0.0; 3] };
                    pixel.components[k] =
                        std::array::from_fn(|c| residual[c] + if layers.model { model[c] } else { 0.0 });
                }
            }
            SceneLighting::Points(lighting) => {
                pixel.coverage = lighting.covers(&self.camera, &surface);
                pixel.components = lighting.radiance(self.renderer, &self.camera, &surface, self.options, &parts);
            }
        }
        pixel
    }

    /// The part of a component's image that is shown, and whether that is all of it; `None` where nothing is.
    fn part(&self, component: Component) -> ShownPart {
        let layers = self.options.layers;
        match component {
            Component::Combined if layers.diffuse != layers.specular => {
                Some((if layers.diffuse { Component::Diffuse } else { Component::Specular }, false))
            }
            Component::Diffuse | Component::Combined => layers.diffuse.then_some((component, true)),
            Component::Specular => layers.specular.then_some((component, true)),
        }
    }

    /// Returns what the captured views that see a surface point show there, with weights that sum to 1 (none if none sees it), and whether
    /// their masks let the point stand.
    fn sight(
        &self,
        captured: &[&CapturedView],
        surface: &SurfacePoint,
        centre: [f64; 3],
    ) -> (Vec<([CapturedRadiance; 2], f32)>, bool) {
        let (mut seen, mut angles, mut cut) = (Vec::new(), Vec::new(), false);
        for (angle, captured) in nearest_first(captured, surface.point, centre) {
            if seen.len() > self.options.views {
                break;
            }
            match captured.sample_at(surface.point) {
                CapturedSample::Seen(reading) => {
                    seen.push((reading.components, reading.confidence));
                    angles.push(angle);
                }
                CapturedSample::Cut => cut |= seen.is_empty(),
                CapturedSample::Unseen => {}
            }
        }
        let weights = weights(angles.into_iter(), self.options.views);
        seen.iter_mut().zip(weights).for_each(|(s, weight)| s.1 *= weight as f32);
        let total: f32 = seen.iter().map(|s| s.1).sum();
        seen.iter_mut().for_each(|s| s.1 /= total);
        (seen, !cut)
    }
}

/// The residual of a component where its model is `model`, interpolated: of every view the radiance that its residual leads to, the mean of
/// these in the (signed) square-root signal, minus the model. A specular residual that takes away is scaled by the model's ratio to the
/// model in the view: a highlight which the view didn't have leaves no black hole where the model has none.
fn residual(seen: &[([CapturedRadiance; 2], f32)], component: usize, model: [f32; 3], part: Component) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for (shown, weight) in seen {
        let CapturedRadiance { photograph, model: captured } = &shown[component];
        for c in 0..3 {
            let residual = photograph[c] - captured[c];
            let bounded = part == Component::Specular && residual < 0.0 && captured[c] > 0.0;
            let scale = if bounded { (model[c] / captured[c]).min(1.0) } else { 1.0 };
            // The first is exact where model and captured model agree.
            let radiance =
                if scale == 1.0 { photograph[c] + (model[c] - captured[c]) } else { model[c] + scale * residual };
            sum[c] += weight * radiance.abs().sqrt().copysign(radiance);
        }
    }
    if seen.is_empty() {
        return [0.0; 3];
    }
    std::array::from_fn(|c| sum[c] * sum[c].abs() - model[c])
}
