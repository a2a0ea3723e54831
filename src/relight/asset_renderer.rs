//! Renders one asset, keeping what images share.

use super::point_lighting::PointLighting;
use super::prepared_asset::PreparedAsset;
use super::view_scene::{RenderedPixel, SceneLighting, ViewScene};
use super::{RenderLighting, RenderOptions, ViewRender};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::image::{Grid, Mask, RgbImage};
use crate::views::{Camera, View};

/// Samples of the largest image.
const MAX_PIXELS: u64 = 1 << 28;
/// Samples of a pixel along each side, at most.
const MAX_SAMPLES: u32 = 8;

/// Renders images of one asset. Captured views are prepared when first needed.
pub struct AssetRenderer<'a> {
    prepared: PreparedAsset<'a>,
}

impl<'a> AssetRenderer<'a> {
    /// Prepares a renderer, checking that the parts of the asset belong together.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if mesh, charts, maps and photographs do not fit each other.
    pub fn new(asset: &'a Asset) -> Result<Self> {
        Ok(AssetRenderer { prepared: PreparedAsset::new(asset)? })
    }

    /// The number, for [`RenderLighting::Capture`], of the light that a view shows; `None` if the asset's views have no such light.
    pub fn light_number(&self, view: &View) -> Option<usize> {
        self.prepared.lights.number_of(self.prepared.asset, view)
    }

    /// Renders one image.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for an image without samples or of more than 2^28, a camera that is not finite, a light that no view
    /// shows; [`Error::Unsupported`] for point lights where those of the capture are unknown.
    pub fn render(&self, camera: &Camera, options: &RenderOptions) -> Result<ViewRender> {
        match options.samples {
            1 => self.render_middles(camera, options),
            2..=MAX_SAMPLES => self.render_means(camera, options),
            _ => Err(Error::parameter(format!("a pixel has 1 to {MAX_SAMPLES} samples along each side"))),
        }
    }

    /// The means of the samples in each pixel.
    fn render_means(&self, camera: &Camera, options: &RenderOptions) -> Result<ViewRender> {
        let fine = [camera.width, camera.height].map(|side| side.saturating_mul(options.samples));
        let fine = self.render_middles(&camera.resized(fine), options)?;
        let (width, height, n) = (camera.width as usize, camera.height as usize, options.samples as usize);
        let within = |k: usize| {
            let first = k / width * n * width * n + k % width * n;
            (0..n * n).map(move |sample| first + sample / n * width * n + sample % n)
        };
        let mean = |image: &RgbImage| {
            let of_pixel = |k: usize| {
                let sum = within(k).fold([0f32; 3], |sum, at| std::array::from_fn(|c| sum[c] + image.data[at][c]));
                sum.map(|x| x / (n * n) as f32)
            };
            Grid { width, height, data: (0..width * height).map(of_pixel).collect() }
        };
        let any = |mask: &Mask| {
            let of_pixel = |k: usize| within(k).any(|at| mask.data[at]);
            Grid { width, height, data: (0..width * height).map(of_pixel).collect() }
        };
        Ok(ViewRender {
            image: mean(&fine.image),
            components: fine.components.iter().map(mean).collect(),
            hit: any(&fine.hit),
            coverage: any(&fine.coverage),
        })
    }

    /// What the rays through the middles of the pixels meet.
    fn render_middles(&self, camera: &Camera, options: &RenderOptions) -> Result<ViewRender> {
        let prepared = &self.prepared;
        if camera.width == 0 || camera.height == 0 || camera.width as u64 * camera.height as u64 > MAX_PIXELS {
            return Err(Error::parameter("the image has no pixels or too many"));
        }
        let numbers = camera.focal.iter().chain(&camera.principal).chain(camera.rotation.iter().flatten());
        if !numbers.chain(&camera.translation).all(|x| x.is_finite()) || camera.focal.contains(&0.0) {
            return Err(Error::parameter("the camera has a number that is not finite, or no focal length"));
        }
        let lighting = self.lighting(camera, options)?;
        let scene = ViewScene { renderer: prepared, options, camera, raster: prepared.draw(camera), lighting };
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut pixels = vec![RenderedPixel { components: [[0.0; 3]; 2], hit: false, coverage: false }; width * height];
        crate::parallel::for_each_chunk(&mut pixels, width, |y, row| {
            row.iter_mut().enumerate().for_each(|(x, pixel)| *pixel = scene.pixel(y * width + x));
        });
        let plane = |value: &dyn Fn(&RenderedPixel) -> [f32; 3]| -> RgbImage {
            Grid { width, height, data: pixels.iter().map(value).collect() }
        };
        let mask = |value: fn(&RenderedPixel) -> bool| Grid { width, height, data: pixels.iter().map(value).collect() };
        Ok(ViewRender {
            image: plane(&|p| std::array::from_fn(|c| p.components[0][c].max(0.0) + p.components[1][c].max(0.0))),
            components: (0..prepared.asset.components.len()).map(|k| plane(&|p| p.components[k])).collect(),
            hit: mask(|p| p.hit),
            coverage: mask(|p| p.coverage),
        })
    }

    /// The light of an image: the capture's, with the views under it that are near, or lights given by their places.
    fn lighting(&self, camera: &Camera, options: &RenderOptions) -> Result<SceneLighting<'_, 'a>> {
        let prepared = &self.prepared;
        let maps = prepared.asset.reflectance.as_ref();
        let relightable = maps.is_some_and(|m| m.relightable);
        match &options.lighting {
            RenderLighting::Capture(number) => {
                let views = options.views.max(1);
                let near = prepared.lights.nearest(prepared.asset, camera, *number, views);
                if near.is_empty() && !prepared.asset.views.is_empty() && *number > 0 {
                    return Err(Error::parameter(format!("no view was captured under light {number}")));
                }
                let light =
                    relightable.then(|| prepared.lights.between(prepared.asset, camera, &near, views)).flatten();
                // Where no view was captured its shadows were not, either. On the normals of a scan the nearest photographs are nearer to
                // the truth than any model.
                let is_fine = prepared.asset.surface.is_some();
                let is_here = |view: usize| prepared.is_captured_from(view, camera);
                // Whether its photograph is there or only the model is shown: a captured camera has one model.
                let captured_here = match near.first() {
                    Some(&(view, _)) => is_here(view),
                    None => (0..prepared.asset.views.len()).any(is_here),
                };
                if let Some(light) = light.filter(|_| is_fine && !captured_here) {
                    return Ok(SceneLighting::Points(PointLighting::new(prepared, camera, &[light], options)));
                }
                let captured = near.iter().filter_map(|&(view, _)| prepared.captured(view)).collect();
                Ok(SceneLighting::Capture(captured, light))
            }
            RenderLighting::Points(_) if !relightable => {
                let message = "relighting: the lights of this asset's capture are unknown, so it has no reflectance";
                Err(Error::Unsupported(message.into()))
            }
            RenderLighting::Points(lights) => {
                Ok(SceneLighting::Points(PointLighting::new(prepared, camera, lights, options)))
            }
        }
    }
}
