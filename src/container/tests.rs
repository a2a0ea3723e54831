use super::*;
use crate::limits::{Budget, Limits};
use crate::{Error, Result};
use std::io::{Cursor, Read};

fn limits() -> Limits {
    Limits { memory_bytes: 1 << 22, ..Limits::default() }
}

fn thumbnail_bytes() -> Vec<u8> {
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x10\0\0\0\x08".to_vec();
    png.resize(90, 7);
    png
}

/// A small file with one section of every codec, and one ancillary section that no table knows, twice.
fn sample() -> Vec<u8> {
    let mut data = metadata::Metadata::default();
    data.set_units("m");
    data.set_provenance(
        "made by a test, made by a test, made by a test, made by a test, made by a test, made by a test",
    );
    let mut writer = ContainerWriter::new(Vec::new()).unwrap();
    writer.write_section(Tag::METADATA, SectionCodec::Zstd, &metadata::encode(&data).unwrap()).unwrap();
    writer
        .write_section(Tag::THUMBNAIL, SectionCodec::None, &thumbnail::encode_thumbnail(&thumbnail_bytes()).unwrap())
        .unwrap();
    writer.write_section(Tag::MESH, SectionCodec::Own, b"own bytes").unwrap();
    writer.write_section(Tag(*b"zzZz"), SectionCodec::None, b"").unwrap();
    writer.write_section(Tag(*b"zzZz"), SectionCodec::None, b"again").unwrap();
    writer.finish().unwrap()
}

fn open(bytes: &[u8]) -> Result<Container<Cursor<&[u8]>>> {
    Container::open_slice(bytes, limits())
}

#[test]
fn sections_come_back_by_directory_and_in_order() {
    let bytes = sample();
    let mut container = open(&bytes).unwrap();
    assert_eq!(container.sections().len(), 5);
    let read_for_directory = container.bytes_read();
    assert!(read_for_directory < 110, "{read_for_directory}");
    assert_eq!(container.read_section(Tag::MESH).unwrap(), b"own bytes");
    assert_eq!(container.read_range(Tag::MESH, 4, 5).unwrap(), b"bytes");
    assert_eq!(container.bytes_read(), read_for_directory + 10 + 9 + 5);
    assert!(matches!(container.read_range(Tag::MESH, 4, 6), Err(Error::Format { .. })));
    assert!(matches!(container.read_range(Tag::METADATA, 0, 1), Err(Error::Format { .. })), "compressed as a whole");
    let data = metadata::decode(&container.read_section(Tag::METADATA).unwrap(), &container.budget()).unwrap();
    assert_eq!(data.units(), Some("m"));
    let thumbnail = thumbnail::decode_thumbnail(container.read_section(Tag::THUMBNAIL).unwrap()).unwrap();
    assert_eq!((thumbnail.width, thumbnail.height), (16, 8));
    assert!(container.read_optional(Tag::PLANES).unwrap().is_none());
    let again = container.sections()[4];
    assert_eq!(container.read_content(&again).unwrap(), b"again");
    let streamed = read_stream(&bytes[..], limits()).unwrap();
    for (section, content) in &streamed {
        assert_eq!(&container.read_content(section).unwrap(), content);
    }
    assert_eq!(verify(&bytes[..], limits()).unwrap(), container.sections());
}

#[test]
fn overhead_is_small() {
    let one = |length: usize| {
        let mut writer = ContainerWriter::new(Vec::new()).unwrap();
        writer.write_section(Tag::MESH, SectionCodec::Own, &vec![1; length]).unwrap();
        writer.finish().unwrap().len() - length
    };
    let empty = ContainerWriter::new(Vec::new()).unwrap().finish().unwrap().len();
    assert_eq!(empty, 12 + 9 + 8);
    assert_eq!((one(100) - empty, one(60_000) - empty), (20, 24));
}

#[test]
fn every_changed_byte_is_found() {
    let bytes = sample();
    for at in 0..bytes.len() {
        for change in 1..=255u8 {
            let mut damaged = bytes.clone();
            damaged[at] ^= change;
            assert!(verify(&damaged[..], limits()).is_err(), "byte {at} changed by {change}");
        }
    }
}

