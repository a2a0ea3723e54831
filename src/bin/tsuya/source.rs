//! Opening `.tsuya` files, from disk or standard input.

use crate::output::is_stream;
use anyhow::{Context, Result};
use std::io::{Cursor, Read, Seek};
use std::path::Path;
use std::sync::OnceLock;
use tsuya::Asset;
use tsuya::Limits;
use tsuya::container::{Container, Tag};
use tsuya::decoder::{DecodeOptions, ViewSelection, decode_from};
use tsuya::input::{self, FileAccess};

static LIMITS: OnceLock<Limits> = OnceLock::new();

/// Bounds on what a file may ask for, as the command line has them.
pub fn limits() -> Limits {
    LIMITS.get().copied().unwrap_or_default()
}

/// Sets the memory that a file may ask for, once.
pub fn set_memory_limit(mebibytes: u64) {
    let _ = LIMITS.set(Limits { memory_bytes: mebibytes.saturating_mul(1 << 20), ..Limits::default() });
}

/// A file, or standard input held in memory.
pub trait Source: Read + Seek {}
impl<T: Read + Seek> Source for T {}

/// A readable file; `-` is standard input.
pub fn open(path: &Path) -> tsuya::Result<Box<dyn Source>> {
    if is_stream(path) {
        return Ok(Box::new(Cursor::new(read(path)?)));
    }
    Ok(Box::new(input::open(path)?.0))
}

/// The account of one job's input: as much as a file may ask for.
pub fn access() -> FileAccess {
    FileAccess::new(limits())
}

/// The bytes of a file or of standard input, no more than the limit.
pub fn read(path: &Path) -> tsuya::Result<Vec<u8>> {
    read_at_most(path, "file", u64::MAX)
}

/// The same, of at most `max_bytes`, which what it is has.
pub fn read_at_most(path: &Path, what: &'static str, max_bytes: u64) -> tsuya::Result<Vec<u8>> {
    let access = access();
    let bytes = if is_stream(path) {
        access.read_stream(path, what, std::io::stdin().lock(), max_bytes)?
    } else {
        access.read_bytes(path, what, max_bytes)?
    };
    Ok(bytes.keep())
}

/// Whether a path has an extension, in small or capital letters.
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// Opens a container; errors name the file.
pub fn open_container(path: &Path) -> Result<Container<Box<dyn Source>>> {
    Container::open_seek(open(path)?, limits()).with_context(|| name(path))
}

/// Decodes a file.
pub fn decode(path: &Path, selection: ViewSelection) -> Result<(Asset, u64)> {
    let mut file = open_container(path)?;
    let options = DecodeOptions { selection, limits: limits(), ..Default::default() };
    let asset = decode_from(&mut file, &options).with_context(|| name(path))?;
    Ok((asset, file.file_bytes()))
}

/// The light of a file.
pub fn read_light(path: &Path) -> Result<tsuya::lighting::EnvironmentLobes> {
    let mut file = open_container(path)?;
    let section = file.read_section(Tag::LIGHT).with_context(|| name(path))?;
    tsuya::lighting::decode(&section, &file.budget()).with_context(|| name(path))
}

/// How messages call a file.
pub fn name(path: &Path) -> String {
    if is_stream(path) { "standard input".into() } else { path.display().to_string() }
}
