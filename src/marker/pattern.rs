//! ARToolKit's markers: black squares with any picture within, which is compared with pattern files (Kato and Billinghurst 1999).

use super::MarkerFamily;
use super::detection::{MarkerDetection, area};
use super::squares::{bilinear, turned, unit_square_to};
use crate::error::{Error, Result};
use crate::image::Grid;
use crate::input::{FileAccess, quoted};
use std::path::Path;

/// Bytes of a pattern file, at most.
const MAX_BYTES: u64 = 1 << 20;
/// Cells along a side of a picture.
const SIDES: std::ops::RangeInclusive<usize> = 16..=64;
/// Least correlation between the four parts of a file, turned back.
const MIN_AGREEMENT: f64 = 0.8;
/// Positions along each side of the border where it must be dark.
const BORDER_PLACES: usize = 8;
/// Least difference between the border and what is around it, of 255.
const MIN_CONTRAST: f64 = 25.0;

/// Picture of an ARToolKit marker.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerPattern {
    name: String,
    side: usize,
    border: f64,
    min_confidence: f64,
    /// Grey values of the upright print by rows, of mean 0 and norm 1.
    values: Vec<f64>,
}

impl MarkerPattern {
    /// Width of the black border over the marker's side, unless [`Self::set_border`] sets another.
    pub const BORDER: f64 = 0.25;
    /// Least normalised correlation of what is taken for the marker, unless [`Self::set_min_confidence`] sets another.
    pub const MIN_CONFIDENCE: f64 = 0.6;

    /// Reads a pattern file: `4 * 3 * N * N` numbers from 0 to 255 as text, N 16 to 64. These are blue, green and red, each by rows, of the
    /// picture upright and turned counter-clockwise by one, two and three quarters. Colours are compared as grey values.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] with the line of what is wrong.
    pub fn read(path: impl AsRef<Path>, access: &FileAccess) -> Result<Self> {
        let path = path.as_ref();
        let text = access.read_text(path, "marker pattern (ARToolKit)", MAX_BYTES)?;
        let _held = access.reserve(path, "marker pattern", 2 * text.len() as u64)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        parse(&text)
            .map(|(side, values)| MarkerPattern {
                name,
                side,
                border: Self::BORDER,
                min_confidence: Self::MIN_CONFIDENCE,
                values,
            })
            .map_err(|message| Error::input(path, message))
    }

    /// Its file's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Cells along a side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Sets the width of the black border over the marker's side, 0.05 to 0.45.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for any other width.
    pub fn set_border(&mut self, border: f64) -> Result<()> {
        if !(0.05..=0.45).contains(&border) {
            return Err(Error::parameter(format!(
                "a marker's border is 0.05 to 0.45 of its side (ARToolKit's is 0.25), not {border}"
            )));
        }
        self.border = border;
        Ok(())
    }

    /// Sets the least normalised correlation, above 0 and below 1, of what is taken for the marker.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for any other number.
    pub fn set_min_confidence(&mut self, confidence: f64) -> Result<()> {
        if !(confidence > 0.0 && confidence < 1.0) {
            return Err(Error::parameter(format!(
                "a marker's least confidence is above 0 and below 1, not {confidence}"
            )));
        }
        self.min_confidence = confidence;
        Ok(())
    }

