//! Puts a file's checksums and lengths right, so that what a fuzzer changes gets past them.

use crate::damage::RawSection;
use tsuya::container::{SIGNATURE, VERSION};
use tsuya::internals::predictive::TileGrid;
use tsuya::{Budget, Limits, View, internals};

/// A varint at `at`, and where it ends.
fn varint(bytes: &[u8], mut at: usize) -> Option<(u64, usize)> {
    let mut value = 0;
    for shift in (0..63).step_by(7) {
        let byte = *bytes.get(at)?;
        at += 1;
        value |= ((byte & 127) as u64) << shift;
        if byte < 128 {
            return Some((value, at));
        }
    }
    None
}

/// A file of these sections, checksums and directory right.
pub fn assemble(sections: &[RawSection]) -> Vec<u8> {
    let (major, minor) = VERSION;
    let mut file = [&SIGNATURE[..], &major.to_le_bytes(), &minor.to_le_bytes()].concat();
    for (tag, codec, content) in sections {
        file.extend_from_slice(tag);
        file.push(*codec);
        let mut length = content.len();
        while length >= 128 {
            file.push(length as u8 | 128);
            length >>= 7;
        }
        file.push(length as u8);
        if *codec == 1 {
            file.push(100);
        }
        file.extend_from_slice(&[0; 4]);
        file.extend_from_slice(content);
    }
    repair(&file).unwrap_or(file)
}

/// The same sections with right checksums and a directory that fits; `None` where there are none.
pub fn repair(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut out = bytes.get(..12)?.to_vec();
    let (mut headers, mut count, mut at, mut views) = (Vec::new(), 0u8, 12, Vec::new());
    while count < 100 && bytes.get(at..at + 4).is_some_and(|tag| tag != b"DRCT") {
        let codec = *bytes.get(at + 4)?;
        let (stored, mut end) = varint(bytes, at + 5)?;
        if codec == 1 {
            end = varint(bytes, end)?.1;
        }
        let content = end + 4;
        let after = content.checked_add(usize::try_from(stored).ok()?)?;
        let stored = bytes.get(content..after)?;
        let mut content = stored.to_vec();
        match &bytes[at..at + 4] {
            b"VIEW" => {
                let section = internals::views::decode(&content, &Budget::new(Limits::default()));
                views = section.map_or(Vec::new(), |section| section.views);
            }
            b"PLAN" => {
                repair_planes(&mut content, &views);
            }
            _ => {}
        }
        let header = &bytes[at..end];
        let checksum = crc32fast::hash(&[header, &content].concat()).to_le_bytes();
        for piece in [header, &checksum] {
            headers.extend_from_slice(piece);
            out.extend_from_slice(piece);
        }
        out.extend(content);
        count += 1;
        at = after;
    }
    let directory = [b"DRCT", &[count][..], &headers].concat();
    let checksum = crc32fast::hash(&[&out[..12], &directory].concat());
    out.extend_from_slice(&directory);
    out.extend(checksum.to_le_bytes());
    out.extend((directory.len() as u32 + 4).to_le_bytes());
    out.extend(*b"YST\xe8");
    Some(out)
}

/// The head's checksum and those of the steps and their tiles, as far as the head can be read.
pub fn repair_planes(section: &mut [u8], views: &[View]) -> Option<()> {
    let length = u32::from_le_bytes(section.get(..4)?.try_into().ok()?) as usize;
    let behind = 8usize.checked_add(length)?;
    section.get(8..behind)?;
    repair_streams(section, views, behind);
    let checksum = crc32fast::hash(&section[8..behind]).to_le_bytes();
    section[4..8].copy_from_slice(&checksum);
    Some(())
}

fn repair_streams(section: &mut [u8], views: &[View], mut offset: usize) -> Option<()> {
    let level = section.get(8)? >> 1 & 3;
    let (side, head) = if level > 0 { (*section.get(9)?, 10) } else { (8, 9) };
    let components = *section.get(head)? as usize;
    let (count, mut at) = varint(section, head + 1 + 25 * components)?;
    for _ in 0..count.min(1000) {
        let (view, scale) = varint(section, at)?;
        let parent = scale + 1;
        let references = varint(section, parent)?.1;
        at = references + 1;
        for _ in 0..*section.get(references)? {
            at = varint(section, at)?.1 + 1;
        }
        // The base, and then the tiles, whose checksums are only there if they are not empty.
        let camera = views.get(view as usize).map(|view| view.camera).unwrap_or_default();
        let tiles =
            TileGrid::new([camera.width as usize, camera.height as usize], level, side.clamp(4, 12)).tile_count();
        for part in 0..=tiles.min(1 << 16) {
            let start = offset;
            for _ in 0..components + (part == 0) as usize {
                let (size, next) = varint(section, at)?;
                offset = offset.checked_add(usize::try_from(size).ok()?)?;
                at = next;
            }
            if part == 0 || offset > start {
                let checksum = crc32fast::hash(section.get(start..offset)?).to_le_bytes();
                section.get_mut(at..at + 4)?.copy_from_slice(&checksum);
                at += 4;
            }
        }
    }
    Some(())
}
