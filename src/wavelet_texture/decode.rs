//! Reading the section, and radiance from what it holds.

use super::layout::{PatchLayout, interpolate_grid};
use super::model::{CodedReflectionModel, ReflectionModel};
use super::stream::{VolumeModels, code_volume};
use super::{HEADER_BYTES, WaveletHeader};
use crate::container::Tag;
use crate::entropy::{BitCoder, RangeDecoder};
use crate::error::{Error, Result};
use crate::image::{Mask, RgbImage};
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::parallel;
use crate::quantise::dead_zone::DeadZone;
use crate::residual::volume::{VolumeScratch, restore};
use crate::surface::patches::{MAX_SIDE_LOG2, PatchPoint};
use crate::surface::raster;
use crate::transform::colour::{self, ColourRotation};
use crate::transform::daubechies::VolumeShape;
use crate::views::{Component, Photograph, View};

/// A decoded section.
#[derive(Debug, Clone)]
pub struct DecodedWaveletTexture {
    /// The patches.
    pub layout: PatchLayout,
    /// The components, in the asset's order.
    pub components: Vec<Component>,
    /// Number of captured views.
    pub views: usize,
    /// The reflection model; absent where the file was written without.
    pub model: Option<ReflectionModel>,
    /// For each patch and each component the residual, linear radiance, signed: view by view, in rows.
    pub residual: Vec<Vec<Vec<[f32; 3]>>>,
}

/// Reads a section for the given decoded mesh, components and number of views.
pub fn decode(
    bytes: &[u8],
    mesh: &Mesh,
    components: &[Component],
    views: usize,
    budget: &Budget,
) -> Result<DecodedWaveletTexture> {
    let header = WaveletHeader::parse(bytes)?;
    let wrong = |offset: usize, message: &str| Error::format(Tag::WAVELET_TEXTURE, offset as u64, message);
    if header.components as usize != components.len() || header.views as usize != views {
        return Err(wrong(2, "components and views differ from the asset's"));
    }
    let vertices = mesh.positions.len() as u64;
    if mesh.triangles.iter().flatten().any(|&v| v as u64 >= vertices) {
        return Err(Error::parameter("the mesh refers to vertices that it does not have"));
    }
    budget.charge_items("patches", vertices + mesh.triangles.len() as u64, 160)?;
    let mut layout = PatchLayout::new(mesh);
    if header.patches as usize != layout.patches.len() {
        return Err(wrong(8, "the number of patches differs from the mesh's"));
    }
    let mut coder = RangeDecoder::new(&bytes[HEADER_BYTES..]);
    let exhausted = || wrong(bytes.len(), "the coded data end early");
    code_sides(&mut coder, &mut layout.side_log2);
    let shapes: Vec<VolumeShape> =
        layout.side_log2.iter().map(|&log2| VolumeShape::padded(log2, views, header.view_levels)).collect();

    let mut model = None;
    if header.modelled {
        let texels: u64 = shapes.iter().map(|s| s.area() as u64).sum();
        budget.charge_items("reflectance of patches", texels * 3 + vertices * 4, 8)?;
        let mut coded = CodedReflectionModel {
            diffuse_scale: header.diffuse_scale,
            diffuse_step: header.diffuse_step,
            rotation: header.rotations[0],
            diffuse: shapes.iter().map(|s| std::array::from_fn(|_| vec![0; s.area()])).collect(),
            specular_scale: header.specular_scale,
            lobes: vec![[0; 4]; if header.lobes { mesh.positions.len() } else { 0 }],
        };
        if !coded.code(&mut coder, &layout, |coder| !coder.is_exhausted()) {
            return Err(exhausted());
        }
        model = Some(coded.dequantise(&layout, header.relightable));
    }

    let samples: u64 = shapes.iter().map(|s| s.len() as u64).sum();
    // Levels and samples exist side by side.
    budget.charge_items("residual volumes", samples.saturating_mul(components.len() as u64 * 3), 8)?;
    let mut models = VolumeModels::new(components.len());
    let mut levels = Vec::with_capacity(shapes.len());
    for &shape in &shapes {
        let mut planes = vec![vec![0i32; shape.len()]; components.len() * 3];
        code_volume(&mut coder, &mut models, &mut planes, components.len(), shape);
        if coder.is_exhausted() {
            return Err(exhausted());
        }
        levels.push(planes);
    }
    if !coder.ends_as_written(0) {
        return Err(wrong(HEADER_BYTES, "bytes do not end with the last patch"));
    }
    let residual = parallel::map(shapes.len(), |patch| {
        levels[patch]
            .chunks_exact(3)
            .zip(&header.rotations[1..])
            .map(|(planes, rotation)| restore_component(planes, shapes[patch], views, &header.quantiser, rotation))
            .collect()
    });
    Ok(DecodedWaveletTexture { layout, components: components.to_vec(), views, model, residual })
}

