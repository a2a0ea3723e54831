//! Captures described by `transforms.json`: nerfstudio's keys and our own for polarised photographs, lights and the white board.

use super::description::{
    CaptureDescription, FrameDescription, WhiteReference, camera_fault, capture_folder, folder_name,
};
use super::json::{JsonDocument, JsonNode};
use super::lens::Lens;
use super::photograph::{ExposureTimes, PhotographFiles, find_image, first_name, read_photograph};
use super::view_names::view_names;
use crate::error::Result;
use crate::image::Region;
use crate::image::read::read_size;
use crate::input::{FileAccess, Folder, escaped, quoted};
use crate::views::{Camera, PointLight, View};
use std::collections::BTreeSet;
use std::path::Path;

pub(super) fn describe(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let document = JsonDocument::read(path, access)?;
    let root = document.root();
    let folder = Folder::new(capture_folder(path), path, access.allows_outside());
    let mut lights = LightWarnings::default();
    let mut frames = Vec::new();
    let list = root.required("frames")?.items(access.budget().limits().views as usize)?;
    let paths: Vec<&str> = list.iter().map(first_name).collect::<Result<_>>()?;
    let names = view_names(&folder, &paths);
    let mut times = ExposureTimes::default();
    for (frame, name) in list.iter().zip(names) {
        let photograph = read_photograph(&root, frame, &folder, &mut times)?;
        frames.push(read_frame(&root, frame, name, photograph, &folder, access, &mut lights)?);
    }
    let file = |node: &JsonNode| folder.resolve(node.text()?);
    let white_reference = match root.get("white_reference") {
        Some(node) => Some(WhiteReference { photograph: read_photograph(&root, &node, &folder, &mut times)? }),
        None => None,
    };
    times.check(&root)?;
    Ok(CaptureDescription {
        path: path.to_owned(),
        name: folder_name(folder.path()),
        frames,
        mesh_file: root.optional("mesh_file", file)?,
        mesh_pose: root.optional("mesh_transform", JsonNode::matrix)?,
        white_reference,
        color_space: root.optional("color_space", |node| Ok(node.text()?.to_owned()))?,
        warnings: lights.sentences().into_iter().chain(unused_transform(&root)).collect(),
    })
}

/// nerfstudio writes by which transform the cameras were moved away from where they were found; a mesh made before that is not with them.
fn unused_transform(root: &JsonNode) -> Option<String> {
    let node = root.get("applied_transform")?;
    let rows = node.items(4).ok()?;
    let is_identity = rows.iter().enumerate().all(|(row, values)| {
        values.numbers::<4>().is_ok_and(|values| {
            let unit: [f64; 4] = std::array::from_fn(|column| f64::from(u8::from(row == column)));
            values == unit
        })
    });
    (!is_identity).then(|| {
        "the key \"applied_transform\" is not used: a mesh that was made before it was applied to the cameras needs it as mesh_transform".into()
    })
}

fn read_frame(
    root: &JsonNode,
    frame: &JsonNode,
    name: String,
    photograph: PhotographFiles,
    folder: &Folder,
    access: &FileAccess,
    lights: &mut LightWarnings,
) -> Result<FrameDescription> {
    let (mut camera, lens) = read_intrinsics(root, frame, Some((photograph.first(), access)))?;
    (camera.rotation, camera.translation) = read_pose(&frame.required("transform_matrix")?)?;
    if let Some(fault) = camera_fault(&camera) {
        return Err(frame.error(format!("the camera has {fault}")));
    }
    let light = read_light(root, frame, lights)?;
    Ok(FrameDescription {
        photograph,
        board: frame
            .get("white_region")
            .or_else(|| root.get("white_region"))
            .map(|node| read_region(&node))
            .transpose()?,
        mask: frame.optional("mask_path", |node| find_image(folder, node.text()?))?,
        lens,
        view: View { name, camera, light },
    })
}

/// Left, top, width and height.
fn read_region(node: &JsonNode) -> Result<Region> {
    let sides = node.items(4)?.iter().map(JsonNode::count).collect::<Result<Vec<_>>>()?;
    match sides[..] {
        [left, top, width, height] if width > 0 && height > 0 => Ok(Region { left, top, width, height }),
        _ => Err(node.error("a region is told by its left, top, width and height, in pixels")),
    }
}

