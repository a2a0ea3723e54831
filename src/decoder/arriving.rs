//! Decoding a file while it arrives: each part as soon as its bytes are there, each view once.

use crate::brdf::materials::{self, NamedMaterial};
use crate::container::arriving::here;
use crate::container::metadata::Metadata;
use crate::container::{Arrival, Arriving, Section, Tag, metadata};
use crate::error::{Error, Result};
use crate::image::Mask;
use crate::lighting::{self, Light};
use crate::limits::{Budget, Limits};
use crate::mesh;
use crate::mesh::Mesh;
use crate::predictive::decode::DecodedPicture;
use crate::predictive::decoder::ViewDecoder;
use crate::predictive::header::{Header, PREFIX_BYTES};
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
/// [`ArrivingFile::give`], and the method is called again. Nothing is decoded twice but views that had to be given up for memory.
#[derive(Debug)]
pub struct ArrivingFile {
    file: Arriving,
    opened: Option<Arc<Opened>>,
    mesh: Option<Option<Arc<Mesh>>>,
    charts: Option<Option<Arc<Charts>>>,
    pictures: Option<Pictures>,
}

/// What stands before the pictures.
#[derive(Debug)]
pub struct Opened {
    /// The object's metadata.
    pub metadata: Metadata,
    /// White board, components and views; empty in a file without.
    pub capture: ViewsSection,
    /// Profile and head of the photographs.
    pub pictures: PictureFacts,
}

/// How a file holds its photographs.
#[derive(Debug)]
pub enum PictureFacts {
    /// There are none.
    None,
    /// Profile `tuned`.
    Tuned {
        /// Head of the section.
        header: Header,
        /// Where in the file the first step's streams begin.
        streams: u64,
    },
    /// Profile `paper`.
    Paper,
}

/// What decodes photographs.
#[derive(Debug)]
enum Pictures {
    None,
    Tuned(Box<ViewDecoder<'static>>, u64),
    Paper(Box<wavelet_texture::Decoded>, Arc<Mesh>),
}

/// What came of asking for a view.
#[derive(Debug)]
pub enum ViewProgress<T = Photograph> {
    /// The view.
    Done(T),
    /// A view that it is predicted from has been decoded; ask again.
    Again,
    /// The file holds no photographs.
    NoPictures,
}

/// A view as it is decoded.
#[derive(Debug)]
pub enum ViewPicture<'a> {
    /// Of profile `tuned`.
    Decoded(DecodedPicture<'a>),
    /// Of profile `paper`.
    Photograph(Photograph),
}

impl ViewPicture<'_> {
    /// Pixels that show the object.
    pub fn mask(&self) -> &Mask {
        match self {
            ViewPicture::Decoded(picture) => picture.mask(),
            ViewPicture::Photograph(photograph) => &photograph.mask,
        }
    }

    /// Calls `visit` for the rows that the object may be in, or parts of them, with the index of the first pixel in the picture: a
    /// component's radiance with 1 as fourth channel, 0 outside the mask.
    pub fn for_each_row(&self, component: usize, mut visit: impl FnMut(usize, &[[f32; 4]])) {
        match self {
            ViewPicture::Decoded(picture) => picture.for_each_row(component, visit),
            ViewPicture::Photograph(Photograph { mask, images }) => {
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
            ViewPicture::Decoded(picture) => picture.photograph(),
            ViewPicture::Photograph(photograph) => photograph,
        }
    }
}

impl ArrivingFile {
    /// A file of which nothing is there yet; see [`Arriving::new`].
    pub fn new(length: Option<u64>, is_seekable: bool, limits: Limits) -> Self {
        let file = Arriving::new(length, is_seekable, limits);
        ArrivingFile { file, opened: None, mesh: None, charts: None, pictures: None }
    }

    /// Takes bytes that have arrived.
    /// # Errors
    /// As [`Arriving::give`].
    pub fn give(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.file.give(offset, bytes)
    }
    /// Says where the file ends, when that is known at last.
    pub fn end(&mut self, length: u64) {
        self.file.end(length);
    }
    /// The sections that are known, and whether these are all.
    pub fn sections(&self) -> (&[Section], bool) {
        self.file.sections()
    }

