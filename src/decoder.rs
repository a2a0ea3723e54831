//! From a file back to photographs, mesh and reflectance: the encoder's stages from bottom to top.

use crate::asset::Asset;
use crate::brdf::materials;
use crate::container::{Container, Tag, metadata};
use crate::error::{Error, Result};
use crate::limits::{Limits, Reservation};
use crate::mesh::Mesh;
use crate::predictive::header::{PREFIX_BYTES, PlaneHeader};
use crate::predictive::workspace::photograph_bytes;
use crate::reflectance::codec as reflectance_code;
use crate::surface::{charts, raster};
use crate::views::codec;
use crate::views::{Photograph, View};
use crate::{Budget, lighting, mesh, predictive, visibility, wavelet_texture};
use std::io::{Read, Seek};

pub(crate) mod arriving;

pub use arriving::{FileHeader, IncrementalDecoder, PhotographCoding, ViewPhotograph, ViewStatus};

/// Which photographs to decode.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum ViewSelection {
    /// All of them.
    #[default]
    All,
    /// None: mesh, views, reflectance only.
    None,
    /// These, by index in the file's views; what they are predicted from is read, too.
    Views(Vec<usize>),
}

impl ViewSelection {
    fn includes(&self, view: usize) -> bool {
        match self {
            ViewSelection::All => true,
            ViewSelection::None => false,
            ViewSelection::Views(views) => views.contains(&view),
        }
    }
}

/// What decoding may use and what it should give.
#[derive(Debug, Clone, Default)]
pub struct DecodeOptions {
    /// Bounds on what the file may ask for.
    pub limits: Limits,
    /// Photographs wanted.
    pub selection: ViewSelection,
}

/// Decodes a file in memory.
pub fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Asset> {
    decode_from(&mut Container::open_slice(bytes, options.limits)?, options)
}

/// Decodes an open file; reads only the sections, and of the planes only the views, that are asked for.
pub fn decode_from<R: Read + Seek>(file: &mut Container<R>, options: &DecodeOptions) -> Result<Asset> {
    let mut asset = decode_model(file, options)?;
    let mut photographs = std::mem::take(&mut asset.photographs);
    for (view, _) in asset.views.iter().enumerate().filter(|(view, _)| options.selection.includes(*view)) {
        let bytes = photograph_bytes(&asset.views[view].camera, asset.components.len());
        file.budget().charge("decoded photographs", bytes)?;
    }
    decode_photographs(file, &asset, options, |_, given| {
        given.into_iter().for_each(|(view, photograph)| photographs[view] = Some(photograph));
        Ok(())
    })?;
    asset.photographs = photographs;
    Ok(asset)
}

/// Returns the views of a file, without their photographs.
/// # Errors
/// [`Error::Format`] if the section is missing or damaged, [`Error::Limits`] if it exceeds the budget of `file`.
pub fn read_views<R: Read + Seek>(file: &mut Container<R>) -> Result<Vec<View>> {
    let budget = file.budget();
    Ok(codec::decode(&file.read_section(Tag::VIEWS)?, &budget)?.views)
}

/// Decodes an open file and hands the photographs that are asked for to `done`, with their views' indices and everything else that the
/// file holds, some at a time and in any order: memory does not grow with their number. The returned asset has none.
/// # Errors
/// Those of [`decode_from`], and those of `done`.
pub fn decode_each<R: Read + Seek>(
    file: &mut Container<R>,
    options: &DecodeOptions,
    done: impl FnMut(&Asset, Vec<(usize, Photograph)>) -> Result<()>,
) -> Result<Asset> {
    let asset = decode_model(file, options)?;
    decode_photographs(file, &asset, options, done)?;
    Ok(asset)
}

