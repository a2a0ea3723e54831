//! A camera's calibration from a file: OpenCV's YAML, ROS's `camera_info` YAML, JSON with the keys of `transforms.json`, or ARToolKit's
//! `camera_para.dat` ([`super::artoolkit`]).
//!
//! - OpenCV and ROS: `image_width`, `image_height`, `camera_matrix` (or `K`), `distortion_coefficients` (or `D`) as matrices with `data`, or as
//!   plain lists; `distortion_model`, if there: `plumb_bob`, `rational_polynomial` (both OpenCV's `k1 k2 p1 p2 k3 k4 k5 k6`), `equidistant`
//!   or `fisheye`. Pixel centres are at whole numbers there; half a pixel is added to the principal point.
//!   OpenCV's `fisheye_model`, the names of its version 2 and its JSON are read, too, and `cam0` of Kalibr's camchain.
//! - JSON: `w`, `h`, `fl_x`, `fl_y`, `cx`, `cy`, `camera_model`, `k1 k2 k3 k4 p1 p2`, pixel centres at .5, as nerfstudio writes them.

use super::Lens;
use super::artoolkit::{from_camera_para, is_camera_para};
use super::json::JsonDocument;
use super::transforms::read_intrinsics;
use crate::error::{Error, Result};
use crate::image::ImageOrientation;
use crate::input::{FileAccess, escaped};
use crate::views::Camera;
use std::collections::HashMap;
use std::path::Path;
use yaml_rust2::parser::{Event, Parser, Tag};
use yaml_rust2::{Yaml, YamlLoader};

const WHAT: &str = "camera calibration (OpenCV or ROS YAML, JSON, or ARToolKit's camera_para.dat)";
/// Bytes of a calibration file, at most.
const MAX_BYTES: u64 = 1 << 20;
/// Values of a YAML file, at most, those that aliases repeat counted each time; a calibration with its views has some thousands.
const MAX_NODES: u64 = 100_000;
/// Lists and maps in each other, at most.
const MAX_DEPTH: usize = 32;
/// Memory of a value, with a list that has grown, bytes.
const NODE_BYTES: u64 = 256;

/// A camera without a place, and its lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Size, focal lengths, principal point; at the origin, looking to +z.
    pub camera: Camera,
    /// Lens distortion.
    pub lens: Lens,
}

impl Calibration {
    /// Fails where pictures are of another size: calibrations of cropped or scaled pictures differ in more than one way.
    pub fn check_size(&self, calibration: &Path, picture: &Path, width: usize, height: usize) -> Result<()> {
        let Camera { width: w, height: h, .. } = self.camera;
        if (w as usize, h as usize) == (width, height) {
            return Ok(());
        }
        Err(Error::input(
            picture,
            format!(
                "{width} x {height} pixels, but {} calibrates {w} x {h}: take the calibration made for this size, or, if the \
                 pictures are the calibrated ones made smaller or larger, option `scale_camera`",
                calibration.display()
            ),
        ))
    }

    /// Returns the calibration of the same pictures made smaller or larger, each axis by itself; nothing is cropped.
    pub fn scaled_to(&self, [width, height]: [usize; 2]) -> Self {
        let sides = [width, height];
        let from = [self.camera.width, self.camera.height];
        let scaled =
            |lengths: [f64; 2]| std::array::from_fn(|i| lengths[i] * sides[i] as f64 / f64::from(from[i].max(1)));
        let (focal, principal) = (scaled(self.camera.focal), scaled(self.camera.principal));
        // The lens bends what is not yet in pixels; skew is of the rows' focal length.
        let camera = Camera { width: width as u32, height: height as u32, focal, principal, ..self.camera };
        Calibration { camera, ..*self }
    }
}