    /// Metadata, views and the order of the photographs.
    pub fn open(&mut self) -> Result<Arrival<Arc<Opened>>> {
        if let Some(opened) = &self.opened {
            return Ok(Arrival::Here(opened.clone()));
        }
        let budget = self.file.budget();
        // Of both PLAN counts, wherever it stands.
        let pictures = match here!(self.file.find(Tag::PLANES)?) {
            None => here!(self.file.find(Tag::PAPER)?),
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
            head = self.file.place(section, 0..PREFIX_BYTES as u64)?;
            if let Arrival::Here(prefix) = self.file.bytes(head.clone())? {
                head = self.file.place(section, 0..PREFIX_BYTES as u64 + Header::length(prefix)?)?;
            }
            wanted.push(head.clone());
        }
        here!(self.file.all(&wanted)?);
        let metadata =
            here!(self.file.read(Tag::METADATA)?).map(|content| metadata::decode(&content, &budget)).transpose()?;
        let capture = here!(self.file.read(Tag::VIEWS)?).map(|content| codec::decode(&content, &budget)).transpose()?;
        let capture = match capture {
            Some(capture) => capture,
            None if pictures.is_some() => return Err(missing_section(Tag::VIEWS)),
            None => ViewsSection { white: [1.0; 3], ..Default::default() },
        };
        let pictures = match (planes, pictures) {
            (Some(section), _) => {
                let streams = head.end;
                let bytes = here!(self.file.bytes(head)?);
                let header = Header::parse(bytes, capture.views.len(), capture.components.len(), &budget)?;
                let before = streams - (section.offset + section.header_bytes());
                if section.stored != before + header.stream_bytes() {
                    return Err(Error::format("PLAN", before, "the streams are not as long as the head says"));
                }
                PictureFacts::Tuned { header, streams }
            }
            (None, Some(_)) => PictureFacts::Paper,
            (None, None) => PictureFacts::None,
        };
        let opened = Arc::new(Opened { metadata: metadata.unwrap_or_default(), capture, pictures });
        self.opened = Some(opened.clone());
        Ok(Arrival::Here(opened))
    }

    /// The mesh; `None` where the file has none.
    pub fn mesh(&mut self) -> Result<Arrival<Option<Arc<Mesh>>>> {
        if self.mesh.is_none() {
            let budget = self.file.budget();
            let content = here!(self.file.read(Tag::MESH)?);
            let mesh = content.map(|bytes| mesh::codec::decode(&bytes, &budget)).transpose()?;
            self.mesh = Some(mesh.map(Arc::new));
        }
        Ok(Arrival::Here(self.mesh.clone().flatten()))
    }

    /// The atlas; `None` where the file has none.
    pub fn charts(&mut self) -> Result<Arrival<Option<Arc<Charts>>>> {
        if self.charts.is_none() {
            let budget = self.file.budget();
            let mesh = here!(self.mesh()?);
            let content = here!(self.file.read(Tag::CHARTS)?);
            let charts = match (&mesh, content) {
                (Some(mesh), Some(bytes)) => Some(Arc::new(charts::decode(&bytes, mesh, &budget)?)),
                _ => None,
            };
            self.charts = Some(charts);
        }
        Ok(Arrival::Here(self.charts.clone().flatten()))
    }

    /// Fitted reflectance; `None` where the file has none. Not kept.
    pub fn reflectance(&mut self) -> Result<Arrival<Option<ReflectanceMaps>>> {
        let budget = self.file.budget();
        let charts = here!(self.charts()?);
        let content = here!(self.file.read(Tag::REFLECTANCE)?);
        let (Some(mesh), Some(charts), Some(bytes)) = (here!(self.mesh()?), charts, content) else {
            return Ok(Arrival::Here(None));
        };
        let decode = |budget: &Budget| reflectance_code::decode(&bytes, &mesh, &charts, budget);
        Ok(Arrival::Here(Some(handed_out(&budget, decode)?)))
    }

    /// What the vertices see; `None` where the file has none. Not kept.
    pub fn visibility(&mut self) -> Result<Arrival<Option<Visibility>>> {
        let budget = self.file.budget();
        let mesh = here!(self.mesh()?);
        let content = here!(self.file.read(Tag::VISIBILITY)?);
        let (Some(mesh), Some(bytes)) = (mesh, content) else { return Ok(Arrival::Here(None)) };
        let decode = |budget: &Budget| visibility::codec::decode(&bytes, &mesh, budget);
        Ok(Arrival::Here(Some(handed_out(&budget, decode)?)))
    }

    /// Light to show the object in; `None` where the file has none. Not kept.
    pub fn light(&mut self) -> Result<Arrival<Option<Light>>> {
        let budget = self.file.budget();
        let content = here!(self.file.read(Tag::LIGHT)?);
        let decode = |bytes: Vec<u8>| handed_out(&budget, |budget| lighting::codec::decode(&bytes, budget));
        Ok(Arrival::Here(content.map(decode).transpose()?))
    }

    /// Fitted materials; none where the file has none. Not kept.
    pub fn materials(&mut self) -> Result<Arrival<Vec<NamedMaterial>>> {
        let budget = self.file.budget();
        let content = here!(self.file.read(Tag::MATERIALS)?);
        let decode = |bytes: Vec<u8>| handed_out(&budget, |budget| materials::decode(&bytes, budget));
        Ok(Arrival::Here(content.map(decode).transpose()?.unwrap_or_default()))
    }

