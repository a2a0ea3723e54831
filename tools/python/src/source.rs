//! Where a file's bytes come from.

use crate::errors::raise;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyMemoryView};
use std::io::{Cursor, Read, Seek};
use std::path::PathBuf;
use std::sync::Arc;
use tsuya::Limits;
use tsuya::container::Container;

/// What a container is read from.
pub trait Stream: Read + Seek + Send {}
impl<T: Read + Seek + Send> Stream for T {}

/// A file, opened anew for each use, or bytes.
#[derive(Clone)]
pub enum Source {
    Path(PathBuf),
    Bytes(Arc<[u8]>),
}

impl Source {
    /// A path, bytes (or a bytearray or memoryview, copied), or anything with `read()`.
    pub fn new(given: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(bytes) = given.cast::<PyBytes>() {
            return Ok(Source::Bytes(bytes.as_bytes().into()));
        }
        if given.is_instance_of::<PyByteArray>() || given.is_instance_of::<PyMemoryView>() {
            let bytes = given.py().get_type::<PyBytes>().call1((given,))?;
            return Source::new(&bytes);
        }
        if let Ok(path) = given.extract() {
            return Ok(Source::Path(path));
        }
        let read = given.getattr("read").map_err(|_| {
            PyTypeError::new_err("a file is given as a path, as bytes or as something with a method `read`")
        })?;
        let content = read.call0()?;
        let bytes =
            content.cast::<PyBytes>().map_err(|_| PyTypeError::new_err("the file's `read` does not return bytes"))?;
        Ok(Source::Bytes(bytes.as_bytes().into()))
    }

    /// Opens the container.
    pub fn open(&self, limits: Limits) -> tsuya::Result<Container<Box<dyn Stream>>> {
        let stream: Box<dyn Stream> = match self {
            Source::Path(path) => Box::new(tsuya::input::open(path)?.0),
            Source::Bytes(bytes) => Box::new(Cursor::new(bytes.clone())),
        };
        Container::open_seek(stream, limits)
    }

    /// How the file is called, as far as it is.
    pub fn name(&self) -> String {
        match self {
            Source::Path(path) => path.display().to_string(),
            Source::Bytes(bytes) => format!("{} bytes", bytes.len()),
        }
    }
}

/// Limits with this memory, the default without.
pub fn limits(memory_bytes: Option<u64>) -> Limits {
    let default = Limits::default();
    Limits { memory_bytes: memory_bytes.unwrap_or(default.memory_bytes), ..default }
}

/// Does work of the library without the interpreter's lock.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> tsuya::Result<T> + Send) -> PyResult<T> {
    py.detach(work).map_err(raise)
}
