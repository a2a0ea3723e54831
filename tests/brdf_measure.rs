//! A simulated goniometer: planned angles, measured values with noise as CSV, fits from those alone, and the next angles.

use crate::support::{complaint, json, output, shared, tsuya};
use std::fmt::Write;
use std::path::Path;
use tsuya::brdf::{
    Brdf, BrdfForm, BrdfSample, FitSettings, MeasuredSamples, MerlTable, PlanMethod, PlannedAngles, Population,
    RglMaterial, fit_measured, fit_planned, goniometer_rows, read_published,
};
use tsuya::input::FileAccess;

const MATERIALS: [&str; 3] = ["acrylic_felt_green", "ilm_l3_37_metallic", "paper_white"];

/// Log RMSE over a coarse table.
fn error(truth: &[BrdfSample], fitted: &impl Brdf) -> f64 {
    let found = BrdfSample::tabulate(fitted, BINS);
    assert_eq!(found.len(), truth.len());
    let square = |(a, b): (&BrdfSample, &BrdfSample)| {
        (0..3)
            .map(|c| ((a.value[c] * a.cos_incoming).ln_1p() - (b.value[c] * a.cos_incoming).ln_1p()).powi(2))
            .sum::<f64>()
    };
    (truth.iter().zip(&found).map(square).sum::<f64>() / (3 * truth.len()) as f64).sqrt()
}

const BINS: [usize; 3] = [45, 20, 8];

/// Normal numbers, the same in every run.
struct Noise(u64);

