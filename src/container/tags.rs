//! Section tags, and the table of the sections: their bounds and what they depend on.

use super::{Section, SectionCodec};
use crate::error::FilePart;
use std::fmt;

/// Four ASCII letters whose case says, as in PNG, how a reader treats a section that it doesn't know: first letter upper case,
/// critical (a reader must understand it); second lower case, private; third upper case (reserved); fourth lower case, safe
/// to copy by editors that changed other sections.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tag(pub [u8; 4]);

impl Tag {
    /// Metadata, a JSON object.
    pub const METADATA: Tag = Tag(*b"mETA");
    /// Thumbnail, a PNG image.
    pub const THUMBNAIL: Tag = Tag(*b"tHMB");
    /// Mesh.
    pub const MESH: Tag = Tag(*b"MESH");
    /// Captured views: cameras, lights, names, white board, components.
    pub const VIEWS: Tag = Tag(*b"VIEW");
    /// Atlas layout.
    pub const CHARTS: Tag = Tag(*b"CHRT");
    /// Reflectance parameters on the atlas.
    pub const REFLECTANCE: Tag = Tag(*b"RFLC");
    /// Displacements of the surface on the atlas.
    pub const DISPLACEMENT: Tag = Tag(*b"DISP");
    /// Residual planes of the `predictive` profile.
    pub const PLANES: Tag = Tag(*b"PLAN");
    /// Residual volumes of the `wavelet-texture` profile.
    pub const WAVELET_TEXTURE: Tag = Tag(*b"PAPR");
    /// Materials by name, fitted or modelled.
    pub const MATERIALS: Tag = Tag(*b"mATl");
    /// Materials of the mesh's triangles; holds for the MESH beside it only.
    pub const BINDING: Tag = Tag(*b"bIND");
    /// Texture coordinates of the mesh's corners; holds for the MESH beside it only.
    pub const COORDINATES: Tag = Tag(*b"tCOR");
    /// Visibility of the vertices; holds for the MESH beside it only.
    pub const VISIBILITY: Tag = Tag(*b"vISB");
    /// Light: spherical Gaussians and prefiltered levels.
    pub const LIGHT: Tag = Tag(*b"lIGt");

    /// Returns whether a reader that does not know the section must refuse the file.
    pub fn is_critical(self) -> bool {
        self.0[0].is_ascii_uppercase()
    }
    /// Returns whether the tag is of private use.
    pub fn is_private(self) -> bool {
        self.0[1].is_ascii_lowercase()
    }
    /// Returns whether the section stays valid after changes to other sections.
    pub fn is_safe_to_copy(self) -> bool {
        self.0[3].is_ascii_lowercase()
    }
    /// Returns whether the tag is four ASCII letters, the third one upper case.
    pub fn is_valid(self) -> bool {
        self.0.iter().all(u8::is_ascii_alphabetic) && self.0[2].is_ascii_uppercase()
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.escape_ascii().fmt(f)
    }
}

impl fmt::Debug for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl From<Tag> for FilePart {
    fn from(tag: Tag) -> FilePart {
        FilePart::Section(tag.0)
    }
}

/// Rule that a section must obey.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SectionRule {
    /// Its tag.
    pub tag: Tag,
    /// Fewest decoded bytes.
    pub min_bytes: u64,
    /// Most decoded bytes (also the most stored bytes).
    pub max_bytes: u64,
    /// Codecs it may be stored with.
    pub codecs: &'static [SectionCodec],
    /// Sections that it can't be decoded without.
    pub dependencies: &'static [Tag],
    /// Whether it may come more than once.
    pub repeats: bool,
}

const GENERAL: &[SectionCodec] = &[SectionCodec::None, SectionCodec::Zstd];
const OWN: &[SectionCodec] = &[SectionCodec::Own];
const ANY: &[SectionCodec] = &[SectionCodec::None, SectionCodec::Zstd, SectionCodec::Own];

/// All known sections, in the order in which writers put them. Part of the format.
const SECTION_RULES: [SectionRule; 14] = [
    rule(Tag::METADATA, 2, 1 << 20, GENERAL, &[]),
    rule(Tag::THUMBNAIL, 57, 1 << 20, &[SectionCodec::None], &[]),
    rule(Tag::MESH, 4, 1 << 32, OWN, &[]),
    rule(Tag::VIEWS, 4, 1 << 26, OWN, &[]),
    rule(Tag::CHARTS, 1, 1 << 30, ANY, &[Tag::MESH]),
    rule(Tag::DISPLACEMENT, 7, 1 << 32, OWN, &[Tag::CHARTS, Tag::MESH]),
    rule(Tag::REFLECTANCE, 1, 1 << 40, ANY, &[Tag::CHARTS, Tag::MESH]),
    rule(Tag::PLANES, 1, 1 << 40, ANY, &[Tag::MESH, Tag::VIEWS]),
    rule(Tag::WAVELET_TEXTURE, 1, 1 << 40, ANY, &[Tag::MESH, Tag::VIEWS]),
    rule(Tag::MATERIALS, 5, 1 << 32, OWN, &[]),
    rule(Tag::BINDING, 5, 1 << 32, OWN, &[Tag::MATERIALS, Tag::MESH]),
    rule(Tag::COORDINATES, 16, 1 << 34, OWN, &[Tag::MESH]),
    rule(Tag::VISIBILITY, 21, 1 << 36, OWN, &[Tag::MESH]),
    rule(Tag::LIGHT, 4, 1 << 32, OWN, &[]),
];
/// Sections of which one is enough for a file; a file with none of them is of an object with its views.
const SELF_CONTAINED: [Tag; 3] = [Tag::VISIBILITY, Tag::LIGHT, Tag::MATERIALS];
/// Most bytes of a section that this build does not know. Part of the format.
const MAX_UNKNOWN_BYTES: u64 = 1 << 40;

const fn rule(
    tag: Tag,
    min_bytes: u64,
    max_bytes: u64,
    codecs: &'static [SectionCodec],
    dependencies: &'static [Tag],
) -> SectionRule {
    SectionRule { tag, min_bytes, max_bytes, codecs, dependencies, repeats: false }
}

/// Returns whether a file of these sections must have one with this tag: the mesh and the views of an object, and what
/// other sections depend on.
pub(crate) fn is_required(tag: Tag, sections: &[Section]) -> bool {
    let has = |tag: Tag| sections.iter().any(|section| section.tag == tag);
    let is_object = has(Tag::VIEWS) || !SELF_CONTAINED.into_iter().any(has);
    let mut rules = sections.iter().map(|section| section_rule(section.tag));
    is_object && [Tag::MESH, Tag::VIEWS].contains(&tag) || rules.any(|rule| rule.dependencies.contains(&tag))
}

/// All known sections, in the order in which writers put them.
#[cfg(feature = "encode")]
pub(crate) fn section_rules() -> impl Iterator<Item = SectionRule> {
    SECTION_RULES.into_iter()
}

/// Returns the rule of a section that this build knows.
pub fn known_rule(tag: Tag) -> Option<SectionRule> {
    SECTION_RULES.iter().find(|known| known.tag == tag).copied()
}

/// Returns the rule of a section: that of the table, or the general one for a tag that is not in it.
pub fn section_rule(tag: Tag) -> SectionRule {
    known_rule(tag).unwrap_or(SectionRule {
        tag,
        min_bytes: 0,
        max_bytes: MAX_UNKNOWN_BYTES,
        codecs: ANY,
        dependencies: &[],
        repeats: true,
    })
}
