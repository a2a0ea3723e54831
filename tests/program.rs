//! The program from end to end, on the bundled sample.

use crate::support;
use crate::support::{complaint, json, output, sample, text, tsuya, variant};
use serde_json::Value;

/// The names of an object's keys.
fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn has_keys(value: &Value, wanted: &[&str]) {
    let found = keys(value);
    assert!(wanted.iter().all(|key| found.contains(key)), "{wanted:?} in {found:?}");
}

#[test]
fn predictive_there_and_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (file, capture) = (path("a.tsuya"), sample());
    let (file, capture) = (text(&file), text(&capture));
    let report = json(&["encode", capture, "-o", file, "--json"]);
    has_keys(&report, &["bytes", "seconds", "threads", "sections", "sample_psnr_db", "kept_percent"]);
    assert_eq!(keys(&report["sections"][0]), ["tag", "bytes"]);
    assert_eq!(report["sample_psnr_db"]["linear"], serde_json::json!({"diffuse": null, "specular": null}));
    assert_eq!(report["kept_percent"], Value::Null);
    let bytes = report["bytes"].as_u64().unwrap();
    assert_eq!(bytes, std::fs::metadata(file).unwrap().len());
    assert!(bytes < 96_000, "{bytes}");
    let scan = path("scan.tsuya");
    tsuya(&["encode", capture, "-o", text(&scan), "--refine", "none", "--no-check"]).code(0);
    let without_surface = std::fs::metadata(&scan).unwrap().len();
    assert!(without_surface < 92_500 && without_surface < bytes, "{without_surface}");
    let sections = report["sections"].as_array().unwrap();
    let in_sections: u64 = sections.iter().map(|section| section["bytes"].as_u64().unwrap()).sum();
    assert!(in_sections < bytes && in_sections > bytes * 9 / 10);

    let verified = output(&["verify", file, "--deep", "--against", capture]);
    assert!(verified.contains("36 of 36 views decode") && verified.contains("as stated"), "{verified}");

    let pictures = path("compared");
    let compared = json(&["compare", file, capture, "-o", text(&pictures), "--json"]);
    has_keys(
        &compared,
        &[
            "bytes",
            "masked_pixels",
            "coverage",
            "bits_per_sample",
            "image_psnr_db",
            "held_out_psnr_db",
            "frames",
            "missing_pixels",
        ],
    );
    assert_eq!(compared["bytes"].as_u64().unwrap(), bytes);
    assert_eq!(compared["held_out_psnr_db"], Value::Null);
    assert_eq!(compared["missing_pixels"], 0);
    assert_eq!(keys(&compared["image_psnr_db"]), ["diffuse", "specular", "sum"]);
    has_keys(&compared["frames"][35], &["name", "psnr_db"]);
    let sum = compared["image_psnr_db"]["sum"].as_f64().unwrap();
    assert!((37.4..39.5).contains(&sum), "{sum}");
    let masked = compared["masked_pixels"].as_f64().unwrap();
    let bits = compared["bits_per_sample"].as_f64().unwrap();
    assert!((bits - 8.0 * bytes as f64 / (3.0 * masked)).abs() < 1e-9);
    assert!(compared["coverage"].as_f64().unwrap() > 0.95);
    assert_eq!(std::fs::read_dir(&pictures).unwrap().count(), 4 + 2);

    // The decoded capture encodes again, and is nearly as near to the photographs as the file.
    let decoded = path("decoded");
    let said = output(&["decode", file, "-o", text(&decoded), "--preview"]);
    assert!(said.starts_with("36 of 36 views"), "{said}");
    let again = path("again.tsuya");
    tsuya(&["encode", text(&decoded), "-o", text(&again)]).code(0);
    let twice = json(&["compare", text(&again), capture, "--json"]);
    let second = twice["image_psnr_db"]["sum"].as_f64().unwrap();
    assert!(second > sum - 1.1, "{sum} {second}");

    let info = json(&["info", file, "--json"]);
    assert_eq!((&info["profile"], &info["relightable"]), (&"predictive".into(), &true.into()));
    assert_eq!(info["views"].as_array().unwrap().len(), 36);
    assert_eq!(info["metadata"]["title"], "sample-spot");
    assert!(output(&["info", file]).contains("can be relit: yes"));
}

