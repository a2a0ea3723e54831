//! What the program writes and prints, whatever happens to it and whatever is in its files.

use crate::support::{complaint, json, output, read, text, tsuya, variant};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tsuya::EncodeOptions;
use tsuya::encoder::encode;

/// All files below a folder with what they hold.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.clone(), std::fs::read(path).unwrap());
            }
        }
    }
    files
}

/// The sample with `frames` frames, encoded; `edit` changes the capture first.
fn encoded(frames: usize, path: &Path, quality: f64, edit: impl FnOnce(&mut tsuya::capture::Capture)) {
    let capture = variant(frames, |_, _| {});
    let mut capture = read(capture.path()).unwrap();
    edit(&mut capture);
    let target = Some(tsuya::EncodeTarget::Quality(quality));
    let options = EncodeOptions { target, ..Default::default() };
    std::fs::write(path, encode(capture, &options).unwrap().bytes).unwrap();
}

fn temporary(folder: &Path) -> usize {
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    names.filter(|name| name.to_string_lossy().starts_with(".tsuya-")).count()
}

#[cfg(unix)]
fn begin(arguments: &[&str]) -> std::process::Child {
    use std::process::{Command, Stdio};
    let mut command = Command::new(env!("CARGO_BIN_EXE_tsuya"));
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

#[cfg(unix)]
#[test]
fn a_killed_decode_leaves_the_old_folder_or_the_new_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let files = [path("0.tsuya"), path("1.tsuya")];
    files.iter().zip([40.0, 75.0]).for_each(|(file, quality)| encoded(3, file, quality, |_| {}));
    let out = path("out");
    let arguments = |k: usize| ["decode", text(&files[k]), "-o", text(&out), "--force"];
    let run = |k: usize| {
        tsuya(&arguments(k)).code(0);
        content(&out)
    };
    let begun = std::time::Instant::now();
    let states = [run(0), run(1)];
    let whole = begun.elapsed() / 2;
    for part in [2, 4, 5, 6, 7] {
        let before = content(&out);
        let next = (before == states[0]) as usize;
        let mut process = begin(&arguments(next));
        std::thread::sleep(whole * part / 8);
        process.kill().unwrap();
        process.wait().unwrap();
        assert!(states.contains(&content(&out)), "after {part}/8 of a run");
    }
    assert_eq!(run(0), states[0]);
    assert_eq!(temporary(folder.path()), 0);
}

#[cfg(unix)]
#[test]
fn a_signal_ends_the_program_as_signals_do_and_nothing_is_left() {
    use std::os::unix::process::ExitStatusExt;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.tsuya");
    encoded(3, &file, 75.0, |_| {});
    let out = folder.path().join("out");
    for (name, number) in [("INT", 2), ("TERM", 15)] {
        let mut process = begin(&["decode", text(&file), "-o", text(&out), "--force"]);
        while temporary(folder.path()) == 0 && process.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        std::process::Command::new("kill").args(["-s", name, &process.id().to_string()]).status().unwrap();
        let status = process.wait().unwrap();
        assert!(status.success() || status.signal() == Some(number), "{status}");
        assert_eq!(temporary(folder.path()), 0);
    }
}

#[cfg(unix)]
#[test]
fn files_keep_links_and_permissions_and_inputs_stay() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let capture = variant(3, |_, _| {});
    let folder = capture.path();
    let path = |name: &str| folder.join(name);
    let (file, link) = (path("a.tsuya"), path("link.tsuya"));
    tsuya(&["encode", text(folder), "-o", text(&file), "--quality", "40"]).code(0);
    let old = std::fs::read(&file).unwrap();
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o604)).unwrap();
    symlink("a.tsuya", &link).unwrap();
    assert!(complaint(2, &["encode", text(folder), "-o", text(&link)]).contains("--force"));
    tsuya(&["encode", text(folder), "-o", text(&link), "--force"]).code(0);
    assert!(link.symlink_metadata().unwrap().is_symlink() && std::fs::read(&file).unwrap() != old);
    assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o604);

    // No output is an input, by whatever name.
    let before = content(folder);
    std::fs::hard_link(path("scan.ply"), path("hard.tsuya")).unwrap();
    symlink("off/001.exr", path("soft.tsuya")).unwrap();
    for name in ["off/000.exr", "mask/../off/000.exr", "transforms.json", "hard.tsuya", "soft.tsuya", "white_off.exr"] {
        let said = complaint(1, &["encode", text(folder), "-o", text(&path(name)), "--force"]);
        assert!(said.contains("would be overwritten"), "{name}: {said}");
    }
    let refused: [&[&str]; 5] = [
        &["decode", "a.tsuya", "-o", "link.tsuya", "--mesh-only"],
        &["decode", "a.tsuya", "-o", "./a.tsuya", "--section", "MESH"],
        &["gltf", "export", "a.tsuya", "-o", "link.tsuya"],
        &["bake", "scan.ply", "-o", "hard.tsuya"],
        &["render", "a.tsuya", "-o", "a.png", "--env", "a.png"],
    ];
    symlink("a.tsuya", path("a.png")).unwrap();
    for arguments in refused {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("tsuya");
        let failed = command.args(arguments).arg("--force").current_dir(folder).assert().code(1);
        let said = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(said.contains("would be overwritten"), "{arguments:?}: {said}");
    }
    ["hard.tsuya", "soft.tsuya", "a.png"].iter().for_each(|name| std::fs::remove_file(path(name)).unwrap());
    assert!(content(folder) == before);
}

