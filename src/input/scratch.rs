//! Temporary files of what may be larger than memory.

use std::path::{Path, PathBuf};
use tempfile::{SpooledTempFile, spooled_tempfile_in};

/// Bytes that stay in memory; a file with more is on disk.
const IN_MEMORY: usize = 32 << 20;

/// Returns the folder of temporary files: `TMPDIR`, or where the system has large ones, as `/tmp` may be in memory.
pub(crate) fn scratch_folder() -> PathBuf {
    let large = Path::new("/var/tmp");
    match std::env::var_os("TMPDIR").is_none() && cfg!(unix) && large.is_dir() {
        true => large.to_owned(),
        false => std::env::temp_dir(),
    }
}

/// Returns a temporary file without a name, which is gone when it is dropped.
pub(crate) fn scratch_file() -> SpooledTempFile {
    spooled_tempfile_in(IN_MEMORY, scratch_folder())
}
