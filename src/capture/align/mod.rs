//! Registering a mesh to photographs by points seen in both: the direct linear transform, then Levenberg-Marquardt on the
//! reprojection error.
//!
//! The points are a JSON file:
//! ```json
//! {"points": [
//!   {"frame": "off/000.exr", "pixel": [61.5, 40.25], "mesh": [0.12, 0.80, -0.31]},
//!   {"frame": "off/009.exr", "pixel": [70.0, 38.5], "mesh": [0.12, 0.80, -0.31]}
//! ]}
//! ```
//! `frame` names a photograph of the capture (its `file_path`, or the file name alone where that is unique); `pixel` is its
//! position in the photograph as it is stored, lens distortion and all, x to the right and y down from the upper left corner,
//! pixel centres at .5; `mesh` is the point in the mesh file's coordinates. One mesh point may stand in several frames.
//! Six points in one frame that are not in one plane are enough, or three points marked in two frames each; more, spread over
//! the object and over several frames, are better.

pub(crate) mod refine;
pub(crate) mod start;

use super::description::CaptureDescription;
use super::json::{JsonDocument, JsonNode};
use crate::error::{Error, Result};
use crate::input::{FileAccess, quoted};
use crate::mesh::Mesh;
use crate::views::Camera;
use std::collections::HashMap;
use std::ffi::OsStr;
use std::path::Path;

/// Fewest correspondences that determine a pose linearly.
pub(crate) const MIN_POINTS: usize = 6;
/// Most correspondences that a file may hold; people mark some dozens.
const MAX_POINTS: usize = 4096;

/// A mesh point and where one frame shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// Index of the frame, or of the camera given to [`align`].
    pub frame: usize,
    /// Image position in pixels of the pinhole camera, that is with lens distortion removed.
    pub pixel: [f64; 2],
    /// Position in the mesh's own coordinates.
    pub mesh: [f64; 3],
}

/// Pose of the mesh in the capture's world, and its errors.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Mesh to world, rows: rotation times scale, and translation.
    pub pose: [[f64; 4]; 4],
    /// The scale in it; 1 unless asked for.
    pub scale: f64,
    /// Root mean square distance between marked and projected points, in pixels.
    pub rms_pixels: f64,
    /// Largest such distance.
    pub max_pixels: f64,
    /// The distance of each correspondence, in the given order.
    pub errors_pixels: Vec<f64>,
}

/// Rotation, translation and scale of the mesh in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Similarity {
    pub(crate) rotation: glam::DMat3,
    pub(crate) translation: glam::DVec3,
    pub(crate) scale: f64,
}

impl Similarity {
    fn transform(&self, p: glam::DVec3) -> glam::DVec3 {
        self.rotation * p * self.scale + self.translation
    }
}

/// Reads a points file and takes the lens distortion off its image positions.
pub fn read_correspondences(
    path: impl AsRef<Path>,
    description: &CaptureDescription,
    access: &FileAccess,
) -> Result<Vec<Correspondence>> {
    let document = JsonDocument::read(path.as_ref(), access)?;
    let mut correspondences = Vec::new();
    let frames = FrameNames::from_description(description);
    for point in document.root().required("points")?.items(MAX_POINTS)? {
        let node = point.required("frame")?;
        let frame = frames.find(&node)?;
        let described = &description.frames[frame];
        let camera = &described.view.camera;
        let pixel_node = point.required("pixel")?;
        let pixel = pixel_node.numbers::<2>()?;
        if !(0.0..=camera.width as f64).contains(&pixel[0]) || !(0.0..=camera.height as f64).contains(&pixel[1]) {
            return Err(pixel_node.error(format!("outside the picture of {} x {} pixels", camera.width, camera.height)));
        }
        let bent =
            [(pixel[0] - camera.principal[0]) / camera.focal[0], (pixel[1] - camera.principal[1]) / camera.focal[1]];
        let Some(ideal) = described.lens.undistort(bent) else {
            return Err(pixel_node.error("the lens model has no ray for this position"));
        };
        let pixel =
            [ideal[0] * camera.focal[0] + camera.principal[0], ideal[1] * camera.focal[1] + camera.principal[1]];
        correspondences.push(Correspondence { frame, pixel, mesh: point.required("mesh")?.numbers()? });
    }
    Ok(correspondences)
}

/// The frames of a capture by their names, and by their files' alone.
struct FrameNames<'a> {
    whole: HashMap<&'a str, usize>,
    /// `None` where several frames have it.
    file: HashMap<&'a OsStr, Option<usize>>,
}

