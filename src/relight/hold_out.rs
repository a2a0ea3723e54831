//! Views that were left out of a file, rendered and compared with their photographs.

use super::{AssetRenderer, RenderLayers, RenderLighting, RenderOptions};
use crate::asset::Asset;
use crate::error::Result;
use crate::metrics::PhotographError;
use crate::surface::raster::rasterise;
use crate::views::{Camera, Photograph, View};

/// Errors of the held-out views together.
#[derive(Debug, Clone, Default)]
pub struct HeldOut {
    /// Rendered by interpolation between captured views.
    pub interpolated: PhotographError,
    /// Rendered with the nearest captured view's residual only.
    pub nearest: PhotographError,
    /// With the reflectance model only.
    pub model: PhotographError,
    /// The photograph of the nearest captured view, warped through the mesh, without any model.
    pub warped: PhotographError,
}

/// Renders the cameras of held-out views, whose photographs are `originals` (parallel to `views`), from an asset without them.
pub fn hold_out(asset: &Asset, views: &[View], originals: &[Photograph]) -> Result<HeldOut> {
    let mut result = HeldOut::default();
    let renderer = AssetRenderer::new(asset)?;
    let bare = Asset { reflectance: None, ..asset.clone() };
    let bare = AssetRenderer::new(&bare)?;
    for (view, original) in views.iter().zip(originals) {
        // A light that no captured view has is a case for relighting.
        let lighting = match (renderer.light_number(view), view.light) {
            (None, Some(light)) => RenderLighting::Points(vec![light]),
            (number, _) => RenderLighting::Capture(number.unwrap_or(0)),
        };
        let base = RenderOptions { lighting: lighting.clone(), ..RenderOptions::default() };
        let nearest = RenderOptions { views: 1, ..base.clone() };
        let mut model = base.clone();
        model.layers = RenderLayers { residual: false, interreflection: false, ..model.layers };
        let compare = |renderer: &AssetRenderer, options: &RenderOptions| {
            compare(renderer, &view.camera, options, asset, original)
        };
        result.interpolated.merge(&compare(&renderer, &base)?);
        result.nearest.merge(&compare(&renderer, &nearest)?);
        result.model.merge(&compare(&renderer, &model)?);
        if matches!(lighting, RenderLighting::Capture(_)) {
            result.warped.merge(&compare(&bare, &nearest)?);
        }
    }
    Ok(result)
}

/// Compares the image of a camera with its photograph, where the mesh is.
pub(super) fn compare(
    renderer: &AssetRenderer,
    camera: &Camera,
    options: &RenderOptions,
    asset: &Asset,
    original: &Photograph,
) -> Result<PhotographError> {
    let rendered = renderer.render(camera, options)?;
    let decoded = Photograph { mask: original.mask.clone(), images: rendered.components };
    let covered = rasterise(&asset.mesh, camera).coverage();
    Ok(PhotographError::compare(original, &decoded, &asset.components, &covered, asset.white))
}
