//! Stages of decoding: each decodes one section of a file from what earlier stages gave, or names the ranges that it needs.

use crate::brdf::binding::{self, TriangleBinding};
use crate::brdf::materials::{self, NamedMaterial};
use crate::container::incremental::ready;
use crate::container::metadata::{self, Metadata};
use crate::container::{IncrementalReader, Poll, Tag, is_required, missing_section};
use crate::error::Result;
use crate::lighting::{self, EnvironmentLobes};
use crate::limits::{Budget, Reservation};
use crate::mesh::{self, CornerCoordinates, Mesh};
use crate::predictive::header::{self, PlaneSection};
use crate::reflectance::{self, maps::ReflectanceMaps};
use crate::surface::charts::{self, Charts};
use crate::surface::displacement::{self, DisplacedMesh};
use crate::surface::raster;
use crate::views::codec::{self, ViewsSection};
use crate::views::{Photograph, View};
use crate::visibility::{self, Visibility};
use crate::wavelet_texture::{self, DecodedWaveletTexture};

/// How a file holds its photographs.
#[derive(Debug)]
pub enum PhotographCoding {
    /// It holds none.
    None,
    /// Profile `predictive`: the opened section PLAN.
    Predictive(PlaneSection),
    /// Profile `wavelet-texture`: section PAPR.
    WaveletTexture,
}

/// Decodes the first section with a tag; `None` if the file has none and needs none.
fn section<T>(
    file: &mut IncrementalReader,
    tag: Tag,
    decode: impl FnOnce(&[u8], &Budget) -> Result<T>,
) -> Result<Poll<Option<T>>> {
    let budget = file.budget();
    let content = ready!(file.content(tag)?);
    Ok(Poll::Ready(content.map(|content| decode(&content, &budget)).transpose()?))
}

/// Decodes a section that the file must have unless [`is_required`] excuses it.
fn object_section<T>(
    file: &mut IncrementalReader,
    tag: Tag,
    decode: impl FnOnce(&[u8], &Budget) -> Result<T>,
) -> Result<Poll<Option<T>>> {
    let decoded = ready!(section(file, tag, decode)?);
    if decoded.is_none() && is_required(tag, file.sections().0) {
        return Err(missing_section(tag));
    }
    Ok(Poll::Ready(decoded))
}

/// Decodes the metadata; empty in a file without.
pub(super) fn metadata(file: &mut IncrementalReader) -> Result<Poll<Metadata>> {
    Ok(Poll::Ready(ready!(section(file, Tag::METADATA, metadata::decode)?).unwrap_or_default()))
}

/// Decodes white board, components and views; none in a file without.
pub(super) fn views(file: &mut IncrementalReader) -> Result<Poll<ViewsSection>> {
    let none = || ViewsSection { white: [1.0; 3], ..Default::default() };
    Ok(Poll::Ready(ready!(object_section(file, Tag::VIEWS, codec::decode)?).unwrap_or_else(none)))
}

/// Finds out how the photographs of these views, and of so many components, are coded. Of both profiles PLAN counts, wherever it stands.
pub(super) fn photograph_coding(
    file: &mut IncrementalReader,
    views: &[View],
    components: usize,
) -> Result<Poll<PhotographCoding>> {
    if let Some(section) = ready!(file.find(Tag::PLANES)?) {
        let planes = ready!(header::open(file, &section, views, components)?);
        return Ok(Poll::Ready(PhotographCoding::Predictive(planes)));
    }
    Ok(Poll::Ready(match ready!(file.find(Tag::WAVELET_TEXTURE)?) {
        Some(_) => PhotographCoding::WaveletTexture,
        None => PhotographCoding::None,
    }))
}

/// Decodes the photographs of profile `wavelet-texture`, all views together; [`wavelet_photograph`] draws each.
pub(super) fn wavelet_texture(
    file: &mut IncrementalReader,
    mesh: &Mesh,
    components: &[crate::views::Component],
    views: usize,
) -> Result<Poll<DecodedWaveletTexture>> {
    let decode = |bytes: &[u8], budget: &Budget| wavelet_texture::decode(bytes, mesh, components, views, budget);
    match ready!(section(file, Tag::WAVELET_TEXTURE, decode)?) {
        Some(decoded) => Ok(Poll::Ready(decoded)),
        None => Err(missing_section(Tag::WAVELET_TEXTURE)),
    }
}

