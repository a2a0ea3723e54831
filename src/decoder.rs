//! From a file back to photographs, mesh and reflectance: the encoder's stages ([`crate::encoder`]) from bottom to top.
//!
//! Every stage decodes one section, or names the ranges of the file that it needs (`stages`, [`Poll`](crate::container::Poll)).
//! Two drivers run them: [`decode_from`] here, which reads the ranges from a file and decodes views side by side, and
//! [`IncrementalDecoder`], which hands them to its caller and decodes one view at a time.

use crate::asset::Asset;
use crate::container::{Container, metadata};
use crate::error::{Error, Result};
use crate::image::Region;
use crate::limits::Limits;
use crate::predictive::decode::PlaneDecoder;
use crate::predictive::low_camera;
use crate::predictive::model::PredictionModel;
use crate::predictive::workspace::photograph_bytes;
use crate::transform::shape_adaptive::level_count;
use crate::views::codec::ViewsSection;
use crate::views::{Photograph, View};
use std::borrow::Cow;
use std::io::{Read, Seek};
use std::ops::Range;
use std::sync::Arc;

pub(crate) mod incremental;
mod stages;

pub use incremental::{FileHeader, IncrementalDecoder, ViewPhotograph, ViewStatus};
pub use stages::PhotographCoding;

/// Photographs to decode.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum ViewSelection {
    /// All of them.
    #[default]
    All,
    /// None: mesh, views, reflectance only.
    None,
    /// These, by index in the file's views; those they are predicted from are read, too.
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

    /// # Errors
    /// [`Error::Parameter`] for a view that a file of so many views has not.
    fn check(&self, views: usize) -> Result<()> {
        match self {
            ViewSelection::Views(selected) => match selected.iter().find(|&&view| view >= views) {
                Some(view) => Err(Error::parameter(format!("view {view} does not exist: the file has {views} views"))),
                None => Ok(()),
            },
            _ => Ok(()),
        }
    }
}

/// Decoder options.
#[derive(Debug, Clone, Default)]
pub struct DecodeOptions {
    /// Bounds on what the file may ask for.
    pub limits: Limits,
    /// Photographs to decode.
    pub selection: ViewSelection,
    /// How often the photographs' size is halved, 0 to 5 (profile `predictive` only): nothing is read or decoded of the finer levels. The
    /// cameras of the views are those of the smaller photographs.
    pub reduction: u8,
    /// Decodes only this region of each selected photograph, in pixels of its size after the reduction; the same bits as there. Profile
    /// `predictive` reads and decodes of the levels that are coded in tiles only what the region takes; the coarser ones, from which views are
    /// predicted, cost what they cost for the whole photograph. The cameras of these views are those of the region.
    pub region: Option<Region>,
    /// Leaves out of the asset what photographs are not: atlas, finer surface, reflectance, visibility, light and materials. What photographs are
    /// predicted from is read all the same.
    pub photographs_only: bool,
}

/// Decodes a file in memory.
/// # Errors
/// As [`decode_from`], and those of [`Container::open_slice`].
pub fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Asset> {
    decode_from(&mut Container::open_slice(bytes, options.limits)?, options)
}

/// Decodes an open file; reads only the sections, and of section PLAN only the views, that are selected.
/// # Errors
/// [`Error::Format`] if a section is damaged or missing, [`Error::Unsupported`] for codings of later versions,
/// [`Error::Limits`] if the memory budget is exceeded, [`Error::Parameter`] if a selected view does not exist.
pub fn decode_from<R: Read + Seek>(file: &mut Container<R>, options: &DecodeOptions) -> Result<Asset> {
    let (mut asset, views) = decode_model(file, options)?;
    let mut photographs = std::mem::take(&mut asset.photographs);
    for (_, view) in asset.views.iter().enumerate().filter(|(index, _)| options.selection.includes(*index)) {
        file.budget().charge("decoded photographs", photograph_bytes(&view.camera, asset.components.len()))?;
    }
    decode_photographs(file, (&asset, &views), options, |_, given| {
        given.into_iter().for_each(|(view, photograph)| photographs[view] = Some(photograph));
        Ok(())
    })?;
    asset.photographs = photographs;
    Ok(asset)
}

