//! Columns of a table of measurements, by the names in its first row.

use super::spectrum::{MAX_WAVELENGTH, MIN_WAVELENGTH};
use crate::input::quoted;
use std::f64::consts::PI;

/// Columns of the same names, `None` for those that are not there.
type Indices<const N: usize> = [Option<usize>; N];

/// Columns of a table: where directions, values and noise stand.
#[derive(Debug, Clone, Default, PartialEq)]
pub(in crate::brdf) struct ColumnLayout {
    /// `wi_x`, `wi_y`, `wi_z`, `wo_x`, `wo_y`, `wo_z`.
    pub vectors: Indices<6>,
    /// `theta_i`, `phi_i`, `theta_o`, `phi_o`, with the factor that makes them radians.
    pub angles: [Option<(usize, f64)>; 4],
    /// `theta_h`, `theta_d`, `phi_d`, likewise.
    pub half_difference: [Option<(usize, f64)>; 3],
    /// `r`, `g`, `b`.
    pub colours: Indices<3>,
    /// One value for all channels.
    pub single: Option<usize>,
    /// Wavelengths in nanometres, ascending, and their columns.
    pub spectrum: Vec<(f64, usize)>,
    /// Relative standard deviation, with the factor that makes it a part of 1.
    pub relative_noise: Option<(usize, f64)>,
    /// Standard deviation, per steradian.
    pub noise: Option<usize>,
    /// Columns of names that mean nothing here.
    pub unknown: Vec<String>,
    /// Number of columns.
    pub count: usize,
}

const DEGREES: f64 = PI / 180.0;

/// Names of the columns of vectors, angles, angles of the half vector, and colours.
const VECTORS: [[&str; 3]; 6] = [
    ["wi_x", "wix", "incoming_x"],
    ["wi_y", "wiy", "incoming_y"],
    ["wi_z", "wiz", "incoming_z"],
    ["wo_x", "wox", "outgoing_x"],
    ["wo_y", "woy", "outgoing_y"],
    ["wo_z", "woz", "outgoing_z"],
];
const ANGLES: [[&str; 5]; 4] = [
    ["theta_i", "thetai", "theta_in", "theta_incoming", "incoming_theta"],
    ["phi_i", "phii", "phi_in", "phi_incoming", "incoming_phi"],
    ["theta_o", "thetao", "theta_out", "theta_outgoing", "outgoing_theta"],
    ["phi_o", "phio", "phi_out", "phi_outgoing", "outgoing_phi"],
];
/// Names of the reflected direction where it is called so.
const REFLECTED: [[&str; 3]; 2] = [["theta_r", "theta_s", "theta_v"], ["phi_r", "phi_s", "phi_v"]];
const HALF_DIFFERENCE: [&str; 3] = ["theta_h", "theta_d", "phi_d"];
const COLOURS: [[&str; 3]; 3] = [["r", "red", "brdf_r"], ["g", "green", "brdf_g"], ["b", "blue", "brdf_b"]];
/// A column of plans, of no meaning for a fit.
const PLAN_COLUMN: &str = "rank";

/// Unit that a column's name states.
#[derive(Debug, Clone, Copy, PartialEq)]
enum ColumnUnit {
    Unstated,
    Degrees,
    Radians,
    Percent,
}

