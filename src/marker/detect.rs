//! Finding markers in a picture: AprilTags by the AprilTag library, ArUco markers by `aruco-rs`, whose corners are refined here.

use super::Family;
use crate::error::{Error, Result};
use crate::image::Grid;
use apriltag::{DetectorBuilder, Family as Tags, Image};
use aruco_rs::ImageBuffer;
use aruco_rs::core::detector::Detector as ArucoDetector;
use aruco_rs::core::dictionary::{DICTIONARY_ARUCO, DICTIONARY_ARUCO_MIP_36H12, Dictionary};
use aruco_rs::cv::scalar::ScalarCV;

/// Sides of the smallest and the largest picture that is looked at.
const SIDES: std::ops::RangeInclusive<usize> = 32..=16384;
/// Bits of a code that may be read wrongly; two make the table of 36h11 grow to many megabytes.
const CORRECTED_BITS: usize = 1;
/// Pictures of more pixels are first looked at with every second pixel left out.
const LARGE: usize = 160 * 160;
/// An edge is looked for this many pixels to each side, at most.
const EDGE_REACH: f64 = 4.0;

/// A marker in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Its family.
    pub family: Family,
    /// Its number within the family.
    pub id: u32,
    /// Corners in pixels (centres at +0.5): upper left, upper right, lower right, lower left, as the marker is printed.
    pub corners: [[f64; 2]; 4],
}

/// Finds markers of some families.
pub struct Detector {
    tags: Vec<(Family, apriltag::Detector)>,
    dictionaries: Vec<(Family, Dictionary)>,
}

impl Detector {
    /// For these families, at least one.
    pub fn new(families: &[Family]) -> Result<Self> {
        if families.is_empty() {
            return Err(Error::parameter("no marker family to look for"));
        }
        let (mut tags, mut dictionaries) = (Vec::new(), Vec::new());
        for &family in families {
            let codes = match family {
                Family::Tag36h11 => Tags::tag_36h11(),
                Family::Tag25h9 => Tags::tag_25h9(),
                Family::Tag16h5 => Tags::tag_16h5(),
                Family::Standard41h12 => Tags::tag_standard_41h12(),
                Family::Aruco => {
                    dictionaries.push((family, Dictionary::new(&DICTIONARY_ARUCO)));
                    continue;
                }
                Family::ArucoMip36h12 => {
                    dictionaries.push((family, Dictionary::new(&DICTIONARY_ARUCO_MIP_36H12)));
                    continue;
                }
            };
            // What is detected does not say its family: each has a detector of its own.
            let detector = DetectorBuilder::new().add_family_bits(codes, CORRECTED_BITS).build();
            let mut detector = detector.map_err(failed)?;
            // One thread, so that what is found never depends on their number.
            detector.set_thread_number(1);
            detector.set_refine_edges(true);
            tags.push((family, detector));
        }
        Ok(Detector { tags, dictionaries })
    }