#[test]
fn wavelet_texture_with_its_figures() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("p.tsuya");
    let (file, capture) = (text(&file), sample());
    let report =
        json(&["encode", text(&capture), "-o", file, "--profile", "wavelet-texture", "--keep-percent", "5", "--json"]);
    assert!((report["kept_percent"].as_f64().unwrap() - 5.0).abs() < 0.05);
    for domain in ["linear", "sqrt"] {
        for component in ["diffuse", "specular"] {
            let db = report["sample_psnr_db"][domain][component].as_f64().unwrap();
            assert!((25.0..60.0).contains(&db), "{domain} {component}: {db}");
        }
    }
    assert!(report["bytes"].as_u64().unwrap() < 360_000);
    assert!(report["image_psnr_db"]["sum"].as_f64().unwrap() > 29.0);
    assert!(output(&["verify", file, "--deep"]).contains("36 of 36"));
}

#[test]
fn measured_lobes_take_the_place_of_torrance_and_sparrow() {
    let folder = tempfile::tempdir().unwrap();
    let capture = sample();
    let encoded = |name: &str, model: &str| {
        let file = folder.path().join(name);
        let file = text(&file);
        tsuya(&["encode", text(&capture), "-o", file, "--hold-out", "6", "--specular", model]).code(0);
        assert!(output(&["verify", file, "--deep"]).contains("30 of 30"));
        let compared = json(&["compare", file, text(&capture), "--json"]);
        let decibel = |key: &str| compared["held_out_psnr_db"]["model"][key].as_f64().unwrap();
        (std::fs::metadata(file).unwrap().len(), decibel("specular"), decibel("sum"))
    };
    let (gaussian, lobes) = (encoded("g.tsuya", "torrance-sparrow"), encoded("l.tsuya", "dsbrdf"));
    assert!(lobes.1 > gaussian.1 && lobes.2 > gaussian.2, "{lobes:?} {gaussian:?}");
    assert!(output(&["info", text(&folder.path().join("l.tsuya"))]).contains("measured lobes"));
    assert!(lobes.0 < gaussian.0 + 2000, "{lobes:?} {gaussian:?}");
    let (file, picture) = (folder.path().join("l.tsuya"), folder.path().join("relit.png"));
    tsuya(&["render", text(&file), "-o", text(&picture), "--view", "9", "--light", "-3,2,1"]).code(0);

    // The palette comes out as materials, which measured ones are evaluated like.
    let (out, directions) = (folder.path().join("out"), folder.path().join("d.csv"));
    tsuya(&["decode", text(&file), "-o", text(&out), "--views", "0"]).code(0);
    let palette = out.join("maps/palette.tsuya");
    let described = json(&["info", text(&palette), "--json"]);
    let entries = json(&["info", text(&file), "--json"])["palette_entries"].as_u64().unwrap();
    let materials = described["materials"].as_array().unwrap();
    assert!((1..=4).contains(&entries) && materials.len() as u64 == entries, "{described}");
    let name = materials[0]["name"].as_str().unwrap();
    let sigma: f64 = name.strip_prefix("sigma ").unwrap().parse().unwrap();
    assert!((0.02..0.8).contains(&sigma), "{name}");
    std::fs::write(&directions, "0,0,1,0,0,1\n0.6,0,0.8,0,0,1\n").unwrap();
    let values = output(&["brdf", "eval", text(&palette), "--directions", text(&directions), "--material", name]);
    let values: Vec<f64> = values.lines().flat_map(|row| row.split(',')).map(|x| x.parse().unwrap()).collect();
    assert!(values.len() == 6 && (0..3).all(|c| values[c] > values[3 + c]), "{values:?}");
    let gltf = folder.path().join("l.glb");
    tsuya(&["gltf", "export", text(&file), "-o", text(&gltf)]).code(0);

    let paper = ["--profile", "wavelet-texture", "--specular", "dsbrdf"];
    let none = folder.path().join("none.tsuya");
    let refused = complaint(1, &[&["encode", text(&capture), "-o", text(&none)], &paper[..]].concat());
    assert!(refused.contains("profile predictive"), "{refused}");
    // Older names of options are read, but not shown.
    let older = ["--profile", "paper", "--decoding", "fast", "--keep", "5"];
    let refused = complaint(1, &[&["encode", text(&capture), "-o", text(&none)], &older[..]].concat());
    assert!(refused.contains("--faster-decoding goes with profile predictive"), "{refused}");
    let help = output(&["encode", "--help"]);
    assert!(["tuned", "paper", "--decoding", "--keep "].iter().all(|name| !help.contains(name)), "{help}");
}

