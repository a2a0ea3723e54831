//! Point lights on an object of any reflectance.

use super::appearance::ShadingModel;
use super::filtered::evaluate_brdf;
use super::occlusion::visibility_ramp;
use super::octahedral_map::to_square;
use super::sampled_view::render_samples;
use super::scene::{EnvironmentRender, RenderObject, ShadingPoint};
use super::shadow::ShadowMap;
use crate::error::{Error, Result};
use crate::views::{Camera, PointLight};
use glam::Vec3;

/// Sharpness of a point light seen through a visibility, whose borders are known to some two degrees.
const SHARPNESS: f32 = 1000.0;

/// Options of [`render_point_lights`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointLightOptions {
    /// Whether the object shadows itself.
    pub shadows: bool,
    /// Samples of a pixel along each side, 1 to 8; from 2 on, twice as many along each side at the object's outline.
    pub samples: u32,
}

impl Default for PointLightOptions {
    fn default() -> Self {
        PointLightOptions { shadows: true, samples: 2 }
    }
}

/// What keeps a light from the object.
enum Shadows {
    None,
    /// The object as the light sees it.
    Map(ShadowMap),
    /// What the object's visibility says: for a light within the sphere around the object, which no map can be drawn from.
    Visibility,
}

/// Renders an object under point lights, whose intensities are irradiance times squared distance. Shadows come from a depth map drawn from
/// each light; for one within the sphere around the object from its visibility, if it has one.
///
/// # Errors
///
/// [`Error::Parameter`] for samples out of range or a light that is not finite, [`Error::Limits`] where drawing the mesh at this size is too
/// much work.
pub fn render_point_lights(
    object: &RenderObject,
    camera: &Camera,
    shading: &dyn ShadingModel,
    lights: &[PointLight],
    options: &PointLightOptions,
) -> Result<EnvironmentRender> {
    if !(1..=8).contains(&options.samples) {
        return Err(Error::parameter("an image needs 1 to 8 samples a side"));
    }
    if lights.iter().any(|light| !light.position.iter().chain(&light.intensity).all(|x| x.is_finite())) {
        return Err(Error::parameter("a point light's position and intensity are finite"));
    }
    let shadows =
        |light: &PointLight| match (options.shadows, ShadowMap::for_distant_light(object.mesh, light.position)) {
            (false, _) => Shadows::None,
            (true, Some(map)) => Shadows::Map(map),
            (true, None) if object.occlusion.is_some() => Shadows::Visibility,
            (true, None) => Shadows::None,
        };
    let lights: Vec<(PointLight, Shadows)> = lights.iter().map(|light| (*light, shadows(light))).collect();
    render_samples(object, camera, options.samples, |point: &ShadingPoint, _| {
        let parameters = point.reflectance(shading);
        let basis = point.basis().transpose();
        let outgoing = basis * point.outgoing;
        let (mut directed, mut shine) = (Vec3::ZERO, Vec3::ZERO);
        for (light, shadows) in &lights {
            let to_light = Vec3::from_array(light.position.map(|x| x as f32)) - point.position;
            let direction = to_light.normalize_or_zero();
            let cosine = point.normal.dot(direction);
            if cosine <= 0.0 || (options.shadows && point.geometric.dot(direction) <= 0.0) {
                continue;
            }
            let visible = match (shadows, object.occlusion) {
                (Shadows::Map(map), _) => {
                    let cosine = f64::from(point.geometric.dot(direction));
                    map.visibility(point.position.as_dvec3().to_array(), cosine) as f32
                }
                (Shadows::Visibility, Some(occlusion)) => {
                    visibility_ramp(point.distance(occlusion, to_square(direction)), SHARPNESS)
                }
                _ => 1.0,
            };
            if visible <= 0.0 {
                continue;
            }
            let intensity = Vec3::from_array(light.intensity.map(|x| x as f32));
            let arriving = intensity * (cosine * visible / to_light.length_squared());
            directed += arriving * parameters.entering(cosine);
            let fresnel = parameters.highlights.fresnel(0.5 * (direction + point.outgoing).length());
            for (scale, part) in parameters.highlights.iter() {
                shine += fresnel * scale * arriving * evaluate_brdf(part, basis * direction, outgoing);
            }
        }
        [parameters.diffuse(Vec3::ZERO, directed, point.normal.dot(point.outgoing)), shine]
    })
}