    /// The corner of a square that is the print's upper left one, and the normalised correlation there, which is the best of the four; `None` where
    /// the square has no black border or no picture.
    fn compare(&self, grey: &Grid<u8>, corners: [[f64; 2]; 4]) -> Option<(usize, f64)> {
        let map = unit_square_to(corners)?;
        let value = |x: f64, y: f64| bilinear(grey, map(x, y));
        if !has_border(value, self.border) {
            return None;
        }
        let long = |k: usize| (corners[k][0] - corners[(k + 1) % 4][0]).hypot(corners[k][1] - corners[(k + 1) % 4][1]);
        let within = 1.0 - 2.0 * self.border;
        // As many samples as pixels, about.
        let pixels = (0..4).map(long).fold(0.0, f64::max) * within / self.side as f64;
        let samples = pixels.ceil().clamp(1.0, 4.0) as usize;
        let step = within / (self.side * samples) as f64;
        let mut seen = vec![0.0; self.side * self.side];
        for row in 0..self.side * samples {
            for column in 0..self.side * samples {
                let at = |k: usize| self.border + step * (k as f64 + 0.5);
                seen[row / samples * self.side + column / samples] += value(at(column), at(row))?;
            }
        }
        normalise(&mut seen)?;
        let correlation = |turn: usize| {
            let values = self.values.iter().enumerate();
            (turn, values.map(|(k, value)| value * seen[turned(turn, self.side, k)]).sum::<f64>())
        };
        (0..4).map(correlation).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// Markers with these pictures among the squares of an image, each once, where it fits best; their numbers are those of the patterns.
pub(super) fn detect(patterns: &[MarkerPattern], grey: &Grid<u8>, squares: &[[[f64; 2]; 4]]) -> Vec<MarkerDetection> {
    let mut found = Vec::new();
    for (number, pattern) in patterns.iter().enumerate() {
        let mut best: Option<(f64, MarkerDetection)> = None;
        for &corners in squares {
            let Some((turn, confidence)) = pattern.compare(grey, corners) else { continue };
            let corners = std::array::from_fn(|k| corners[(k + turn) % 4]);
            let detection = MarkerDetection { family: MarkerFamily::ArToolKit, id: number as u32, corners };
            // Of contours of one square all fit alike.
            let fits = best.is_none_or(|(other, last)| {
                confidence > other + 0.02 || (confidence > other - 0.02 && area(&detection) > area(&last))
            });
            if confidence >= pattern.min_confidence && fits {
                best = Some((confidence, detection));
            }
        }
        found.extend(best.map(|(_, detection)| detection));
    }
    found
}

/// Whether the border of a square is dark all around, and brighter what is around it.
fn has_border(value: impl Fn(f64, f64) -> Option<f64>, border: f64) -> bool {
    let around = |inset: f64| -> Option<Vec<f64>> {
        let along = |k: usize| inset + (1.0 - 2.0 * inset) * (k as f64 + 0.5) / BORDER_PLACES as f64;
        let sides = |k: usize| {
            let t = along(k);
            [(t, inset), (1.0 - inset, t), (t, 1.0 - inset), (inset, t)]
        };
        (0..BORDER_PLACES).flat_map(sides).map(|(x, y)| value(x, y)).collect()
    };
    let (Some(black), Some(paper)) = (around(0.5 * border), around(-0.15 * border)) else { return false };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let brightest = black.iter().copied().fold(0.0, f64::max);
    mean(&paper) - mean(&black) >= MIN_CONTRAST && brightest < 0.5 * (mean(&black) + mean(&paper))
}

/// Brings values to mean 0 and norm 1; `None` where they are all alike.
fn normalise(values: &mut [f64]) -> Option<()> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter_mut().for_each(|v| *v -= mean);
    let norm = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    // A deviation of less than a code is no picture.
    if norm < (values.len() as f64).sqrt() {
        return None;
    }
    values.iter_mut().for_each(|v| *v /= norm);
    Some(())
}

/// Cells along a side, and normalised grey values of a pattern file.
fn parse(text: &str) -> std::result::Result<(usize, Vec<f64>), String> {
    let mut numbers: Vec<u8> = Vec::new();
    let mut last = 0;
    for (number, line) in text.lines().enumerate() {
        for word in line.split_whitespace() {
            last = number + 1;
            let value =
                word.parse().map_err(|_| format!("line {last}: {} is no whole number from 0 to 255", quoted(word)));
            numbers.push(value?);
            if numbers.len() > 12 * SIDES.end() * SIDES.end() {
                return Err(format!("line {last}: more numbers than a pattern of 64 x 64 cells has"));
            }
        }
    }
    let Some(side) = SIDES.clone().find(|side| 12 * side * side == numbers.len()) else {
        return Err(format!(
            "line {last}: the file ends after {} numbers; a pattern of N x N cells has 4 * 3 * N * N, 3072 for 16, 12288 for 32, 49152 for 64",
            numbers.len()
        ));
    };
    let cells = side * side;
    let mut values = vec![0.0; cells];
    for (turn, part) in numbers.chunks_exact(3 * cells).enumerate() {
        // Weighted as the images' grey values are.
        let grey = |k: usize| {
            let [b, g, r] = [0, 1, 2].map(|colour| f64::from(part[colour * cells + k]));
            0.25 * (b + 2.0 * g + r)
        };
        // The upper left corner of the print is the picture's lower left one after a quarter turn counter-clockwise.
        let mut upright: Vec<f64> = (0..cells).map(|k| grey(turned((4 - turn) % 4, side, k))).collect();
        normalise(&mut upright).ok_or("all cells are alike: there is nothing to find the marker by")?;
        let agreement: f64 = values.iter().zip(&upright).map(|(a, b)| a * b).sum::<f64>() / (turn as f64).max(1.0);
        if turn > 0 && agreement < MIN_AGREEMENT {
            return Err(format!("its part {} of 4 is not the first one turned counter-clockwise", turn + 1));
        }
        values.iter_mut().zip(&upright).for_each(|(sum, v)| *sum += v);
    }
    let norm = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    values.iter_mut().for_each(|v| *v /= norm);
    Ok((side, values))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of `side` cells without symmetry: an L and a dot, in colours.
    fn cell(side: usize, row: usize, column: usize) -> [u8; 3] {
        let (y, x) = (8 * row / side, 8 * column / side);
        let inked = (x == 1 && (1..7).contains(&y)) || (y == 6 && (1..5).contains(&x)) || (x, y) == (6, 1);
        if inked { [20, 40, 30] } else { [230, 220, 240] }
    }

    fn file(side: usize) -> String {
        let mut text = String::new();
        for turn in 0..4 {
            for colour in 0..3 {
                for row in 0..side {
                    for column in 0..side {
                        // Turned counter-clockwise, the upper right corner becomes the upper left one.
                        let (mut y, mut x) = (row, column);
                        for _ in 0..turn {
                            (y, x) = (x, side - 1 - y);
                        }
                        text += &format!(" {}", cell(side, y, x)[colour]);
                    }
                    text += "\n";
                }
            }
            text += "\n";
        }
        text
    }

    fn read(text: &str) -> Result<MarkerPattern> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("patt.test");
        std::fs::write(&path, text).unwrap();
        MarkerPattern::read(&path, &FileAccess::default())
    }

