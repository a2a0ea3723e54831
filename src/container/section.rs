//! Section headers: the same bytes before the section and in the directory.

use super::tags::{Tag, known_rule, section_rule};
use super::zstd_frame::{ZstdRefusal, decompress};
use crate::limits::Budget;
use crate::{Error, FilePart, Result};
use byteorder::{ByteOrder, LittleEndian};

/// Coding of a section's bytes. The discriminants are part of the format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SectionCodec {
    /// As they are.
    None = 0,
    /// One zstd frame (RFC 8878) without dictionary.
    Zstd = 1,
    /// As they are; the section's own format has its entropy coding (and, where parts are read alone, its own checksums).
    Own = 2,
}

/// A section's header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Section {
    /// Kind of content.
    pub tag: Tag,
    /// Coding of the stored bytes.
    pub codec: SectionCodec,
    /// Bytes in the file after the header.
    pub stored: u64,
    /// Bytes after decompression; equal to `stored` unless the codec is zstd.
    pub decoded: u64,
    /// CRC-32 (ISO-HDLC, as in zlib and PNG) of tag, codec, lengths and stored bytes.
    pub crc: u32,
    /// Offset of the header in the file.
    pub offset: u64,
}

impl Section {
    /// Returns the header without its checksum.
    pub(crate) fn head(&self) -> Vec<u8> {
        let mut bytes = self.tag.0.to_vec();
        bytes.push(self.codec as u8);
        push_number(&mut bytes, self.stored);
        if self.codec == SectionCodec::Zstd {
            push_number(&mut bytes, self.decoded);
        }
        bytes
    }
    /// Returns the whole header, as in the file.
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        let mut bytes = self.head();
        push_u32(&mut bytes, self.crc);
        bytes
    }
    /// Length of the header in bytes.
    pub fn header_bytes(&self) -> u64 {
        self.head().len() as u64 + 4
    }
    /// Offset behind the section in the file; `None` beyond 64 bits.
    pub fn end(&self) -> Option<u64> {
        self.offset.checked_add(self.header_bytes())?.checked_add(self.stored)
    }
    /// Parses the rest of a header whose tag has been read; bytes come from `next`. `offset` is that of the tag.
    pub(crate) fn parse(tag: Tag, offset: u64, mut next: impl FnMut() -> Result<u8>) -> Result<Section> {
        if !tag.is_valid() {
            return Err(Error::format(
                FilePart::File,
                offset,
                format!("'{tag}' is no section tag: four letters, the third upper case"),
            ));
        }
        let codec = match next()? {
            0 => SectionCodec::None,
            1 => SectionCodec::Zstd,
            2 => SectionCodec::Own,
            other => return Err(Error::Unsupported(format!("section {tag}: codec {other}"))),
        };
        let stored = read_number(tag, &mut next)?;
        let decoded = if codec == SectionCodec::Zstd { read_number(tag, &mut next)? } else { stored };
        let crc = LittleEndian::read_u32(&[next()?, next()?, next()?, next()?]);
        let section = Section { tag, codec, stored, decoded, crc, offset };
        section.check_bounds()?;
        Ok(section)
    }
    /// Checks codec and lengths against the section's rule.
    pub(crate) fn check_bounds(&self) -> Result<()> {
        if self.tag.is_critical() && known_rule(self.tag).is_none() {
            return Err(Error::Unsupported(format!("critical section {}, which this build does not know", self.tag)));
        }
        let bounds = section_rule(self.tag);
        if !bounds.codecs.contains(&self.codec) {
            return Err(Error::format(self.tag, 4u8, format!("codec {:?} is not allowed here", self.codec)));
        }
        if !(bounds.min_bytes..=bounds.max_bytes).contains(&self.decoded) || self.stored > bounds.max_bytes {
            let (shortest, longest) = (bounds.min_bytes, bounds.max_bytes);
            return Err(Error::format(
                self.tag,
                5u8,
                format!("{} bytes decoded, {} stored: must be {shortest} to {longest}", self.decoded, self.stored),
            ));
        }
        Ok(())
    }
    /// Checks that a section that may come once has not come before.
    pub(crate) fn check_repetition(&self, before: &[Section]) -> Result<()> {
        if !section_rule(self.tag).repeats && before.iter().any(|other| other.tag == self.tag) {
            return Err(Error::format(self.tag, 0u8, "comes twice, may come once"));
        }
        Ok(())
    }
    /// Returns a checksum that has begun with the header.
    pub(crate) fn hasher(&self) -> crc32fast::Hasher {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&self.head());
        hasher
    }
    /// Compares the checksum.
    pub(crate) fn check_crc(&self, hasher: crc32fast::Hasher) -> Result<()> {
        if hasher.finalize() == self.crc {
            Ok(())
        } else {
            Err(Error::format(self.tag, self.header_bytes(), "CRC-32 does not match: the section is damaged"))
        }
    }
    /// Decompresses if the codec asks for it. The stored bytes have been charged by the caller.
    pub(crate) fn decode(&self, stored: Vec<u8>, budget: &Budget) -> Result<Vec<u8>> {
        if self.codec != SectionCodec::Zstd {
            return Ok(stored);
        }
        let wrong = |message: &str| Error::format(self.tag, self.header_bytes(), message);
        budget.charge("decompressed section", self.decoded)?;
        let length = usize::try_from(self.decoded).map_err(|_| wrong("longer than this machine's memory"))?;
        let decoded = decompress(&stored, length).map_err(|refusal| match refusal {
            ZstdRefusal::NotOneFrame => wrong("must be exactly one zstd frame"),
            ZstdRefusal::Length => wrong("does not decompress to as many bytes as its header says"),
            ZstdRefusal::Damaged(message) => wrong(&format!("zstd: {message}")),
            ZstdRefusal::Memory => Error::Limits { what: "decompressed section", requested: self.decoded, allowed: 0 },
        })?;
        budget.release(stored.len() as u64);
        Ok(decoded)
    }
}

/// Appends a little-endian number of two bytes.
pub(crate) fn push_u16(bytes: &mut Vec<u8>, value: u16) {
    let start = bytes.len();
    bytes.resize(start + 2, 0);
    LittleEndian::write_u16(&mut bytes[start..], value);
}

/// Appends a little-endian number of four bytes.
pub(crate) fn push_u32(bytes: &mut Vec<u8>, value: u32) {
    let start = bytes.len();
    bytes.resize(start + 4, 0);
    LittleEndian::write_u32(&mut bytes[start..], value);
}

/// Appends a little-endian number in single precision.
pub(crate) fn push_f32(bytes: &mut Vec<u8>, value: f32) {
    push_u32(bytes, value.to_bits());
}

/// Appends a number as LEB128: seven bits a byte from the lowest on, the high bit set if more follow.
pub(crate) fn push_number(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Reads a number as LEB128 in its shortest form of at most ten bytes.
pub(crate) fn read_number(tag: Tag, next: &mut impl FnMut() -> Result<u8>) -> Result<u64> {
    let mut value = 0u64;
    for k in 0..10 {
        let byte = next()?;
        let bits = (byte & 0x7f) as u64;
        if k == 9 && bits > 1 || k > 0 && byte == 0 {
            break;
        }
        value |= bits << (7 * k);
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(Error::format(tag, 5u8, "number not in its shortest form or beyond 64 bits"))
}
