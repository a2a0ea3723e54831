//! Reading by the directory: only the bytes that are asked for.

use super::section::{Section, SectionCodec, read_number};
use super::{
    DIRECTORY_TAG, END_SIGNATURE, FILE_HEADER_BYTES, MAX_SECTIONS, SECTION_HEADER_BYTES, TRAILER_BYTES, Tag,
    check_file_header,
};
use crate::error::FilePart;
use crate::limits::{Budget, Limits};
use crate::{Error, Result};
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An open file with its directory.
#[derive(Debug)]
pub struct Container<R> {
    source: R,
    path: PathBuf,
    sections: Vec<Section>,
    budget: Arc<Budget>,
    length: u64,
    bytes_read: u64,
}

impl<'a> Container<Cursor<&'a [u8]>> {
    /// Opens a file in memory.
    pub fn open_slice(bytes: &'a [u8], limits: Limits) -> Result<Self> {
        Container::open_seek(Cursor::new(bytes), limits)
    }
}

impl Container<std::fs::File> {
    /// Opens a file on disk.
    pub fn open_path(path: impl AsRef<Path>, limits: Limits) -> Result<Self> {
        let path = path.as_ref();
        let (file, _) = crate::input::open(path)?;
        Container::open_named(file, path.to_owned(), limits)
    }
}

impl<R: Read + Seek> Container<R> {
    /// Opens a seekable source: reads its head, trailer and directory and checks that they fit its length.
    pub fn open_seek(source: R, limits: Limits) -> Result<Self> {
        Self::open_named(source, PathBuf::from("-"), limits)
    }

    fn open_named(source: R, path: PathBuf, limits: Limits) -> Result<Self> {
        let budget = Arc::new(Budget::new(limits));
        let mut container = Container { source, path, sections: Vec::new(), budget, length: 0, bytes_read: 0 };
        let end = container.source.seek(SeekFrom::End(0));
        container.length = end.map_err(|e| Error::io(&container.path, e))?;
        let length = container.length;
        let head_bytes = container.read_at(0, length.min(FILE_HEADER_BYTES as u64))?;
        let Ok(head) = <[u8; FILE_HEADER_BYTES]>::try_from(&head_bytes[..]) else {
            return Err(Error::format(FilePart::File, length, "ends within its first 12 bytes"));
        };
        check_file_header(&head)?;
        let trailer_at = length.saturating_sub(TRAILER_BYTES as u64);
        let trailer = container.read_at(trailer_at, length - trailer_at)?;
        let directory_at = directory_offset(&trailer, length)?;
        let directory_length = trailer_at - directory_at;
        container.budget.charge("directory", directory_length)?;
        let directory = container.read_at(directory_at, directory_length)?;
        container.sections = parse_directory(&head, &directory, directory_at)?;
        Ok(container)
    }

    /// `length` bytes from `offset`; the caller has checked that the file has them and has charged them.
    fn read_at(&mut self, offset: u64, length: u64) -> Result<Vec<u8>> {
        let failed = |e| Error::io(&self.path, e);
        self.source.seek(SeekFrom::Start(offset)).map_err(failed)?;
        let mut bytes = Vec::new();
        let reserved = usize::try_from(length).ok().and_then(|length| bytes.try_reserve_exact(length).ok());
        reserved.ok_or(Error::Limits { what: "bytes of the file", requested: length, allowed: 0 })?;
        let got = self.source.by_ref().take(length).read_to_end(&mut bytes).map_err(failed)?;
        self.bytes_read += got as u64;
        if got as u64 != length {
            return Err(Error::format(FilePart::File, offset + got as u64, "ends early"));
        }
        Ok(bytes)
    }

