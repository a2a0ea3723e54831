//! The reflectance stage of the encoder: an atlas, fitted maps, and both as sections.

use super::codec::{self, MapSteps};
use super::gather::{ReflectanceSources, fit_maps};
use super::maps::{COLOUR_LEVELS, ReflectanceMaps};
use super::torrance_sparrow::SIGMA_LEVELS;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::options::{EncodeOptions, SpecularModel};
use crate::surface::atlas;
use crate::surface::charts::{self, Charts};
use crate::surface::displacement::{self, DisplacedMesh, Displacements};
use crate::views::source::PhotographSource;
use crate::views::{Component, View};

/// Value of a bit of the reflectance maps, in squared steps.
const MAP_LAMBDA: f32 = 0.15;

/// Reflectance maps fitted once, to be coded at the quality of each trial of the rate control.
#[derive(Debug)]
pub(crate) struct ReflectanceEncoder<'a> {
    mesh: &'a Mesh,
    charts: Charts,
    chart_bytes: Vec<u8>,
    maps: ReflectanceMaps,
    displacement_bytes: Option<Vec<u8>>,
    surface: Option<DisplacedMesh>,
}

/// What is known of a mesh's surface beside its shape.
#[derive(Debug, Default)]
pub(crate) struct ReflectanceSurface<'a> {
    /// The surface, where it is finer than the mesh.
    pub(crate) displacements: Option<&'a Displacements<'a>>,
    /// Irradiance of the mesh's vertices, where the light is an environment and not the lamps of the views.
    pub(crate) irradiance: Option<&'a [[f32; 3]]>,
}

/// About the most texels of the atlas, so that readers decode it within their default memory.
const MAX_TEXELS: f64 = 4e6;

impl<'a> ReflectanceEncoder<'a> {
    /// Lays out the atlas of the mesh and fits reflectance to the photographs.
    /// # Errors
    /// [`crate::Error::Parameter`] if the atlas has too many texels at `options.atlas_density`.
    pub(crate) fn new(
        mesh: &'a Mesh,
        views: &[View],
        components: &[Component],
        photographs: &dyn PhotographSource,
        surface: &ReflectanceSurface,
        options: &EncodeOptions,
    ) -> Result<Self> {
        let cameras: Vec<_> = views.iter().map(|v| v.camera).collect();
        let density = atlas::texels_per_unit(mesh, &cameras, options.atlas_density);
        // More than a few texels for a pixel of all photographs together hold nothing more.
        let pixels: f64 = cameras.iter().map(|camera| f64::from(camera.width) * f64::from(camera.height)).sum();
        let per_pixel = 4.0 + 16.0 * options.atlas_density.powi(2);
        let most = (1 << 20) as f64 + per_pixel * pixels;
        let mut charts = atlas::layout_within(mesh, density, most)?;
        let texels = charts.width as f64 * charts.height as f64;
        if texels > MAX_TEXELS {
            charts = atlas::layout_within(mesh, density * (MAX_TEXELS / texels).sqrt(), most)?;
        }
        let chart_bytes = charts::encode(mesh, &charts)?;
        let raster = atlas::rasterise_atlas(mesh, &charts)?;
        let displaced = surface
            .displacements
            .map(|displacements| displacement::encode(displacements, mesh, &charts))
            .transpose()?;
        let (displacement_bytes, finer) = displaced.unzip();
        let irradiance = surface.irradiance;
        let surface = finer.as_ref();
        let specular = match options.specular {
            SpecularModel::Automatic if surface.is_some() => SpecularModel::GgxLobes,
            SpecularModel::Automatic => SpecularModel::TorranceSparrow,
            chosen => chosen,
        };
        let sources = ReflectanceSources { mesh, surface, views, components, photographs, specular, irradiance };
        let maps = fit_maps(&sources, &charts, &raster)?;
        Ok(ReflectanceEncoder { mesh, charts, chart_bytes, maps, displacement_bytes, surface: finer })
    }

    /// The content of section `CHRT`.
    pub(crate) fn chart_bytes(&self) -> &[u8] {
        &self.chart_bytes
    }

    /// The content of section `DISP`, if the surface is finer than the mesh.
    pub(crate) fn displacement_bytes(&self) -> Option<&[u8]> {
        self.displacement_bytes.as_deref()
    }

    /// The atlas.
    pub(crate) fn charts(&self) -> &Charts {
        &self.charts
    }

    /// The surface as the decoder has it, if it is finer than the mesh.
    pub(crate) fn surface(&self) -> Option<&DisplacedMesh> {
        self.surface.as_ref()
    }

    /// Returns the content of section `RFLC`, and the maps as the decoder has them, for photographs coded with quantiser step `step`.
    ///
    /// The maps carry the appearance between captured views; they are coded a little coarser than the photographs.
    pub(crate) fn encode(&self, step: f32) -> Result<(Vec<u8>, ReflectanceMaps)> {
        let relative = (step * 2.0).clamp(0.08, 0.25);
        let colour = relative * COLOUR_LEVELS as f32;
        let sigma = 2.0 * relative * SIGMA_LEVELS as f32;
        let steps = MapSteps { diffuse: 0.5 * colour, specular: colour, sigma };
        codec::encode(&self.maps, self.mesh, &self.charts, &steps, MAP_LAMBDA)
    }
}