/// Draws a photograph of profile `wavelet-texture`. Its memory is charged before and released with the reservation.
/// # Errors
/// [`crate::Error::Limits`] if the memory is not available, or drawing takes too much work.
pub(super) fn wavelet_photograph<'b>(
    decoded: &DecodedWaveletTexture,
    mesh: &Mesh,
    (index, view): (usize, &View),
    components: usize,
    budget: &'b Budget,
) -> Result<(Photograph, Reservation<'b>)> {
    raster::check_work(mesh, &view.camera)?;
    let pixels = view.camera.width as u64 * view.camera.height as u64;
    let reservation = budget.reserve("a view being decoded", pixels.saturating_mul(32 + 12 * components as u64))?;
    Ok((wavelet_texture::decode::photograph(decoded, mesh, view, index), reservation))
}

/// Decodes the reflectance; `None` in a file without, or without the atlas that it lies on.
pub(super) fn reflectance(
    file: &mut IncrementalReader,
    mesh: Option<&Mesh>,
    charts: Option<&Charts>,
) -> Result<Poll<Option<ReflectanceMaps>>> {
    let (Some(mesh), Some(charts)) = (mesh, charts) else { return Ok(Poll::Ready(None)) };
    section(file, Tag::REFLECTANCE, |bytes, budget| reflectance::codec::decode(bytes, mesh, charts, budget))
}

/// Decodes the fine surface; `None` in a file without.
pub(super) fn displacement(
    file: &mut IncrementalReader,
    mesh: Option<&Mesh>,
    charts: Option<&Charts>,
) -> Result<Poll<Option<DisplacedMesh>>> {
    let (Some(mesh), Some(charts)) = (mesh, charts) else { return Ok(Poll::Ready(None)) };
    section(file, Tag::DISPLACEMENT, |bytes, budget| displacement::decode(bytes, mesh, charts, budget))
}

/// Decodes the atlas; `None` in a file without.
pub(super) fn charts(file: &mut IncrementalReader, mesh: Option<&Mesh>) -> Result<Poll<Option<Charts>>> {
    let Some(mesh) = mesh else { return Ok(Poll::Ready(None)) };
    section(file, Tag::CHARTS, |bytes, budget| charts::decode(bytes, mesh, budget))
}

/// Decodes the mesh; `None` in a file that needs none.
pub(super) fn mesh(file: &mut IncrementalReader) -> Result<Poll<Option<Mesh>>> {
    object_section(file, Tag::MESH, mesh::codec::decode)
}

/// Decodes the visibility of the mesh's vertices; `None` in a file without.
pub(super) fn visibility(file: &mut IncrementalReader, mesh: Option<&Mesh>) -> Result<Poll<Option<Visibility>>> {
    let Some(mesh) = mesh else { return Ok(Poll::Ready(None)) };
    section(file, Tag::VISIBILITY, |bytes, budget| visibility::codec::decode(bytes, mesh, budget))
}

/// Decodes the light to show the object in; `None` in a file without.
pub(super) fn light(file: &mut IncrementalReader) -> Result<Poll<Option<EnvironmentLobes>>> {
    section(file, Tag::LIGHT, lighting::codec::decode)
}

/// Decodes the materials; none in a file without.
pub(super) fn materials(file: &mut IncrementalReader) -> Result<Poll<Vec<NamedMaterial>>> {
    Ok(Poll::Ready(ready!(section(file, Tag::MATERIALS, materials::decode_materials)?).unwrap_or_default()))
}

/// Decodes the texture coordinates; `None` in a file without.
pub(super) fn coordinates(
    file: &mut IncrementalReader,
    mesh: Option<&Mesh>,
) -> Result<Poll<Option<Vec<CornerCoordinates>>>> {
    let Some(mesh) = mesh else { return Ok(Poll::Ready(None)) };
    section(file, Tag::COORDINATES, |bytes, budget| mesh::coordinates::decode_coordinates(bytes, mesh, budget))
}

/// Decodes the materials of the mesh's triangles; `None` in a file without.
pub(super) fn binding(
    file: &mut IncrementalReader,
    mesh: Option<&Mesh>,
    materials: &[NamedMaterial],
) -> Result<Poll<Option<TriangleBinding>>> {
    let Some(mesh) = mesh else { return Ok(Poll::Ready(None)) };
    section(file, Tag::BINDING, |bytes, budget| binding::decode_binding(bytes, mesh.triangles.len(), materials, budget))
}
