//! A capture whose photographs are read when they are needed.

use super::agreement::{self, Agreement, SmallView};
use super::frames::{FrameFiles, FrameSettings, FrameSource};
use super::{
    Capture, CaptureDescription, CaptureFrame, CaptureReadOptions, Clipping, check_beta, describe, read_mesh, white,
};
use crate::error::{Error, Result};
use crate::image::read::{ColorSpace, ImageFault};
use crate::input::escaped;
use crate::mesh::Mesh;
use crate::views::View;
use std::borrow::Cow;
use std::path::Path;

/// A capture of which only the photographs in use are in memory; the fields are those of [`Capture`].
#[derive(Debug)]
pub struct OpenCapture {
    /// Name of the capture's folder.
    pub name: String,
    /// The mesh, in world coordinates, cleaned ([`crate::mesh::clean`]).
    pub mesh: Mesh,
    /// What was subtracted from the capture's coordinates.
    pub origin: [f64; 3],
    /// Mean radiance of the unpolarised white board's middle; 1 without a board.
    pub white: [f64; 3],
    /// `on_board / off_board` per colour.
    pub beta: Option<[f64; 3]>,
    /// Colour space of the pixels in memory, always a linear one.
    pub color_space: String,
    /// Non-fatal problems found while reading, one sentence each.
    pub warnings: Vec<String>,
    /// Frames left out.
    pub skipped_frames: usize,
    /// Pixels, inside the masks where there are any, that are NaN or infinite in a photograph as stored.
    pub missing_pixels: u64,
    /// Pixels of the object that are at the most that their files hold.
    pub clipping: Clipping,
    views: Vec<View>,
    is_polarised: bool,
    small: Vec<SmallView>,
    source: Box<dyn FrameSource>,
}

impl OpenCapture {
    /// Name, camera and light of each frame.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// Returns `true` if the frames have cross photographs.
    pub fn is_polarised(&self) -> bool {
        self.is_polarised
    }

    /// Returns a frame with its photographs, which are in memory until it is dropped; pixels that its mask leaves out may be 0.
    /// # Errors
    /// Those of reading its files, also where they were changed since the capture was opened.
    pub fn frame(&self, index: usize) -> Result<Cow<'_, CaptureFrame>> {
        self.source.frame(index)
    }

    /// Frames that the limits of reading allow to be read side by side.
    pub(crate) fn at_once(&self) -> usize {
        self.source.at_once()
    }

    /// Compares the mesh's silhouette with the masks, and photographs with their neighbours, as [`super::agreement`] does.
    pub fn agreement(&self) -> Agreement {
        let chosen = agreement::chosen(self.small.len());
        let small = chosen.iter().map(|&frame| &self.small[frame]).collect();
        agreement::of_views(&self.mesh, &self.views.iter().collect::<Vec<_>>(), &chosen, small)
    }
}

impl From<Capture> for OpenCapture {
    fn from(capture: Capture) -> Self {
        let Capture { name, frames, mesh, origin, white, beta, color_space, .. } = capture;
        OpenCapture {
            name,
            mesh,
            origin,
            white,
            beta,
            color_space,
            warnings: capture.warnings,
            skipped_frames: capture.skipped_frames,
            missing_pixels: capture.missing_pixels,
            clipping: capture.clipping,
            views: frames.iter().map(|frame| frame.view.clone()).collect(),
            is_polarised: frames.first().is_some_and(|frame| frame.cross.is_some()),
            small: frames.iter().map(SmallView::new).collect(),
            source: Box::new(frames),
        }
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
    Ok(Capture {
        name: opened.name,
        frames,
        mesh: opened.mesh,
        origin: opened.origin,
        white: opened.white,
        beta: opened.beta,
        color_space: opened.color_space,
        warnings: opened.warnings,
        skipped_frames: opened.skipped_frames,
        missing_pixels: opened.missing_pixels,
        clipping: opened.clipping,
    })
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
    let mut warnings = description.warnings.clone();
    let declared = options.color_space.as_ref().or(description.color_space.as_ref());
    let space = declared.map_or_else(|| Ok(ColorSpace::from_files()), |name| ColorSpace::from_name(name))?;
    let (mesh, origin) = read_mesh(&mut description, options, &access, &mut warnings)?;

    let (white, measured_beta) = match &description.white_reference {
        Some(reference) => white::calibrate(reference, &access, &space)?,
        None => ([1.0; 3], None),
    };
    let mut described = description.frames.clone();
    let crossed = described.iter().filter(|frame| frame.cross.is_some()).count();
    let mut skipped = 0;
    if crossed > 0 && crossed < described.len() {
        let without: Vec<_> = described.iter().filter(|f| f.cross.is_none()).map(|f| escaped(&f.view.name)).collect();
        skipped += without.len();
        let names = without.iter().take(MAX_NAMED).cloned().collect::<Vec<_>>().join(", ");
        let more = if without.len() > MAX_NAMED { ", ..." } else { "" };
        let count = without.len();
        warnings.push(format!("{count} frames without a cross photograph skipped, as others have one: {names}{more}"));
        described.retain(|frame| frame.cross.is_some());
    }
    let beta = options.beta.or(measured_beta);
    check_beta(&description, beta, crossed > 0)?;

    let settings = FrameSettings { space, invert_masks: options.invert_masks };
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
    let mut opened = OpenCapture {
        name,
        mesh,
        origin,
        white,
        beta,
        color_space,
        warnings,
        skipped_frames: skipped,
        missing_pixels,
        clipping,
        views: files.described.iter().map(|frame| frame.view.clone()).collect(),
        is_polarised: crossed > 0,
        small,
        source: Box::new(files),
    };
    if !options.unchecked {
        let found = opened.agreement();
        agreement::settle(&path, found, &mut opened.mesh, &mut opened.warnings)?;
    }
    Ok((opened, taken))
}
