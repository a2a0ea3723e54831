//! Videos through an installed ffmpeg: raw frames from its standard output, and into its standard input.

use super::sinks::into_library_error;
use crate::output::Files;
use std::io::{Error as IoError, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use tsuya::ar::{Plate, Y4mHeader};
use tsuya::{Error, Result};

const EXTENSIONS: [&str; 9] = ["mp4", "mkv", "mov", "webm", "avi", "m4v", "y4m", "mpg", "ogv"];

/// Whether a path is called like a video.
pub fn is_video(path: &Path) -> bool {
    EXTENSIONS.iter().any(|extension| crate::source::has_extension(path, extension))
}

/// Whether a path is called like a video that takes no ffmpeg.
pub fn is_uncompressed(path: &Path) -> bool {
    crate::source::has_extension(path, "y4m")
}

fn not_started(ffmpeg: &Path, error: IoError) -> Error {
    let missing = error.kind() == ErrorKind::NotFound;
    let message = if missing {
        "videos are read and written by ffmpeg, which is not installed: install it, say where it is with --ffmpeg, or give and take a \
         folder of pictures"
            .to_owned()
    } else {
        format!("ffmpeg does not start: {error}")
    };
    Error::io(ffmpeg, IoError::new(error.kind(), message))
}

/// What a process said last.
fn last_error_line(child: &mut Child) -> String {
    let mut said = Vec::new();
    if let Some(stderr) = child.stderr.take() {
        let _ = stderr.take(1 << 16).read_to_end(&mut said);
    }
    let said = String::from_utf8_lossy(&said).into_owned();
    said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it says nothing").trim().to_owned()
}

fn path_argument(path: &Path) -> PathBuf {
    // A name that begins with a dash, or has a colon in it, is not taken for an option or a protocol.
    if path.is_absolute() { path.to_owned() } else { Path::new(".").join(path) }
}

/// A video's frames.
pub struct VideoReader {
    path: PathBuf,
    child: Child,
    out: ChildStdout,
    pub width: usize,
    pub height: usize,
    /// Frames a second, as a fraction.
    pub rate: [u32; 2],
    bytes: Vec<u8>,
    number: usize,
}

impl VideoReader {
    pub fn open(ffmpeg: &Path, path: &Path) -> Result<Self> {
        std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
        let ([width, height], rate) = probe(ffmpeg, path)?;
        let (mut child, out) = start(ffmpeg, path, &["-f", "rawvideo", "-pix_fmt", "rgb24"])?;
        // Its complaints are read at the end; a pipe that fills up would stop it.
        drop(child.stderr.take());
        let bytes = vec![0; 3 * width * height];
        Ok(VideoReader { path: path.to_owned(), child, out, width, height, rate, bytes, number: 0 })
    }

    pub fn next(&mut self) -> Result<Option<Plate>> {
        let mut filled = 0;
        while filled < self.bytes.len() {
            match self.out.read(&mut self.bytes[filled..]) {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(&self.path, e)),
            }
        }
        if filled == self.bytes.len() {
            self.number += 1;
            return Plate::from_bytes(self.width, self.height, &self.bytes).map(Some);
        }
        let ended = self.child.wait().map_err(|e| Error::io(&self.path, e))?;
        if filled > 0 || !ended.success() || self.number == 0 {
            return Err(Error::input(
                &self.path,
                format!("ffmpeg gives up after {} frames: a damaged video?", self.number),
            ));
        }
        Ok(None)
    }
}

impl Drop for VideoReader {
    fn drop(&mut self) {
        // Whether it has ended already does not matter.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn start(ffmpeg: &Path, path: &Path, format: &[&str]) -> Result<(Child, ChildStdout)> {
    let mut command = Command::new(ffmpeg);
    command.args(["-nostdin", "-v", "error", "-i"]).arg(path_argument(path)).args(["-map", "0:v:0"]);
    command.args(format).arg("-").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|e| not_started(ffmpeg, e))?;
    match child.stdout.take() {
        Some(out) => Ok((child, out)),
        None => Err(Error::io(ffmpeg, IoError::other("has no standard output"))),
    }
}

/// Size and rate, from the header of the first frame as YUV4MPEG2.
fn probe(ffmpeg: &Path, path: &Path) -> Result<([usize; 2], [u32; 2])> {
    let format = ["-frames:v", "1", "-f", "yuv4mpegpipe", "-pix_fmt", "yuv420p", "-strict", "-1"];
    let (mut child, out) = start(ffmpeg, path, &format)?;
    let mut header = Vec::new();
    let mut byte = [0u8];
    let mut out = out;
    while header.len() < 512 && out.read(&mut byte).is_ok_and(|n| n == 1) && byte[0] != b'\n' {
        header.push(byte[0]);
    }
    // The rest of the frame is of no interest.
    drop(out);
    let said = last_error_line(&mut child);
    let _ = child.kill();
    let _ = child.wait();
    let header = String::from_utf8_lossy(&header).into_owned();
    if !header.starts_with("YUV4MPEG2 ") {
        return Err(Error::input(path, format!("ffmpeg finds no video in it: {said}")));
    }
    let header = Y4mHeader::parse(&header, path)?;
    Ok((header.size(), header.rate().unwrap_or([30, 1])))
}

/// A video in the making, beside its place until it is whole.
pub struct VideoWriter {
    target: PathBuf,
    ffmpeg: PathBuf,
    files: Files,
    child: Child,
    input: Option<ChildStdin>,
}

impl VideoWriter {
    pub fn create(
        ffmpeg: &Path,
        target: &Path,
        [width, height]: [usize; 2],
        rate: [u32; 2],
        force: bool,
    ) -> Result<Self> {
        let mut files = Files::new(force);
        let file = files.reserve(target).map_err(into_library_error)?;
        let mut command = Command::new(ffmpeg);
        command.args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s"]);
        command.arg(format!("{width}x{height}")).args(["-r", &format!("{}/{}", rate[0], rate[1]), "-i", "-"]);
        // Players want even sides with half the colours.
        let even = width.is_multiple_of(2) && height.is_multiple_of(2);
        command.args(["-an", "-pix_fmt", if even { "yuv420p" } else { "yuv444p" }]);
        command.arg(path_argument(&file)).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|e| not_started(ffmpeg, e))?;
        let input = child.stdin.take();
        Ok(VideoWriter { target: target.to_owned(), ffmpeg: ffmpeg.to_owned(), files, child, input })
    }

    pub fn put(&mut self, plate: &Plate) -> Result<()> {
        let bytes: Vec<u8> = plate.to_display().data.concat();
        let written = match &mut self.input {
            Some(input) => input.write_all(&bytes),
            None => Err(IoError::from(ErrorKind::BrokenPipe)),
        };
        written.map_err(|_| self.refused())
    }

    fn refused(&mut self) -> Error {
        drop(self.input.take());
        let said = last_error_line(&mut self.child);
        Error::io(&self.target, IoError::other(format!("{} can't write this video: {said}", self.ffmpeg.display())))
    }

    /// Waits for the last frame and puts the file into its place.
    pub fn finish(mut self) -> Result<()> {
        drop(self.input.take());
        let said = last_error_line(&mut self.child);
        let ended = self.child.wait().map_err(|e| Error::io(&self.target, e))?;
        if !ended.success() {
            let message = format!("{} can't write this video: {said}", self.ffmpeg.display());
            return Err(Error::io(&self.target, IoError::other(message)));
        }
        self.files.commit().map_err(into_library_error)
    }
}