#[test]
fn views_between_are_interpolated_and_one_view_is_read_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (file, capture) = (path("h.tsuya"), sample());
    let file = text(&file);
    tsuya(&["encode", text(&capture), "-o", file, "--hold-out", "6"]).code(0);
    let compared = json(&["compare", file, text(&capture), "--json"]);
    assert_eq!(compared["frames"].as_array().unwrap().len(), 30);
    let held_out = &compared["held_out_psnr_db"];
    has_keys(held_out, &["diffuse", "specular", "sum"]);
    let (interpolated, nearest) = (held_out["sum"].as_f64().unwrap(), held_out["nearest"]["sum"].as_f64().unwrap());
    assert!(interpolated > nearest + 1.5 && interpolated > 21.0, "{interpolated} {nearest}");

    let one = json(&["decode", file, "-o", text(&path("one")), "--views", "off/003.exr", "--json"]);
    assert_eq!(one["views"], 1);
    assert!(one["bytes_read"].as_u64().unwrap() < one["bytes"].as_u64().unwrap() / 2, "{one}");
    assert!(path("one/off/003.exr").exists() && !path("one/off/000.exr").exists());
    let mesh = path("m.ply");
    tsuya(&["decode", file, "-o", text(&mesh), "--mesh-only"]).code(0);
    assert!(std::fs::metadata(mesh).unwrap().len() > 20_000);
    let section = assert_cmd::cargo::cargo_bin_cmd!("tsuya")
        .args(["decode", "-", "-o", "-", "--section", "mETA"])
        .write_stdin(std::fs::read(file).unwrap())
        .assert()
        .code(0);
    let metadata: Value = serde_json::from_slice(&section.get_output().stdout).unwrap();
    assert!(metadata["achieved_error"]["sum_psnr_db"].as_f64().unwrap() > 30.0);

    // Pictures: the light moves, the numbers come, the same is not written twice.
    let picture = |name: &str, more: &[&str]| {
        let place = path(name);
        tsuya(&[&["render", file, "-o", text(&place)], more].concat()).code(0);
        std::fs::read(place).unwrap()
    };
    let captured = picture("captured.png", &["--view", "9"]);
    let relit = picture("relit.png", &["--view", "9", "--light", "-3,2,1"]);
    let nearest = picture("nearest.png", &["--view", "9", "--nearest", "--layers", "model,residual"]);
    picture("free.exr", &["--camera", "0,1.5,4,0,0,0", "--fov", "40", "--size", "60x40", "--layers", "model"]);
    assert!(captured != relit && captured != nearest);
    // A captured camera gives its photograph unless more samples are asked for.
    let sampled = |samples: &str| picture(&format!("{samples}.png"), &["--view", "9", "--samples", samples]);
    assert!(sampled("1") == captured && sampled("2") != captured);
    tsuya(&["render", file, "-o", text(&path("o.png")), "--orbit", "2", "--size", "32x32"]).code(0);
    assert!(path("o-000.png").exists() && path("o-001.png").exists());
    assert!(complaint(2, &["render", file, "-o", text(&path("relit.png"))]).contains("--force"));
    // What would be left aside is refused.
    let refused = |more: &[&str]| complaint(1, &[&["render", file, "-o", text(&path("no.png"))], more].concat());
    assert!(refused(&["--env", "sky.hdr", "--layers", "diffuse"]).contains("both reflections"));
    assert!(refused(&["--env", "sky.hdr", "--nearest"]).contains("--nearest"));
    assert!(refused(&["--evaluator", "sg"]).contains("--env"));
    // What is wrong with an environment is said before the object is decoded.
    let no_light = ["render", "none.tsuya", "-o", "no.png", "--env", "none.hdr"];
    assert!(complaint(2, &no_light).contains("none.hdr"));
}

