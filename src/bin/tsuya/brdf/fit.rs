//! `tsuya brdf fit`: measured materials as a few numbers, and how far they are then.

use super::eval::environment;
use super::material::{MODEL_FORMAT, Material, ModelEntry, ModelFile, expand, read_all};
use super::sheet;
use crate::{output, pictures, progress};
use anyhow::Result;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::Error;
use tsuya::brdf::errors::ErrorReport;
use tsuya::brdf::merl::MerlTable;
use tsuya::brdf::models::{self, Form, Objective};
use tsuya::brdf::sphere::SphereScenes;

/// Width and height of the spheres that errors are measured on.
const SPHERE_SIDE: usize = 64;

/// Fits materials and says how far the fits are from what was measured.
#[derive(Args)]
pub struct Fit {
    /// MERL tables (.binary), RGL materials (.bsdf), folders of them.
    #[arg(required = true, value_name = "IN")]
    inputs: Vec<PathBuf>,
    /// The fitted materials: .json for classical models.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// What is fitted: lambert, blinn-phong, cook-torrance-beckmann, cook-torrance-ggx, ward, ashikhmin-shirley, lafortune.
    #[arg(long, value_name = "FORM", default_value = "cook-torrance-ggx", value_parser = form)]
    form: Form,
    /// What the fit of a classical model makes small.
    #[arg(long, value_enum, default_value_t = Goal::Both)]
    objective: Goal,
    /// A lat-long picture as the environment of the rendered sphere [default: one of the program's own].
    #[arg(long, value_name = "FILE")]
    environment: Option<PathBuf>,
    /// A picture with each material's spheres under a point light and in the environment: measured, fitted, difference (5 times).
    #[arg(long, value_name = "PNG")]
    contact_sheet: Option<PathBuf>,
    /// The contact sheet shows this many steps of a point light that moves from left to right.
    #[arg(long, value_name = "N", requires = "contact_sheet", value_parser = clap::value_parser!(u16).range(1..=64))]
    sweep: Option<u16>,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON: an object, or for several materials a list of them as `materials`.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Goal {
    /// Log RMSE over the table's cells.
    Log,
    /// Differences as a picture shows them.
    Picture,
    /// Both.
    Both,
}

fn form(name: &str) -> std::result::Result<Form, String> {
    let known = || Form::ALL.map(Form::name).join(", ");
    Form::of_name(name).ok_or_else(|| format!("no such form; there are {}", known()))
}

/// A fitted material and its figures.
struct Fitted {
    name: String,
    material: Material,
    bytes: usize,
    seconds: f64,
    report: ErrorReport,
}

impl Fit {
    pub fn run(self) -> Result<()> {
        for path in self.output.iter().chain(&self.contact_sheet) {
            output::check_free(path, self.force)?;
        }
        if let Some(path) = self.output.as_deref().filter(|path| !ends_with(path, "json") && !output::is_stream(path)) {
            let message = format!("{}: fitted models are written as .json", path.display());
            return Err(Error::parameter(message).into());
        }
        if self.json && self.output.as_deref().is_some_and(output::is_stream) {
            return Err(Error::parameter("figures and materials can't both go to standard output").into());
        }
        let files = expand(&self.inputs)?;
        let scenes = SphereScenes::new(SPHERE_SIDE, &environment(self.environment.as_deref())?);
        let busy = progress::busy("fitting");
        let (mut all, mut tiles) = (Vec::new(), Vec::new());
        for path in &files {
            for named in read_all(path)? {
                let table = named.material.into_table();
                let fitted = self.fit(named.name, &table, &scenes)?;
                if self.contact_sheet.is_some() {
                    let sweep = self.sweep.map(usize::from);
                    tiles.push(sheet::tile(&fitted.name, &scenes, &table.smooth(), &fitted.material, sweep));
                }
                all.push(fitted);
            }
        }
        drop(busy);
        if let Some(path) = &self.contact_sheet {
            let columns = if self.sweep.is_some() { 1 } else { tiles.len().div_ceil(15) };
            output::write(path, &pictures::png(&sheet::arrange(&tiles, columns))?, self.force)?;
        }
        let figures: Vec<Value> = all.iter().map(|fitted| self.figures(fitted)).collect();
        let text = self.table(&all);
        if let Some(path) = &self.output {
            output::write(path, &model_file(all)?, self.force)?;
        }
        if !self.json {
            let quiet = self.output.as_deref().is_some_and(output::is_stream);
            return if quiet { Ok(()) } else { output::say(&text) };
        }
        match <[Value; 1]>::try_from(figures) {
            Ok([one]) => output::say_json(&one),
            Err(several) => output::say_json(&json!({"materials": several})),
        }
    }

