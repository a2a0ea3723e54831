//! Materials that vary over the surface: a file's reflectance maps and bound materials, and parameters driven by images.

use super::appearance::{Highlights, PreparedSpecular, ShadingModel, ShadingParameters, UniformMaterial};
use super::bound_materials::BoundMaterials;
use super::material::{Material, SpecularPart};
use super::models::{GgxLobe, PaletteHighlight, TorranceSparrow};
use crate::asset::Asset;
use crate::brdf::Brdf;
use crate::error::{Error, Result};
use crate::image::Grid;
use crate::reflectance::lobes::LOBES;
use crate::reflectance::maps::ReflectanceMaps;
use crate::reflectance::palette::PaletteTables;
use crate::reflectance::torrance_sparrow::SIGMA_RANGE;
use crate::surface::atlas::{atlas_position, sample_colour, sample_number};
use crate::surface::charts::Charts;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Steps of a width of lobes that varies, each with lobes of its own.
const STEPS: usize = 64;

/// Ranges of what textures drive.
const ROUGHNESS: [f32; 2] = [0.005, 2.0];
const EXPONENT: [f32; 2] = [0.1, 1e5];

/// Reflection functions for a range of widths, evenly spaced in the logarithm.
struct SpecularRange {
    min_width: f64,
    max_width: f64,
    prepared: Vec<PreparedSpecular>,
}

impl SpecularRange {
    fn new(
        [least, most]: [f64; 2],
        taps: usize,
        part: impl Fn(f64) -> Result<Box<dyn Brdf + Send>> + Sync + Send,
    ) -> Result<Self> {
        let steps = if most > least { STEPS } else { 1 };
        let width = |k: usize| least * (most / least).powf(k as f64 / (steps.max(2) - 1) as f64);
        let prepared =
            crate::parallel::map(steps, |k| Ok(PreparedSpecular::new(SpecularPart::new(part(width(k))?), taps)));
        Ok(SpecularRange { min_width: least, max_width: most, prepared: prepared.into_iter().collect::<Result<_>>()? })
    }

    fn at(&self, width: f64) -> Option<&PreparedSpecular> {
        let place = (width / self.min_width).ln() / (self.max_width / self.min_width).ln().max(1e-12);
        let last = self.prepared.len().saturating_sub(1);
        self.prepared.get(((place * last as f64).round().max(0.0) as usize).min(last))
    }
}

/// The reflectance of a decoded file: of each triangle that a material is bound to, that; of others the reflectance maps.
pub struct AssetShading<'a> {
    bound: Option<BoundMaterials<'a>>,
    maps: Option<MapShading<'a>>,
}

impl<'a> AssetShading<'a> {
    /// Prepares the reflectance of a decoded file; `taps` as in [`PreparedSpecular::new`].
    ///
    /// # Errors
    ///
    /// [`Error::Unsupported`] for files with neither reflectance nor materials for all triangles, [`Error::Parameter`] if mesh, charts, maps
    /// and materials do not fit each other.
    pub fn new(asset: &'a Asset, taps: usize) -> Result<Self> {
        let bound = asset.binding.as_ref().map(|binding| BoundMaterials::new(asset, binding, taps)).transpose()?;
        let is_whole = bound.as_ref().is_some_and(|bound| bound.unbound() == 0);
        let maps = if is_whole { None } else { Some(MapShading::new(asset, bound.as_ref(), taps)?) };
        Ok(AssetShading { bound, maps })
    }
}

impl ShadingModel for AssetShading<'_> {
    fn parameters_at(&self, triangle: usize, weights: [f32; 3], position: [f32; 3]) -> ShadingParameters<'_> {
        if let Some(material) = self.bound.as_ref().and_then(|bound| bound.material_of(triangle)) {
            return material.parameters_at(triangle, weights, position);
        }
        match &self.maps {
            Some(maps) => maps.parameters_at(triangle, weights, position),
            None => ShadingParameters { albedo: [0.0; 3], is_layered: false, highlights: Highlights::default() },
        }
    }
}

/// The reflectance maps of a decoded file.
struct MapShading<'a> {
    charts: &'a Charts,
    maps: &'a ReflectanceMaps,
    range: Option<SpecularRange>,
    /// Those of maps with lobes, which then have no range.
    lobes: Vec<PreparedSpecular>,
}

