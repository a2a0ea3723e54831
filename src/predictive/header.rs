//! Head of section `PLAN`: how the pictures are coded, in which order, and where their streams lie.
//!
//! Layout: `u32` length of the head, `u32` CRC-32 of the head, the head, then the streams in coding order. The head is
//! enough to find the streams of one view, and each step's streams carry a CRC-32 of their own.

use super::order::{MAX_REFERENCES, OrderEntry};
use super::{ComponentCoding, MAX_PREDICTION_LEVEL, MaskCoding, PlaneCoding};
use crate::container::Tag;
#[cfg(feature = "encode")]
use crate::container::push_number;
use crate::error::{Error, Result};
use crate::limits::{Budget, check};
use crate::residual::coefficients::Modelling;
use byteorder::{ByteOrder, LittleEndian};

/// Bytes before the head: its length and checksum.
pub const PREFIX_BYTES: usize = 8;
/// Largest head, for a length that is read before anything can be checked.
const MAX_HEAD_BYTES: u64 = 1 << 26;
const SECTION: Tag = Tag::PLANES;

/// A step of the coding order with its streams.
#[derive(Debug, Clone, PartialEq)]
pub struct CodedEntry {
    /// View, references and parent.
    pub entry: OrderEntry,
    /// Quantiser step of this view in 1/64 of the component's.
    pub scale: u8,
    /// Bytes of the mask's stream and of each component's.
    pub lengths: Vec<u32>,
    /// CRC-32 of the streams together.
    pub checksum: u32,
    /// Where the streams start, in bytes after the head. Not stored: the sum of the lengths before.
    pub offset: u64,
}

/// Head of the section.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneHeader {
    /// How the pictures are coded.
    pub coding: PlaneCoding,
    /// The coding order; every view once.
    pub entries: Vec<CodedEntry>,
}

impl PlaneHeader {
    /// The steps without their streams.
    pub fn order(&self) -> Vec<OrderEntry> {
        self.entries.iter().map(|s| s.entry.clone()).collect()
    }

    /// Bytes of the head with its length and checksum.
    #[cfg(feature = "encode")]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut head = Vec::new();
        let PlaneCoding { masks, prediction_level, modelling, .. } = self.coding;
        head.push(masks as u8 | prediction_level << 1 | (modelling as u8) << 3);
        head.push(self.coding.components.len() as u8);
        for component in &self.coding.components {
            head.extend(component.step.to_le_bytes());
            head.extend(component.shrink);
            head.push(component.signed as u8 | (component.shaded as u8) << 1);
            head.extend(component.rotation.iter().flatten().flat_map(|v| v.to_le_bytes()));
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
            head.extend(coded.checksum.to_le_bytes());
            step_of_view.insert(coded.entry.view, index);
        }
        let mut bytes = Vec::with_capacity(head.len() + PREFIX_BYTES);
        bytes.extend((head.len() as u32).to_le_bytes());
        bytes.extend(crc32fast::hash(&head).to_le_bytes());
        bytes.extend(head);
        bytes
    }

    /// Length of the head from the section's first [`PREFIX_BYTES`] bytes, [`PREFIX_BYTES`] not counted.
    pub fn head_bytes(prefix: &[u8]) -> Result<u64> {
        let length = prefix.get(..4).map(LittleEndian::read_u32).ok_or_else(|| cut(prefix.len()))? as u64;
        check("head of section PLAN", length, MAX_HEAD_BYTES)?;
        Ok(length)
    }

    /// Reads a head from the section's start. `bytes` may go on after the head.
    pub fn parse(bytes: &[u8], views: usize, components: usize, budget: &Budget) -> Result<Self> {
        let length = Self::head_bytes(bytes)? as usize;
        let head = bytes.get(PREFIX_BYTES..PREFIX_BYTES + length).ok_or_else(|| cut(bytes.len()))?;
        if crc32fast::hash(head) != LittleEndian::read_u32(&bytes[4..8]) {
            return Err(Error::format(SECTION, 4, "the head's checksum does not match: the file is damaged"));
        }
        let mut reader = PlaneHeaderReader { bytes: head, position: 0 };
        let flags = reader.byte()?;
        let masks = if flags & 1 == 0 { MaskCoding::Coverage } else { MaskCoding::Coded };
        let prediction_level = flags >> 1 & 3;
        let modelling = if flags & 8 == 0 { Modelling::Mixed } else { Modelling::Direct };
        if flags > 15 || prediction_level > MAX_PREDICTION_LEVEL {
            return Err(Error::Unsupported(format!("coding {flags} of the pictures (section PLAN, byte 8)")));
        }
        if reader.byte()? as usize != components {
            return Err(reader.error("the number of components is not that of section VIEW"));
        }
        let components = (0..components).map(|_| reader.component()).collect::<Result<Vec<_>>>()?;
        let count = reader.varint()?;
        if count != views as u64 {
            return Err(reader.error(format!("{count} coded views, section VIEW has {views}")));
        }
        budget.charge_items("coding order", count, size_of::<CodedEntry>() + 128)?;
        let mut steps: Vec<CodedEntry> = Vec::new();
        let mut seen = vec![false; views];
        let mut offset = 0u64;
        for _ in 0..views {
            let coded = reader.step(&steps, components.len(), offset)?;
            match seen.get_mut(coded.entry.view) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(reader.error(format!("view {} does not exist or comes twice", coded.entry.view))),
            }
            offset += coded.lengths.iter().map(|&l| l as u64).sum::<u64>();
            steps.push(coded);
        }
        if reader.position != head.len() {
            return Err(reader.error("bytes left over at the end of the head"));
        }
        Ok(PlaneHeader { coding: PlaneCoding { components, masks, prediction_level, modelling }, entries: steps })
    }

    /// Bytes of all streams together.
    pub fn stream_bytes(&self) -> u64 {
        self.entries.last().map_or(0, |s| s.offset + s.lengths.iter().map(|&l| l as u64).sum::<u64>())
    }
}

