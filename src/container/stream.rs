//! Reading from start to end: streams, cut files, and the check of every byte.

use super::incremental::{CHUNK_BYTES, IncrementalReader, Poll};
use super::section::Section;
use crate::limits::{Budget, Limits};
use crate::{Error, Result};
use std::io::Read;
use std::sync::Arc;

/// Sections of a stream, one after the other; at the end the directory is compared with them. An [`IncrementalReader`] whose
/// ranges are read from the stream.
#[derive(Debug)]
pub struct SectionStream<R> {
    reader: IncrementalReader,
    source: R,
    /// Bytes read.
    position: u64,
}

impl<R: Read> SectionStream<R> {
    /// Reads signature and version.
    /// # Errors
    /// [`Error::Io`] of the source, [`Error::Format`] for what is not a `.tsuya` file, [`Error::Unsupported`] for another
    /// version.
    pub fn new(source: R, limits: Limits) -> Result<Self> {
        let reader = IncrementalReader::transient(None, false, limits);
        let mut stream = SectionStream { reader, source, position: 0 };
        stream.drive(IncrementalReader::file_header)?;
        Ok(stream)
    }

    /// Runs `step` until it is ready, reading on to the end of the ranges that it needs.
    fn drive<T>(&mut self, mut step: impl FnMut(&mut IncrementalReader) -> Result<Poll<T>>) -> Result<T> {
        loop {
            match step(&mut self.reader)? {
                Poll::Ready(value) => return Ok(value),
                Poll::NeedRanges(ranges) => {
                    let end = ranges.iter().map(|range| range.end).max().unwrap_or_default();
                    self.read_bytes(end.min(self.position + CHUNK_BYTES))?;
                }
            }
        }
    }

    fn read_bytes(&mut self, end: u64) -> Result<()> {
        let SectionStream { reader, source, position } = self;
        let mut got = 0;
        reader.feed_with(&(*position..end), |bytes| {
            got = source.take(end - *position).read_to_end(bytes).map_err(|error| Error::io("-", error))? as u64;
            Ok(())
        })?;
        *position += got;
        if *position < end {
            reader.set_length(*position);
        }
        Ok(())
    }

    /// Memory budget that the contents are charged to.
    pub fn budget(&self) -> Arc<Budget> {
        self.reader.budget()
    }
    /// Headers of the sections that were read so far.
    pub fn sections(&self) -> &[Section] {
        self.reader.sections().0
    }
    /// Reads the next section with its content; `None` behind the last one, when directory, trailer and the stream's end
    /// have been checked.
    /// # Errors
    /// [`Error::Io`] of the source, [`Error::Format`] if the stream is damaged or cut, [`Error::Limits`] if the memory budget
    /// is exceeded.
    pub fn next_section(&mut self) -> Result<Option<(Section, Vec<u8>)>> {
        self.drive(|reader| reader.next_section(true))
    }
}

/// Reads all sections of a whole stream with their contents.
/// # Errors
/// As [`SectionStream::next_section`].
pub fn read_stream(source: impl Read, limits: Limits) -> Result<Vec<(Section, Vec<u8>)>> {
    let mut stream = SectionStream::new(source, limits)?;
    let mut sections = Vec::new();
    while let Some(section) = stream.next_section()? {
        sections.push(section);
    }
    Ok(sections)
}

/// Whole sections of a file that may be cut or damaged.
#[derive(Debug)]
pub struct FilePrefix {
    /// The whole, undamaged sections before the damage.
    pub sections: Vec<(Section, Vec<u8>)>,
    /// Why it ends there; `None` when the file is whole.
    pub damage: Option<Error>,
}

/// Reads the whole sections of a file that may be cut.
/// # Errors
/// As [`SectionStream::new`]: only if not even the file's first bytes are right.
pub fn read_prefix(source: impl Read, limits: Limits) -> Result<FilePrefix> {
    let mut stream = SectionStream::new(source, limits)?;
    let mut sections = Vec::new();
    let damage = loop {
        match stream.next_section() {
            Ok(Some(section)) => sections.push(section),
            Ok(None) => break None,
            Err(error) => break Some(error),
        }
    };
    Ok(FilePrefix { sections, damage })
}

/// Checks every byte of a file: signature, version, headers, checksums, directory, trailer and length, and that what is
/// compressed decompresses. Contents are not decoded. Returns the sections.
/// # Errors
/// As [`SectionStream::next_section`].
pub fn verify(source: impl Read, limits: Limits) -> Result<Vec<Section>> {
    let mut stream = SectionStream::new(std::io::BufReader::new(source), limits)?;
    while let Some((_, content)) = stream.drive(|reader| reader.next_section(false))? {
        stream.budget().release(content.len() as u64);
    }
    Ok(stream.sections().to_vec())
}