impl Calibration {
    /// Returns the calibration of a photograph that is shown upright, width and height in pixels. One that is of the stored size is turned with the
    /// photograph; where both sizes are the same it is taken to be of the stored one, which is the sensor's. Others are returned as they are.
    pub fn upright(&self, orientation: ImageOrientation, size: [usize; 2]) -> Self {
        let Camera { width, height, focal, principal, .. } = self.camera;
        let stored = orientation.swap_sides(size);
        // Rows that are sheared along columns have no lens here.
        let is_sheared = matches!(self.lens, Lens::Radial { shear, .. } if shear != 0.0);
        if [width as usize, height as usize] != stored || (orientation.transposed && is_sheared) {
            return *self;
        }
        let [width, height] = orientation.swap_sides([width, height]);
        let (focal, mut principal) = (orientation.swap_sides(focal), orientation.swap_sides(principal));
        let mut lens = self.lens;
        if let Lens::Radial { tangential, shear, .. } = &mut lens {
            if orientation.mirrored_x != orientation.mirrored_y {
                *shear = -*shear;
            }
            // The first bends along y, the second along x.
            *tangential = orientation.swap_sides(*tangential);
        }
        for (axis, (mirrored, side)) in
            [(orientation.mirrored_x, width), (orientation.mirrored_y, height)].into_iter().enumerate()
        {
            if mirrored {
                principal[axis] = f64::from(side) - principal[axis];
                if let Lens::Radial { tangential, .. } = &mut lens {
                    tangential[1 - axis] = -tangential[1 - axis];
                }
            }
        }
        Calibration { camera: Camera { width, height, focal, principal, ..self.camera }, lens }
    }
}

/// Reads a calibration; which kind is told by its content.
///
/// Errors name the file and the key that is missing or wrong.
pub fn read_calibration(path: impl AsRef<Path>, access: &FileAccess) -> Result<Calibration> {
    let path = path.as_ref();
    {
        let bytes = access.read_bytes(path, WHAT, MAX_BYTES)?;
        if is_camera_para(&bytes) {
            let (camera, lens) = from_camera_para(path, &bytes, access)?;
            return checked(path, Calibration { camera, lens });
        }
    }
    let text = access.read_text(path, WHAT, MAX_BYTES)?;
    if text.trim_start().starts_with('<') {
        let message = "an XML file (OpenCV's or another program's), which is not read: save the calibration as YAML (OpenCV's FileStorage does \
                       so under a name that ends in .yml)";
        return Err(Error::input(path, message));
    }
    // OpenCV's JSON has the keys of its YAML, of which JSON is a part.
    let calibration = if text.trim_start().starts_with('{') && !text.contains("\"camera_matrix\"") {
        let document = JsonDocument::read(path, access)?;
        let (camera, lens) = read_intrinsics(&document.root(), &document.root(), None)?;
        Calibration { camera, lens }
    } else {
        // OpenCV's first line, "%YAML:1.0", is not YAML.
        let text = text.lines().filter(|line| !line.starts_with("%YAML")).collect::<Vec<_>>().join("\n");
        let nodes = count_nodes(&text).map_err(|message| Error::input(path, message))?;
        let _held = access.reserve(path, "camera calibration", nodes * NODE_BYTES + 4 * text.len() as u64)?;
        from_yaml(&text).map_err(|message| Error::input(path, message))?
    };
    checked(path, calibration)
}

/// The calibration, its camera at the origin; an error where it is none.
fn checked(path: &Path, calibration: Calibration) -> Result<Calibration> {
    let Camera { width, height, focal, principal, .. } = calibration.camera;
    let finite = focal.iter().all(|f| f.is_finite() && *f > 0.0) && principal.iter().all(|p| p.is_finite());
    if !finite || width == 0 || height == 0 {
        return Err(Error::input(path, "focal lengths must be above 0, the size at least 1 x 1"));
    }
    let camera = Camera { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], ..calibration.camera };
    Ok(Calibration { camera, ..calibration })
}

