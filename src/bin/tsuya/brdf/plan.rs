//! `tsuya brdf plan`: what to measure, chosen from a population of measured materials.

use super::material::{Kind, Material, expand, read_all};
use crate::{output, progress, source};
use anyhow::Result;
use clap::{Args, ValueEnum};
use serde_json::json;
use std::path::{Path, PathBuf};
use tsuya::brdf::{Brdf, Population, goniometer_csv};
use tsuya::{Error, brdf};

/// A plan of 40 components has 160 kB.
const MAX_PLAN_BYTES: u64 = 16 << 20;

/// Chooses the angles at which to measure materials like those of a folder.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya brdf plan merl/ --samples 32 -o plan.json --csv angles.csv",
))]
pub struct Plan {
    /// MERL tables (.binary), RGL materials (.bsdf), folders of them: the population.
    #[arg(required = true, value_name = "DIR")]
    inputs: Vec<PathBuf>,
    /// Samples: pairs of directions to measure.
    #[arg(long, value_name = "N")]
    samples: usize,
    /// Method by which angles are chosen.
    #[arg(long, value_enum, default_value_t = Method::Optimal)]
    method: Method,
    /// Methods uniform and variance: half angles from here on, in degrees. 5 suits a fit of form dsbrdf, which leaves smaller ones out.
    #[arg(long, alias = "least-theta-h", value_name = "DEG", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=80))]
    min_theta_h: u8,
    /// The plan, JSON; tsuya brdf fit --samples takes it.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// The angles for a goniometer: a row `theta_i,phi_i,theta_o,phi_o` (degrees) with the unit vectors for each measurement, in an order that
    /// moves the arms little. With columns `r,g,b` added, tsuya brdf fit and next take it.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
    /// Prints angles and expected error as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    /// Along theta_h by the population's variance (DSBRDF, equations 10 and 11).
    #[value(alias = "published")]
    Variance,
    /// Along theta_h in equal steps.
    Uniform,
    /// Each sample where it lowers the expected error most.
    Optimal,
}

impl Plan {
    pub fn run(self) -> Result<()> {
        let inputs = expand(&self.inputs)?;
        let outputs: Vec<&Path> = self.output.iter().chain(&self.csv).map(|path| &**path).collect();
        output::check_outputs(&outputs, &inputs.iter().map(|path| &**path).collect::<Vec<_>>(), self.force)?;
        let streams = outputs.iter().filter(|path| output::is_stream(path)).count();
        if streams + usize::from(self.json) > 1 {
            return Err(Error::parameter("figures, plan and angles can't go to standard output together").into());
        }
        let busy = progress::busy("planning");
        let population = population(&inputs, Population::new().with_min_theta_h_deg(self.min_theta_h.into()))?;
        let method = match self.method {
            Method::Variance => brdf::PlanMethod::Variance,
            Method::Uniform => brdf::PlanMethod::Uniform,
            Method::Optimal => brdf::PlanMethod::Optimal,
        };
        let plan = population.plan(self.samples, method)?;
        drop(busy);
        let mut written = output::Files::new(self.force);
        if let Some(path) = &self.output {
            written.add(path, format!("{}\n", plan.to_json()?).as_bytes())?;
        }
        if let Some(path) = &self.csv {
            written.add(path, goniometer_csv(&plan.angles).as_bytes())?;
        }
        written.commit()?;
        if self.json {
            let angles: Vec<_> = (plan.angles.iter())
                .map(|a| json!({"theta_h_deg": a.theta_h_deg, "theta_d_deg": a.theta_d_deg, "phi_d_deg": a.phi_d_deg}))
                .collect();
            return output::print_json(&json!({
                "method": plan.method,
                "materials": plan.materials,
                "samples": plan.angles.len(),
                "expected_log_rmse": plan.expected_log_rmse,
                "angles": angles,
            }));
        }
        if streams > 0 {
            return Ok(());
        }
        let mut text = String::from("theta_h  theta_d    phi_d  degrees\n");
        for a in &plan.angles {
            text += &format!("{:7.2}  {:7.2}  {:7.2}\n", a.theta_h_deg, a.theta_d_deg, a.phi_d_deg);
        }
        text += &format!("{} samples, from {} materials: ", plan.angles.len(), plan.materials);
        text += &format!("expected log RMSE {:.4}\n", plan.expected_log_rmse);
        output::print(&text)
    }
}

/// Adds the materials of files to a population.
pub fn population(inputs: &[PathBuf], mut population: Population) -> Result<Population> {
    for path in inputs {
        if !matches!(Kind::of(path)?, Kind::Merl | Kind::Rgl) {
            let message = "a population is of measured materials, .binary or .bsdf";
            return Err(Error::parameter(format!("{}: {message}", path.display())).into());
        }
        for named in read_all(path)? {
            match named.material {
                // Only the cells that are asked for are evaluated, not a whole table.
                Material::Rgl(material) => population.add_values(|_, angles| {
                    let (incoming, outgoing) = angles.directions();
                    Some(material.reciprocal().evaluate(incoming, outgoing))
                })?,
                other => population.add(&other.into_table())?,
            }
        }
    }
    Ok(population)
}

/// Reads a plan.
pub fn read(path: &Path) -> Result<brdf::MeasurementPlan> {
    let text = source::read_at_most(path, "sampling plan", MAX_PLAN_BYTES)?;
    Ok(brdf::MeasurementPlan::from_json(&text).map_err(|e| Error::input(path, e.to_string()))?)
}
