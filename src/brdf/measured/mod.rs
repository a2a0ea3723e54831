//! Values measured at any pairs of directions, out of text or JSON, and materials fitted to them.

pub(in crate::brdf) mod columns;
mod fit;
mod json;
mod repeats;
pub(in crate::brdf) mod rows;
mod spectrum;

pub use fit::{MeasuredFit, fit_measured};

use super::MeasuredSample;
use crate::error::{Error, Result};
use crate::input::{FileAccess, escaped, quoted};
use crate::vector::dot;
use columns::ColumnLayout;
use repeats::RawSample;
use rows::{NumberReader, TextTable, WrittenNumber};
use std::borrow::Cow;
use std::path::Path;

/// Bytes of samples, their repeats and a JSON's values for one of text, at most: the shortest row has 8, its lists some 500.
const MEMORY_FACTOR: u64 = 64;
/// Most columns of a table.
const MAX_COLUMNS: usize = 4096;
/// Values beyond this are no BRDF, per steradian.
const MAX_VALUE: f64 = 1e9;
/// Cosine of the angle by which two statements of one direction may differ: 1 degree.
const AGREEING_COSINE: f64 = 0.99985;

/// Origin of the samples' standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoiseSource {
    /// The file states them.
    Stated,
    /// Differences between repeats of the same directions.
    Repeats,
    /// Neither: [`MeasuredSamples::ASSUMED_NOISE`].
    Assumed,
}

/// Samples of one material, as a goniometer gives them.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredSamples {
    /// One for each pair of directions, in the order in which they came.
    pub samples: Vec<MeasuredSample>,
    /// Rows with a value, repeats counted.
    pub measured: usize,
    /// Rows without a value.
    pub gaps: usize,
    /// Rows with a direction that does not lie above the surface, which are left out.
    pub below_horizon: usize,
    /// Relative standard deviation of one measured value, the median over the samples.
    pub relative_noise: f64,
    /// Origin of the noise.
    pub noise_source: NoiseSource,
    /// Oddities found while reading, one sentence each.
    pub remarks: Vec<String>,
}

impl MeasuredSamples {
    /// Relative standard deviation of a value where neither the file nor repeats say more.
    pub const ASSUMED_NOISE: f64 = 0.02;
    /// Bytes of a table, at most: about half a million rows.
    pub const MAX_BYTES: u64 = 32 << 20;

    /// Reads a table of measurements: text, or JSON where it begins with `[` or `{`. See [`MeasuredSamples::from_text`].
    /// # Errors
    /// [`Error::Io`], [`Error::Limits`], and as [`MeasuredSamples::from_text`].
    pub fn read(path: impl AsRef<Path>, access: &FileAccess) -> Result<Self> {
        let path = path.as_ref();
        let text = access.read_text(path, "table of measurements", Self::MAX_BYTES)?;
        Self::from_text(&text, path, access)
    }

    /// Reads a table of measurements.
    ///
    /// The first row names the columns, in any order: directions as `wi_x,wi_y,wi_z,wo_x,wo_y,wo_z` (of any length, `z` along the normal),
    /// as `theta_i,phi_i,theta_o,phi_o` or as `theta_h,theta_d,phi_d` (degrees); values per steradian as `r,g,b` (linear), as one column
    /// `value`, or at wavelengths in nanometres (`450` or `450nm`), which become linear sRGB under illuminant D65; noise as `sigma` (relative
    /// standard deviation) or `noise` (per steradian). Cells stand apart by commas, semicolons, tabs or spaces; `#`, `%` and `//` begin
    /// comments; rows without a value are gaps; repeats of the same directions are averaged. JSON is a list of objects with these
    /// fields, or an object with such a list as `samples`. `path` is how errors call the text.
    /// # Errors
    /// [`Error::Input`] with the line where a row or name is wrong, and where no value is above the horizon; [`Error::Limits`] where the
    /// access's budget ends.
    pub fn from_text(text: &str, path: &Path, access: &FileAccess) -> Result<Self> {
        let _held = access.reserve(path, "table of measurements", MEMORY_FACTOR * text.len() as u64)?;
        if json::is_json(text) {
            let (names, rows) = json::rows(text).map_err(|what| Error::input(path, what))?;
            let place = |number: usize| format!("sample {number}");
            let layout = ColumnLayout::from_names(names.iter().map(String::as_str));
            let layout = layout.map_err(|what| Error::input(path, what))?;
            let rows = rows.into_iter().enumerate().map(|(index, cells)| Ok((index + 1, cells)));
            return gather(&layout, rows, path, "the fields", place);
        }
        let place = |number: usize| format!("line {number}");
        let fault = |(line, what): (usize, String)| Error::input(path, format!("{}: {what}", place(line)));
        let table = TextTable::new(text).map_err(fault)?;
        let rows = table.rows().map(|(line, cells)| match table.check_row(&cells) {
            Ok(()) => Ok((line, cells)),
            Err(what) => Err((line, what)),
        });
        gather(&table.layout, rows, path, &format!("line {}", table.names_line), place)
    }
}

