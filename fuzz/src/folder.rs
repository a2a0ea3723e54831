//! One folder for each process, for readers that take paths.

use std::path::PathBuf;
use std::sync::LazyLock;
use tsuya::Limits;
use tsuya::input::FileAccess;

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("tsuya-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
});

/// The folder; `tools/fuzz` removes it.
pub fn path() -> PathBuf {
    FOLDER.clone()
}

/// Writes a file into the folder.
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = FOLDER.join(name);
    std::fs::write(&path, bytes).expect("room for a temporary file");
    path
}

/// What reading a file may use: little, so that what follows a claim is found.
pub fn limits() -> Limits {
    Limits { memory_bytes: 256 << 20, ..Limits::default() }
}

/// A fresh account of them.
pub fn access() -> FileAccess {
    FileAccess::new(limits())
}