/// One component's residual in one patch from its levels.
fn restore_component(
    planes: &[Vec<i32>],
    shape: VolumeShape,
    views: usize,
    quantiser: &DeadZone,
    rotation: &ColourRotation,
) -> Vec<[f32; 3]> {
    let coefficients: Vec<[f32; 3]> =
        (0..shape.len()).map(|i| std::array::from_fn(|c| quantiser.dequantise(planes[c][i]))).collect();
    let mut samples = restore(coefficients, shape, views, &mut VolumeScratch::default());
    samples.iter_mut().for_each(|x| *x = colour::inverse(rotation, *x));
    samples
}

/// Codes the patches' sides, each by the one before it.
pub(super) fn code_sides<C: BitCoder>(coder: &mut C, sides: &mut [u8]) {
    let mut models = [[crate::entropy::BitModel::default(); 4]; MAX_SIDE_LOG2 as usize + 1];
    let mut last = 0;
    for side in sides {
        let mut read = 1;
        while read < MAX_SIDE_LOG2 && models[last as usize][read as usize].code(coder, read < *side) {
            read += 1;
        }
        *side = read;
        last = read;
    }
}

impl DecodedWaveletTexture {
    /// Residual of a component in a captured view at a place of the surface; linear radiance, signed.
    pub fn residual_on(&self, component: usize, view: usize, triangle: u32, barycentric: [f64; 3]) -> [f32; 3] {
        self.layout
            .locate(triangle, barycentric)
            .map_or([0.0; 3], |(patch, _, at)| self.residual_at(component, view, patch, at))
    }
    /// Modelled radiance of a component at a place of the surface, for any camera and light.
    pub fn modelled_on(&self, component: usize, view: &View, triangle: u32, barycentric: [f64; 3]) -> [f32; 3] {
        self.layout
            .locate(triangle, barycentric)
            .map_or([0.0; 3], |(patch, point, at)| self.modelled_at(component, view, patch, &point, at))
    }
    /// `K_d` (the mean radiance where the lights were unknown) at a place of the surface.
    pub fn diffuse_reflectance(&self, triangle: u32, barycentric: [f64; 3]) -> Option<[f32; 3]> {
        let (patch, _, at) = self.layout.locate(triangle, barycentric)?;
        let grid = &self.model.as_ref()?.diffuse[patch];
        Some(interpolate_grid(self.layout.side_log2[patch], at, grid).map(|k| k.max(0.0)))
    }
    /// The highlight's parameters at a place of the surface.
    pub fn lobe_on(&self, triangle: u32, barycentric: [f64; 3]) -> Option<crate::reflectance::TorranceSparrowLobe> {
        let (patch, point, _) = self.layout.locate(triangle, barycentric)?;
        let model = self.model.as_ref().filter(|model| !model.lobes.is_empty())?;
        Some(model.lobe_at(&self.layout, patch, &point))
    }
    /// A captured view: model and residual at every pixel where `hit(x, y)` gives a triangle and the weights of its
    /// vertices.
    pub fn photograph(
        &self,
        index: usize,
        view: &View,
        hit: impl Fn(usize, usize) -> Option<(u32, [f64; 3])> + Sync + Send,
    ) -> Photograph {
        let (width, height) = (view.camera.width as usize, view.camera.height as usize);
        let count = self.components.len();
        let rows = parallel::map(height, |y| {
            let mut row = vec![[0.0f32; 3]; width * count];
            let mut mask = vec![false; width];
            for x in 0..width {
                let Some((triangle, barycentric)) = hit(x, y) else { continue };
                let Some((patch, point, at)) = self.layout.locate(triangle, barycentric) else { continue };
                mask[x] = true;
                for component in 0..count {
                    let model = self.modelled_at(component, view, patch, &point, at);
                    let residual = self.residual_at(component, index, patch, at);
                    row[component * width + x] = std::array::from_fn(|c| model[c] + residual[c]);
                }
            }
            (mask, row)
        });
        let mut mask = Mask { width, height, data: Vec::with_capacity(width * height) };
        let mut images = vec![RgbImage { width, height, data: Vec::with_capacity(width * height) }; count];
        for (shown, row) in rows {
            mask.data.extend(shown);
            images.iter_mut().zip(row.chunks_exact(width.max(1))).for_each(|(image, row)| image.data.extend(row));
        }
        Photograph { mask, images }
    }
    /// Decoded radiance of a component at a grid sample in a captured view.
    pub fn radiance_at_sample(
        &self,
        component: usize,
        index: usize,
        view: &View,
        patch: usize,
        sample: usize,
    ) -> Option<[f32; 3]> {
        let side_log2 = self.layout.side_log2[patch];
        let side = 1usize << side_log2;
        let point = self.layout.grid_point(patch, sample % side, sample / side)?;
        let model =
            predicted(self.model.as_ref(), &self.layout, &self.components, component, patch, sample, &point, view);
        let at = (index << (2 * side_log2)) + sample;
        let residual = self.residual[patch][component][at];
        Some(std::array::from_fn(|c| model[c] + residual[c]))
    }
    fn residual_at(&self, component: usize, view: usize, patch: usize, at: [f64; 2]) -> [f32; 3] {
        let side_log2 = self.layout.side_log2[patch];
        let start = view << (2 * side_log2);
        interpolate_grid(side_log2, at, &self.residual[patch][component][start..])
    }
    fn modelled_at(&self, component: usize, view: &View, patch: usize, point: &PatchPoint, at: [f64; 2]) -> [f32; 3] {
        match (&self.model, self.components[component]) {
            (None, _) => [0.0; 3],
            (Some(model), Component::Specular) => model.specular_at(&self.layout, patch, point, view),
            (Some(model), _) => model.diffuse_at(&self.layout, patch, point, at, view),
        }
    }
}