/// Camera and lens from the frame's own keys, else the capture's. Needed: `w`, `h`, `fl_x` (or `camera_angle_x`); where a photograph is given,
/// `w` and `h` may be left to it.
pub(super) fn read_intrinsics(
    root: &JsonNode,
    frame: &JsonNode,
    photograph: Option<(&Path, &FileAccess)>,
) -> Result<(Camera, Lens)> {
    let find = |key: &str| frame.get(key).or_else(|| root.get(key));
    let number = |key: &str| find(key).map(|node| node.number()).transpose();
    let missing = |key: &str| frame.error(format!("key \"{key}\" is missing, here and at the top level"));
    let side = |key: &str| find(key).ok_or_else(|| missing(key))?.count();
    let (width, height) = match photograph {
        Some((path, access)) if find("w").is_none() && find("h").is_none() => read_size(path, access)?,
        _ => (side("w")?, side("h")?),
    };
    let from_angle = |angle: f64, side: u32| 0.5 * side as f64 / (0.5 * angle).tan();
    let focal_x = match (number("fl_x")?, number("camera_angle_x")?) {
        (Some(focal), _) => focal,
        (None, Some(angle)) => from_angle(angle, width),
        (None, None) => return Err(missing("fl_x")),
    };
    let focal_y = match (number("fl_y")?, number("camera_angle_y")?) {
        (Some(focal), _) => focal,
        (None, Some(angle)) => from_angle(angle, height),
        (None, None) => focal_x,
    };
    let principal = [number("cx")?.unwrap_or(0.5 * width as f64), number("cy")?.unwrap_or(0.5 * height as f64)];
    let camera = Camera { width, height, focal: [focal_x, focal_y], principal, ..Camera::default() };

    let coefficient = |key: &str| Ok::<f64, crate::Error>(number(key)?.unwrap_or(0.0));
    let radial = [coefficient("k1")?, coefficient("k2")?, coefficient("k3")?, coefficient("k4")?];
    let tangential = [coefficient("p1")?, coefficient("p2")?];
    let model = find("camera_model");
    let model_name = model.as_ref().map(|node| node.text()).transpose()?;
    let lens = match model_name {
        Some("PINHOLE" | "SIMPLE_PINHOLE") => Lens::Pinhole,
        Some("OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE") => Lens::Fisheye { coefficients: radial },
        None if find("is_fisheye").is_some_and(|node| node.is_true()) => Lens::Fisheye { coefficients: radial },
        Some("OPENCV" | "SIMPLE_RADIAL" | "RADIAL" | "PERSPECTIVE") | None => {
            Lens::Radial { numerator: radial, denominator: [0.0; 3], tangential, shear: 0.0 }
        }
        Some(other) => {
            let message = format!(
                "camera model {} is not supported; known: PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, \
                 OPENCV_FISHEYE",
                escaped(other)
            );
            return Err(model.map_or_else(|| frame.error(&message), |node| node.error(&message)));
        }
    };
    Ok((camera, if lens.is_pinhole() { Lens::Pinhole } else { lens }))
}

/// Camera to world with OpenGL's axes (x right, y up, z backward) into world to camera with OpenCV's.
fn read_pose(node: &JsonNode) -> Result<([[f64; 3]; 3], [f64; 3])> {
    let matrix = node.matrix()?;
    // Columns of camera to world are rows of world to camera; y and z change sides.
    let signs = [1.0, -1.0, -1.0];
    let rows: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| signs[i] * matrix[j][i]));
    let rotation = nearest_rotation(rows).map_err(|fault| node.error(fault))?;
    let centre = [matrix[0][3], matrix[1][3], matrix[2][3]];
    let translation = rotation.map(|row| -(row[0] * centre[0] + row[1] * centre[1] + row[2] * centre[2]));
    Ok((rotation, translation))
}

