//! Photographs as `transforms.json` writes them.
//!
//! A photograph is an object with `file_path`, and `exposure_time` where exposures differ, or with `exposures`, a list of such objects. Frames and
//! the white reference are photographs; beside them stand `cross_file_path` or `cross`, `parallel_file_path` or `parallel`, `polarisers`, and
//! here or at the top `polarisation_mosaic`.

use super::polariser::{MIN_ANGLES, distinct};
use super::{ExposureFile, Exposures, MosaicColours, PhotographFiles, PolarisationMosaic};
use crate::capture::json::JsonNode;
use crate::error::Result;
use crate::input::{Folder, escaped};
use std::path::PathBuf;

/// Exposures of a photograph, and angles of the polariser, at most.
const MAX_IMAGES: usize = 64;

/// Exposure times of a capture, which are told relative to the first.
#[derive(Default)]
pub(in super::super) struct ExposureTimes {
    first: Option<f64>,
    /// Where the first image without a time is named.
    silent: Option<String>,
}

impl ExposureTimes {
    fn of(&mut self, node: &JsonNode) -> Result<f64> {
        let Some(stated) = node.get("exposure_time") else {
            self.silent.get_or_insert_with(|| node.key.clone());
            return Ok(1.0);
        };
        let time = stated.number()?;
        if time <= 0.0 {
            return Err(stated.error("an exposure time is positive"));
        }
        let relative = time / *self.first.get_or_insert(time);
        if !(1e-6..=1e6).contains(&relative) {
            return Err(stated.error(format!("{relative:.1e} times the exposure of the capture's first photograph")));
        }
        Ok(relative)
    }

    /// Checks that all images of a capture have a time, or none.
    pub(in super::super) fn check(&self, root: &JsonNode) -> Result<()> {
        match (&self.silent, self.first) {
            (Some(silent), Some(_)) => Err(root.error(format!(
                "{} has no exposure_time, as others have: state it for all photographs and the white_reference",
                escaped(silent)
            ))),
            _ => Ok(()),
        }
    }
}

/// Returns the name of the first image file of a frame, after which its view is named.
pub(in super::super) fn first_name<'a>(frame: &JsonNode<'a>) -> Result<&'a str> {
    if let Some(path) = frame.get("file_path") {
        return path.text();
    }
    let first = |key: &str| frame.get(key).and_then(|list| list.items(MAX_IMAGES).ok()?.into_iter().next());
    if let Some(one) = first("exposures").or_else(|| first("polarisers")).or_else(|| frame.get("parallel")) {
        return first_name(&one);
    }
    frame.get("parallel_file_path").map_or_else(|| frame.required("file_path")?.text(), |path| path.text())
}

