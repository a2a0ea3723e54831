//! Images of an asset.

use crate::arrays::{from_grid, from_image};
use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;
use tsuya::image::{Grid, RgbImage};
use tsuya::lighting::EnvironmentMap;
use tsuya::relight::{
    self, AssetRenderer, AssetShading, EnvironmentOptions, EnvironmentRender, EnvironmentScene, Occlusion,
    PointLightOptions, PreparedEnvironment, PreparedEnvironmentOptions, RenderLayers, RenderLighting, RenderObject,
    RenderOptions, ViewRender, add_detail,
};
use tsuya::visibility::{BakeOptions, bake};
use tsuya::{Asset, Camera, Error, PointLight};

/// What an image is asked to be.
pub struct RenderArguments<'a> {
    lights: Option<Vec<PointLight>>,
    environment: Option<&'a EnvironmentMap>,
    pub layers: RenderLayers,
    shadows: bool,
    samples: Option<u32>,
    capture_light: usize,
}

impl<'a> RenderArguments<'a> {
    /// Naming only reflections shows them whole, naming only parts shows them of both reflections.
    pub fn new(
        lights: Option<Vec<PointLight>>,
        environment: Option<&'a EnvironmentMap>,
        layers: Option<&[String]>,
        shadows: bool,
        samples: Option<u32>,
        capture_light: usize,
    ) -> PyResult<Self> {
        const REFLECTIONS: [&str; 2] = ["diffuse", "specular"];
        const PARTS: [&str; 3] = ["model", "residual", "interreflection"];
        let named = layers.unwrap_or_default();
        if let Some(unknown) = named.iter().find(|name| !REFLECTIONS.iter().chain(&PARTS).any(|known| known == name)) {
            let known = [&REFLECTIONS[..], &PARTS].concat().join(", ");
            return Err(PyValueError::new_err(format!("no layer '{unknown}'; there are {known}")));
        }
        let has = |layer: &str| named.iter().any(|name| name == layer);
        let (reflections, parts) = (REFLECTIONS.iter().any(|l| has(l)), PARTS.iter().any(|l| has(l)));
        let layers = RenderLayers {
            diffuse: has("diffuse") || !reflections,
            specular: has("specular") || !reflections,
            model: has("model") || !parts,
            residual: has("residual") || !parts,
            interreflection: has("interreflection") || !parts,
        };
        if environment.is_some() && !(layers.diffuse && layers.specular && layers.model) {
            let message = "under an environment both reflections are shown by the model: `layers` only adds residual and \
                           interreflection to it";
            return Err(PyValueError::new_err(message));
        }
        Ok(RenderArguments { lights, environment, layers, shadows, samples, capture_light })
    }
}

/// An image with what of it shows the object.
pub struct Image {
    radiance: RgbImage,
    coverage: Grid<f32>,
}

impl From<EnvironmentRender> for Image {
    fn from(render: EnvironmentRender) -> Self {
        Image { radiance: render.image, coverage: render.coverage }
    }
}

impl From<ViewRender> for Image {
    fn from(render: ViewRender) -> Self {
        let coverage = render.coverage.map(|&is_covered| f32::from(u8::from(is_covered)));
        Image { radiance: render.image, coverage }
    }
}

/// Renders an image from each camera.
pub fn render(asset: &Asset, cameras: &[Camera], arguments: &RenderArguments<'_>) -> tsuya::Result<Vec<Image>> {
    if let Some(environment) = arguments.environment {
        return render_environment(asset, cameras, environment, arguments);
    }
    if asset.is_modelled() {
        return render_modelled(asset, cameras, arguments);
    }
    let renderer = AssetRenderer::new(asset)?;
    let image = |camera: &Camera| {
        // A captured camera gives its photograph.
        let is_captured = asset.views.iter().any(|view| view.camera == *camera);
        let options = RenderOptions {
            lighting: match &arguments.lights {
                Some(lights) => RenderLighting::Points(lights.clone()),
                None => RenderLighting::Capture(arguments.capture_light),
            },
            layers: arguments.layers,
            shadows: arguments.shadows,
            samples: arguments.samples.unwrap_or(if is_captured { 1 } else { 2 }),
            ..RenderOptions::default()
        };
        Ok(renderer.render(camera, &options)?.into())
    };
    cameras.iter().map(image).collect()
}

fn render_modelled(asset: &Asset, cameras: &[Camera], arguments: &RenderArguments<'_>) -> tsuya::Result<Vec<Image>> {
    let Some(lights) = &arguments.lights else {
        return Err(Error::Parameter("the object was modelled: an image takes `lights` or `environment`".into()));
    };
    let stored = asset.visibility.as_ref().filter(|_| arguments.shadows).map(Occlusion::from_visibility);
    let options = PointLightOptions { shadows: arguments.shadows, samples: arguments.samples.unwrap_or(2) };
    let object = RenderObject::of_asset(asset, stored.as_ref())?;
    let shading = AssetShading::new(asset, EnvironmentOptions::default().taps)?;
    let image = |camera| Ok(relight::render_point_lights(&object, camera, &shading, lights, &options)?.into());
    cameras.iter().map(image).collect()
}

fn render_environment(
    asset: &Asset,
    cameras: &[Camera],
    environment: &EnvironmentMap,
    arguments: &RenderArguments<'_>,
) -> tsuya::Result<Vec<Image>> {
    let options = EnvironmentOptions {
        shadows: arguments.shadows,
        samples: arguments.samples.unwrap_or(2),
        ..EnvironmentOptions::default()
    };
    let occlusion = match (&asset.visibility, arguments.shadows) {
        (_, false) => None,
        (Some(visibility), true) => Some(Occlusion::from_visibility(visibility)),
        (None, true) => Some(Occlusion::from_visibility(&bake(&asset.mesh, &BakeOptions::default())?.visibility)),
    };
    let object = RenderObject::of_asset(asset, occlusion.as_ref())?;
    let shading = AssetShading::new(asset, options.taps)?;
    let prepared = PreparedEnvironment::new(environment, &PreparedEnvironmentOptions::default());
    let scene = EnvironmentScene::new(&object, Arc::new(prepared), None, options)?;
    let is_captured = !asset.is_modelled();
    let bounces = is_captured && arguments.layers.interreflection;
    let scene = if bounces { scene.with_interreflection(&shading) } else { scene };
    let detail = (is_captured && arguments.layers.residual).then(|| AssetRenderer::new(asset)).transpose()?;
    let image = |camera| {
        let mut render = scene.render(camera, &shading)?;
        if let Some(renderer) = &detail {
            add_detail(&mut render, renderer, asset, camera)?;
        }
        Ok(render.into())
    };
    cameras.iter().map(image).collect()
}

/// A rendered image.
#[pyclass(frozen, module = "tsuya")]
pub struct Rendering {
    /// Linear radiance: (height, width, 3), float32; 0 where the object is not.
    #[pyo3(get)]
    radiance: Py<PyArray3<f32>>,
    /// Share of each pixel that shows the object, 0 to 1: (height, width), float32.
    #[pyo3(get)]
    coverage: Py<PyArray2<f32>>,
}

impl Rendering {
    pub fn new(py: Python<'_>, image: Image) -> PyResult<Self> {
        Ok(Rendering {
            radiance: from_image(py, image.radiance)?.unbind(),
            coverage: from_grid(py, image.coverage)?.unbind(),
        })
    }
}
