//! Incremental reading: bytes are fed in any order, and what can't be computed yet names the ranges that it needs.
//!
//! This is the only reader of the file's structure. [`Container`](super::Container) answers the ranges by reading a seekable
//! source, [`SectionStream`](super::SectionStream) by reading on; the browser by fetching them.

use super::pieces::FilePieces;
use super::section::{Section, SectionCodec};
use super::{
    DIRECTORY_TAG, FILE_HEADER_BYTES, MAX_SECTIONS, SECTION_HEADER_BYTES, TRAILER_BYTES, Tag, check_file_header,
    directory,
};
use crate::limits::{Budget, Limits, check};
use crate::{Error, FilePart, Result};
use std::ops::Range;
use std::sync::Arc;

/// Bytes of a section that are asked for at once by [`IncrementalReader::next_section`], so that memory grows with what
/// arrives.
pub(super) const CHUNK_BYTES: u64 = 1 << 16;

/// Either a value, or the byte ranges that must be fed before it can be computed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Poll<T> {
    /// The value.
    Ready(T),
    /// Ranges of the file, in bytes, that must be fed first; more may be needed after these. A range may end beyond the end
    /// of a file whose length is not known yet.
    NeedRanges(Vec<Range<u64>>),
}

/// Takes the value out of a [`Poll`], or returns the ranges it needs.
macro_rules! ready {
    ($poll:expr) => {
        match $poll {
            $crate::container::Poll::Ready(value) => value,
            $crate::container::Poll::NeedRanges(ranges) => {
                return Ok($crate::container::Poll::NeedRanges(ranges));
            }
        }
    };
}
pub(crate) use ready;

/// Reader of a file of which some bytes are there.
#[derive(Debug)]
pub struct IncrementalReader {
    pieces: FilePieces,
    length: Option<u64>,
    is_seekable: bool,
    /// Whether bytes stay after they were used.
    retains: bool,
    file_header: Option<[u8; FILE_HEADER_BYTES]>,
    sections: Vec<Section>,
    /// Whether `sections` are all: the directory has been read.
    is_complete: bool,
    /// Section that [`IncrementalReader::next_section`] is within.
    current: Option<PartialSection>,
    budget: Arc<Budget>,
}

/// Section of which only the beginning has been read.
#[derive(Debug)]
struct PartialSection {
    section: Section,
    hasher: crc32fast::Hasher,
    /// Offset of the next byte in the file.
    position: u64,
    stored: Vec<u8>,
}

impl IncrementalReader {
    /// Creates a reader of a file of which nothing is there yet. `is_seekable` states that any range can be asked for; then
    /// the directory is read, otherwise the sections are found one after the other as they arrive.
    pub fn new(length: Option<u64>, is_seekable: bool, limits: Limits) -> Self {
        IncrementalReader {
            pieces: FilePieces::default(),
            length,
            is_seekable,
            retains: true,
            file_header: None,
            sections: Vec::new(),
            is_complete: false,
            current: None,
            budget: Arc::new(Budget::new(limits)),
        }
    }

    /// Creates a reader that frees bytes once they were used; they must be fed again to be used again.
    pub(super) fn transient(length: Option<u64>, is_seekable: bool, limits: Limits) -> Self {
        IncrementalReader { retains: false, ..IncrementalReader::new(length, is_seekable, limits) }
    }

    /// Feeds bytes of the file; those that are there already are left as they are.
    /// # Errors
    /// [`Error::Limits`] if the memory budget is exceeded; [`Error::Parameter`] for bytes beyond the file's length.
    pub fn feed(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        let end = offset.checked_add(bytes.len() as u64).filter(|end| self.length.is_none_or(|length| *end <= length));
        let Some(end) = end else {
            return Err(Error::parameter("bytes arrived beyond the end of the file"));
        };
        for missing in self.pieces.missing_ranges(offset..end) {
            let part = &bytes[(missing.start - offset) as usize..(missing.end - offset) as usize];
            self.budget.charge("bytes of the file", part.len() as u64)?;
            self.pieces.insert(missing.start, part.to_vec());
        }
        Ok(())
    }