/// The values that a YAML text stands for, with those that its aliases repeat; an error where they are too many or lie too deep to be
/// loaded.
fn count_nodes(text: &str) -> std::result::Result<u64, String> {
    let mut parser = Parser::new_from_str(text);
    // Long texts count as several values.
    let weigh = |text: &str, tag: &Option<Tag>| {
        let tag = tag.as_ref().map_or(0, |tag| tag.handle.len() + tag.suffix.len());
        1 + (text.len() + tag) as u64 / NODE_BYTES
    };
    // Values of everything that is open, and of everything that an alias may mean. What has an anchor is kept twice.
    let mut open: Vec<(u64, usize)> = Vec::new();
    let mut anchored: HashMap<usize, u64> = HashMap::new();
    let mut total: u64 = 0;
    loop {
        let (event, place) = parser.next_token().map_err(|e| format!("neither JSON nor YAML: {e}"))?;
        let nodes = match event {
            Event::StreamEnd => return Ok(total),
            Event::SequenceStart(anchor, tag) | Event::MappingStart(anchor, tag) => {
                open.push((weigh("", &tag), anchor));
                if open.len() > MAX_DEPTH {
                    return Err(format!("line {}: lists and maps lie more than {MAX_DEPTH} deep", place.line()));
                }
                continue;
            }
            Event::SequenceEnd | Event::MappingEnd => {
                let (nodes, anchor) = open.pop().unwrap_or_default();
                anchored.insert(anchor, nodes);
                if anchor > 0 { 2 * nodes } else { nodes }
            }
            Event::Scalar(text, _, anchor, tag) => {
                let nodes = weigh(&text, &tag);
                anchored.insert(anchor, nodes);
                if anchor > 0 { 2 * nodes } else { nodes }
            }
            Event::Alias(anchor) => anchored.get(&anchor).copied().unwrap_or(1),
            _ => continue,
        };
        let sum = match open.last_mut() {
            Some((sum, _)) => sum,
            None => &mut total,
        };
        *sum = sum.saturating_add(nodes);
        if *sum > MAX_NODES {
            let line = place.line();
            return Err(format!(
                "line {line}: more than {MAX_NODES} values, repeated ones counted: no camera calibration"
            ));
        }
    }
}

