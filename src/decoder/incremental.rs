//! Incremental decoding: each part of a file as soon as its bytes are there, each view by itself.

use super::stages::{self, PhotographCoding};
use crate::brdf::binding::TriangleBinding;
use crate::brdf::materials::NamedMaterial;
use crate::container::incremental::ready;
use crate::container::metadata::Metadata;
use crate::container::{IncrementalReader, Poll, Section, Tag, missing_section};
use crate::error::{Error, Result};
use crate::image::{Mask, Region};
use crate::lighting::EnvironmentLobes;
use crate::limits::Limits;
use crate::mesh::{CornerCoordinates, Mesh};
use crate::predictive::decode::DecodedPhotograph;
use crate::predictive::header;
use crate::predictive::model::PredictionModel;
use crate::predictive::on_demand::ViewDecoder;
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::charts::Charts;
use crate::surface::displacement::DisplacedMesh;
use crate::views::Photograph;
use crate::views::codec::ViewsSection;
use crate::visibility::Visibility;
use crate::wavelet_texture::DecodedWaveletTexture;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Decoder of a file that is fed piece by piece.
///
/// Every method returns either its result or the ranges of the file that it needs; these are fetched and handed to
/// [`IncrementalDecoder::feed`], and the method is called again. Only views evicted to stay within the memory budget are
/// decoded again.
#[derive(Debug)]
pub struct IncrementalDecoder {
    file: IncrementalReader,
    header: Option<Arc<FileHeader>>,
    mesh: Option<Option<Arc<Mesh>>>,
    charts: Option<Option<Arc<Charts>>>,
    /// What photographs are predicted from besides each other, and what that was made from.
    model: Option<(Arc<PredictionModel>, Option<DisplacedMesh>, Option<ReflectanceMaps>)>,
    photographs: Option<PhotographDecoder>,
    reduction: u8,
    region: Option<Region>,
}

/// Everything that precedes the photographs' streams.
#[derive(Debug)]
pub struct FileHeader {
    /// The object's metadata.
    pub metadata: Metadata,
    /// White board, components and views; empty in a file without.
    pub capture: ViewsSection,
    /// Profile and head of the photographs.
    pub photographs: PhotographCoding,
}

/// Decoder of the photographs by profile.
#[derive(Debug)]
enum PhotographDecoder {
    None,
    Predictive(Box<ViewDecoder<'static>>),
    WaveletTexture(Box<DecodedWaveletTexture>, Arc<Mesh>),
}

/// Result of [`IncrementalDecoder::view`].
#[derive(Debug)]
pub enum ViewStatus<T = Photograph> {
    /// The view.
    Decoded(T),
    /// A view that it is predicted from has been decoded; the method is to be called again.
    InProgress,
    /// The file holds no photographs.
    Absent,
}

/// A view just decoded.
#[derive(Debug)]
pub enum ViewPhotograph<'a> {
    /// Of profile `predictive`.
    Predictive(DecodedPhotograph<'a>),
    /// Of profile `wavelet-texture`.
    WaveletTexture(Photograph),
}

impl ViewPhotograph<'_> {
    /// Pixels that show the object.
    pub fn mask(&self) -> &Mask {
        match self {
            ViewPhotograph::Predictive(picture) => picture.mask(),
            ViewPhotograph::WaveletTexture(photograph) => &photograph.mask,
        }
    }

    /// Calls `visit` for the rows that the object may be in, or parts of them, with the index of the first pixel in the
    /// image: a component's radiance with 1 as fourth channel, 0 outside the mask.
    pub fn for_each_row(&self, component: usize, mut visit: impl FnMut(usize, &[[f32; 4]])) {
        match self {
            ViewPhotograph::Predictive(picture) => picture.for_each_row(component, visit),
            ViewPhotograph::WaveletTexture(Photograph { mask, images }) => {
                let Some(image) = images.get(component) else { return };
                let mut row = Vec::with_capacity(image.width);
                for y in 0..image.height {
                    let pixels = image.row(y).iter().zip(mask.row(y));
                    row.clear();
                    row.extend(pixels.map(|([r, g, b], &inside)| if inside { [*r, *g, *b, 1.0] } else { [0.0; 4] }));
                    visit(y * image.width, &row);
                }
            }
        }
    }

