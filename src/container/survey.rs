//! Survey of a damaged file: its whole sections, and where the rest may be.
//!
//! Sections are looked for by their headers wherever these are, and by the directory where that is whole; a section counts as whole
//! only when its checksum is right.

use super::section::{Section, read_number};
use super::{
    DIRECTORY_TAG, FILE_HEADER_BYTES, MAX_SECTIONS, SIGNATURE, Tag, check_file_header, directory, file_header,
    known_rule,
};
use crate::{Error, FilePart, Result};
use byteorder::{ByteOrder, LittleEndian};
use std::ops::Range;

/// Most bytes that are read for checksums, as a multiple of the file's.
const MAX_WORK: u64 = 16;

/// Sections found in a damaged file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Survey {
    /// Sections whose checksums are right, in file order; `offset` is where their headers are or would be.
    pub whole: Vec<WholeSection>,
    /// Sections that are not whole, with the bytes of the file that may hold what is left of their contents.
    pub damaged: Vec<(Section, Range<usize>)>,
    /// Ranges of the file between the sections found, longest first.
    pub unexplained: Vec<Range<usize>>,
    /// Whether no section can have been overlooked: the directory is whole, or begins after the last section that was found.
    pub is_all_known: bool,
    /// Faults of the bytes around the sections, one sentence each.
    pub faults: Vec<String>,
}

/// A whole section.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WholeSection {
    /// Its header.
    pub section: Section,
    /// Range of its stored bytes in the file.
    pub stored: Range<usize>,
}

/// Finds all sections of a file.
/// # Errors
/// [`Error::Unsupported`] for the head of another version.
pub(crate) fn survey(bytes: &[u8]) -> Result<Survey> {
    let mut faults = Vec::new();
    let directory = find_directory(bytes);
    match bytes.first_chunk::<FILE_HEADER_BYTES>() {
        Some(head) if *head == file_header() => {}
        // The directory's checksum tells another version from a damaged head.
        Some(head) if head[..8] == SIGNATURE && directory.is_none() => check_file_header(head)?,
        _ => match (0..bytes.len()).find(|&at| bytes[at..].starts_with(&file_header())) {
            Some(before) => faults.push(format!("{before} bytes of something else stand before the file")),
            None => faults.push("the signature is damaged".to_owned()),
        },
    }
    let is_at_end =
        directory.as_ref().is_some_and(|(_, range)| bytes[range.end..] == directory::trailer(range.len() as u32));
    match &directory {
        None => faults.push("the directory is missing or damaged".into()),
        Some(_) if !is_at_end => faults.push("the end of the file is damaged".into()),
        Some(_) => {}
    }
    let mut search = SectionSearch { bytes, work: 0, whole: Vec::new(), headers: Vec::new() };
    let stated = directory.as_ref().map(|(sections, _)| &sections[..]);
    search.scan(stated.unwrap_or_default());
    let mut damaged = Vec::new();
    if let Some(sections) = stated {
        search.find_stated(sections);
    }
    search.whole.sort_by_key(|whole| whole.stored.start);
    let end = directory.as_ref().map_or(bytes.len(), |(_, range)| range.start);
    let lost: Vec<Section> = match stated {
        Some(sections) => sections.iter().filter(|section| !search.has(section)).copied().collect(),
        None => search
            .headers
            .iter()
            .filter(|header| !search.whole.iter().any(|w| w.section.tag == header.tag))
            .copied()
            .collect(),
    };
    for section in lost {
        if damaged.iter().any(|(other, _): &(Section, _)| other.tag == section.tag) {
            continue;
        }
        let header = search.headers.iter().find(|header| header.tag == section.tag);
        let start = header.map_or_else(|| search.likely_start(&section, stated), content_start);
        let start = start.min(end);
        let next = search.whole.iter().map(|whole| whole.section.offset as usize).filter(|at| *at >= start).min();
        damaged.push((section, start..next.unwrap_or(end).max(start)));
    }
    let last = search.whole.iter().map(|whole| whole.stored.end).max().unwrap_or(0);
    let is_all_known = directory.is_some() || damaged.is_empty() && bytes[last..].starts_with(&DIRECTORY_TAG.0);
    if !is_all_known {
        faults.push(format!("sections that stood after byte {last} can't be known"));
    }
    let unexplained = search.gaps(directory.as_ref().map(|(_, range)| range.clone()));
    Ok(Survey { whole: search.whole, damaged, unexplained, is_all_known, faults })
}