    #[test]
    fn patterns_of_all_sizes_are_read() {
        for side in [16, 32, 64] {
            let pattern = read(&file(side)).unwrap();
            assert_eq!((pattern.side(), pattern.name()), (side, "patt.test"));
            let dark = |row: usize, column: usize| pattern.values[row * side / 8 * side + column * side / 8] < 0.0;
            assert!(dark(1, 1) && dark(6, 4) && dark(1, 6) && !dark(0, 0) && !dark(6, 6), "{side}");
        }
    }

    #[test]
    fn damage_is_named_with_its_line() {
        let whole = file(16);
        let fault = |text: &str| read(text).unwrap_err().to_string();
        let words = whole.split_inclusive(' ');
        for length in (0..3072).step_by(61) {
            let part: String = words.clone().take(length + 1).collect();
            assert!(fault(&part).contains("the file ends after"), "{length}");
        }
        assert!(fault(&format!("{whole} 7")).contains("line 197: the file ends after 3073 numbers"));
        for word in ["256", "-1", "1.5", "ink", "\u{1b}[31m"] {
            let said = fault(&whole.replacen(" 230", &format!(" {word}"), 20));
            assert!(said.contains("is no whole number from 0 to 255") && said.contains("line 1:"), "{said}");
            assert!(!said.contains('\u{1b}'));
        }
        assert!(fault("7 ".repeat(3072).as_str()).contains("all cells are alike"));
        assert!(fault(&"1 ".repeat(49_153)).contains("more numbers"));
        let parts: Vec<&str> = whole.split("\n\n").collect();
        let mixed = [parts[0], parts[3], parts[2], parts[1]].join("\n\n");
        assert!(fault(&mixed).contains("part 2 of 4"), "{}", fault(&mixed));
        let mut pattern = read(&whole).unwrap();
        assert!(pattern.set_border(0.5).is_err() && pattern.set_border(f64::NAN).is_err());
        assert!(pattern.set_min_confidence(1.0).is_err() && pattern.set_min_confidence(0.9).is_ok());
    }
}
