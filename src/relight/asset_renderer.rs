//! Renders one asset, keeping what images share.

use super::antialiasing::{SampledRows, edges};
use super::point_lighting::PointLighting;
use super::prepared_asset::PreparedAsset;
use super::view_scene::{SceneLighting, ViewScene};
use super::{RenderLighting, RenderOptions, ViewRender};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::image::{Grid, RgbImage};
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
        let (prepared, samples) = (&self.prepared, options.samples);
        if !(1..=MAX_SAMPLES).contains(&samples) {
            return Err(Error::parameter(format!("a pixel has 1 to {MAX_SAMPLES} samples along each side")));
        }
        let sides = [camera.width, camera.height].map(|side| u64::from(side) * u64::from(samples));
        if sides.contains(&0) || sides[0].saturating_mul(sides[1]) > MAX_PIXELS {
            return Err(Error::parameter("the image has no pixels or too many"));
        }
        let numbers = camera.focal.iter().chain(&camera.principal).chain(camera.rotation.iter().flatten());
        if !numbers.chain(&camera.translation).all(|x| x.is_finite()) || camera.focal.contains(&0.0) {
            return Err(Error::parameter("the camera has a number that is not finite, or no focal length"));
        }
        let lighting = self.lighting(camera, options)?;
        let scene = |rows: &SampledRows| ViewScene::new(prepared, options, rows.camera, &lighting);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let rows = SampledRows::whole(camera, samples);
        let whole = scene(&rows);
        let mut pixels = vec![PixelMean::NONE; width * height];
        crate::parallel::for_each_chunk(&mut pixels, width, |y, row| {
            row.iter_mut().enumerate().for_each(|(x, pixel)| *pixel = PixelMean::of(&whole, &rows, y * width + x));
        });
        drop(whole);
        let hits: Vec<u32> = pixels.iter().map(|pixel| pixel.hits).collect();
        for (rows, edges) in edges(camera, samples, &hits) {
            let scene = scene(&rows);
            let means = crate::parallel::map(edges.len(), |k| PixelMean::of(&scene, &rows, edges[k]));
            edges.into_iter().zip(means).for_each(|(pixel, mean)| pixels[pixel] = mean);
        }
        let plane = |value: &dyn Fn(&PixelMean) -> [f32; 3]| -> RgbImage {
            Grid { width, height, data: pixels.iter().map(value).collect() }
        };
        let mask = |value: fn(&PixelMean) -> bool| Grid { width, height, data: pixels.iter().map(value).collect() };
        Ok(ViewRender {
            image: plane(&|p| p.image),
            components: (0..prepared.asset.components.len()).map(|k| plane(&|p| p.components[k])).collect(),
            hit: mask(|p| p.hits > 0),
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

/// The means of a pixel's samples.
#[derive(Clone, Copy)]
struct PixelMean {
    /// Of the sums of the components, each not below 0.
    image: [f32; 3],
    components: [[f32; 3]; 2],
    /// Whether any sample shows the object where masks let it stand.
    coverage: bool,
    /// Samples that show the object.
    hits: u32,
}

impl PixelMean {
    const NONE: Self = PixelMean { image: [0.0; 3], components: [[0.0; 3]; 2], coverage: false, hits: 0 };

    fn of(scene: &ViewScene, rows: &SampledRows, pixel: usize) -> Self {
        let (mut mean, share) = (Self::NONE, rows.share());
        for sample in rows.samples_of(pixel).map(|sample| scene.pixel(sample)).filter(|sample| sample.hit) {
            let [a, b] = sample.components;
            mean.hits += 1;
            mean.coverage |= sample.coverage;
            for c in 0..3 {
                mean.image[c] += (a[c].max(0.0) + b[c].max(0.0)) * share;
                (0..2).for_each(|k| mean.components[k][c] += sample.components[k][c] * share);
            }
        }
        mean
    }
}
