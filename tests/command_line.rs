//! What all commands share: how much they say, names of options, manual pages.

use crate::support::{encoded_sample, json, output, text, tsuya};
use std::process::Command;

#[test]
fn quiet_commands_say_what_was_asked_for_and_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    let file = path("a.tsuya");
    std::fs::write(&file, &encoded_sample().bytes).unwrap();
    for (told, arguments) in [
        (false, vec!["gltf", "export", &file, "-o", &path("a.glb")]),
        (false, vec!["decode", &file, "-o", &path("out"), "--views", "0"]),
        (false, vec!["repair", &file, "-o", &path("b.tsuya")]),
        // These are asked for what they say.
        (true, vec!["info", &file]),
        (true, vec!["verify", &file]),
        (true, vec!["decode", &file, "-o", &path("other"), "--views", "0", "--json"]),
    ] {
        let run = Command::new(env!("CARGO_BIN_EXE_tsuya")).arg("--quiet").args(&arguments).output().unwrap();
        assert!(run.status.success() && run.stderr.is_empty(), "{arguments:?}");
        assert_eq!(!run.stdout.is_empty(), told, "{arguments:?}");
    }
    let run = Command::new(env!("CARGO_BIN_EXE_tsuya")).args(["-q", "info", &path("none")]).output().unwrap();
    assert!(run.status.code() == Some(2) && !run.stderr.is_empty());
    let verified = json(&["verify", &file, "--deep", "--json"]);
    assert_eq!((&verified["views"], &verified["views_decoded"]), (&36.into(), &36.into()));
    assert_eq!(verified["bytes"], encoded_sample().bytes.len());
}

#[test]
fn one_thing_has_one_name_and_earlier_ones_are_taken() {
    for (command, name, earlier) in [
        (&["render"][..], "--environment", "--env"),
        (&["ar"], "--environment", "--env"),
        (&["brdf", "fit"], "--environment", "--env"),
        (&["brdf", "render"], "--environment", "--env"),
        (&["encode"], "--licence", "--license"),
    ] {
        let help = output(&[command, &["--help"]].concat());
        assert!(help.contains(&format!("{name} <")) && help.contains(&format!("[alias: {earlier}]")), "{command:?}");
    }
    // Those that help does not list.
    let said =
        crate::support::complaint(1, &["render", "none.tsuya", "-o", "a.png", "--env", "a.hdr", "--env-scale", "x"]);
    assert!(said.contains("--environment-scale"), "{said}");
}

#[test]
fn every_command_has_a_manual_page_and_examples() {
    let folder = tempfile::tempdir().unwrap();
    tsuya(&["man", "-o", text(folder.path())]).code(0);
    for name in ["tsuya", "tsuya-encode", "tsuya-brdf", "tsuya-brdf-fit", "tsuya-gltf-export", "tsuya-light-fit"] {
        let page = std::fs::read_to_string(folder.path().join(format!("{name}.1"))).unwrap();
        assert!(page.contains(".SH \"EXIT STATUS\"") && page.contains("not supported"), "{name}");
    }
    // Examples are command lines that are taken.
    for command in
        [&["encode"][..], &["decode"], &["render"], &["ar"], &["make"], &["gltf", "export"], &["brdf", "fit"]]
    {
        let help = output(&[command, &["--help"]].concat()).replace("\\\n", "");
        let examples: Vec<&str> = help.lines().filter(|line| line.starts_with("  tsuya ")).collect();
        assert!(!examples.is_empty(), "{command:?}");
        for example in examples {
            let (folder, program) = (text(folder.path()), env!("CARGO_BIN_EXE_tsuya"));
            let script = format!("cd '{folder}'; tsuya() {{ '{program}' \"$@\"; }}; {example}");
            let run = Command::new("sh").args(["-c", &script]).output().unwrap();
            let said = String::from_utf8_lossy(&run.stderr).into_owned();
            assert!(!said.contains("Usage:") && !said.contains("unexpected"), "{example}: {said}");
        }
    }
}
