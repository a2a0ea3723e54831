//! `tsuya brdf fit`: measured materials as a few numbers, and how far they are then.

use super::asset;
use super::eval::environment;
use super::material::{Kind, MODEL_FORMAT, ModelEntry, ModelFile, expand, read_all};
use super::measured;
use super::sheet;
use crate::{output, pictures, progress, source};
use anyhow::Result;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::brdf::{
    BrdfForm, ClassicalForm, ErrorReport, FitObjective, FitSettings, FittedBrdf, LobeCount, LobeError,
    MeasurementPlan as SamplingPlan, MerlTable, NamedMaterial, SpherePsnr, SphereScenes,
};
use tsuya::container::Metadata;
use tsuya::{Error, brdf};

/// Width and height of the spheres that errors are measured on.
const SPHERE_SIDE: usize = 64;

/// Fits materials and says how far the fits are from what was measured.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya brdf fit steel.binary -o steel.tsuya\n",
    "  tsuya brdf fit measured.csv --population merl/ -o new.tsuya\n",
    "  tsuya brdf fit merl/ -o merl.tsuya --contact-sheet sheet.png",
))]
pub struct Fit {
    /// MERL tables (.binary), RGL materials (.bsdf), folders of them; or measured values (.csv, .json), each file a material: columns
    /// `theta_i,phi_i,theta_o,phi_o` (degrees) or `wi_x,wi_y,wi_z,wo_x,wo_y,wo_z` (z along the normal), and `r,g,b`, `value` or wavelengths
    /// such as `450` (BRDF per steradian); `sigma` (relative) or `noise`. Rows without a value are gaps, repeats are averaged.
    #[arg(required = true, value_name = "IN")]
    inputs: Vec<PathBuf>,
    /// The fitted materials: .tsuya, or .json for classical models.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// A .tsuya file, such as of tsuya make: the output is this file with the fitted materials, which take the place of those of their names.
    #[arg(long, value_name = "FILE", requires = "output")]
    asset: Option<PathBuf>,
    /// Name of the fitted material in the file of --asset [default: that of its input].
    #[arg(long, value_name = "NAME", requires = "asset")]
    name: Option<String>,
    #[command(flatten)]
    forms: Forms,
    /// A lat-long picture as the environment of the rendered sphere [default: one of the program's own].
    #[arg(long, visible_alias = "env", value_name = "FILE")]
    environment: Option<PathBuf>,
    /// A picture with each material's spheres under a point light and in the environment: measured, fitted, difference (5 times).
    #[arg(long, value_name = "PNG")]
    contact_sheet: Option<PathBuf>,
    /// The contact sheet shows this many steps of a point light that moves from left to right.
    #[arg(long, value_name = "N", requires = "contact_sheet", value_parser = clap::value_parser!(u16).range(1..=64))]
    sweep: Option<u16>,
    /// Tables: fits from the samples of this plan only (tsuya brdf plan), as if nothing else had been measured. Measured values: the
    /// plan's population says what is probable between them.
    #[arg(long, value_name = "PLAN")]
    samples: Option<PathBuf>,
    /// Measured values: materials like the one that was measured, MERL tables (.binary), RGL materials (.bsdf) or folders of them; may
    /// be given several times [default: a population of classical models].
    #[arg(long, value_name = "DIR", conflicts_with = "samples")]
    population: Vec<PathBuf>,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON: an object, or for several materials a list of them as `materials`.
    #[arg(long)]
    json: bool,
}

