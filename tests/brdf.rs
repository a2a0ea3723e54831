//! `tsuya brdf` from end to end.

use crate::support::{complaint, json, output, shared, text, tsuya};

/// Pairs of directions at the middles of cells, where a table and what it was made of agree.
const DIRECTIONS: &str = "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z\n0.3,0.1,0.9,-0.2,0.1,0.9\n0,0,1,0,0,2\n0.6,0,-0.8,0,0,1\n";

#[test]
fn rgl_to_a_model_to_merl() {
    let Some(felt) = shared("brdf/rgl/acrylic_felt_green_rgb.bsdf") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (model, table, again) = (path("felt.json"), path("felt.binary"), path("again.binary"));
    let (directions, sheet) = (path("directions.csv"), path("sheet.png"));
    std::fs::write(&directions, DIRECTIONS).unwrap();
    let (model, table, directions) = (text(&model), text(&table), text(&directions));

    tsuya(&["brdf", "convert", text(&felt), "-o", table]).code(0);
    assert_eq!(std::fs::metadata(table).unwrap().len(), 34_992_012);
    let report = json(&[
        "brdf",
        "fit",
        table,
        "-o",
        model,
        "--form",
        "cook-torrance-ggx",
        "--contact-sheet",
        text(&sheet),
        "--json",
    ]);
    let keys: Vec<&str> = report.as_object().unwrap().keys().map(String::as_str).collect();
    for key in ["name", "form", "bytes", "seconds", "log_rmse", "cosine_rmse", "albedo_max", "sphere_psnr_db"] {
        assert!(keys.contains(&key), "{key} in {keys:?}");
    }
    assert_eq!(
        (&report["name"], &report["form"], &report["bytes"]),
        (&"felt".into(), &"cook-torrance-ggx".into(), &32.into())
    );
    assert!(report["log_rmse"].as_f64().unwrap() < 0.05, "{report}");
    assert!(report["albedo_max"].as_f64().unwrap() < 1.0, "{report}");
    assert!(report["sphere_psnr_db"]["point"].as_f64().unwrap() > 28.0, "{report}");
    assert!(report["sphere_psnr_db"]["environment"].as_f64().unwrap() > 28.0, "{report}");
    assert!(std::fs::metadata(&sheet).unwrap().len() > 1000);

    // The fitted model, its table and the measured one answer alike.
    tsuya(&["brdf", "convert", model, "-o", text(&again)]).code(0);
    let values = |file: &str| -> Vec<f64> {
        let rows = output(&["brdf", "eval", file, "--directions", directions, "--smooth"]);
        assert_eq!(rows.lines().count(), 3, "{rows}");
        rows.lines().flat_map(|row| row.split(',')).map(|x| x.parse().unwrap()).collect()
    };
    let (measured, fitted, sampled) = (values(table), values(model), values(text(&again)));
    assert_eq!(measured[6..], [0.0; 3]);
    for k in 0..6 {
        assert!((sampled[k] / fitted[k] - 1.0).abs() < 0.01, "{sampled:?} {fitted:?}");
        assert!((measured[k] - fitted[k]).abs() < 0.15, "{measured:?} {fitted:?}");
    }

    // In a file of the project's own: small, and nearer.
    let (tuned, lobes) = (path("felt.tsuya"), path("lobes.tsuya"));
    let (tuned, lobes) = (text(&tuned), text(&lobes));
    let own = json(&["brdf", "fit", table, "-o", tuned, "--json"]);
    assert_eq!(own["form"], "compact");
    assert!(own["bytes"].as_u64().unwrap() <= 256 && own["log_rmse"].as_f64().unwrap() < 0.015, "{own}");
    assert!(own["sphere_psnr_db"]["point"].as_f64().unwrap() > 45.0, "{own}");
    assert!(own["sphere_psnr_db"]["environment"].as_f64().unwrap() > 45.0, "{own}");
    assert!(std::fs::metadata(tuned).unwrap().len() < 400);
    assert!(output(&["verify", tuned, "--deep"]).contains("1 materials decode"));
    let close = values(tuned);
    assert!((0..6).all(|k| (close[k] / measured[k] - 1.0).abs() < 0.2), "{close:?} {measured:?}");
    tsuya(&["brdf", "convert", tuned, "-o", text(&again), "--force"]).code(0);
    assert!(json(&["brdf", "fit", text(&again), "--json"])["log_rmse"].as_f64().unwrap() < 0.005);
    tsuya(&["brdf", "convert", table, "-o", lobes, "--form", "published", "--slices", "6"]).code(0);
    assert!(output(&["info", lobes]).contains("materials: 1 (felt)"));
    assert!(
        complaint(1, &["brdf", "convert", table, "-o", text(&path("b.json")), "--form", "dsbrdf"]).contains(".tsuya")
    );
    tsuya(&["brdf", "convert", table, "-o", text(&path("ward.tsuya")), "--form", "ward"]).code(0);
    assert!(json(&["info", text(&path("ward.tsuya")), "--json"])["materials"][0]["form"] == "ward");

    assert!(complaint(2, &["brdf", "convert", model, "-o", table]).contains("--force"));
    let picture = path("ball.png");
    tsuya(&["brdf", "render", model, "-o", text(&picture), "--size", "32", "--sweep", "3"]).code(0);
    assert!(std::fs::metadata(&picture).unwrap().len() > 300);
}

