//! Heads there and back, and damaged ones.

use crate::limits::Limits;
use crate::predictive::header::*;
use crate::views::Camera;

/// Views of 300 x 200 pixels: with tiles of 64 coefficients 2 x 1 at level 2 and 3 x 2 at level 1.
fn views(count: usize) -> Vec<View> {
    let camera = Camera { width: 300, height: 200, ..Camera::default() };
    (0..count).map(|k| View { name: k.to_string(), camera, light: None }).collect()
}

fn header() -> PlaneHeader {
    let component = ComponentCoding {
        step: 0.03,
        shrink: [20, 6],
        rotation: [[16384, 0, 0], [0, 16384, 0], [0, 0, -16384]],
        signed: false,
        shaded: true,
    };
    let tile = |index: u8| CodedTile {
        level: if index < 2 { 2 } else { 1 },
        lengths: if [0, 3, 6].contains(&index) { vec![0, 0] } else { vec![index as u32, 1000] },
        checksum: if [0, 3, 6].contains(&index) { 0 } else { 0x0bad_cafe },
    };
    let step = |view, references, parent, offset| CodedEntry {
        entry: OrderEntry { view, references, parent },
        scale: 64,
        lengths: vec![3, 200, 70_000],
        checksum: 0xdead_beef,
        tiles: (0..8).map(tile).collect(),
        offset,
    };
    PlaneHeader {
        coding: PlaneCoding {
            components: vec![component; 2],
            masks: MaskCoding::Coded,
            prediction_level: 2,
            modelling: Modelling::Direct,
            is_modelled: true,
            tile_side_log2: 6,
        },
        entries: vec![
            step(0, vec![], None, 0),
            step(2, vec![], Some(0), 75_222),
            step(1, vec![(0, 128), (2, 127)], Some(0), 150_444),
        ],
    }
}

#[test]
fn comes_back_and_every_damage_is_an_error() {
    let budget = Budget::new(Limits::default());
    let bytes = header().to_bytes();
    assert_eq!(PlaneHeader::parse(&bytes, &views(3), 2, &budget).unwrap(), header());
    for length in 0..bytes.len() {
        assert!(PlaneHeader::parse(&bytes[..length], &views(3), 2, &budget).is_err());
    }
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        assert!(PlaneHeader::parse(&damaged, &views(3), 2, &budget).is_err(), "byte {at}");
    }
    assert!(PlaneHeader::parse(&bytes, &views(4), 2, &budget).is_err());
    assert!(PlaneHeader::parse(&bytes, &views(3), 1, &budget).is_err());
}

#[test]
fn the_streams_of_coarse_levels_come_first() {
    let entry = &header().entries[0];
    assert_eq!([0, 1, 2, 5].map(|level| entry.stream_bytes_above(level)), [75_222, 71_204, 70_203, 70_203]);
    let mut untiled = header();
    (untiled.coding.prediction_level, untiled.coding.tile_side_log2) = (0, DEFAULT_TILE_SIDE_LOG2);
    for (index, entry) in untiled.entries.iter_mut().enumerate() {
        (entry.tiles, entry.offset) = (Vec::new(), 70_203 * index as u64);
    }
    let bytes = untiled.to_bytes();
    assert_eq!(PlaneHeader::parse(&bytes, &views(3), 2, &Budget::new(Limits::default())).unwrap(), untiled);
}

/// A head may claim no more tiles than it has bytes for.
#[test]
fn tiles_that_are_not_there_take_no_memory() {
    let mut vast = views(3);
    (vast[0].camera.width, vast[0].camera.height) = (1 << 30, 1 << 30);
    let budget = Budget::new(Limits::default());
    let before = budget.left();
    let error = PlaneHeader::parse(&header().to_bytes(), &vast, 2, &budget).unwrap_err();
    assert!(error.to_string().contains("tiles in"), "{error}");
    assert!(before - budget.left() < 10_000);
}

#[test]
fn a_coding_of_later_versions_is_named() {
    let unsupported = |at: usize, value: u8| {
        let mut bytes = header().to_bytes();
        bytes[PREFIX_BYTES + at] = value;
        let checksum = crc32fast::hash(&bytes[PREFIX_BYTES..]);
        LittleEndian::write_u32(&mut bytes[4..8], checksum);
        let error = PlaneHeader::parse(&bytes, &views(3), 2, &Budget::new(Limits::default())).unwrap_err();
        assert!(matches!(&error, Error::Unsupported(what) if what.contains("PLAN")), "{value}: {error}");
    };
    [32, 128].into_iter().for_each(|coding| unsupported(0, coding));
    [0, 3, 13, 255].into_iter().for_each(|side| unsupported(1, side));
}

#[test]
fn a_view_may_not_come_twice() {
    let mut twice = header();
    twice.entries[2].entry.view = 0;
    let error = PlaneHeader::parse(&twice.to_bytes(), &views(3), 2, &Budget::new(Limits::default())).unwrap_err();
    assert!(error.to_string().contains("comes twice"), "{error}");
}