/// Undoes a transfer in text mode that put a carriage return before every line feed; `None` where none did.
pub(crate) fn without_carriage_returns(bytes: &[u8]) -> Option<Vec<u8>> {
    // The signature E8 TSY 0D 0A 1A 0A after such a transfer.
    if !bytes.starts_with(&[0xe8, b'T', b'S', b'Y', b'\r', b'\r', b'\n', 0x1a, b'\r', b'\n']) {
        return None;
    }
    let mut out = Vec::with_capacity(bytes.len());
    for &byte in bytes {
        if byte == b'\n' && out.last() == Some(&b'\r') {
            out.pop();
        }
        out.push(byte);
    }
    Some(out)
}

fn content_start(header: &Section) -> usize {
    (header.offset + header.header_bytes()) as usize
}

/// Finds the directory, wherever it is: its entries and its bytes from tag to checksum.
fn find_directory(bytes: &[u8]) -> Option<(Vec<Section>, Range<usize>)> {
    let starts = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(&DIRECTORY_TAG.0));
    starts.rev().find_map(|at| {
        let mut position = at + 4;
        let mut next = || {
            let byte =
                bytes.get(position).copied().ok_or_else(|| Error::format(FilePart::Directory, at, "ends early"))?;
            position += 1;
            Ok(byte)
        };
        let count = read_number(DIRECTORY_TAG, &mut next).ok().filter(|count| *count <= MAX_SECTIONS)?;
        let mut sections: Vec<Section> = Vec::new();
        let mut offset = FILE_HEADER_BYTES as u64;
        for _ in 0..count {
            let tag = Tag([next().ok()?, next().ok()?, next().ok()?, next().ok()?]);
            let section = Section::parse(tag, offset, &mut next).ok()?;
            section.check_repetition(&sections).ok()?;
            offset = section.end()?;
            sections.push(section);
        }
        let checksum = bytes.get(position..position + 4)?;
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&file_header());
        hasher.update(&bytes[at..position]);
        (hasher.finalize() == LittleEndian::read_u32(checksum)).then_some((sections, at..position + 4))
    })
}

struct SectionSearch<'a> {
    bytes: &'a [u8],
    /// Bytes that went into checksums.
    work: u64,
    whole: Vec<WholeSection>,
    /// Headers that look right before contents that are not whole.
    headers: Vec<Section>,
}

