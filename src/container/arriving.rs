//! A file whose bytes arrive piece by piece, from its start or in ranges that were asked for.

use super::reader::{directory_offset, parse_directory};
use super::section::{Section, SectionCodec, directory_length};
use super::{
    DIRECTORY_TAG, FILE_HEADER_BYTES, MAX_SECTIONS, SECTION_HEADER_BYTES, TRAILER_BYTES, Tag, check_file_header,
};
use crate::error::FilePart;
use crate::limits::{Budget, Limits, check};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Something that is there, or the bytes of the file that it still takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Poll<T> {
    /// It is there.
    Ready(T),
    /// Ranges of the file, in bytes, that must arrive first; more may be needed once these are there. A range may end beyond the end of
    /// a file whose length is not known yet.
    NeedRanges(Vec<Range<u64>>),
}

/// Takes what is there out of an [`Poll`], or returns what is missing.
macro_rules! here {
    ($arrival:expr) => {
        match $arrival {
            $crate::container::Poll::Ready(value) => value,
            $crate::container::Poll::NeedRanges(ranges) => {
                return Ok($crate::container::Poll::NeedRanges(ranges));
            }
        }
    };
}
pub(crate) use here;

/// A file of which some bytes are there.
#[derive(Debug)]
pub struct IncrementalReader {
    /// Pieces by where they begin; they neither touch nor overlap.
    pieces: BTreeMap<u64, Vec<u8>>,
    length: Option<u64>,
    is_seekable: bool,
    head: Option<[u8; FILE_HEADER_BYTES]>,
    sections: Vec<Section>,
    is_complete: bool,
    budget: Arc<Budget>,
}

impl IncrementalReader {
    /// A file of which nothing is there yet. `is_seekable` says that any range can be asked for; then the directory is read, else the
    /// sections are found one after the other as they arrive.
    pub fn new(length: Option<u64>, is_seekable: bool, limits: Limits) -> Self {
        IncrementalReader {
            pieces: BTreeMap::new(),
            length,
            is_seekable,
            head: None,
            sections: Vec::new(),
            is_complete: false,
            budget: Arc::new(Budget::new(limits)),
        }
    }

    /// Takes bytes that have arrived; what was there before is left as it is.
    /// # Errors
    /// [`Error::Limits`] where the memory is not there; [`Error::Parameter`] for bytes beyond the file's length.
    pub fn feed(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        let end = offset.checked_add(bytes.len() as u64).filter(|end| self.length.is_none_or(|length| *end <= length));
        let Some(end) = end else {
            return Err(Error::parameter("bytes arrived beyond the end of the file"));
        };
        let mut at = offset;
        while at < end {
            if let Some((start, piece)) = self.pieces.range(..=at).next_back()
                && start + piece.len() as u64 > at
            {
                at = start + piece.len() as u64;
                continue;
            }
            let until = self.pieces.range(at..).next().map_or(end, |(start, _)| end.min(*start));
            let part = &bytes[(at - offset) as usize..(until - offset) as usize];
            self.budget.charge("bytes of the file", part.len() as u64)?;
            match self.pieces.range_mut(..at).next_back() {
                Some((start, piece)) if start + piece.len() as u64 == at => piece.extend_from_slice(part),
                _ => {
                    self.pieces.insert(at, part.to_vec());
                }
            }
            if let Some(next) = self.pieces.remove(&until)
                && let Some((_, piece)) = self.pieces.range_mut(..until).next_back()
            {
                piece.extend_from_slice(&next);
            }
            at = until;
        }
        Ok(())
    }

    /// Says where the file ends, when that is known at last.
    pub fn set_length(&mut self, length: u64) {
        self.length = Some(length);
    }
    /// Length of the file, where it is known.
    pub fn length(&self) -> Option<u64> {
        self.length
    }
    /// The account that everything is charged to.
    pub fn budget(&self) -> Arc<Budget> {
        self.budget.clone()
    }
    /// The sections that are known, in file order, and whether these are all.
    pub fn sections(&self) -> (&[Section], bool) {
        (&self.sections, self.is_complete)
    }

    /// The bytes of a range.
    /// # Errors
    /// [`Error::Format`] where the file ends before.
    pub fn bytes(&self, range: Range<u64>) -> Result<Poll<&[u8]>> {
        if let Some(length) = self.length.filter(|length| range.end > *length) {
            return Err(Error::format(FilePart::File, length, format!("ends early: byte {} is needed", range.end)));
        }
        if range.start >= range.end {
            return Ok(Poll::Ready(&[]));
        }
        let piece = self.pieces.range(..=range.start).next_back();
        let found = piece.and_then(|(start, piece)| {
            let skip = usize::try_from(range.start - start).ok()?;
            piece.get(skip..)?.get(..usize::try_from(range.end - range.start).ok()?)
        });
        Ok(match found {
            Some(bytes) => Poll::Ready(bytes),
            None => Poll::NeedRanges(self.missing_ranges(range)),
        })
    }

    /// Whether all of some ranges are there.
    pub fn require(&self, ranges: &[Range<u64>]) -> Result<Poll<()>> {
        let mut missing = Vec::new();
        for range in ranges {
            if let Poll::NeedRanges(gaps) = self.bytes(range.clone())? {
                missing.extend(gaps);
            }
        }
        Ok(if missing.is_empty() { Poll::Ready(()) } else { Poll::NeedRanges(missing) })
    }

