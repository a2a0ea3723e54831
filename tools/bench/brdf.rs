//! Errors of fitted materials: `bench-brdf MERL_TABLES [RGL_MATERIALS [PUBLISHED_FITS]]`, three folders.
//!
//! Prints, for every material, log RMSE and the PSNR of rendered spheres for each form, then medians and worst, and the seconds that
//! reading and fitting take. Classical models are fitted twice: for both log
//! RMSE and pictures, and for log RMSE alone (`-log`). Published fits are compared on the tables whose names they carry. Then the errors
//! of sampling plans. Where the environment has `TSUYA_BENCH_QUICK` classical models are left out, where it has `TSUYA_BENCH_PLANS` all
//! fits of whole tables.

mod files;

use files::{files, stem};
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;
use tsuya::brdf::{
    BrdfForm, ClassicalForm, ErrorReport, FitObjective, FitSettings, MeasuredReference, MeasurementPlan, MerlTable,
    PlanMethod, Population, PreviewEnvironment, RglMaterial, SphereScenes, cell_errors, fit_planned, fit_table,
    read_published, studio_environment,
};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// One form's figures for one material.
struct Row {
    material: String,
    form: String,
    bytes: usize,
    seconds: f64,
    report: ErrorReport,
}

fn main() -> Result<()> {
    let folders: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let Some(tables) = folders.first() else {
        return Err("usage: bench-brdf MERL_TABLES [RGL_MATERIALS [PUBLISHED_FITS]]".into());
    };
    let scenes = SphereScenes::new(64, &PreviewEnvironment::new(&studio_environment()));
    let mut published = Vec::new();
    if let Some(folder) = folders.get(2) {
        for path in files(folder, "fit")? {
            published.push((stem(&path), read_published(&path, &Default::default())?));
        }
    }
    let mut rows = Vec::new();
    let (mut reading, mut bytes) = (0.0, 0u64);
    let merl = files(tables, "binary")?;
    for path in &merl {
        let begun = Instant::now();
        let table = MerlTable::read(path, &Default::default())?;
        reading += begun.elapsed().as_secs_f64();
        bytes += std::fs::metadata(path)?.len();
        let name = stem(path);
        if plans_alone() {
            continue;
        }
        let reference = MeasuredReference::new(&table, &scenes);
        fit_all(&name, &table, &reference, &mut rows)?;
        for (list, fits) in &published {
            if let Some(found) = fits.iter().find(|fit| fit.material == name) {
                let report = reference.report(&found.model);
                say(&name, list, &report);
                rows.push(Row {
                    material: name.clone(),
                    form: list.clone(),
                    bytes: 4 * found.model.parameter_count(),
                    seconds: 0.0,
                    report,
                });
            }
        }
    }
    if !rows.is_empty() {
        print("MERL tables", &rows);
    }
    println!(
        "read {} tables, {:.0} MB/s; greatest memory of this process {}\n",
        merl.len(),
        bytes as f64 / 1e6 / f64::max(reading, 1e-9),
        greatest_memory()
    );
    if let Some(folder) = folders.get(1).filter(|_| !plans_alone()) {
        let mut rows = Vec::new();
        for path in files(folder, "bsdf")? {
            let table = MerlTable::tabulate(&RglMaterial::read(&path, &Default::default())?.reciprocal());
            fit_all(&stem(&path), &table, &MeasuredReference::new(&table, &scenes), &mut rows)?;
        }
        print("RGL materials", &rows);
    }
    // Two thirds of a handful of tables are no population.
    if merl.len() >= 6 {
        plans(&merl)?;
    }
    Ok(())
}

/// Plans made on two thirds of the tables and judged on the others: the whole table for one split, then the other two.
fn plans(merl: &[PathBuf]) -> Result<()> {
    for part in [1, 0, 2] {
        let mut population = Population::new();
        for path in merl.iter().enumerate().filter(|(k, _)| k % 3 != part).map(|(_, path)| path) {
            population.add(&MerlTable::read(path, &Default::default())?)?;
        }
        let judged: Vec<&PathBuf> = merl.iter().enumerate().filter(|(k, _)| k % 3 == part).map(|(_, p)| p).collect();
        println!(
            "plans made on {} tables, judged on {} (those of number 3 n + {part}); median / mean log RMSE over all cells | from 5 degrees",
            population.len(),
            judged.len()
        );
        let (tuned, lobes) = (BrdfForm::Compact, BrdfForm::Dsbrdf);
        let (uniform, published, optimal) = (PlanMethod::Uniform, PlanMethod::Variance, PlanMethod::Optimal);
        let counts: &[usize] = if part == 1 { &[8, 11, 16, 18, 32, 64, 128, 200] } else { &[11, 18, 32, 200] };
        let mut rows: Vec<(String, MeasurementPlan, BrdfForm)> = Vec::new();
        for &count in counts {
            for (method, form) in
                [(optimal, tuned), (published, tuned), (published, lobes), (uniform, tuned), (uniform, lobes)]
            {
                let name = format!("{count:3} samples, {method:?}, {}", form.name());
                rows.push((name, population.plan(count, method)?, form));
            }
        }
        // As in the paper: an eighth and a fifth of the 90 half angles in each of 18 slices. Lobes leave the first 5 degrees out, so plans
        // for them begin there; beside it plans that don't know of it.
        for (form, least) in [(lobes, 5.0), (lobes, 0.0), (tuned, 0.0)] {
            population = population.with_min_theta_h_deg(least);
            let name = |count: usize, method: PlanMethod| {
                format!("18 x {count:2} samples from {least} deg, {method:?}, {}", form.name())
            };
            rows.push((name(18, uniform), population.plan_slices(18, 18, uniform)?, form));
            rows.push((name(11, uniform), population.plan_slices(18, 11, uniform)?, form));
            for floor in [0.003, 0.005, 0.01, 0.02, 0.05, 0.1] {
                population = population.with_variance_floor(floor);
                let plan = population.plan_slices(18, 11, published)?;
                rows.push((format!("{}, floor {floor}", name(11, published)), plan, form));
            }
            population = population.with_variance_floor(0.01);
        }
        let mut errors = vec![[Vec::new(), Vec::new()]; rows.len()];
        for path in judged {
            let table = MerlTable::read(path, &Default::default())?;
            for ((_, plan, form), [all, from_5_deg]) in rows.iter().zip(&mut errors) {
                let fitted = fit_planned(&table, plan, *form, &FitSettings::default())?;
                let found = cell_errors(&table, &fitted);
                all.push(found.log_rmse);
                from_5_deg.push(found.log_rmse_from_5_deg);
            }
        }
        for ((name, _, _), errors) in rows.iter().zip(&mut errors) {
            let columns = errors.each_mut().map(|values| {
                values.sort_by(f64::total_cmp);
                let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
                format!("{:.4} / {mean:.4}", values.get(values.len() / 2).unwrap_or(&f64::NAN))
            });
            println!("{name:64} {} | {}", columns[0], columns[1]);
        }
        println!();
    }
    Ok(())
}