/// Samples out of the rows of a table.
fn gather<'a>(
    layout: &ColumnLayout,
    rows: impl Iterator<Item = std::result::Result<(usize, Vec<Cow<'a, str>>), (usize, String)>>,
    path: &Path,
    names_place: &str,
    place: impl Fn(usize) -> String,
) -> Result<MeasuredSamples> {
    let wrong = |(number, what): (usize, String)| Error::input(path, format!("{}: {what}", place(number)));
    let of_names = |what: String| Error::input(path, format!("{names_place}: {what}"));
    if layout.count > MAX_COLUMNS {
        return Err(of_names(format!("{} columns, {MAX_COLUMNS} are the most", layout.count)));
    }
    layout.check_directions().and_then(|()| layout.check_values()).map_err(of_names)?;
    let values = ValueColumns::new(layout).map_err(of_names)?;
    let mut numbers = NumberReader::default();
    let mut raw: Vec<RawSample> = Vec::new();
    let (mut gaps, mut below, mut negative) = (0, 0, 0);
    let mut last_digit = f64::INFINITY;
    let mut largest_angle = 0.0f64;
    for row in rows {
        let (number, cells) = row.map_err(wrong)?;
        let fault = |what: String| wrong((number, what));
        let mut read = |column: usize| numbers.read(cells.get(column).map_or("", |cell| cell), number);
        let Some((value, digit)) = values.read(&mut read).map_err(fault)? else {
            gaps += 1;
            continue;
        };
        let (incoming, outgoing) = row_directions(layout, &mut read, &mut largest_angle).map_err(fault)?;
        let noise = noise(layout, &mut read).map_err(fault)?;
        if value.iter().any(|v| v.abs() > MAX_VALUE) {
            return Err(fault("a BRDF per steradian is no larger than 1e9".into()));
        }
        if incoming[2] <= 1e-9 || outgoing[2] <= 1e-9 {
            below += 1;
            continue;
        }
        negative += usize::from(value.iter().any(|v| *v < 0.0));
        last_digit = last_digit.min(digit);
        raw.push(RawSample { incoming, outgoing, value: value.map(|v| v.max(0.0)), noise });
    }
    numbers.finish().map_err(wrong)?;
    if raw.is_empty() {
        let message = format!("no value is above the horizon: {gaps} rows without a value, {below} below the surface");
        return Err(Error::input(path, message));
    }
    let mut remarks = values.remarks;
    if !layout.unknown.is_empty() {
        let names: Vec<String> = layout.unknown.iter().take(8).map(|name| quoted(name)).collect();
        let more = if layout.unknown.len() > names.len() { ", ..." } else { "" };
        remarks.push(format!("columns of no meaning here, not used: {}{more}", names.join(", ")));
    }
    let mut count = |count: usize, what: &str| {
        if count > 0 {
            remarks.push(format!("{count} of {} rows {what}", raw.len() + gaps + below));
        }
    };
    count(gaps, "have no value");
    count(below, "are left out: a direction is not above the surface");
    count(negative, "have a negative value, taken as 0");
    if largest_angle > 0.0 && largest_angle < 1.6 && raw.len() >= 4 {
        remarks
            .push("no angle is larger than 1.6 degrees: are they radians? name columns theta_i_rad and so on".into());
    }
    let measured = raw.len();
    let merged = repeats::merge(raw, if last_digit.is_finite() { last_digit } else { 0.0 });
    remarks.extend(merged.remark);
    Ok(MeasuredSamples {
        samples: merged.samples,
        measured,
        gaps,
        below_horizon: below,
        relative_noise: merged.relative_noise,
        noise_source: merged.source,
        remarks: remarks.into_iter().map(|remark| format!("{}: {remark}", escaped(&path.to_string_lossy()))).collect(),
    })
}

/// Reads the number of a column.
pub(in crate::brdf) type ReadColumn<'r> = dyn FnMut(usize) -> std::result::Result<Option<WrittenNumber>, String> + 'r;

/// Where values stand, with what makes colours of them.
struct ValueColumns {
    /// Column and weights in red, green, blue.
    weighted: Vec<(usize, [f64; 3])>,
    remarks: Vec<String>,
}

