//! Poses from frame to frame.

use super::detect::MarkerDetector;
use super::detection::MarkerDetection;
use super::{PoseEstimate, Rig, estimate_poses};
use crate::capture::Lens;
use crate::error::Result;
use crate::image::Grid;
use crate::views::Camera;

/// A second pose whose error is within this factor and this many pixels of the best one's may be the true one.
const AMBIGUOUS: (f64, f64) = (2.0, 0.15);
/// The next frame's markers are first looked for in the last one's surroundings, larger by this share of their extent on every side.
const MARGIN: f64 = 0.6;
const MIN_MARGIN: f64 = 32.0;

/// Follows a rig through the frames of one camera.
pub struct MarkerTracker {
    rig: Rig,
    camera: Camera,
    lens: Lens,
    detector: MarkerDetector,
    last: Option<PoseEstimate>,
    /// Part of the image where the last markers were: left, top, right, bottom.
    around: Option<[usize; 4]>,
}

impl MarkerTracker {
    /// For one camera (its pose is not used) and its lens.
    pub fn new(rig: Rig, camera: Camera, lens: Lens) -> Result<Self> {
        let detector = MarkerDetector::with_patterns(&rig.families(), &rig.patterns)?;
        Ok(MarkerTracker { rig, camera, lens, detector, last: None, around: None })
    }

    /// The markers looked for.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Pose in the next frame, 8-bit grey values as displayed; `None` where no marker of the rig is wholly in the image.
    ///
    /// Where the corners leave it open which way the markers lean, the pose nearer to the last frame's is taken.
    pub fn track(&mut self, grey: &Grid<u8>) -> Result<Option<(PoseEstimate, Vec<MarkerDetection>)>> {
        let found = self.find(grey)?;
        let poses = estimate_poses(&self.camera, &self.lens, &self.rig, &found);
        let chosen = match (poses.as_slice(), &self.last) {
            ([best, second], Some(last))
                if second.rms_pixels < AMBIGUOUS.0 * best.rms_pixels + AMBIGUOUS.1
                    && second.pose.angle_to(&last.pose) < best.pose.angle_to(&last.pose) =>
            {
                Some(*second)
            }
            (poses, _) => poses.first().copied(),
        };
        self.last = chosen;
        self.around = chosen.and_then(|_| surroundings(grey, &found));
        Ok(chosen.map(|estimate| (estimate, found)))
    }

    /// Markers of the rig: around the last ones, else in the whole image coarsely, else in all its pixels.
    fn find(&mut self, grey: &Grid<u8>) -> Result<Vec<MarkerDetection>> {
        if let Some([left, top, right, bottom]) = self.around
            && right <= grey.width
            && bottom <= grey.height
        {
            let data = (top..bottom).flat_map(|y| grey.row(y)[left..right].iter().copied()).collect();
            let part = Grid { width: right - left, height: bottom - top, data };
            let mut found = self.wanted(&part, true)?;
            for corner in found.iter_mut().flat_map(|d| &mut d.corners) {
                *corner = [corner[0] + left as f64, corner[1] + top as f64];
            }
            if found.len() >= self.last.map_or(1, |last| last.markers) {
                return Ok(found);
            }
        }
        let found = self.wanted(grey, true)?;
        if found.is_empty() { self.wanted(grey, false) } else { Ok(found) }
    }

    fn wanted(&mut self, grey: &Grid<u8>, coarse: bool) -> Result<Vec<MarkerDetection>> {
        let mut found = self.detector.detect(grey, coarse)?;
        let markers = &self.rig.markers;
        found.retain(|d| markers.iter().any(|m| m.family == d.family && m.id.is_none_or(|id| id == d.id)));
        Ok(found)
    }
}

/// The part of an image around markers.
fn surroundings(grey: &Grid<u8>, found: &[MarkerDetection]) -> Option<[usize; 4]> {
    let range = |i: usize, most: usize| {
        let values = || found.iter().flat_map(|d| d.corners).map(move |c| c[i]);
        let (low, high) = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
        let margin = (MARGIN * (high - low)).max(MIN_MARGIN);
        ((low - margin).max(0.0) as usize, (high + margin).clamp(0.0, most as f64) as usize)
    };
    let ((left, right), (top, bottom)) = (range(0, grey.width), range(1, grey.height));
    // Nothing is gained with most of the image, and the detector wants some size.
    let small = (right.saturating_sub(left)) * (bottom.saturating_sub(top)) < grey.data.len() / 2;
    (small && right >= left + 64 && bottom >= top + 64).then_some([left, top, right, bottom])
}
