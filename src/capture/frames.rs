//! Frames of a capture: photographs and masks, read together or one at a time.

use super::FrameDescription;
use super::clipping::Clipping;
use super::photograph::{PhotographReading, ReadPhotograph};
use super::scratch::{FrameScratch, StoredFrame};
use super::white::BoardRadiance;
use crate::error::{Error, Result};
use crate::image::read::{ColorSpace, ImageFault, read_mask};
use crate::image::{Mask, RgbImage};
use crate::input::FileAccess;
use crate::mesh::Mesh;
use crate::views::View;
use std::borrow::Cow;
use std::fmt::Debug;
use std::path::Path;
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

impl CaptureFrame {
    /// Returns an error unless photographs and mask have the camera's size and the mask shows something. Those that are read from files have.
    /// # Errors
    /// [`Error::Parameter`], which names the frame.
    pub fn check(&self) -> Result<()> {
        let View { name, camera, .. } = &self.view;
        let wrong = |what: String| Err(Error::parameter(format!("frame {name}: {what}")));
        let of_photographs = [Some(&self.photograph), self.cross.as_ref()].into_iter().flatten();
        let photographs = of_photographs.map(|image| ("photograph", image.size(), image.data.len()));
        let mask = self.mask.as_ref().map(|mask| ("mask", mask.size(), mask.data.len()));
        for (what, (width, height), values) in photographs.chain(mask) {
            if (width, height) != (camera.width, camera.height) || values != width as usize * height as usize {
                let size = format!("{} x {}", camera.width, camera.height);
                return wrong(format!("the {what} has {width} x {height} pixels, its camera {size}"));
            }
        }
        if self.photograph.data.is_empty() || self.mask.as_ref().is_some_and(|mask| mask.count() == 0) {
            return wrong("its mask shows nothing of the object".into());
        }
        Ok(())
    }
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
    /// Radiance of the white board, to which frames that show it are brought.
    pub(super) board: Option<BoardRadiance>,
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
        let (mut kept, mut reading) = (0u64, 1u64);
        for frame in &self.described {
            if std::fs::metadata(frame.photograph.first()).is_err() {
                continue;
            }
            let (width, height) = (frame.view.camera.width, frame.view.camera.height);
            let pixels = u64::from(width) * u64::from(height);
            kept += pixels * (if frame.photograph.is_polarised() { 24 } else { 12 } + 1);
            // Lens distortion is removed out of place.
            reading = reading.max(self.reading().memory(frame, width, height).saturating_add(12 * pixels));
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

    fn reading(&self) -> PhotographReading<'_> {
        PhotographReading { access: &self.access, space: &self.settings.space }
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
            let path = described.files().nth(changed).unwrap_or(described.photograph.first());
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

fn stamps(described: &FrameDescription) -> Vec<Option<FileStamp>> {
    let stamp = |metadata: std::fs::Metadata| (metadata.len(), metadata.modified().ok());
    described.files().map(|file| std::fs::metadata(file).ok().map(stamp)).collect()
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
    let camera = &described.view.camera;
    let size = (camera.width, camera.height);
    let reading = PhotographReading { access, space: &settings.space };
    let mut read = reading.read(&described.photograph, Some(size))?;
    if let (Some(region), Some(wanted)) = (&described.board, &settings.board) {
        BoardRadiance::of_region(&read, region, described).map_err(ImageFault::Wrong)?.bring_to(wanted, &mut read);
    }
    let ReadPhotograph { mut photograph, mut cross, alpha, mut clipped } = read;
    let (mut mask, mask_path) = match &described.mask {
        Some(path) => (Some(read_mask(path, access, size)?), path.as_path()),
        None => (alpha, described.photograph.first()),
    };
    if settings.invert_masks {
        mask.iter_mut().flat_map(|mask| &mut mask.data).for_each(|shown| *shown = !*shown);
    }
    let is_shown = |index: usize| mask.as_ref().is_none_or(|mask| mask.data[index]);
    let missing = (0..photograph.data.len()).filter(|&k| photograph.data[k][0].is_nan() && is_shown(k)).count() as u64;
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