fn cut(length: usize) -> Error {
    Error::format(SECTION, length, "the section ends within its head: the file is cut short")
}

struct PlaneHeaderReader<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl PlaneHeaderReader<'_> {
    fn error(&self, message: impl Into<String>) -> Error {
        Error::format(SECTION, self.position + PREFIX_BYTES, message)
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
        let step = f32::from_le_bytes(self.take()?);
        if !(step.is_finite() && (1e-6..=1e3).contains(&step)) {
            return Err(self.error(format!("quantiser step {step}, 0.000001 to 1000 expected")));
        }
        let shrink = self.take()?;
        let flags = self.byte()?;
        if flags > 3 {
            return Err(Error::Unsupported(format!("component flags {flags} (section PLAN)")));
        }
        let mut rotation = [[0i16; 3]; 3];
        for value in rotation.iter_mut().flatten() {
            *value = i16::from_le_bytes(self.take()?);
        }
        Ok(ComponentCoding { step, shrink, rotation, signed: flags & 1 != 0, shaded: flags & 2 != 0 })
    }
    /// A view `back` steps before the next one; 0 is none.
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
        let lengths = (0..components + 1)
            .map(|_| u32::try_from(self.varint()?).map_err(|_| self.error("a stream of 4 GiB or more")))
            .collect::<Result<Vec<_>>>()?;
        let checksum = u32::from_le_bytes(self.take()?);
        Ok(CodedEntry { entry: OrderEntry { view, references, parent }, scale, lengths, checksum, offset })
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use crate::limits::Limits;
    use crate::predictive::header::*;

    fn header() -> PlaneHeader {
        let component = ComponentCoding {
            step: 0.03,
            shrink: [20, 6],
            rotation: [[16384, 0, 0], [0, 16384, 0], [0, 0, -16384]],
            signed: false,
            shaded: true,
        };
        let step = |view, references, parent, offset| CodedEntry {
            entry: OrderEntry { view, references, parent },
            scale: 64,
            lengths: vec![3, 200, 70_000],
            checksum: 0xdead_beef,
            offset,
        };
        PlaneHeader {
            coding: PlaneCoding {
                components: vec![component; 2],
                masks: MaskCoding::Coded,
                prediction_level: 2,
                modelling: Modelling::Direct,
            },
            entries: vec![
                step(0, vec![], None, 0),
                step(2, vec![], Some(0), 70_203),
                step(1, vec![(0, 128), (2, 127)], Some(0), 140_406),
            ],
        }
    }

    #[test]
    fn comes_back_and_every_damage_is_an_error() {
        let budget = Budget::new(Limits::default());
        let bytes = header().to_bytes();
        assert_eq!(PlaneHeader::parse(&bytes, 3, 2, &budget).unwrap(), header());
        for length in 0..bytes.len() {
            assert!(PlaneHeader::parse(&bytes[..length], 3, 2, &budget).is_err());
        }
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert!(PlaneHeader::parse(&damaged, 3, 2, &budget).is_err(), "byte {at}");
        }
        assert!(PlaneHeader::parse(&bytes, 4, 2, &budget).is_err());
        assert!(PlaneHeader::parse(&bytes, 3, 1, &budget).is_err());
    }

    #[test]
    fn a_coding_of_later_versions_is_named() {
        for coding in [6, 7, 16, 128] {
            let mut bytes = header().to_bytes();
            bytes[PREFIX_BYTES] = coding;
            let checksum = crc32fast::hash(&bytes[PREFIX_BYTES..]);
            LittleEndian::write_u32(&mut bytes[4..8], checksum);
            let error = PlaneHeader::parse(&bytes, 3, 2, &Budget::new(Limits::default())).unwrap_err();
            assert!(matches!(&error, Error::Unsupported(what) if what.contains("PLAN")), "{coding}: {error}");
        }
    }

    #[test]
    fn a_view_may_not_come_twice() {
        let mut twice = header();
        twice.entries[2].entry.view = 0;
        let error = PlaneHeader::parse(&twice.to_bytes(), 3, 2, &Budget::new(Limits::default())).unwrap_err();
        assert!(error.to_string().contains("comes twice"), "{error}");
    }
}
