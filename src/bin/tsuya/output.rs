//! Writing: never over an existing file unasked, never a part of a file under its name.

use anyhow::Result;
use std::io::{Error as IoError, ErrorKind, Write};
use std::path::Path;
use tsuya::Error;

/// True for `-`, standard input or output.
pub fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Prints to standard output.
pub fn say(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|e| Error::io("-", e))?;
    Ok(())
}

/// Prints a value as JSON to standard output.
pub fn say_json(value: &serde_json::Value) -> Result<()> {
    say(&format!("{value:#}\n"))
}

/// Prints a line to standard error; nobody hears of it if that is closed.
pub fn complain(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Prints warnings to standard error.
pub fn warn(warnings: &[String]) {
    warnings.iter().for_each(|warning| complain(&format!("warning: {warning}")));
}

/// An error where a file stands that may not be overwritten. Asked before long work.
pub fn check_free(path: &Path, force: bool) -> Result<()> {
    if !force && !is_stream(path) && path.is_file() {
        return Err(exists(path).into());
    }
    Ok(())
}

fn exists(path: &Path) -> Error {
    Error::io(path, IoError::new(ErrorKind::AlreadyExists, "exists already; --force overwrites it"))
}

/// A folder to write into: made if there is none, and empty unless `force`.
pub fn folder(path: &Path, force: bool) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| Error::io(path, e))?;
    let mut entries = std::fs::read_dir(path).map_err(|e| Error::io(path, e))?;
    if !force && entries.next().is_some() {
        let error = IoError::new(ErrorKind::AlreadyExists, "the folder is not empty; --force writes into it");
        return Err(Error::io(path, error).into());
    }
    Ok(())
}

/// Writes a whole file: beside its place under another name, then renamed, so that it is there whole or not at all.
/// `-` is standard output; devices and pipes are written directly.
pub fn write(path: &Path, bytes: &[u8], force: bool) -> Result<()> {
    let failed = |e| Error::io(path, e);
    if is_stream(path) {
        let mut out = std::io::stdout().lock();
        return Ok(out.write_all(bytes).and_then(|()| out.flush()).map_err(failed)?);
    }
    if std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
        let mut file = std::fs::OpenOptions::new().write(true).open(path).map_err(failed)?;
        return Ok(file.write_all(bytes).and_then(|()| file.flush()).map_err(failed)?);
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".tsuya-");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(folder).map_err(failed)?;
    // Whatever fails from here on, the temporary file is removed when it is dropped.
    file.write_all(bytes).and_then(|()| file.as_file().sync_data()).map_err(failed)?;
    let persisted = if force { file.persist(path) } else { file.persist_noclobber(path) };
    match persisted {
        Ok(_) => Ok(()),
        Err(e) if e.error.kind() == ErrorKind::AlreadyExists => Err(exists(path).into()),
        Err(e) => Err(failed(e.error).into()),
    }
}

/// As [`write`], making the folders above.
pub fn write_below(path: &Path, bytes: &[u8], force: bool) -> Result<()> {
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
    }
    write(path, bytes, force)
}
