//! Camera poses from printed markers in its images. See `spec/placing.md`.
//!
//! # The chain of frames
//!
//! Every point goes the same way, `x_camera = camera_of_rig * rig_of_world * world_of_local * x_local`:
//!
//! - **local**: the mesh's own coordinates, any unit.
//! - **world**: +Y up, the ground level, at y = 0 unless the object is put elsewhere; in the rig's unit. Environments are given in these axes.
//!   `world_of_local` ([`crate::ar::placement::Placement`]) turns, scales and shifts the object.
//! - **rig**: the markers' common frame, in the unit in which their sizes are given. A single marker's own frame: origin in its middle,
//!   x to the right and y upwards on the print, z out of the paper towards whoever looks at it. `rig_of_world` ([`crate::ar::placement::RigMount`])
//!   says how the world's ground lies to it.
//! - **camera**: x to the right, y down, z forward, as in [`crate::views::Camera`]; `camera_of_rig` is the [`Pose`] found here.

mod aruco;
pub(crate) mod detect;
pub(crate) mod detection;
mod dictionary;
mod homography;
mod pattern;
mod pose;
mod rig;
mod squares;
pub(crate) mod track;

pub use detect::MarkerDetector;
pub use detection::MarkerDetection;
pub use dictionary::ArucoDictionary;
pub use pattern::MarkerPattern;
pub use pose::{PoseEstimate, estimate_poses};
pub use rig::{Rig, RigMarker};

pub use track::MarkerTracker;

use crate::error::{Error, Result};
use glam::{DMat3, DVec3};

/// Printed codes that can be told apart. Sizes are those of the black border's outer edge (of the border between black and white for
/// [`MarkerFamily::Standard41h12`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MarkerFamily {
    /// AprilTag 36h11.
    Tag36h11,
    /// AprilTag 25h9.
    Tag25h9,
    /// AprilTag 16h5; few bits, easily found where there is none.
    Tag16h5,
    /// AprilTag 3 standard, 41h12.
    Standard41h12,
    /// The original ArUco dictionary, 5 x 5 bits.
    Aruco,
    /// ArUco MIP 36h12.
    ArucoMip36h12,
    /// OpenCV's ArUco dictionaries of 4 x 4 to 7 x 7 bits.
    ArucoOpenCv(ArucoDictionary),
    /// ARToolKit's squares with a picture, each found by its [`MarkerPattern`].
    ArToolKit,
    /// ARToolKit's barcodes of 3 x 3 cells without error correction; few bits, easily found where there is none.
    ArToolKitBarcode,
}

const fn opencv(side: u8, count: u16) -> MarkerFamily {
    MarkerFamily::ArucoOpenCv(ArucoDictionary::new(side, count))
}

