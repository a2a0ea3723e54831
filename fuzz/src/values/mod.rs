//! Values of every section, made of a fuzzer's bytes, written by the library, and read again: what the writer accepts must come back.

mod parts;
mod pictures;

use arbitrary::{Result, Unstructured};
use tsuya::Charts;
use tsuya::Mesh;
use tsuya::brdf::NamedMaterial;
use tsuya::{Budget, Limits, lighting, mesh};
use tsuya::{Component, View};
use tsuya::{
    container::{self, SectionCodec, Tag},
    internals,
};

/// What sections are made for, as a decoder has it.
#[derive(Debug)]
pub struct Object {
    /// The mesh and its section.
    pub mesh: (Mesh, Vec<u8>),
    /// The views and their section.
    pub views: (internals::views::ViewsSection, Vec<u8>),
    /// The atlas and its section.
    pub charts: (Charts, Vec<u8>),
    /// Materials and their section; `None` of those that are not taken.
    pub materials: Option<(Vec<NamedMaterial>, Vec<u8>)>,
}

/// Sections in the order in which they stand in a file.
pub const TAGS: [Tag; 13] = [
    Tag::METADATA,
    Tag::THUMBNAIL,
    Tag::MESH,
    Tag::VIEWS,
    Tag::CHARTS,
    Tag::REFLECTANCE,
    Tag::PLANES,
    Tag::WAVELET_TEXTURE,
    Tag::MATERIALS,
    Tag::BINDING,
    Tag::COORDINATES,
    Tag::VISIBILITY,
    Tag::LIGHT,
];

/// Limits for what these values ask for.
pub const LIMITS: Limits = Limits { memory_bytes: 1 << 28, views: 64, image_side: 1024, mesh_elements: 1 << 14 };

/// A fresh account.
pub fn budget() -> Budget {
    Budget::new(LIMITS)
}

/// The codec that the writer uses.
pub fn codec(tag: Tag) -> u8 {
    let codec = match tag {
        Tag::METADATA | Tag::THUMBNAIL => SectionCodec::None,
        _ => SectionCodec::Own,
    };
    codec as u8
}

impl Object {
    /// A mesh, views, an atlas and materials. All come back.
    pub fn arbitrary(u: &mut Unstructured) -> Result<Object> {
        let mesh = parts::mesh(u)?;
        let views = parts::views(u, &mesh.0)?;
        let charts = parts::charts(u, &mesh.0)?;
        let materials = parts::materials(u)?;
        Ok(Object { mesh, views, charts, materials })
    }

    /// A section, which came back; `None` where the writer does not take the value.
    pub fn section(&self, tag: Tag, u: &mut Unstructured) -> Result<Option<Vec<u8>>> {
        Ok(match tag {
            Tag::METADATA => Some(parts::metadata(u)?),
            Tag::THUMBNAIL => parts::thumbnail(u)?,
            Tag::MESH => Some(self.mesh.1.clone()),
            Tag::VIEWS => Some(self.views.1.clone()),
            Tag::CHARTS => Some(self.charts.1.clone()),
            Tag::REFLECTANCE => parts::reflectance(u, &self.mesh.0, &self.charts.0)?,
            Tag::PLANES => Some(pictures::planes(u, self)?),
            Tag::WAVELET_TEXTURE => pictures::paper(u, self)?,
            Tag::MATERIALS => self.materials.as_ref().map(|(_, bytes)| bytes.clone()),
            Tag::BINDING => match &self.materials {
                Some((materials, _)) => parts::binding(u, &self.mesh.0, materials)?,
                None => None,
            },
            Tag::COORDINATES => parts::coordinates(u, &self.mesh.0)?,
            Tag::VISIBILITY => parts::visibility(u, &self.mesh.0)?,
            _ => parts::light(u)?,
        })
    }

    /// Reads a section that may be damaged.
    pub fn read(&self, tag: Tag, bytes: &[u8]) {
        let (mesh, budget) = (&self.mesh.0, budget());
        match tag {
            Tag::METADATA => drop(internals::container::metadata::decode(bytes, &budget)),
            Tag::THUMBNAIL => drop(container::decode_thumbnail(bytes.to_vec())),
            Tag::MESH => drop(mesh::decode(bytes, &budget)),
            Tag::VIEWS => drop(internals::views::decode(bytes, &budget)),
            Tag::CHARTS => drop(internals::surface::charts::decode(bytes, mesh, &budget)),
            Tag::REFLECTANCE => drop(internals::reflectance::decode(bytes, mesh, &self.charts.0, &budget)),
            Tag::PLANES => pictures::read_planes(bytes, self),
            Tag::WAVELET_TEXTURE => drop(internals::wavelet_texture::decode(
                bytes,
                mesh,
                self.components(),
                self.all_views().len(),
                &budget,
            )),
            Tag::MATERIALS => drop(tsuya::brdf::decode_materials(bytes, &budget)),
            Tag::BINDING => {
                let materials = self.materials.as_ref().map_or(&[][..], |(materials, _)| materials);
                drop(tsuya::brdf::decode_binding(bytes, mesh.triangles.len(), materials, &budget));
            }
            Tag::COORDINATES => drop(mesh::decode_coordinates(bytes, mesh, &budget)),
            Tag::VISIBILITY => drop(internals::visibility::decode(bytes, mesh, &budget)),
            _ => drop(lighting::decode(bytes, &budget)),
        }
    }

    /// What each photograph consists of.
    pub fn components(&self) -> &[Component] {
        &self.views.0.components
    }

    /// The views.
    pub fn all_views(&self) -> &[View] {
        &self.views.0.views
    }
}

/// The head of section `PLAN` of any value comes back.
pub fn planes_header(u: &mut Unstructured) -> Result<internals::predictive::PlaneHeader> {
    pictures::header(u)
}

/// A number: often a plain one, at times any.
pub fn number(u: &mut Unstructured) -> Result<f32> {
    Ok(match u.int_in_range(0..=15)? {
        0 => f32::from_bits(u.arbitrary()?),
        1 => {
            *u.choose(&[0.0, -0.0, 1.0, f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, f32::MIN_POSITIVE, 1e-42])?
        }
        _ => u.arbitrary::<i16>()? as f32 / 4096.0,
    })
}

/// A finite number from 0 on.
pub fn positive(u: &mut Unstructured) -> Result<f32> {
    let number = number(u)?.abs();
    Ok(if number.is_finite() { number } else { 1.0 })
}
