//! Writing: sections stream out as they come, the directory follows at the end.

use super::metadata::{self, Metadata};
use super::section::{Section, SectionCodec};
use super::{DIRECTORY_TAG, MAX_SECTIONS, Tag, directory, file_header, thumbnail};
use crate::{Error, Result};
use std::io::Write;
use std::path::PathBuf;

/// zstd's level for sections without entropy coding of their own: they are small.
const ZSTD_LEVEL: i32 = 19;

/// Writes a file from start to end.
#[derive(Debug)]
pub struct ContainerWriter<W: Write> {
    inner: W,
    path: PathBuf,
    sections: Vec<Section>,
    offset: u64,
}

impl<W: Write> ContainerWriter<W> {
    /// Writes signature and version.
    pub fn new(inner: W) -> Result<Self> {
        Self::with_path(inner, "-")
    }
    /// Writes signature and version to a file that errors name `path`.
    pub fn with_path(inner: W, path: impl Into<PathBuf>) -> Result<Self> {
        let mut writer = ContainerWriter { inner, path: path.into(), sections: Vec::new(), offset: 0 };
        writer.write_bytes(&file_header())?;
        Ok(writer)
    }
    fn write_bytes(&mut self, bytes: &[u8]) -> Result<()> {
        self.inner.write_all(bytes).map_err(|e| Error::io(&self.path, e))?;
        self.offset += bytes.len() as u64;
        Ok(())
    }
    /// Writes one section. With [`SectionCodec::Zstd`] the bytes are stored as they are where that is no longer.
    pub fn write_section(&mut self, tag: Tag, codec: SectionCodec, content: &[u8]) -> Result<Section> {
        if !tag.is_valid() || tag == DIRECTORY_TAG {
            return Err(Error::parameter(format!("'{tag}' can't be the tag of a section")));
        }
        if self.sections.len() as u64 >= MAX_SECTIONS {
            return Err(Error::parameter(format!("more than {MAX_SECTIONS} sections")));
        }
        let compressed;
        let (codec, stored) = if codec == SectionCodec::Zstd {
            compressed = zstd::bulk::compress(content, ZSTD_LEVEL).map_err(|e| Error::io(&self.path, e))?;
            if compressed.len() + 1 < content.len() { (codec, &compressed[..]) } else { (SectionCodec::None, content) }
        } else {
            (codec, content)
        };
        let (stored_length, decoded) = (stored.len() as u64, content.len() as u64);
        let mut section = Section { tag, codec, stored: stored_length, decoded, crc: 0, offset: self.offset };
        section.check_bounds()?;
        section.check_repetition(&self.sections)?;
        let mut hasher = section.hasher();
        hasher.update(stored);
        section.crc = hasher.finalize();
        self.write_bytes(&section.to_bytes())?;
        self.write_bytes(stored)?;
        self.sections.push(section);
        Ok(section)
    }
    /// The sections written so far.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }
    /// Writes directory and trailer, flushes, and gives the writer back.
    pub fn finish(mut self) -> Result<W> {
        self.write_bytes(&directory::to_bytes(&file_header(), &self.sections))?;
        self.inner.flush().map_err(|e| Error::io(&self.path, e))?;
        Ok(self.inner)
    }
}

/// Writes a file into memory: metadata, a thumbnail (a PNG file) and sections whose content is coded already. Returns it with
/// each section's four letters and stored bytes, in file order.
pub(crate) fn write_file(
    metadata: &Metadata,
    thumbnail_png: &[u8],
    sections: &[(Tag, Vec<u8>)],
) -> Result<(Vec<u8>, Vec<(String, u64)>)> {
    let mut writer = ContainerWriter::new(Vec::new())?;
    writer.write_section(Tag::METADATA, SectionCodec::Zstd, &metadata::encode(metadata)?)?;
    writer.write_section(Tag::THUMBNAIL, SectionCodec::None, &thumbnail::encode_thumbnail(thumbnail_png)?)?;
    for (tag, content) in sections {
        writer.write_section(*tag, SectionCodec::Own, content)?;
    }
    let stored = writer.sections().iter().map(|section| (section.tag.to_string(), section.stored)).collect();
    Ok((writer.finish()?, stored))
}