impl MarkerFamily {
    /// All families with the names that they go by.
    pub const NAMES: [(MarkerFamily, &'static str); 24] = [
        (MarkerFamily::Tag36h11, "tag36h11"),
        (MarkerFamily::Tag25h9, "tag25h9"),
        (MarkerFamily::Tag16h5, "tag16h5"),
        (MarkerFamily::Standard41h12, "tagStandard41h12"),
        (MarkerFamily::Aruco, "aruco"),
        (MarkerFamily::ArucoMip36h12, "aruco-mip-36h12"),
        (opencv(4, 50), "aruco-4x4-50"),
        (opencv(4, 100), "aruco-4x4-100"),
        (opencv(4, 250), "aruco-4x4-250"),
        (opencv(4, 1000), "aruco-4x4-1000"),
        (opencv(5, 50), "aruco-5x5-50"),
        (opencv(5, 100), "aruco-5x5-100"),
        (opencv(5, 250), "aruco-5x5-250"),
        (opencv(5, 1000), "aruco-5x5-1000"),
        (opencv(6, 50), "aruco-6x6-50"),
        (opencv(6, 100), "aruco-6x6-100"),
        (opencv(6, 250), "aruco-6x6-250"),
        (opencv(6, 1000), "aruco-6x6-1000"),
        (opencv(7, 50), "aruco-7x7-50"),
        (opencv(7, 100), "aruco-7x7-100"),
        (opencv(7, 250), "aruco-7x7-250"),
        (opencv(7, 1000), "aruco-7x7-1000"),
        (MarkerFamily::ArToolKit, "artoolkit"),
        (MarkerFamily::ArToolKitBarcode, "artoolkit-3x3"),
    ];

    /// Returns the family of a name, capital letters or small, or of OpenCV's for it (`DICT_6X6_250`).
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for an unknown name, [`Error::Unsupported`] for ARToolKit's barcodes of other kinds.
    pub fn from_name(name: &str) -> Result<Self> {
        let plain = name.to_ascii_lowercase().replace('_', "-");
        if plain.starts_with("artoolkit-") && plain != "artoolkit-3x3" {
            let message = "ARToolKit's barcodes (matrix codes) of other kinds than 3 x 3 cells without error correction (artoolkit-3x3)";
            return Err(Error::Unsupported(message.into()));
        }
        let plain = match plain.strip_prefix("dict-") {
            Some("aruco-original") => "aruco".into(),
            Some("aruco-mip-36h12") => "aruco-mip-36h12".into(),
            Some(tag) if tag.starts_with("apriltag-") => tag.replace("apriltag-", "tag"),
            Some(size) => format!("aruco-{size}"),
            None => plain,
        };
        let found = MarkerFamily::NAMES.iter().find(|(_, known)| known.eq_ignore_ascii_case(&plain));
        let known: Vec<&str> = MarkerFamily::NAMES.iter().map(|(_, name)| *name).collect();
        let unknown = || Error::parameter(format!("no marker family \"{name}\"; known: {}", known.join(", ")));
        found.map(|(family, _)| *family).ok_or_else(unknown)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        MarkerFamily::NAMES.iter().find(|(family, _)| *family == self).map_or("", |(_, name)| name)
    }
}

/// A rigid motion: `rotation * x + translation`, rotation by rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation, rows.
    pub rotation: [[f64; 3]; 3],
    /// Translation.
    pub translation: [f64; 3],
}

impl Pose {
    /// Nothing moves.
    pub const IDENTITY: Pose =
        Pose { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation: [0.0; 3] };

    /// A point moved.
    pub fn transform_point(&self, x: [f64; 3]) -> [f64; 3] {
        (self.matrix() * DVec3::from_array(x) + DVec3::from_array(self.translation)).to_array()
    }

    /// First `inner`, then this.
    pub fn compose(&self, inner: &Pose) -> Pose {
        Pose::from_matrix(
            self.matrix() * inner.matrix(),
            self.matrix() * DVec3::from_array(inner.translation) + DVec3::from_array(self.translation),
        )
    }

    /// The motion back.
    pub fn inverse(&self) -> Pose {
        let back = self.matrix().transpose();
        Pose::from_matrix(back, -(back * DVec3::from_array(self.translation)))
    }

    /// Angle of the rotation that leads from one pose's to the other's, radians.
    pub fn angle_to(&self, other: &Pose) -> f64 {
        let between = self.matrix().transpose() * other.matrix();
        let columns = [between.x_axis, between.y_axis, between.z_axis];
        let trace = columns[0].x + columns[1].y + columns[2].z;
        let skew =
            DVec3::new(columns[1].z - columns[2].y, columns[2].x - columns[0].z, columns[0].y - columns[1].x).length();
        skew.atan2(trace - 1.0)
    }

    pub(crate) fn from_matrix(rotation: DMat3, translation: DVec3) -> Pose {
        Pose { rotation: rotation.transpose().to_cols_array_2d(), translation: translation.to_array() }
    }

    pub(crate) fn matrix(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&self.rotation).transpose()
    }
}