    /// Returns all components.
    pub fn photograph(self) -> Photograph {
        match self {
            ViewPhotograph::Predictive(picture) => picture.photograph(),
            ViewPhotograph::WaveletTexture(photograph) => photograph,
        }
    }
}

impl IncrementalDecoder {
    /// Creates a decoder of a file of which nothing is there yet; see [`IncrementalReader::new`].
    pub fn new(length: Option<u64>, is_seekable: bool, limits: Limits) -> Self {
        let file = IncrementalReader::new(length, is_seekable, limits);
        IncrementalDecoder {
            file,
            header: None,
            mesh: None,
            charts: None,
            model: None,
            photographs: None,
            reduction: 0,
            region: None,
        }
    }

    /// Feeds bytes of the file.
    /// # Errors
    /// As [`IncrementalReader::feed`].
    pub fn feed(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.file.feed(offset, bytes)
    }
    /// Sets the length of a file that was begun without one.
    pub fn set_length(&mut self, length: u64) {
        self.file.set_length(length);
    }
    /// Halves the size of the views that are decoded from now on so often; see [`DecodeOptions::reduction`](super::DecodeOptions::reduction).
    /// Nothing that was decoded before is kept.
    pub fn set_reduction(&mut self, reduction: u8) {
        if reduction != self.reduction {
            (self.reduction, self.photographs) = (reduction, None);
        }
    }
    /// Decodes only this region of the views that are asked for from now on, in pixels of their size after the reduction, or all of them; see
    /// [`DecodeOptions::region`](super::DecodeOptions::region). What views are predicted from is kept.
    pub fn set_region(&mut self, region: Option<Region>) {
        self.region = region;
        if let Some(PhotographDecoder::Predictive(decoder)) = &mut self.photographs {
            decoder.set_region(region);
        }
    }
    /// Sections known so far, and whether these are all.
    pub fn sections(&self) -> (&[Section], bool) {
        self.file.sections()
    }

    /// Decodes metadata, views and the head of the photographs.
    /// # Errors
    /// [`Error::Format`] if one of them is damaged or missing, [`Error::Unsupported`] for later versions, [`Error::Limits`] if
    /// the memory budget is exceeded; so do the other methods for what they decode.
    pub fn header(&mut self) -> Result<Poll<Arc<FileHeader>>> {
        if let Some(header) = &self.header {
            return Ok(Poll::Ready(header.clone()));
        }
        // All of it is asked for at once, not one section after the other.
        let mut ranges = Vec::new();
        if let Some(planes) = ready!(self.file.find(Tag::PLANES)?) {
            ranges.push(header::head_range(&self.file, &planes)?);
        }
        for tag in [Tag::METADATA, Tag::VIEWS] {
            let section = ready!(self.file.find(tag)?);
            ranges.extend(section.map(|section| section.offset..section.end().unwrap_or(u64::MAX)));
        }
        ready!(self.file.require(&ranges)?);
        let metadata = ready!(stages::metadata(&mut self.file)?);
        let capture = ready!(stages::views(&mut self.file)?);
        let photographs = ready!(stages::photograph_coding(&mut self.file, &capture.views, capture.components.len())?);
        let header = Arc::new(FileHeader { metadata, capture, photographs });
        self.header = Some(header.clone());
        Ok(Poll::Ready(header))
    }

    /// Decodes the mesh; `None` in a file that needs none.
    pub fn mesh(&mut self) -> Result<Poll<Option<Arc<Mesh>>>> {
        if self.mesh.is_none() {
            self.mesh = Some(ready!(stages::mesh(&mut self.file)?).map(Arc::new));
        }
        Ok(Poll::Ready(self.mesh.clone().flatten()))
    }

