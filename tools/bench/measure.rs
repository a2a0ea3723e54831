//! A simulated goniometer: `bench-measure MERL_TABLES [RGL_MATERIALS]`, two folders.
//!
//! The population is two thirds of the tables. Every other table and every RGL material is measured at planned directions, with 2 % noise
//! and values of three digits, written as CSV and fitted from that alone. Prints log RMSE over the whole table: of a fit from the table at
//! the same directions, of that from the CSV, and of directions chosen one after another by what was measured before. Where the environment
//! has `TSUYA_BENCH_RECIPROCAL`, RGL materials alone are measured, both orders of the directions averaged, as their tables are.

mod files;

use files::{files, stem};
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tsuya::brdf::{
    Brdf, BrdfForm, FitSettings, MaterialPrior, MeasuredSamples, MeasurementPlan, MerlTable, PlanMethod, PlannedAngles,
    Population, RglMaterial, fit_measured, fit_planned, goniometer_rows, log_rmse,
};
use tsuya::input::FileAccess;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Relative standard deviation of a simulated value.
const NOISE: f64 = 0.02;

/// A material with its table.
struct Measured {
    name: String,
    table: MerlTable,
    material: Option<RglMaterial>,
}

impl Measured {
    /// Rows of CSV, as a goniometer would write them; nothing where the table has no value.
    fn rows(&self, angles: &[PlannedAngles], noise: &mut Noise) -> String {
        let mut text = String::new();
        for row in goniometer_rows(angles) {
            let (incoming, outgoing) = row.directions();
            let value = match &self.material {
                Some(material) if reciprocal() => material.reciprocal().evaluate(incoming, outgoing),
                Some(material) => material.evaluate(incoming, outgoing),
                None => self.table.interpolated().evaluate(incoming, outgoing),
            };
            let _ = write!(text, "{:.3},0,{:.3},{:.3}", row.theta_i_deg, row.theta_o_deg, row.phi_o_deg);
            for value in value {
                let _ = match value {
                    value if value > 0.0 => write!(text, ",{:.2e}", value * (1.0 + NOISE * noise.normal())),
                    _ => write!(text, ","),
                };
            }
            text.push('\n');
        }
        text
    }
}

/// Whether RGL materials alone are judged, both orders of the directions averaged: the environment has TSUYA_BENCH_RECIPROCAL.
fn reciprocal() -> bool {
    std::env::var_os("TSUYA_BENCH_RECIPROCAL").is_some()
}

/// Normal numbers, the same in every run.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

const HEADING: &str = "theta_i,phi_i,theta_o,phi_o,r,g,b\n";

fn samples(rows: &str) -> tsuya::Result<MeasuredSamples> {
    MeasuredSamples::from_text(&format!("{HEADING}{rows}"), Path::new("measured.csv"), &FileAccess::default())
}

/// Log RMSE and the expected one of a fit in form compact.
fn fitted(measured: &Measured, rows: &str, prior: &MaterialPrior, form: BrdfForm) -> Result<[f64; 2]> {
    let fit = fit_measured(&samples(rows)?.samples, prior, form, &FitSettings::default())?;
    Ok([log_rmse(&measured.table, &fit.fitted), fit.expected_log_rmse])
}

fn main() -> Result<()> {
    let folders: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let Some(tables) = folders.first() else { return Err("usage: bench-measure MERL_TABLES [RGL_MATERIALS]".into()) };
    let mut population = Population::new();
    let mut all = Vec::new();
    for (k, path) in files(tables, "binary")?.iter().enumerate() {
        let table = MerlTable::read(path, &FileAccess::default())?;
        if k % 3 == 1 {
            if reciprocal() {
                continue;
            }
            all.push(Measured { name: stem(path), table, material: None });
        } else {
            population.add(&table)?;
        }
    }
    if let Some(folder) = folders.get(1) {
        for path in files(folder, "bsdf")? {
            let material = RglMaterial::read(&path, &FileAccess::default())?;
            let table = MerlTable::tabulate(&material.reciprocal());
            all.push(Measured { name: stem(&path), table, material: Some(material) });
        }
    }
    let prior = population.prior()?;
    let classical = Population::of_classical_models();
    let (classical_prior, classical_32) = (classical.prior()?, classical.plan(32, PlanMethod::Optimal)?);
    let plan_32 = population.plan(32, PlanMethod::Optimal)?;
    // Each direction is chosen after those before it, so that the first of a plan are a plan.
    let planned = |count: usize| MeasurementPlan { angles: plan_32.angles[..count].to_vec(), ..plan_32.clone() };
    let (plan_8, plan_16, plan_24) = (planned(8), planned(16), planned(24));
    println!("{:28} table 32  csv 32 expected  csv 16  csv 24  next 16 expected built-in 32 expected", "");
    let mut rows = Vec::new();
    for measured in &all {
        let mut noise = Noise(7);
        let mut csv = |plan: &MeasurementPlan| measured.rows(&plan.angles, &mut noise);
        let compact = BrdfForm::Compact;
        let (first, csv_16, csv_24, csv_32) = (csv(&plan_8), csv(&plan_16), csv(&plan_24), csv(&plan_32));
        let clean =
            log_rmse(&measured.table, &fit_planned(&measured.table, &plan_32, compact, &FitSettings::default())?);
        let by_plan = fitted(measured, &csv_32, &plan_32.prior()?, compact)?;
        let fixed = [fitted(measured, &csv_16, &prior, compact)?[0], fitted(measured, &csv_24, &prior, compact)?[0]];
        let mut rows_so_far = first;
        for _ in 0..4 {
            let next = prior.posterior(&samples(&rows_so_far)?.samples)?.next(2)?;
            rows_so_far += &measured.rows(&next.angles, &mut noise);
        }
        let chosen = fitted(measured, &rows_so_far, &prior, compact)?;
        let built_in = fitted(measured, &measured.rows(&classical_32.angles, &mut noise), &classical_prior, compact)?;
        let row = [clean, by_plan[0], by_plan[1], fixed[0], fixed[1], chosen[0], chosen[1], built_in[0], built_in[1]];
        println!("{:28} {}", measured.name, row.map(|x| format!("{x:8.4}")).join(" "));
        rows.push(row);
    }
    let tables = all.iter().filter(|measured| measured.material.is_none()).count();
    for (name, part) in [("MERL", 0..tables), ("RGL", tables..rows.len()), ("all", 0..rows.len())] {
        let mean = |k: usize| rows[part.clone()].iter().map(|row| row[k]).sum::<f64>() / part.len() as f64;
        println!(
            "{:28} {}",
            format!("mean {name}"),
            std::array::from_fn::<_, 9, _>(|k| format!("{:8.4}", mean(k))).join(" ")
        );
    }
    let ratios: Vec<f64> = rows.iter().map(|row| row[1] / row[0]).collect();
    println!("greatest ratio csv 32 / table 32: {:.3}", ratios.iter().copied().fold(0.0, f64::max));
    Ok(())
}
