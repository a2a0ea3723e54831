//! A capture whose photographs are read when they are needed.

use super::agreement::{self, Agreement, SmallView};
use super::frames::{FrameFiles, FrameSettings, FrameSource};
use super::photograph::{PhotographReading, settle_exposures};
use super::white::BoardRadiance;
use super::{
    Capture, CaptureDescription, CaptureFrame, CaptureReadOptions, Clipping, FrameDescription, check_beta, describe,
    read_mesh,
};
use crate::error::{Error, Result};
use crate::image::read::{ColorSpace, ImageFault};
use crate::input::escaped;
use crate::views::View;
use std::borrow::Cow;
use std::path::Path;

/// A capture of which only the photographs in use are in memory.
pub type OpenCapture = Capture<OpenFrames>;

/// Frames of a capture that are read when they are needed.
#[derive(Debug)]
pub struct OpenFrames {
    views: Vec<View>,
    is_polarised: bool,
    /// Those that the check of agreement looks at, where the frames were read for it.
    small: Option<Vec<SmallView>>,
    source: Box<dyn FrameSource>,
}

impl OpenFrames {
    /// Frames that the limits of reading allow to be read side by side.
    pub(crate) fn at_once(&self) -> usize {
        self.source.at_once()
    }
}

impl OpenCapture {
    /// Name, camera and light of each frame.
    pub fn views(&self) -> &[View] {
        &self.frames.views
    }

    /// Returns `true` if the frames have cross photographs.
    pub fn is_polarised(&self) -> bool {
        self.frames.is_polarised
    }

    /// Returns a frame with its photographs, which are in memory until it is dropped; pixels that its mask leaves out may be 0.
    /// # Errors
    /// Those of reading its files, also where they were changed since the capture was opened.
    pub fn frame(&self, index: usize) -> Result<Cow<'_, CaptureFrame>> {
        self.frames.source.frame(index)
    }

    /// Compares the mesh's silhouette with the masks, and photographs with their neighbours, as [`super::agreement`] does.
    /// # Errors
    /// Those of [`Self::frame`], of a capture that was not opened but in memory.
    pub fn agreement(&self) -> Result<Agreement> {
        let chosen = agreement::chosen(self.views().len());
        let read: Vec<SmallView>;
        let small = match &self.frames.small {
            Some(small) => small,
            None => {
                read = chosen.iter().map(|&k| Ok(SmallView::new(&*self.frame(k)?))).collect::<Result<_>>()?;
                &read
            }
        };
        Ok(agreement::of_views(&self.mesh, &self.views().iter().collect::<Vec<_>>(), &chosen, small))
    }
}

impl From<Capture> for OpenCapture {
    fn from(capture: Capture) -> Self {
        capture.map_frames(|frames| OpenFrames {
            views: frames.iter().map(|frame| frame.view.clone()).collect(),
            is_polarised: frames.first().is_some_and(|frame| frame.cross.is_some()),
            small: None,
            source: Box::new(frames),
        })
    }
}

/// Opens a capture as [`super::read`] reads it, but keeps no photograph in memory: each is read once now, so that what is wrong is found at
/// once, and what its mask shows goes to a temporary file, in `TMPDIR` or where the system has large ones; of what does not fit there, the
/// photographs are read again. The limits of memory bound those that are read side by side.
pub fn open(path: impl AsRef<Path>, options: &CaptureReadOptions) -> Result<OpenCapture> {
    open_with_progress(path, options, &|_, _| {})
}