#[test]
fn threads_do_not_change_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let capture = variant(8, |_, _| {});
    for profile in ["predictive", "wavelet-texture"] {
        let files = ["1", "2"].map(|threads| {
            let file = folder.path().join(format!("{profile}-{threads}.tsuya"));
            let arguments = ["encode", text(capture.path()), "-o", text(&file), "--threads", threads, "--title", "x"];
            let report = json(&[&arguments[..], &["--profile", profile, "--json"]].concat());
            assert_eq!(report["threads"].to_string(), threads);
            std::fs::read(file).unwrap()
        });
        assert!(files[0] == files[1], "{profile}");
    }
}

#[test]
fn former_flags_are_taken() {
    let folder = tempfile::tempdir().unwrap();
    let capture = variant(8, |_, _| {});
    let encoded = |name: &str, flags: &[&str]| {
        let file = folder.path().join(name);
        tsuya(&[&["encode", text(capture.path()), "-o", text(&file), "--title", "x"], flags].concat()).code(0);
        std::fs::read(file).unwrap()
    };
    let predictive = ["--profile", "predictive", "--faster-decoding", "1"];
    assert!(encoded("a", &predictive) == encoded("b", &["--profile", "tuned", "--decoding", "fast"]));
    let wavelet_texture = ["--profile", "wavelet-texture", "--keep-percent", "3"];
    assert!(encoded("c", &wavelet_texture) == encoded("d", &["--profile", "paper", "--keep", "3"]));
}