/// Decodes an open file and calls `done` with the selected photographs, their views' indices and everything else that the
/// file holds, some at a time and in any order: memory does not grow with their number. The returned asset has none.
/// # Errors
/// As [`decode_from`], and those of `done`.
pub fn decode_each<R: Read + Seek>(
    file: &mut Container<R>,
    options: &DecodeOptions,
    done: impl FnMut(&Asset, Vec<(usize, Photograph)>) -> Result<()>,
) -> Result<Asset> {
    let (asset, views) = decode_model(file, options)?;
    decode_photographs(file, (&asset, &views), options, done)?;
    Ok(asset)
}

/// Returns the views of a file, without their photographs.
/// # Errors
/// [`Error::Format`] if the section is missing or damaged, [`Error::Limits`] if it exceeds the budget of `file`.
pub fn read_views<R: Read + Seek>(file: &mut Container<R>) -> Result<Vec<View>> {
    Ok(file.drive(stages::views)?.views)
}

/// Decodes everything but the photographs, with the views as they were captured; those of the asset are of the photographs' decoded size.
fn decode_model<R: Read + Seek>(file: &mut Container<R>, options: &DecodeOptions) -> Result<(Asset, Vec<View>)> {
    // 6. Container: metadata.
    let metadata = file.drive(stages::metadata)?;
    // 3. Views, which all other stages need, like the mesh.
    let ViewsSection { white, components, views } = file.drive(stages::views)?;
    // 2. Mesh, as the encoder's later stages saw it.
    let mesh = file.drive(stages::mesh)?;
    options.selection.check(views.len())?;
    let captured = views;
    let views = reduced_views(&captured, options)?;
    let (metadata, photographs) = (metadata.0, vec![None; views.len()]);
    let mut asset = Asset { metadata, white, components, views, photographs, ..Asset::default() };
    if !options.photographs_only {
        // 5. The reflectance that was fitted to the photographs, on the atlas.
        asset.charts = file.drive(|file| stages::charts(file, mesh.as_ref()))?;
        asset.surface = file.drive(|file| stages::displacement(file, mesh.as_ref(), asset.charts.as_ref()))?;
        asset.reflectance = file.drive(|file| stages::reflectance(file, mesh.as_ref(), asset.charts.as_ref()))?;
        // Sections that are added to a file: what the vertices see, light, materials.
        asset.visibility = file.drive(|file| stages::visibility(file, mesh.as_ref()))?;
        asset.light = file.drive(stages::light)?;
        asset.materials = file.drive(stages::materials)?;
        asset.coordinates = file.drive(|file| stages::coordinates(file, mesh.as_ref()))?;
        asset.binding = file.drive(|file| stages::binding(file, mesh.as_ref(), &asset.materials))?;
    }
    asset.mesh = mesh.unwrap_or_default();
    Ok((asset, captured))
}

/// Views with the cameras of photographs whose size is halved as often as the options say; those of selected views of the region.
/// # Errors
/// [`Error::Parameter`] if a selected photograph is too small for that.
fn reduced_views(views: &[View], options: &DecodeOptions) -> Result<Vec<View>> {
    let levels = options.reduction as usize;
    let reduced = |(index, view): (usize, &View)| {
        let mut camera = low_camera(&view.camera, levels);
        if options.selection.includes(index) {
            check_reduction(view, levels)?;
            if let Some(region) = &options.region {
                check_region(view, levels, region)?;
                camera = camera.cropped(region);
            }
        }
        Ok(View { camera, ..view.clone() })
    };
    views.iter().enumerate().map(reduced).collect()
}

fn check_region(view: &View, levels: usize, region: &Region) -> Result<()> {
    let Region { left, top, width, height } = *region;
    let camera = low_camera(&view.camera, levels);
    if region.is_within(camera.width, camera.height) {
        return Ok(());
    }
    let size = format!("{} x {} pixels", camera.width, camera.height);
    let halved = if levels > 0 { format!(", halved {levels} times,") } else { String::new() };
    Err(Error::parameter(format!(
        "option `region` is {width} x {height} pixels from column {left} and row {top}: view {}{halved} has {size}",
        view.name
    )))
}

