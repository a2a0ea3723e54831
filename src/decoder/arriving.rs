//! Decoding a file while it arrives: each part as soon as its bytes are there, each view once.

use crate::brdf::materials::{self, NamedMaterial};
use crate::container::arriving::here;
use crate::container::metadata::Metadata;
use crate::container::{IncrementalReader, Poll, Section, Tag, metadata};
use crate::error::{Error, Result};
use crate::image::Mask;
use crate::lighting::{self, EnvironmentLobes};
use crate::limits::{Budget, Limits};
use crate::mesh;
use crate::mesh::Mesh;
use crate::predictive::decode::DecodedPhotograph;
use crate::predictive::decoder::ViewDecoder;
use crate::predictive::header::{PREFIX_BYTES, PlaneHeader};
use crate::reflectance::codec as reflectance_code;
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::charts;
use crate::surface::charts::Charts;
use crate::views::Photograph;
use crate::views::codec;
use crate::views::codec::ViewsSection;
use crate::visibility::{self, Visibility};
use crate::wavelet_texture;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// A file that arrives piece by piece.
///
/// Every method either gives what it is asked for or the ranges of the file that it still takes; these are fetched, handed to
/// [`IncrementalDecoder::feed`], and the method is called again. Nothing is decoded twice but views that had to be given up for memory.
#[derive(Debug)]
pub struct IncrementalDecoder {
    file: IncrementalReader,
    opened: Option<Arc<FileHeader>>,
    mesh: Option<Option<Arc<Mesh>>>,
    charts: Option<Option<Arc<Charts>>>,
    pictures: Option<PhotographDecoder>,
}

/// What stands before the pictures.
#[derive(Debug)]
pub struct FileHeader {
    /// The object's metadata.
    pub metadata: Metadata,
    /// White board, components and views; empty in a file without.
    pub capture: ViewsSection,
    /// Profile and head of the photographs.
    pub photographs: PhotographCoding,
}

/// How a file holds its photographs.
#[derive(Debug)]
pub enum PhotographCoding {
    /// There are none.
    None,
    /// Profile `predictive`.
    Predictive {
        /// Head of the section.
        header: PlaneHeader,
        /// Where in the file the first step's streams begin.
        streams: u64,
    },
    /// Profile `wavelet-texture`.
    WaveletTexture,
}

/// What decodes photographs.
#[derive(Debug)]
enum PhotographDecoder {
    None,
    Predictive(Box<ViewDecoder<'static>>, u64),
    WaveletTexture(Box<wavelet_texture::DecodedWaveletTexture>, Arc<Mesh>),
}

/// What came of asking for a view.
#[derive(Debug)]
pub enum ViewStatus<T = Photograph> {
    /// The view.
    Decoded(T),
    /// A view that it is predicted from has been decoded; ask again.
    InProgress,
    /// The file holds no photographs.
    Absent,
}

/// A view as it is decoded.
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

    /// Calls `visit` for the rows that the object may be in, or parts of them, with the index of the first pixel in the picture: a
    /// component's radiance with 1 as fourth channel, 0 outside the mask.
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

    /// All components.
    pub fn photograph(self) -> Photograph {
        match self {
            ViewPhotograph::Predictive(picture) => picture.photograph(),
            ViewPhotograph::WaveletTexture(photograph) => photograph,
        }
    }
}

impl IncrementalDecoder {
    /// A file of which nothing is there yet; see [`IncrementalReader::new`].
    pub fn new(length: Option<u64>, is_seekable: bool, limits: Limits) -> Self {
        let file = IncrementalReader::new(length, is_seekable, limits);
        IncrementalDecoder { file, opened: None, mesh: None, charts: None, pictures: None }
    }

    /// Takes bytes that have arrived.
    /// # Errors
    /// As [`IncrementalReader::feed`].
    pub fn feed(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.file.feed(offset, bytes)
    }
    /// Says where the file ends, when that is known at last.
    pub fn set_length(&mut self, length: u64) {
        self.file.set_length(length);
    }
    /// The sections that are known, and whether these are all.
    pub fn sections(&self) -> (&[Section], bool) {
        self.file.sections()
    }