#[test]
fn every_truncation_and_extension_is_found_and_whole_sections_are_saved() {
    let bytes = sample();
    let sections = verify(&bytes[..], limits()).unwrap();
    for length in 0..bytes.len() {
        let cut = &bytes[..length];
        assert!(
            verify(cut, limits()).is_err() && open(cut).is_err() && read_stream(cut, limits()).is_err(),
            "{length}"
        );
        let whole = sections.iter().filter(|section| section.end().unwrap() <= length as u64).count();
        match read_prefix(cut, limits()) {
            Ok(prefix) => assert!(prefix.sections.len() == whole && prefix.damage.is_some()),
            Err(_) => assert!(length < FILE_HEADER_BYTES),
        }
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(verify(&longer[..], limits()).is_err() && open(&longer).is_err());
    assert_eq!(read_prefix(&bytes[..], limits()).unwrap().sections.len(), 5);
}

#[test]
fn random_damage_never_panics() {
    let bytes = sample();
    let mut state = 1u64;
    let mut random = |bound: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % bound
    };
    for _ in 0..3000 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + random(6) {
            let at = random(damaged.len());
            damaged[at] = random(256) as u8;
        }
        damaged.truncate(bytes.len() - random(3));
        assert!(damaged == bytes || verify(&damaged[..], limits()).is_err());
        let _ = read_prefix(&damaged[..], limits());
        if let Ok(mut container) = open(&damaged) {
            for section in container.sections().to_vec() {
                let _ = container.read_content(&section);
            }
        }
    }
}

#[test]
fn versions_signatures_and_tags_are_told_apart() {
    let bytes = sample();
    for (at, value) in [(8, 1), (10, 2)] {
        let mut future = bytes.clone();
        future[at] = value;
        assert!(matches!(open(&future), Err(Error::Unsupported(_))));
        assert!(matches!(verify(&future[..], limits()), Err(Error::Unsupported(_))));
    }
    let as_text: Vec<u8> = bytes.iter().copied().filter(|byte| *byte != b'\r').collect();
    let message = open(&as_text).unwrap_err().to_string();
    assert!(message.contains("text mode"), "{message}");
    assert!(matches!(open(b""), Err(Error::Format { .. })));
    let mut writer = ContainerWriter::new(Vec::new()).unwrap();
    assert!(writer.write_section(Tag(*b"MESh"), SectionCodec::Own, b"abcd").is_err(), "unknown critical section");
    assert!(writer.write_section(Tag(*b"zzzz"), SectionCodec::Own, b"abcd").is_err(), "reserved letter");
    assert!(writer.write_section(Tag::MESH, SectionCodec::Zstd, b"abcd").is_err(), "codec not in the table");
    assert!(writer.write_section(Tag::MESH, SectionCodec::Own, b"abc").is_err(), "too short");
    writer.write_section(Tag::MESH, SectionCodec::Own, b"abcd").unwrap();
    assert!(writer.write_section(Tag::MESH, SectionCodec::Own, b"abcd").is_err(), "repeated");
    assert!(!Tag(*b"aBCd").is_critical() && Tag(*b"abCd").is_private() && Tag(*b"aBCd").is_safe_to_copy());
}

/// A file whose sections are given byte for byte, with a right directory.
fn by_hand(section: Section, stored: &[u8]) -> Vec<u8> {
    let mut section = Section { offset: FILE_HEADER_BYTES as u64, ..section };
    let mut hasher = section.hasher();
    hasher.update(stored);
    section.crc = hasher.finalize();
    let mut bytes = file_header().to_vec();
    bytes.extend_from_slice(&section.to_bytes());
    bytes.extend_from_slice(stored);
    let mut directory = [&b"DRCT\x01"[..], &section.to_bytes()].concat();
    let crc = crc32fast::hash(&[&file_header()[..], &directory].concat());
    directory.extend_from_slice(&crc.to_le_bytes());
    let length = directory.len() as u32;
    [bytes, directory, length.to_le_bytes().to_vec(), END_SIGNATURE.to_vec()].concat()
}

