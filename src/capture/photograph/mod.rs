//! Files that photographs come of: one image each, or several through polarisers, at several exposures, or of a polarisation camera.
//!
//! Whatever they are, two images are made of them: unpolarised radiance, and where light was polarised, radiance with the specular reflection
//! blocked. A lamp behind a linear polariser and a linear polariser at angle `t` before the camera show `I(t) = a + b cos 2t + c sin 2t`
//! (Malus): a diffuse reflection is depolarised, a specular one is not, so that `2 a` is the radiance without the second polariser and
//! `a - |(b, c)|` half of the diffuse part (Wolff and Boult 1991; Miyazaki 2007, appendix A).

mod exif;
mod exposures;
mod filter_names;
mod mosaic;
mod polariser;
mod read;
#[cfg(test)]
mod tests;
mod written;

pub use mosaic::{MosaicColours, PolarisationMosaic};

pub(super) use exif::settle_exposures;
pub(super) use filter_names::pair_by_names;
pub(super) use read::{PhotographReading, ReadPhotograph};
pub(super) use written::{ExposureTimes, find_image, first_name, read_photograph};

use std::path::{Path, PathBuf};

/// Part of the diffuse reflection that one of two crossed ideal polarisers lets through of what both of its positions do together.
const IDEAL_BETA: f64 = 0.5;

/// One image file of an exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct ExposureFile {
    /// The image file.
    pub path: PathBuf,
    /// Time that it was exposed, over that of the capture's first one: positive, 1 where none is stated. Values are divided by it.
    pub time: f64,
}

/// Image files of one position of the filters; of several exposures each pixel takes those that are not clipped. At least one.
pub type Exposures = Vec<ExposureFile>;

/// Image files that a frame's photograph, or its pair of photographs through polarisers, is made of.
#[derive(Debug, Clone, PartialEq)]
pub enum PhotographFiles {
    /// A photograph, and where `cross` is given, one with the specular reflection blocked.
    Unpolarised {
        /// Without polarisers, or with the analyser open.
        photograph: Exposures,
        /// With the specular reflection blocked.
        cross: Option<Exposures>,
    },
    /// Polarised light, through an analyser parallel to it and one across: their sum is the photograph.
    Parallel {
        /// Through the analyser parallel to the light's polariser.
        parallel: Exposures,
        /// Through the analyser across it.
        cross: Exposures,
    },
    /// Linearly polarised light, through a linear polariser at these angles in degrees; at least three that differ modulo 180.
    Polariser(Vec<(f64, Exposures)>),
    /// Linearly polarised light, seen by a polarisation camera whose pixels have polarisers of their own.
    Mosaic {
        /// The raw image.
        raw: Exposures,
        /// Its cells.
        mosaic: PolarisationMosaic,
    },
}

impl PhotographFiles {
    /// One image file without polarisers.
    pub fn single(path: PathBuf) -> Self {
        PhotographFiles::Unpolarised { photograph: vec![ExposureFile { path, time: 1.0 }], cross: None }
    }

    fn exposures(&self) -> Vec<&ExposureFile> {
        match self {
            PhotographFiles::Unpolarised { photograph, cross } => {
                photograph.iter().chain(cross.iter().flatten()).collect()
            }
            PhotographFiles::Parallel { parallel, cross } => parallel.iter().chain(cross).collect(),
            PhotographFiles::Polariser(angles) => angles.iter().flat_map(|(_, exposures)| exposures).collect(),
            PhotographFiles::Mosaic { raw, .. } => raw.iter().collect(),
        }
    }

    /// Returns the image files, at least one.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.exposures().into_iter().map(|exposure| exposure.path.as_path())
    }

    /// Returns the first image file, which errors and warnings name.
    pub fn first(&self) -> &Path {
        self.files().next().unwrap_or(Path::new(""))
    }

    /// Returns `true` if a photograph with the specular reflection blocked comes of them.
    pub fn is_polarised(&self) -> bool {
        !matches!(self, PhotographFiles::Unpolarised { cross: None, .. })
    }

    /// Returns the ratio of both photographs of a white diffuse surface where it follows from what they are; else it has to be measured.
    pub(super) fn ideal_beta(&self) -> Option<[f64; 3]> {
        (!matches!(self, PhotographFiles::Unpolarised { .. })).then_some([IDEAL_BETA; 3])
    }
}
