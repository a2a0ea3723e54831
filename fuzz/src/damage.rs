//! Structured damage: to bytes, and to the sections of a file.

use arbitrary::Arbitrary;

/// One change of some bytes. Places are taken modulo the length.
#[derive(Arbitrary, Debug, Clone)]
pub enum Damage {
    /// Turns a bit round.
    Flip { at: u16, bit: u8 },
    /// Another byte.
    Set { at: u16, value: u8 },
    /// Four bytes become a number that is likely to hurt.
    Number { at: u16, which: u8 },
    /// Takes bytes out.
    Remove { at: u16, count: u8 },
    /// Puts bytes in.
    Insert { at: u16, bytes: [u8; 3] },
    /// Copies bytes to another place.
    Copy { from: u16, to: u16, count: u8 },
    /// Cuts the end off.
    Cut { at: u16 },
}

/// Numbers at the edges of what is allowed.
const EDGES: [u32; 12] = [
    0,
    1,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x0001_0000,
    0x7f80_0000, // infinity
    0xff80_0000,
    0x7fc0_0000, // not a number
    0x0000_0001, // least float
    0x7f7f_ffff, // largest float
    0x3f80_0000, // 1.0
];

impl Damage {
    /// Changes the bytes.
    pub fn apply(&self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        let length = bytes.len();
        let place = |at: u16| at as usize % length;
        match *self {
            Damage::Flip { at, bit } => bytes[place(at)] ^= 1 << (bit % 8),
            Damage::Set { at, value } => bytes[place(at)] = value,
            Damage::Number { at, which } => {
                let number = EDGES[which as usize % EDGES.len()].to_le_bytes();
                bytes.iter_mut().skip(place(at)).zip(number).for_each(|(byte, new)| *byte = new);
            }
            Damage::Remove { at, count } => {
                let end = (place(at) + count as usize).min(length);
                bytes.drain(place(at)..end);
            }
            Damage::Insert { at, bytes: new } => drop(bytes.splice(place(at)..place(at), new)),
            Damage::Copy { from, to, count } => {
                let part = bytes[place(from)..(place(from) + count as usize).min(length)].to_vec();
                bytes.iter_mut().skip(place(to)).zip(part).for_each(|(byte, new)| *byte = new);
            }
            Damage::Cut { at } => bytes.truncate(place(at)),
        }
    }
}

/// A section as it stands in a file: tag, codec, content.
pub type RawSection = ([u8; 4], u8, Vec<u8>);

/// One change of a file. Sections are taken modulo their number.
#[derive(Arbitrary, Debug, Clone)]
pub enum FileDamage {
    /// Within a section.
    Within { section: u8, damage: Damage },
    /// A section is missing.
    Leave { section: u8 },
    /// Two sections change places.
    Exchange { a: u8, b: u8 },
    /// A section comes twice.
    Twice { section: u8 },
    /// A section says another codec.
    Codec { section: u8, codec: u8 },
    /// A section takes the content of another.
    Instead { section: u8, of: u8 },
}

impl FileDamage {
    /// Changes the sections.
    pub fn apply(&self, sections: &mut Vec<RawSection>) {
        if sections.is_empty() {
            return;
        }
        let count = sections.len();
        let place = |at: u8| at as usize % count;
        match self {
            FileDamage::Within { section, damage } => damage.apply(&mut sections[place(*section)].2),
            FileDamage::Leave { section } => drop(sections.remove(place(*section))),
            FileDamage::Exchange { a, b } => sections.swap(place(*a), place(*b)),
            FileDamage::Twice { section } => sections.push(sections[place(*section)].clone()),
            FileDamage::Codec { section, codec } => sections[place(*section)].1 = codec % 4,
            FileDamage::Instead { section, of } => sections[place(*section)].2 = sections[place(*of)].2.clone(),
        }
    }
}
