//! Materials out of measured values.

use super::material::{Kind, MODEL_FORMAT, expand, name_of};
use crate::{output, source};
use anyhow::Result;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::Error;
use tsuya::brdf::{
    BrdfForm, FitSettings, FittedBrdf, MaterialPrior, MeasuredFit, MeasuredSamples, NoiseSource, Population,
    fit_measured, max_albedo, reciprocity_error,
};

/// A fit that reflects more than this is of values that are no BRDF.
const MAX_ALBEDO: f64 = 1.1;

/// A fitted material with its figures.
pub struct MeasuredRow {
    name: String,
    samples: MeasuredSamples,
    fit: MeasuredFit,
    albedo: f64,
    seconds: f64,
}

/// Returns `true` for measured values: text, or JSON that is no file of fitted models.
pub fn is_measured(path: &Path) -> Result<bool> {
    if output::is_stream(path) {
        return Ok(true);
    }
    Ok(match Kind::of(path)? {
        Kind::Measured => true,
        Kind::Models => {
            let text =
                source::access().read_text(path, "table of measurements", MeasuredSamples::MAX_BYTES)?.to_owned();
            let begin = text.trim_start();
            begin.starts_with('[')
                || begin.starts_with('{') && begin.contains("\"samples\"") && !begin.contains(MODEL_FORMAT)
        }
        _ => false,
    })
}

/// Reads measured values and prints what is odd about them.
pub fn read(path: &Path) -> Result<MeasuredSamples> {
    let samples = match output::is_stream(path) {
        true => {
            let bytes = source::read_at_most(path, "table of measurements", MeasuredSamples::MAX_BYTES)?;
            let text = std::str::from_utf8(&bytes).map_err(|e| Error::input(path, format!("not UTF-8 text: {e}")))?;
            MeasuredSamples::from_text(text, path, &source::access())?
        }
        false => MeasuredSamples::read(path, &source::access())?,
    };
    output::warn(&samples.remarks);
    Ok(samples)
}

/// Knowledge of materials before anything was measured: of files, of a plan, or of classical models.
pub fn prior(population: &[PathBuf], plan: Option<&Path>) -> Result<MaterialPrior> {
    Ok(match plan {
        Some(path) => super::plan::read(path)?.prior()?,
        None if population.is_empty() => Population::of_classical_models().prior()?,
        None => super::plan::population(&expand(population)?, Population::new())?.prior()?,
    })
}

/// Fits each file as a material.
pub fn fit(
    files: &[PathBuf],
    prior: &MaterialPrior,
    form: BrdfForm,
    settings: &FitSettings,
) -> Result<Vec<MeasuredRow>> {
    let row = |path: &PathBuf| {
        let samples = read(path)?;
        let begun = Instant::now();
        let fit = fit_measured(&samples.samples, prior, form, settings)?;
        let seconds = begun.elapsed().as_secs_f64();
        let name = if output::is_stream(path) { "measured".into() } else { name_of(path) };
        let albedo = max_albedo(&fit.fitted);
        if albedo > MAX_ALBEDO {
            output::warn(&[format!(
                "{name}: the fit reflects {albedo:.1} times the light that it receives; are the values a BRDF per steradian, without the cosine, or too few?"
            )]);
        }
        Ok(MeasuredRow { name, samples, fit, albedo, seconds })
    };
    files.iter().map(row).collect()
}

/// The materials by name.
pub fn fitted(rows: Vec<MeasuredRow>) -> Vec<(String, FittedBrdf)> {
    rows.into_iter().map(|row| (row.name, row.fit.fitted)).collect()
}

/// Figures of one material, or of several as `materials`.
pub fn figures(rows: &[MeasuredRow], form: BrdfForm) -> Value {
    let figures = |row: &MeasuredRow| {
        json!({
            "name": row.name,
            "form": form.name(),
            "bytes": row.fit.fitted.bytes(),
            "seconds": row.seconds,
            "measured": row.samples.measured,
            "directions": row.samples.samples.len(),
            "gaps": row.samples.gaps,
            "below_horizon": row.samples.below_horizon,
            "relative_noise": row.samples.relative_noise,
            "noise_source": source_name(row.samples.noise_source),
            "log_rmse_at_samples": row.fit.log_rmse_at_samples,
            "expected_log_rmse": row.fit.expected_log_rmse,
            "albedo_max": row.albedo,
            "reciprocity": reciprocity_error(&row.fit.fitted),
        })
    };
    match rows {
        [one] => figures(one),
        several => json!({"materials": several.iter().map(figures).collect::<Vec<_>>()}),
    }
}

fn source_name(source: NoiseSource) -> &'static str {
    match source {
        NoiseSource::Stated => "stated",
        NoiseSource::Repeats => "repeats",
        NoiseSource::Assumed => "assumed",
    }
}

/// Figures as a table of text.
pub fn table(rows: &[MeasuredRow], form: BrdfForm) -> String {
    let names: Vec<String> = rows.iter().map(|row| output::line(&row.name)).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(18);
    let mut text = String::new();
    let heads = "bytes  directions  noise %  log RMSE at them  expected of a table  albedo  seconds";
    let _ = writeln!(text, "{:width$}  {heads}", form.name());
    for (row, name) in rows.iter().zip(&names) {
        let (samples, fit) = (&row.samples, &row.fit);
        let _ = writeln!(
            text,
            "{name:width$} {:6}  {:10}  {:7.1}  {:16.4}  {:19.4}  {:6.3}  {:7.3}",
            fit.fitted.bytes(),
            samples.samples.len(),
            100.0 * samples.relative_noise,
            fit.log_rmse_at_samples,
            fit.expected_log_rmse,
            max_albedo(&fit.fitted),
            row.seconds,
        );
    }
    text
}