    /// Feeds a missing range that `read` appends to an empty buffer, whose memory is charged and reserved before.
    /// # Errors
    /// [`Error::Limits`] if the memory is not available; those of `read`.
    pub(super) fn feed_with(
        &mut self,
        range: &Range<u64>,
        read: impl FnOnce(&mut Vec<u8>) -> Result<()>,
    ) -> Result<()> {
        let length = range.end - range.start;
        self.budget.charge("bytes of the file", length)?;
        let mut bytes = Vec::new();
        let reserved = usize::try_from(length).ok().and_then(|length| bytes.try_reserve_exact(length).ok());
        reserved.ok_or(Error::Limits { what: "bytes of the file", requested: length, allowed: 0 })?;
        read(&mut bytes)?;
        self.budget.release(length.saturating_sub(bytes.len() as u64));
        if !bytes.is_empty() {
            self.pieces.insert(range.start, bytes);
        }
        Ok(())
    }

    /// Sets the length of a file that was begun without one.
    pub fn set_length(&mut self, length: u64) {
        self.length = Some(length);
    }
    /// Length of the file if it is known.
    pub fn length(&self) -> Option<u64> {
        self.length
    }
    /// Memory budget that everything is charged to.
    pub fn budget(&self) -> Arc<Budget> {
        self.budget.clone()
    }
    /// Sections known so far, in file order, and whether these are all.
    pub fn sections(&self) -> (&[Section], bool) {
        (&self.sections, self.is_complete)
    }

    /// Returns the bytes of a range.
    /// # Errors
    /// [`Error::Format`] if the file ends before the range does.
    pub fn bytes(&self, range: Range<u64>) -> Result<Poll<&[u8]>> {
        if let Some(length) = self.length.filter(|length| range.end > *length) {
            return Err(Error::format(FilePart::File, length, format!("ends early: byte {} is needed", range.end)));
        }
        if range.start >= range.end {
            return Ok(Poll::Ready(&[]));
        }
        Ok(match self.pieces.get(&range) {
            Some(bytes) => Poll::Ready(bytes),
            None => Poll::NeedRanges(self.pieces.missing_ranges(range)),
        })
    }

    /// Returns whether all of some ranges are there.
    /// # Errors
    /// As [`IncrementalReader::bytes`].
    pub fn require(&self, ranges: &[Range<u64>]) -> Result<Poll<()>> {
        let mut missing = Vec::new();
        for range in ranges {
            if let Poll::NeedRanges(ranges) = self.bytes(range.clone())? {
                missing.extend(ranges);
            }
        }
        Ok(if missing.is_empty() { Poll::Ready(()) } else { Poll::NeedRanges(missing) })
    }

    /// Returns the bytes of a range for the caller to own and keep charged. A reader that retains its bytes copies them.
    /// # Errors
    /// As [`IncrementalReader::bytes`]; [`Error::Limits`] if there is no memory for the copy.
    pub(crate) fn take(&mut self, range: Range<u64>) -> Result<Poll<Vec<u8>>> {
        let bytes = ready!(self.bytes(range.clone())?);
        if self.retains {
            self.budget.charge("section", bytes.len() as u64)?;
            return Ok(Poll::Ready(bytes.to_vec()));
        }
        Ok(Poll::Ready(self.pieces.take(&range).unwrap_or_default()))
    }

    /// Frees bytes that were used, unless the reader retains its bytes.
    pub(crate) fn discard(&mut self, range: Range<u64>) {
        if !self.retains {
            self.budget.release(self.pieces.discard(&range));
        }
    }

    /// Checks signature and version.
    pub(super) fn file_header(&mut self) -> Result<Poll<[u8; FILE_HEADER_BYTES]>> {
        if let Some(header) = self.file_header {
            return Ok(Poll::Ready(header));
        }
        let range = 0..FILE_HEADER_BYTES as u64;
        if let Some(length) = self.length.filter(|length| *length < range.end) {
            return Err(Error::format(FilePart::File, length, "ends within its first 12 bytes"));
        }
        let mut header = [0; FILE_HEADER_BYTES];
        header.copy_from_slice(ready!(self.bytes(range.clone())?));
        check_file_header(&header)?;
        self.file_header = Some(header);
        self.discard(range);
        Ok(Poll::Ready(header))
    }

    /// Finds all sections.
    pub(super) fn read_sections(&mut self) -> Result<Poll<()>> {
        while !self.is_complete {
            ready!(self.advance()?);
        }
        Ok(Poll::Ready(()))
    }

    /// Finds the first section with a tag; `None` if the file has none.
    pub fn find(&mut self, tag: Tag) -> Result<Poll<Option<Section>>> {
        loop {
            let found = self.sections.iter().find(|section| section.tag == tag).copied();
            if found.is_some() || self.is_complete {
                return Ok(Poll::Ready(found));
            }
            ready!(self.advance()?);
        }
    }