    /// What of a range is not there.
    fn missing_ranges(&self, range: Range<u64>) -> Vec<Range<u64>> {
        let mut gaps = Vec::new();
        let mut at = range.start;
        let before = self.pieces.range(..=at).next_back().map(|(start, _)| *start).unwrap_or(at);
        for (start, piece) in self.pieces.range(before..range.end) {
            if *start > at {
                gaps.push(at..*start);
            }
            at = at.max(start + piece.len() as u64);
        }
        if at < range.end {
            gaps.push(at..range.end);
        }
        gaps
    }

    /// The first section with a tag, `None` where the file has none.
    pub fn find(&mut self, tag: Tag) -> Result<Poll<Option<Section>>> {
        loop {
            let found = self.sections.iter().find(|section| section.tag == tag).copied();
            if found.is_some() || self.is_complete {
                return Ok(Poll::Ready(found));
            }
            here!(self.advance()?);
        }
    }

    /// Learns of all sections from the directory, or else of one more.
    fn advance(&mut self) -> Result<Poll<()>> {
        let head = match self.head {
            Some(head) => head,
            None => {
                let bytes = here!(self.bytes(0..FILE_HEADER_BYTES as u64)?);
                let Some(head) = bytes.first_chunk().copied() else {
                    return Err(Error::format(FilePart::File, bytes.len(), "ends within its first 12 bytes"));
                };
                check_file_header(&head)?;
                self.head = Some(head);
                head
            }
        };
        match self.length.filter(|_| self.is_seekable) {
            Some(length) => self.read_directory(&head, length),
            None => self.read_next_header(&head),
        }
    }

    fn read_directory(&mut self, head: &[u8; FILE_HEADER_BYTES], length: u64) -> Result<Poll<()>> {
        let trailer_at = length.saturating_sub(TRAILER_BYTES as u64);
        let trailer = here!(self.bytes(trailer_at..length)?);
        let directory_at = directory_offset(trailer, length)?;
        let directory = here!(self.bytes(directory_at..trailer_at)?);
        self.budget.charge("directory", directory.len() as u64)?;
        self.sections = parse_directory(head, directory, directory_at)?;
        self.is_complete = true;
        Ok(Poll::Ready(()))
    }

    /// The header after the last known section; where the directory stands instead, it is read and compared.
    fn read_next_header(&mut self, head: &[u8; FILE_HEADER_BYTES]) -> Result<Poll<()>> {
        let offset = match self.sections.last() {
            Some(last) => last.end().ok_or_else(|| Error::format(last.tag, 5u8, "ends beyond 64 bits"))?,
            None => FILE_HEADER_BYTES as u64,
        };
        let longest =
            self.length.map_or(u64::MAX, |length| length.saturating_sub(offset)).min(*SECTION_HEADER_BYTES.end());
        let bytes = here!(self.bytes(offset..offset.saturating_add(longest.max(4)))?);
        let Some((tag, mut rest)) = bytes.split_first_chunk::<4>() else {
            return Err(Error::format(FilePart::File, offset, "ends early"));
        };
        if *tag == DIRECTORY_TAG.0 {
            let end = offset + directory_length(&self.sections);
            let directory = here!(self.bytes(offset..end)?);
            if parse_directory(head, directory, offset)? != self.sections {
                return Err(Error::format(FilePart::Directory, offset, "differs from the sections before it"));
            }
            self.is_complete = true;
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

    /// The content of the first section with a tag: checksum compared, decompressed. `None` where the file has none.
    pub fn content(&mut self, tag: Tag) -> Result<Poll<Option<Vec<u8>>>> {
        let Some(section) = here!(self.find(tag)?) else { return Ok(Poll::Ready(None)) };
        let stored = here!(self.stored(&section)?).to_vec();
        self.budget.charge("section", section.stored)?;
        Ok(Poll::Ready(Some(section.decode(stored, &self.budget)?)))
    }

    /// What is stored of a section: its header and checksum are compared.
    fn stored(&self, section: &Section) -> Result<Poll<&[u8]>> {
        let header = section.to_bytes();
        let end = section.offset + header.len() as u64 + section.stored;
        let (stored_header, stored) = here!(self.bytes(section.offset..end)?).split_at(header.len());
        if stored_header != header {
            return Err(Error::format(section.tag, 0u8, "header differs from the directory"));
        }
        let mut hasher = section.hasher();
        hasher.update(stored);
        section.check_crc(hasher)?;
        Ok(Poll::Ready(stored))
    }

    /// Compares the checksum of every section, and the directory.
    /// # Errors
    /// [`Error::Format`] for the first that does not match.
    pub fn verify(&mut self) -> Result<Poll<()>> {
        while !self.is_complete {
            here!(self.advance()?);
        }
        let sections = &self.sections;
        let directory_at = sections.last().map_or(Some(FILE_HEADER_BYTES as u64), Section::end).unwrap_or(u64::MAX);
        let length = directory_at.saturating_add(directory_length(sections) + TRAILER_BYTES as u64);
        here!(self.bytes(0..length)?);
        let trailer = here!(self.bytes(length - TRAILER_BYTES as u64..length)?);
        if directory_offset(trailer, length)? != directory_at {
            return Err(Error::format(FilePart::File, length - TRAILER_BYTES as u64, "trailer is wrong"));
        }
        if let Some(end) = self.length.filter(|end| *end != length) {
            return Err(Error::format(FilePart::File, length, format!("goes on after its end, up to byte {end}")));
        }
        for section in sections {
            here!(self.stored(section)?);
        }
        Ok(Poll::Ready(()))
    }

    /// Where in the file a part of a section lies that is not compressed as a whole.
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
