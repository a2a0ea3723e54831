//! Section tags and the table of what is known about them.

use super::SectionCodec;
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
    /// Thumbnail, a PNG picture.
    pub const THUMBNAIL: Tag = Tag(*b"tHMB");
    /// Mesh.
    pub const MESH: Tag = Tag(*b"MESH");
    /// Captured views: cameras, lights, names, white board, components.
    pub const VIEWS: Tag = Tag(*b"VIEW");
    /// Atlas layout.
    pub const CHARTS: Tag = Tag(*b"CHRT");
    /// Reflectance parameters on the atlas.
    pub const REFLECTANCE: Tag = Tag(*b"RFLC");
    /// Residual planes of the `predictive` profile.
    pub const PLANES: Tag = Tag(*b"PLAN");
    /// Residual volumes of the `wavelet-texture` profile.
    pub const WAVELET_TEXTURE: Tag = Tag(*b"PAPR");
    /// Fitted materials by name.
    pub const MATERIALS: Tag = Tag(*b"mATl");
    /// Visibility of the vertices; holds for the MESH beside it only.
    pub const VISIBILITY: Tag = Tag(*b"vISB");
    /// Light: spherical Gaussians and prefiltered levels.
    pub const LIGHT: Tag = Tag(*b"lIGt");

    /// True when a reader that doesn't know the section must refuse the file.
    pub fn is_critical(self) -> bool {
        self.0[0].is_ascii_uppercase()
    }
    /// True for tags of private use.
    pub fn is_private(self) -> bool {
        self.0[1].is_ascii_lowercase()
    }
    /// True when the section stays true after changes to other sections.
    pub fn is_safe_to_copy(self) -> bool {
        self.0[3].is_ascii_lowercase()
    }
    /// Four ASCII letters, the third one upper case.
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

/// What this build knows about a section.
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
    /// Whether it may come more than once.
    pub repeats: bool,
}

const GENERAL: &[SectionCodec] = &[SectionCodec::None, SectionCodec::Zstd];
const OWN: &[SectionCodec] = &[SectionCodec::Own];
const ANY: &[SectionCodec] = &[SectionCodec::None, SectionCodec::Zstd, SectionCodec::Own];

/// All known sections, in the order in which writers put them. Part of the format.
const SECTION_RULES: [SectionRule; 11] = [
    rule(Tag::METADATA, 2, 1 << 20, GENERAL),
    rule(Tag::THUMBNAIL, 57, 1 << 20, &[SectionCodec::None]),
    rule(Tag::MESH, 4, 1 << 32, OWN),
    rule(Tag::VIEWS, 4, 1 << 26, OWN),
    rule(Tag::CHARTS, 1, 1 << 30, ANY),
    rule(Tag::REFLECTANCE, 1, 1 << 40, ANY),
    rule(Tag::PLANES, 1, 1 << 40, ANY),
    rule(Tag::WAVELET_TEXTURE, 1, 1 << 40, ANY),
    rule(Tag::MATERIALS, 5, 1 << 32, OWN),
    rule(Tag::VISIBILITY, 21, 1 << 36, OWN),
    rule(Tag::LIGHT, 4, 1 << 32, OWN),
];
/// What holds for sections that this build doesn't know. Part of the format.
const MAX_UNKNOWN_BYTES: u64 = 1 << 40;

const fn rule(tag: Tag, shortest: u64, longest: u64, codecs: &'static [SectionCodec]) -> SectionRule {
    SectionRule { tag, min_bytes: shortest, max_bytes: longest, codecs, repeats: false }
}

/// What this build knows about a tag.
pub fn known_rule(tag: Tag) -> Option<SectionRule> {
    SECTION_RULES.iter().find(|known| known.tag == tag).copied()
}

/// Bounds of a section: those of the table, or the general ones for a tag that is not in it.
pub fn section_rule(tag: Tag) -> SectionRule {
    known_rule(tag).unwrap_or(SectionRule {
        tag,
        min_bytes: 0,
        max_bytes: MAX_UNKNOWN_BYTES,
        codecs: ANY,
        repeats: true,
    })
}
