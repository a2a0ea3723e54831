//! The pose of a rig from its corners: a homography for each marker, both of the poses that a small flat square leaves open, and
//! Levenberg-Marquardt on the reprojection error of all corners.

use super::detection::{MarkerDetection, area};
use super::homography::homography;
use super::{Pose, Rig, RigMarker};
use crate::capture::Lens;
use crate::capture::align::{Correspondence, Similarity, refine, start::nearest_rotation};
use crate::views::Camera;
use glam::{DMat3, DVec3};

/// Markers, the largest ones, from which a pose is started.
const MAX_STARTS: usize = 4;
/// Poses nearer to each other than this are one, radians.
const SAME: f64 = 1e-3;

/// A pose and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseEstimate {
    /// Rig to camera.
    pub pose: Pose,
    /// Root mean square distance between found and projected corners, pixels of the pinhole camera.
    pub rms_pixels: f64,
    /// Largest such distance.
    pub max_pixels: f64,
    /// Markers that it rests on.
    pub markers: usize,
}

/// Poses of a rig in one image, the best first: one, or two where the markers found leave it nearly open which way they lean. Empty where no
/// marker of the rig was found.
///
/// Of `camera` focal lengths and principal point are taken; `lens` bends what it sees.
pub fn estimate_poses(camera: &Camera, lens: &Lens, rig: &Rig, found: &[MarkerDetection]) -> Vec<PoseEstimate> {
    let camera = Camera { rotation: Pose::IDENTITY.rotation, translation: [0.0; 3], ..*camera };
    let mut seen: Vec<(&RigMarker, &MarkerDetection, [[f64; 2]; 4])> = Vec::new();
    for marker in &rig.markers {
        let same = found.iter().filter(|d| d.family == marker.family && marker.id.is_none_or(|id| id == d.id));
        let Some(largest) = same.max_by(|a, b| area(a).total_cmp(&area(b))) else { continue };
        let corners = largest.corners.map(|c| {
            let bent: [f64; 2] = std::array::from_fn(|i| (c[i] - camera.principal[i]) / camera.focal[i]);
            lens.undistort(bent)
        });
        if let [Some(a), Some(b), Some(c), Some(d)] = corners {
            seen.push((marker, largest, [a, b, c, d]));
        }
    }
    seen.sort_by(|a, b| area(b.1).total_cmp(&area(a.1)));
    let points: Vec<Correspondence> = (seen.iter())
        .flat_map(|(marker, _, ideal)| marker.corners().into_iter().zip(*ideal))
        .map(|(mesh, ideal)| {
            let pixel = std::array::from_fn(|i| ideal[i] * camera.focal[i] + camera.principal[i]);
            Correspondence { frame: 0, pixel, mesh }
        })
        .collect();
    let mut estimates: Vec<PoseEstimate> = Vec::new();
    for (marker, _, ideal) in seen.iter().take(MAX_STARTS) {
        let Some(first) = from_homography(*ideal, marker.size) else { continue };
        for start in [first, mirrored_pose(&first)] {
            let start = start.compose(&marker.pose.inverse());
            let start = Similarity { rotation: start.matrix(), translation: start.translation.into(), scale: 1.0 };
            let Some((_, refined)) = refine::refine(&[camera], &points, start, false) else { continue };
            let Some(errors) = refine::reprojection_errors(&[camera], &points, &refined) else { continue };
            let pose = Pose::from_matrix(refined.rotation, refined.translation);
            let rms_pixels = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let max_pixels = errors.iter().copied().fold(0.0, f64::max);
            if estimates.iter().all(|known| known.pose.angle_to(&pose) > SAME) {
                estimates.push(PoseEstimate { pose, rms_pixels, max_pixels, markers: seen.len() });
            }
        }
    }
    estimates.sort_by(|a, b| a.rms_pixels.total_cmp(&b.rms_pixels));
    estimates.truncate(2);
    estimates
}

/// Pose of a square of sides `size` from its corners in focal lengths from the principal point.
fn from_homography(corners: [[f64; 2]; 4], size: f64) -> Option<Pose> {
    let (across, down, constant) = homography(corners)?;
    let middle = constant + 0.5 * (across + down);
    // x = (u - 1/2) size, y = (1/2 - v) size.
    let (x, y) = (across / size, -down / size);
    let scale = 2.0 / (x.length() + y.length()) * middle.z.signum();
    let (x, y, middle) = (x * scale, y * scale, middle * scale);
    let (rotation, _) = nearest_rotation(DMat3::from_cols(x, y, x.cross(y)))?;
    (rotation.is_finite() && middle.is_finite()).then(|| Pose::from_matrix(rotation, middle))
}

/// The other pose under which a small square looks nearly the same: its normal mirrored at the line of sight (Schweighofer and Pinz
/// 2006).
fn mirrored_pose(pose: &Pose) -> Pose {
    let rotation = pose.matrix();
    let sight = DVec3::from_array(pose.translation).normalize_or(DVec3::Z);
    let normal = rotation.z_axis;
    let mirrored = 2.0 * sight.dot(normal) * sight - normal;
    let turn = glam::DQuat::from_rotation_arc(normal.normalize_or(DVec3::Z), mirrored.normalize_or(DVec3::Z));
    Pose::from_matrix(DMat3::from_quat(turn) * rotation, pose.translation.into())
}
