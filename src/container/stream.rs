//! Reading from start to end: streams, cut files, and the check of every byte.

use super::reader::parse_directory;
use super::section::{Section, SectionCodec};
use super::{DIRECTORY_TAG, END_SIGNATURE, FILE_HEADER_BYTES, MAX_SECTIONS, TRAILER_BYTES, Tag, check_file_header};
use crate::error::FilePart;
use crate::limits::{Budget, Limits};
use crate::{Error, Result};
use std::io::Read;
use std::sync::Arc;

/// Largest step in which a section's bytes are taken from a stream, so that memory grows with what arrives.
const CHUNK_BYTES: u64 = 1 << 16;

/// Sections of a stream, one after the other. At the end the directory is compared with what came.
#[derive(Debug)]
pub struct SectionStream<R> {
    source: R,
    head: [u8; FILE_HEADER_BYTES],
    sections: Vec<Section>,
    budget: Arc<Budget>,
    offset: u64,
    finished: bool,
}

impl<R: Read> SectionStream<R> {
    /// Reads signature and version.
    pub fn new(source: R, limits: Limits) -> Result<Self> {
        let budget = Arc::new(Budget::new(limits));
        let head = [0; FILE_HEADER_BYTES];
        let mut stream = SectionStream { source, head, sections: Vec::new(), budget, offset: 0, finished: false };
        let mut head = [0; FILE_HEADER_BYTES];
        stream.fill(&mut head)?;
        check_file_header(&head)?;
        stream.head = head;
        Ok(stream)
    }
    /// The only place where bytes are taken.
    fn fill(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.source.read_exact(bytes).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => Error::format(FilePart::File, self.offset, "ends early"),
            _ => Error::io("-", error),
        })?;
        self.offset += bytes.len() as u64;
        Ok(())
    }
    /// The account that the contents are charged to.
    pub fn budget(&self) -> Arc<Budget> {
        self.budget.clone()
    }
    /// Headers of the sections that came so far.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }
    /// The next section with its content; `None` after the last one, when directory and trailer were right.
    pub fn next_section(&mut self) -> Result<Option<(Section, Vec<u8>)>> {
        self.advance(true)
    }

    /// With `keep` false contents that are not compressed are only checked.
    fn advance(&mut self, keep: bool) -> Result<Option<(Section, Vec<u8>)>> {
        if self.finished {
            return Ok(None);
        }
        let offset = self.offset;
        let mut tag = [0; 4];
        self.fill(&mut tag)?;
        if tag == DIRECTORY_TAG.0 {
            self.directory()?;
            self.finished = true;
            return Ok(None);
        }
        crate::limits::check("sections", self.sections.len() as u64 + 1, MAX_SECTIONS)?;
        let section = Section::parse(Tag(tag), offset, || {
            let mut byte = [0];
            self.fill(&mut byte)?;
            Ok(byte[0])
        })?;
        section.check_repetition(&self.sections)?;
        let keep = keep || section.codec == SectionCodec::Zstd;
        let mut hasher = section.hasher();
        let mut stored = Vec::new();
        let mut chunk = vec![0; section.stored.min(CHUNK_BYTES) as usize];
        let mut left = section.stored;
        while left > 0 {
            let step = left.min(CHUNK_BYTES) as usize;
            let part = &mut chunk[..step];
            self.fill(part)?;
            hasher.update(part);
            if keep {
                self.budget.charge("section", step as u64)?;
                stored.extend_from_slice(part);
            }
            left -= step as u64;
        }
        section.check_crc(hasher)?;
        let content = section.decode(stored, &self.budget)?;
        self.sections.push(section);
        Ok(Some((section, content)))
    }

    /// Directory after its tag, trailer and end of file.
    fn directory(&mut self) -> Result<()> {
        let directory_at = self.offset - 4;
        // What the directory must be follows from what came; it is read at that length and compared.
        let mut expected = DIRECTORY_TAG.0.to_vec();
        super::section::push_number(&mut expected, self.sections.len() as u64);
        for section in &self.sections {
            expected.extend_from_slice(&section.to_bytes());
        }
        let mut directory = vec![0; expected.len() + 4];
        directory[..4].copy_from_slice(&DIRECTORY_TAG.0);
        self.fill(&mut directory[4..])?;
        if directory[..expected.len()] != expected[..] {
            return Err(Error::format(FilePart::Directory, directory_at, "differs from the sections before it"));
        }
        parse_directory(&self.head, &directory, directory_at)?;
        let mut trailer = [0; TRAILER_BYTES];
        self.fill(&mut trailer)?;
        if trailer[..4] != (directory.len() as u32).to_le_bytes() || trailer[4..] != END_SIGNATURE {
            return Err(Error::format(FilePart::File, self.offset - TRAILER_BYTES as u64, "trailer is wrong"));
        }
        match self.source.read(&mut [0]) {
            Ok(0) => Ok(()),
            Ok(_) => Err(Error::format(FilePart::File, self.offset, "goes on after its end")),
            Err(error) => Err(Error::io("-", error)),
        }
    }
}

/// All sections of a whole stream with their contents.
pub fn read_stream(source: impl Read, limits: Limits) -> Result<Vec<(Section, Vec<u8>)>> {
    let mut stream = SectionStream::new(source, limits)?;
    let mut sections = Vec::new();
    while let Some(section) = stream.next_section()? {
        sections.push(section);
    }
    Ok(sections)
}

/// What could be saved of a file that may be cut or damaged.
#[derive(Debug)]
pub struct FilePrefix {
    /// The whole, undamaged sections before the damage.
    pub sections: Vec<(Section, Vec<u8>)>,
    /// Why it ends there; `None` when the file is whole.
    pub damage: Option<Error>,
}

/// The whole sections of a file that may be cut. An error only where not even the file's head is right.
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
pub fn verify(source: impl Read, limits: Limits) -> Result<Vec<Section>> {
    let mut stream = SectionStream::new(std::io::BufReader::new(source), limits)?;
    while let Some((_, content)) = stream.advance(false)? {
        stream.budget.release(content.len() as u64);
    }
    Ok(stream.sections)
}