/// Modelled radiance of a component at a grid sample.
#[allow(clippy::too_many_arguments)]
pub(super) fn predicted(
    model: Option<&ReflectionModel>,
    layout: &PatchLayout,
    components: &[Component],
    component: usize,
    patch: usize,
    sample: usize,
    point: &PatchPoint,
    view: &View,
) -> [f32; 3] {
    match (model, components[component]) {
        (None, _) => [0.0; 3],
        (Some(model), Component::Specular) => model.specular_at(layout, patch, point, view),
        (Some(model), _) => model.diffuse_sample(layout, patch, sample, point, view),
    }
}

/// Draws the photographs of profile `wavelet-texture`: model plus residual at every pixel that meets the mesh.
pub fn photographs(
    decoded: &DecodedWaveletTexture,
    mesh: &Mesh,
    views: &[View],
    wanted: impl Fn(usize) -> bool,
) -> Vec<Option<Photograph>> {
    let wanted = |(index, view): (usize, &View)| wanted(index).then(|| photograph(decoded, mesh, view, index));
    views.iter().enumerate().map(wanted).collect()
}

pub(crate) fn photograph(decoded: &DecodedWaveletTexture, mesh: &Mesh, view: &View, index: usize) -> Photograph {
    let raster = raster::rasterise(mesh, &view.camera);
    decoded.photograph(index, view, |x, y| {
        let at = y * raster.width + x;
        let [b, c] = raster.barycentric[at].map(f64::from);
        raster.is_covered(at).then_some((raster.triangle[at], [1.0 - b - c, b, c]))
    })
}