impl<'a> MapShading<'a> {
    fn new(asset: &'a Asset, bound: Option<&BoundMaterials>, taps: usize) -> Result<Self> {
        let (Some(charts), Some(maps)) = (&asset.charts, &asset.reflectance) else {
            let message = match bound {
                Some(bound) => format!("{} triangles have no material, and the file has no reflectance", bound.unbound()),
                None if !asset.materials.is_empty() => {
                    "this file has no reflectance, and its materials are bound to no triangle: `encoder::encode_modelled` binds them".into()
                }
                None => "this file has no reflectance; `encoder::encode_modelled` gives a mesh materials".into(),
            };
            return Err(Error::Unsupported(format!("relighting: {message}")));
        };
        if !maps.relightable {
            let message = "relighting: the lights of this asset's capture are unknown, so it has no reflectance";
            return Err(Error::Unsupported(message.into()));
        }
        let texels = charts.width as usize * charts.height as usize;
        let alike = |count: usize| count == texels || count == 0;
        let named = charts.chart_of_triangle.iter().all(|&c| (c as usize) < charts.charts.len());
        let sizes =
            maps.diffuse.data.len() == texels && alike(maps.specular.data.len()) && alike(maps.sigma.data.len());
        if texels == 0 || !sizes || !named || charts.chart_of_triangle.len() != asset.mesh.triangles.len() {
            return Err(Error::parameter("mesh, charts and reflectance maps do not belong together"));
        }
        let (least, most) = SIGMA_RANGE;
        let has_lobes = !maps.lobes.is_empty();
        let lobes = (0..if has_lobes { LOBES } else { 0 }).map(|lobe| Box::new(GgxLobe { lobe }));
        let lobes = lobes.map(|lobe| PreparedSpecular::new(SpecularPart::new(lobe), taps)).collect();
        let shiny = !has_lobes && !maps.specular.data.is_empty() && !maps.sigma.data.is_empty();
        let palette = Arc::new(PaletteTables::new(&maps.palette));
        let part = |sigma: f64| -> Result<Box<dyn Brdf + Send>> {
            if maps.palette.is_empty() {
                return Ok(Box::new(TorranceSparrow { sigma }));
            }
            Ok(Box::new(PaletteHighlight { palette: palette.clone(), sigma: sigma as f32 }))
        };
        let range = if shiny { Some(SpecularRange::new([least as f64, most as f64], taps, part)?) } else { None };
        Ok(MapShading { charts, maps, range, lobes })
    }
}

impl ShadingModel for MapShading<'_> {
    fn parameters_at(&self, triangle: usize, _: [f32; 3], position: [f32; 3]) -> ShadingParameters<'_> {
        let at = atlas_position(self.charts, triangle, DVec3::from_array(position.map(f64::from)));
        // K_d is radiance over irradiance.
        let albedo = sample_colour(&self.maps.diffuse, at).map(|c| c as f32 * std::f32::consts::PI);
        let mut highlights = Highlights::default();
        if let Some(range) = &self.range {
            let scale = sample_colour(&self.maps.specular, at).map(|c| c as f32);
            highlights = Highlights::single(scale, range.at(sample_number(&self.maps.sigma, at)));
        } else if !self.lobes.is_empty() {
            highlights = Highlights::of_lobes(&self.maps.lobe_weights(at), &self.lobes);
        }
        ShadingParameters { albedo, is_layered: !self.lobes.is_empty(), highlights }
    }
}

/// An image read at texture coordinates: `u` to the right, `v` upwards, repeated.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// Linear values.
    pub image: Grid<[f32; 3]>,
    /// Factor.
    pub scale: f32,
}

impl Texture {
    fn read(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        let (width, height) = (self.image.width, self.image.height);
        let place = |t: f32, size: usize| {
            let t = t - t.floor();
            if t.is_finite() { t * size as f32 - 0.5 } else { 0.0 }
        };
        let (x, y) = (place(u, width), place(1.0 - v, height));
        let wrap = |t: f32, size: usize| (t as isize).rem_euclid(size as isize) as usize;
        let (x0, x1) = (wrap(x.floor(), width), wrap(x.floor() + 1.0, width));
        let (y0, y1) = (wrap(y.floor(), height), wrap(y.floor() + 1.0, height));
        let (s, t) = (x - x.floor(), y - y.floor());
        let at = |x: usize, y: usize| Vec3::from_array(*self.image.value_at(x, y));
        let upper = at(x0, y0).lerp(at(x1, y0), s);
        let lower = at(x0, y1).lerp(at(x1, y1), s);
        (upper.lerp(lower, t) * self.scale).to_array()
    }
}

/// Textures that drive a material's parameters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Textures {
    /// Texture coordinates of each triangle's corners.
    pub coordinates: Vec<[[f32; 2]; 3]>,
    /// Diffuse albedo.
    pub diffuse: Option<Texture>,
    /// Factor of the specular part.
    pub specular: Option<Texture>,
    /// Width of the lobe, 0.005 to 2; the first colour counts.
    pub roughness: Option<Texture>,
    /// Exponent of the lobe in place of its width, 0.1 to 100000; the first colour counts.
    pub exponent: Option<Texture>,
}

