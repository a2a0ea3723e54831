//! Transfers the captured residual to an image under another light.

use super::scene::EnvironmentRender;
use super::{AssetRenderer, RenderLayers, RenderOptions};
use crate::asset::Asset;
use crate::error::Result;
use crate::views::{Camera, Component};

/// Bounds of the factor by which detail changes the diffuse part.
const FACTOR: [f32; 2] = [0.5, 2.0];
/// Texels to either side over which the ratio is compared where the capture's light is not modelled in full, and the bounds in pixels.
const TEXELS: f64 = 3.0;
const PIXELS: [f64; 2] = [2.0, 64.0];

/// Multiplies the diffuse part by the ratio of photographs to model under the capture's own light, as the camera sees it, so that
/// texture finer than the maps is kept. The residual was measured under that light only: where the model is dark or nothing was
/// captured, nothing changes. Where that light is an environment the model has none of its shadows, so that the ratio is taken relative
/// to that of the surroundings.
pub fn add_detail(
    relit: &mut EnvironmentRender,
    renderer: &AssetRenderer,
    asset: &Asset,
    camera: &Camera,
) -> Result<()> {
    let has_lamps = asset.views.iter().any(|view| view.light.is_some());
    let of = |component| asset.components.iter().position(|&c| c == component);
    // Under lamps highlights would be taken for detail.
    let combined = if has_lamps { None } else { of(Component::Combined) };
    let Some(component) = of(Component::Diffuse).or(combined) else { return Ok(()) };
    if asset.photographs.iter().all(Option::is_none) {
        return Ok(());
    }
    let shown = RenderLayers { specular: combined.is_some(), interreflection: false, ..RenderLayers::default() };
    let layers = |residual: bool| RenderLayers { residual, ..shown };
    let options = |residual: bool| RenderOptions { layers: layers(residual), ..RenderOptions::default() };
    let model = renderer.render(camera, &options(false))?;
    let whole = renderer.render(camera, &options(true))?;
    let (model, shown) = (&model.components[component], &whole.components[component]);
    let floor = 0.02 * (asset.white.iter().sum::<f64>() / 3.0) as f32;
    let valid: Vec<bool> =
        relit.coverage.data.iter().zip(&whole.coverage.data).map(|(&share, &shown)| share > 0.0 && shown).collect();
    for c in 0..3 {
        let ratios = model.data.iter().zip(&shown.data);
        let ratios: Vec<f32> = ratios.map(|(m, s)| (s[c].max(0.0) + floor) / (m[c].max(0.0) + floor)).collect();
        let around =
            if has_lamps { None } else { Some(mean_around(&ratios, &valid, model.width, radius(asset, camera))) };
        for k in (0..ratios.len()).filter(|&k| valid[k]) {
            let factor = ratios[k] / around.as_ref().map_or(1.0, |around| around[k]);
            let change = relit.diffuse.data[k][c] * (factor.clamp(FACTOR[0], FACTOR[1]) - 1.0);
            relit.diffuse.data[k][c] += change;
            relit.image.data[k][c] += change;
        }
    }
    Ok(())
}

/// Pixels of the object's middle that some texels fill.
fn radius(asset: &Asset, camera: &Camera) -> usize {
    let middle = asset.mesh.bounding_sphere().0;
    let centre = camera.centre();
    let distance = (0..3).map(|k| (centre[k] - middle[k]).powi(2)).sum::<f64>().sqrt();
    let texel = asset.charts.as_ref().map_or(0.0, |charts| 1.0 / charts.texels_per_unit);
    let pixels = TEXELS * texel * camera.focal[0].abs() / distance;
    if pixels.is_finite() { pixels.clamp(PIXELS[0], PIXELS[1]) as usize } else { PIXELS[0] as usize }
}

/// Means of the valid values around each pixel, weighted by a tent in either direction: two boxes, one after the other.
fn mean_around(values: &[f32], valid: &[bool], width: usize, radius: usize) -> Vec<f32> {
    let height = values.len() / width.max(1);
    let mut sums: Vec<[f64; 2]> =
        values.iter().zip(valid).map(|(&v, &valid)| if valid { [f64::from(v), 1.0] } else { [0.0; 2] }).collect();
    for _ in 0..2 {
        (0..height).for_each(|y| box_sums(&mut sums, y * width, 1, width, radius));
        (0..width).for_each(|x| box_sums(&mut sums, x, width, height, radius));
    }
    sums.iter().map(|[sum, count]| if *count > 0.0 { (sum / count) as f32 } else { 1.0 }).collect()
}

/// Replaces `count` values from `first` on, `step` apart, by the sums of those at most `radius` away.
fn box_sums(values: &mut [[f64; 2]], first: usize, step: usize, count: usize, radius: usize) {
    let mut until = vec![[0.0; 2]; count + 1];
    for k in 0..count {
        until[k + 1] = std::array::from_fn(|c| until[k][c] + values[first + k * step][c]);
    }
    for k in 0..count {
        let (from, to) = (k.saturating_sub(radius), (k + radius + 1).min(count));
        values[first + k * step] = std::array::from_fn(|c| until[to][c] - until[from][c]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_of_valid_neighbours_only() {
        let values = [1.0, 2.0, 90.0, 4.0, 1.0, 2.0, 90.0, 4.0];
        let valid = [true, true, false, true, true, true, false, true];
        let means = mean_around(&values, &valid, 4, 1);
        // Both rows are alike, so that only the tents along them count: 2, 2 of the first two, then 2, 3, 1.
        let right = [(2.0 + 2.0 * 2.0) / 4.0, (2.0 + 3.0 * 2.0 + 4.0) / 6.0];
        assert!((0..2).all(|k| (means[k] - right[k]).abs() < 1e-6), "{means:?} {right:?}");
        assert!(means.iter().all(|&mean| (1.0..=4.0).contains(&mean)), "{means:?}");
        assert_eq!(mean_around(&[7.0], &[false], 1, 3), [1.0]);
    }
}
