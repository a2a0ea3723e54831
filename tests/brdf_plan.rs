//! `tsuya brdf plan`, and fits from a plan's samples.

use crate::support::{complaint, json, shared, text, tsuya};

#[test]
fn sixteen_samples_make_a_material() {
    let names = ["acrylic_felt_green", "paper_white", "satin_rosaline", "vch_golden_yellow"];
    let paths: Vec<_> = names.iter().filter_map(|name| shared(&format!("brdf/rgl/{name}_rgb.bsdf"))).collect();
    let [felt, paper, satin, golden] = paths.as_slice() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (plan, fitted) = (folder.path().join("plan.json"), folder.path().join("paper.tsuya"));
    let (plan, fitted) = (text(&plan), text(&fitted));
    let population = [text(felt), text(paper), text(satin), text(golden)];
    let command = ["brdf", "plan", "--samples", "16", "-o", plan, "--json"];
    let report = json(&[&command[..], &population[..]].concat());
    assert_eq!(
        (&report["method"], &report["samples"], &report["materials"]),
        (&"optimal".into(), &16.into(), &4.into())
    );
    assert_eq!(report["angles"].as_array().unwrap().len(), 16);
    assert!(report["expected_log_rmse"].as_f64().unwrap() < 0.3, "{report}");

    let report = json(&["brdf", "fit", text(paper), "--samples", plan, "-o", fitted, "--json"]);
    assert!(report["bytes"].as_u64().unwrap() <= 256, "{report}");
    assert!(report["log_rmse"].as_f64().unwrap() < 0.02, "{report}");
    tsuya(&["verify", "--deep", fitted]).code(0);

    let text_of = |path| std::fs::read_to_string(path).unwrap();
    std::fs::write(plan, text_of(plan).replacen("tsuya-brdf-plan-1", "tsuya-brdf-plan-9", 1)).unwrap();
    assert!(complaint(3, &["brdf", "fit", text(paper), "--samples", plan]).contains("tsuya-brdf-plan-1"));
    assert!(complaint(1, &["brdf", "plan", text(paper), "--samples", "16"]).contains("2 materials"));
}