#[test]
fn claims_are_checked_before_memory_is_used() {
    let section =
        |tag, codec, stored, decoded| Section { tag, codec, stored: stored as u64, decoded, crc: 0, offset: 0 };
    let frame = zstd::bulk::compress(&vec![b' '; 1 << 16], 3).unwrap();
    // Right, as a control; then a wrong claim above and below; then beyond the table and beyond the budget.
    let make = |decoded| by_hand(section(Tag(*b"zzZz"), SectionCodec::Zstd, frame.len(), decoded), &frame);
    assert!(verify(&make(1 << 16)[..], limits()).is_ok());
    for claim in [1 << 20, (1 << 16) + 1, (1 << 16) - 1, 0] {
        assert!(matches!(verify(&make(claim)[..], limits()), Err(Error::Format { .. })), "{claim}");
    }
    assert!(matches!(verify(&make(1 << 30)[..], limits()), Err(Error::Limits { .. })));
    assert!(matches!(open(&make(1 << 41)), Err(Error::Format { .. })));
    // Two frames, and a frame with a byte after it.
    for extra in [&frame[..], b"x"] {
        let long = [&frame[..], extra].concat();
        let file = by_hand(section(Tag(*b"zzZz"), SectionCodec::Zstd, long.len(), 1 << 16), &long);
        assert!(matches!(verify(&file[..], limits()), Err(Error::Format { .. })));
    }
    // An endless stream that claims a section of 2^40 bytes runs into the budget, not into memory.
    let endless = section(Tag(*b"zzZz"), SectionCodec::None, 1usize << 40, 1 << 40).to_bytes();
    let stream = [&file_header()[..], &endless].concat();
    let stream = Cursor::new(stream).chain(std::io::repeat(0));
    assert!(matches!(read_stream(stream, limits()), Err(Error::Limits { .. })));
    let file = by_hand(section(Tag(*b"MESh"), SectionCodec::Own, 4, 4), b"abcd");
    assert!(matches!(open(&file), Err(Error::Unsupported(_))));
    assert!(matches!(verify(&file[..], limits()), Err(Error::Unsupported(_))));
}

