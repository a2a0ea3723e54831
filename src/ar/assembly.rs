//! Several assets on one ground, drawn as one object: they hide each other, and shadow each other and the ground.

use super::ArObject;
use super::placement::Placement;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::mesh::{CornerCoordinates, Mesh};
use crate::relight::{AssetShading, Occlusion, RenderObject, ShadingModel, ShadingParameters};
use crate::surface::displacement::coarser;
use crate::visibility::{BakeOptions, bake};
use glam::Vec3;

/// Vertices of all surfaces together, at most, at which visibility is computed; surfaces are drawn as coarse as that takes.
const MAX_VERTICES: usize = 60_000;

/// Assets that stand still to each other, in world axes.
pub struct ArAssembly<'a> {
    mesh: Mesh,
    occlusion: Occlusion,
    shading: AssemblyShading<'a>,
    placement: Placement,
    /// Texture coordinates of all triangles, where an asset has any; of others a single point.
    coordinates: Option<Vec<CornerCoordinates>>,
}

impl<'a> ArAssembly<'a> {
    /// Puts assets together, each as it is placed, and computes what every vertex sees of the others. The ground lies at the lowest of the heights
    /// that they are placed at. `taps` as in [`AssetShading::new`].
    ///
    /// # Errors
    ///
    /// Those of [`AssetShading::new`]; [`Error::Parameter`] without assets.
    pub fn new(assets: &[(&'a Asset, Placement)], taps: usize) -> Result<Self> {
        if assets.is_empty() {
            return Err(Error::parameter("an assembly has at least one asset"));
        }
        let mut mesh = Mesh::default();
        let mut parts = Vec::new();
        let mut coordinates = Vec::new();
        let count = |dropped: u32| -> usize {
            let levels = |asset: &Asset| asset.surface.as_ref().map_or(0, |s| s.levels().saturating_sub(dropped));
            assets.iter().map(|(asset, _)| asset.mesh.positions.len() << (2 * levels(asset))).sum()
        };
        let deepest = assets.iter().filter_map(|(asset, _)| Some(asset.surface.as_ref()?.levels())).max().unwrap_or(0);
        let dropped = (0..deepest).find(|&dropped| count(dropped) <= MAX_VERTICES).unwrap_or(deepest);
        for &(asset, placement) in assets {
            let (drawn, levels) = drawn_mesh(asset, dropped);
            let (vertices, triangle) = (mesh.positions.len(), mesh.triangles.len());
            if vertices + drawn.positions.len() > u32::MAX as usize {
                return Err(Error::parameter("the assets have too many vertices together"));
            }
            let place = |p: &[f32; 3]| placement.point_to_world(p.map(f64::from)).map(|x| x as f32);
            mesh.positions.extend(drawn.positions.iter().map(place));
            mesh.triangles.extend(drawn.triangles.iter().map(|t| t.map(|v| v + vertices as u32)));
            match asset.coordinates.as_ref().filter(|own| own.len() == drawn.triangles.len()) {
                Some(own) => coordinates.extend_from_slice(own),
                None => coordinates.resize(mesh.triangles.len(), [[0.0; 2]; 3]),
            }
            let shading = AssetShading::new(asset, taps)?;
            parts.push(AssemblyPart { triangle, base: &asset.mesh, levels, shading });
        }
        let ground = assets.iter().map(|(_, placement)| placement.ground).fold(f64::MAX, f64::min);
        let occlusion = Occlusion::from_visibility(&bake(&mesh, &BakeOptions::default())?.visibility);
        let rotation = crate::marker::Pose::IDENTITY.rotation;
        let placement = Placement { rotation, scale: 1.0, translation: [0.0; 3], ground };
        let has_any = assets.iter().any(|(asset, _)| asset.coordinates.is_some());
        let coordinates = has_any.then_some(coordinates);
        Ok(ArAssembly { mesh, occlusion, shading: AssemblyShading { parts }, placement, coordinates })
    }

    /// Prepares what a [`super::Session`] draws.
    ///
    /// # Errors
    ///
    /// Those of [`RenderObject::new`].
    pub fn object(&self) -> Result<ArObject<'_>> {
        let object = RenderObject::new(&self.mesh, Some(&self.occlusion))?;
        let object = match &self.coordinates {
            Some(coordinates) => object.with_coordinates(coordinates)?,
            None => object,
        };
        Ok(ArObject { object, shading: &self.shading, placement: self.placement, detail: None })
    }
}

/// What is drawn of an asset without some subdivisions of its surface, and the subdivisions that it has.
fn drawn_mesh(asset: &Asset, dropped: u32) -> (std::borrow::Cow<'_, Mesh>, u32) {
    match asset.surface.as_ref().map(|surface| (surface, surface.levels().saturating_sub(dropped))) {
        None | Some((_, 0)) => (std::borrow::Cow::Borrowed(&asset.mesh), 0),
        Some((surface, levels)) if levels == surface.levels() => (std::borrow::Cow::Borrowed(surface.mesh()), levels),
        Some((surface, levels)) => (std::borrow::Cow::Owned(surface.without_levels(dropped)), levels),
    }
}

/// Asset of an assembly: its first triangle in the whole, and the mesh under what is drawn.
struct AssemblyPart<'a> {
    triangle: usize,
    base: &'a Mesh,
    levels: u32,
    shading: AssetShading<'a>,
}

/// Reflectance of the assets of an assembly.
struct AssemblyShading<'a> {
    parts: Vec<AssemblyPart<'a>>,
}

impl ShadingModel for AssemblyShading<'_> {
    fn parameters_at(&self, triangle: usize, weights: [f32; 3], _: [f32; 3]) -> ShadingParameters<'_> {
        let part = self.parts.partition_point(|part| part.triangle <= triangle).saturating_sub(1);
        let part = &self.parts[part];
        let (triangle, weights) = coarser(triangle - part.triangle, weights.map(f64::from), part.levels);
        let weights = weights.map(|w| w as f32);
        let corners = part.base.triangles[triangle].map(|v| Vec3::from_array(part.base.positions[v as usize]));
        let position = (0..3).map(|k| corners[k] * weights[k]).sum::<Vec3>();
        part.shading.parameters_at(triangle, weights, position.to_array())
    }
}