/// Progress, on standard error.
fn say(material: &str, form: &str, report: &ErrorReport) {
    let psnr = report.sphere_psnr_db;
    eprintln!("{material} {form} {:.4} {:.1} {:.1}", report.log_rmse, psnr.point, psnr.environment);
}

fn fit_all(name: &str, table: &MerlTable, reference: &MeasuredReference, rows: &mut Vec<Row>) -> Result<()> {
    let classical =
        |objective, suffix| ClassicalForm::ISOTROPIC.map(|form| (BrdfForm::Classical(form), objective, suffix));
    let forms = [(BrdfForm::Compact, FitObjective::Both, ""), (BrdfForm::Dsbrdf, FitObjective::Both, "")].into_iter();
    let forms = forms.chain(classical(FitObjective::Both, "")).chain(classical(FitObjective::Logarithm, "-log"));
    for (form, objective, suffix) in forms {
        if quick() && matches!(form, BrdfForm::Classical(_)) {
            continue;
        }
        let begun = Instant::now();
        let fitted = fit_table(table, form, &FitSettings { objective, ..Default::default() })?;
        let seconds = begun.elapsed().as_secs_f64();
        let report = reference.report(&fitted);
        let form = format!("{}{suffix}", form.name());
        say(name, &form, &report);
        rows.push(Row { material: name.into(), form, bytes: fitted.bytes(), seconds, report });
    }
    Ok(())
}

/// Whether classical models are left out: the environment has TSUYA_BENCH_QUICK.
fn quick() -> bool {
    std::env::var_os("TSUYA_BENCH_QUICK").is_some()
}

/// Whether whole tables are not fitted: the environment has TSUYA_BENCH_PLANS.
fn plans_alone() -> bool {
    std::env::var_os("TSUYA_BENCH_PLANS").is_some()
}

fn print(title: &str, rows: &[Row]) {
    let mut forms: Vec<&str> = Vec::new();
    rows.iter().filter(|row| !row.form.is_empty()).for_each(|row| {
        if !forms.contains(&row.form.as_str()) {
            forms.push(&row.form);
        }
    });
    let mut materials: Vec<&str> = rows.iter().map(|row| row.material.as_str()).collect();
    materials.dedup();
    println!("{title}: log RMSE, PSNR of a sphere under a point light / in an environment, dB\n");
    println!("{:24} {}", "", forms.iter().map(|form| format!("{form:>24}")).collect::<String>());
    for material in &materials {
        let cell = |form: &str| {
            let row = rows.iter().find(|row| row.material == *material && row.form == form);
            row.map_or_else(String::new, |row| {
                let psnr = row.report.sphere_psnr_db;
                format!("{:.4} {:5.1} {:5.1}", row.report.log_rmse, psnr.point, psnr.environment)
            })
        };
        println!("{material:24} {}", forms.iter().map(|form| format!("{:>24}", cell(form))).collect::<String>());
    }
    println!(
        "\n{:24}   n  bytes  log RMSE median / worst  from 5 deg  cosine RMSE  point dB median / worst  environment dB  albedo  seconds",
        "form"
    );
    for form in forms {
        let of: Vec<&Row> = rows.iter().filter(|row| row.form == form).collect();
        let column = |value: &dyn Fn(&Row) -> f64| {
            let mut values: Vec<f64> = of.iter().map(|row| value(row)).collect();
            values.sort_by(f64::total_cmp);
            let half = values.len() / 2;
            (values[0], 0.5 * (values[half] + values[(values.len() - 1) / 2]), values[values.len() - 1])
        };
        let log = column(&|row| row.report.log_rmse);
        let (point, light) =
            (column(&|row| row.report.sphere_psnr_db.point), column(&|row| row.report.sphere_psnr_db.environment));
        println!(
            "{form:24} {:3} {:6}        {:.4} / {:7.4}      {:.4}       {:8.4}          {:6.2} / {:5.2}   {:6.2} / {:5.2}  {:6.3}   {:6.3}",
            of.len(),
            column(&|row| row.bytes as f64).2,
            log.1,
            log.2,
            column(&|row| row.report.log_rmse_from_5_deg).1,
            column(&|row| row.report.cosine_rmse).1,
            point.1,
            point.0,
            light.1,
            light.0,
            column(&|row| row.report.albedo_max).2,
            column(&|row| row.seconds).1,
        );
    }
    println!();
}

fn greatest_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    line.map_or_else(|| "unknown".into(), |line| line.trim_start_matches("VmHWM:").trim().into())
}
