//! The door through which files from outside come in: photographs, meshes, descriptions, tables.
//!
//! Only regular files are opened, so that no read can block or go on for ever. Bytes are charged to the caller's [`Budget`] before they
//! are read, and what is read is what is there, whatever was claimed. Paths that a file names stay in its folder ([`Folder`]).

mod folder;
#[cfg(feature = "encode")]
mod scratch;

pub use folder::{Folder, percent_decoded};
#[cfg(feature = "encode")]
pub(crate) use scratch::{scratch_file, scratch_folder};

use crate::error::{Error, Result};
use crate::limits::{Budget, Limits, Reservation};
use std::collections::BTreeMap;
use std::fs::{File, Metadata};
use std::io::{Error as IoError, ErrorKind, Read};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Remarks of different text that are kept, at most.
const MAX_REMARKS: usize = 64;

/// Permissions of reading: one memory budget for all files of a job, and whether they may lie outside their folder; and what was remarked on the
/// files that were read.
#[derive(Debug)]
pub struct FileAccess {
    budget: Budget,
    allow_outside: bool,
    /// By text, with the first of the files by name and their number.
    remarks: Mutex<BTreeMap<String, (PathBuf, usize)>>,
}

impl Default for FileAccess {
    fn default() -> Self {
        FileAccess::new(Limits::default())
    }
}

impl FileAccess {
    /// A fresh account of these limits. Paths that files name must stay in their folders.
    pub fn new(limits: Limits) -> Self {
        FileAccess { budget: Budget::new(limits), allow_outside: false, remarks: Mutex::default() }
    }

    /// Allows files to name hidden files and files outside their folders if `allowed`.
    pub fn allow_outside(self, allowed: bool) -> Self {
        FileAccess { allow_outside: allowed, ..self }
    }

    /// Whether files may name others outside their folders.
    pub fn allows_outside(&self) -> bool {
        self.allow_outside
    }

    /// The account that everything is charged to.
    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// Notes something about a file that was read nevertheless, such as a part of it that has no effect.
    pub(crate) fn remark(&self, path: &Path, text: impl Into<String>) {
        let mut remarks = self.remarks.lock().unwrap_or_else(PoisonError::into_inner);
        let text = text.into();
        if remarks.len() < MAX_REMARKS || remarks.contains_key(&text) {
            let (first, count) = remarks.entry(text).or_insert_with(|| (path.to_owned(), 0));
            if path < first.as_path() {
                path.clone_into(first);
            }
            *count += 1;
        }
    }

    /// Returns what was remarked on the files read so far, one sentence for each text, in an order that does not depend on that of reading.
    pub fn remarks(&self) -> Vec<String> {
        let remarks = self.remarks.lock().unwrap_or_else(PoisonError::into_inner);
        let sentence = |(text, (first, count)): (&String, &(PathBuf, usize))| match count {
            1 => format!("{}: {text}", first.display()),
            _ => format!("{} and {} more: {text}", first.display(), count - 1),
        };
        remarks.iter().map(sentence).collect()
    }

    /// Charges memory that a file requests until the result is dropped; the error names the file.
    pub fn reserve(&self, path: &Path, what: &'static str, bytes: u64) -> Result<Reservation<'_>> {
        self.budget.reserve(what, bytes).map_err(|e| e.in_file(path))
    }

    /// Charges memory that a file requests for good; the error names the file.
    pub fn charge(&self, path: &Path, what: &'static str, bytes: u64) -> Result<()> {
        self.reserve(path, what, bytes).map(Reservation::keep)
    }

    /// The bytes of a regular file of at most `max_bytes`, charged while they are held.
    pub fn read_bytes(&self, path: &Path, what: &'static str, max_bytes: u64) -> Result<FileBytes<'_>> {
        let (mut file, size) = open(path)?;
        if size > max_bytes {
            return Err(Error::input(path, format!("{size} bytes: a {what} has {max_bytes} at most")));
        }
        let held = self.reserve(path, what, size)?;
        let mut bytes = Vec::new();
        // The size is the system's word for a file that is there, not a claim of its content.
        bytes.try_reserve_exact(size as usize).map_err(|e| Error::io(path, IoError::new(ErrorKind::OutOfMemory, e)))?;
        (&mut file).take(size).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
        if file.read(&mut [0]).map_err(|e| Error::io(path, e))? > 0 {
            return Err(Error::input(
                path,
                format!("the file goes on after its {size} bytes: is it still being written?"),
            ));
        }
        Ok(FileBytes { bytes, held })
    }

    /// As [`FileAccess::read_bytes`] for text: UTF-8, with or without a byte order mark, or UTF-16 with one.
    pub fn read_text(&self, path: &Path, what: &'static str, max_bytes: u64) -> Result<FileText<'_>> {
        let FileBytes { mut bytes, mut held } = self.read_bytes(path, what, max_bytes)?;
        let utf16 = match bytes.first_chunk() {
            Some([0xff, 0xfe]) => Some(u16::from_le_bytes as fn([u8; 2]) -> u16),
            Some([0xfe, 0xff]) => Some(u16::from_be_bytes as fn([u8; 2]) -> u16),
            _ => None,
        };
        if let Some(unit) = utf16 {
            // Two bytes become three at most.
            held.grow(what, 2 * bytes.len() as u64).map_err(|e| e.in_file(path))?;
            let (units, rest) = bytes[2..].as_chunks::<2>();
            let text: Option<String> =
                char::decode_utf16(units.iter().map(|&pair| unit(pair))).map(|c| c.ok()).collect();
            let text = text.filter(|_| rest.is_empty());
            let text = text.ok_or_else(|| Error::input(path, format!("damaged UTF-16 text; a {what} is text")))?;
            return Ok(FileText { text, _held: held });
        }
        if bytes.starts_with(&[0xef, 0xbb, 0xbf]) {
            bytes.drain(..3);
        }
        let text = String::from_utf8(bytes).map_err(|e| {
            let at = e.utf8_error().valid_up_to();
            Error::input(path, format!("not UTF-8 text at byte {at}; a {what} is text"))
        })?;
        Ok(FileText { text, _held: held })
    }

    /// The bytes of a stream such as standard input, of at most `max_bytes`, charged as they come.
    pub fn read_stream(
        &self,
        path: &Path,
        what: &'static str,
        stream: impl Read,
        max_bytes: u64,
    ) -> Result<FileBytes<'_>> {
        let mut held = self.reserve(path, what, 0)?;
        let mut bytes = Vec::new();
        let mut stream = stream.take(max_bytes.saturating_add(1));
        loop {
            // Grows with the bytes received: by an eighth, so that little is copied and little is allocated in vain.
            let step = (bytes.len() / 8).clamp(1 << 16, 1 << 26);
            held.grow(what, step as u64).map_err(|e| e.in_file(path))?;
            bytes.reserve_exact(step);
            let got = (&mut stream).take(step as u64).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
            if bytes.len() as u64 > max_bytes {
                return Err(Error::input(path, format!("more than {max_bytes} bytes, which a {what} has at most")));
            }
            if got < step {
                return Ok(FileBytes { bytes, held });
            }
        }
    }
}

/// The bytes of a file, charged until they are dropped.
#[derive(Debug)]
pub struct FileBytes<'a> {
    bytes: Vec<u8>,
    held: Reservation<'a>,
}

impl FileBytes<'_> {
    /// The bytes, which stay charged.
    pub fn keep(self) -> Vec<u8> {
        self.held.keep();
        self.bytes
    }
}

