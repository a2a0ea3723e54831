//! Exposures that image files tell of themselves.

use super::{ExposureFile, PhotographFiles};
use crate::capture::description::CaptureDescription;
use crate::error::{Error, Result};
use crate::input::FileAccess;
use exif::{In, Tag, Value};
use std::io::BufReader;
use std::path::Path;

/// Ratio of exposures that is told of.
const TOLD: f64 = 1.02;
/// Bytes of a file that is read whole for its EXIF data, at most, as of TIFF it is.
const MAX_BYTES: u64 = 256 << 20;

/// Light that a photograph let in and how it was amplified, as EXIF has it: seconds times sensitivity over the square of the f-number. What is
/// not told is `None`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ExifExposure {
    seconds: f64,
    sensitivity: Option<f64>,
    aperture: Option<f64>,
}

impl ExifExposure {
    fn read(path: &Path, access: &FileAccess) -> Option<Self> {
        // A file that can't be read is told of where its image is.
        let (file, bytes) = crate::input::open(path).ok()?;
        if bytes > MAX_BYTES {
            return None;
        }
        let _held = access.reserve(path, "EXIF data", bytes).ok()?;
        let data = exif::Reader::new().read_from_container(&mut BufReader::new(file)).ok()?;
        let number = |tag: Tag| {
            let value = match &data.get_field(tag, In::PRIMARY)?.value {
                Value::Rational(values) => values.first()?.to_f64(),
                value => f64::from(value.get_uint(0)?),
            };
            (value.is_finite() && value > 0.0).then_some(value)
        };
        Some(ExifExposure {
            seconds: number(Tag::ExposureTime)?,
            sensitivity: number(Tag::PhotographicSensitivity),
            aperture: number(Tag::FNumber),
        })
    }

    /// Returns how much brighter a photograph is than another by its exposure alone, by what both tell.
    fn over(&self, other: &Self) -> f64 {
        let ratio = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(1.0, |(a, b)| a / b);
        let opening = ratio(self.aperture, other.aperture);
        self.seconds / other.seconds * ratio(self.sensitivity, other.sensitivity) / (opening * opening)
    }
}

/// Looks whether photographs were exposed alike, unless the capture states their times; divides them by their exposures over the first one's if
/// `applied`, else warns where they differ.
/// # Errors
/// Where exposures are to be applied and a file says nothing about its own, or they differ by more than a million.
pub(in super::super) fn settle_exposures(
    description: &mut CaptureDescription,
    applied: bool,
    access: &FileAccess,
) -> Result<()> {
    let frames = description.frames.iter_mut().map(|frame| &mut frame.photograph);
    let boards = description.white_reference.iter_mut().map(|white| &mut white.photograph);
    let mut files: Vec<&mut ExposureFile> = frames.chain(boards).flat_map(exposures).collect();
    if files.iter().any(|file| file.time != 1.0) {
        return Ok(());
    }
    let found = crate::parallel::map(files.len(), |k| ExifExposure::read(&files[k].path, access));
    if !applied {
        let known: Vec<ExifExposure> = found.into_iter().flatten().collect();
        let ratios = known.iter().map(|exposure| exposure.over(&known[0]));
        let (least, most) = ratios.fold((1.0, 1.0), |(a, b): (f64, f64), ratio| (a.min(ratio), b.max(ratio)));
        if most > TOLD * least {
            description.warnings.push(format!(
                "photographs were exposed differently, by up to a factor of {:.2} (EXIF), and are taken as they are; option `exif_exposure` divides \
                 them by their exposures",
                most / least
            ));
        }
        return Ok(());
    }
    let mut first = None;
    for (file, found) in files.iter_mut().zip(found) {
        let wrong = |message: &str| Error::input(&file.path, message);
        let found = found.ok_or_else(|| {
            wrong("it does not say how it was exposed (EXIF's ExposureTime): leave out option `exif_exposure`")
        })?;
        let time = found.over(first.get_or_insert(found));
        if !(1e-6..=1e6).contains(&time) {
            return Err(wrong(
                "its exposure (EXIF) is more than a million times the first photograph's, or less than a millionth",
            ));
        }
        file.time = time;
    }
    Ok(())
}

fn exposures(photograph: &mut PhotographFiles) -> Vec<&mut ExposureFile> {
    match photograph {
        PhotographFiles::Unpolarised { photograph, cross } => {
            photograph.iter_mut().chain(cross.iter_mut().flatten()).collect()
        }
        PhotographFiles::Parallel { parallel, cross } => parallel.iter_mut().chain(cross).collect(),
        PhotographFiles::Polariser(angles) => angles.iter_mut().flat_map(|(_, exposures)| exposures).collect(),
        PhotographFiles::Mosaic { raw, .. } => raw.iter_mut().collect(),
    }
}