    /// Finds all sections by the directory, or else one more.
    fn advance(&mut self) -> Result<Poll<()>> {
        let file_header = ready!(self.file_header()?);
        match self.length.filter(|_| self.is_seekable) {
            Some(length) => self.read_directory(&file_header, length),
            None => self.read_next_header(&file_header),
        }
    }

    fn read_directory(&mut self, file_header: &[u8; FILE_HEADER_BYTES], length: u64) -> Result<Poll<()>> {
        let trailer_at = length.saturating_sub(TRAILER_BYTES as u64);
        let directory_at = directory::offset(ready!(self.bytes(trailer_at..length)?), length)?;
        let bytes = ready!(self.bytes(directory_at..trailer_at)?);
        self.budget.charge("directory", bytes.len() as u64)?;
        self.sections = directory::parse(file_header, bytes, directory_at)?;
        self.is_complete = true;
        self.discard(directory_at..length);
        Ok(Poll::Ready(()))
    }

    /// Reads the header after the last known section; if the directory stands there, it is read and compared.
    fn read_next_header(&mut self, file_header: &[u8; FILE_HEADER_BYTES]) -> Result<Poll<()>> {
        let offset = self.sections_end()?;
        let available = self.length.map_or(u64::MAX, |length| length.saturating_sub(offset));
        let header_bytes = available.min(*SECTION_HEADER_BYTES.end()).max(4);
        let bytes = ready!(self.bytes(offset..offset.saturating_add(header_bytes))?);
        let Some((tag, mut rest)) = bytes.split_first_chunk::<4>() else {
            return Err(Error::format(FilePart::File, offset, "ends early"));
        };
        if *tag == DIRECTORY_TAG.0 {
            let end = offset + directory::length(&self.sections);
            let bytes = ready!(self.bytes(offset..end)?);
            if directory::parse(file_header, bytes, offset)? != self.sections {
                return Err(Error::format(FilePart::Directory, offset, "differs from the sections before it"));
            }
            self.is_complete = true;
            self.discard(offset..end);
            return Ok(Poll::Ready(()));
        }
        check("sections", self.sections.len() as u64 + 1, MAX_SECTIONS)?;
        let section = Section::parse(Tag(*tag), offset, || match rest.split_first() {
            Some((byte, tail)) => {
                rest = tail;
                Ok(*byte)
            }
            None => Err(Error::format(FilePart::File, offset, "ends within a section's header")),
        })?;
        section.check_repetition(&self.sections)?;
        self.sections.push(section);
        Ok(Poll::Ready(()))
    }

    /// Offset behind the last known section.
    fn sections_end(&self) -> Result<u64> {
        match self.sections.last() {
            Some(last) => last.end().ok_or_else(|| Error::format(last.tag, 5u8, "ends beyond 64 bits")),
            None => Ok(FILE_HEADER_BYTES as u64),
        }
    }

    /// Returns the content of the first section with a tag, its checksum compared and decompressed; `None` if the file has
    /// none. Its bytes stay charged to the budget.
    pub fn content(&mut self, tag: Tag) -> Result<Poll<Option<Vec<u8>>>> {
        let Some(section) = ready!(self.find(tag)?) else { return Ok(Poll::Ready(None)) };
        Ok(Poll::Ready(Some(ready!(self.section_content(&section)?))))
    }

    /// Returns the content of a section of this file, as [`IncrementalReader::content`].
    pub(super) fn section_content(&mut self, section: &Section) -> Result<Poll<Vec<u8>>> {
        ready!(self.checked_content(section)?);
        let start = section.offset + section.header_bytes();
        self.discard(section.offset..start);
        let stored = ready!(self.take(start..start + section.stored)?);
        Ok(Poll::Ready(section.decode(stored, &self.budget)?))
    }

    /// Returns the stored bytes of a section, its header and checksum compared.
    fn checked_content(&self, section: &Section) -> Result<Poll<&[u8]>> {
        let header = section.to_bytes();
        let end = section.offset + header.len() as u64 + section.stored;
        let (stored_header, stored) = ready!(self.bytes(section.offset..end)?).split_at(header.len());
        if stored_header != header {
            return Err(Error::format(section.tag, 0u8, "header differs from the directory"));
        }
        let mut hasher = section.hasher();
        hasher.update(stored);
        section.check_crc(hasher)?;
        Ok(Poll::Ready(stored))
    }