    /// Metadata, views and the order of the photographs.
    pub fn open(&mut self) -> Result<Poll<Arc<FileHeader>>> {
        if let Some(opened) = &self.opened {
            return Ok(Poll::Ready(opened.clone()));
        }
        let budget = self.file.budget();
        // Of both PLAN counts, wherever it stands.
        let pictures = match here!(self.file.find(Tag::PLANES)?) {
            None => here!(self.file.find(Tag::WAVELET_TEXTURE)?),
            planes => planes,
        };
        let metadata = here!(self.file.find(Tag::METADATA)?);
        let capture = here!(self.file.find(Tag::VIEWS)?);
        // Everything that this takes is asked for at once, not one after the other.
        let mut wanted: Vec<Range<u64>> = Vec::new();
        for section in [metadata, capture].iter().flatten() {
            wanted.push(section.offset..section.end().unwrap_or(u64::MAX));
        }
        let mut head = 0..0;
        let planes = pictures.filter(|section| section.tag == Tag::PLANES);
        if let Some(section) = &planes {
            head = self.file.file_range(section, 0..PREFIX_BYTES as u64)?;
            if let Poll::Ready(prefix) = self.file.bytes(head.clone())? {
                head = self.file.file_range(section, 0..PREFIX_BYTES as u64 + PlaneHeader::head_bytes(prefix)?)?;
            }
            wanted.push(head.clone());
        }
        here!(self.file.require(&wanted)?);
        let metadata =
            here!(self.file.content(Tag::METADATA)?).map(|content| metadata::decode(&content, &budget)).transpose()?;
        let capture =
            here!(self.file.content(Tag::VIEWS)?).map(|content| codec::decode(&content, &budget)).transpose()?;
        let capture = match capture {
            Some(capture) => capture,
            None if pictures.is_some() => return Err(missing_section(Tag::VIEWS)),
            None => ViewsSection { white: [1.0; 3], ..Default::default() },
        };
        let pictures = match (planes, pictures) {
            (Some(section), _) => {
                let streams = head.end;
                let bytes = here!(self.file.bytes(head)?);
                let header = PlaneHeader::parse(bytes, capture.views.len(), capture.components.len(), &budget)?;
                let before = streams - (section.offset + section.header_bytes());
                if section.stored != before + header.stream_bytes() {
                    return Err(Error::format(Tag::PLANES, before, "the streams are not as long as the head says"));
                }
                PhotographCoding::Predictive { header, streams }
            }
            (None, Some(_)) => PhotographCoding::WaveletTexture,
            (None, None) => PhotographCoding::None,
        };
        let opened = Arc::new(FileHeader { metadata: metadata.unwrap_or_default(), capture, photographs: pictures });
        self.opened = Some(opened.clone());
        Ok(Poll::Ready(opened))
    }

    /// The mesh; `None` where the file has none.
    pub fn mesh(&mut self) -> Result<Poll<Option<Arc<Mesh>>>> {
        if self.mesh.is_none() {
            let budget = self.file.budget();
            let content = here!(self.file.content(Tag::MESH)?);
            let mesh = content.map(|bytes| mesh::codec::decode(&bytes, &budget)).transpose()?;
            self.mesh = Some(mesh.map(Arc::new));
        }
        Ok(Poll::Ready(self.mesh.clone().flatten()))
    }

    /// The atlas; `None` where the file has none.
    pub fn charts(&mut self) -> Result<Poll<Option<Arc<Charts>>>> {
        if self.charts.is_none() {
            let budget = self.file.budget();
            let mesh = here!(self.mesh()?);
            let content = here!(self.file.content(Tag::CHARTS)?);
            let charts = match (&mesh, content) {
                (Some(mesh), Some(bytes)) => Some(Arc::new(charts::decode(&bytes, mesh, &budget)?)),
                _ => None,
            };
            self.charts = Some(charts);
        }
        Ok(Poll::Ready(self.charts.clone().flatten()))
    }

