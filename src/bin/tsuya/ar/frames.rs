//! Where frames come from and where they go.

use super::video::{self, VideoReader, VideoWriter};
use crate::{output, pictures};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use tsuya::ar::Plate;
use tsuya::image::ImageOrientation;
use tsuya::input::FileAccess;
use tsuya::{Error, Result};

const PICTURES: [&str; 7] = ["png", "jpg", "jpeg", "tif", "tiff", "exr", "hdr"];

/// Frames of a camera: one photograph, a folder of them, or a video.
pub enum Source {
    Pictures { paths: Vec<PathBuf>, next: usize, access: FileAccess, orientation: ImageOrientation },
    Video { path: PathBuf, frames: Box<VideoReader> },
}

impl Source {
    pub fn open(path: &Path, ffmpeg: &Path) -> Result<Self> {
        let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
        if metadata.is_dir() {
            return Ok(Source::of_pictures(in_folder(path)?));
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
            Source::Video { .. } => None,
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
        }
    }

    pub fn rate(&self) -> Option<[u32; 2]> {
        match self {
            Source::Video { frames, .. } => Some(frames.rate),
            Source::Pictures { .. } => None,
        }
    }

    /// What messages call a frame.
    pub fn name(&self, frame: usize) -> String {
        match self {
            Source::Pictures { paths, .. } => paths.get(frame).map_or(String::new(), |p| p.display().to_string()),
            Source::Video { .. } => format!("frame {frame}"),
        }
    }

    /// Name of a frame's file in a folder.
    fn file_name(&self, frame: usize) -> String {
        let stem = match self {
            Source::Pictures { paths, .. } => paths.get(frame).and_then(|p| p.file_stem()),
            Source::Video { .. } => None,
        };
        stem.map_or_else(|| format!("{frame:06}.png"), |stem| format!("{}.png", stem.to_string_lossy()))
    }

    pub fn next(&mut self) -> Result<Option<Plate>> {
        match self {
            Source::Video { frames, .. } => frames.next(),
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
            // ffmpeg turns them.
            Source::Video { .. } => ImageOrientation::default(),
        }
    }

    /// What was remarked while frames were read.
    pub fn remarks(&self) -> Vec<String> {
        match self {
            Source::Pictures { access, .. } => access.remarks(),
            Source::Video { .. } => Vec::new(),
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

/// Where frames go. Nothing is in its place until `finish`.
pub enum Sink {
    Picture { path: PathBuf, bytes: Option<Vec<u8>>, force: bool },
    Folder { folder: Box<output::Folder>, names: HashSet<String> },
    Video(PendingVideo),
}

/// A video, begun with its first frame, whose size it has.
pub struct PendingVideo {
    ffmpeg: PathBuf,
    path: PathBuf,
    rate: [u32; 2],
    force: bool,
    writer: Option<Box<VideoWriter>>,
}

impl Sink {
    pub fn create(
        path: &Path,
        source: &Source,
        rate: Option<[u32; 2]>,
        ffmpeg: &Path,
        force: bool,
    ) -> anyhow::Result<Self> {
        if output::is_stream(path) {
            return Err(Error::parameter("pictures go into a file or a folder, not to standard output").into());
        }
        let inputs = source.files();
        output::check_outputs(&[path], &inputs, force)?;
        if video::is_video(path) {
            let rate = rate.or(source.rate()).unwrap_or([30, 1]);
            let (ffmpeg, path) = (ffmpeg.to_owned(), path.to_owned());
            return Ok(Sink::Video(PendingVideo { ffmpeg, path, rate, force, writer: None }));
        }
        let is_picture = PICTURES.iter().any(|extension| crate::source::has_extension(path, extension));
        if is_picture && !source.is_single() {
            let message = format!(
                "{}: several frames go into a folder or a video (.mp4, .mkv), not into one picture",
                path.display()
            );
            return Err(Error::parameter(message).into());
        }
        if is_picture {
            crate::render::is_exr(path)?;
            return Ok(Sink::Picture { path: path.to_owned(), bytes: None, force });
        }
        let folder = Box::new(output::Folder::create(path, force, None, &inputs)?);
        Ok(Sink::Folder { folder, names: HashSet::new() })
    }

    pub fn put(&mut self, plate: &Plate, source: &Source, frame: usize) -> Result<()> {
        match self {
            Sink::Picture { path, bytes, .. } => {
                *bytes = Some(if crate::source::has_extension(path, "exr") {
                    pictures::exr(&plate.to_linear(), false).map_err(into_library_error)?
                } else {
                    pictures::png(&plate.to_display()).map_err(into_library_error)?
                });
                Ok(())
            }
            Sink::Folder { folder, names } => {
                let mut name = source.file_name(frame);
                // Some file systems don't tell upper from lower case.
                while !names.insert(name.to_lowercase()) {
                    name = format!("{frame:06}-{name}");
                }
                folder
                    .write(&name, &pictures::png(&plate.to_display()).map_err(into_library_error)?)
                    .map_err(into_library_error)
            }
            Sink::Video(PendingVideo { ffmpeg, path, rate, force, writer }) => {
                if writer.is_none() {
                    *writer = Some(Box::new(VideoWriter::create(ffmpeg, path, plate.size(), *rate, *force)?));
                }
                writer.as_mut().map_or(Ok(()), |writer| writer.put(plate))
            }
        }
    }

    pub fn finish(self) -> Result<()> {
        match self {
            Sink::Picture { path, bytes, force } => {
                output::write(&path, &bytes.unwrap_or_default(), force).map_err(into_library_error)
            }
            Sink::Folder { folder, .. } => folder.commit().map_err(into_library_error),
            Sink::Video(PendingVideo { writer, .. }) => writer.map_or(Ok(()), |writer| writer.finish()),
        }
    }
}

/// The library's error in one of the program's.
pub fn into_library_error(error: anyhow::Error) -> Error {
    match error.downcast::<Error>() {
        Ok(error) => error,
        Err(other) => Error::parameter(format!("{other:#}")),
    }
}