    /// All sections in file order.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }
    /// The first section with a tag.
    pub fn find(&self, tag: Tag) -> Option<&Section> {
        self.sections.iter().find(|section| section.tag == tag)
    }
    /// The account that everything read is charged to.
    pub fn budget(&self) -> Arc<Budget> {
        self.budget.clone()
    }
    /// Bytes taken from the source so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read
    }
    /// Length of the file.
    pub fn file_bytes(&self) -> u64 {
        self.length
    }

    fn need(&self, tag: Tag) -> Result<Section> {
        self.find(tag).copied().ok_or_else(|| Error::format(tag, 0u8, "the file has no such section"))
    }

    /// The content of the first section with a tag: checksum compared, decompressed.
    pub fn read_section(&mut self, tag: Tag) -> Result<Vec<u8>> {
        let section = self.need(tag)?;
        self.read_content(&section)
    }
    /// The content of that section, `None` where the file has none.
    pub fn read_optional(&mut self, tag: Tag) -> Result<Option<Vec<u8>>> {
        let section = self.find(tag).copied();
        section.map(|section| self.read_content(&section)).transpose()
    }
    /// The content of a section out of [`Container::sections`].
    pub fn read_content(&mut self, section: &Section) -> Result<Vec<u8>> {
        let header = section.to_bytes();
        self.budget.charge("section", section.stored)?;
        if self.read_at(section.offset, header.len() as u64)? != header {
            return Err(Error::format(section.tag, 0u8, "header differs from the directory"));
        }
        let stored = self.read_at(section.offset + header.len() as u64, section.stored)?;
        let mut hasher = section.hasher();
        hasher.update(&stored);
        section.check_crc(hasher)?;
        section.decode(stored, &self.budget)
    }

    /// A part of a section that is not compressed as a whole. The section's checksum is not compared: formats that are read
    /// in parts carry checksums of their own.
    pub fn read_range(&mut self, tag: Tag, offset: u64, length: u64) -> Result<Vec<u8>> {
        let section = self.need(tag)?;
        if section.codec == SectionCodec::Zstd {
            return Err(Error::format(tag, 4u8, "compressed as a whole, can't be read in parts"));
        }
        if offset.checked_add(length).is_none_or(|end| end > section.stored) {
            let stored = section.stored;
            return Err(Error::format(tag, offset, format!("{length} bytes asked for here, the section has {stored}")));
        }
        self.budget.charge("part of a section", length)?;
        self.read_at(section.offset + section.header_bytes() + offset, length)
    }
}

/// Where the directory begins in a file of `length` bytes that ends in `trailer`.
pub(super) fn directory_offset(trailer: &[u8], length: u64) -> Result<u64> {
    let trailer_at = length.checked_sub(TRAILER_BYTES as u64).filter(|at| *at >= FILE_HEADER_BYTES as u64);
    let Some((trailer_at, (directory_length, end_signature))) = trailer_at.zip(trailer.split_first_chunk::<4>()) else {
        return Err(Error::format(FilePart::File, length, "ends before its directory"));
    };
    if *end_signature != END_SIGNATURE {
        return Err(Error::format(
            FilePart::File,
            trailer_at + 4,
            "end signature missing: the file is cut or extended",
        ));
    }
    let directory_length = u32::from_le_bytes(*directory_length) as u64;
    let longest = 4 + 10 + MAX_SECTIONS * SECTION_HEADER_BYTES.end() + 4;
    let directory_at = trailer_at.checked_sub(directory_length).filter(|at| *at >= FILE_HEADER_BYTES as u64);
    directory_at.filter(|_| directory_length <= longest).ok_or_else(|| {
        Error::format(FilePart::File, trailer_at, format!("directory of {directory_length} bytes can't be"))
    })
}

/// Sections of a directory that stands at `directory_at`, tag and checksum included. They must fill the file up to it.
pub(super) fn parse_directory(head: &[u8], directory: &[u8], directory_at: u64) -> Result<Vec<Section>> {
    let wrong = |message: &str| Error::format(FilePart::Directory, directory_at, message);
    let Some((body, crc)) = directory.split_last_chunk::<4>() else { return Err(wrong("too short")) };
    let Some((tag, mut rest)) = body.split_first_chunk::<4>() else { return Err(wrong("too short")) };
    if *tag != DIRECTORY_TAG.0 {
        return Err(wrong("must begin with DRCT"));
    }
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(head);
    hasher.update(body);
    if hasher.finalize() != u32::from_le_bytes(*crc) {
        return Err(wrong("CRC-32 of file header and directory does not match"));
    }
    let mut next = || match rest.split_first() {
        Some((byte, tail)) => {
            rest = tail;
            Ok(*byte)
        }
        None => Err(wrong("ends within an entry")),
    };
    let count = read_number(DIRECTORY_TAG, &mut next)?;
    crate::limits::check("sections", count, MAX_SECTIONS)?;
    let mut sections: Vec<Section> = Vec::new();
    let mut offset = FILE_HEADER_BYTES as u64;
    for _ in 0..count {
        let tag = Tag([next()?, next()?, next()?, next()?]);
        let section = Section::parse(tag, offset, &mut next)?;
        section.check_repetition(&sections)?;
        offset = section.end().ok_or_else(|| wrong("lengths beyond 64 bits"))?;
        sections.push(section);
    }
    if !rest.is_empty() {
        return Err(wrong("bytes left after the last entry"));
    }
    if offset != directory_at {
        return Err(wrong("the sections do not fill the file up to the directory"));
    }
    Ok(sections)
}