fn check_reduction(view: &View, levels: usize) -> Result<()> {
    let View { name, camera, .. } = view;
    let most = level_count(camera.width as usize, camera.height as usize);
    if levels > most {
        let size = format!("{} x {} pixels", camera.width, camera.height);
        return Err(Error::parameter(format!(
            "option `reduction` is {levels}: view {name} of {size} can be halved {most} times at most"
        )));
    }
    Ok(())
}

fn reduction_of_wavelet_texture() -> Error {
    Error::parameter(
        "option `reduction` goes with profile predictive: profile wavelet-texture has no levels to leave out",
    )
}

/// What photographs are predicted from besides other photographs, if they are: the asset's parts, or, where these were left out, the file's.
fn prediction_model<R: Read + Seek>(
    file: &mut Container<R>,
    asset: &Asset,
    is_modelled: bool,
) -> Result<Option<PredictionModel>> {
    if !is_modelled {
        return Ok(None);
    }
    let Asset { mesh, components, white, .. } = asset;
    let (mut surface, mut charts, mut maps) = (
        asset.surface.as_ref().map(Cow::Borrowed),
        asset.charts.as_ref().map(Cow::Borrowed),
        asset.reflectance.as_ref().map(Cow::Borrowed),
    );
    if charts.is_none() {
        charts = file.drive(|file| stages::charts(file, Some(mesh)))?.map(Cow::Owned);
        surface = file.drive(|file| stages::displacement(file, Some(mesh), charts.as_deref()))?.map(Cow::Owned);
        maps = file.drive(|file| stages::reflectance(file, Some(mesh), charts.as_deref()))?.map(Cow::Owned);
    }
    let parts = (surface.as_deref(), charts.as_deref(), maps.as_deref());
    PredictionModel::new(mesh, parts, components, *white, &file.budget()).map(Some)
}

/// Decodes the selected photographs that the file has not lost.
fn decode_photographs<R: Read + Seek>(
    file: &mut Container<R>,
    (asset, views): (&Asset, &[View]),
    options: &DecodeOptions,
    mut done: impl FnMut(&Asset, Vec<(usize, Photograph)>) -> Result<()>,
) -> Result<()> {
    if options.selection == ViewSelection::None {
        return Ok(());
    }
    let budget = file.budget();
    let lost = metadata::lost_views(&asset.metadata);
    let wanted = |view: usize| options.selection.includes(view) && !lost.contains(&view);
    let Asset { mesh, components, .. } = asset;
    // 5. Photographs, as the profile coded them, with 4. the pixels that were coded. Each keeps 1. the components of reflection.
    match file.drive(|file| stages::photograph_coding(file, views, components.len()))? {
        PhotographCoding::None => {}
        PhotographCoding::Predictive(planes) => {
            let model = prediction_model(file, asset, planes.header.coding.is_modelled)?.map(Arc::new);
            let decoder = PlaneDecoder::new(&planes.header, mesh, views, asset.white).with_model(model);
            let decoder = decoder.reduced_by(options.reduction as usize).within(options.region);
            let read = |streams: Range<u64>| {
                let range = planes.streams + streams.start..planes.streams + streams.end;
                file.drive(|file| file.take(range.clone())).map(Some)
            };
            decoder.for_each_view(wanted, read, &budget, |given| done(asset, given))?;
        }
        PhotographCoding::WaveletTexture if options.reduction > 0 => return Err(reduction_of_wavelet_texture()),
        PhotographCoding::WaveletTexture => {
            let decoded = file.drive(|file| stages::wavelet_texture(file, mesh, components, views.len()))?;
            for (index, view) in views.iter().enumerate().filter(|(index, _)| wanted(*index)) {
                let (photograph, _reservation) =
                    stages::wavelet_photograph(&decoded, mesh, (index, view), components.len(), &budget)?;
                let region = options.region.map(|region| photograph.cropped(&region));
                done(asset, vec![(index, region.unwrap_or(photograph))])?;
            }
        }
    }
    Ok(())
}