/// Everything but photographs.
fn decode_model<R: Read + Seek>(file: &mut Container<R>, options: &DecodeOptions) -> Result<Asset> {
    let budget = file.budget();
    // 6. Container.
    let metadata = match file.read_optional(Tag::METADATA)? {
        Some(content) => metadata::decode(&content, &budget)?.0,
        None => Default::default(),
    };
    // What stands for itself needs no views, and some of it no mesh.
    let has = |tags: &[Tag]| tags.iter().any(|&tag| file.find(tag).is_some());
    let alone = has(&[Tag::VISIBILITY, Tag::LIGHT, Tag::MATERIALS]);
    let needs_views = !alone || has(&[Tag::VIEWS, Tag::PLANES, Tag::WAVELET_TEXTURE]);
    let needs_mesh = !alone || needs_views || has(&[Tag::MESH, Tag::VISIBILITY, Tag::CHARTS]);
    let section = match needs_views {
        true => codec::decode(&file.read_section(Tag::VIEWS)?, &budget)?,
        false => codec::ViewsSection { white: [1.0; 3], components: Vec::new(), views: Vec::new() },
    };
    // 2. Mesh.
    let mesh = match needs_mesh {
        true => mesh::codec::decode(&file.read_section(Tag::MESH)?, &budget)?,
        false => Default::default(),
    };
    if let ViewSelection::Views(wanted) = &options.selection
        && let Some(view) = wanted.iter().find(|&&view| view >= section.views.len())
    {
        return Err(Error::parameter(format!(
            "view {view} does not exist: the file has {} views",
            section.views.len()
        )));
    }
    // 4. Reflectance.
    let charts = file.read_optional(Tag::CHARTS)?.map(|bytes| charts::decode(&bytes, &mesh, &budget)).transpose()?;
    let reflectance = match (&charts, file.read_optional(Tag::REFLECTANCE)?) {
        (Some(charts), Some(bytes)) => Some(reflectance_code::decode(&bytes, &mesh, charts, &budget)?),
        _ => None,
    };
    // Precomputed: what the vertices see, and light.
    let visibility = file.read_optional(Tag::VISIBILITY)?;
    let visibility = visibility.map(|bytes| visibility::codec::decode(&bytes, &mesh, &budget)).transpose()?;
    let light = file.read_optional(Tag::LIGHT)?.map(|bytes| lighting::codec::decode(&bytes, &budget)).transpose()?;
    // Materials.
    let materials = match file.read_optional(Tag::MATERIALS)? {
        Some(bytes) => materials::decode_materials(&bytes, &budget)?,
        None => Vec::new(),
    };
    let codec::ViewsSection { white, components, views } = section;
    let photographs = vec![None; views.len()];
    Ok(Asset {
        metadata,
        mesh,
        charts,
        reflectance,
        white,
        components,
        views,
        photographs,
        materials,
        visibility,
        light,
    })
}

/// 5. Residual.
fn decode_photographs<R: Read + Seek>(
    file: &mut Container<R>,
    asset: &Asset,
    options: &DecodeOptions,
    mut done: impl FnMut(&Asset, Vec<(usize, Photograph)>) -> Result<()>,
) -> Result<()> {
    let budget = file.budget();
    let lost = metadata::lost_views(&asset.metadata);
    let wanted = |view: usize| options.selection.includes(view) && !lost.contains(&view);
    if options.selection == ViewSelection::None {
        return Ok(());
    }
    if file.find(Tag::PLANES).is_some() {
        return predictive_photographs(file, asset, wanted, &budget, |given| done(asset, given));
    }
    if file.find(Tag::WAVELET_TEXTURE).is_some() {
        let bytes = file.read_section(Tag::WAVELET_TEXTURE)?;
        let decoded = wavelet_texture::decode(&bytes, &asset.mesh, &asset.components, asset.views.len(), &budget)?;
        for (index, view) in asset.views.iter().enumerate().filter(|(index, _)| wanted(*index)) {
            let _held = hold_wavelet_photograph(&asset.mesh, view, asset.components.len(), &budget)?;
            done(asset, vec![(index, wavelet_texture::decode::photograph(&decoded, &asset.mesh, view, index))])?;
        }
    }
    Ok(())
}

/// Photographs of profile `predictive`: the head of the section, then the streams of the views that are needed.
fn predictive_photographs<R: Read + Seek>(
    file: &mut Container<R>,
    asset: &Asset,
    wanted: impl Fn(usize) -> bool + Sync + Send,
    budget: &Budget,
    done: impl FnMut(Vec<(usize, Photograph)>) -> Result<()>,
) -> Result<()> {
    let prefix = file.read_range(Tag::PLANES, 0, PREFIX_BYTES as u64)?;
    let length = PREFIX_BYTES as u64 + PlaneHeader::head_bytes(&prefix)?;
    let head = file.read_range(Tag::PLANES, 0, length)?;
    let header = PlaneHeader::parse(&head, asset.views.len(), asset.components.len(), budget)?;
    let stored = file.find(Tag::PLANES).map_or(0, |s| s.stored);
    if stored != length + header.stream_bytes() {
        return Err(Error::format(Tag::PLANES, length, "the streams are not as long as the head says"));
    }
    let read = |step: &predictive::header::CodedEntry| {
        let bytes = step.lengths.iter().map(|&l| l as u64).sum();
        file.read_range(Tag::PLANES, length + step.offset, bytes).map(Some)
    };
    let capture = (&asset.views[..], asset.white);
    predictive::decode::for_each_view(&header, &asset.mesh, capture, wanted, read, budget, done)
}

/// Charges what a photograph of profile `wavelet-texture` takes and checks that drawing it is bounded work.
fn hold_wavelet_photograph<'b>(
    mesh: &Mesh,
    view: &View,
    components: usize,
    budget: &'b Budget,
) -> Result<Reservation<'b>> {
    raster::check_work(mesh, &view.camera)?;
    let pixels = view.camera.width as u64 * view.camera.height as u64;
    budget.reserve("a view being decoded", pixels.saturating_mul(32 + 12 * components as u64))
}
