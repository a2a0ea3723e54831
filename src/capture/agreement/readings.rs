//! Other readings of a capture, under which mesh and photographs would agree: the usual mistakes, each as another camera.

use crate::views::Camera;
use glam::{DMat3, DVec3};

/// Units of length in each other: metric ones, inches and feet.
const UNITS: [f64; 10] = [1000.0, 100.0, 10.0, 0.1, 0.01, 0.001, 39.370_078_74, 0.0254, 3.280_839_9, 0.3048];
/// Sizes of pictures that focal lengths and principal points may have been written for, over the pictures' own.
const SIZES: [f64; 4] = [0.25, 0.5, 2.0, 4.0];
/// Factors of a wrong focal length that are tried, before the best one is looked for between them.
const FOCALS: [f64; 8] = [0.5, 0.65, 0.8, 0.9, 1.1, 1.25, 1.5, 2.0];

/// A camera instead of another.
pub(super) type Change = Box<dyn Fn(&Camera) -> Camera + Sync>;

/// A mistake and the camera that a view has without it. A mesh that is scaled or turned is seen as by a camera that is moved or turned.
pub(super) struct Reading {
    /// The fault and its remedy.
    pub(super) sentence: String,
    pub(super) camera: Change,
}

/// All readings but those of the focal length, the likeliest first.
pub(super) fn readings() -> Vec<Reading> {
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
    for turn in turns().into_iter().filter(|turn| *turn != DMat3::IDENTITY) {
        all.push(turned(
            turn,
            "the mesh's axes are not the cameras' (is up y or z? was it made before an applied_transform?)",
        ));
    }
    all.extend(pictures());
    all.extend(turns().into_iter().map(|turn| turned(-turn, "the mesh is mirrored")));
    all
}

/// Focal lengths that are tried, over those that are given.
pub(super) fn focal_factors() -> [f64; 8] {
    FOCALS
}

/// The reading of focal lengths that are to be multiplied by a factor.
pub(super) fn focal(factor: f64) -> Reading {
    Reading {
        sentence: format!(
            "the focal lengths are not those of the photographs (or the mesh's scale is not the cameras'): about {factor:.2} times them fits; \
             correct fl_x and fl_y"
        ),
        camera: Box::new(move |camera| Camera { focal: camera.focal.map(|focal| focal * factor), ..*camera }),
    }
}

fn rotation(camera: &Camera) -> DMat3 {
    DMat3::from_cols_array_2d(&camera.rotation).transpose()
}

fn turned(turn: DMat3, fault: &str) -> Reading {
    // Without zeros below zero.
    let [x, y, z] = turn.transpose().to_cols_array_2d().map(|row| row.map(|value| value + 0.0));
    let rows = [x, y, z].map(|row| format!("[{}, {}, {}, 0]", row[0], row[1], row[2])).join(", ");
    Reading {
        sentence: format!("{fault}; set its pose to [{rows}, [0, 0, 0, 1]]"),
        camera: Box::new(move |camera| {
            let rotation = (rotation(camera) * turn).transpose();
            Camera { rotation: rotation.to_cols_array_2d(), ..*camera }
        }),
    }
}

/// The 24 turns by right angles, the first of which is none.
fn turns() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let signed: Vec<DVec3> = axes.iter().flat_map(|&axis| [axis, -axis]).collect();
    let pairs = signed.iter().flat_map(|&x| signed.iter().map(move |&y| (x, y))).filter(|(x, y)| x.dot(*y) == 0.0);
    pairs.map(|(x, y)| DMat3::from_cols(x, y, x.cross(y))).collect()
}

/// Mistakes of what belongs to the picture: its principal point, its size, the way that it is turned.
fn pictures() -> Vec<Reading> {
    let reading = |sentence: &str, camera: Change| Reading { sentence: sentence.into(), camera };
    // The middle of a picture lies between pixels, the same from either side.
    fn flipped(camera: &Camera, axes: [bool; 2]) -> Camera {
        let mut flipped = *camera;
        for axis in (0..2).filter(|&axis| axes[axis]) {
            let side = f64::from([camera.width, camera.height][axis]);
            flipped.principal[axis] = side - camera.principal[axis];
            flipped.rotation[axis] = camera.rotation[axis].map(|value| -value);
            flipped.translation[axis] = -camera.translation[axis];
        }
        flipped
    }
    let mut all = vec![
        reading(
            "the principal point's coordinates are exchanged; exchange cx and cy",
            // In pixels of the small picture, whose sides are of one scale.
            Box::new(|camera| Camera { principal: [camera.principal[1], camera.principal[0]], ..*camera }),
        ),
        reading(
            "the principal point is not the photographs'; the middle of the picture fits",
            Box::new(|camera| Camera {
                principal: [camera.width, camera.height].map(|side| 0.5 * f64::from(side)),
                ..*camera
            }),
        ),
        reading(
            "the photographs and masks are upside down beside their cameras; turn them",
            Box::new(|camera| flipped(camera, [true, true])),
        ),
        reading(
            "the photographs and masks are mirrored; mirror them",
            Box::new(|camera| flipped(camera, [true, false])),
        ),
        reading(
            "the photographs and masks are upside down and mirrored; mirror them from top to bottom",
            Box::new(|camera| flipped(camera, [false, true])),
        ),
    ];
    all.extend(SIZES.map(|size| Reading {
        sentence: format!(
            "focal lengths and principal point are those of pictures of {} times the size; multiply them by {size}",
            1.0 / size
        ),
        camera: Box::new(move |camera: &Camera| Camera {
            focal: camera.focal.map(|value| value * size),
            principal: camera.principal.map(|value| value * size),
            ..*camera
        }),
    }));
    all
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
