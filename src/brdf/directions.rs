//! Pairs of directions out of text.

use crate::error::{Error, Result};
use crate::input::escaped;
use std::path::Path;

/// Unit vectors to the light and to the viewer, z along the normal.
pub type DirectionPair = ([f64; 3], [f64; 3]);

/// Reads rows `wi_x,wi_y,wi_z,wo_x,wo_y,wo_z`, vectors of any length. A first row that begins with a letter, empty rows and rows that begin
/// with # are skipped; `path` is how errors call the text.
/// # Errors
/// [`Error::Input`] with the line where a row is not six numbers, or a vector has no length.
pub fn parse_directions(text: &str, path: &Path) -> Result<Vec<DirectionPair>> {
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
    Ok((unit([a, b, c])?, unit([d, e, f])?))
}

/// The vector of length 1; scaled first, so that no square overflows.
fn unit(v: [f64; 3]) -> std::result::Result<[f64; 3], String> {
    let largest = v.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    if largest <= 1e-12 {
        return Err("a direction of length 0".to_owned());
    }
    let scaled = v.map(|x| x / largest);
    let length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
    Ok(scaled.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_unit_vectors() {
        let text = "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z\n# a comment\n\n3, 0, 4, 0,0,2\n1e300,0,0, 0,-1e-11,0\n";
        let pairs = parse_directions(text, Path::new("a.csv")).unwrap();
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
