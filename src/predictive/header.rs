//! Head of section `PLAN`: coding of the views, their order, and the lengths of their streams.
//!
//! Layout: `u32` length of the head, `u32` CRC-32 of the head, the head, then the streams in coding order. The head is
//! enough to find the streams of one view and of each of its tiles, which carry CRC-32s of their own.

use super::order::{MAX_REFERENCES, OrderEntry};
use super::{ComponentCoding, DEFAULT_TILE_SIDE_LOG2, MaskCoding, PlaneCoding};
use crate::container::incremental::ready;
use crate::container::{IncrementalReader, Poll, Section, Tag};
#[cfg(feature = "encode")]
use crate::container::{push_f32, push_number, push_u32};
use crate::error::{Error, Result};
use crate::limits::{Budget, check};
use crate::residual::coefficients::Modelling;
use crate::residual::tiles::{TILE_SIDES_LOG2, TileGrid};
use crate::views::View;
use byteorder::{ByteOrder, LittleEndian};
use std::ops::Range;

/// Bytes before the head: its length and checksum.
pub const PREFIX_BYTES: usize = 8;
/// Bit of the first byte of the head: views are predicted from the reflectance, too.
const MODELLED: u8 = 16;
/// Largest first byte of the head: all its bits.
pub(super) const MAX_CODING: u8 = 2 * MODELLED - 1;
/// Largest head, for a length that is read before anything can be checked.
const MAX_HEAD_BYTES: u64 = 1 << 26;

/// Entry of the coding order with its streams.
#[derive(Debug, Clone, PartialEq)]
pub struct CodedEntry {
    /// View, references and parent.
    pub entry: OrderEntry,
    /// Quantiser step of this view in 1/64 of the component's.
    pub scale: u8,
    /// Bytes of the mask's stream and of each component's base.
    pub lengths: Vec<u32>,
    /// CRC-32 of these streams together.
    pub checksum: u32,
    /// The tiles of its finest levels, those of the coarsest level first.
    pub tiles: Vec<CodedTile>,
    /// Offset of the streams in bytes after the head. Not stored: the sum of the lengths before.
    pub offset: u64,
}

/// Streams of one tile.
#[derive(Debug, Clone, PartialEq)]
pub struct CodedTile {
    /// Level of its bands; 1 is the finest. Not stored: it follows from the size of the view.
    pub level: u8,
    /// Bytes of each component's stream.
    pub lengths: Vec<u32>,
    /// CRC-32 of the streams together; not stored and 0 where these are empty.
    pub checksum: u32,
}

impl CodedTile {
    /// Bytes of its streams.
    pub fn stream_bytes(&self) -> u64 {
        total(&self.lengths)
    }
}

fn total(lengths: &[u32]) -> u64 {
    lengths.iter().map(|&length| length as u64).sum()
}

impl CodedEntry {
    /// Bytes of all its streams.
    pub fn stream_bytes(&self) -> u64 {
        self.stream_bytes_above(0)
    }
    /// Whether `streams` are those of the base and of the `needed` tiles, one after the other, and their checksums match.
    pub(crate) fn is_intact(&self, needed: impl Iterator<Item = bool>, streams: &[u8]) -> bool {
        let Some((base, mut rest)) = streams.split_at_checked(total(&self.lengths) as usize) else { return false };
        let mut tiles = self.tiles.iter().zip(needed).filter(|(tile, is_needed)| *is_needed && tile.stream_bytes() > 0);
        let is_whole = |(tile, _): (&CodedTile, bool)| {
            let Some((part, behind)) = rest.split_at_checked(tile.stream_bytes() as usize) else { return false };
            rest = behind;
            crc32fast::hash(part) == tile.checksum
        };
        crc32fast::hash(base) == self.checksum && tiles.all(is_whole)
    }
    /// Ranges of the section's streams that hold the base and the `needed` tiles, in their order.
    pub(crate) fn needed_ranges(&self, needed: impl Iterator<Item = bool>) -> Vec<Range<u64>> {
        let mut end = self.offset + total(&self.lengths);
        let mut ranges: Vec<Range<u64>> = std::iter::once(self.offset..end).collect();
        for (tile, is_needed) in self.tiles.iter().zip(needed) {
            let start = end;
            end += tile.stream_bytes();
            match ranges.last_mut() {
                Some(last) if is_needed && last.end == start => last.end = end,
                _ if is_needed && end > start => ranges.push(start..end),
                _ => {}
            }
        }
        ranges
    }
    /// Bytes of its streams but those of the tiles of the first `level` levels, which stand behind the others.
    pub fn stream_bytes_above(&self, level: usize) -> u64 {
        let tiles = self.tiles.iter().take_while(|tile| tile.level as usize > level);
        total(&self.lengths) + tiles.map(CodedTile::stream_bytes).sum::<u64>()
    }
}