#[test]
fn metadata_keeps_unknown_keys_and_refuses_what_is_no_object() {
    let budget = Budget::new(limits());
    let mut data = metadata::decode(br#"{"x":[1,{"y":2}],"units":"cm"}"#, &budget).unwrap();
    let error = metadata::AchievedError { sum_psnr_db: Some(40.5), ..Default::default() };
    data.set_achieved_error(error);
    let data = metadata::decode(&metadata::encode(&data).unwrap(), &budget).unwrap();
    assert_eq!((data.units(), data.achieved_error(), data.0["x"][1]["y"].as_i64()), (Some("cm"), Some(error), Some(2)));
    let nested = [vec![b'['; 50_000], vec![b']'; 50_000]].concat();
    for bad in [&b""[..], b"[]", b"{", b"{}x", b"{\"a\":\xff}", b"1", &nested] {
        assert!(metadata::decode(bad, &budget).is_err());
    }
    let long = format!("{{\"a\":\"{}\"}}", "x".repeat(100_000));
    assert!(matches!(metadata::decode(long.as_bytes(), &budget), Err(Error::Limits { .. })));
}

#[test]
fn thumbnails_have_bounded_sides() {
    let good = thumbnail_bytes();
    assert!(thumbnail::decode_thumbnail(good.clone()).is_ok());
    for length in 0..24 {
        assert!(thumbnail::decode_thumbnail(good[..length].to_vec()).is_err());
    }
    for at in [16, 20] {
        let mut wide = good.clone();
        wide[at] = 1;
        assert!(thumbnail::decode_thumbnail(wide).is_err());
    }
}

/// Gives what is asked for, in small and overlapping pieces, until an operation has it.
fn arrive<T>(
    file: &mut IncrementalReader,
    bytes: &[u8],
    mut what: impl FnMut(&mut IncrementalReader) -> Result<Poll<T>>,
) -> (T, usize) {
    let mut given = 0;
    loop {
        let ranges = match what(file).unwrap() {
            Poll::Ready(value) => return (value, given),
            Poll::NeedRanges(ranges) => ranges,
        };
        assert!(!ranges.is_empty());
        for range in ranges {
            let end = (range.end as usize).min(bytes.len());
            let middle = (range.start as usize + end) / 2;
            for part in [middle.saturating_sub(3)..end, range.start as usize..middle] {
                file.feed(part.start as u64, &bytes[part.clone()]).unwrap();
                given += part.len();
            }
            if range.end as usize > bytes.len() {
                file.set_length(bytes.len() as u64);
            }
        }
    }
}

#[test]
fn a_file_arrives_in_ranges_or_from_its_start() {
    let bytes = sample();
    let whole = read_stream(&bytes[..], limits()).unwrap();
    // By the directory, and where the length is not known yet from one section to the next.
    for (length, is_seekable) in [(Some(bytes.len() as u64), true), (Some(bytes.len() as u64), false), (None, false)] {
        let mut file = IncrementalReader::new(length, is_seekable, limits());
        let (mesh, given) = arrive(&mut file, &bytes, |file| file.content(Tag::MESH));
        assert_eq!(mesh.unwrap(), b"own bytes");
        assert!(given < bytes.len(), "{given} of {}", bytes.len());
        assert_eq!(file.sections().1, is_seekable);
        let (data, _) = arrive(&mut file, &bytes, |file| file.content(Tag::METADATA));
        assert_eq!(data.as_ref(), Some(&whole[0].1));
        assert_eq!(arrive(&mut file, &bytes, |file| file.content(Tag::LIGHT)).0, None);
        let (sections, is_complete) = file.sections();
        assert!(is_complete && sections.iter().eq(whole.iter().map(|(section, _)| section)));
        arrive(&mut file, &bytes, |file| file.verify());
        assert_eq!(file.feed(bytes.len() as u64, b"x").is_err(), length.is_some());
    }
    // One byte at a time from the start: never a wrong answer, and right as soon as all is there.
    let mut file = IncrementalReader::new(None, false, limits());
    for (at, byte) in bytes.iter().enumerate() {
        match file.content(Tag::MESH).unwrap() {
            Poll::Ready(content) => assert_eq!(content.unwrap(), b"own bytes"),
            Poll::NeedRanges(ranges) => assert!(ranges.iter().all(|range| range.start >= at as u64)),
        }
        file.feed(at as u64, &[*byte]).unwrap();
    }
    assert_eq!(file.content(Tag::MESH).unwrap(), Poll::Ready(Some(b"own bytes".to_vec())));
}

#[test]
fn an_incremental_reader_finds_every_damage() {
    let bytes = sample();
    let complaint = |bytes: &[u8], is_seekable: bool| {
        let mut file = IncrementalReader::new(Some(bytes.len() as u64), is_seekable, limits());
        file.feed(0, bytes).unwrap();
        match file.verify() {
            Ok(Poll::Ready(())) => None,
            Ok(Poll::NeedRanges(ranges)) => panic!("all is there, yet {ranges:?} are asked for"),
            Err(error) => Some(error),
        }
    };
    for is_seekable in [true, false] {
        assert!(complaint(&bytes, is_seekable).is_none());
        for cut in 0..bytes.len() {
            assert!(matches!(complaint(&bytes[..cut], is_seekable), Some(Error::Format { .. })), "{cut}");
        }
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                assert!(complaint(&damaged, is_seekable).is_some(), "bit {bit} of byte {at}");
            }
        }
    }
    let mut small = IncrementalReader::new(None, true, Limits { memory_bytes: 100, ..Limits::default() });
    assert!(matches!(small.feed(0, &bytes[..101]), Err(Error::Limits { .. })));
}