    /// Returns the next section of a file that is read from its start, with its content; `None` behind the last one, when
    /// directory, trailer and length of the file have been checked. Unless `keep`, contents that are not compressed are only
    /// checked and come empty.
    pub(super) fn next_section(&mut self, keep: bool) -> Result<Poll<Option<(Section, Vec<u8>)>>> {
        if self.current.is_none() {
            let file_header = ready!(self.file_header()?);
            if !self.is_complete {
                ready!(self.read_next_header(&file_header)?);
            }
            if self.is_complete {
                ready!(self.check_end(true)?);
                return Ok(Poll::Ready(None));
            }
            let Some(&section) = self.sections.last() else { return Ok(Poll::Ready(None)) };
            let position = section.offset + section.header_bytes();
            self.discard(section.offset..position);
            self.current = Some(PartialSection { section, hasher: section.hasher(), position, stored: Vec::new() });
        }
        let Some(mut current) = self.current.take() else { return Ok(Poll::Ready(None)) };
        let keep = keep || current.section.codec == SectionCodec::Zstd;
        let end = self.sections_end()?;
        while current.position < end {
            let part = current.position..end.min(current.position + CHUNK_BYTES);
            let bytes = match self.bytes(part.clone())? {
                Poll::Ready(bytes) => bytes,
                Poll::NeedRanges(ranges) => {
                    self.current = Some(current);
                    return Ok(Poll::NeedRanges(ranges));
                }
            };
            current.hasher.update(bytes);
            if keep {
                self.budget.charge("section", bytes.len() as u64)?;
                current.stored.extend_from_slice(bytes);
            }
            current.position = part.end;
            self.discard(part);
        }
        let PartialSection { section, hasher, stored, .. } = current;
        section.check_crc(hasher)?;
        let content = if keep { section.decode(stored, &self.budget)? } else { stored };
        Ok(Poll::Ready(Some((section, content))))
    }

    /// Checks the trailer and that the file ends with it. A file whose length is not known ends there if no byte follows,
    /// which `asks_beyond` asks for.
    fn check_end(&self, asks_beyond: bool) -> Result<Poll<()>> {
        let directory_at = self.sections_end()?;
        let trailer_at = directory_at.saturating_add(directory::length(&self.sections));
        let end = trailer_at.saturating_add(TRAILER_BYTES as u64);
        let trailer = ready!(self.bytes(trailer_at..end)?);
        if *trailer != directory::trailer((trailer_at - directory_at) as u32) {
            return Err(Error::format(FilePart::File, trailer_at, "trailer is wrong"));
        }
        match self.length {
            Some(length) if length == end => {}
            Some(length) => {
                return Err(Error::format(FilePart::File, end, format!("goes on after its end, up to byte {length}")));
            }
            None if asks_beyond => {
                ready!(self.bytes(end..end + 1)?);
                return Err(Error::format(FilePart::File, end, "goes on after its end"));
            }
            None => {}
        }
        Ok(Poll::Ready(()))
    }

    /// Compares the checksum of every section, the directory and the trailer.
    /// # Errors
    /// [`Error::Format`] for the first that does not match.
    pub fn verify(&mut self) -> Result<Poll<()>> {
        ready!(self.read_sections()?);
        let directory_at = self.sections_end()?;
        ready!(self.bytes(0..directory_at + directory::length(&self.sections) + TRAILER_BYTES as u64)?);
        ready!(self.check_end(false)?);
        for section in &self.sections {
            ready!(self.checked_content(section)?);
        }
        Ok(Poll::Ready(()))
    }

    /// Returns the range of the file in which a part of a section lies that is not compressed as a whole.
    /// # Errors
    /// [`Error::Format`] if the section is compressed or shorter.
    pub fn file_range(&self, section: &Section, part: Range<u64>) -> Result<Range<u64>> {
        if section.codec == SectionCodec::Zstd {
            return Err(Error::format(section.tag, 4u8, "compressed as a whole, can't be read in parts"));
        }
        if part.start > part.end || part.end > section.stored {
            let stored = section.stored;
            let message = format!("bytes up to {} asked for, the section has {stored}", part.end);
            return Err(Error::format(section.tag, part.start, message));
        }
        let start = section.offset + section.header_bytes();
        Ok(start + part.start..start + part.end)
    }
}
