//! A metallic-roughness material baked from fitted reflectance, for viewers that don't know the extension.

use super::geometry::charts;
use super::metallic_roughness::{equivalent_lobe, material};
use super::normal_map::bake_normal_map;
use crate::asset::Asset;
use crate::brdf::Microfacets;
use crate::error::{Error, Result};
use crate::image::{Grid, from_srgb, to_srgb};
use crate::reflectance::torrance_sparrow::SIGMA_RANGE;
use crate::surface::atlas::{bilinear_taps, rasterise_atlas};
use std::f64::consts::PI;

/// Widths for which the equivalent of a lobe is computed; between them it is interpolated.
const LOBES: usize = 96;

/// 8-bit textures on the atlas.
#[derive(Debug, Clone, PartialEq)]
pub struct Fallback {
    /// Base colour, sRGB.
    pub base_colour: Grid<[u8; 3]>,
    /// Green: roughness, blue: metalness; linear. `None` for a surface that reflects nothing but diffusely, and without known lights.
    pub metallic_roughness: Option<Grid<[u8; 3]>>,
    /// Specular colour, sRGB; to be multiplied with `specular_scale`. With `metallic_roughness`.
    pub specular_colour: Option<Grid<[u8; 3]>>,
    /// Factor of the specular colour.
    pub specular_scale: f32,
    /// Normals of a surface finer than the mesh: tangent, up in the picture, normal, from -1 to 1. `None` where there is none.
    pub normal: Option<Grid<[u8; 3]>>,
    /// Whether the base colour is the light that was seen, since the capture's lights are unknown: it is to be shown unlit.
    pub is_unlit: bool,
    /// A BRDF of the asset times this is one per steradian; of each colour.
    pub unit: [f64; 3],
}

/// Bakes the material. `white_albedo` is the diffuse albedo of the capture's white board: colours are relative to it, so that the
/// capture's exposure and the colour of its lights don't matter.
///
/// # Errors
///
/// [`Error::Unsupported`] for an asset without reflectance.
pub fn bake_fallback(asset: &Asset, white_albedo: f64) -> Result<Fallback> {
    let charts = charts(asset)?;
    let Some(maps) = &asset.reflectance else {
        return Err(Error::Unsupported("the file has no reflectance, so there is nothing to make textures of".into()));
    };
    let maps = &*maps.without_palette();
    let atlas = rasterise_atlas(&asset.mesh, charts)?;
    let mask = atlas.mask();
    let texels = mask.data.len();
    if maps.diffuse.data.len() != texels || ![0, texels].contains(&maps.specular.data.len()) {
        return Err(Error::parameter("charts and reflectance maps do not belong together"));
    }
    let filled = |map: &Grid<[f32; 3]>| {
        let mut map = map.clone();
        map.fill_outside(&mask);
        map
    };
    let unit = if maps.relightable { unit(asset, white_albedo) } else { asset.white.map(|w| 1.0 / w.max(1e-12)) };
    let diffuse = filled(&maps.diffuse);
    let grid = |data: Vec<[u8; 3]>| Grid { width: mask.width, height: mask.height, data };
    if !maps.relightable || maps.specular.data.is_empty() || maps.sigma.data.len() != texels {
        let scale = if maps.relightable { PI } else { 1.0 };
        let colour = |k: &[f32; 3]| std::array::from_fn(|c| to_code(k[c] as f64 * scale * unit[c]));
        return Ok(Fallback {
            base_colour: grid(diffuse.data.iter().map(colour).collect()),
            metallic_roughness: None,
            specular_colour: None,
            specular_scale: 0.0,
            normal: if maps.relightable { bake_normal_map(asset, charts, &atlas, &mask) } else { None },
            is_unlit: !maps.relightable,
            unit,
        });
    }
    let specular = filled(&maps.specular);
    let sigma = filled(&maps.sigma.map(|&sigma| [sigma; 3]));
    let lobes = LobeMixture::new();
    let materials: Vec<Microfacets> = (0..texels)
        .map(|k| {
            let (alpha, peak) = lobes.at(sigma.data[k][0] as f64);
            // F D / 4 at the peak of the distribution, 1 / (pi alpha^2), is to be the lobe's.
            let strength = |c: usize| 4.0 * PI * alpha * alpha * peak * specular.data[k][c] as f64 * unit[c];
            let albedo = |c: usize| PI * diffuse.data[k][c] as f64 * unit[c];
            material(std::array::from_fn(albedo), std::array::from_fn(strength), alpha.sqrt())
        })
        .collect();
    let specular_scale = materials.iter().flat_map(|m| m.specular_colour).fold(1.0, f64::max) as f32;
    let each = |f: &dyn Fn(&Microfacets) -> [u8; 3]| grid(materials.iter().map(f).collect());
    let linear = |x: f64| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
    Ok(Fallback {
        base_colour: each(&|m| m.base_colour.map(to_code)),
        // Red would be the occlusion, if a texture served both.
        metallic_roughness: Some(each(&|m| [255, linear(m.roughness), linear(m.metallic)])),
        specular_colour: Some(each(&|m| m.specular_colour.map(|s| to_code(s / specular_scale as f64)))),
        specular_scale,
        normal: bake_normal_map(asset, charts, &atlas, &mask),
        is_unlit: false,
        unit,
    })
}

