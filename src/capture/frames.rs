//! Frames of a capture: photographs and masks, read together or one at a time.

use super::FrameDescription;
use super::clipping::Clipping;
use super::scratch::{FrameScratch, StoredFrame};
use crate::error::{Error, Result};
use crate::image::read::{ColorSpace, ImageFault, read_mask, read_radiance_image, reading_memory};
use crate::image::{Mask, RgbImage};
use crate::input::FileAccess;
use crate::mesh::Mesh;
use crate::views::View;
use std::borrow::Cow;
use std::fmt::Debug;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::SystemTime;

/// One photograph, or a pair through polarisers, by one camera under one light.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureFrame {
    /// Name, camera and light.
    pub view: View,
    /// Unpolarised linear radiance (diffuse and specular). Missing pixels are NaN in all colours, here and in `cross`.
    pub photograph: RgbImage,
    /// Linear radiance with the specular reflection blocked.
    pub cross: Option<RgbImage>,
    /// Pixels that show the object; not empty.
    pub mask: Option<Mask>,
}

/// Frames that are handed out one at a time, so that only those in use are in memory.
pub(crate) trait FrameSource: Debug + Send + Sync {
    /// Returns a frame.
    fn frame(&self, index: usize) -> Result<Cow<'_, CaptureFrame>>;
    /// Frames that may be asked for at the same time, at least one.
    fn at_once(&self) -> usize;
}

impl FrameSource for Vec<CaptureFrame> {
    fn frame(&self, index: usize) -> Result<Cow<'_, CaptureFrame>> {
        Ok(Cow::Borrowed(&self[index]))
    }
    fn at_once(&self) -> usize {
        usize::MAX
    }
}

/// Settings of reading the photographs and masks of a capture.
#[derive(Debug)]
pub(super) struct FrameSettings {
    pub(super) space: ColorSpace,
    pub(super) invert_masks: bool,
}

/// Frames as files, which are read whenever a frame is asked for.
#[derive(Debug)]
pub(super) struct FrameFiles {
    pub(super) described: Vec<FrameDescription>,
    pub(super) access: FileAccess,
    pub(super) settings: FrameSettings,
    /// Parallel to `described`: the files as they were when they were first read.
    stamps: Vec<Vec<Option<FileStamp>>>,
    scratch: FrameScratch,
    /// Parallel to `described`: the frames that need not be decoded again.
    stored: Vec<Option<StoredFrame>>,
    pub(super) at_once: usize,
}

/// A file's size and when it was written.
type FileStamp = (u64, Option<SystemTime>);

/// What is made of a frame, its missing and its clipped pixels.
pub(super) type FrameOutcome<T> = std::result::Result<(T, u64, Clipping), ImageFault>;

impl FrameFiles {
    pub(super) fn new(described: Vec<FrameDescription>, access: FileAccess, settings: FrameSettings) -> Self {
        let stamps = described.iter().map(stamps).collect();
        let stored = Vec::new();
        FrameFiles { described, access, settings, stamps, scratch: FrameScratch::new(), stored, at_once: 1 }
    }

    /// Reads all frames, in order, on the current pool, as many at once as the memory allows that they need while they are read, and returns
    /// what `take` makes of each, with the numbers of its missing and clipped pixels, and how many may be read at once. If they are `held`, their memory is charged for good.
    pub(super) fn read_all<T: Send>(
        &self,
        path: &Path,
        mesh: &Mesh,
        held: bool,
        take: &(dyn Fn(CaptureFrame) -> T + Sync),
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<(Vec<FrameOutcome<T>>, usize)> {
        // What stays of each frame is known from its camera, as no picture of another size is taken.
        let size = |file: &Path| std::fs::metadata(file).ok().map(|metadata| metadata.len());
        let (mut kept, mut reading) = (0u64, 1u64);
        for frame in &self.described {
            let Some(bytes) = size(&frame.photograph) else { continue };
            let (width, height) = (frame.view.camera.width, frame.view.camera.height);
            let pixels = u64::from(width) * u64::from(height);
            kept += pixels * (if frame.cross.is_some() { 24 } else { 12 } + 1);
            let largest = [&frame.cross, &frame.mask].into_iter().flatten().filter_map(|file| size(file));
            let bytes = largest.fold(bytes, u64::max);
            // Lens distortion is removed out of place.
            reading = reading.max(reading_memory(bytes, width, height).saturating_add(12 * pixels));
        }
        if held {
            self.access.charge(path, "photographs of the capture", kept)?;
        }
        let at_once = (self.access.budget().left() / reading).max(1) as usize;
        let done = AtomicUsize::new(0);
        let take_one = |frame: &FrameDescription| {
            let ReadFrame { frame, missing, clipped } = read_frame(frame, &self.access, &self.settings)?;
            let clipping = clipped.map_or(Clipping::default(), |clipped| Clipping::of_frame(&clipped, &frame, mesh));
            Ok((take(frame), missing, clipping))
        };
        let one = |frame: &FrameDescription| {
            let outcome = take_one(frame);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, self.described.len());
            outcome
        };
        let mut outcomes = Vec::with_capacity(self.described.len());
        for some in self.described.chunks(at_once) {
            outcomes.extend(crate::parallel::map(some.len(), |k| one(&some[k])));
        }
        // Some need more than their size tells, such as those of many channels: alone they may have it.
        let mut alone = false;
        for (outcome, frame) in outcomes.iter_mut().zip(&self.described) {
            if matches!(outcome, Err(ImageFault::Wrong(Error::InputMemory { .. }))) {
                *outcome = take_one(frame);
                alone = true;
            }
        }
        Ok((outcomes, if alone { 1 } else { at_once }))
    }