/// The rotation that a matrix written with few digits, or scaled as a whole, stands for.
pub(crate) fn nearest_rotation(rows: [[f64; 3]; 3]) -> std::result::Result<[[f64; 3]; 3], String> {
    let given = glam::DMat3::from_cols_array_2d(&rows).transpose();
    let determinant = given.determinant();
    if determinant.is_nan() || determinant <= 0.0 {
        return Err(format!(
            "the upper left 3 x 3 should be a rotation, its determinant is {determinant}: mirrored or singular axes"
        ));
    }
    let scaled = given * (1.0 / determinant.cbrt());
    let off = |m: glam::DMat3| {
        let gram = m * m.transpose() - glam::DMat3::IDENTITY;
        gram.to_cols_array().into_iter().fold(0.0, |worst: f64, v| worst.max(v.abs()))
    };
    if off(scaled) > 1e-3 {
        return Err(format!("the upper left 3 x 3 should be a rotation, it is off by {:.1e}", off(scaled)));
    }
    let mut rotation = if off(given) < 1e-12 { given } else { scaled };
    // Newton's iteration for the polar decomposition; quadratic, so few steps do.
    for _ in 0..8 {
        if off(rotation) < 1e-12 {
            break;
        }
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    Ok(rotation.transpose().to_cols_array_2d())
}

/// Warnings about lights, each given once for all frames.
#[derive(Default)]
struct LightWarnings {
    /// Types that are not points, the first few.
    types: BTreeSet<String>,
    /// Frames with yet other types.
    more: usize,
    without_intensity: bool,
}

impl LightWarnings {
    fn other_type(&mut self, name: &str) {
        let name = quoted(name);
        if self.types.len() < 8 || self.types.contains(&name) {
            self.types.insert(name);
        } else {
            self.more += 1;
        }
    }

    fn sentences(self) -> Vec<String> {
        let of_type = |name: &String| format!("light type {name} is not a point light: taken as unknown");
        let mut all: Vec<String> = self.types.iter().map(of_type).collect();
        if self.more > 0 {
            all.push(format!("the lights of {} frames are of yet other types: taken as unknown", self.more));
        }
        if self.without_intensity {
            all.push("the lights have a position but no intensity: taken as 1".into());
        }
        all
    }
}

/// The frame's point light: position and intensity from the frame's own keys, else the capture's.
fn read_light(root: &JsonNode, frame: &JsonNode, warnings: &mut LightWarnings) -> Result<Option<PointLight>> {
    let lights = [frame.get("light"), root.get("light")];
    let find = |key: &str| lights.iter().flatten().find_map(|light| light.get(key));
    if let Some(kind) = find("type")
        && kind.text()? != "point"
    {
        warnings.other_type(kind.text()?);
        return Ok(None);
    }
    let Some(position) = frame.get("light_position").or_else(|| find("position")) else {
        return Ok(None);
    };
    let position = position.numbers::<3>()?;
    let intensity = match frame.get("light_intensity").or_else(|| find("intensity")) {
        Some(node) if node.is_list() => node.numbers::<3>()?,
        Some(node) => [node.number()?; 3],
        None => {
            warnings.without_intensity = true;
            [1.0; 3]
        }
    };
    if intensity.iter().any(|&v| v < 0.0) {
        return Err(frame.error("the light's intensity is negative"));
    }
    Ok(Some(PointLight { position, intensity }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn describe_text(text: &str) -> Result<CaptureDescription> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        std::fs::write(&path, text).unwrap();
        describe(&path, &FileAccess::default())
    }

    const POSE: &str = "[[0, 0, 1, 5], [1, 0, 0, 6], [0, 1, 0, 7], [0, 0, 0, 1]]";

    #[test]
    fn axes_intrinsics_and_lights() {
        let text = format!(
            r#"{{"w": 64.0, "h": 48, "fl_x": 50, "cx": 30, "cy": 25, "k1": 0.1, "p1": 0.01, "camera_model": "OPENCV",
            "light": {{"type": "point", "intensity": 3, "position": [9, 9, 9]}}, "mesh_file": "m.ply",
            "frames": [
              {{"file_path": "./a.png", "transform_matrix": {POSE}}},
              {{"file_path": "b.png", "transform_matrix": {POSE}, "fl_x": 60, "fl_y": 61, "camera_model": "OPENCV_FISHEYE",
                "k2": 0.2, "light_position": [1, 2, 3], "light": {{"intensity": [4, 5, 6]}}}}]}}"#
        );
        let description = describe_text(&text).unwrap();
        let [a, b] = description.frames.as_slice() else { panic!() };
        assert_eq!(a.view.name, "a.png");
        let camera = a.view.camera;
        assert_eq!((camera.width, camera.height, camera.focal, camera.principal), (64, 48, [50.0; 2], [30.0, 25.0]));
        // OpenGL's camera looks along -z of the pose: here world -x. One unit ahead, right is world +y, up is world +z.
        assert_eq!(camera.to_camera([4.0, 6.0, 7.0]), [0.0, 0.0, 1.0]);
        assert_eq!(camera.to_camera([5.0, 7.0, 7.0]), [1.0, 0.0, 0.0]);
        assert_eq!(camera.to_camera([5.0, 6.0, 8.0]), [0.0, -1.0, 0.0]);
        assert_eq!(camera.centre(), [5.0, 6.0, 7.0]);
        let lens = Lens::Radial {
            numerator: [0.1, 0.0, 0.0, 0.0],
            denominator: [0.0; 3],
            tangential: [0.01, 0.0],
            shear: 0.0,
        };
        assert_eq!(a.lens, lens);
        assert_eq!(a.view.light, Some(PointLight { position: [9.0; 3], intensity: [3.0; 3] }));
        assert_eq!(b.view.camera.focal, [60.0, 61.0]);
        assert_eq!(b.lens, Lens::Fisheye { coefficients: [0.1, 0.2, 0.0, 0.0] });
        assert_eq!(b.view.light, Some(PointLight { position: [1.0, 2.0, 3.0], intensity: [4.0, 5.0, 6.0] }));
        assert!(description.mesh_file.unwrap().ends_with("m.ply"));
    }

    #[test]
    fn faults_name_line_and_key() {
        let frame = |keys: &str| format!("{{\"w\": 4, \"h\": 4, \"fl_x\": 5,\n \"frames\": [\n  {{{keys}}}]}}");
        let cases = [
            ("{}".to_owned(), "line 1, top level: key \"frames\" is missing"),
            (frame("\"x\": 1"), "line 3, frames[0]: key \"file_path\" is missing"),
            (frame("\"file_path\": \"a\""), "line 3, frames[0]: key \"transform_matrix\" is missing"),
            (
                frame("\"file_path\": \"a\", \"transform_matrix\": [[1, 2], [3, 4], [5, 6]]"),
                "line 3, frames[0].transform_matrix[0]: expected a list of 4 numbers, found a list of 2",
            ),
            (
                frame("\"file_path\": \"a\", \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,-1,0]]"),
                "mirrored or singular axes",
            ),
            (
                frame("\"file_path\": \"a\", \"transform_matrix\": [[1,0.1,0,0],[0,1,0,0],[0,0,1,0]]"),
                "should be a rotation, it is off by 1.0e-1",
            ),
            (
                frame(&format!("\"file_path\": \"a\", \"transform_matrix\": {POSE}, \"fl_x\": \"wide\"")),
                "line 3, frames[0].fl_x: expected a number, found \"wide\"",
            ),
            (
                frame(&format!("\"file_path\": \"a\", \"transform_matrix\": {POSE}, \"w\": 0")),
                "a picture of 0 x 4 pixels",
            ),
            (
                frame(&format!(
                    "\"file_path\": \"a\", \"transform_matrix\": {POSE}, \"camera_model\": \"EQUIRECTANGULAR\""
                )),
                "camera model EQUIRECTANGULAR is not supported",
            ),
        ];
        for (text, expected) in cases {
            let error = describe_text(&text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}\nexpected: {expected}");
        }
    }

    #[test]
    fn rounded_rotations_become_exact() {
        let (s, c) = (0.6001, 0.8);
        let rotation = nearest_rotation([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).unwrap();
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        assert!((dot(rotation[0], rotation[0]) - 1.0).abs() < 1e-12 && dot(rotation[0], rotation[1]).abs() < 1e-12);
        assert!((rotation[1][0] - 0.6).abs() < 1e-4);
        // A pose scaled as a whole keeps its directions.
        let rotation = nearest_rotation([[0.0, -3.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 3.0]]).unwrap();
        assert!((rotation[0][1] + 1.0).abs() < 1e-12 && (rotation[2][2] - 1.0).abs() < 1e-12);
    }
}