/// Head of the section.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneHeader {
    /// Coding of all views.
    pub coding: PlaneCoding,
    /// The coding order; every view once.
    pub entries: Vec<CodedEntry>,
}

impl PlaneHeader {
    /// Returns the coding order without the streams.
    pub fn order(&self) -> Vec<OrderEntry> {
        self.entries.iter().map(|s| s.entry.clone()).collect()
    }

    /// Returns the bytes of the head with its length and checksum.
    #[cfg(feature = "encode")]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut head = Vec::new();
        let PlaneCoding { masks, prediction_level, modelling, is_modelled, .. } = self.coding;
        head.push(
            masks as u8 | prediction_level << 1 | (modelling as u8) << 3 | if is_modelled { MODELLED } else { 0 },
        );
        if prediction_level > 0 {
            head.push(self.coding.tile_side_log2);
        }
        head.push(self.coding.components.len() as u8);
        for component in &self.coding.components {
            push_f32(&mut head, component.step);
            head.extend(component.shrink);
            head.push(component.signed as u8 | (component.shaded as u8) << 1);
            let mut rotation = [0; 18];
            LittleEndian::write_i16_into(component.rotation.as_flattened(), &mut rotation);
            head.extend(rotation);
        }
        push_number(&mut head, self.entries.len() as u64);
        let mut step_of_view = std::collections::HashMap::new();
        for (index, coded) in self.entries.iter().enumerate() {
            let back = |view: &usize| (index - step_of_view[view]) as u64;
            push_number(&mut head, coded.entry.view as u64);
            head.push(coded.scale);
            push_number(&mut head, coded.entry.parent.as_ref().map_or(0, back));
            head.push(coded.entry.references.len() as u8);
            for (view, share) in &coded.entry.references {
                push_number(&mut head, back(view));
                head.push(*share);
            }
            for length in &coded.lengths {
                push_number(&mut head, *length as u64);
            }
            push_u32(&mut head, coded.checksum);
            for tile in &coded.tiles {
                tile.lengths.iter().for_each(|&length| push_number(&mut head, length as u64));
                if tile.stream_bytes() > 0 {
                    push_u32(&mut head, tile.checksum);
                }
            }
            step_of_view.insert(coded.entry.view, index);
        }
        let mut bytes = Vec::with_capacity(head.len() + PREFIX_BYTES);
        push_u32(&mut bytes, head.len() as u32);
        push_u32(&mut bytes, crc32fast::hash(&head));
        bytes.extend(head);
        bytes
    }

    /// Returns the head's length in bytes, without its prefix, from the section's first [`PREFIX_BYTES`] bytes.
    /// # Errors
    /// [`Error::Format`] for fewer bytes, [`Error::Limits`] for a head of more than 64 MiB.
    pub fn head_bytes(prefix: &[u8]) -> Result<u64> {
        let length = prefix.get(..4).map(LittleEndian::read_u32).ok_or_else(|| cut(prefix.len()))? as u64;
        check("head of section PLAN", length, MAX_HEAD_BYTES)?;
        Ok(length)
    }

    /// Parses a head with its prefix, of a file with these views and so many components. `bytes` may go on after it.
    /// # Errors
    /// As `open`.
    pub fn parse(bytes: &[u8], views: &[View], components: usize, budget: &Budget) -> Result<Self> {
        let length = Self::head_bytes(bytes)? as usize;
        let head = bytes.get(PREFIX_BYTES..PREFIX_BYTES + length).ok_or_else(|| cut(bytes.len()))?;
        if crc32fast::hash(head) != LittleEndian::read_u32(&bytes[4..8]) {
            return Err(Error::format(Tag::PLANES, 4, "the head's checksum does not match: the file is damaged"));
        }
        let mut reader = PlaneHeaderReader { bytes: head, position: 0 };
        let flags = reader.byte()?;
        let masks = if flags & 1 == 0 { MaskCoding::Coverage } else { MaskCoding::Coded };
        let prediction_level = flags >> 1 & 3;
        let modelling = if flags & 8 == 0 { Modelling::Mixed } else { Modelling::Direct };
        let is_modelled = flags & MODELLED != 0;
        if flags > MAX_CODING {
            return Err(Error::Unsupported(format!("coding {flags} of the views (section PLAN, byte 8)")));
        }
        let tile_side_log2 = if prediction_level > 0 { reader.byte()? } else { DEFAULT_TILE_SIDE_LOG2 };
        if !TILE_SIDES_LOG2.contains(&tile_side_log2) {
            return Err(Error::Unsupported(format!("tiles of 2^{tile_side_log2} coefficients (section PLAN, byte 9)")));
        }
        if reader.byte()? as usize != components {
            return Err(reader.error("the number of components is not that of section VIEW"));
        }
        let components = (0..components).map(|_| reader.component()).collect::<Result<Vec<_>>>()?;
        let count = reader.varint()?;
        if count != views.len() as u64 {
            return Err(reader.error(format!("{count} coded views, section VIEW has {}", views.len())));
        }
        budget.charge_items("coding order", count, size_of::<CodedEntry>() + 128)?;
        let coding = PlaneCoding { components, masks, prediction_level, modelling, is_modelled, tile_side_log2 };
        let mut steps: Vec<CodedEntry> = Vec::new();
        let mut seen = vec![false; views.len()];
        let mut offset = 0u64;
        for _ in views {
            let mut coded = reader.step(&steps, coding.components.len(), offset)?;
            match seen.get_mut(coded.entry.view) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(reader.error(format!("view {} does not exist or comes twice", coded.entry.view))),
            }
            let grid = coding.tile_grid(&views[coded.entry.view].camera);
            coded.tiles = reader.tiles(&grid, coding.components.len(), budget)?;
            offset += coded.stream_bytes();
            steps.push(coded);
        }
        if reader.position != head.len() {
            return Err(reader.error("bytes left over at the end of the head"));
        }
        Ok(PlaneHeader { coding, entries: steps })
    }

    /// Whether the views of a section, of which these are the first bytes, are predicted from the reflectance, too.
    pub(crate) fn is_modelled(section: &[u8]) -> bool {
        section.get(PREFIX_BYTES).is_some_and(|coding| coding & MODELLED != 0)
    }

    /// Number of bytes of all streams together.
    pub fn stream_bytes(&self) -> u64 {
        self.entries.last().map_or(0, |entry| entry.offset + entry.stream_bytes())
    }
}

