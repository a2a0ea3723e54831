//! Streams of YUV4MPEG2.

use super::{MAGIC, Y4mFrame, Y4mHeader};
use crate::error::{Error, Result};
use crate::input::{FileAccess, quoted};
use std::io::{BufRead, Read, Write};
use std::path::{Path, PathBuf};

/// Bytes of a line, at most.
const MAX_LINE: u64 = 1024;
/// What the line of a frame begins with.
const FRAME: &str = "FRAME";
/// Memory that a pixel takes beside its samples: the image before and after, bytes.
const BYTES_A_PIXEL: usize = 6;

/// Reads a stream of YUV4MPEG2 frame by frame.
pub struct Y4mReader<R> {
    stream: R,
    path: PathBuf,
    header: Y4mHeader,
    frames: usize,
}

impl<R: BufRead> Y4mReader<R> {
    /// Reads the header; errors name `path`. Memory of a frame is charged to `access` for good.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] for no such stream, [`Error::InputMemory`] for frames that are too large.
    pub fn new(mut stream: R, path: &Path, access: &FileAccess) -> Result<Self> {
        let line = read_line(&mut stream, path, "the header")?.unwrap_or_default();
        let header = Y4mHeader::parse(&line, path)?;
        // It may be written with another rate.
        if header.with_rate([u32::MAX; 2]).line().len() as u64 > MAX_LINE {
            return Err(Error::input(path, "its header's parameters are too long"));
        }
        let pixels = header.size[0] * header.size[1];
        access.charge(path, "video frame", (header.frame_bytes() + BYTES_A_PIXEL * pixels) as u64)?;
        Ok(Y4mReader { stream, path: path.to_owned(), header, frames: 0 })
    }

    /// The stream's header.
    pub fn header(&self) -> &Y4mHeader {
        &self.header
    }

    /// Reads the next frame into `frame`; `false` at the end of the stream. Nothing is read beyond the frame but what the stream buffers.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] where the stream ends within a frame, or goes on with something else.
    pub fn read_frame(&mut self, frame: &mut Y4mFrame) -> Result<bool> {
        let number = self.frames;
        let Some(line) = read_line(&mut self.stream, &self.path, &format!("frame {number}"))? else { return Ok(false) };
        let Some(parameters) = line.strip_prefix(FRAME).filter(|rest| rest.is_empty() || rest.starts_with(' ')) else {
            let message = format!("frame {number} begins with {}, not with {FRAME}", quoted(&line));
            return Err(Error::input(&self.path, message));
        };
        parameters.clone_into(&mut frame.parameters);
        let bytes = self.header.frame_bytes();
        frame.planes.clear();
        // Grows with what comes; later frames find the memory there.
        let read = (&mut self.stream).take(bytes as u64).read_to_end(&mut frame.planes);
        let got = read.map_err(|e| Error::io(&self.path, e))?;
        if got < bytes {
            let message = format!("frame {number}: the stream ends after {got} of its {bytes} bytes");
            return Err(Error::input(&self.path, message));
        }
        self.frames += 1;
        Ok(true)
    }
}

/// A line without its end; `None` at the end of the stream.
fn read_line(stream: &mut impl BufRead, path: &Path, what: &str) -> Result<Option<String>> {
    let mut line = Vec::new();
    let read = stream.take(MAX_LINE).read_until(b'\n', &mut line);
    read.map_err(|e| Error::io(path, e))?;
    if line.is_empty() {
        return Ok(None);
    }
    if line.pop() != Some(b'\n') {
        let message = format!("{what}: no line of up to {MAX_LINE} bytes; is it YUV4MPEG2, and whole?");
        return Err(Error::input(path, message));
    }
    match String::from_utf8(line) {
        Ok(line) => Ok(Some(line)),
        // What is no such line at all is only shown.
        Err(e) if ![MAGIC, FRAME].iter().any(|magic| e.as_bytes().starts_with(magic.as_bytes())) => {
            Ok(Some(String::from_utf8_lossy(e.as_bytes()).into_owned()))
        }
        Err(_) => Err(Error::input(path, format!("{what}: its line is no text"))),
    }
}

/// Writes a stream of YUV4MPEG2 frame by frame.
pub struct Y4mWriter<W> {
    stream: W,
    path: PathBuf,
}

impl<W: Write> Y4mWriter<W> {
    /// Writes the header; errors name `path`.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if the stream takes no more.
    pub fn new(mut stream: W, path: &Path, header: &Y4mHeader) -> Result<Self> {
        stream.write_all(header.line().as_bytes()).map_err(|e| Error::io(path, e))?;
        Ok(Y4mWriter { stream, path: path.to_owned() })
    }

    /// Writes a frame and flushes it.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if the stream takes no more; of kind [`std::io::ErrorKind::BrokenPipe`] if nobody reads it any longer.
    pub fn write_frame(&mut self, frame: &Y4mFrame) -> Result<()> {
        let line = format!("{FRAME}{}\n", frame.parameters);
        let written = self.stream.write_all(line.as_bytes()).and_then(|()| self.stream.write_all(&frame.planes));
        written.and_then(|()| self.stream.flush()).map_err(|e| Error::io(&self.path, e))
    }

    /// Flushes the stream and hands it back.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if that fails.
    pub fn finish(mut self) -> Result<W> {
        self.stream.flush().map_err(|e| Error::io(&self.path, e))?;
        Ok(self.stream)
    }
}