impl Noise {
    fn normal(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// Rows of CSV: three digits, 2 % noise.
fn measure(material: &impl Brdf, angles: &[PlannedAngles], noise: &mut Noise) -> String {
    let mut text = String::new();
    for row in goniometer_rows(angles) {
        let (incoming, outgoing) = row.directions();
        let _ = write!(text, "{:.3},0,{:.3},{:.3}", row.theta_i_deg, row.theta_o_deg, row.phi_o_deg);
        for value in material.evaluate(incoming, outgoing) {
            let _ = write!(text, ",{:.2e}", value * (1.0 + 0.02 * noise.normal()));
        }
        text.push('\n');
    }
    text
}

#[test]
fn csv_is_as_good_as_the_table_and_chosen_angles_are_better_than_a_plan() {
    let (Some(fits), Some(folder)) = (shared("brdf/fits"), shared("brdf/rgl")) else { return };
    let access = FileAccess::default();
    let mut population = Population::new();
    for fit in read_published(fits.join("ngan_cooktorrance.fit"), &access).unwrap().iter().step_by(2) {
        let value = |_: usize, angles: tsuya::brdf::HalfDifference| {
            let (incoming, outgoing) = angles.directions();
            Some(fit.model.evaluate(incoming, outgoing))
        };
        population.add_values(value).unwrap();
    }
    let prior = population.prior().unwrap();
    // Each direction is chosen after those before it, so that the first of a plan are a plan.
    let plan_32 = population.plan(32, PlanMethod::Optimal).unwrap();
    let planned = |count: usize| &plan_32.angles[..count];
    let (form, settings) = (BrdfForm::Compact, FitSettings::default());
    let read = |rows: &str| {
        let text = format!("theta_i,phi_i,theta_o,phi_o,r,g,b\n{rows}");
        MeasuredSamples::from_text(&text, Path::new("measured.csv"), &access).unwrap().samples
    };
    let mut sums = [0.0; 4];
    for name in MATERIALS {
        let material = RglMaterial::read(folder.join(format!("{name}_rgb.bsdf")), &access).unwrap();
        // A table keeps one value of both orders of the directions.
        let material = material.reciprocal();
        let (table, truth) = (MerlTable::tabulate(&material), BrdfSample::tabulate(&material, BINS));
        let mut noise = Noise(7);
        let from_rows = |rows: &str, prior: &tsuya::brdf::MaterialPrior| {
            error(&truth, &fit_measured(&read(rows), prior, form, &settings).unwrap().fitted)
        };
        let clean = error(&truth, &fit_planned(&table, &plan_32, form, &settings).unwrap());
        let by_plan = from_rows(&measure(&material, planned(32), &mut noise), &plan_32.prior().unwrap());
        let fixed = from_rows(&measure(&material, planned(24), &mut noise), &prior);
        let mut rows = measure(&material, planned(8), &mut noise);
        for _ in 0..4 {
            let next = prior.posterior(&read(&rows)).unwrap().next(2).unwrap();
            rows += &measure(&material, &next.angles, &mut noise);
        }
        let figures = [clean, by_plan, fixed, from_rows(&rows, &prior)];
        println!("{name}: table 32, csv 32, csv 24, chosen 16: {figures:.4?}");
        (0..4).for_each(|k| sums[k] += figures[k]);
    }
    let [clean, by_plan, fixed, chosen] = sums.map(|sum| sum / MATERIALS.len() as f64);
    assert!(by_plan <= 1.25 * clean, "{by_plan} from CSV, {clean} from the table");
    assert!(chosen <= fixed, "{chosen} at 16 chosen angles, {fixed} at 24 planned ones");
}

#[test]
fn a_goniometer_needs_nothing_but_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    // The material: a model, for want of a real one.
    let model = r#"{"format": "tsuya-brdf-models-1", "materials": [{"name": "a", "model": {"diffuse": [0.3, 0.2, 0.1],
        "specular": [0.8, 0.8, 0.8], "lobe": {"model": "cook-torrance-ggx", "roughness": 0.3, "reflectance": 0.05}}}]}"#;
    std::fs::write(path("model.json"), model).unwrap();
    std::fs::write(
        path("first.csv"),
        "theta_i,phi_i,theta_o,phi_o\n20,0,20,180\n50,0,50,180\n40,0,10,90\n70,0,60,180\n0,0,45,0\n",
    )
    .unwrap();
    let eval = |directions: &str| {
        output(&["brdf", "eval", &path("model.json"), "--directions", directions, "--with-directions"])
    };
    let mut measured = eval(&path("first.csv"));
    for round in 0..2 {
        std::fs::write(path("measured.csv"), &measured).unwrap();
        let csv = path(&format!("next-{round}.csv"));
        let report = json(&["brdf", "next", &path("measured.csv"), "--samples", "3", "--csv", &csv, "--json"]);
        assert_eq!((&report["enough"], report["angles"].as_array().unwrap().len()), (&false.into(), 3));
        measured += eval(&csv).split_once('\n').unwrap().1;
    }
    std::fs::write(path("measured.csv"), &measured).unwrap();
    let report = json(&["brdf", "fit", &path("measured.csv"), "-o", &path("a.tsuya"), "--json"]);
    assert_eq!((&report["directions"], &report["form"]), (&11.into(), &"compact".into()));
    assert!(report["log_rmse_at_samples"].as_f64().unwrap() < 0.03, "{report}");
    tsuya(&["verify", "--deep", &path("a.tsuya")]).code(0);
    let truth =
        json(&["brdf", "fit", &path("a.tsuya"), "--form", "cook-torrance-ggx", "-o", &path("b.json"), "--json"]);
    assert!(truth["log_rmse"].as_f64().unwrap() < 0.1, "{truth}");
    let report = json(&["brdf", "fit", &path("measured.csv"), "-o", &path("c.json"), "--json"]);
    assert_eq!(report["form"], "cook-torrance-ggx");
    assert!(report["log_rmse_at_samples"].as_f64().unwrap() < 0.01, "{report}");

    // It is enough where more would not be asked for; what can't be is refused.
    let said = output(&["brdf", "next", &path("measured.csv"), "--until", "0.9"]);
    assert!(said.contains("enough"), "{said}");
    let said = output(&["brdf", "next", &path("measured.csv"), "--until", "0.0001"]);
    assert!(said.contains("not enough after these"), "{said}");
    assert!(complaint(1, &["brdf", "fit", &path("measured.csv"), "--form", "dsbrdf"]).contains("--slices"));
    assert!(complaint(1, &["brdf", "fit", &path("measured.csv"), &path("model.json")]).contains("runs of their own"));
    assert!(
        complaint(1, &["brdf", "eval", &path("measured.csv"), "--directions", &path("first.csv")]).contains("brdf fit")
    );
    std::fs::write(path("bad.csv"), "theta_i,phi_i,theta_o,phi_o,r,g,b\n1,0,1,0,0,5,0,5,0,5\n").unwrap();
    assert!(complaint(3, &["brdf", "next", &path("bad.csv")]).contains("line 2: 10 cells, 7 columns"));
    assert!(complaint(3, &["brdf", "fit", &path("bad.csv")]).contains("decimal commas"));
}
