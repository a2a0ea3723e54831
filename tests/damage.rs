//! Damaged and hostile files.

use crate::support::encoded_sample;
use tsuya::container::{Container, verify};
use tsuya::decoder::{DecodeOptions, ViewSelection, decode};
use tsuya::{Error, Limits};

/// Runs `check` for every position of the file, over two threads.
fn for_every_byte(length: usize, check: impl Fn(usize) + Sync) {
    std::thread::scope(|scope| {
        let check = &check;
        for half in 0..2 {
            scope.spawn(move || (half..length).step_by(2).for_each(check));
        }
    });
}

#[test]
fn every_damaged_byte_is_found() {
    let bytes = &encoded_sample().bytes;
    assert!(verify(&bytes[..], Limits::default()).is_ok());
    for_every_byte(bytes.len(), |at| {
        // One bit, another for each byte, and all bits.
        for change in [1 << (at % 8), 0xff] {
            let mut damaged = Damaged { bytes, at, change, position: 0 };
            assert!(verify(&mut damaged, Limits::default()).is_err(), "byte {at} changed by {change:#x}");
        }
    });
}

/// The file with one byte changed, without a copy of it.
struct Damaged<'a> {
    bytes: &'a [u8],
    at: usize,
    change: u8,
    position: usize,
}

impl std::io::Read for Damaged<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = buffer.len().min(self.bytes.len() - self.position);
        buffer[..count].copy_from_slice(&self.bytes[self.position..self.position + count]);
        if let Some(byte) = self.at.checked_sub(self.position).and_then(|at| buffer[..count].get_mut(at)) {
            *byte ^= self.change;
        }
        self.position += count;
        Ok(count)
    }
}

#[test]
fn every_truncation_is_an_error() {
    let bytes = &encoded_sample().bytes;
    for_every_byte(bytes.len(), |length| {
        assert!(verify(&bytes[..length], Limits::default()).is_err(), "{length} bytes verify");
        assert!(Container::open_slice(&bytes[..length], Limits::default()).is_err(), "{length} bytes open");
    });
    let longer = [&bytes[..], &[0]].concat();
    assert!(verify(&longer[..], Limits::default()).is_err());
    assert!(decode(&longer, &DecodeOptions::default()).is_err());
}

#[test]
fn damage_behind_the_checksums_is_an_error_or_another_picture() {
    // One view is read without the section's checksum: the decoder itself must stand it.
    let bytes = &encoded_sample().bytes;
    let file = Container::open_slice(bytes, Limits::default()).unwrap();
    let planes = *file.find(tsuya::container::Tag::PLANES).unwrap();
    let start = (planes.offset + planes.header_bytes()) as usize;
    let options = DecodeOptions { selection: ViewSelection::Views(vec![0]), ..Default::default() };
    for step in 0..40 {
        let mut damaged = bytes.clone();
        let at = start + if step < 30 { step * 5 } else { 150 + (step - 30) * planes.stored as usize / 11 };
        damaged[at] ^= 0x55;
        if let Ok(asset) = decode(&damaged, &options) {
            assert_eq!(asset.photographs.len(), 36);
        }
    }
}

#[test]
fn limits_hold() {
    let bytes = &encoded_sample().bytes;
    let with = |change: fn(&mut Limits)| {
        let mut limits = Limits::default();
        change(&mut limits);
        decode(bytes, &DecodeOptions { limits, ..Default::default() })
    };
    let enough = with(|limits| limits.memory_bytes = 512 << 20);
    assert!(enough.is_ok(), "{:?}", enough.map(|_| ()));
    for limited in [
        with(|limits| limits.memory_bytes = 0),
        with(|limits| limits.memory_bytes = 10_000),
        with(|limits| limits.memory_bytes = 1 << 20),
        with(|limits| limits.views = 35),
        with(|limits| limits.image_side = 127),
        with(|limits| limits.mesh_elements = 700),
    ] {
        assert!(matches!(limited, Err(Error::Limits { .. })), "{:?}", limited.map(|_| "decoded"));
    }
}