impl Textures {
    /// The texture that drives the lobe's shape, and the range that its values are kept in.
    fn lobe(&self) -> Option<(&Texture, [f32; 2])> {
        let roughness = self.roughness.as_ref().map(|texture| (texture, ROUGHNESS));
        roughness.or(self.exponent.as_ref().map(|texture| (texture, EXPONENT)))
    }
}

/// A material with parameters driven by images.
pub struct TexturedShading {
    base: UniformMaterial,
    textures: Textures,
    range: Option<SpecularRange>,
}

impl TexturedShading {
    /// `part` makes the specular part for a roughness, or an exponent. Coordinates must be there for all `triangles`.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if coordinates are missing, a texture has no pixels, or both roughness and exponent have one.
    pub fn new(
        material: Material,
        textures: Textures,
        triangles: usize,
        taps: usize,
        part: impl Fn(f64) -> Result<Box<dyn Brdf + Send>> + Sync + Send,
    ) -> Result<Self> {
        if textures.coordinates.len() != triangles {
            return Err(Error::parameter("a material's textures need a mesh with texture coordinates (OBJ)"));
        }
        if textures.roughness.is_some() && textures.exponent.is_some() {
            return Err(Error::parameter("a material's lobe has a roughness or an exponent, not both"));
        }
        let pictures = [&textures.diffuse, &textures.specular, &textures.roughness, &textures.exponent];
        if pictures.iter().any(|t| t.as_ref().is_some_and(|t| t.image.data.is_empty())) {
            return Err(Error::parameter("a material's texture has no pixels"));
        }
        let range = match textures.lobe() {
            Some((texture, [low, high])) => {
                let values = texture.image.data.iter().map(|p| (p[0] * texture.scale).clamp(low, high));
                let (least, most) = values.fold((high, low), |(l, m), v| (l.min(v), m.max(v)));
                Some(SpecularRange::new([least as f64, most as f64], taps, part)?)
            }
            None => None,
        };
        Ok(TexturedShading { base: UniformMaterial::new(material, taps), textures, range })
    }
}

impl ShadingModel for TexturedShading {
    fn parameters_at(&self, triangle: usize, weights: [f32; 3], position: [f32; 3]) -> ShadingParameters<'_> {
        let base = self.base.parameters_at(triangle, weights, position);
        let (scale, prepared) = self.base.specular();
        let corners = self.textures.coordinates[triangle];
        let [a, b, c] = weights;
        let at = std::array::from_fn(|k| a * corners[0][k] + b * corners[1][k] + c * corners[2][k]);
        let read = |texture: &Option<Texture>, constant: [f32; 3]| texture.as_ref().map_or(constant, |t| t.read(at));
        let shape = || self.textures.lobe().map(|(t, [low, high])| t.read(at)[0].clamp(low, high) as f64);
        let specular = match &self.range {
            Some(range) => shape().and_then(|value| range.at(value)),
            None => prepared,
        };
        ShadingParameters {
            albedo: read(&self.textures.diffuse, base.albedo),
            is_layered: false,
            highlights: Highlights::single(read(&self.textures.specular, scale), specular),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_drive_parameters() {
        let image = Grid { width: 2, height: 1, data: vec![[0.1; 3], [0.5; 3]] };
        let texture = || Some(Texture { image: image.clone(), scale: 1.0 });
        let textures = Textures {
            coordinates: vec![[[0.25, 0.5], [0.75, 0.5], [0.25, 0.5]]],
            diffuse: texture(),
            roughness: texture(),
            ..Textures::default()
        };
        let material = Material { albedo: [1.0; 3], specular: None, specular_scale: [0.3; 3] };
        let part = |sigma: f64| Ok(Box::new(TorranceSparrow { sigma }) as Box<dyn Brdf + Send>);
        let look = TexturedShading::new(material, textures, 1, 8, part).unwrap();
        let (left, right) =
            (look.parameters_at(0, [1.0, 0.0, 0.0], [0.0; 3]), look.parameters_at(0, [0.0, 1.0, 0.0], [0.0; 3]));
        assert!((left.albedo[0] - 0.1).abs() < 1e-6 && (right.albedo[0] - 0.5).abs() < 1e-6);
        let width = |a: &ShadingParameters| a.highlights.iter().next().unwrap().1.specular.lobes[0].sharpness[0];
        assert!(width(&left) > 15.0 * width(&right), "{} {}", width(&left), width(&right));
        assert_eq!(left.highlights.scale().x, 0.3);
    }
}