    /// Decodes the atlas; `None` in a file without.
    pub fn charts(&mut self) -> Result<Poll<Option<Arc<Charts>>>> {
        if self.charts.is_none() {
            let mesh = ready!(self.mesh()?);
            self.charts = Some(ready!(stages::charts(&mut self.file, mesh.as_deref())?).map(Arc::new));
        }
        Ok(Poll::Ready(self.charts.clone().flatten()))
    }

    /// Decodes the surface, where it is finer than the mesh; `None` in a file without. Kept where photographs are predicted from it.
    pub fn surface(&mut self) -> Result<Poll<Option<DisplacedMesh>>> {
        ready!(self.model()?);
        if let Some((_, surface, _)) = &self.model {
            return Ok(Poll::Ready(surface.clone()));
        }
        let charts = ready!(self.charts()?);
        let mesh = ready!(self.mesh()?);
        self.handed_out(|file| stages::displacement(file, mesh.as_deref(), charts.as_deref()))
    }

    /// Decodes the reflectance; `None` in a file without. Kept where photographs are predicted from it.
    pub fn reflectance(&mut self) -> Result<Poll<Option<ReflectanceMaps>>> {
        ready!(self.model()?);
        if let Some((.., maps)) = &self.model {
            return Ok(Poll::Ready(maps.clone()));
        }
        let charts = ready!(self.charts()?);
        let mesh = ready!(self.mesh()?);
        self.handed_out(|file| stages::reflectance(file, mesh.as_deref(), charts.as_deref()))
    }

    /// Decodes the visibility of the vertices; `None` in a file without. Not kept.
    pub fn visibility(&mut self) -> Result<Poll<Option<Visibility>>> {
        let mesh = ready!(self.mesh()?);
        self.handed_out(|file| stages::visibility(file, mesh.as_deref()))
    }

    /// Decodes the light to show the object in; `None` in a file without. Not kept.
    pub fn light(&mut self) -> Result<Poll<Option<EnvironmentLobes>>> {
        self.handed_out(stages::light)
    }

    /// Decodes the materials; none in a file without. Not kept.
    pub fn materials(&mut self) -> Result<Poll<Vec<NamedMaterial>>> {
        self.handed_out(stages::materials)
    }

    /// Decodes the texture coordinates; `None` in a file without. Not kept.
    pub fn coordinates(&mut self) -> Result<Poll<Option<Vec<CornerCoordinates>>>> {
        let mesh = ready!(self.mesh()?);
        self.handed_out(|file| stages::coordinates(file, mesh.as_deref()))
    }

    /// Decodes the materials of the mesh's triangles; `None` in a file without. Not kept.
    pub fn binding(&mut self) -> Result<Poll<Option<TriangleBinding>>> {
        let mesh = ready!(self.mesh()?);
        let materials = ready!(self.materials()?);
        self.handed_out(|file| stages::binding(file, mesh.as_deref(), &materials))
    }

    /// Decodes what the photographs are predicted from besides each other; `None` where that is nothing, or before the header is decoded.
    fn model(&mut self) -> Result<Poll<Option<Arc<PredictionModel>>>> {
        let Some(header) = self.header.clone() else { return Ok(Poll::Ready(None)) };
        let PhotographCoding::Predictive(planes) = &header.photographs else { return Ok(Poll::Ready(None)) };
        if self.model.is_some() || !planes.header.coding.is_modelled {
            return Ok(Poll::Ready(self.model.as_ref().map(|(model, ..)| model.clone())));
        }
        let mut ranges = Vec::new();
        for tag in [Tag::CHARTS, Tag::DISPLACEMENT, Tag::REFLECTANCE] {
            let section = ready!(self.file.find(tag)?);
            ranges.extend(section.map(|section| section.offset..section.end().unwrap_or(u64::MAX)));
        }
        ready!(self.file.require(&ranges)?);
        let mesh = ready!(self.mesh()?);
        let charts = ready!(self.charts()?);
        let surface = ready!(stages::displacement(&mut self.file, mesh.as_deref(), charts.as_deref())?);
        let maps = ready!(stages::reflectance(&mut self.file, mesh.as_deref(), charts.as_deref())?);
        let Some(mesh) = mesh else { return Ok(Poll::Ready(None)) };
        let (components, white) = (&header.capture.components, header.capture.white);
        let parts = (surface.as_ref(), charts.as_deref(), maps.as_ref());
        let model = Arc::new(PredictionModel::new(&mesh, parts, components, white, &self.file.budget())?);
        self.model = Some((model.clone(), surface, maps));
        Ok(Poll::Ready(Some(model)))
    }

