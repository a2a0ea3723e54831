//! ArUco markers, and ARToolKit's barcodes: the bits of squares, compared with the dictionaries.

use super::MarkerFamily;
use super::detection::{MarkerDetection, area};
use super::squares::{bilinear, turned, unit_square_to};
use crate::image::Grid;
use aruco_rs::core::dictionary::{DICTIONARY_ARUCO, DICTIONARY_ARUCO_MIP_36H12};
use std::borrow::Cow;

/// Codes, bits along a side, and how many may be read wrongly: fewer than half the least distance between codes, and few enough that hardly
/// any other square is taken for one.
pub(super) struct ArucoCodes {
    family: MarkerFamily,
    codes: Cow<'static, [u64]>,
    side: usize,
    most_wrong: u32,
    /// Width of the black border, in cells.
    border: f64,
}

/// The codes of ARToolKit's barcodes of 3 x 3 cells: the upper and the lower left one are black, the lower right one is white, and the other six
/// are the bits of the number by rows, the highest first, 1 for black.
fn barcodes() -> Vec<u64> {
    const CORNERS: [usize; 3] = [0, 6, 8];
    let cell = |number: u64, k: usize| match k {
        0 | 6 => 0,
        8 => 1,
        _ => 1 ^ (number >> (5 - (k - CORNERS.iter().filter(|&&corner| corner < k).count())) & 1),
    };
    (0..64).map(|number| (0..9).fold(0, |code, k| code << 1 | cell(number, k))).collect()
}

impl ArucoCodes {
    /// Of a family; `None` for those that are no ArUco markers.
    pub(super) fn new(family: MarkerFamily) -> Option<Self> {
        let (codes, side, most_wrong) = match family {
            MarkerFamily::Aruco => (DICTIONARY_ARUCO.code_list.into(), 5, 0),
            MarkerFamily::ArucoMip36h12 => (DICTIONARY_ARUCO_MIP_36H12.code_list.into(), 6, 4),
            MarkerFamily::ArucoOpenCv(dictionary) => {
                (dictionary.codes().into(), dictionary.side(), dictionary.corrected_bits())
            }
            MarkerFamily::ArToolKitBarcode => (barcodes().into(), 3, 0),
            _ => return None,
        };
        // The barcode takes half of the side.
        let border = if family == MarkerFamily::ArToolKitBarcode { 1.5 } else { 1.0 };
        Some(ArucoCodes { family, codes, side, most_wrong, border })
    }
}

/// Markers of these families among the squares of an image, the larger ones first.
pub(super) fn detect(families: &[ArucoCodes], grey: &Grid<u8>, squares: &[[[f64; 2]; 4]]) -> Vec<MarkerDetection> {
    let of_square = |&corners| families.iter().filter_map(move |family| decode(family, grey, corners));
    let mut found: Vec<MarkerDetection> = squares.iter().flat_map(of_square).collect();
    // The same marker has contours inside and outside.
    found.sort_by(|a, b| area(b).total_cmp(&area(a)));
    found
}

/// Reads the bits of a square whose corners go clockwise; the marker's own upper left corner first in what is given back.
fn decode(family: &ArucoCodes, grey: &Grid<u8>, corners: [[f64; 2]; 4]) -> Option<MarkerDetection> {
    let &ArucoCodes { family, ref codes, side, most_wrong, border: border_cells } = family;
    let cells = side + (2.0 * border_cells) as usize;
    let map = unit_square_to(corners)?;
    let mean = |column: f64, row: f64| -> Option<f64> {
        let offsets = [-0.2, 0.0, 0.2];
        let places = offsets.iter().flat_map(|dy| offsets.iter().map(move |dx| (column + dx, row + dy)));
        let mut sum = 0.0;
        for (x, y) in places {
            sum += bilinear(grey, map(x / cells as f64, y / cells as f64))?;
        }
        Some(sum / 9.0)
    };
    let middle = |k: usize| k as f64 + 0.5;
    let within = |k: usize| middle(k) + border_cells;
    let border: Vec<f64> = (0..cells * cells)
        .filter(|k| [0, cells - 1].contains(&(k % cells)) || [0, cells - 1].contains(&(k / cells)))
        .map(|k| mean(middle(k % cells), middle(k / cells)))
        .collect::<Option<_>>()?;
    let values: Vec<f64> = (0..side * side).map(|k| mean(within(k % side), within(k / side))).collect::<Option<_>>()?;
    let black = border.iter().sum::<f64>() / border.len() as f64;
    let darkest = border.iter().copied().fold(0.0, f64::max);
    let white = values.iter().copied().fold(0.0, f64::max);
    let threshold = 0.5 * (black + white);
    if white - black < 30.0 || darkest > threshold {
        return None;
    }
    let bits: Vec<bool> = values.iter().map(|&v| v > threshold).collect();
    let mut best: Option<(u32, usize, usize)> = None;
    for turn in 0..4 {
        let code = (0..side * side).fold(0u64, |code, k| (code << 1) | bits[turned(turn, side, k)] as u64);
        for (id, known) in codes.iter().enumerate() {
            let wrong = (known ^ code).count_ones();
            if wrong <= most_wrong && best.is_none_or(|(least, ..)| wrong < least) {
                best = Some((wrong, id, turn));
            }
        }
    }
    let (_, id, turn) = best?;
    Some(MarkerDetection { family, id: id as u32, corners: std::array::from_fn(|k| corners[(k + turn) % 4]) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::marker::squares::find_squares;

    #[test]
    fn drawn_markers_of_every_dictionary_are_found() {
        for &(family, name) in &MarkerFamily::NAMES {
            let Some(codes) = ArucoCodes::new(family) else { continue };
            let (side, number) = (codes.side, codes.codes.len() - 3);
            let (cell, margin) = (12, 30);
            let border = (codes.border * cell as f64) as usize;
            let marker = side * cell + 2 * border;
            let mut grey = Grid::filled(marker + 2 * margin, marker + 2 * margin, 230u8);
            for y in 0..marker {
                for x in 0..marker {
                    let inside = |at: usize| (border..border + side * cell).contains(&at);
                    let bit = |row: usize, column: usize| {
                        codes.codes[number] >> (side * side - 1 - row * side - column) & 1 == 1
                    };
                    let white = inside(x) && inside(y) && bit((y - border) / cell, (x - border) / cell);
                    *grey.value_at_mut(margin + x, margin + y) = if white { 230 } else { 25 };
                }
            }
            let found = detect(&[codes], &grey, &find_squares(&grey));
            assert!(found.iter().any(|m| (m.family, m.id) == (family, number as u32)), "{name}: {found:?}");
            let [x, y] = found[0].corners[0];
            assert!((x - margin as f64).abs() < 0.3 && (y - margin as f64).abs() < 0.3, "{name}: {found:?}");
            assert_eq!(MarkerFamily::from_name(name).unwrap(), family);
        }
        // The bits of number 5 are 000101: the fourth and the last of the six cells are black, and two corners.
        assert_eq!(barcodes()[5], 0b011_101_001, "{:09b}", barcodes()[5]);
        assert_eq!(MarkerFamily::from_name("DICT_6X6_250").unwrap().name(), "aruco-6x6-250");
        assert_eq!(MarkerFamily::from_name("DICT_APRILTAG_36h11").unwrap(), MarkerFamily::Tag36h11);
    }
}
