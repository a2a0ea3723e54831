//! Other readings of a capture, under which mesh and masks would agree: the usual mistakes, each as another camera.

use super::Cause;
use super::silhouette::{count, iou};
use crate::mesh::Mesh;
use crate::parallel;
use crate::views::Camera;
use glam::{DMat3, DVec3};

/// Another reading of the capture is named where it comes to this intersection over union, and is so much better than what is there.
const CONVINCING: f64 = 0.6;
const BETTER: f64 = 0.25;
/// A later reading takes the place of an earlier one where it is so much better.
const CLEARER: f64 = 0.02;
/// Units of length in each other: metric ones, inches and feet.
const UNITS: [f64; 10] = [1000.0, 100.0, 10.0, 0.1, 0.01, 0.001, 39.370_078_74, 0.0254, 3.280_839_9, 0.3048];

/// A mistake and the camera that a view has without it. A mesh that is scaled or turned is seen as by a camera that is moved or turned.
struct Reading {
    /// The fault and its remedy.
    sentence: String,
    camera: Box<dyn Fn(&Camera) -> Camera + Sync>,
}

/// Returns the mistake without which mesh and masks agree best, if they then do.
pub(super) fn explain(mesh: &Mesh, views: &[(Camera, Vec<bool>)]) -> Option<Cause> {
    let mean = |camera: &(dyn Fn(&Camera) -> Camera + Sync), inverted: bool| {
        let one = |k: usize| {
            let (there, mask) = &views[k];
            let mask: Vec<bool> = mask.iter().map(|shown| shown ^ inverted).collect();
            iou(&count(mesh, &camera(there), Some(&mask)))
        };
        parallel::map(views.len(), one).iter().sum::<f64>() / views.len().max(1) as f64
    };
    let there = mean(&|camera| *camera, false);
    let mut best: Option<Cause> = None;
    let mut take = |silhouette_iou: f64, sentence: String| {
        let least = best.as_ref().map_or(CONVINCING.max(there + BETTER), |best| best.silhouette_iou + CLEARER);
        if silhouette_iou >= least {
            best = Some(Cause { sentence, silhouette_iou });
        }
    };
    let inverted = "the masks are inverted: they show the background; set invert_masks";
    take(mean(&|camera| *camera, true), inverted.into());
    for Reading { sentence, camera } in readings() {
        take(mean(&camera, false), sentence);
    }
    best
}

fn readings() -> Vec<Reading> {
    let mut all = Vec::new();
    for factor in UNITS {
        let sentence = format!("the mesh is in another unit than the cameras; set mesh_scale to {factor}");
        let camera = move |camera: &Camera| Camera { translation: camera.translation.map(|t| t / factor), ..*camera };
        all.push(Reading { sentence, camera: Box::new(camera) });
    }
    for (name, camera) in conventions() {
        let sentence = format!("the cameras' poses are {name}; write them as the format asks for");
        all.push(Reading { sentence, camera: Box::new(camera) });
    }
    for turn in turns() {
        // Without zeros below zero.
        let [x, y, z] = turn.transpose().to_cols_array_2d().map(|row| row.map(|value| value + 0.0));
        let rows = [x, y, z].map(|row| format!("[{}, {}, {}, 0]", row[0], row[1], row[2])).join(", ");
        let sentence =
            format!("the mesh's axes are not the cameras' (is up y or z?); set its pose to [{rows}, [0, 0, 0, 1]]");
        let camera = move |camera: &Camera| {
            let rotation = (rotation(camera) * turn).transpose();
            Camera { rotation: rotation.to_cols_array_2d(), ..*camera }
        };
        all.push(Reading { sentence, camera: Box::new(camera) });
    }
    all
}

fn rotation(camera: &Camera) -> DMat3 {
    DMat3::from_cols_array_2d(&camera.rotation).transpose()
}

/// The 23 turns by right angles.
fn turns() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let signed: Vec<DVec3> = axes.iter().flat_map(|&axis| [axis, -axis]).collect();
    let pairs = signed.iter().flat_map(|&x| signed.iter().map(move |&y| (x, y))).filter(|(x, y)| x.dot(*y) == 0.0);
    pairs.map(|(x, y)| DMat3::from_cols(x, y, x.cross(y))).filter(|turn| *turn != DMat3::IDENTITY).collect()
}

/// Poses as the numbers of the file would give them under other conventions than the one they were read by.
fn conventions() -> [(&'static str, fn(&Camera) -> Camera); 5] {
    // What the file has, if it was read as camera to world in OpenGL's axes: columns of the rotation, and the centre.
    fn written(camera: &Camera) -> (DMat3, DVec3) {
        let rows = camera.rotation.map(DVec3::from_array);
        (DMat3::from_cols(rows[0], -rows[1], -rows[2]), DVec3::from_array(camera.centre()))
    }
    fn posed(camera: &Camera, to_camera: DMat3, translation: DVec3) -> Camera {
        let rows = to_camera.transpose();
        let rotation = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.to_array());
        Camera { rotation, translation: translation.to_array(), ..*camera }
    }
    const FLIP: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    [
        ("camera to world in OpenCV's axes (y down, z forward), not in OpenGL's", |camera| {
            let (matrix, centre) = written(camera);
            let to_camera = matrix.transpose();
            posed(camera, to_camera, -(to_camera * centre))
        }),
        ("world to camera, not camera to world", |camera| {
            let (matrix, translation) = written(camera);
            posed(camera, FLIP * matrix, FLIP * translation)
        }),
        ("world to camera in OpenCV's axes (y down, z forward), not camera to world", |camera| {
            let (matrix, translation) = written(camera);
            posed(camera, matrix, translation)
        }),
        ("camera to world, not world to camera", |camera| {
            let rows = camera.rotation.map(DVec3::from_array);
            // The rows that were read are those of the rotation to the world.
            let to_camera = DMat3::from_cols(rows[0], rows[1], rows[2]);
            posed(camera, to_camera, -(to_camera * DVec3::from_array(camera.translation)))
        }),
        ("world to camera in OpenGL's axes (y up, z back), not in OpenCV's", |camera| {
            let rows = camera.rotation.map(DVec3::from_array);
            let to_camera = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            posed(camera, FLIP * to_camera, FLIP * DVec3::from_array(camera.translation))
        }),
    ]
}