impl SectionSearch<'_> {
    /// Whether the bytes from `start` on are the section's.
    fn is_content(&mut self, section: &Section, start: usize) -> bool {
        let stored =
            usize::try_from(section.stored).ok().and_then(|stored| self.bytes.get(start..start.checked_add(stored)?));
        let Some(stored) = stored.filter(|_| self.work <= MAX_WORK * self.bytes.len() as u64) else { return false };
        self.work += stored.len() as u64;
        let mut hasher = section.hasher();
        hasher.update(stored);
        section.check_crc(hasher).is_ok()
    }

    fn has(&self, stated: &Section) -> bool {
        let same = |a: &Section, b: &Section| {
            (a.tag, a.codec, a.stored, a.decoded, a.crc) == (b.tag, b.codec, b.stored, b.decoded, b.crc)
        };
        self.whole.iter().any(|whole| same(&whole.section, stated))
    }

    fn add(&mut self, section: Section, start: usize) {
        let tag_may_repeat = super::section_rule(section.tag).repeats;
        if tag_may_repeat || !self.whole.iter().any(|whole| whole.section.tag == section.tag) {
            self.whole.push(WholeSection { section, stored: start..start + section.stored as usize });
        }
    }

    /// Finds headers: of known tags everywhere, of others where a section should begin.
    fn scan(&mut self, stated: &[Section]) {
        let mut at = 0;
        let mut expected = FILE_HEADER_BYTES;
        while at + 4 <= self.bytes.len() {
            let mut tag = Tag([0; 4]);
            tag.0.copy_from_slice(&self.bytes[at..at + 4]);
            // Of the other tags, a thousandth of all positions look like one.
            let is_stated = || stated.iter().any(|section| section.offset == at as u64 && section.tag == tag);
            let is_other = || tag.is_valid() && tag != DIRECTORY_TAG && (at == expected || is_stated());
            if known_rule(tag).is_none() && !is_other() {
                at += 1;
                continue;
            }
            let mut rest = self.bytes[at + 4..].iter();
            let header = Section::parse(tag, at as u64, || {
                rest.next().copied().ok_or_else(|| Error::format(FilePart::File, at, "ends within a section's header"))
            });
            match header {
                Ok(section) if self.is_content(&section, content_start(&section)) => {
                    self.add(section, content_start(&section));
                    at = content_start(&section) + section.stored as usize;
                    expected = at;
                }
                Ok(section) => {
                    self.headers.push(section);
                    at += 1;
                }
                Err(_) => at += 1,
            }
        }
    }

    /// Finds the directory's sections whose headers are damaged, where they should be and where others have moved to.
    fn find_stated(&mut self, stated: &[Section]) {
        let mut shifts = vec![0i64];
        for section in stated {
            let found =
                self.whole.iter().find(|whole| whole.section.crc == section.crc && whole.section.tag == section.tag);
            shifts.extend(found.map(|found| found.section.offset as i64 - section.offset as i64));
        }
        shifts.sort_unstable();
        shifts.dedup();
        for section in stated {
            if self.has(section) {
                continue;
            }
            for shift in &shifts {
                let Some(offset) = section.offset.checked_add_signed(*shift) else { continue };
                let moved = Section { offset, ..*section };
                if self.is_content(&moved, content_start(&moved)) {
                    self.add(moved, content_start(&moved));
                    break;
                }
            }
        }
    }

    /// Returns where the contents of a section without a header may begin: after the section before it, or where the directory says.
    fn likely_start(&self, section: &Section, stated: Option<&[Section]>) -> usize {
        let before = stated.unwrap_or_default().iter().take_while(|other| other.offset < section.offset).last();
        let found = before.and_then(|before| self.whole.iter().find(|whole| whole.section.crc == before.crc));
        let offset = found.map_or(section.offset as usize, |found| found.stored.end);
        offset + section.header_bytes() as usize
    }

    /// Bytes that no whole section, nor the head and the directory, explain.
    fn gaps(&self, directory: Option<Range<usize>>) -> Vec<Range<usize>> {
        let mut explained: Vec<Range<usize>> =
            self.whole.iter().map(|whole| whole.section.offset as usize..whole.stored.end).chain(directory).collect();
        explained.sort_by_key(|range| range.start);
        let mut gaps = Vec::new();
        let mut at = 0;
        for range in explained {
            gaps.push(at..range.start.max(at));
            at = at.max(range.end);
        }
        gaps.push(at..self.bytes.len().max(at));
        gaps.retain(|gap| gap.len() > FILE_HEADER_BYTES);
        gaps.sort_by_key(|gap| std::cmp::Reverse(gap.len()));
        gaps
    }
}

impl WholeSection {
    /// The section's stored bytes in the file.
    pub(crate) fn bytes<'a>(&self, file: &'a [u8]) -> &'a [u8] {
        &file[self.stored.clone()]
    }
}