    /// Fitted reflectance; `None` where the file has none. Not kept.
    pub fn reflectance(&mut self) -> Result<Poll<Option<ReflectanceMaps>>> {
        let budget = self.file.budget();
        let charts = here!(self.charts()?);
        let content = here!(self.file.content(Tag::REFLECTANCE)?);
        let (Some(mesh), Some(charts), Some(bytes)) = (here!(self.mesh()?), charts, content) else {
            return Ok(Poll::Ready(None));
        };
        let decode = |budget: &Budget| reflectance_code::decode(&bytes, &mesh, &charts, budget);
        Ok(Poll::Ready(Some(handed_out(&budget, decode)?)))
    }

    /// What the vertices see; `None` where the file has none. Not kept.
    pub fn visibility(&mut self) -> Result<Poll<Option<Visibility>>> {
        let budget = self.file.budget();
        let mesh = here!(self.mesh()?);
        let content = here!(self.file.content(Tag::VISIBILITY)?);
        let (Some(mesh), Some(bytes)) = (mesh, content) else { return Ok(Poll::Ready(None)) };
        let decode = |budget: &Budget| visibility::codec::decode(&bytes, &mesh, budget);
        Ok(Poll::Ready(Some(handed_out(&budget, decode)?)))
    }

    /// Light to show the object in; `None` where the file has none. Not kept.
    pub fn light(&mut self) -> Result<Poll<Option<EnvironmentLobes>>> {
        let budget = self.file.budget();
        let content = here!(self.file.content(Tag::LIGHT)?);
        let decode = |bytes: Vec<u8>| handed_out(&budget, |budget| lighting::codec::decode(&bytes, budget));
        Ok(Poll::Ready(content.map(decode).transpose()?))
    }

    /// Fitted materials; none where the file has none. Not kept.
    pub fn materials(&mut self) -> Result<Poll<Vec<NamedMaterial>>> {
        let budget = self.file.budget();
        let content = here!(self.file.content(Tag::MATERIALS)?);
        let decode = |bytes: Vec<u8>| handed_out(&budget, |budget| materials::decode_materials(&bytes, budget));
        Ok(Poll::Ready(content.map(decode).transpose()?.unwrap_or_default()))
    }

    fn pictures(&mut self) -> Result<Poll<()>> {
        if self.pictures.is_some() {
            return Ok(Poll::Ready(()));
        }
        let budget = self.file.budget();
        let opened = here!(self.open()?);
        let mesh = here!(self.mesh()?);
        let capture = &opened.capture;
        let pictures = match (&opened.photographs, mesh) {
            (PhotographCoding::None, _) => PhotographDecoder::None,
            (_, None) => return Err(missing_section(Tag::MESH)),
            (PhotographCoding::Predictive { header, streams }, Some(mesh)) => {
                // A second copy, and the vertices' normals.
                budget.charge_items("mesh", mesh.positions.len() as u64, 36)?;
                budget.charge_items("mesh", mesh.triangles.len() as u64, 12)?;
                let decoder = ViewDecoder::new(
                    Cow::Owned(header.clone()),
                    Cow::Owned((*mesh).clone()),
                    Cow::Owned(capture.views.clone()),
                    capture.white,
                    budget,
                );
                PhotographDecoder::Predictive(Box::new(decoder), *streams)
            }
            (PhotographCoding::WaveletTexture, Some(mesh)) => {
                let Some(bytes) = here!(self.file.content(Tag::WAVELET_TEXTURE)?) else {
                    return Err(missing_section(Tag::WAVELET_TEXTURE));
                };
                let decoded =
                    wavelet_texture::decode(&bytes, &mesh, &capture.components, capture.views.len(), &budget)?;
                PhotographDecoder::WaveletTexture(Box::new(decoded), mesh)
            }
        };
        self.pictures = Some(pictures);
        Ok(Poll::Ready(()))
    }