impl Fallback {
    /// The normal at an atlas position in texels, in the mesh's tangent frame, as a viewer reads it.
    pub(super) fn normal_at(&self, position: [f64; 2]) -> [f64; 3] {
        let Some(map) = &self.normal else { return [0.0, 0.0, 1.0] };
        let mut sum = glam::DVec3::ZERO;
        for (index, weight) in bilinear_taps(map.width, map.height, position) {
            let Some(texel) = map.data.get(index) else { continue };
            sum += weight * glam::DVec3::from_array(texel.map(|code| code as f64 / 127.5 - 1.0));
        }
        sum.normalize_or(glam::DVec3::Z).to_array()
    }

    /// The material at an atlas position in texels, as a viewer reads it: bilinear between linear values.
    pub fn microfacets_at(&self, position: [f64; 2]) -> Microfacets {
        let mut sums = [[0.0; 3]; 3];
        let textures = [Some(&self.base_colour), self.metallic_roughness.as_ref(), self.specular_colour.as_ref()];
        for (index, weight) in bilinear_taps(self.base_colour.width, self.base_colour.height, position) {
            for (k, texture) in textures.iter().enumerate() {
                let Some(texel) = texture.and_then(|texture| texture.data.get(index)) else { continue };
                let linear = |code: u8| if k == 1 { code as f64 / 255.0 } else { from_srgb(code as f64 / 255.0) };
                (0..3).for_each(|c| sums[k][c] += weight * linear(texel[c]));
            }
        }
        Microfacets {
            base_colour: sums[0],
            metallic: sums[1][2],
            roughness: if self.metallic_roughness.is_some() { sums[1][1] } else { 1.0 },
            specular_colour: sums[2].map(|s| s * self.specular_scale as f64),
        }
    }
}

/// Factors that make BRDFs of the asset's reflectance, whose lights may be in any unit: the white board, facing the light from the object's
/// place, has `white_albedo / pi`.
fn unit(asset: &Asset, white_albedo: f64) -> [f64; 3] {
    let middle = asset.mesh.bounding_sphere().0;
    std::array::from_fn(|c| {
        let mut boards: Vec<f64> = (asset.views.iter().filter_map(|view| view.light))
            .map(|light| {
                let squared = (0..3).map(|k| (light.position[k] - middle[k]).powi(2)).sum::<f64>();
                asset.white[c] * squared / light.intensity[c]
            })
            .filter(|board| board.is_finite() && *board > 0.0)
            .collect();
        boards.sort_by(f64::total_cmp);
        boards.get(boards.len() / 2).map_or(1.0, |board| white_albedo / PI / board)
    })
}

/// [`equivalent_lobe`] of every width that fits give.
struct LobeMixture(Vec<(f64, f64)>);

impl LobeMixture {
    fn new() -> Self {
        let (least, most) = (SIGMA_RANGE.0 as f64, SIGMA_RANGE.1 as f64);
        let sigma = |k: usize| least * (most / least).powf(k as f64 / (LOBES - 1) as f64);
        LobeMixture((0..LOBES).map(|k| equivalent_lobe(sigma(k))).collect())
    }

    fn at(&self, sigma: f64) -> (f64, f64) {
        let (least, most) = (SIGMA_RANGE.0 as f64, SIGMA_RANGE.1 as f64);
        let place = ((sigma / least).ln() / (most / least).ln()).clamp(0.0, 1.0) * (LOBES - 1) as f64;
        let first = (place as usize).min(LOBES - 2);
        let (one, two, share) = (self.0[first], self.0[first + 1], place - first as f64);
        (one.0 + share * (two.0 - one.0), one.1 + share * (two.1 - one.1))
    }
}

/// Linear 0 to 1 as 8-bit sRGB.
fn to_code(x: f64) -> u8 {
    (to_srgb(x.clamp(0.0, 1.0)) * 255.0).round() as u8
}
