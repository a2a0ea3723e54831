//! Where frames go.

use super::frames::{PICTURES, Source};
use super::video::{self, VideoWriter};
use crate::{output, pictures};
use std::collections::HashSet;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use tsuya::ar::{Plate, Y4mFrame, Y4mHeader, Y4mWriter};
use tsuya::{Error, Result};

/// Where frames go. Nothing is in its place until `finish`.
pub enum Sink {
    Picture { path: PathBuf, bytes: Option<Vec<u8>>, force: bool },
    Folder { folder: Box<output::Folder>, names: HashSet<String> },
    Video(PendingVideo),
    Uncompressed(PendingStream),
}

/// A video of YUV4MPEG2, begun with its first frame.
pub struct PendingStream {
    path: PathBuf,
    rate: Option<[u32; 2]>,
    files: output::Files,
    writer: Option<(Y4mHeader, Y4mWriter<Box<dyn Write>>)>,
}

impl PendingStream {
    fn put(&mut self, plate: &Plate, source: &mut Source) -> Result<()> {
        let image = plate.to_display();
        let (header, writer) = match &mut self.writer {
            Some((header, writer)) => (&*header, writer),
            None => {
                let header = match source {
                    Source::Uncompressed(video) => {
                        self.rate.map_or(video.header().clone(), |rate| video.header().with_rate(rate))
                    }
                    _ => Y4mHeader::new(plate.size(), self.rate.or(source.rate()).unwrap_or([30, 1]))?,
                };
                let stream: Box<dyn Write> = if output::is_stream(&self.path) {
                    Box::new(std::io::stdout().lock())
                } else {
                    let file = self.files.reserve(&self.path).map_err(into_library_error)?;
                    Box::new(std::fs::File::create_new(&file).map_err(|e| Error::io(&self.path, e))?)
                };
                let writer = Y4mWriter::new(stream, &self.path, &header)?;
                let (header, writer) = self.writer.insert((header, writer));
                (&*header, writer)
            }
        };
        match source {
            Source::Uncompressed(video) => writer.write_frame(video.frame_showing(&image)?),
            _ => writer.write_frame(&Y4mFrame::from_image(header, &image)?),
        }
    }
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
        let inputs = source.files();
        output::check_outputs(&[path], &inputs, force)?;
        if output::is_stream(path) || video::is_uncompressed(path) {
            if output::is_stream(path) && std::io::stdout().is_terminal() {
                let message = "a video is no text for a terminal: send it into another program, as in -o - | ffplay -";
                return Err(Error::parameter(message).into());
            }
            let (path, files) = (path.to_owned(), output::Files::new(force));
            return Ok(Sink::Uncompressed(PendingStream { path, rate, files, writer: None }));
        }
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

    pub fn put(&mut self, plate: &Plate, source: &mut Source, frame: usize) -> Result<()> {
        match self {
            Sink::Uncompressed(stream) => stream.put(plate, source),
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
            Sink::Uncompressed(PendingStream { files, writer, .. }) => {
                writer.map_or(Ok(()), |(_, writer)| writer.finish().map(drop))?;
                files.commit().map_err(into_library_error)
            }
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