/// Section `PLAN` of a file: its head, and where the streams behind it lie.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneSection {
    /// Head of the section.
    pub header: PlaneHeader,
    /// Offset in the file of the first entry's streams, in bytes.
    pub streams: u64,
}

impl PlaneSection {
    /// Range of the file that holds an entry's streams.
    pub fn stream_range(&self, entry: &CodedEntry) -> Range<u64> {
        let start = self.streams + entry.offset;
        start..start + entry.stream_bytes()
    }
}

/// Range of the file that holds the head with its prefix; that of the prefix alone until the prefix is there.
/// # Errors
/// [`Error::Format`] if the section is shorter or compressed, [`Error::Limits`] for a head of more than 64 MiB.
pub(crate) fn head_range(file: &IncrementalReader, section: &Section) -> Result<Range<u64>> {
    let prefix = file.file_range(section, 0..PREFIX_BYTES as u64)?;
    match file.bytes(prefix.clone())? {
        Poll::Ready(bytes) => file.file_range(section, 0..PREFIX_BYTES as u64 + PlaneHeader::head_bytes(bytes)?),
        Poll::NeedRanges(_) => Ok(prefix),
    }
}

/// Opens section `PLAN` of a file with these views and so many components: parses its head and checks that the streams fill the rest.
/// # Errors
/// [`Error::Format`] if the head is damaged or does not fit section VIEW or the streams, [`Error::Unsupported`] for codings of
/// later versions, [`Error::Limits`] if the memory budget is exceeded.
pub(crate) fn open(
    file: &mut IncrementalReader,
    section: &Section,
    views: &[View],
    components: usize,
) -> Result<Poll<PlaneSection>> {
    ready!(file.bytes(head_range(file, section)?)?);
    let range = head_range(file, section)?;
    let head = ready!(file.bytes(range.clone())?);
    let header = PlaneHeader::parse(head, views, components, &file.budget())?;
    if section.stored != head.len() as u64 + header.stream_bytes() {
        return Err(Error::format(Tag::PLANES, head.len(), "the streams are not as long as the head says"));
    }
    file.discard(range.clone());
    Ok(Poll::Ready(PlaneSection { header, streams: range.end }))
}