impl Deref for FileBytes<'_> {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

/// The text of a file, charged until it is dropped.
#[derive(Debug)]
pub struct FileText<'a> {
    text: String,
    _held: Reservation<'a>,
}

impl Deref for FileText<'_> {
    type Target = str;
    fn deref(&self) -> &str {
        &self.text
    }
}

/// Opens a regular file and returns its size in bytes. Folders, pipes, devices and sockets are refused before an open or a read can block.
pub fn open(path: &Path) -> Result<(File, u64)> {
    let failed = |e| Error::io(path, e);
    check_regular(path, &std::fs::metadata(path).map_err(failed)?)?;
    let file = File::open(path).map_err(failed)?;
    // Asked again of what was opened: the name may lead elsewhere by now.
    let metadata = file.metadata().map_err(failed)?;
    check_regular(path, &metadata)?;
    Ok((file, metadata.len()))
}

fn check_regular(path: &Path, metadata: &Metadata) -> Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let (kind, message) = if metadata.is_dir() {
        (ErrorKind::IsADirectory, "is a folder, not a file")
    } else {
        (ErrorKind::InvalidInput, "is a pipe, a device or a socket; only regular files are read")
    };
    Err(Error::io(path, IoError::new(kind, message)))
}

/// A text out of a file as messages show it: control characters escaped, cut after 80 characters.
pub fn escaped(text: &str) -> String {
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("{}...", text[..end].escape_debug()),
        None => text.escape_debug().to_string(),
    }
}

/// Returns [`escaped`] text in quotes.
pub fn quoted(text: &str) -> String {
    format!("\"{}\"", escaped(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_charged_while_they_are_held() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, [7; 1000]).unwrap();
        let access = FileAccess::new(Limits { memory_bytes: 1500, ..Limits::default() });
        let bytes = access.read_bytes(&path, "table", 1000).unwrap();
        assert_eq!((bytes.len(), access.budget().left()), (1000, 500));
        let error = access.read_bytes(&path, "table", 1000).unwrap_err().to_string();
        assert!(
            error.ends_with(
                "a: table: 1000 bytes of memory are requested, 500 are left; if the file is trusted, raise option `memory_bytes`"
            ),
            "{error}"
        );
        drop(bytes);
        assert_eq!(access.budget().left(), 1500);
        let error = access.read_bytes(&path, "table", 999).unwrap_err().to_string();
        assert!(error.ends_with("a: 1000 bytes: a table has 999 at most"), "{error}");
        assert_eq!(access.read_bytes(&path, "table", 1000).unwrap().keep(), [7; 1000]);
        assert_eq!(access.budget().left(), 500);
    }

    #[test]
    fn streams_grow_with_what_comes() {
        let access = FileAccess::new(Limits { memory_bytes: 1 << 20, ..Limits::default() });
        let read = |stream: &mut dyn Read, most| access.read_stream(Path::new("-"), "table", stream, most);
        assert_eq!(read(&mut &[5; 200_000][..], 1 << 20).unwrap().len(), 200_000);
        assert_eq!(access.budget().left(), 1 << 20);
        let endless = read(&mut std::io::repeat(1), u64::MAX).unwrap_err().to_string();
        assert!(endless.contains("raise option `memory_bytes`"), "{endless}");
        let long = read(&mut std::io::repeat(1), 100).unwrap_err().to_string();
        assert_eq!(long, "-: more than 100 bytes, which a table has at most");
    }

    #[test]
    fn folders_and_devices_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = open(folder.path()).unwrap_err().to_string();
        assert!(error.ends_with("is a folder, not a file"), "{error}");
        #[cfg(unix)]
        for device in ["/dev/zero", "/dev/null"] {
            let error = open(Path::new(device)).unwrap_err().to_string();
            assert_eq!(error, format!("{device}: is a pipe, a device or a socket; only regular files are read"));
        }
    }
}
