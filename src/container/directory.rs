//! Directory and trailer: the headers of all sections once more, where the directory begins, and the end of the file.

use super::section::{Section, push_number, push_u32, read_number};
use super::{DIRECTORY_TAG, END_SIGNATURE, FILE_HEADER_BYTES, MAX_SECTIONS, SECTION_HEADER_BYTES, TRAILER_BYTES, Tag};
use crate::limits::check;
use crate::{Error, FilePart, Result};
use byteorder::{ByteOrder, LittleEndian};

/// Bytes of the checksum at the directory's end.
const CHECKSUM_BYTES: u64 = 4;
/// Most bytes of a directory: tag, count, headers, checksum. Part of the format.
const MAX_DIRECTORY_BYTES: u64 = 4 + 10 + MAX_SECTIONS * *SECTION_HEADER_BYTES.end() + CHECKSUM_BYTES;

/// Directory of these sections without its checksum.
fn body(sections: &[Section]) -> Vec<u8> {
    let mut bytes = DIRECTORY_TAG.0.to_vec();
    push_number(&mut bytes, sections.len() as u64);
    sections.iter().for_each(|section| bytes.extend(section.to_bytes()));
    bytes
}

/// CRC-32 of the file header and the directory's body.
fn checksum(file_header: &[u8], body: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(file_header);
    hasher.update(body);
    hasher.finalize()
}

/// Directory and trailer of these sections: the last bytes of the file.
#[cfg(feature = "encode")]
pub(super) fn to_bytes(file_header: &[u8; FILE_HEADER_BYTES], sections: &[Section]) -> Vec<u8> {
    let mut bytes = body(sections);
    let checksum = checksum(file_header, &bytes);
    push_u32(&mut bytes, checksum);
    let length = bytes.len() as u32;
    bytes.extend(trailer(length));
    bytes
}

/// Trailer behind a directory of `length` bytes.
pub(super) fn trailer(length: u32) -> [u8; TRAILER_BYTES] {
    let mut bytes = [0; TRAILER_BYTES];
    LittleEndian::write_u32(&mut bytes[..4], length);
    bytes[4..].copy_from_slice(&END_SIGNATURE);
    bytes
}

/// Length of the directory of these sections, tag and checksum included.
pub(super) fn length(sections: &[Section]) -> u64 {
    body(sections).len() as u64 + CHECKSUM_BYTES
}

/// Offset of the directory in a file of `length` bytes that ends in `trailer`.
/// # Errors
/// [`Error::Format`] if the file is too short or does not end in a trailer.
pub(super) fn offset(trailer: &[u8], length: u64) -> Result<u64> {
    let trailer_at = length.checked_sub(TRAILER_BYTES as u64).filter(|at| *at >= FILE_HEADER_BYTES as u64);
    let Some((trailer_at, (directory_bytes, end_signature))) = trailer_at.zip(trailer.split_at_checked(4)) else {
        return Err(Error::format(FilePart::File, length, "ends before its directory"));
    };
    if end_signature != END_SIGNATURE {
        return Err(Error::format(
            FilePart::File,
            trailer_at + 4,
            "end signature missing: the file is cut or extended",
        ));
    }
    let directory_bytes = LittleEndian::read_u32(directory_bytes) as u64;
    let offset = trailer_at.checked_sub(directory_bytes).filter(|at| *at >= FILE_HEADER_BYTES as u64);
    offset.filter(|_| directory_bytes <= MAX_DIRECTORY_BYTES).ok_or_else(|| {
        Error::format(FilePart::File, trailer_at, format!("directory of {directory_bytes} bytes can't be"))
    })
}

/// Parses the directory that stands at `offset`, tag and checksum included, into its sections.
/// # Errors
/// [`Error::Format`] if it is damaged or its sections do not fill the file from the file header up to it;
/// [`Error::Limits`] for more than [`MAX_SECTIONS`] sections.
pub(super) fn parse(file_header: &[u8], directory: &[u8], offset: u64) -> Result<Vec<Section>> {
    let wrong = |message: &str| Error::format(FilePart::Directory, offset, message);
    let Some((body, stored_checksum)) = directory.split_last_chunk::<4>() else { return Err(wrong("too short")) };
    let Some((tag, mut rest)) = body.split_first_chunk::<4>() else { return Err(wrong("too short")) };
    if *tag != DIRECTORY_TAG.0 {
        return Err(wrong("must begin with DRCT"));
    }
    if checksum(file_header, body) != LittleEndian::read_u32(stored_checksum) {
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
    check("sections", count, MAX_SECTIONS)?;
    let mut sections: Vec<Section> = Vec::new();
    let mut section_at = FILE_HEADER_BYTES as u64;
    for _ in 0..count {
        let tag = Tag([next()?, next()?, next()?, next()?]);
        let section = Section::parse(tag, section_at, &mut next)?;
        section.check_repetition(&sections)?;
        section_at = section.end().ok_or_else(|| wrong("lengths beyond 64 bits"))?;
        sections.push(section);
    }
    if !rest.is_empty() {
        return Err(wrong("bytes left after the last entry"));
    }
    if section_at != offset {
        return Err(wrong("the sections do not fill the file up to the directory"));
    }
    Ok(sections)
}
