//! Placement of the object: local to world to rig to camera, see [the chain of frames](super).

use crate::error::{Error, Result};
use crate::marker::Pose;
use crate::mesh::Mesh;
use crate::relight::Ground;
use crate::views::Camera;
use glam::{DMat3, DQuat, DVec3};

/// Position of the world's ground relative to the rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RigMount {
    /// The markers lie on the ground: the world's +Y is the rig's z, its +X the rig's x, its +Z points to the print's lower edge.
    #[default]
    OnMarker,
    /// The markers stand upright: the world's axes are the rig's.
    BesideMarker,
}

impl RigMount {
    /// World to rig.
    pub fn rig_of_world(self) -> Pose {
        match self {
            RigMount::OnMarker => {
                Pose { rotation: [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], translation: [0.0; 3] }
            }
            RigMount::BesideMarker => Pose::IDENTITY,
        }
    }
}

/// An object in the world: `x_world = scale * rotation * x_local + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Local to world axes, rows.
    pub rotation: [[f64; 3]; 3],
    /// Length of a local unit in the rig's.
    pub scale: f64,
    /// The local origin in the world.
    pub translation: [f64; 3],
    /// Height of the ground in the world.
    pub ground: f64,
}

impl Placement {
    /// Puts the mesh with its lowest vertex on the ground at the height of `at`, the middle of its box above `at`.
    ///
    /// `upright` brings what is up in it to +Y first ([`crate::View::upright_rotation`]), then it is turned about +Y by `turn_degrees`, counter-clockwise
    /// seen from above.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a mesh without vertices, numbers that are not finite, or a scale of 0 or less.
    pub fn on_ground(
        mesh: &Mesh,
        upright: Option<[f32; 4]>,
        turn_degrees: f64,
        scale: f64,
        at: [f64; 3],
    ) -> Result<Self> {
        if mesh.positions.is_empty() {
            return Err(Error::parameter("the object has no mesh to place"));
        }
        if !(scale.is_finite() && scale > 0.0 && turn_degrees.is_finite() && at.iter().all(|x| x.is_finite())) {
            return Err(Error::parameter("an object is placed at finite numbers, its scale is above 0"));
        }
        let upright = upright.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.map(f64::from)).normalize());
        let rotation = DMat3::from_quat(DQuat::from_rotation_y(turn_degrees.to_radians()) * upright);
        let points = mesh.positions.iter().map(|p| rotation * DVec3::from_array(p.map(f64::from)));
        let (low, high) = points.fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
        let foot = DVec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z));
        let translation = DVec3::from_array(at) - scale * foot;
        let (rotation, translation) = (rotation.transpose().to_cols_array_2d(), translation.to_array());
        Ok(Placement { rotation, scale, translation, ground: at[1] })
    }

    fn matrix(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&self.rotation).transpose()
    }

    /// A point of the object in the world.
    pub fn point_to_world(&self, point: [f64; 3]) -> [f64; 3] {
        (self.matrix() * DVec3::from_array(point) * self.scale + DVec3::from_array(self.translation)).to_array()
    }

    /// A direction of the object in world axes.
    pub fn to_world(&self, direction: [f64; 3]) -> [f64; 3] {
        (self.matrix() * DVec3::from_array(direction)).to_array()
    }

    /// A direction of the world in the object's axes.
    pub fn to_local(&self, direction: [f64; 3]) -> [f64; 3] {
        (self.matrix().transpose() * DVec3::from_array(direction)).to_array()
    }

    /// The world's ground in the object's coordinates.
    pub fn ground(&self) -> Ground {
        let back = self.matrix().transpose();
        Ground {
            point: (back * ((DVec3::Y * self.ground - DVec3::from_array(self.translation)) / self.scale)).to_array(),
            up: (back * DVec3::Y).to_array(),
        }
    }

    /// The camera that sees the object as the chain says: `camera_of_rig * rig_of_world * world_of_local`, divided by the scale, which
    /// projects to the same pixels.
    pub fn camera(&self, intrinsics: &Camera, camera_of_rig: &Pose, rig_of_world: &Pose) -> Camera {
        let camera_of_world = camera_of_rig.compose(rig_of_world);
        let rotation = camera_of_world.matrix() * self.matrix();
        let translation = DVec3::from_array(camera_of_world.transform_point(self.translation)) / self.scale;
        let Pose { rotation, translation } = Pose::from_matrix(rotation, translation);
        Camera { rotation, translation, ..*intrinsics }
    }
}
