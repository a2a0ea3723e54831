//! Where frames come from.

use super::video::{self, VideoReader};
use crate::output;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use tsuya::ar::{Plate, Y4mFrame, Y4mHeader, Y4mReader};
use tsuya::image::ImageOrientation;
use tsuya::input::FileAccess;
use tsuya::metrics::DisplayImage;
use tsuya::{Error, Result};

pub const PICTURES: [&str; 7] = ["png", "jpg", "jpeg", "tif", "tiff", "exr", "hdr"];

/// Frames of a camera: one photograph, a folder of them, or a video.
pub enum Source {
    Pictures { paths: Vec<PathBuf>, next: usize, access: FileAccess, orientation: ImageOrientation },
    Video { path: PathBuf, frames: Box<VideoReader> },
    Uncompressed(Box<UncompressedVideo>),
}

/// A video of YUV4MPEG2, and its last frame, with the image that it shows.
pub struct UncompressedVideo {
    path: PathBuf,
    reader: Y4mReader<Box<dyn BufRead>>,
    frame: Y4mFrame,
    image: DisplayImage,
}

impl UncompressedVideo {
    fn open(path: &Path) -> Result<Self> {
        let stream: Box<dyn BufRead> = if output::is_stream(path) {
            Box::new(std::io::stdin().lock())
        } else {
            Box::new(BufReader::with_capacity(1 << 16, tsuya::input::open(path)?.0))
        };
        let reader = Y4mReader::new(stream, path, &crate::source::access())?;
        Ok(UncompressedVideo {
            path: path.to_owned(),
            reader,
            frame: Y4mFrame::default(),
            image: DisplayImage::default(),
        })
    }

    fn next(&mut self) -> Result<Option<Plate>> {
        if !self.reader.read_frame(&mut self.frame)? {
            return Ok(None);
        }
        self.image = self.frame.to_image(self.reader.header())?;
        Ok(Some(Plate::Display(self.image.clone())))
    }

    pub fn header(&self) -> &Y4mHeader {
        self.reader.header()
    }

    /// The last frame, with what another image of it shows in place of its own; only samples of what differs change.
    pub fn frame_showing(&mut self, image: &DisplayImage) -> Result<&Y4mFrame> {
        self.frame.update(self.reader.header(), &self.image, image)?;
        Ok(&self.frame)
    }
}

impl Source {
    /// As [`Self::open`]; `-` is a video on standard input.
    pub fn open_frames(path: &Path, ffmpeg: &Path) -> Result<Self> {
        if output::is_stream(path) {
            return Ok(Source::Uncompressed(Box::new(UncompressedVideo::open(path)?)));
        }
        Source::open(path, ffmpeg)
    }

    pub fn open(path: &Path, ffmpeg: &Path) -> Result<Self> {
        let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
        if metadata.is_dir() {
            return Ok(Source::of_pictures(in_folder(path)?));
        }
        if video::is_uncompressed(path) {
            return Ok(Source::Uncompressed(Box::new(UncompressedVideo::open(path)?)));
        }
        if video::is_video(path) {
            return Ok(Source::Video { path: path.to_owned(), frames: Box::new(VideoReader::open(ffmpeg, path)?) });
        }
        Ok(Source::of_pictures(vec![path.to_owned()]))
    }

    fn of_pictures(paths: Vec<PathBuf>) -> Self {
        Source::Pictures { paths, next: 0, access: crate::source::access(), orientation: ImageOrientation::default() }
    }

    /// Frames, where their number is known.
    pub fn count(&self) -> Option<usize> {
        match self {
            Source::Pictures { paths, .. } => Some(paths.len()),
            Source::Video { .. } | Source::Uncompressed(_) => None,
        }
    }

    /// Whether it is a single photograph, not a sequence.
    pub fn is_single(&self) -> bool {
        self.count() == Some(1)
    }

    /// The files that frames are read from.
    pub fn files(&self) -> Vec<&Path> {
        match self {
            Source::Pictures { paths, .. } => paths.iter().map(PathBuf::as_path).collect(),
            Source::Video { path, .. } => vec![path],
            Source::Uncompressed(video) => vec![&video.path],
        }
    }

    pub fn rate(&self) -> Option<[u32; 2]> {
        match self {
            Source::Video { frames, .. } => Some(frames.rate),
            Source::Uncompressed(video) => video.header().rate(),
            Source::Pictures { .. } => None,
        }
    }

    /// What messages call a frame.
    pub fn name(&self, frame: usize) -> String {
        match self {
            Source::Pictures { paths, .. } => paths.get(frame).map_or(String::new(), |p| p.display().to_string()),
            Source::Video { .. } | Source::Uncompressed(_) => format!("frame {frame}"),
        }
    }

    /// Name of a frame's file in a folder.
    pub fn file_name(&self, frame: usize) -> String {
        let stem = match self {
            Source::Pictures { paths, .. } => paths.get(frame).and_then(|p| p.file_stem()),
            Source::Video { .. } | Source::Uncompressed(_) => None,
        };
        stem.map_or_else(|| format!("{frame:06}.png"), |stem| format!("{}.png", stem.to_string_lossy()))
    }

    pub fn next(&mut self) -> Result<Option<Plate>> {
        match self {
            Source::Video { frames, .. } => frames.next(),
            Source::Uncompressed(video) => video.next(),
            Source::Pictures { paths, next, access, orientation } => {
                let Some(path) = paths.get(*next) else { return Ok(None) };
                *next += 1;
                let (plate, stored) = Plate::read_with_orientation(path, access)?;
                *orientation = stored;
                Ok(Some(plate))
            }
        }
    }

    /// The orientation that the last frame was stored in.
    pub fn orientation(&self) -> ImageOrientation {
        match self {
            Source::Pictures { orientation, .. } => *orientation,
            // ffmpeg turns them, and YUV4MPEG2 has none.
            Source::Video { .. } | Source::Uncompressed(_) => ImageOrientation::default(),
        }
    }

    /// What was remarked while frames were read.
    pub fn remarks(&self) -> Vec<String> {
        match self {
            Source::Pictures { access, .. } => access.remarks(),
            Source::Video { .. } | Source::Uncompressed(_) => Vec::new(),
        }
    }
}

fn in_folder(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut paths: Vec<PathBuf> = (entries.filter_map(|entry| Some(entry.ok()?.path())))
        .filter(|path| PICTURES.iter().any(|extension| crate::source::has_extension(path, extension)))
        .collect();
    // frame2 before frame10.
    paths.sort_by_cached_key(|path| natural(&path.file_name().unwrap_or_default().to_string_lossy()));
    if paths.is_empty() {
        return Err(Error::input(folder, "no picture in this folder: PNG, JPEG, TIFF or EXR frames are looked for"));
    }
    Ok(paths)
}

/// A name as texts and numbers in turn.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = vec![(String::new(), 0)];
    let mut digits = String::new();
    for letter in name.chars().chain(['\0']) {
        if letter.is_ascii_digit() {
            digits.push(letter);
            continue;
        }
        if !digits.is_empty() {
            if let Some(last) = parts.last_mut() {
                last.1 = digits.parse().unwrap_or(u64::MAX);
            }
            digits.clear();
            parts.push((String::new(), 0));
        }
        if let Some(last) = parts.last_mut() {
            last.0.push(letter);
        }
    }
    parts
}
