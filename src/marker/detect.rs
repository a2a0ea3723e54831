//! Finding markers in an image: AprilTags by the AprilTag library; ArUco and ARToolKit markers among the squares of the contours of
//! `aruco-rs`, their corners, bits and pictures read here.

use super::MarkerFamily;
use super::aruco::{self, ArucoCodes};
use super::detection::{MarkerDetection, area};
use super::pattern::{self, MarkerPattern};
use super::squares::find_squares;
use crate::error::{Error, Result};
use crate::image::Grid;
use apriltag::{DetectorBuilder, Family as Tags, Image};

/// Sides of the smallest and the largest image that is looked at.
const SIDES: std::ops::RangeInclusive<usize> = 32..=16384;
/// Bits of a code that may be read wrongly; two make the table of 36h11 grow to many megabytes.
const CORRECTED_BITS: usize = 1;
/// Images of more pixels are first looked at with every second pixel left out.
const LARGE: usize = 160 * 160;

/// Finds markers of some families.
pub struct MarkerDetector {
    tags: Vec<(MarkerFamily, apriltag::Detector)>,
    aruco: Vec<ArucoCodes>,
    patterns: Vec<MarkerPattern>,
}

impl MarkerDetector {
    /// Prepares a detector for these families, at least one.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] without a family, [`Error::Unsupported`] if the AprilTag library refuses one.
    pub fn new(families: &[MarkerFamily]) -> Result<Self> {
        MarkerDetector::with_patterns(families, &[])
    }

    /// Prepares a detector for these families; markers of [`MarkerFamily::ArToolKit`] are found by these patterns, and numbered as they are.
    ///
    /// # Errors
    ///
    /// Those of [`Self::new`]; [`Error::Parameter`] for [`MarkerFamily::ArToolKit`] without patterns.
    pub fn with_patterns(families: &[MarkerFamily], patterns: &[MarkerPattern]) -> Result<Self> {
        if families.is_empty() {
            return Err(Error::parameter("no marker family to look for"));
        }
        let patterns = if families.contains(&MarkerFamily::ArToolKit) { patterns.to_vec() } else { Vec::new() };
        if families.contains(&MarkerFamily::ArToolKit) && patterns.is_empty() {
            return Err(Error::parameter(
                "ARToolKit's markers are found by their pattern files, of which there is none",
            ));
        }
        let (mut tags, mut aruco) = (Vec::new(), Vec::new());
        for &family in families {
            let codes = match family {
                MarkerFamily::Tag36h11 => Tags::tag_36h11(),
                MarkerFamily::Tag25h9 => Tags::tag_25h9(),
                MarkerFamily::Tag16h5 => Tags::tag_16h5(),
                MarkerFamily::Standard41h12 => Tags::tag_standard_41h12(),
                MarkerFamily::Aruco
                | MarkerFamily::ArucoMip36h12
                | MarkerFamily::ArucoOpenCv(_)
                | MarkerFamily::ArToolKitBarcode => {
                    aruco.extend(ArucoCodes::new(family));
                    continue;
                }
                MarkerFamily::ArToolKit => continue,
            };
            // What is detected does not say its family: each has a detector of its own.
            let detector = DetectorBuilder::new().add_family_bits(codes, CORRECTED_BITS).build();
            let mut detector = detector.map_err(failed)?;
            // One thread, so that what is found never depends on their number.
            detector.set_thread_number(1);
            detector.set_refine_edges(true);
            tags.push((family, detector));
        }
        Ok(MarkerDetector { tags, aruco, patterns })
    }

    /// Markers in an image of 8-bit grey values as they are displayed (not linear), 32 to 16384 pixels a side, by family and number.
    /// If `coarse`, small markers may be missed, and the work is a quarter.
    pub fn detect(&mut self, grey: &Grid<u8>, coarse: bool) -> Result<Vec<MarkerDetection>> {
        let (width, height) = (grey.width, grey.height);
        if !SIDES.contains(&width) || !SIDES.contains(&height) {
            let (least, most) = (SIDES.start(), SIDES.end());
            return Err(Error::parameter(format!(
                "markers are looked for in images of {least} to {most} pixels a side, this one has {width} x {height}"
            )));
        }
        let mut found = Vec::new();
        if !self.tags.is_empty() {
            let image = copy(grey)?;
            for (family, detector) in &mut self.tags {
                detector.set_decimation(if coarse && width * height > LARGE { 2.0 } else { 1.0 });
                found.extend(detector.detect(&image).iter().filter_map(|detection| tag(*family, detection)));
            }
        }
        if !(self.aruco.is_empty() && self.patterns.is_empty()) {
            let squares = find_squares(grey);
            found.extend(aruco::detect(&self.aruco, grey, &squares));
            found.extend(pattern::detect(&self.patterns, grey, &squares));
        }
        // Of a marker found twice the larger one.
        found.sort_by(|a, b| (a.family, a.id).cmp(&(b.family, b.id)).then(area(b).total_cmp(&area(a))));
        found.dedup_by(|b, a| (a.family, a.id) == (b.family, b.id));
        Ok(found)
    }
}

fn failed(error: apriltag::Error) -> Error {
    Error::Unsupported(format!("the detector of AprilTags: {error}"))
}

fn copy(grey: &Grid<u8>) -> Result<Image> {
    let mut image = Image::zeros_with_alignment(grey.width, grey.height, 96).map_err(failed)?;
    let stride = image.stride();
    let rows = image.as_slice_mut().chunks_mut(stride).zip(grey.data.chunks(grey.width));
    rows.for_each(|(to, from)| to[..from.len()].copy_from_slice(from));
    Ok(image)
}

fn tag(family: MarkerFamily, detection: &apriltag::Detection) -> Option<MarkerDetection> {
    // The library starts at the lower left and goes to the right.
    let [a, b, c, d] = detection.corners();
    let corners = [d, c, b, a];
    let finite = corners.iter().flatten().all(|x| x.is_finite());
    finite.then_some(MarkerDetection { family, id: detection.id() as u32, corners })
}