    fn pictures(&mut self) -> Result<Arrival<()>> {
        if self.pictures.is_some() {
            return Ok(Arrival::Here(()));
        }
        let budget = self.file.budget();
        let opened = here!(self.open()?);
        let mesh = here!(self.mesh()?);
        let capture = &opened.capture;
        let pictures = match (&opened.pictures, mesh) {
            (PictureFacts::None, _) => Pictures::None,
            (_, None) => return Err(missing_section(Tag::MESH)),
            (PictureFacts::Tuned { header, streams }, Some(mesh)) => {
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
                Pictures::Tuned(Box::new(decoder), *streams)
            }
            (PictureFacts::Paper, Some(mesh)) => {
                let Some(bytes) = here!(self.file.read(Tag::PAPER)?) else {
                    return Err(missing_section(Tag::PAPER));
                };
                let decoded =
                    wavelet_texture::decode(&bytes, &mesh, &capture.components, capture.views.len(), &budget)?;
                Pictures::Paper(Box::new(decoded), mesh)
            }
        };
        self.pictures = Some(pictures);
        Ok(Arrival::Here(()))
    }

    /// Decodes a view, or one that it is predicted from: no call takes longer than one view.
    pub fn view(&mut self, index: usize) -> Result<Arrival<ViewProgress>> {
        self.view_as(index, |picture| picture.photograph())
    }

    /// [`ArrivingFile::view`], with what `take` makes of the view.
    pub fn view_as<T>(
        &mut self,
        index: usize,
        take: impl FnOnce(ViewPicture) -> T,
    ) -> Result<Arrival<ViewProgress<T>>> {
        here!(self.pictures()?);
        let opened = here!(self.open()?);
        let Some(view) = opened.capture.views.get(index) else {
            let count = opened.capture.views.len();
            return Err(Error::parameter(format!("view {index} does not exist: the file has {count} views")));
        };
        let progress = match &mut self.pictures {
            None | Some(Pictures::None) => ViewProgress::NoPictures,
            Some(Pictures::Paper(decoded, mesh)) => {
                let budget = self.file.budget();
                let _held = super::hold_paper_photograph(mesh, view, opened.capture.components.len(), &budget)?;
                ViewProgress::Done(take(ViewPicture::Photograph(wavelet_texture::decode::photograph(
                    decoded, mesh, view, index,
                ))))
            }
            Some(Pictures::Tuned(decoder, streams)) => {
                let steps = decoder.missing(index)?;
                let Some(&first) = steps.first() else {
                    return match decoder.kept(index) {
                        Some(picture) => Ok(Arrival::Here(ViewProgress::Done(take(ViewPicture::Decoded(picture))))),
                        None => Err(Error::parameter("the view is neither missing nor kept")),
                    };
                };
                let ranges = stream_ranges(decoder, *streams, &steps)?;
                // What is there is decoded while the rest arrives.
                let Arrival::Here(bytes) = self.file.bytes(ranges[0].clone())? else {
                    here!(self.file.all(&ranges)?);
                    return Err(Error::parameter("bytes are there and are not"));
                };
                if steps.len() == 1 {
                    ViewProgress::Done(decoder.decode(first, bytes, |picture| take(ViewPicture::Decoded(picture)))?)
                } else {
                    decoder.decode(first, bytes, |_| ())?;
                    ViewProgress::Again
                }
            }
        };
        Ok(Arrival::Here(progress))
    }

    /// What is not there yet of a view's bytes and of those it is predicted from, to be fetched ahead; empty before the photographs'
    /// order is known.
    pub fn missing_for(&mut self, index: usize) -> Result<Vec<Range<u64>>> {
        let Some(Pictures::Tuned(decoder, streams)) = &mut self.pictures else { return Ok(Vec::new()) };
        let steps = decoder.missing(index)?;
        let wanted = stream_ranges(decoder, *streams, &steps)?;
        Ok(match self.file.all(&wanted)? {
            Arrival::Here(()) => Vec::new(),
            Arrival::Missing(ranges) => ranges,
        })
    }

    /// Compares the checksum of every section.
    /// # Errors
    /// [`Error::Format`] for the first one that does not match.
    pub fn verify(&mut self) -> Result<Arrival<()>> {
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
        let coded = decoder.coded(step).ok_or_else(|| Error::parameter("the step does not exist"))?;
        let start = streams + coded.offset;
        Ok(start..start + coded.lengths.iter().map(|&length| length as u64).sum::<u64>())
    };
    steps.iter().map(range).collect()
}
