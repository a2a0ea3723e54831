//! What the tests of the whole share: the sample, captures made of it, the program.

use assert_cmd::assert::Assert;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;
use tsuya::EncodeOptions;
use tsuya::capture::{self, Capture, CaptureReadOptions};
use tsuya::encoder::{EncodedFile, encode};

/// The folder of a bundled capture: `sample-spot`, or one that `tools/captures/make.py` makes: `dome`, `unpolarised`, `lens`, `sizes`.
pub fn bundled(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    assert!(path.is_dir(), "there is no bundled capture {name}");
    path
}

/// The largest of the bundled captures: a ring of 36 views.
pub fn sample() -> PathBuf {
    bundled("sample-spot")
}

/// A capture of the shared test data; `None`, after saying so, where it is not there.
pub fn shared(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let path = std::env::var_os("TSUYA_DATA").map_or_else(beside, PathBuf::from).join(name);
    if !path.exists() {
        eprintln!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

/// Runs the program.
pub fn tsuya(arguments: &[&str]) -> Assert {
    assert_cmd::cargo::cargo_bin_cmd!("tsuya").args(arguments).assert()
}

/// Runs the program, which must succeed, and gives its standard output.
pub fn output(arguments: &[&str]) -> String {
    String::from_utf8(tsuya(arguments).code(0).get_output().stdout.clone()).unwrap()
}

/// The same, as JSON.
pub fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&output(arguments)).unwrap()
}

/// What the program says to standard error when it ends with this code.
pub fn complaint(code: i32, arguments: &[&str]) -> String {
    String::from_utf8(tsuya(arguments).code(code).get_output().stderr.clone()).unwrap()
}

/// A path as text.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A copy of the sample with its first `frames` frames, its description changed by `edit`, which may also change files.
pub fn variant(frames: usize, edit: impl FnOnce(&mut Value, &Path)) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let source = sample();
    let mut description: Value =
        serde_json::from_slice(&std::fs::read(source.join("transforms.json")).unwrap()).unwrap();
    description["frames"].as_array_mut().unwrap().truncate(frames);
    let mut files: Vec<String> = ["scan.ply", "white_off.exr", "white_cross.exr"].map(String::from).to_vec();
    for frame in description["frames"].as_array().unwrap() {
        let paths = ["file_path", "cross_file_path", "mask_path"].map(|key| frame[key].as_str().unwrap().to_owned());
        files.extend(paths);
    }
    for file in files {
        let target = folder.path().join(&file);
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::copy(source.join(&file), target).unwrap();
    }
    edit(&mut description, folder.path());
    std::fs::write(folder.path().join("transforms.json"), description.to_string()).unwrap();
    folder
}

/// Reads a capture as it is.
pub fn read(path: &Path) -> tsuya::Result<Capture> {
    capture::read(path, &CaptureReadOptions::default())
}

/// Reads and encodes a capture with the defaults.
pub fn encode_default(path: &Path) -> tsuya::Result<EncodedFile> {
    encode(read(path)?, &EncodeOptions::default())
}

/// The sample encoded with the defaults, once a test program.
pub fn encoded_sample() -> &'static EncodedFile {
    static ENCODED: OnceLock<EncodedFile> = OnceLock::new();
    ENCODED.get_or_init(|| encode_default(&sample()).unwrap())
}