fn from_yaml(text: &str) -> std::result::Result<Calibration, String> {
    let documents = YamlLoader::load_from_str(text).map_err(|e| format!("neither JSON nor YAML: {e}"))?;
    let root = documents.first().ok_or("the file is empty")?;
    if !root["cam0"].is_badvalue() {
        return from_kalibr(root);
    }
    if !root["Camera.fx"].is_badvalue() || !root["Camera1.fx"].is_badvalue() {
        return Err("settings of ORB-SLAM, which are not read: write image_width, image_height, camera_matrix and distortion_coefficients".into());
    }
    let find =
        |keys: &[&str]| keys.iter().map(|key| &root[*key]).find(|value| !value.is_badvalue() && !value.is_null());
    let count = |keys: &[&str]| {
        let value = find(keys).and_then(number).filter(|v| v.fract() == 0.0 && (1.0..=65536.0).contains(v));
        value.map(|v| v as u32).ok_or_else(|| format!("key {} is missing or no number of pixels", keys[0]))
    };
    let (width, height) =
        (count(&["image_width", "width", "image_Width"])?, count(&["image_height", "height", "image_Height"])?);
    let list = |keys: &[&str]| {
        find(keys).map(|value| numbers(value).ok_or_else(|| format!("{} is no list of numbers", keys[0])))
    };
    let matrix = list(&["camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k"])
        .ok_or("key camera_matrix (or K) is missing")??;
    let [fx, skew, cx, zero, fy, cy, 0.0, 0.0, 1.0] = matrix[..] else {
        return Err("camera_matrix is not fx 0 cx, 0 fy cy, 0 0 1".into());
    };
    if zero != 0.0 || skew.abs() > 1e-6 * fx.abs() {
        return Err("camera_matrix has skew, which is not supported".into());
    }
    let names =
        ["distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "dist_coeff", "D", "d"];
    let bending = list(&names).transpose()?.unwrap_or_default();
    let is_fisheye =
        find(&["fisheye_model"]).is_some_and(|value| number(value) == Some(1.0) || value.as_bool() == Some(true));
    let usual = if is_fisheye { "fisheye" } else { "plumb_bob" };
    let model = find(&["distortion_model", "camera_model"]).and_then(Yaml::as_str).unwrap_or(usual);
    let camera = Camera { width, height, focal: [fx, fy], principal: [cx + 0.5, cy + 0.5], ..Camera::default() };
    Ok(Calibration { camera, lens: lens_of(model, &bending)? })
}

/// The camera `cam0` of Kalibr's camchain.
fn from_kalibr(root: &Yaml) -> std::result::Result<Calibration, String> {
    if !root["cam1"].is_badvalue() {
        return Err(
            "a camchain of several cameras; leave the one in the file that the photographs are of, as cam0".into()
        );
    }
    let camera = &root["cam0"];
    let list = |key: &str| numbers(&camera[key]).ok_or_else(|| format!("cam0: {key} is missing or no list of numbers"));
    let model = camera["camera_model"].as_str().unwrap_or("pinhole");
    if model != "pinhole" {
        return Err(format!("cam0: Kalibr's camera model {} is not supported; known: pinhole", escaped(model)));
    }
    let ([fx, fy, cx, cy], [width, height]) = (&list("intrinsics")?[..], &list("resolution")?[..]) else {
        return Err("cam0: intrinsics should be fu, fv, pu, pv, and resolution width, height".into());
    };
    let side =
        |value: f64| if value.fract() == 0.0 && (1.0..=65536.0).contains(&value) { Some(value as u32) } else { None };
    let (Some(width), Some(height)) = (side(*width), side(*height)) else {
        return Err("cam0: resolution is no number of pixels".into());
    };
    let model = match camera["distortion_model"].as_str() {
        Some("none") | None => "plumb_bob",
        Some("equi") => "equidistant",
        Some(other) => other,
    };
    let bending = if camera["distortion_coeffs"].is_badvalue() { Vec::new() } else { list("distortion_coeffs")? };
    let camera = Camera { width, height, focal: [*fx, *fy], principal: [cx + 0.5, cy + 0.5], ..Camera::default() };
    Ok(Calibration { camera, lens: lens_of(model, &bending)? })
}

/// The lens of a distortion model of OpenCV or ROS.
fn lens_of(model: &str, bending: &[f64]) -> std::result::Result<Lens, String> {
    let at = |k: usize| bending.get(k).copied().unwrap_or(0.0);
    let lens = match model {
        "equidistant" | "fisheye" | "kannala_brandt" if bending.len() <= 4 => {
            Lens::Fisheye { coefficients: std::array::from_fn(at) }
        }
        "plumb_bob" | "rational_polynomial" | "pinhole" | "perspective" | "radtan"
            if matches!(bending.len(), 0 | 4 | 5 | 8 | 12 | 14) =>
        {
            if bending.iter().skip(8).any(|&k| k != 0.0) {
                return Err("thin-prism and tilt coefficients (the ninth and on) are not supported".into());
            }
            Lens::Radial {
                numerator: [at(0), at(1), at(4), 0.0],
                denominator: [at(5), at(6), at(7)],
                tangential: [at(2), at(3)],
                shear: 0.0,
            }
        }
        "equidistant"
        | "fisheye"
        | "kannala_brandt"
        | "plumb_bob"
        | "rational_polynomial"
        | "pinhole"
        | "perspective"
        | "radtan" => return Err(format!("{} distortion coefficients don't fit model {model}", bending.len())),
        other => {
            return Err(format!(
                "distortion model {} is not supported; known: plumb_bob, rational_polynomial, equidistant, fisheye",
                escaped(other)
            ));
        }
    };
    Ok(if lens.is_pinhole() { Lens::Pinhole } else { lens })
}

fn number(value: &Yaml) -> Option<f64> {
    value.as_f64().or_else(|| value.as_i64().map(|v| v as f64)).filter(|v| v.is_finite())
}

/// A list, a list of rows, or a matrix with its values under `data`.
fn numbers(value: &Yaml) -> Option<Vec<f64>> {
    let list = if value["data"].is_badvalue() { value } else { &value["data"] };
    let mut flat = Vec::new();
    for item in list.as_vec()? {
        match item.as_vec() {
            Some(row) => flat.extend(row.iter().map(number).collect::<Option<Vec<f64>>>()?),
            None => flat.push(number(item)?),
        }
    }
    Some(flat)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Calibration> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.yaml");
        std::fs::write(&path, text).unwrap();
        read_calibration(&path, &FileAccess::default())
    }

    const OPENCV: &str = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   \
        dt: d\n   data: [ 500., 0., 319.5, 0., 5.1e+02, 239., 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   \
        cols: 5\n   dt: d\n   data: [ 0.1, -0.02, 0.001, 0.002, 0.03 ]\n";

    #[test]
    fn three_kinds_say_the_same() {
        let ros = "image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
            data: [500.0, 0.0, 319.5, 0.0, 510.0, 239, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob\n\
            distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, -0.02, 0.001, 0.002, 0.03]\n\
            projection_matrix:\n  rows: 3\n  cols: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]\n";
        let json = r#"{"w": 640, "h": 480, "fl_x": 500, "fl_y": 510, "cx": 320, "cy": 239.5, "camera_model": "OPENCV",
            "k1": 0.1, "k2": -0.02, "k3": 0.03, "p1": 0.001, "p2": 0.002}"#;
        let [a, b, c] = [OPENCV, ros, json].map(|text| read_text(text).unwrap());
        assert_eq!(a, b);
        assert_eq!(a, c);
        assert_eq!((a.camera.focal, a.camera.principal), ([500.0, 510.0], [320.0, 239.5]));
        let fisheye = ros.replace("plumb_bob", "equidistant").replace(", 0.03]", "]");
        assert_eq!(read_text(&fisheye).unwrap().lens, Lens::Fisheye { coefficients: [0.1, -0.02, 0.001, 0.002] });
    }

    #[test]
    fn dialects_say_the_same() {
        let matrix = "rows: 3\n   cols: 3\n   dt: d\n   data: [ 600., 0., 319.5, 0., 600., 239.5, 0., 0., 1. ]";
        let bends = "rows: 1\n   cols: 4\n   dt: d\n   data: [ -0.01, 0.02, -0.0003, 0.0001 ]";
        let old = format!(
            "%YAML:1.0\nimage_Width: 640\nimage_Height: 480\nCamera_Matrix: !!opencv-matrix\n   {matrix}\n\
             Distortion_Coefficients: !!opencv-matrix\n   {bends}\n"
        );
        let kalibr = "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.01, 0.02, -0.0003, 0.0001]\n  distortion_model: radtan\n  \
            intrinsics: [600.0, 600.0, 319.5, 239.5]\n  resolution: [640, 480]\n";
        let json = r#"{"image_width": 640, "image_height": 480,
            "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": [600.0,0.0,319.5,0.0,600.0,239.5,0.0,0.0,1.0]},
            "distortion_coefficients": {"type_id": "opencv-matrix", "rows": 1, "cols": 4, "dt": "d", "data": [-0.01,0.02,-0.0003,0.0001]}}"#;
        let [a, b, c] = [&old, kalibr, json].map(|text| read_text(text).unwrap());
        assert_eq!((a.camera.focal, a.camera.principal), ([600.0; 2], [320.0, 240.0]));
        let lens = Lens::Radial {
            numerator: [-0.01, 0.02, 0.0, 0.0],
            denominator: [0.0; 3],
            tangential: [-0.0003, 0.0001],
            shear: 0.0,
        };
        assert_eq!((a.lens, b, c), (lens, a, a));
        let fisheye = Lens::Fisheye { coefficients: [-0.01, 0.02, -0.0003, 0.0001] };
        assert_eq!(read_text(&old.replace("Camera_Matrix", "fisheye_model: 1\nCamera_Matrix")).unwrap().lens, fisheye);
        assert_eq!(read_text(&kalibr.replace("radtan", "equidistant")).unwrap().lens, fisheye);
        for (text, said) in [
            ("<?xml version=\"1.0\"?>\n<opencv_storage/>", "an XML file"),
            ("%YAML:1.0\nCamera.fx: 600.0\n", "ORB-SLAM"),
            (&kalibr.replace("pinhole", "omni"), "Kalibr's camera model omni"),
            (&format!("{kalibr}{}", kalibr.replace("cam0", "cam1")), "several cameras"),
        ] {
            let error = read_text(text).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn calibrations_turn_with_the_photograph() {
        let stored = read_text(OPENCV).unwrap();
        let position = |calibration: &Calibration, [x, y]: [f64; 2]| {
            let [u, v] = calibration.lens.distort([x, y]);
            let Camera { focal, principal, .. } = calibration.camera;
            [focal[0] * u + principal[0], focal[1] * v + principal[1]]
        };
        for number in 1..=8 {
            let orientation = ImageOrientation::from_exif(number).unwrap();
            let size = orientation.swap_sides([640, 480]);
            let upright = stored.upright(orientation, size);
            assert_eq!([upright.camera.width as usize, upright.camera.height as usize], size, "{number}");
            // A direction in the stored image, and the same in the upright one.
            let turn = |p: [f64; 2], size: [f64; 2]| {
                let [x, y] = orientation.swap_sides(p);
                [
                    if orientation.mirrored_x { size[0] - x } else { x },
                    if orientation.mirrored_y { size[1] - y } else { y },
                ]
            };
            let ideal = [0.3, -0.2];
            let expected = turn(position(&stored, ideal), size.map(|side| side as f64));
            let found = position(&upright, turn(ideal, [0.0; 2]));
            assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-9), "{number}: {found:?} {expected:?}");
        }
        // What was calibrated upright stays.
        let upright = Calibration { camera: Camera { width: 480, height: 640, ..stored.camera }, ..stored };
        assert_eq!(upright.upright(ImageOrientation::from_exif(6).unwrap(), [480, 640]), upright);
    }

    #[test]
    fn faults_are_named() {
        let fault = |text: &str| read_text(text).unwrap_err().to_string();
        assert!(fault(&OPENCV.replace("image_width", "width_of_image")).contains("image_width is missing"));
        assert!(fault(&OPENCV.replace("camera_matrix", "matrix")).contains("camera_matrix (or K) is missing"));
        assert!(fault(&OPENCV.replace("0., 5.1e+02", "3., 5.1e+02")).contains("skew"));
        assert!(
            fault(&OPENCV.replace(", 0.03 ]", "]").replace("---", "---\ndistortion_model: cheese")).contains("cheese")
        );
        assert!(fault("a: [1, 2").contains("neither JSON nor YAML"));
        assert!(fault("").contains("empty"));
        assert!(fault("{\"w\": 3}").contains("\"h\" is missing"));
        let calibration = read_text(OPENCV).unwrap();
        let wrong = calibration.check_size(Path::new("k.yaml"), Path::new("a.png"), 320, 240).unwrap_err().to_string();
        assert!(wrong.contains("320 x 240") && wrong.contains("640 x 480") && wrong.contains("k.yaml"), "{wrong}");
    }
}