fn cut(length: usize) -> Error {
    Error::format(Tag::PLANES, length, "the section ends within its head: the file is cut short")
}

struct PlaneHeaderReader<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl PlaneHeaderReader<'_> {
    fn error(&self, message: impl Into<String>) -> Error {
        Error::format(Tag::PLANES, self.position + PREFIX_BYTES, message)
    }
    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let bytes = self.bytes.get(self.position..self.position + N).and_then(|b| b.try_into().ok());
        let bytes = bytes.ok_or_else(|| self.error("the head ends too early"))?;
        self.position += N;
        Ok(bytes)
    }
    fn byte(&mut self) -> Result<u8> {
        Ok(self.take::<1>()?[0])
    }
    fn varint(&mut self) -> Result<u64> {
        let mut value = 0u64;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= ((byte & 0x7f) as u64) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(self.error("a number of more than five bytes"))
    }
    fn component(&mut self) -> Result<ComponentCoding> {
        let step = LittleEndian::read_f32(&self.take::<4>()?);
        if !(step.is_finite() && (1e-6..=1e3).contains(&step)) {
            return Err(self.error(format!("quantiser step {step}, 0.000001 to 1000 expected")));
        }
        let shrink = self.take()?;
        let flags = self.byte()?;
        if flags > 3 {
            return Err(Error::Unsupported(format!("component flags {flags} (section PLAN)")));
        }
        let mut rotation = [[0i16; 3]; 3];
        LittleEndian::read_i16_into(&self.take::<18>()?, rotation.as_flattened_mut());
        Ok(ComponentCoding { step, shrink, rotation, signed: flags & 1 != 0, shaded: flags & 2 != 0 })
    }
    /// Returns the view `back` entries before the next one; 0 is none.
    fn earlier(&self, back: u64, steps: &[CodedEntry]) -> Result<Option<usize>> {
        if back == 0 {
            return Ok(None);
        }
        let index =
            (steps.len() as u64).checked_sub(back).ok_or_else(|| self.error("a view depends on a later one"))?;
        Ok(Some(steps[index as usize].entry.view))
    }
    fn step(&mut self, steps: &[CodedEntry], components: usize, offset: u64) -> Result<CodedEntry> {
        let view = self.varint()? as usize;
        let scale = self.byte()?;
        if scale == 0 {
            return Err(self.error("quantiser scale 0"));
        }
        let back = self.varint()?;
        let parent = self.earlier(back, steps)?;
        let count = self.byte()? as usize;
        if count > MAX_REFERENCES {
            return Err(self.error(format!("{count} references, at most {MAX_REFERENCES} expected")));
        }
        let mut references = Vec::with_capacity(count);
        for _ in 0..count {
            let back = self.varint()?;
            let reference = self.earlier(back, steps)?.ok_or_else(|| self.error("a view is its own reference"))?;
            references.push((reference, self.byte()?));
        }
        let lengths = self.lengths(components + 1)?;
        let checksum = LittleEndian::read_u32(&self.take::<4>()?);
        let entry = OrderEntry { view, references, parent };
        Ok(CodedEntry { entry, scale, lengths, checksum, tiles: Vec::new(), offset })
    }
    fn lengths(&mut self, count: usize) -> Result<Vec<u32>> {
        let length = |_| u32::try_from(self.varint()?).map_err(|_| self.error("a stream of 4 GiB or more"));
        (0..count).map(length).collect()
    }
    /// The tiles of an entry. Each takes a byte of the head at least, so that no memory is for tiles that are not there.
    fn tiles(&mut self, grid: &TileGrid, components: usize, budget: &Budget) -> Result<Vec<CodedTile>> {
        let left = (self.bytes.len() - self.position) as u64;
        if grid.tile_count() > left {
            return Err(self.error(format!("{} tiles in {left} bytes", grid.tile_count())));
        }
        budget.charge_items("tiles", grid.tile_count(), size_of::<CodedTile>() + 16 + 4 * components)?;
        let tile = |level: usize| {
            let mut tile = CodedTile { level: level as u8, lengths: self.lengths(components)?, checksum: 0 };
            if tile.stream_bytes() > 0 {
                tile.checksum = LittleEndian::read_u32(&self.take::<4>()?);
            }
            Ok(tile)
        };
        grid.tile_levels().map(tile).collect()
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests;
