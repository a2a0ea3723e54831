//! Files of which any range can be read: only the bytes that are needed are.

use super::Tag;
use super::incremental::{IncrementalReader, Poll};
use super::section::Section;
use crate::limits::{Budget, Limits};
use crate::{Error, FilePart, Result};
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Open file with its directory: an [`IncrementalReader`] whose ranges are read from a seekable source.
#[derive(Debug)]
pub struct Container<R> {
    reader: IncrementalReader,
    source: R,
    path: PathBuf,
    length: u64,
    bytes_read: u64,
}

impl<'a> Container<Cursor<&'a [u8]>> {
    /// Opens a file in memory.
    /// # Errors
    /// As [`Container::open_seek`].
    pub fn open_slice(bytes: &'a [u8], limits: Limits) -> Result<Self> {
        Container::open_seek(Cursor::new(bytes), limits)
    }
}

impl Container<std::fs::File> {
    /// Opens a file on disk.
    /// # Errors
    /// As [`Container::open_seek`].
    pub fn open_path(path: impl AsRef<Path>, limits: Limits) -> Result<Self> {
        let path = path.as_ref();
        let (file, _) = crate::input::open(path)?;
        Container::open_named(file, path.to_owned(), limits)
    }
}

impl<R: Read + Seek> Container<R> {
    /// Opens a seekable source: reads its header, trailer and directory and checks that they fit its length.
    /// # Errors
    /// [`Error::Io`] of the source, [`Error::Format`] for a file that is damaged there or not a `.tsuya` file,
    /// [`Error::Unsupported`] for another version, [`Error::Limits`] for too many sections.
    pub fn open_seek(source: R, limits: Limits) -> Result<Self> {
        Self::open_named(source, PathBuf::from("-"), limits)
    }

    fn open_named(mut source: R, path: PathBuf, limits: Limits) -> Result<Self> {
        let length = source.seek(SeekFrom::End(0)).map_err(|e| Error::io(&path, e))?;
        let reader = IncrementalReader::transient(Some(length), true, limits);
        let mut container = Container { reader, source, path, length, bytes_read: 0 };
        container.drive(IncrementalReader::read_sections)?;
        Ok(container)
    }

    /// Runs `step` until it is ready, reading the ranges that it needs.
    pub(crate) fn drive<T>(&mut self, mut step: impl FnMut(&mut IncrementalReader) -> Result<Poll<T>>) -> Result<T> {
        loop {
            match step(&mut self.reader)? {
                Poll::Ready(value) => return Ok(value),
                Poll::NeedRanges(ranges) => ranges.iter().try_for_each(|range| self.read_bytes(range))?,
            }
        }
    }

    fn read_bytes(&mut self, range: &Range<u64>) -> Result<()> {
        let Container { reader, source, path, bytes_read, .. } = self;
        reader.feed_with(range, |bytes| {
            let failed = |e| Error::io(&*path, e);
            source.seek(SeekFrom::Start(range.start)).map_err(failed)?;
            let got = source.by_ref().take(range.end - range.start).read_to_end(bytes).map_err(failed)? as u64;
            *bytes_read += got;
            if got != range.end - range.start {
                return Err(Error::format(FilePart::File, range.start + got, "ends early"));
            }
            Ok(())
        })
    }

    /// All sections in file order.
    pub fn sections(&self) -> &[Section] {
        self.reader.sections().0
    }
    /// Finds the first section with a tag.
    pub fn find(&self, tag: Tag) -> Option<&Section> {
        self.sections().iter().find(|section| section.tag == tag)
    }
    /// Memory budget that everything read is charged to.
    pub fn budget(&self) -> Arc<Budget> {
        self.reader.budget()
    }
    /// Bytes read from the source so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read
    }
    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.length
    }

    fn required(&self, tag: Tag) -> Result<Section> {
        self.find(tag).copied().ok_or_else(|| super::missing_section(tag))
    }

    /// Reads the content of the first section with a tag: checksum compared, decompressed.
    /// # Errors
    /// [`Error::Format`] if there is none or it is damaged, [`Error::Limits`] if the memory budget is exceeded.
    pub fn read_section(&mut self, tag: Tag) -> Result<Vec<u8>> {
        let section = self.required(tag)?;
        self.read_content(&section)
    }
    /// Reads the content of that section; `None` if the file has none.
    /// # Errors
    /// As [`Container::read_section`].
    pub fn read_optional(&mut self, tag: Tag) -> Result<Option<Vec<u8>>> {
        self.drive(|reader| reader.content(tag))
    }
    /// Reads the content of one of the [`Container::sections`].
    /// # Errors
    /// As [`Container::read_section`].
    pub fn read_content(&mut self, section: &Section) -> Result<Vec<u8>> {
        self.drive(|reader| reader.section_content(section))
    }

    /// Reads a part of a section that is not compressed as a whole. The section's checksum is not compared: formats that are
    /// read in parts carry checksums of their own.
    /// # Errors
    /// [`Error::Format`] if the section is missing, compressed or shorter, [`Error::Limits`] if the memory budget is exceeded.
    pub fn read_range(&mut self, tag: Tag, offset: u64, length: u64) -> Result<Vec<u8>> {
        let section = self.required(tag)?;
        let range = self.reader.file_range(&section, offset..offset.saturating_add(length))?;
        self.drive(|reader| reader.take(range.clone()))
    }
}