#[test]
fn wrong_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let header = [90u32, 90, 180].map(u32::to_le_bytes).concat();
    let swapped = [90u32, 90, 180].map(u32::to_be_bytes).concat();
    let out = file("out.json", b"");
    std::fs::remove_file(&out).unwrap();
    let fit = |input: &str| complaint(3, &["brdf", "fit", input, "-o", &out]);
    assert!(fit(&file("short.binary", &header)).contains("cut off"));
    assert!(fit(&file("swapped.binary", &swapped)).contains("big-endian"));
    assert!(fit(&file("empty.binary", b"")).contains("has 0"));
    // Of another size than its header, of another header, full of what is no number, with its values' bytes swapped.
    let table = |counts: [u32; 3], value: [u8; 8]| {
        let cells: usize = 90 * 90 * 180 * 3;
        [counts.map(u32::to_le_bytes).concat(), value.repeat(cells)].concat()
    };
    let whole = [90, 90, 180];
    let tables = [
        ("longer.binary", [&table(whole, 0.1f64.to_le_bytes())[..], &[0; 8]].concat(), "goes on after its end"),
        ("counts.binary", table([90, 90, 360], 0.1f64.to_le_bytes()), "90 x 90 x 360"),
        ("nan.binary", table(whole, f64::NAN.to_le_bytes()), "not finite"),
        ("negative.binary", table(whole, (-1f64).to_le_bytes()), "no cell"),
        ("big-endian.binary", table(whole, 0.1f64.to_be_bytes()), "little-endian"),
    ];
    for (name, bytes, expected) in tables {
        let complained = fit(&file(name, &bytes));
        assert!(complained.contains(expected) && complained.contains(name), "{complained}");
    }
    assert!(fit(&file("x.bsdf", b"tensor")).contains("cut off"));
    assert!(fit(&file("x.json", b"{}")).contains("not a file of fitted models"));
    assert!(!std::path::Path::new(&out).exists());
    assert!(complaint(1, &["brdf", "fit", &file("x.wax", b""), "-o", &out]).contains(".binary"));
    assert!(complaint(2, &["brdf", "fit", "missing.binary", "-o", &out]).contains("missing.binary"));
    assert!(complaint(1, &["brdf", "fit", &out, "-o", &out, "--form", "wax"]).contains("blinn-phong"));
    let model = r#"{"format": "tsuya-brdf-models-1", "materials": [{"name": "a", "model": {"diffuse": [0.3, 0.2, 0.1],
        "specular": [0, 0, 0], "lobe": {"model": "lambert"}}}]}"#;
    let model = file("model.json", model.as_bytes());
    let eval = |rows: &[u8]| complaint(3, &["brdf", "eval", &model, "--directions", &file("d.csv", rows)]);
    assert!(eval(b"1,2,3\n").contains("line 1: 3 numbers, 6 expected"));
    assert!(eval(b"0,0,1,0,0,1\n0,0,x,0,0,1\n").contains("line 2: 'x' is not a number"));
    assert!(eval(b"0,0,0,0,0,1\n").contains("length 0"));
    let bad = file("bad.json", std::fs::read_to_string(&model).unwrap().replace("0.3", "-0.3").as_bytes());
    assert!(fit(&bad).contains("material a"));
    let directions = file("good.csv", b"0,0,1,0,0,1\n");
    let row = output(&["brdf", "eval", &model, "--directions", &directions]);
    assert!(row.starts_with("0.0954929658551372,"), "{row}");
    assert!(
        complaint(1, &["brdf", "eval", &model, "--directions", &directions, "--material", "b"]).contains("there are a")
    );
}