    /// Runs a stage whose result the caller keeps: what it charges is released.
    fn handed_out<T>(&mut self, stage: impl FnOnce(&mut IncrementalReader) -> Result<Poll<T>>) -> Result<Poll<T>> {
        let budget = self.file.budget();
        let before = budget.left();
        let result = stage(&mut self.file);
        budget.release(before.saturating_sub(budget.left()));
        result
    }

    /// Creates the decoder of the photographs.
    fn photographs(&mut self) -> Result<Poll<()>> {
        if self.photographs.is_some() {
            return Ok(Poll::Ready(()));
        }
        let budget = self.file.budget();
        let header = ready!(self.header()?);
        let mesh = ready!(self.mesh()?);
        let capture = &header.capture;
        let decoder = match (&header.photographs, mesh) {
            (PhotographCoding::None, _) => PhotographDecoder::None,
            (_, None) => return Err(missing_section(Tag::MESH)),
            (PhotographCoding::Predictive(planes), Some(mesh)) => {
                // A second copy, and the vertices' normals.
                budget.charge_items("mesh", mesh.positions.len() as u64, 36)?;
                budget.charge_items("mesh", mesh.triangles.len() as u64, 12)?;
                let model = ready!(self.model()?);
                let decoder = ViewDecoder::new(
                    Cow::Owned(planes.header.clone()),
                    Cow::Owned((*mesh).clone()),
                    Cow::Owned(capture.views.clone()),
                    capture.white,
                    budget,
                );
                let mut decoder = decoder.with_model(model).reduced_by(self.reduction as usize);
                decoder.set_region(self.region);
                PhotographDecoder::Predictive(Box::new(decoder))
            }
            (PhotographCoding::WaveletTexture, _) if self.reduction > 0 => {
                return Err(super::reduction_of_wavelet_texture());
            }
            (PhotographCoding::WaveletTexture, Some(mesh)) => {
                let (components, views) = (&capture.components, capture.views.len());
                let decoded = ready!(stages::wavelet_texture(&mut self.file, &mesh, components, views)?);
                PhotographDecoder::WaveletTexture(Box::new(decoded), mesh)
            }
        };
        self.photographs = Some(decoder);
        Ok(Poll::Ready(()))
    }

    /// Decodes a view, or one that it is predicted from: no call takes longer than one view.
    /// # Errors
    /// Also [`Error::Parameter`] if `index` is out of range.
    pub fn view(&mut self, index: usize) -> Result<Poll<ViewStatus>> {
        self.view_as(index, |photograph| photograph.photograph())
    }