#[test]
fn exit_codes_and_output_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let capture = variant(3, |_, _| {});
    let capture = text(capture.path());
    let file = path("a.tsuya");
    let file = text(&file);
    tsuya(&["encode", capture, "-o", file]).code(0);
    let original = std::fs::read(file).unwrap();
    assert!(complaint(2, &["encode", capture, "-o", file]).contains("--force"));
    assert_eq!(std::fs::read(file).unwrap(), original);
    tsuya(&["encode", capture, "-o", file, "--force", "--quality", "50"]).code(0);
    assert!(std::fs::metadata(file).unwrap().len() < original.len() as u64);
    std::fs::write(file, &original).unwrap();

    complaint(1, &["frobnicate"]);
    complaint(1, &["encode", capture, "-o", file, "--force", "--quality", "200"]);
    complaint(1, &["encode", capture, "-o", file, "--force", "--quality", "50", "--psnr", "40"]);
    complaint(1, &["decode", file, "-o", text(&path("d")), "--views", "99"]);
    assert!(complaint(4, &["verify", file, "--deep", "--max-memory", "1"]).contains("limit exceeded"));
    complaint(2, &["info", text(&path("none.tsuya"))]);
    complaint(2, &["encode", text(&path("none")), "-o", text(&path("b.tsuya"))]);
    complaint(5, &["encode", capture, "-o", text(&path("b.tsuya")), "--color-space", "slog3"]);
    std::fs::write(path("empty.tsuya"), b"").unwrap();
    assert!(complaint(3, &["verify", text(&path("empty.tsuya"))]).contains("ends"));
    complaint(3, &["info", text(&path("empty.tsuya"))]);
    // A true file with another capture's figures.
    let other = variant(3, |description, folder| {
        let frames = description["frames"].as_array_mut().unwrap();
        let [a, b] = [0, 1].map(|k| folder.join(frames[k]["file_path"].as_str().unwrap()));
        std::fs::copy(a, b).unwrap();
    });
    assert!(complaint(4, &["verify", file, "--against", text(other.path())]).contains("stated"));

    // A cut file is an error, and what stands before the cut can be had.
    let cut = path("cut.tsuya");
    std::fs::write(&cut, &original[..original.len() * 2 / 3]).unwrap();
    complaint(3, &["decode", text(&cut), "-o", text(&path("cut"))]);
    let salvaged = complaint(4, &["decode", text(&cut), "-o", text(&path("cut")), "--salvage"]);
    assert!(salvaged.contains("lost: ") && path("cut/mesh.ply").exists(), "{salvaged}");
    // So is one of a later version.
    let mut later = original.clone();
    later[8] = 9;
    std::fs::write(&cut, later).unwrap();
    complaint(5, &["info", text(&cut)]);

    assert!(output(&["completions", "bash"]).contains("tsuya"));
    tsuya(&["man", "-o", text(&path("man"))]).code(0);
    assert!(path("man/tsuya-encode.1").exists() && path("man/tsuya.1").exists());
    assert!(output(&["--version"]).starts_with("tsuya "));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_nothing_behind() {
    let capture = variant(3, |_, _| {});
    let said = complaint(2, &["encode", text(capture.path()), "-o", "/dev/full"]);
    assert!(said.contains("/dev/full: No space left"), "{said}");
    // A file may not grow beyond four blocks.
    let folder = tempfile::tempdir().unwrap();
    let script = r#"trap '' XFSZ; ulimit -f 4; exec "$0" encode "$1" -o "$2/a.tsuya""#;
    let status = std::process::Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_tsuya"), text(capture.path()), text(folder.path())])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&status.stderr);
    assert_eq!(status.status.code(), Some(2), "{said}");
    assert!(said.contains("a.tsuya"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "a partial file is left");
}

#[test]
fn the_demo_writes_its_files_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let capture = variant(8, |_, _| {});
    std::fs::write(folder.path().join("mine.txt"), b"kept").unwrap();
    let arguments = ["demo", "-o", text(folder.path()), "--capture", text(capture.path())];
    assert!(output(&arguments).contains("predictive"));
    output(&arguments);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3 + 12 + 1);
    assert_eq!(std::fs::read(folder.path().join("mine.txt")).unwrap(), b"kept");
}

