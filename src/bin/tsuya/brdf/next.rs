//! `tsuya brdf next`: which directions to measure next.

use super::measured;
use crate::{output, progress};
use anyhow::Result;
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use tsuya::Error;
use tsuya::brdf::{goniometer_csv, goniometer_rows};

/// Chooses the directions to measure next, given the values that were measured so far.
#[derive(Args)]
pub struct Next {
    /// Measured values (.csv, .json; - is standard input), as tsuya brdf fit takes them.
    input: PathBuf,
    /// Directions to choose.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=1000))]
    samples: u16,
    /// Materials like the one that is measured: MERL tables (.binary), RGL materials (.bsdf) or folders of them; may be given several times
    /// [default: a population of classical models].
    #[arg(long, value_name = "DIR")]
    population: Vec<PathBuf>,
    /// Says that it is enough once the expected log RMSE is at most this.
    #[arg(long, value_name = "ERROR")]
    until: Option<f64>,
    /// The angles for a goniometer, as tsuya brdf plan --csv writes them; no rows if it is enough.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
    /// Prints angles and expected errors as JSON.
    #[arg(long)]
    json: bool,
}

impl Next {
    pub fn run(self) -> Result<()> {
        if let Some(path) = &self.csv {
            output::check_outputs(&[path], &[&self.input], self.force)?;
        }
        let streams = self.csv.as_deref().is_some_and(output::is_stream);
        if self.json && streams {
            return Err(Error::parameter("figures and angles can't both go to standard output").into());
        }
        if self.until.is_some_and(|error| !error.is_finite() || error <= 0.0) {
            return Err(Error::parameter("--until takes a log RMSE above 0").into());
        }
        if !measured::is_measured(&self.input)? {
            let message = "measured values are wanted, .csv or .json";
            return Err(Error::parameter(format!("{}: {message}", self.input.display())).into());
        }
        let samples = measured::read(&self.input)?;
        let busy = progress::busy("planning");
        let prior = measured::prior(&self.population, None::<&Path>)?;
        let posterior = prior.posterior(&samples.samples)?;
        let now = posterior.expected_log_rmse();
        let enough = self.until.is_some_and(|error| now <= error);
        let next = posterior.next(if enough { 0 } else { self.samples.into() })?;
        drop(busy);
        if let Some(path) = &self.csv {
            output::write(path, goniometer_csv(&next.angles).as_bytes(), self.force)?;
        }
        let mut rows = goniometer_rows(&next.angles);
        rows.sort_by_key(|row| row.rank);
        if self.json {
            let angles: Vec<_> = (rows.iter().zip(&next.angles).zip(&next.expected_log_rmse))
                .map(|((row, angles), expected)| {
                    json!({
                        "theta_i_deg": row.theta_i_deg,
                        "phi_i_deg": row.phi_i_deg,
                        "theta_o_deg": row.theta_o_deg,
                        "phi_o_deg": row.phi_o_deg,
                        "theta_h_deg": angles.theta_h_deg,
                        "theta_d_deg": angles.theta_d_deg,
                        "phi_d_deg": angles.phi_d_deg,
                        "expected_log_rmse": expected,
                    })
                })
                .collect();
            return output::print_json(&json!({
                "directions": samples.samples.len(),
                "expected_log_rmse": now,
                "enough": enough,
                "angles": angles,
            }));
        }
        if streams {
            return Ok(());
        }
        let mut text = format!("{} directions: expected log RMSE {now:.4}\n", samples.samples.len());
        if enough {
            text += "enough: that is at most what was asked for\n";
            return output::print(&text);
        }
        text += "theta_i  theta_o    phi_o  degrees, phi_i 0; expected log RMSE after it\n";
        for (row, expected) in rows.iter().zip(&next.expected_log_rmse) {
            text +=
                &format!("{:7.3}  {:7.3}  {:7.3}  {expected:.4}\n", row.theta_i_deg, row.theta_o_deg, row.phi_o_deg);
        }
        if let Some(error) = self.until {
            let after = next.expected_log_rmse.iter().position(|expected| *expected <= error);
            text += &match after {
                Some(index) => format!("enough after {} of them, by expectation\n", index + 1),
                None => "not enough after these, by expectation\n".into(),
            };
        }
        output::print(&text)
    }
}