#[test]
fn a_folder_keeps_what_else_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let file = path("a.tsuya");
    encoded(3, &file, 75.0, |_| {});
    let out = path("out");
    std::fs::create_dir_all(out.join("off/raw")).unwrap();
    std::fs::write(out.join("off/raw/000.tif"), b"mine").unwrap();
    std::fs::write(out.join("mesh.ply"), b"old").unwrap();
    assert!(complaint(2, &["decode", text(&file), "-o", text(&out)]).contains("not empty; --force"));
    tsuya(&["decode", text(&file), "-o", text(&out), "--force"]).code(0);
    assert_eq!(std::fs::read(out.join("off/raw/000.tif")).unwrap(), b"mine");
    assert_ne!(std::fs::read(out.join("mesh.ply")).unwrap(), b"old");
    // Into the folder where one is: it stays the same folder, and here, too, all else stays.
    let whole = content(&out);
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("tsuya");
    command.args(["decode", text(&file), "-o", ".", "--force"]).current_dir(&out).assert().code(0);
    assert!(content(&out) == whole && temporary(&out) == 0 && temporary(folder.path()) == 0);
    // A folder in the way of a file is an error before anything is written.
    std::fs::remove_file(out.join("off/000.exr")).unwrap();
    std::fs::create_dir(out.join("off/000.exr")).unwrap();
    let before = content(&out);
    let said = complaint(2, &["decode", text(&file), "-o", text(&out), "--force"]);
    assert!(said.contains("off/000.exr: is a folder where a file is to be written"), "{said}");
    assert!(content(&out) == before && temporary(folder.path()) == 0);
}

#[test]
fn views_of_any_name_are_decoded_apart_and_into_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let file = path("a.tsuya");
    let names = ["a", "a.exr/b", "A", "../../CON", "mesh.ply/x", "a?", "/etc/nul.exr"];
    encoded(names.len(), &file, 40.0, |capture| {
        capture.frames.iter_mut().zip(names).for_each(|(frame, name)| frame.view.name = name.into());
    });
    let out = path("below/out");
    tsuya(&["decode", text(&file), "-o", text(&out)]).code(0);
    let description: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("transforms.json")).unwrap()).unwrap();
    let written: Vec<&str> =
        description["frames"].as_array().unwrap().iter().map(|frame| frame["file_path"].as_str().unwrap()).collect();
    let expected =
        ["a.exr", "a.exr_/b.exr", "A-002.exr", "_CON.exr", "photograph/mesh.ply/x.exr", "a-005.exr", "etc/_nul.exr"];
    assert_eq!(written, expected);
    assert!(written.iter().all(|name| out.join(name).is_file()));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    tsuya(&["encode", text(&out), "-o", text(&path("again.tsuya"))]).code(0);
}

#[test]
fn nothing_in_a_file_steers_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.tsuya");
    let (title, view) = ("\u{1b}]0;x\u{7}\u{9b}31m\nverified: OK", "off/\u{202e}gnp.000\u{1b}[2J.exr");
    encoded(3, &file, 40.0, |capture| {
        capture.name = title.into();
        capture.frames[0].view.name = view.into();
    });
    let file = text(&file);
    let shown = output(&["info", file]);
    assert!(shown.contains(r"title: \u{1b}]0;x\u{7}\u{9b}31m\nverified: OK"), "{shown}");
    let printed = output(&["info", file, "--json"]);
    assert!(printed.chars().all(|c| !c.is_control() || c == '\n') && !printed.contains('\u{202e}'), "{printed}");
    let info = json(&["info", file, "--json"]);
    assert_eq!((&info["metadata"]["title"], &info["views"][0]["name"]), (&title.into(), &view.into()));
    // Errors, with what is in the file and with names of files.
    let mut broken = std::fs::read(file).unwrap();
    let at = broken.len() - 3000;
    broken[at] ^= 1;
    let hostile = folder.path().join("b\u{1b}[31m\u{202e}.tsuya");
    std::fs::write(&hostile, broken).unwrap();
    let is_harmless = |said: &str| said.chars().all(|c| !c.is_control() || c == '\n') && !said.contains('\u{202e}');
    for arguments in [&["verify", text(&hostile)][..], &["decode", text(&hostile), "-o", "none"]] {
        let said = complaint(3, arguments);
        assert!(said.contains(r"b\u{1b}[31m\u{202e}.tsuya") && is_harmless(&said), "{said}");
    }
    assert!(is_harmless(&complaint(1, &["info", text(&hostile), "x\u{1b}]0;x\u{7}"])));
}