    fn fit(&self, name: String, table: &MerlTable, scenes: &SphereScenes) -> Result<Fitted> {
        let begun = Instant::now();
        let objective = match self.objective {
            Goal::Log => Objective::Logarithm,
            Goal::Picture => Objective::Picture,
            Goal::Both => Objective::Both,
        };
        let model = models::fit(table, self.form, objective)?;
        let seconds = begun.elapsed().as_secs_f64();
        let report = ErrorReport::of(table, &model, scenes);
        Ok(Fitted { name, bytes: 4 * model.parameters(), material: Material::Classical(model), seconds, report })
    }

    fn figures(&self, fitted: &Fitted) -> Value {
        let report = &fitted.report;
        json!({
            "name": fitted.name,
            "form": self.form.name(),
            "bytes": fitted.bytes,
            "seconds": fitted.seconds,
            "log_rmse": report.log_rmse,
            "cosine_rmse": report.cosine_rmse,
            "albedo_max": report.albedo_max,
            "reciprocity": report.reciprocity,
            "sphere_psnr_db": report.sphere_psnr_db,
        })
    }

    fn table(&self, all: &[Fitted]) -> String {
        let width = all.iter().map(|fitted| fitted.name.chars().count()).max().unwrap_or(0).max(8);
        let mut text = String::new();
        let _ = writeln!(
            text,
            "{:width$}  bytes  log RMSE  cosine RMSE  albedo  point dB  environment dB  seconds",
            self.form.name()
        );
        let mut line = |name: &str, bytes: f64, r: &ErrorReport, seconds: f64| {
            let psnr = r.sphere_psnr_db;
            let _ = writeln!(
                text,
                "{name:width$} {bytes:6.0}  {:8.4}  {:11.4}  {:6.3}  {:8.2}  {:14.2}  {seconds:7.3}",
                r.log_rmse, r.cosine_rmse, r.albedo_max, psnr.point, psnr.environment,
            );
        };
        for fitted in all {
            line(&fitted.name, fitted.bytes as f64, &fitted.report, fitted.seconds);
        }
        if all.len() > 1 {
            let of = |part: f64, value: &dyn Fn(&Fitted) -> f64| {
                let mut values: Vec<f64> = all.iter().map(value).collect();
                values.sort_by(f64::total_cmp);
                values[((values.len() - 1) as f64 * part).round() as usize]
            };
            // Worst is the greatest error and the least PSNR.
            for (name, part) in [("median", 0.5), ("worst", 1.0)] {
                let report = ErrorReport {
                    log_rmse: of(part, &|f| f.report.log_rmse),
                    cosine_rmse: of(part, &|f| f.report.cosine_rmse),
                    albedo_max: of(part, &|f| f.report.albedo_max),
                    reciprocity: of(part, &|f| f.report.reciprocity),
                    sphere_psnr_db: tsuya::brdf::errors::SpherePsnr {
                        point: of(1.0 - part, &|f| f.report.sphere_psnr_db.point),
                        environment: of(1.0 - part, &|f| f.report.sphere_psnr_db.environment),
                    },
                };
                line(name, of(part, &|f| f.bytes as f64), &report, of(part, &|f| f.seconds));
            }
        }
        text
    }
}

fn model_file(all: Vec<Fitted>) -> Result<Vec<u8>> {
    let entry = |fitted: Fitted| match fitted.material {
        Material::Classical(model) => Some(ModelEntry { name: fitted.name, model }),
        _ => None,
    };
    let materials = all.into_iter().filter_map(entry).collect();
    let file = ModelFile { format: MODEL_FORMAT.into(), materials };
    Ok(format!("{}\n", serde_json::to_string_pretty(&file)?).into_bytes())
}

fn ends_with(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}
