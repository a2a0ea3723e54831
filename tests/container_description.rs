//! The container as other programs are told of it: `spec/tsuya.ksy` for Kaitai Struct, `spec/tsuya.magic` for file(1).

use std::path::{Path, PathBuf};
use std::process::Command;
use tsuya::container::Container;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn golden_files() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(root().join("spec/vectors")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "tsuya"));
    files.sort();
    files
}

/// What the compiled description lists: version, and of each section tag, codec, stored bytes and checksum.
#[test]
fn kaitai_lists_the_sections_that_the_library_lists() {
    let output = Command::new("node").arg(root().join("tools/kaitai/check.mjs")).args(golden_files()).output();
    let Ok(output) = output else {
        println!("skipped: needs Node");
        return;
    };
    let complained = String::from_utf8_lossy(&output.stderr);
    if output.status.code() == Some(3) {
        println!("skipped: {complained}");
        return;
    }
    assert!(output.status.success(), "{complained}");
    let mut expected = String::new();
    for path in golden_files() {
        let bytes = std::fs::read(&path).unwrap();
        let container = Container::open_slice(&bytes, Default::default()).unwrap();
        expected += &format!("{} 0.1", path.file_name().unwrap().to_string_lossy());
        for section in container.sections() {
            expected += &format!(" {}:{}:{}:{:08x}", section.tag, section.codec as u8, section.stored, section.crc);
        }
        expected += "\n";
    }
    assert_eq!(String::from_utf8_lossy(&output.stdout), expected);
}

#[test]
fn file_knows_the_signature() {
    let magic = root().join("spec/tsuya.magic");
    let file = |arguments: &[&str], path: &Path| {
        let output = Command::new("file").arg("-b").args(arguments).arg("-m").arg(&magic).arg(path).output().ok()?;
        Some(String::from_utf8(output.stdout).unwrap())
    };
    let path = root().join("spec/vectors/light.tsuya");
    let Some(said) = file(&[], &path) else {
        println!("skipped: needs file(1)");
        return;
    };
    assert_eq!(said, "tsuya measured appearance, version 0.1, first section lIGt\n");
    assert_eq!(file(&["--mime-type"], &path).unwrap(), "model/vnd.tsuya\n");
    assert!(!file(&[], &root().join("Cargo.toml")).unwrap().contains("tsuya"));
}
