//! Bodies of answers: bytes that the program holds, or a part of a file, read piece by piece as it is sent.

use hyper::body::{Bytes, Frame, SizeHint};
use std::fs::{File, Metadata};
use std::io::{Error, Read, Result, Seek, SeekFrom};
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::SystemTime;
use tokio::task::{JoinHandle, spawn_blocking};

/// Bytes of a file that are read at once; a connection holds no more.
const PIECE_BYTES: u64 = 64 << 10;

/// An open file, and the version of its content.
pub struct OpenFile {
    file: File,
    version: Version,
    number: u64,
}

/// Length and time of the last change: another one whenever the file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Version {
    length: u64,
    modified: Option<SystemTime>,
}

impl Version {
    fn new(metadata: &Metadata) -> Self {
        Version { length: metadata.len(), modified: metadata.modified().ok() }
    }
}

/// Number of a file within its file system: another one when the file is replaced. 0 where the system has none.
#[cfg_attr(not(unix), allow(unused_variables))]
fn file_number(metadata: &Metadata) -> u64 {
    #[cfg(unix)]
    return std::os::unix::fs::MetadataExt::ino(metadata);
    #[cfg(not(unix))]
    return 0;
}

impl OpenFile {
    /// Wraps a regular file.
    pub fn new(file: File) -> Result<Self> {
        let metadata = file.metadata()?;
        Ok(OpenFile { version: Version::new(&metadata), number: file_number(&metadata), file })
    }

    /// Length in bytes.
    pub fn length(&self) -> u64 {
        self.version.length
    }

    /// Entity tag (RFC 9110, section 8.8.3) of the content.
    pub fn tag(&self) -> String {
        let modified = self.version.modified.and_then(|time| time.duration_since(SystemTime::UNIX_EPOCH).ok());
        let nanoseconds = modified.unwrap_or_default().as_nanos();
        format!("\"{:x}-{nanoseconds:x}-{:x}\"", self.version.length, self.number)
    }
}

/// Body of an answer.
pub enum Body {
    /// Bytes that are sent from where they are.
    Held(Bytes),
    /// Part of a file.
    File(FilePart),
}

impl Body {
    /// A body without bytes.
    pub fn empty() -> Self {
        Body::Held(Bytes::new())
    }

    /// The bytes of `file` from `first` to before `end`.
    pub fn part_of(file: OpenFile, first: u64, end: u64) -> Result<Self> {
        let OpenFile { mut file, version, .. } = file;
        file.seek(SeekFrom::Start(first))?;
        Ok(Body::File(FilePart { left: end - first, version, state: State::Idle(file) }))
    }
}

/// Part of a file that is still to be sent.
pub struct FilePart {
    left: u64,
    version: Version,
    state: State,
}

enum State {
    Idle(File),
    Reading(JoinHandle<Result<(File, Vec<u8>)>>),
    Ended,
}

impl FilePart {
    fn poll_piece(&mut self, context: &mut Context<'_>) -> Poll<Option<Result<Bytes>>> {
        if self.left == 0 {
            return Poll::Ready(None);
        }
        let mut reading = match std::mem::replace(&mut self.state, State::Ended) {
            State::Idle(file) => {
                let (count, version) = (self.left.min(PIECE_BYTES), self.version);
                spawn_blocking(move || read_piece(file, count, version))
            }
            State::Reading(reading) => reading,
            State::Ended => return Poll::Ready(None),
        };
        let Poll::Ready(read) = Pin::new(&mut reading).poll(context) else {
            self.state = State::Reading(reading);
            return Poll::Pending;
        };
        Poll::Ready(Some(read.map_err(Error::other).flatten().map(|(file, bytes)| {
            self.left -= bytes.len() as u64;
            self.state = State::Idle(file);
            bytes.into()
        })))
    }
}

/// Reads the next piece; an error where the file is not any more what the answer's head says of it.
fn read_piece(mut file: File, count: u64, version: Version) -> Result<(File, Vec<u8>)> {
    let mut bytes = vec![0; count as usize];
    file.read_exact(&mut bytes)?;
    if Version::new(&file.metadata()?) != version {
        return Err(Error::other("the file was changed while it was sent"));
    }
    Ok((file, bytes))
}

impl hyper::body::Body for Body {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>>>> {
        let piece = match &mut *self {
            Body::Held(bytes) if bytes.is_empty() => None,
            Body::Held(bytes) => Some(Ok(std::mem::take(bytes))),
            Body::File(part) => ready!(part.poll_piece(context)),
        };
        Poll::Ready(piece.map(|bytes| bytes.map(Frame::data)))
    }

    fn is_end_stream(&self) -> bool {
        match self {
            Body::Held(bytes) => bytes.is_empty(),
            Body::File(part) => part.left == 0,
        }
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(match self {
            Body::Held(bytes) => bytes.len() as u64,
            Body::File(part) => part.left,
        })
    }
}