/// Opens a capture as [`open()`] does; `progress(done, total)` is called after each frame, from any thread of the current pool.
pub fn open_with_progress(
    path: impl AsRef<Path>,
    options: &CaptureReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<OpenCapture> {
    Ok(gather(path.as_ref(), options, false, &|_| (), progress)?.0)
}

/// Reads a capture with all its photographs.
pub(super) fn read_whole(
    path: &Path,
    options: &CaptureReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Capture> {
    let (opened, frames) = gather(path, options, true, &|frame| frame, progress)?;
    Ok(opened.map_frames(|_| frames))
}

/// The white board in the first frame that shows it and can be read.
fn first_board(description: &CaptureDescription, reading: PhotographReading<'_>) -> Result<Option<BoardRadiance>> {
    for frame in &description.frames {
        let Some(region) = &frame.board else { continue };
        let size = (frame.view.camera.width, frame.view.camera.height);
        match reading.read(&frame.photograph, Some(size)) {
            Ok(read) => return Ok(Some(BoardRadiance::of_region(&read, region, frame)?)),
            // It is told of with its frame.
            Err(ImageFault::Unreadable(_)) => {}
            Err(ImageFault::Wrong(error)) => return Err(error),
        }
    }
    Ok(None)
}

/// Frames that a warning names, at most.
const MAX_NAMED: usize = 20;

/// Reads a capture's mesh and, once, every frame; returns what `take` makes of each of them. They are charged for good if they are `held`.
fn gather<T: Send>(
    path: &Path,
    options: &CaptureReadOptions,
    held: bool,
    take: &(dyn Fn(CaptureFrame) -> T + Sync),
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<(OpenCapture, Vec<T>)> {
    let access = options.access();
    let mut description = describe(path, &access)?;
    settle_exposures(&mut description, options.exif_exposure, &access)?;
    let mut warnings = description.warnings.clone();
    let declared = options.color_space.as_ref().or(description.color_space.as_ref());
    let space = declared.map_or_else(|| Ok(ColorSpace::from_files()), |name| ColorSpace::from_name(name))?;
    let (mesh, origin) = read_mesh(&mut description, options, &access, &mut warnings)?;

    let reading = PhotographReading { access: &access, space: &space };
    let board = match &description.white_reference {
        Some(reference) => Some(BoardRadiance::of_reference(reference, reading)?),
        None => first_board(&description, reading)?,
    };
    let without = description.frames.iter().filter(|frame| frame.board.is_none()).count();
    if (1..description.frames.len()).contains(&without) {
        warnings.push(format!("{without} frames show no white board (white_region) and are taken as they are"));
    }
    let mut described = description.frames.clone();
    let is_polarised = |frame: &FrameDescription| frame.photograph.is_polarised();
    let crossed = described.iter().filter(|frame| is_polarised(frame)).count();
    let mut skipped = 0;
    if crossed > 0 && crossed < described.len() {
        let without: Vec<_> = described.iter().filter(|f| !is_polarised(f)).map(|f| escaped(&f.view.name)).collect();
        skipped += without.len();
        let names = without.iter().take(MAX_NAMED).cloned().collect::<Vec<_>>().join(", ");
        let more = if without.len() > MAX_NAMED { ", ..." } else { "" };
        let count = without.len();
        warnings.push(format!("{count} frames without a cross photograph skipped, as others have one: {names}{more}"));
        described.retain(is_polarised);
    }
    // Where some need it to be measured, what would follow from the others does not help.
    let ideal_beta = described.iter().map(|frame| frame.photograph.ideal_beta()).min_by_key(Option::is_some).flatten();
    let beta = options.beta.or(board.and_then(|board| board.beta())).or(ideal_beta);
    check_beta(&description, beta, crossed > 0)?;

    let settings = FrameSettings { space, invert_masks: options.invert_masks, board };
    let color_space = settings.space.linear_name.clone();
    let mut files = FrameFiles::new(described, access, settings);
    let (mut missing_pixels, mut clipping) = (0, Clipping::default());
    let (mut taken, mut small, mut stored, mut faults) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let take = |frame: CaptureFrame| {
        let stored = if held { None } else { files.store(&frame) };
        (SmallView::new(&frame), stored, take(frame))
    };
    let (outcomes, at_once) = files.read_all(&description.path, &mesh, held, &take, progress)?;
    let readable: Vec<bool> = outcomes.iter().map(Result::is_ok).collect();
    for (outcome, frame) in outcomes.into_iter().zip(&files.described) {
        match outcome {
            Ok(((view, store, frame), missing, clipped)) => {
                missing_pixels += missing;
                clipping.merge(clipped);
                small.push(view);
                stored.push(store);
                taken.push(frame);
            }
            Err(ImageFault::Unreadable(error)) => {
                skipped += 1;
                faults.push(format!("frame {} skipped: {error}", escaped(&frame.view.name)));
            }
            Err(ImageFault::Wrong(error)) => return Err(error),
        }
    }
    files.at_once = at_once;
    files.retain(|index| readable[index], stored);
    let left_out = faults.len().saturating_sub(MAX_NAMED);
    warnings.extend(faults.into_iter().take(MAX_NAMED));
    if left_out > 0 {
        warnings.push(format!("{left_out} more frames skipped"));
    }
    if taken.is_empty() {
        let last = warnings.last().cloned().unwrap_or_default();
        return Err(Error::input(
            &description.path,
            format!("no frame of {} could be read; {last}", description.frames.len()),
        ));
    }
    if missing_pixels > 0 {
        warnings.push(format!("{missing_pixels} pixels are NaN or infinite and are taken as missing"));
    }
    warnings.extend(clipping.warning(taken.len()));
    warnings.extend(files.access.remarks());
    let CaptureDescription { name, path, .. } = description;
    let chosen = agreement::chosen(small.len());
    let small = small.into_iter().enumerate().filter(|(k, _)| chosen.contains(k)).map(|(_, view)| view).collect();
    let frames = OpenFrames {
        views: files.described.iter().map(|frame| frame.view.clone()).collect(),
        is_polarised: crossed > 0,
        small: Some(small),
        source: Box::new(files),
    };
    let skipped_frames = skipped;
    let mut opened = Capture {
        name,
        frames,
        mesh,
        origin,
        white: board.map_or([1.0; 3], |board| board.photograph),
        beta,
        color_space,
        warnings,
        skipped_frames,
        missing_pixels,
        clipping,
    };
    if !options.unchecked {
        let found = opened.agreement()?;
        agreement::settle(&path, found, &mut opened.mesh, &mut opened.warnings)?;
    }
    Ok((opened, taken))
}