/// Reads which files a frame's photograph, or the white board's, comes of.
pub(in super::super) fn read_photograph(
    root: &JsonNode,
    frame: &JsonNode,
    folder: &Folder,
    times: &mut ExposureTimes,
) -> Result<PhotographFiles> {
    let mut beside = |key: &str| -> Result<Option<Exposures>> {
        let path = format!("{key}_file_path");
        match (frame.get(key), frame.get(&path)) {
            (Some(node), _) => Ok(Some(read_exposures(&node, folder, times)?)),
            (None, Some(path)) => {
                Ok(Some(vec![ExposureFile { path: find_image(folder, path.text()?)?, time: times.of(frame)? }]))
            }
            (None, None) => Ok(None),
        }
    };
    let (parallel, cross) = (beside("parallel")?, beside("cross")?);
    let polarisers = frame.get("polarisers");
    let mosaic = frame.get("polarisation_mosaic").or_else(|| root.get("polarisation_mosaic"));
    if usize::from(parallel.is_some() || cross.is_some())
        + usize::from(polarisers.is_some())
        + usize::from(mosaic.is_some())
        > 1
    {
        return Err(frame.error("polarised photographs are told in one way: cross, polarisers or polarisation_mosaic"));
    }
    if let Some(list) = polarisers {
        let read = |node: &JsonNode| Ok((node.required("angle")?.number()?, read_exposures(node, folder, times)?));
        let angles = list.items(MAX_IMAGES)?.iter().map(read).collect::<Result<Vec<_>>>()?;
        let found = distinct(&angles.iter().map(|(angle, _)| *angle).collect::<Vec<_>>());
        if found < MIN_ANGLES {
            return Err(list.error(format!(
                "photographs at {found} angles of the polariser (modulo 180 degrees), {MIN_ANGLES} at least are needed"
            )));
        }
        return Ok(PhotographFiles::Polariser(angles));
    }
    match (parallel, cross) {
        (Some(parallel), Some(cross)) => Ok(PhotographFiles::Parallel { parallel, cross }),
        (Some(_), None) => {
            Err(frame
                .error("a photograph through parallel polarisers needs the crossed one beside it (cross_file_path)"))
        }
        (None, cross) => {
            let photograph = read_exposures(frame, folder, times)?;
            match mosaic {
                Some(mosaic) => Ok(PhotographFiles::Mosaic { raw: photograph, mosaic: read_mosaic(&mosaic)? }),
                None => Ok(PhotographFiles::Unpolarised { photograph, cross }),
            }
        }
    }
}

fn read_exposures(node: &JsonNode, folder: &Folder, times: &mut ExposureTimes) -> Result<Exposures> {
    let mut read = |node: &JsonNode| -> Result<ExposureFile> {
        Ok(ExposureFile { path: find_image(folder, node.required("file_path")?.text()?)?, time: times.of(node)? })
    };
    let Some(list) = node.get("exposures") else { return Ok(vec![read(node)?]) };
    let exposures = list.items(MAX_IMAGES)?;
    if exposures.is_empty() {
        return Err(list.error("a list of no exposures"));
    }
    if exposures.len() > 1 {
        exposures.iter().try_for_each(|exposure| exposure.required("exposure_time").map(|_| ()))?;
    }
    exposures.iter().map(read).collect()
}

fn read_mosaic(node: &JsonNode) -> Result<PolarisationMosaic> {
    if node.is_true() {
        return Ok(PolarisationMosaic::SONY);
    }
    let angles = node.required("angles")?.numbers::<4>()?;
    if distinct(&angles) < angles.len() {
        return Err(node.error("the four angles of a cell differ, modulo 180 degrees"));
    }
    let colours = node.optional("colours", |node| {
        let letters: Vec<Option<u8>> = node.text()?.chars().map(|letter| "RGB".find(letter).map(|c| c as u8)).collect();
        let count = |colour: u8| letters.iter().filter(|letter| **letter == Some(colour)).count();
        match letters.as_slice() {
            [Some(a), Some(b), Some(c), Some(d)] if [0, 1, 2].map(count) == [1, 2, 1] => {
                Ok(MosaicColours::Bayer([*a, *b, *c, *d]))
            }
            _ => Err(node.error("the colours of 2 x 2 cells are told as RGGB, BGGR, GRBG or GBRG")),
        }
    })?;
    Ok(PolarisationMosaic { angles, colours: colours.unwrap_or(MosaicColours::Monochrome) })
}

/// Returns the path of an image; some data sets leave the extension away.
pub(in super::super) fn find_image(folder: &Folder, name: &str) -> Result<PathBuf> {
    let path = folder.resolve(name)?;
    if path.extension().is_none() && !path.exists() {
        for extension in ["exr", "png", "jpg", "jpeg", "tif", "tiff", "EXR", "PNG", "JPG", "JPEG", "TIF", "TIFF"] {
            // It may be a link, which is another path to judge.
            if path.with_extension(extension).exists() {
                return folder.resolve(&format!("{name}.{extension}"));
            }
        }
    }
    Ok(path)
}
