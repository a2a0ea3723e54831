//! Pairs of directions out of text.

use super::measured::rows::{NumberReader, TextTable};
use super::measured::{row_directions, unit_vector};
use crate::error::{Error, Result};
use crate::input::escaped;
use std::path::Path;

/// Unit vectors to the light and to the viewer, z along the normal.
pub type DirectionPair = ([f64; 3], [f64; 3]);

/// Reads rows of directions: `wi_x,wi_y,wi_z,wo_x,wo_y,wo_z`, vectors of any length. A first row of names may say otherwise: angles
/// `theta_i,phi_i,theta_o,phi_o` in degrees, other columns, which are skipped, another order, as
/// [`MeasuredSamples`](super::MeasuredSamples) reads them. Empty rows and rows that begin with # are skipped; `path` is how errors call the text.
/// # Errors
/// [`Error::Input`] with the line where a row is not six numbers, or a vector has no length.
pub fn parse_directions(text: &str, path: &Path) -> Result<Vec<DirectionPair>> {
    if let Some(pairs) = named_directions(text, path)? {
        return Ok(pairs);
    }
    let mut pairs = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        let heading = number == 0 && line.starts_with(|c: char| c.is_alphabetic());
        if line.is_empty() || line.starts_with('#') || heading {
            continue;
        }
        pairs.push(parse_row(line).map_err(|what| Error::input(path, format!("line {}: {what}", number + 1)))?);
    }
    Ok(pairs)
}

/// Directions of a table whose first row names columns that are known; `None` for another text.
fn named_directions(text: &str, path: &Path) -> Result<Option<Vec<DirectionPair>>> {
    let fault = |(line, what): (usize, String)| Error::input(path, format!("line {line}: {what}"));
    let Some(table) = TextTable::new(text).ok().filter(|table| table.layout.knows_some()) else { return Ok(None) };
    table.layout.check_directions().map_err(|what| fault((table.names_line, what)))?;
    let (mut numbers, mut pairs) = (NumberReader::default(), Vec::new());
    for (line, cells) in table.rows() {
        table.check_row(&cells).map_err(|what| fault((line, what)))?;
        let mut read = |column: usize| numbers.read(cells.get(column).map_or("", |cell| cell), line);
        pairs.push(row_directions(&table.layout, &mut read, &mut 0.0).map_err(|what| fault((line, what)))?);
    }
    numbers.finish().map_err(fault)?;
    Ok(Some(pairs))
}

fn parse_row(line: &str) -> std::result::Result<DirectionPair, String> {
    let number = |part: &str| match part.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(format!("'{}' is not a number", escaped(part.trim()))),
    };
    // One more than the six tells that there are too many.
    let numbers: Vec<f64> = line.split(',').take(7).map(number).collect::<std::result::Result<_, _>>()?;
    let &[a, b, c, d, e, f] = numbers.as_slice() else {
        let more = if numbers.len() > 6 { " or more" } else { "" };
        return Err(format!("{}{more} numbers, 6 expected: wi_x,wi_y,wi_z,wo_x,wo_y,wo_z", numbers.len()));
    };
    Ok((unit_vector([a, b, c])?, unit_vector([d, e, f])?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_unit_vectors() {
        let text = "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z\n# a comment\n\n3, 0, 4, 0,0,2\n1e300,0,0, 0,-1e-11,0\n";
        let pairs = parse_directions(text, Path::new("a.csv")).unwrap();
        let angles = "theta_o;phi_o;rank;theta_i;phi_i\n0;0;7;36,86989764584402;180\n";
        let pair = parse_directions(angles, Path::new("a.csv")).unwrap()[0];
        assert!((pair.0[0] + 0.6).abs() < 1e-12 && pair.0[1].abs() < 1e-12 && pair.1 == [0.0, 0.0, 1.0], "{pair:?}");
        assert_eq!(pairs, [([0.6, 0.0, 0.8], [0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0])]);
    }

    #[test]
    fn faults_name_the_line() {
        let fault = |text: &str| parse_directions(text, Path::new("a.csv")).unwrap_err().to_string();
        assert_eq!(fault("1,2,3,4,5"), "a.csv: line 1: 5 numbers, 6 expected: wi_x,wi_y,wi_z,wo_x,wo_y,wo_z");
        assert_eq!(fault("#\n1,2,3,4,5,inf"), "a.csv: line 2: 'inf' is not a number");
        assert_eq!(fault("0,0,0,0,0,1"), "a.csv: line 1: a direction of length 0");
    }
}