impl ValueColumns {
    fn new(layout: &ColumnLayout) -> std::result::Result<Self, String> {
        let mut remarks = Vec::new();
        let unit = |c: usize| [0, 1, 2].map(|k| f64::from(u8::from(k == c)));
        let weighted = if let [Some(r), Some(g), Some(b)] = layout.colours {
            vec![(r, unit(0)), (g, unit(1)), (b, unit(2))]
        } else if !layout.spectrum.is_empty() {
            let wavelengths: Vec<f64> = layout.spectrum.iter().map(|s| s.0).collect();
            let weights = spectrum::colour_weights(&wavelengths)?;
            let (first, last) = (wavelengths[0], wavelengths[wavelengths.len() - 1]);
            remarks.push(format!(
                "spectra of {} wavelengths, {first} to {last} nm, as linear sRGB: CIE 1931 observer (fit of Wyman et al. 2013), \
                 illuminant D65; a spectrum of 1 is white",
                wavelengths.len(),
            ));
            layout.spectrum.iter().map(|s| s.1).zip(weights).collect()
        } else {
            layout.single.iter().map(|&column| (column, [1.0; 3])).collect()
        };
        let colours = layout.colours.iter().all(Option::is_some);
        let unused = (colours && !layout.spectrum.is_empty(), colours || !layout.spectrum.is_empty());
        if unused.0 {
            remarks.push("columns r,g,b are used, those of wavelengths are not".into());
        }
        if unused.1 && layout.single.is_some() {
            remarks.push("the column of one value is not used, those of colours are".into());
        }
        Ok(ValueColumns { weighted, remarks })
    }

    /// The colours of a row and what the last digits count; `None` where one is missing.
    fn read(&self, read: &mut ReadColumn) -> std::result::Result<Option<([f64; 3], f64)>, String> {
        let (mut value, mut digit) = ([0.0; 3], f64::INFINITY);
        for (column, weights) in &self.weighted {
            let Some(number) = read(*column)? else { return Ok(None) };
            (0..3).for_each(|c| value[c] += weights[c] * number.value);
            digit = digit.min(number.last_digit);
        }
        Ok(Some((value, digit)))
    }
}

/// The unit vectors of a row; the largest angle in degrees is kept.
pub(in crate::brdf) fn row_directions(
    layout: &ColumnLayout,
    read: &mut ReadColumn,
    largest_angle: &mut f64,
) -> std::result::Result<([f64; 3], [f64; 3]), String> {
    let mut needed = |column: usize| read(column)?.map(|n| n.value).ok_or("a value without a direction".to_owned());
    let mut by_vectors = None;
    if let [Some(a), Some(b), Some(c), Some(d), Some(e), Some(f)] = layout.vectors {
        let incoming = unit_vector([needed(a)?, needed(b)?, needed(c)?])?;
        by_vectors = Some((incoming, unit_vector([needed(d)?, needed(e)?, needed(f)?])?));
    }
    let mut angle = |(column, factor): (usize, f64)| {
        let written = needed(column)?;
        if written.abs() > 720.0 {
            return Err(format!("{written} is not an angle in degrees"));
        }
        *largest_angle = largest_angle.max(if factor < 1.0 { written.abs() } else { written.abs().to_degrees() });
        Ok(written * factor)
    };
    let by_angles = if let [Some(a), Some(b), Some(c), Some(d)] = layout.angles {
        let incoming = vector_of_angles(angle(a)?, angle(b)?);
        Some((incoming, vector_of_angles(angle(c)?, angle(d)?)))
    } else if let [Some(h), Some(d), Some(p)] = layout.half_difference {
        Some(super::HalfDifference { theta_h: angle(h)?, theta_d: angle(d)?, phi_d: angle(p)? }.directions())
    } else {
        None
    };
    match (by_vectors, by_angles) {
        (Some(a), Some(b)) if dot(a.0, b.0) < AGREEING_COSINE || dot(a.1, b.1) < AGREEING_COSINE => {
            Err("the vectors and the angles are different directions; leave out the columns of one kind".into())
        }
        (Some(pair), _) | (None, Some(pair)) => Ok(pair),
        (None, None) => Err("no direction".into()),
    }
}

/// Unit vector at an angle from the normal and an azimuth, radians. A negative angle lies on the other side of the normal.
fn vector_of_angles(theta: f64, phi: f64) -> [f64; 3] {
    let (sine, cosine) = theta.sin_cos();
    [sine * phi.cos(), sine * phi.sin(), cosine]
}

/// The vector of length 1; scaled first, so that no square overflows.
pub(in crate::brdf) fn unit_vector(v: [f64; 3]) -> std::result::Result<[f64; 3], String> {
    let largest = v.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    if largest <= 1e-12 {
        return Err("a direction of length 0".to_owned());
    }
    let scaled = v.map(|x| x / largest);
    let length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
    Ok(scaled.map(|x| x / length))
}

/// Stated noise of a row: relative and per steradian; `None` where neither is stated.
fn noise(layout: &ColumnLayout, read: &mut ReadColumn) -> std::result::Result<Option<[f64; 2]>, String> {
    let mut part = |column: Option<(usize, f64)>| -> std::result::Result<Option<f64>, String> {
        let Some((column, factor)) = column else { return Ok(None) };
        let number = read(column)?.map(|n| n.value * factor);
        match number.filter(|n| !(0.0..=1e6).contains(n)) {
            Some(number) => Err(format!("noise of {number}: standard deviations are 0 or more")),
            None => Ok(number),
        }
    };
    let both = [part(layout.relative_noise)?, part(layout.noise.map(|column| (column, 1.0)))?];
    Ok(both.iter().any(Option::is_some).then(|| both.map(|noise| noise.unwrap_or(0.0))))
}

#[cfg(test)]
mod tests;