    /// Decodes a view as [`IncrementalDecoder::view`] and returns what `take` makes of it.
    pub fn view_as<T>(&mut self, index: usize, take: impl FnOnce(ViewPhotograph) -> T) -> Result<Poll<ViewStatus<T>>> {
        ready!(self.photographs()?);
        let header = ready!(self.header()?);
        let Some(view) = header.capture.views.get(index) else {
            let count = header.capture.views.len();
            return Err(Error::parameter(format!("view {index} does not exist: the file has {count} views")));
        };
        super::check_reduction(view, self.reduction as usize)?;
        if let Some(region) = &self.region {
            super::check_region(view, self.reduction as usize, region)?;
        }
        let status = match &mut self.photographs {
            None | Some(PhotographDecoder::None) => ViewStatus::Absent,
            Some(PhotographDecoder::WaveletTexture(decoded, mesh)) => {
                let (budget, components) = (self.file.budget(), header.capture.components.len());
                let (photograph, _reservation) =
                    stages::wavelet_photograph(decoded, mesh, (index, view), components, &budget)?;
                let region = self.region.map(|region| photograph.cropped(&region));
                ViewStatus::Decoded(take(ViewPhotograph::WaveletTexture(region.unwrap_or(photograph))))
            }
            Some(PhotographDecoder::Predictive(decoder)) => {
                let entries = decoder.missing_entries(index)?;
                let Some(&first) = entries.first() else {
                    return match decoder.kept(index) {
                        Some(kept) => Ok(Poll::Ready(ViewStatus::Decoded(take(ViewPhotograph::Predictive(kept))))),
                        None => Err(Error::parameter("the view is neither missing nor kept")),
                    };
                };
                let is_last = entries.len() == 1;
                let ranges = stream_ranges(&header, decoder, (first, is_last))?;
                // What is there is decoded while the rest arrives.
                if let Poll::NeedRanges(_) = self.file.require(&ranges)? {
                    ready!(self.file.require(&all_stream_ranges(&header, decoder, &entries)?)?);
                }
                let take = is_last.then_some(|view: DecodedPhotograph| take(ViewPhotograph::Predictive(view)));
                let decoded = match &ranges[..] {
                    [range] => decoder.decode(first, ready!(self.file.bytes(range.clone())?), take)?,
                    ranges => {
                        let mut bytes = Vec::new();
                        for range in ranges {
                            bytes.extend_from_slice(ready!(self.file.bytes(range.clone())?));
                        }
                        decoder.decode(first, &bytes, take)?
                    }
                };
                match decoded {
                    Some(taken) => ViewStatus::Decoded(taken),
                    None => ViewStatus::InProgress,
                }
            }
        };
        Ok(Poll::Ready(status))
    }

    /// Returns the ranges that a view and those it is predicted from still need, to be fetched ahead; none before the
    /// photographs' order is known.
    /// # Errors
    /// [`Error::Parameter`] if `index` is out of range.
    pub fn ranges_for(&mut self, index: usize) -> Result<Vec<Range<u64>>> {
        let (Some(PhotographDecoder::Predictive(decoder)), Some(header)) = (&mut self.photographs, &self.header) else {
            return Ok(Vec::new());
        };
        let entries = decoder.missing_entries(index)?;
        Ok(match self.file.require(&all_stream_ranges(header, decoder, &entries)?)? {
            Poll::Ready(()) => Vec::new(),
            Poll::NeedRanges(ranges) => ranges,
        })
    }

    /// Compares the checksum of every section.
    /// # Errors
    /// [`Error::Format`] for the first one that does not match.
    pub fn verify(&mut self) -> Result<Poll<()>> {
        self.file.verify()
    }
}

/// Ranges of the file that hold what is needed of entries of the coding order: of the last one the photograph, of those before it what it is
/// predicted from.
fn all_stream_ranges(header: &FileHeader, decoder: &ViewDecoder, entries: &[usize]) -> Result<Vec<Range<u64>>> {
    let of_entry = |(k, &entry): (usize, &usize)| stream_ranges(header, decoder, (entry, k + 1 == entries.len()));
    Ok(entries.iter().enumerate().map(of_entry).collect::<Result<Vec<_>>>()?.concat())
}

/// Ranges of the file that hold what is needed of an entry of the coding order: of its photograph, or of what others are predicted from.
fn stream_ranges(
    header: &FileHeader,
    decoder: &ViewDecoder,
    (entry, is_photograph): (usize, bool),
) -> Result<Vec<Range<u64>>> {
    let PhotographCoding::Predictive(planes) = &header.photographs else { return Ok(Vec::new()) };
    if entry >= planes.header.entries.len() {
        return Err(Error::parameter("the entry does not exist"));
    }
    let within = decoder.needed_ranges(entry, is_photograph).into_iter();
    Ok(within.map(|range| planes.streams + range.start..planes.streams + range.end).collect())
}
