//! `tsuya brdf plan`: what to measure.

use super::material::{expand, read_all};
use crate::{output, progress};
use anyhow::Result;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use std::io::Read;
use std::path::{Path, PathBuf};
use tsuya::Error;
use tsuya::brdf::plan::{self, Population};

/// Chooses angles to measure from a population of measured materials. `tsuya brdf fit --samples` makes a material of the values there.
#[derive(Args)]
pub struct Plan {
    /// A folder of MERL tables (.binary) and RGL materials (.bsdf), or some of those.
    #[arg(required = true, value_name = "DIR")]
    inputs: Vec<PathBuf>,
    /// Pairs of directions to measure.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    samples: u32,
    /// How they are chosen.
    #[arg(long, value_enum, default_value_t = Method::Optimal)]
    method: Method,
    /// The plan; - is standard output.
    #[arg(short, long, value_name = "JSON")]
    output: Option<PathBuf>,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
    /// Prints angles and expected error as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Method {
    /// Steps of the half angle that shrink where materials vary more, as published.
    Published,
    /// Equal steps.
    Uniform,
    /// One after the other, each where it lowers the expected error most.
    Optimal,
}

impl Plan {
    pub fn run(self) -> Result<()> {
        if let Some(path) = &self.output {
            output::check_free(path, self.force)?;
        }
        let method = match self.method {
            Method::Published => plan::Method::Published,
            Method::Uniform => plan::Method::Uniform,
            Method::Optimal => plan::Method::Optimal,
        };
        let busy = progress::busy("planning");
        let mut population = Population::new();
        for path in expand(&self.inputs)? {
            for named in read_all(&path)? {
                population.add(&named.material.into_table())?;
            }
        }
        let plan = population.plan(self.samples as usize, method)?;
        drop(busy);
        let figures = json!({
            "method": plan.method,
            "samples": plan.angles.len(),
            "materials": plan.materials,
            "expected_log_rmse": plan.expected_log_rmse,
            "angles": plan.angles.iter().map(|a| json!([a.theta_h_deg, a.theta_d_deg, a.phi_d_deg])).collect::<Vec<Value>>(),
        });
        let to_stream = self.output.as_deref().is_some_and(output::is_stream);
        if let Some(path) = &self.output {
            output::write(path, plan.to_json()?.as_bytes(), self.force)?;
        }
        match (self.json, to_stream) {
            (true, true) => Err(Error::parameter("figures and plan can't both go to standard output").into()),
            (true, false) => output::say_json(&figures),
            (false, true) => Ok(()),
            (false, false) => {
                let mut text = format!(
                    "{} samples from {} materials, expected log RMSE {:.4}\n\ntheta_h  theta_d  phi_d (degrees)\n",
                    plan.angles.len(),
                    plan.materials,
                    plan.expected_log_rmse
                );
                for a in &plan.angles {
                    text += &format!("{:7.2}  {:7.2}  {:5.1}\n", a.theta_h_deg, a.theta_d_deg, a.phi_d_deg);
                }
                output::say(&text)
            }
        }
    }
}

/// A plan of 100,000 angles has some 10 MB.
const MOST_BYTES: u64 = 64 << 20;

/// Reads a plan.
pub fn read_plan(path: &Path) -> Result<plan::Plan> {
    let failed = |e| Error::io(path, e);
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(failed)?;
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(Error::Limits { what: "sampling plan", asked: bytes.len() as u64, allowed: MOST_BYTES }.into());
    }
    Ok(plan::Plan::from_json(&bytes).map_err(|e| Error::input(path, e.to_string()))?)
}