impl ColumnLayout {
    /// Finds the columns. Names may be in small or capital letters and state a unit, as in `theta_i (deg)`, `phi_o_rad` or `450 nm`.
    /// # Errors
    /// A sentence where a name is there twice.
    pub(in crate::brdf) fn from_names<'a>(names: impl Iterator<Item = &'a str>) -> Result<Self, String> {
        let mut layout = ColumnLayout::default();
        for (index, written) in names.enumerate() {
            layout.count = index + 1;
            let (name, unit) = plain_name(written);
            if name.is_empty() || name == PLAN_COLUMN {
                continue;
            }
            let angle = if unit == ColumnUnit::Radians { 1.0 } else { DEGREES };
            let place = |list: &[&[&str]]| list.iter().position(|names| names.contains(&name.as_str()));
            let vectors = VECTORS.each_ref().map(|names| &names[..]);
            let angles = ANGLES.each_ref().map(|names| &names[..]);
            let reflected = REFLECTED.each_ref().map(|names| &names[..]);
            let colours = COLOURS.each_ref().map(|names| &names[..]);
            let wavelength = name.trim_start_matches(|c: char| c.is_alphabetic() || c == '_').parse::<f64>().ok();
            let wavelength = wavelength.filter(|&w| (MIN_WAVELENGTH..=MAX_WAVELENGTH).contains(&w));
            let prefix = name.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
            let is_wavelength = ["", "nm", "nm_", "l", "l_", "w", "w_", "lambda", "lambda_", "wavelength_"];
            let twice = if let Some(k) = place(&vectors) {
                layout.vectors[k].replace(index).is_some()
            } else if let Some(k) = place(&angles).or(place(&reflected).map(|k| k + 2)) {
                layout.angles[k].replace((index, angle)).is_some()
            } else if let Some(k) = HALF_DIFFERENCE.iter().position(|known| *known == name) {
                layout.half_difference[k].replace((index, angle)).is_some()
            } else if let Some(k) = place(&colours) {
                layout.colours[k].replace(index).is_some()
            } else if ["value", "brdf", "f", "f_r", "fr"].contains(&name.as_str()) {
                layout.single.replace(index).is_some()
            } else if ["sigma", "relative_noise", "noise_relative"].contains(&name.as_str()) {
                let factor = if unit == ColumnUnit::Percent { 0.01 } else { 1.0 };
                layout.relative_noise.replace((index, factor)).is_some()
            } else if ["noise", "deviation", "stddev", "std"].contains(&name.as_str()) {
                layout.noise.replace(index).is_some()
            } else if let Some(wavelength) = wavelength.filter(|_| is_wavelength.contains(&prefix)) {
                let known = layout.spectrum.iter().any(|&(other, _)| other == wavelength);
                layout.spectrum.push((wavelength, index));
                known
            } else {
                layout.unknown.push(written.trim().to_owned());
                false
            };
            if twice {
                return Err(format!("two columns are called {}", quoted(written.trim())));
            }
        }
        layout.spectrum.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(layout)
    }

    /// Returns `true` where some name was known.
    pub(in crate::brdf) fn knows_some(&self) -> bool {
        self.vectors.iter().chain(&self.colours).any(Option::is_some)
            || self.angles.iter().any(Option::is_some)
            || self.half_difference.iter().any(Option::is_some)
            || self.single.is_some()
            || !self.spectrum.is_empty()
    }

    /// Checks that directions are there.
    /// # Errors
    /// A sentence that names the columns that are missing.
    pub(in crate::brdf) fn check_directions(&self) -> Result<(), String> {
        let complete = self.vectors.iter().all(Option::is_some)
            || self.angles.iter().all(Option::is_some)
            || self.half_difference.iter().all(Option::is_some);
        if complete {
            return Ok(());
        }
        let missing = |names: &[&str], there: &[bool]| {
            let missing: Vec<&str> = names.iter().zip(there).filter(|(_, there)| !**there).map(|(n, _)| *n).collect();
            (there.contains(&true)).then(|| format!("of the directions {} is missing", missing.join(", ")))
        };
        let vectors = missing(&VECTORS.map(|n| n[0]), &self.vectors.map(|c| c.is_some()));
        let angles = missing(&ANGLES.map(|n| n[0]), &self.angles.map(|c| c.is_some()));
        let halves = missing(&HALF_DIFFERENCE, &self.half_difference.map(|c| c.is_some()));
        Err(vectors.or(angles).or(halves).unwrap_or_else(|| {
            "no column of directions: theta_i,phi_i,theta_o,phi_o (degrees) or wi_x,wi_y,wi_z,wo_x,wo_y,wo_z".into()
        }))
    }

    /// Checks that values are there.
    /// # Errors
    /// A sentence that names the columns that are missing.
    pub(in crate::brdf) fn check_values(&self) -> Result<(), String> {
        if self.colours.iter().all(Option::is_some) || self.single.is_some() || !self.spectrum.is_empty() {
            return Ok(());
        }
        let missing = COLOURS.iter().zip(self.colours).filter(|(_, c)| c.is_none()).map(|(n, _)| n[0]);
        Err(match self.colours.iter().any(Option::is_some) {
            true => format!("of the colours {} is missing", missing.collect::<Vec<_>>().join(", ")),
            false => {
                "no column of values: r,g,b, or value, or wavelengths in nm such as 450 (BRDF per steradian)".into()
            }
        })
    }
}

/// A name in small letters without its unit.
fn plain_name(written: &str) -> (String, ColumnUnit) {
    let mut name: String = written.trim().to_lowercase();
    for (sign, word) in [('θ', "theta"), ('ϑ', "theta"), ('φ', "phi"), ('ϕ', "phi"), ('ω', "w"), ('λ', "lambda")]
    {
        name = name.replace(sign, word);
    }
    let mut unit = ColumnUnit::Unstated;
    let unit_of = |text: &str| match text.trim() {
        "deg" | "degree" | "degrees" | "°" => Some(ColumnUnit::Degrees),
        "rad" | "radian" | "radians" => Some(ColumnUnit::Radians),
        "%" | "percent" => Some(ColumnUnit::Percent),
        "nm" => Some(ColumnUnit::Unstated),
        _ => None,
    };
    if let Some((before, after)) = name.clone().split_once(['(', '[']) {
        unit = unit_of(after.trim_end_matches([')', ']'])).unwrap_or(ColumnUnit::Unstated);
        name = before.trim().to_owned();
    }
    name = name.trim().replace([' ', '-'], "_");
    for suffix in ["deg", "degrees", "rad", "radians", "percent", "%", "°", "nm"] {
        let before = name.strip_suffix(suffix).map(|before| before.trim_end_matches('_'));
        if let Some(before) = before.filter(|before| !before.is_empty()) {
            (name, unit) = (before.to_owned(), unit_of(suffix).unwrap_or(unit));
            break;
        }
    }
    (name, unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_in_any_order_and_dress_are_found() {
        let find = |text: &str| ColumnLayout::from_names(text.split(';'));
        let layout = find("B;Theta_I (deg);phi_i [rad];θ_o;phi_r_deg;sigma (%);R;lot no;g;rank").unwrap();
        assert_eq!(layout.angles.map(|a| a.unwrap().0), [1, 2, 3, 4]);
        assert_eq!(layout.angles[1], Some((2, 1.0)));
        assert_eq!((layout.colours, layout.relative_noise), ([Some(6), Some(8), Some(0)], Some((5, 0.01))));
        assert_eq!(layout.unknown, ["lot no"]);
        let layout = find("wi_x;wi_y;wi_z;wo_x;wo_y;wo_z;650nm;450;nm550;lambda_500.5").unwrap();
        assert_eq!(layout.spectrum, [(450.0, 7), (500.5, 9), (550.0, 8), (650.0, 6)]);
        layout.check_directions().and(layout.check_values()).unwrap();
        assert!(find("r;g;R").unwrap_err().contains("two columns"));
        assert!(find("theta_i;theta_o;r").unwrap().check_directions().unwrap_err().contains("phi_i, phi_o is missing"));
        assert!(find("theta_i;theta_o;r").unwrap().check_values().unwrap_err().contains("colours g, b"));
    }
}