/// Form and options of a fit.
#[derive(Args)]
pub struct Forms {
    /// compact (the least error for its bytes), dsbrdf (lobes of the half angle), lambert, blinn-phong, cook-torrance-beckmann,
    /// cook-torrance-ggx, ward, ashikhmin-shirley, lafortune [default: compact, or cook-torrance-ggx for a .json].
    #[arg(long, value_name = "FORM", value_parser = form)]
    form: Option<BrdfForm>,
    /// Form compact: bytes of a coded material at most.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u16).range(32..=4096))]
    max_bytes: u16,
    /// Form dsbrdf: slices of the difference angle; 18 and 6 are those of its authors.
    #[arg(long, value_name = "N", default_value_t = 18, value_parser = clap::value_parser!(u16).range(1..=90))]
    slices: u16,
    /// Form dsbrdf: lobes of each colour, 1 to 5; 0 chooses by error.
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u16).range(0..=5))]
    lobes: u16,
    /// Form dsbrdf: each lobe has an amplitude of its own.
    #[arg(long)]
    amplitudes: bool,
    /// Form dsbrdf: half angles from here on, in degrees; nearer to the highlight's centre measurements are unreliable. 0 keeps all.
    #[arg(long, alias = "least-theta-h", value_name = "DEG", default_value_t = 5.0)]
    min_theta_h: f64,
    /// Form dsbrdf: error that the lobes of a slice minimise.
    #[arg(long, value_enum, default_value_t = LobeGoal::Relative)]
    lobe_error: LobeGoal,
    /// Error that the fit of a classical model minimises.
    #[arg(long, value_enum, default_value_t = Goal::Both)]
    objective: Goal,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum LobeGoal {
    /// Relative squares over the means of bins of theta_h.
    Relative,
    /// Plain squares over the samples, until they converge, as published (DSBRDF, equation 9).
    Squares,
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

fn form(name: &str) -> std::result::Result<BrdfForm, String> {
    let known = || BrdfForm::all().into_iter().map(BrdfForm::name).collect::<Vec<_>>().join(", ");
    BrdfForm::from_name(name).ok_or_else(|| format!("no such form; there are {}", known()))
}

impl Forms {
    /// The form that was asked for, or that goes with the output; an error where the output can't hold it.
    pub fn of(&self, output: Option<&Path>) -> tsuya::Result<BrdfForm> {
        let kind = output.filter(|path| !output::is_stream(path)).map(Kind::of).transpose()?;
        let classical = |form| matches!(form, BrdfForm::Classical(_));
        match (self.form, kind) {
            (None, Some(Kind::Models)) => Ok(BrdfForm::Classical(ClassicalForm::CookTorranceGgx)),
            (None, Some(Kind::Tsuya) | None) => Ok(BrdfForm::Compact),
            (Some(form), Some(Kind::Models)) if classical(form) => Ok(form),
            (Some(form), Some(Kind::Tsuya)) => Ok(form),
            (Some(form), None) => Ok(form),
            _ => {
                let message = "the forms compact and dsbrdf are written as .tsuya, classical models as .tsuya or .json";
                Err(Error::parameter(format!("{}: {message}", output.unwrap_or(Path::new("-")).display())))
            }
        }
    }

    /// Returns `true` if no form was asked for.
    pub fn is_default(&self) -> bool {
        self.form.is_none()
    }

    pub fn settings(&self) -> FitSettings {
        let mut settings = FitSettings::default();
        settings.compact.bytes = self.max_bytes.into();
        settings.dsbrdf.slices = self.slices.into();
        settings.dsbrdf.lobes = match self.lobes {
            0 => LobeCount::ByError,
            count => LobeCount::Given(count.into()),
        };
        settings.dsbrdf.amplitudes = self.amplitudes;
        settings.dsbrdf.min_theta_h_deg = self.min_theta_h;
        settings.dsbrdf.error = match self.lobe_error {
            LobeGoal::Relative => LobeError::Relative,
            LobeGoal::Squares => LobeError::Squares,
        };
        settings.objective = match self.objective {
            Goal::Log => FitObjective::Logarithm,
            Goal::Picture => FitObjective::Picture,
            Goal::Both => FitObjective::Both,
        };
        settings
    }
}

/// A fitted material and its figures.
struct Row {
    name: String,
    fitted: FittedBrdf,
    bytes: usize,
    seconds: f64,
    report: ErrorReport,
}

impl Fit {
    pub fn run(self) -> Result<()> {
        let files = expand(&self.inputs)?;
        let measured = files.iter().map(|path| measured::is_measured(path)).collect::<Result<Vec<bool>>>()?;
        if measured.contains(&true) {
            return match measured.contains(&false) {
                true => Err(Error::parameter("tables and measured values are fitted in runs of their own").into()),
                false => self.run_measured(&files),
            };
        }
        if !self.population.is_empty() {
            return Err(Error::parameter("a table needs no population; --population is for measured values").into());
        }
        let outputs: Vec<&Path> = self.output.iter().chain(&self.contact_sheet).map(|path| &**path).collect();
        let inputs = files.iter().chain(&self.environment).chain(&self.samples).map(|path| &**path);
        output::check_outputs(&outputs, &inputs.collect::<Vec<&Path>>(), self.force)?;
        let form = self.forms.of(self.output.as_deref())?;
        if self.json && self.output.as_deref().is_some_and(output::is_stream) {
            return Err(Error::parameter("figures and materials can't both go to standard output").into());
        }
        let plan = self.samples.as_deref().map(super::plan::read).transpose()?;
        let scenes = SphereScenes::new(SPHERE_SIDE, &environment(self.environment.as_deref())?);
        let busy = progress::busy("fitting");
        let (mut all, mut tiles) = (Vec::new(), Vec::new());
        for path in &files {
            for named in read_all(path)? {
                let table = named.material.into_table();
                let row = self.fit(named.name, &table, form, plan.as_ref(), &scenes)?;
                if self.contact_sheet.is_some() {
                    let sweep = self.sweep.map(usize::from);
                    tiles.push(sheet::tile(&row.name, &scenes, &table.interpolated(), &row.fitted, sweep));
                }
                all.push(row);
            }
        }
        drop(busy);
        let mut written = output::Files::new(self.force);
        if let Some(path) = &self.contact_sheet {
            let columns = if self.sweep.is_some() { 1 } else { tiles.len().div_ceil(15) };
            written.add(path, &pictures::png(&sheet::arrange(&tiles, columns))?)?;
        }
        let figures: Vec<Value> = all.iter().map(|row| figures(row, form)).collect();
        let text = table(&all, form);
        if let Some(path) = &self.output {
            let fitted = all.into_iter().map(|row| (row.name, row.fitted)).collect();
            written.add(path, &self.bytes(path, fitted)?)?;
        }
        written.commit()?;
        if !self.json {
            return self.tell(&text);
        }
        match <[Value; 1]>::try_from(figures) {
            Ok([one]) => output::print_json(&one),
            Err(several) => output::print_json(&json!({"materials": several})),
        }
    }

    fn run_measured(&self, files: &[PathBuf]) -> Result<()> {
        if self.contact_sheet.is_some() {
            return Err(
                Error::parameter("a contact sheet shows what a table has; there is none of measured values").into()
            );
        }
        let outputs: Vec<&Path> = self.output.iter().map(|path| &**path).collect();
        let inputs = files.iter().chain(&self.samples).map(|path| &**path);
        output::check_outputs(&outputs, &inputs.collect::<Vec<&Path>>(), self.force)?;
        let form = self.forms.of(self.output.as_deref())?;
        let streams = self.output.as_deref().is_some_and(output::is_stream);
        if self.json && streams {
            return Err(Error::parameter("figures and materials can't both go to standard output").into());
        }
        let busy = progress::busy("fitting");
        let prior = measured::prior(&self.population, self.samples.as_deref())?;
        let rows = measured::fit(files, &prior, form, &self.forms.settings())?;
        drop(busy);
        let (text, figures) = (measured::table(&rows, form), measured::figures(&rows, form));
        if let Some(path) = &self.output {
            output::write(path, &self.bytes(path, measured::fitted(rows))?, self.force)?;
        }
        if self.json { output::print_json(&figures) } else { self.tell(&text) }
    }

    /// Prints figures: all that was asked for where no file is written, and nothing where the file goes to standard output.
    fn tell(&self, text: &str) -> Result<()> {
        match &self.output {
            None => output::print(text),
            Some(path) if output::is_stream(path) => Ok(()),
            Some(_) => output::tell(text),
        }
    }

    /// The bytes of the output.
    fn bytes(&self, path: &Path, fitted: Vec<(String, FittedBrdf)>) -> Result<Vec<u8>> {
        match &self.asset {
            Some(file) if source::has_extension(path, "json") => {
                let message = format!("{}: what comes of --asset {} is a .tsuya file", path.display(), file.display());
                Err(Error::parameter(message).into())
            }
            Some(file) => asset::put(file, fitted, self.name.as_deref()),
            None => write_fitted(path, fitted),
        }
    }

    fn fit(
        &self,
        name: String,
        table: &MerlTable,
        form: BrdfForm,
        plan: Option<&SamplingPlan>,
        scenes: &SphereScenes,
    ) -> Result<Row> {
        let begun = Instant::now();
        let settings = self.forms.settings();
        let fitted = match plan {
            Some(plan) => brdf::fit_planned(table, plan, form, &settings)?,
            None => brdf::fit_table(table, form, &settings)?,
        };
        let seconds = begun.elapsed().as_secs_f64();
        let report = ErrorReport::compare(table, &fitted, scenes);
        Ok(Row { name, bytes: fitted.bytes(), fitted, seconds, report })
    }
}

fn figures(row: &Row, form: BrdfForm) -> Value {
    let report = &row.report;
    json!({
        "name": row.name,
        "form": form.name(),
        "bytes": row.bytes,
        "seconds": row.seconds,
        "log_rmse": report.log_rmse,
        "log_rmse_from_5_deg": report.log_rmse_from_5_deg,
        "cosine_rmse": report.cosine_rmse,
        "albedo_max": report.albedo_max,
        "reciprocity": report.reciprocity,
        "sphere_psnr_db": report.sphere_psnr_db,
    })
}

fn table(all: &[Row], form: BrdfForm) -> String {
    let names: Vec<String> = all.iter().map(|row| output::line(&row.name)).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(18);
    let mut text = String::new();
    let heads = "bytes  log RMSE  cosine RMSE  albedo  point dB  environment dB  seconds";
    let _ = writeln!(text, "{:width$}  {heads}", form.name());
    let mut line = |name: &str, bytes: f64, r: &ErrorReport, seconds: f64| {
        let psnr = r.sphere_psnr_db;
        let _ = writeln!(
            text,
            "{name:width$} {bytes:6.0}  {:8.4}  {:11.4}  {:6.3}  {:8.2}  {:14.2}  {seconds:7.3}",
            r.log_rmse, r.cosine_rmse, r.albedo_max, psnr.point, psnr.environment,
        );
    };
    for (row, name) in all.iter().zip(&names) {
        line(name, row.bytes as f64, &row.report, row.seconds);
    }
    if all.len() > 1 {
        let of = |part: f64, value: &dyn Fn(&Row) -> f64| {
            let mut values: Vec<f64> = all.iter().map(value).collect();
            values.sort_by(f64::total_cmp);
            let at = (values.len() - 1) as f64 * part;
            0.5 * (values[at.floor() as usize] + values[at.ceil() as usize])
        };
        // Worst is the greatest error and the least PSNR.
        for (name, part) in [("median", 0.5), ("worst", 1.0)] {
            let report = ErrorReport {
                log_rmse: of(part, &|row| row.report.log_rmse),
                log_rmse_from_5_deg: of(part, &|row| row.report.log_rmse_from_5_deg),
                cosine_rmse: of(part, &|row| row.report.cosine_rmse),
                albedo_max: of(part, &|row| row.report.albedo_max),
                reciprocity: of(part, &|row| row.report.reciprocity),
                sphere_psnr_db: SpherePsnr {
                    point: of(1.0 - part, &|row| row.report.sphere_psnr_db.point),
                    environment: of(1.0 - part, &|row| row.report.sphere_psnr_db.environment),
                },
            };
            line(name, of(part, &|row| row.bytes as f64), &report, of(part, &|row| row.seconds));
        }
    }
    text
}

/// The bytes of a file of fitted materials: `.tsuya`, or `.json` of classical models (which standard output takes of them).
pub fn write_fitted(path: &Path, all: Vec<(String, FittedBrdf)>) -> Result<Vec<u8>> {
    let is_coded = all.iter().any(|(_, fitted)| matches!(fitted, FittedBrdf::Coded(_)));
    if is_coded && source::has_extension(path, "json") {
        let message = "the forms compact and dsbrdf are written as .tsuya, classical models as .tsuya or .json";
        return Err(Error::parameter(format!("{}: {message}", path.display())).into());
    }
    if is_coded || source::has_extension(path, "tsuya") {
        let named = |(name, fitted)| NamedMaterial { name, material: asset::held(fitted) };
        let held: Vec<NamedMaterial> = all.into_iter().map(named).collect();
        return Ok(tsuya::encoder::encode_materials(&held, &Metadata::default())?);
    }
    let mut models = Vec::new();
    for (name, fitted) in all {
        if let FittedBrdf::Classical(model) = fitted {
            models.push(ModelEntry { name, model });
        }
    }
    let file = ModelFile { format: MODEL_FORMAT.into(), materials: models };
    Ok(format!("{}\n", serde_json::to_string_pretty(&file)?).into_bytes())
}