    /// Markers in a picture of 8-bit grey values as they are displayed (not linear), 32 to 16384 pixels a side, by family and number.
    /// If `coarse`, small markers may be missed, and the work is a quarter.
    pub fn detect(&mut self, grey: &Grid<u8>, coarse: bool) -> Result<Vec<Detection>> {
        let (width, height) = (grey.width, grey.height);
        if !SIDES.contains(&width) || !SIDES.contains(&height) {
            let (least, most) = (SIDES.start(), SIDES.end());
            return Err(Error::parameter(format!(
                "markers are looked for in pictures of {least} to {most} pixels a side, this one has {width} x {height}"
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
        for (family, dictionary) in &self.dictionaries {
            found.extend(detect_aruco(*family, dictionary, grey));
        }
        // Of a marker found twice the larger one.
        found.sort_by(|a, b| (a.family as u8, a.id).cmp(&(b.family as u8, b.id)).then(area(b).total_cmp(&area(a))));
        found.dedup_by(|b, a| (a.family, a.id) == (b.family, b.id));
        Ok(found)
    }
}

/// Area of a marker in a picture, in pixels.
pub(super) fn area(detection: &Detection) -> f64 {
    let c = &detection.corners;
    let twice: f64 = (0..4).map(|k| c[k][0] * c[(k + 1) % 4][1] - c[k][1] * c[(k + 1) % 4][0]).sum();
    0.5 * twice.abs()
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

fn tag(family: Family, detection: &apriltag::Detection) -> Option<Detection> {
    // The library starts at the lower left and goes to the right.
    let [a, b, c, d] = detection.corners();
    let corners = [d, c, b, a];
    let finite = corners.iter().flatten().all(|x| x.is_finite());
    finite.then_some(Detection { family, id: detection.id() as u32, corners })
}

fn detect_aruco(family: Family, dictionary: &Dictionary, grey: &Grid<u8>) -> Vec<Detection> {
    let colours: Vec<u8> = grey.data.iter().flat_map(|&v| [v, v, v, 255]).collect();
    let picture = ImageBuffer { data: &colours, width: grey.width as u32, height: grey.height as u32 };
    let found = ArucoDetector::new(dictionary, ScalarCV).detect(&picture);
    let found = found.into_iter().filter_map(|marker| {
        let corners = marker.corners.map(|p| [p.x as f64 + 0.5, p.y as f64 + 0.5]);
        Some(Detection { family, id: u32::try_from(marker.id).ok()?, corners: refine(grey, corners)? })
    });
    found.collect()
}

/// Corners as the intersections of straight lines through the points of steepest change along each edge; `None` where an edge has none.
fn refine(grey: &Grid<u8>, corners: [[f64; 2]; 4]) -> Option<[[f64; 2]; 4]> {
    let lines: Vec<[f64; 3]> = (0..4).map(|k| edge(grey, corners[k], corners[(k + 1) % 4])).collect::<Option<_>>()?;
    let mut refined = [[0.0; 2]; 4];
    for (k, corner) in refined.iter_mut().enumerate() {
        let ([a, b, c], [d, e, f]) = (lines[(k + 3) % 4], lines[k]);
        let determinant = a * e - b * d;
        *corner = [(c * e - b * f) / determinant, (a * f - c * d) / determinant];
        let moved = (corner[0] - corners[k][0]).hypot(corner[1] - corners[k][1]);
        if moved.is_nan() || moved > 2.0 * EDGE_REACH {
            return None;
        }
    }
    Some(refined)
}

/// The line `a x + b y = c` of an edge that is dark on one side.
fn edge(grey: &Grid<u8>, from: [f64; 2], to: [f64; 2]) -> Option<[f64; 3]> {
    let along = [to[0] - from[0], to[1] - from[1]];
    let length = along[0].hypot(along[1]);
    let normal = [-along[1] / length, along[0] / length];
    let reach = EDGE_REACH.min(0.08 * length).max(1.0);
    let steps = (4.0 * reach).ceil() as i32;
    let count = (length.ceil() as usize).clamp(8, 256);
    let mut points = Vec::with_capacity(count);
    for k in 0..count {
        // The ends belong to the corners.
        let t = 0.06 + 0.88 * (k as f64 + 0.5) / count as f64;
        let middle = [from[0] + t * along[0], from[1] + t * along[1]];
        let value = |s: f64| bilinear(grey, [middle[0] + s * normal[0], middle[1] + s * normal[1]]);
        let (mut sum, mut moment) = (0.0, 0.0);
        for step in -steps..steps {
            let (s, next) = (step as f64 * reach / steps as f64, (step + 1) as f64 * reach / steps as f64);
            // The inside is dark: on the side that the normal points to.
            let drop = (value(s)? - value(next)?).max(0.0).powi(2);
            sum += drop;
            moment += drop * 0.5 * (s + next);
        }
        if sum > 16.0 {
            let s = moment / sum;
            points.push([middle[0] + s * normal[0], middle[1] + s * normal[1]]);
        }
    }
    let mut line = None;
    for _ in 0..2 {
        if points.len() < 6 {
            return None;
        }
        let n = points.len() as f64;
        let mean: [f64; 2] = std::array::from_fn(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
        let moment = |i: usize, j: usize| points.iter().map(|p| (p[i] - mean[i]) * (p[j] - mean[j])).sum::<f64>();
        let angle = 0.5 * (2.0 * moment(0, 1)).atan2(moment(0, 0) - moment(1, 1));
        let (a, b) = (-angle.sin(), angle.cos());
        let c = a * mean[0] + b * mean[1];
        line = Some([a, b, c]);
        // Once more without those that lie beside it.
        let far = |p: &[f64; 2]| (a * p[0] + b * p[1] - c).abs();
        let mut distances: Vec<f64> = points.iter().map(far).collect();
        distances.sort_by(f64::total_cmp);
        let limit = (2.5 * distances[distances.len() / 2]).max(0.05);
        points.retain(|p| far(p) <= limit);
    }
    line
}

/// Between pixels (centres at +0.5); `None` outside.
fn bilinear(grey: &Grid<u8>, [x, y]: [f64; 2]) -> Option<f64> {
    let (x, y) = (x - 0.5, y - 0.5);
    if !(x >= 0.0 && y >= 0.0 && x < (grey.width - 1) as f64 && y < (grey.height - 1) as f64) {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (s, t) = (x - column as f64, y - row as f64);
    let at = |dx: usize, dy: usize| *grey.at(column + dx, row + dy) as f64;
    Some((at(0, 0) * (1.0 - s) + at(1, 0) * s) * (1.0 - t) + (at(0, 1) * (1.0 - s) + at(1, 1) * s) * t)
}
