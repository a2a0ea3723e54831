//! Errors, named after who is at fault.

use std::path::{Path, PathBuf};

/// Result of every fallible function of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Part of a `.tsuya` file that is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilePart {
    /// Bytes outside sections.
    File,
    /// The directory at the end of the file.
    Directory,
    /// A section, by the four letters of its tag.
    Section([u8; 4]),
}

impl std::fmt::Display for FilePart {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FilePart::File => f.write_str("file"),
            FilePart::Directory => f.write_str("directory"),
            FilePart::Section(tag) => tag.escape_ascii().fmt(f),
        }
    }
}

/// An error that names its actor: the system, the file, this build, the limits or the caller.
///
/// Messages name options of this library in the form ``option `name` `` and functions by their path, never flags of a program.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to read or write.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file, or `-` for a stream.
        path: PathBuf,
        /// The error of the operating system.
        #[source]
        source: std::io::Error,
    },
    /// A `.tsuya` file is wrong: section, byte offset and what the specification requires.
    #[error("section {section}, byte {offset}: {message}")]
    Format {
        /// Section, directory or file.
        section: FilePart,
        /// Offset within the section (within the file for [`FilePart::File`] and [`FilePart::Directory`]).
        offset: u64,
        /// The fault and what was expected.
        message: String,
    },
    /// An input file (photograph, mesh, capture description) is wrong.
    #[error("{path}: {message}", path = path.display())]
    Input {
        /// The file.
        path: PathBuf,
        /// Place within the file, fault, and remedy.
        message: String,
    },
    /// Valid, but not by this build or this version.
    #[error("not supported: {0}")]
    Unsupported(String),
    /// The input requests more than its [`crate::Limits`] allow.
    #[error("limit exceeded: {what} asks for {requested}, {allowed} allowed; raise the limit if the file is trusted")]
    Limits {
        /// The limited thing.
        what: &'static str,
        /// Requested amount.
        requested: u64,
        /// Remaining amount.
        allowed: u64,
    },
    /// An input file requests more memory than its [`crate::Limits`] allow.
    #[error("{path}: {what}: {requested} bytes of memory are requested, {allowed} are left; if the file is trusted, raise option `memory_bytes`", path = path.display())]
    InputMemory {
        /// The file.
        path: PathBuf,
        /// The charged thing.
        what: &'static str,
        /// Requested bytes.
        requested: u64,
        /// Remaining bytes.
        allowed: u64,
    },
    /// A file that was just encoded does not give back what was put into it: a defect of the encoder or the decoder.
    #[error("{0}")]
    Check(String),
    /// The caller requested for something impossible.
    #[error("{0}")]
    Parameter(String),
}

impl Error {
    /// An I/O error with its file.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Error::Io { path: path.as_ref().to_owned(), source }
    }
    /// An error in a section of a `.tsuya` file.
    pub fn format(section: impl Into<FilePart>, offset: impl TryInto<u64>, message: impl Into<String>) -> Self {
        Error::Format {
            section: section.into(),
            offset: offset.try_into().unwrap_or(u64::MAX),
            message: message.into(),
        }
    }
    /// An error in an input file.
    pub fn input(path: impl AsRef<Path>, message: impl Into<String>) -> Self {
        Error::Input { path: path.as_ref().to_owned(), message: message.into() }
    }
    /// Turns a [`Error::Limits`] into [`Error::InputMemory`] of `path`; other errors stay.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Error::Limits { what, requested, allowed } => {
                Error::InputMemory { path: path.to_owned(), what, requested, allowed }
            }
            other => other,
        }
    }
    /// An error of the caller.
    pub fn parameter(message: impl Into<String>) -> Self {
        Error::Parameter(message.into())
    }
}