#[test]
fn a_mesh_is_aligned_by_marked_points() {
    // The scan, moved; its vertices' images are the marks.
    let capture = support::read(&sample()).unwrap();
    let moved = variant(6, |description, folder| {
        description["mesh_file"] = "moved.ply".into();
        let mut mesh = tsuya::mesh::read(folder.join("scan.ply"), &Default::default()).unwrap();
        for p in &mut mesh.positions {
            *p = [p[1] + 0.5, -p[0], p[2] - 2.0];
        }
        let mut ply = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
             property list uchar int vertex_indices\nend_header\n",
            mesh.positions.len(),
            mesh.triangles.len()
        );
        mesh.positions.iter().for_each(|p| ply += &format!("{} {} {}\n", p[0], p[1], p[2]));
        mesh.triangles.iter().for_each(|t| ply += &format!("3 {} {} {}\n", t[0], t[1], t[2]));
        std::fs::write(folder.join("moved.ply"), ply).unwrap();
    });
    let mut points = Vec::new();
    for frame in &capture.frames[..2] {
        for p in capture.mesh.positions.iter().step_by(90) {
            let (pixel, _) = frame.view.camera.project(p.map(f64::from)).unwrap();
            if pixel.iter().all(|x| (0.0..128.0).contains(x)) {
                let mesh = [p[1] + 0.5, -p[0], p[2] - 2.0];
                points.push(serde_json::json!({"frame": frame.view.name, "pixel": pixel, "mesh": mesh}));
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("points.json"), serde_json::json!({"points": points}).to_string()).unwrap();
    let (points, pose) = (path("points.json"), path("pose.json"));
    let arguments = ["align", text(moved.path()), text(&points), "-o", text(&pose), "--json"];
    let report = json(&[&arguments[..], &["--write-mesh", text(&path("mesh.ply"))]].concat());
    assert!(report["rms_pixels"].as_f64().unwrap() < 0.01, "{report}");
    let (one, two) = (path("one.tsuya"), path("two.tsuya"));
    tsuya(&["encode", text(moved.path()), "-o", text(&one), "--mesh-pose", text(&pose)]).code(0);
    tsuya(&["encode", text(moved.path()), "-o", text(&two), "--mesh", text(&path("mesh.ply"))]).code(0);
    for file in [one, two] {
        let coverage = json(&["compare", text(&file), text(moved.path()), "--json", "--mesh-pose", text(&pose)]);
        assert!(coverage["coverage"].as_f64().unwrap() > 0.94, "{coverage}");
    }
}

#[test]
fn check_tells_what_does_not_agree() {
    let found = json(&["check", text(&sample()), "--json"]);
    assert!(found["agrees"].as_bool().unwrap() && found["agreement"]["silhouette_iou"].as_f64().unwrap() > 0.9);
    let capture = sample();
    let inverted = ["check", text(&capture), "--json", "--invert-masks"];
    let found: Value = serde_json::from_slice(&tsuya(&inverted).code(4).get_output().stdout).unwrap();
    assert_eq!(found["agrees"], false);
    assert!(found["agreement"]["cause"]["sentence"].as_str().unwrap().contains("the masks are inverted"), "{found}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.tsuya");
    let said = complaint(3, &["encode", text(&sample()), "-o", text(&file), "--invert-masks"]);
    assert!(said.contains("the masks are inverted") && said.contains("unchecked"), "{said}");
    assert!(!file.exists());
    tsuya(&["encode", text(&sample()), "-o", text(&file), "--invert-masks", "--unchecked", "--quality", "30"]).code(0);
}

/// The ranges of a plan hold what the encode then takes; nothing is written.
#[test]
fn a_plan_holds_what_the_encode_takes() {
    let sample = sample();
    let plan = json(&["encode", text(&sample), "--plan", "--json"]);
    assert_eq!((plan["photographs"].as_u64(), plan["pixels"].as_u64()), (Some(36), Some(36 * 128 * 128)));
    assert_eq!(plan["largest"], serde_json::json!([128, 128]));
    let within = |key: &str, value: usize| {
        let [least, most] = [0, 1].map(|end| plan[key][end].as_u64().unwrap() as usize);
        assert!(least < value && value < most, "{key}: {value} is not between {least} and {most}");
    };
    within("bytes", support::encoded_sample().bytes.len());
    let frames = support::read(&sample).unwrap().frames;
    within("masked_pixels", frames.iter().map(|frame| frame.mask.as_ref().unwrap().count()).sum());
    let coarser = json(&["encode", text(&sample), "--plan", "--quality", "50", "--json"]);
    assert!(coarser["bytes"][1].as_f64() < plan["bytes"][1].as_f64());
    assert!(output(&["encode", text(&sample), "--plan"]).starts_with("photographs        36 of 0.6 megapixels"));
    complaint(1, &["encode", text(&sample), "--plan", "-o", "never.tsuya"]);
}
