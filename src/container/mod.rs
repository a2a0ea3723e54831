//! The file: signature, sections and directory. Specified in `spec/container.md`.
//!
//! A section's inline header and its entry in the directory are the same bytes ([`Section`]), so that a file is read either
//! from its start, section by section ([`SectionStream`]), or by its directory at the end ([`Container`]).

mod directory;
#[cfg(feature = "encode")]
pub(crate) mod edit;
pub(crate) mod incremental;
pub(crate) mod metadata;
mod pieces;
mod reader;
mod section;
mod stream;
#[cfg(feature = "encode")]
pub(crate) mod survey;
mod tags;
pub(crate) mod thumbnail;
#[cfg(feature = "encode")]
mod writer;
mod zstd_frame;

#[cfg(feature = "encode")]
pub use edit::with_sections;
pub use incremental::{IncrementalReader, Poll};
pub use metadata::{AchievedError, Metadata, metres_per_unit};
pub use reader::Container;
pub use section::{Section, SectionCodec};
pub(crate) use section::{push_f32, push_number, push_u16, push_u32};
pub use stream::{FilePrefix, SectionStream, read_prefix, read_stream, verify};
pub(crate) use tags::is_required;
#[cfg(feature = "encode")]
pub(crate) use tags::section_rules;
pub use tags::{SectionRule, Tag, known_rule, section_rule};
#[cfg(feature = "encode")]
pub use thumbnail::encode_thumbnail;
pub use thumbnail::{Thumbnail, decode_thumbnail};
#[cfg(feature = "encode")]
pub use writer::ContainerWriter;
#[cfg(feature = "encode")]
pub(crate) use writer::write_file;

use byteorder::{ByteOrder, LittleEndian};

/// First bytes of every file: a byte that is not ASCII, three letters, and both line endings around the end-of-file character, so
/// that damage by text-mode transfers shows at once. Part of the format.
pub const SIGNATURE: [u8; 8] = [0xe8, b'T', b'S', b'Y', b'\r', b'\n', 0x1a, b'\n'];
/// Last bytes of every file. Part of the format.
pub const END_SIGNATURE: [u8; 4] = [b'Y', b'S', b'T', 0xe8];
/// Version written: major, minor. Major 0 is experimental: its minor versions do not read each other. Part of the format.
pub const VERSION: (u16, u16) = (0, 1);
/// Tag that opens the directory. Part of the format.
pub const DIRECTORY_TAG: Tag = Tag(*b"DRCT");
/// Signature and version. Part of the format.
pub const FILE_HEADER_BYTES: usize = 12;
/// Length of the directory and end signature. Part of the format.
pub const TRAILER_BYTES: usize = 8;
/// Sections that a file may have. Part of the format.
pub const MAX_SECTIONS: u64 = 4096;
/// Shortest and longest section header: tag, codec, one or two lengths, checksum. Part of the format.
pub(crate) const SECTION_HEADER_BYTES: std::ops::RangeInclusive<u64> = 10..=29;

/// First twelve bytes of a file of this version.
#[cfg(feature = "encode")]
pub(crate) fn file_header() -> [u8; FILE_HEADER_BYTES] {
    let mut bytes = [0; FILE_HEADER_BYTES];
    bytes[..8].copy_from_slice(&SIGNATURE);
    LittleEndian::write_u16(&mut bytes[8..10], VERSION.0);
    LittleEndian::write_u16(&mut bytes[10..], VERSION.1);
    bytes
}

/// Checks signature and version.
pub(crate) fn check_file_header(bytes: &[u8; FILE_HEADER_BYTES]) -> crate::Result<()> {
    use crate::{Error, FilePart};
    if bytes[1..4] == SIGNATURE[1..4] && bytes[..8] != SIGNATURE {
        return Err(Error::format(FilePart::File, 0u8, "signature damaged, perhaps by a transfer in text mode"));
    }
    if bytes[..8] != SIGNATURE {
        return Err(Error::format(FilePart::File, 0u8, "not a .tsuya file: it must begin with E8 'TSY' 0D 0A 1A 0A"));
    }
    let version = (LittleEndian::read_u16(&bytes[8..10]), LittleEndian::read_u16(&bytes[10..]));
    if version != VERSION {
        return Err(Error::Unsupported(format!(
            "file of version {}.{}, this build reads {}.{} (0.x is experimental)",
            version.0, version.1, VERSION.0, VERSION.1
        )));
    }
    Ok(())
}

/// Error for a section that a file must have and has not.
pub(crate) fn missing_section(tag: Tag) -> crate::Error {
    crate::Error::format(tag, 0u8, "the file has no such section")
}

#[cfg(test)]
mod tests;