    /// Keeps a frame that was read, so that it need not be decoded again.
    pub(super) fn store(&self, frame: &CaptureFrame) -> Option<StoredFrame> {
        self.scratch.store(frame)
    }

    /// Keeps the frames for which `keep` returns `true`; `stored` is parallel to those.
    pub(super) fn retain(&mut self, keep: impl Fn(usize) -> bool, stored: Vec<Option<StoredFrame>>) {
        self.stored = stored;
        let kept = |index: &usize| keep(*index);
        let indices: Vec<usize> = (0..self.described.len()).filter(kept).collect();
        self.described = indices.iter().map(|&index| self.described[index].clone()).collect();
        self.stamps = indices.iter().map(|&index| std::mem::take(&mut self.stamps[index])).collect();
    }
}

impl FrameSource for FrameFiles {
    fn frame(&self, index: usize) -> Result<Cow<'_, CaptureFrame>> {
        let described = &self.described[index];
        if let Some(Some(stored)) = self.stored.get(index) {
            return Ok(Cow::Owned(self.scratch.load(stored, &described.view)?));
        }
        let ReadFrame { frame, .. } = read_frame(described, &self.access, &self.settings)?;
        // What is read twice has to be the same: the encoder's stages rely on it.
        if let Some(changed) = stamps(described).iter().zip(&self.stamps[index]).position(|(now, then)| now != then) {
            let path = files(described).nth(changed).unwrap_or(&described.photograph);
            return Err(Error::input(
                path,
                "the file was changed while the capture was being encoded; encode it again",
            ));
        }
        Ok(Cow::Owned(frame))
    }
    fn at_once(&self) -> usize {
        self.at_once
    }
}

fn files(described: &FrameDescription) -> impl Iterator<Item = &PathBuf> {
    [Some(&described.photograph), described.cross.as_ref(), described.mask.as_ref()].into_iter().flatten()
}

fn stamps(described: &FrameDescription) -> Vec<Option<FileStamp>> {
    let stamp = |metadata: std::fs::Metadata| (metadata.len(), metadata.modified().ok());
    files(described).map(|file| std::fs::metadata(file).ok().map(stamp)).collect()
}

/// A frame as it was read.
struct ReadFrame {
    frame: CaptureFrame,
    /// Missing pixels.
    missing: u64,
    /// Pixels at the most that the files hold.
    clipped: Option<Mask>,
}

fn read_frame(
    described: &FrameDescription,
    access: &FileAccess,
    settings: &FrameSettings,
) -> std::result::Result<ReadFrame, ImageFault> {
    let FrameSettings { space, invert_masks } = settings;
    let camera = &described.view.camera;
    let size = (camera.width, camera.height);
    let picture = read_radiance_image(&described.photograph, access, space, Some(size))?;
    let (mut photograph, mut clipped) = (picture.colour, picture.clipped);
    let mut cross = None;
    if let Some(path) = &described.cross {
        let picture = read_radiance_image(path, access, space, Some(size))?;
        cross = Some(picture.colour);
        match (&mut clipped, picture.clipped) {
            (Some(clipped), Some(other)) => clipped.data.iter_mut().zip(other.data).for_each(|(a, b)| *a |= b),
            (clipped, other) => *clipped = clipped.take().or(other),
        }
    }
    let (mut mask, mask_path) = match &described.mask {
        Some(path) => (Some(read_mask(path, access, size)?), path),
        None => (picture.alpha, &described.photograph),
    };
    if *invert_masks {
        mask.iter_mut().flat_map(|mask| &mut mask.data).for_each(|shown| *shown = !*shown);
    }
    // A pixel missing in one of the pair is missing in both, so that both components miss the same ones.
    let mut missing = 0;
    for index in 0..photograph.data.len() {
        let in_cross = cross.as_ref().is_some_and(|c| c.data[index][0].is_nan());
        if in_cross || photograph.data[index][0].is_nan() {
            photograph.data[index] = [f32::NAN; 3];
            cross.iter_mut().for_each(|c| c.data[index] = [f32::NAN; 3]);
            missing += mask.as_ref().is_none_or(|m| m.data[index]) as u64;
        }
    }
    if !described.lens.is_pinhole() {
        let lens = &described.lens;
        photograph = lens.undistort_image(camera, &photograph);
        cross = cross.map(|cross| lens.undistort_image(camera, &cross));
        mask = mask.map(|mask| lens.undistort_mask(camera, &mask));
        clipped = clipped.map(|clipped| lens.undistort_mask(camera, &clipped));
    }
    if mask.as_ref().is_some_and(|mask| mask.count() == 0) {
        return Err(ImageFault::Unreadable(Error::input(mask_path, "the mask is empty: no pixel shows the object")));
    }
    let frame = CaptureFrame { view: described.view.clone(), photograph, cross, mask };
    Ok(ReadFrame { frame, missing, clipped })
}