    /// Decodes a view, or one that it is predicted from: no call takes longer than one view.
    pub fn view(&mut self, index: usize) -> Result<Poll<ViewStatus>> {
        self.view_as(index, |picture| picture.photograph())
    }

    /// [`IncrementalDecoder::view`], with what `take` makes of the view.
    pub fn view_as<T>(&mut self, index: usize, take: impl FnOnce(ViewPhotograph) -> T) -> Result<Poll<ViewStatus<T>>> {
        here!(self.pictures()?);
        let opened = here!(self.open()?);
        let Some(view) = opened.capture.views.get(index) else {
            let count = opened.capture.views.len();
            return Err(Error::parameter(format!("view {index} does not exist: the file has {count} views")));
        };
        let progress = match &mut self.pictures {
            None | Some(PhotographDecoder::None) => ViewStatus::Absent,
            Some(PhotographDecoder::WaveletTexture(decoded, mesh)) => {
                let budget = self.file.budget();
                let _held = super::hold_wavelet_photograph(mesh, view, opened.capture.components.len(), &budget)?;
                ViewStatus::Decoded(take(ViewPhotograph::WaveletTexture(wavelet_texture::decode::photograph(
                    decoded, mesh, view, index,
                ))))
            }
            Some(PhotographDecoder::Predictive(decoder, streams)) => {
                let steps = decoder.missing_entries(index)?;
                let Some(&first) = steps.first() else {
                    return match decoder.kept(index) {
                        Some(picture) => {
                            Ok(Poll::Ready(ViewStatus::Decoded(take(ViewPhotograph::Predictive(picture)))))
                        }
                        None => Err(Error::parameter("the view is neither missing nor kept")),
                    };
                };
                let ranges = stream_ranges(decoder, *streams, &steps)?;
                // What is there is decoded while the rest arrives.
                let Poll::Ready(bytes) = self.file.bytes(ranges[0].clone())? else {
                    here!(self.file.require(&ranges)?);
                    return Err(Error::parameter("bytes are there and are not"));
                };
                if steps.len() == 1 {
                    ViewStatus::Decoded(
                        decoder.decode(first, bytes, |picture| take(ViewPhotograph::Predictive(picture)))?,
                    )
                } else {
                    decoder.decode(first, bytes, |_| ())?;
                    ViewStatus::InProgress
                }
            }
        };
        Ok(Poll::Ready(progress))
    }

    /// What is not there yet of a view's bytes and of those it is predicted from, to be fetched ahead; empty before the photographs'
    /// order is known.
    pub fn ranges_for(&mut self, index: usize) -> Result<Vec<Range<u64>>> {
        let Some(PhotographDecoder::Predictive(decoder, streams)) = &mut self.pictures else { return Ok(Vec::new()) };
        let steps = decoder.missing_entries(index)?;
        let wanted = stream_ranges(decoder, *streams, &steps)?;
        Ok(match self.file.require(&wanted)? {
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

fn missing_section(tag: Tag) -> Error {
    Error::format(tag, 0u8, "the file has no such section")
}

/// Runs what decodes something that is handed out and not kept: what it charges is given back.
fn handed_out<T>(budget: &Budget, decode: impl FnOnce(&Budget) -> Result<T>) -> Result<T> {
    let before = budget.left();
    let result = decode(budget);
    budget.release(before.saturating_sub(budget.left()));
    result
}

/// Where in the file the streams of some steps lie.
fn stream_ranges(decoder: &ViewDecoder, streams: u64, steps: &[usize]) -> Result<Vec<Range<u64>>> {
    let range = |&step: &usize| {
        let coded = decoder.entry(step).ok_or_else(|| Error::parameter("the step does not exist"))?;
        let start = streams + coded.offset;
        Ok(start..start + coded.lengths.iter().map(|&length| length as u64).sum::<u64>())
    };
    steps.iter().map(range).collect()
}
