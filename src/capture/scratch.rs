//! Frames in a temporary file: decoding a photograph takes longer than reading back the pixels that show the object.

use super::CaptureFrame;
use crate::error::{Error, Result};
use crate::image::{MaskRuns, RgbImage};
use crate::input::{scratch_file, scratch_folder};
use crate::views::View;
use std::io::{Error as IoError, ErrorKind, Read, Result as IoResult, Seek, SeekFrom, Write};
use std::sync::{Mutex, PoisonError};
use tempfile::SpooledTempFile;

/// A temporary file of frames.
#[derive(Debug)]
pub(super) struct FrameScratch {
    file: Mutex<ScratchFile>,
}

#[derive(Debug)]
struct ScratchFile {
    file: SpooledTempFile,
    end: u64,
}

/// Where a frame is in the file, and what there is of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct StoredFrame {
    offset: u64,
    bytes: usize,
    has_cross: bool,
    has_mask: bool,
}

impl FrameScratch {
    pub(super) fn new() -> Self {
        FrameScratch { file: Mutex::new(ScratchFile { file: scratch_file(), end: 0 }) }
    }

    /// Writes the pixels of a frame that its mask shows. `None` where the file can't take it, such as on a full disk.
    pub(super) fn store(&self, frame: &CaptureFrame) -> Option<StoredFrame> {
        let mut bytes = Vec::new();
        if let Some(mask) = &frame.mask {
            let MaskRuns { lengths, .. } = MaskRuns::new(mask);
            bytes.extend((lengths.len() as u32).to_le_bytes());
            lengths.iter().for_each(|length| bytes.extend(length.to_le_bytes()));
        }
        let shown = |k: usize| frame.mask.as_ref().is_none_or(|mask| mask.data[k]);
        for image in [Some(&frame.photograph), frame.cross.as_ref()].into_iter().flatten() {
            for (_, pixel) in image.data.iter().enumerate().filter(|(k, _)| shown(*k)) {
                pixel.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
            }
        }
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let offset = file.end;
        file.file.seek(SeekFrom::Start(offset)).and_then(|_| file.file.write_all(&bytes)).ok()?;
        file.end += bytes.len() as u64;
        let (has_cross, has_mask) = (frame.cross.is_some(), frame.mask.is_some());
        Some(StoredFrame { offset, bytes: bytes.len(), has_cross, has_mask })
    }

    /// Returns a frame of the file; the pixels that its mask leaves out are 0.
    pub(super) fn load(&self, stored: &StoredFrame, view: &View) -> Result<CaptureFrame> {
        let failed = |error| Error::io(scratch_folder(), error);
        let mut bytes = vec![0; stored.bytes];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.file.seek(SeekFrom::Start(stored.offset)).map_err(failed)?;
        file.file.read_exact(&mut bytes).map_err(failed)?;
        drop(file);
        parse(&bytes, stored, view).map_err(failed)
    }
}

fn parse(mut bytes: &[u8], stored: &StoredFrame, view: &View) -> IoResult<CaptureFrame> {
    let short = || IoError::from(ErrorKind::UnexpectedEof);
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let mask = match stored.has_mask {
        true => {
            let mut number = || {
                let (number, rest) = bytes.split_first_chunk().ok_or_else(short)?;
                bytes = rest;
                Ok(u32::from_le_bytes(*number))
            };
            let count = number()?;
            let lengths = (0..count).map(|_| number()).collect::<IoResult<_>>()?;
            Some(MaskRuns { width, height, lengths }.mask())
        }
        false => None,
    };
    let mut image = || {
        let mut image = RgbImage::filled(width, height, [0.0; 3]);
        let shown = |k: usize| mask.as_ref().is_none_or(|mask| mask.data[k]);
        for (_, pixel) in image.data.iter_mut().enumerate().filter(|(k, _)| shown(*k)) {
            let (values, rest) = bytes.split_first_chunk::<12>().ok_or_else(short)?;
            let (values, _) = values.as_chunks::<4>();
            *pixel = std::array::from_fn(|c| f32::from_le_bytes(values[c]));
            bytes = rest;
        }
        Ok::<_, IoError>(image)
    };
    let photograph = image()?;
    let cross = if stored.has_cross { Some(image()?) } else { None };
    Ok(CaptureFrame { view: view.clone(), photograph, cross, mask })
}
