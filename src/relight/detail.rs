//! Transfers the captured residual to an image under another light.

use super::scene::EnvironmentRender;
use super::{AssetRenderer, RenderLayers, RenderOptions};
use crate::asset::Asset;
use crate::error::Result;
use crate::views::{Camera, Component};

/// Bounds of the factor by which detail changes the diffuse part.
const FACTOR: [f32; 2] = [0.5, 2.0];

/// Multiplies the diffuse part by the ratio of photographs to model under the capture's own light, as the camera sees it, so that
/// texture finer than the maps is kept. The residual was measured under that light only: where the model is dark or nothing was
/// captured, nothing changes.
pub fn add_detail(
    relit: &mut EnvironmentRender,
    renderer: &AssetRenderer,
    asset: &Asset,
    camera: &Camera,
) -> Result<()> {
    let Some(component) = asset.components.iter().position(|&c| c == Component::Diffuse) else { return Ok(()) };
    if asset.photographs.iter().all(Option::is_none) {
        return Ok(());
    }
    let layers = |residual: bool| RenderLayers { specular: false, residual, ..RenderLayers::default() };
    let options = |residual: bool| RenderOptions { layers: layers(residual), ..RenderOptions::default() };
    let model = renderer.render(camera, &options(false))?;
    let whole = renderer.render(camera, &options(true))?;
    let (model, shown) = (&model.components[component], &whole.components[component]);
    let floor = 0.02 * (asset.white.iter().sum::<f64>() / 3.0) as f32;
    for k in 0..relit.image.data.len() {
        if relit.coverage.data[k] <= 0.0 || !whole.coverage.data[k] {
            continue;
        }
        for c in 0..3 {
            let factor = (shown.data[k][c].max(0.0) + floor) / (model.data[k][c].max(0.0) + floor);
            let change = relit.diffuse.data[k][c] * (factor.clamp(FACTOR[0], FACTOR[1]) - 1.0);
            relit.diffuse.data[k][c] += change;
            relit.image.data[k][c] += change;
        }
    }
    Ok(())
}