impl<'a> FrameNames<'a> {
    fn from_description(description: &'a CaptureDescription) -> Self {
        let mut names = FrameNames { whole: HashMap::new(), file: HashMap::new() };
        for (index, frame) in description.frames.iter().enumerate() {
            let name = frame.view.name.as_str();
            names.whole.entry(name).or_insert(index);
            if let Some(file) = Path::new(name).file_name() {
                names.file.entry(file).and_modify(|only| *only = None).or_insert(Some(index));
            }
        }
        names
    }

    fn find(&self, node: &JsonNode) -> Result<usize> {
        let name = node.text()?.trim_start_matches("./");
        if let Some(&index) = self.whole.get(name) {
            return Ok(index);
        }
        let file = Path::new(name).file_name().filter(|_| !name.contains('/')).and_then(|file| self.file.get(file));
        match file {
            Some(Some(index)) => Ok(*index),
            Some(None) => Err(node.error(format!("several frames are called {}: give the whole path", quoted(name)))),
            None => Err(node.error(format!("the capture has no frame {}", quoted(name)))),
        }
    }
}

/// Finds the pose of the mesh from correspondences with known cameras; with `with_scale` also its scale, which needs points in
/// two frames at least.
///
/// Linear starts, from each frame with six points or more and from points marked in several frames, are refined by
/// Levenberg-Marquardt on the reprojection error; the best is taken. Too few, collinear or coplanar points are an error.
pub fn align(cameras: &[Camera], correspondences: &[Correspondence], with_scale: bool) -> Result<Alignment> {
    if correspondences.len() < MIN_POINTS {
        return Err(Error::parameter(format!(
            "{} points are given, {MIN_POINTS} at least are needed: mark more",
            correspondences.len()
        )));
    }
    if let Some(point) = correspondences.iter().find(|c| c.frame >= cameras.len()) {
        return Err(Error::parameter(format!("a point names frame {}, there are {}", point.frame, cameras.len())));
    }
    let one_frame = correspondences.iter().all(|c| c.frame == correspondences[0].frame);
    if with_scale && one_frame {
        return Err(Error::parameter(
            "one photograph can't tell a large mesh far away from a small one near by: mark points in a second frame, or leave \
             the scale out",
        ));
    }
    let mut best: Option<(f64, Similarity)> = None;
    for start in start::candidates(cameras, correspondences, with_scale)? {
        let Some((cost, refined)) = refine::refine(cameras, correspondences, start, with_scale) else { continue };
        if best.is_none_or(|(lowest, _)| cost < lowest) {
            best = Some((cost, refined));
        }
    }
    let Some((_, best)) = best else {
        return Err(Error::parameter(
            "no pose puts all points in front of their cameras: check that pixels and mesh points belong together and that the \
             mesh is not mirrored",
        ));
    };
    let errors = refine::reprojection_errors(cameras, correspondences, &best).unwrap_or_default();
    let (r, t) = (best.rotation.transpose().to_cols_array_2d(), best.translation.to_array());
    let row = |i: usize| [r[i][0] * best.scale, r[i][1] * best.scale, r[i][2] * best.scale, t[i]];
    Ok(Alignment {
        pose: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        scale: best.scale,
        rms_pixels: (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt(),
        max_pixels: errors.iter().copied().fold(0.0, f64::max),
        errors_pixels: errors,
    })
}

/// Moves a mesh by a 4 x 4 matrix (rows) from its coordinates to the world. A mirroring one also turns the triangles around.
pub fn apply_pose(mesh: &mut Mesh, pose: &[[f64; 4]; 4]) {
    for position in &mut mesh.positions {
        *position = moved_point(pose, position.map(f64::from)).map(|c| c as f32);
    }
    if is_mirroring(pose) {
        mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
}

pub(super) fn moved_point(pose: &[[f64; 4]; 4], p: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| pose[i][0] * p[0] + pose[i][1] * p[1] + pose[i][2] * p[2] + pose[i][3])
}

pub(super) fn is_mirroring(pose: &[[f64; 4]; 4]) -> bool {
    let linear: [[f64; 3]; 3] = std::array::from_fn(|i| [pose[i][0], pose[i][1], pose[i][2]]);
    glam::DMat3::from_cols_array_2d(&linear).determinant() < 0.0
}

#[cfg(test)]
mod tests;
