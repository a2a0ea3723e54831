//! COLMAP models, binary and text: cameras and the poses of the photographs. Points are not needed, nor are the rigs and frames that models have
//! since COLMAP 3.12: its images have the poses of their cameras in them as before.

use super::description::{CaptureDescription, FrameDescription, camera_fault, capture_folder, folder_name};
use super::lens::Lens;
use super::photograph::PhotographFiles;
use super::view_names::view_names;
use crate::error::{Error, Result};
use crate::input::{FileAccess, Folder, escaped, quoted};
use crate::views::{Camera, View};
use byteorder::{ByteOrder, LittleEndian};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

#[cfg(test)]
mod tests;

/// Name and number of parameters of COLMAP's camera models, by their number in binary files.
const MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

struct ColmapPose {
    name: String,
    camera: u32,
    /// World to camera: w, x, y, z.
    quaternion: [f64; 4],
    translation: [f64; 3],
}

type Cameras = BTreeMap<u32, (Camera, Lens)>;

/// Bytes of a file of a model at most; with its points, a photograph takes some 500 kB.
const MAX_BYTES: u64 = 64 << 30;
/// Models of one workspace that are looked at.
const MAX_NUMBERED: usize = 1000;
/// Letters of a photograph's name.
const MAX_NAME: usize = 4096;

/// An error where one more camera or image than the limit is there.
fn check_count(path: &Path, what: &str, count: usize, access: &FileAccess) -> Result<()> {
    let most = access.budget().limits().views as usize;
    if count <= most { Ok(()) } else { Err(Error::input(path, format!("more than {most} {what}"))) }
}

fn files(folder: &Path, extension: &str) -> Option<(PathBuf, PathBuf)> {
    let pair = (folder.join(format!("cameras.{extension}")), folder.join(format!("images.{extension}")));
    (pair.0.is_file() && pair.1.is_file()).then_some(pair)
}

pub(super) fn is_model(folder: &Path) -> bool {
    files(folder, "bin").or_else(|| files(folder, "txt")).is_some()
}

/// Photographs are looked for in `images/` and beside the model, masks in `masks/` (`NAME.png`, COLMAP's way, or the stem);
/// frames come in the order of their names.
pub(super) fn describe(folder: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let (path, cameras, mut poses) = if let Some((cameras, images)) = files(folder, "bin") {
        (images.clone(), read_cameras_bin(&cameras, access)?, read_images_bin(&images, access)?)
    } else if let Some((cameras, images)) = files(folder, "txt") {
        (images.clone(), read_cameras_txt(&cameras, access)?, read_images_txt(&images, access)?)
    } else {
        return Err(Error::input(folder, "no COLMAP model: cameras and images (.bin or .txt) are needed"));
    };
    poses.sort_by(|a, b| a.name.cmp(&b.name));
    // The workspace, not the folder of the model in it: photographs lie beside the model's folder.
    let root = Folder::new(capture_folder(&path), &path, access.allows_outside());
    let names = view_names(&root, &poses.iter().map(|pose| pose.name.as_str()).collect::<Vec<_>>());
    let named = poses.into_iter().zip(names);
    let frames = named.map(|(pose, name)| frame(&path, &root, &cameras, pose, name)).collect::<Result<_>>()?;
    Ok(CaptureDescription {
        name: folder_name(root.path()),
        path,
        frames,
        mesh_file: None,
        mesh_pose: None,
        white_reference: None,
        color_space: None,
        warnings: Vec::new(),
    })
}

fn frame(path: &Path, root: &Folder, cameras: &Cameras, pose: ColmapPose, name: String) -> Result<FrameDescription> {
    let wrong = |message: String| Error::input(path, format!("image {}: {message}", escaped(&pose.name)));
    let Some((mut camera, lens)) = cameras.get(&pose.camera).copied() else {
        return Err(wrong(format!("camera {} is not in the camera list", pose.camera)));
    };
    let norm = pose.quaternion.iter().map(|v| v * v).sum::<f64>().sqrt();
    if norm.is_nan() || norm < 1e-6 {
        return Err(wrong("the quaternion is zero".into()));
    }
    camera.rotation = rotation_matrix(pose.quaternion.map(|v| v / norm));
    camera.translation = pose.translation;
    if let Some(fault) = camera_fault(&camera) {
        return Err(wrong(format!("the camera has {fault}")));
    }
    let stem = Path::new(&pose.name).with_extension("png");
    let names = [format!("images/{}", pose.name), pose.name.clone()].map(|name| root.portable(&name).into_owned());
    // What exists is found first: only that is judged, and a name that leads out of one folder may lie in the other.
    let found = |names: &[String]| names.iter().find(|name| root.path().join(name).exists()).cloned();
    let photograph = root.resolve(&found(&names).unwrap_or_else(|| names[0].clone()))?;
    let masks = [format!("masks/{}.png", pose.name), format!("masks/{}", stem.display())]
        .map(|name| root.portable(&name).into_owned());
    let mask = found(&masks).map(|name| root.resolve(&name)).transpose()?;
    let photograph = PhotographFiles::single(photograph);
    Ok(FrameDescription { photograph, board: None, mask, lens, view: View { name, camera, light: None } })
}

/// Rows of the rotation of a unit quaternion.
fn rotation_matrix([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

fn camera(model: &str, width: u64, height: u64, p: &[f64]) -> std::result::Result<(Camera, Lens), String> {
    let expected = MODELS.iter().find(|(name, _)| *name == model).map(|m| m.1);
    if expected.is_some_and(|n| n != p.len()) {
        return Err(format!("camera model {model} has {} parameters, found {}", expected.unwrap_or(0), p.len()));
    }
    let radial = |numerator, denominator, tangential| Lens::Radial { numerator, denominator, tangential, shear: 0.0 };
    let fisheye = |coefficients| Lens::Fisheye { coefficients };
    let none = [0.0; 3];
    let (focal, principal, lens) = match (model, p) {
        ("SIMPLE_PINHOLE", &[f, x, y]) => ([f, f], [x, y], Lens::Pinhole),
        ("PINHOLE", &[f, g, x, y]) => ([f, g], [x, y], Lens::Pinhole),
        ("SIMPLE_RADIAL", &[f, x, y, k]) => ([f, f], [x, y], radial([k, 0.0, 0.0, 0.0], none, [0.0; 2])),
        ("RADIAL", &[f, x, y, k, l]) => ([f, f], [x, y], radial([k, l, 0.0, 0.0], none, [0.0; 2])),
        ("OPENCV", &[f, g, x, y, k, l, p1, p2]) => ([f, g], [x, y], radial([k, l, 0.0, 0.0], none, [p1, p2])),
        ("OPENCV_FISHEYE", &[f, g, x, y, k1, k2, k3, k4]) => ([f, g], [x, y], fisheye([k1, k2, k3, k4])),
        ("FULL_OPENCV", &[f, g, x, y, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            ([f, g], [x, y], radial([k1, k2, k3, 0.0], [k4, k5, k6], [p1, p2]))
        }
        ("SIMPLE_RADIAL_FISHEYE", &[f, x, y, k]) => ([f, f], [x, y], fisheye([k, 0.0, 0.0, 0.0])),
        ("RADIAL_FISHEYE", &[f, x, y, k, l]) => ([f, f], [x, y], fisheye([k, l, 0.0, 0.0])),
        ("SIMPLE_FISHEYE", &[f, x, y]) => ([f, f], [x, y], fisheye([0.0; 4])),
        ("FISHEYE", &[f, g, x, y]) => ([f, g], [x, y], fisheye([0.0; 4])),
        ("FOV", &[f, g, x, y, 0.0]) => ([f, g], [x, y], Lens::Pinhole),
        ("FOV", &[f, g, x, y, omega]) => ([f, g], [x, y], Lens::FieldOfView { omega }),
        ("SIMPLE_DIVISION", &[f, x, y, k]) => ([f, f], [x, y], Lens::Division { coefficient: k }),
        ("DIVISION", &[f, g, x, y, k]) => ([f, g], [x, y], Lens::Division { coefficient: k }),
        _ => {
            let model = escaped(model);
            return Err(format!(
                "camera model {model} is not supported; undistort the photographs first (colmap image_undistorter)"
            ));
        }
    };
    let side = |v: u64| u32::try_from(v).unwrap_or(u32::MAX);
    let camera = Camera { width: side(width), height: side(height), focal, principal, ..Camera::default() };
    Ok((camera, if lens.is_pinhole() { Lens::Pinhole } else { lens }))
}

/// A byte position in a binary model.
struct BinaryReader<'a> {
    path: &'a Path,
    data: &'a [u8],
    at: usize,
}

impl BinaryReader<'_> {
    fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let rest = self.data.get(self.at..).unwrap_or_default();
        let Some(bytes) = rest.first_chunk::<N>() else {
            return Err(Error::input(
                self.path,
                format!("the file ends at byte {} within {what}: truncated", self.data.len()),
            ));
        };
        self.at += N;
        Ok(*bytes)
    }
    fn u32(&mut self, what: &str) -> Result<u32> {
        Ok(LittleEndian::read_u32(&self.take::<4>(what)?))
    }
    fn u64(&mut self, what: &str) -> Result<u64> {
        Ok(LittleEndian::read_u64(&self.take::<8>(what)?))
    }
    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = LittleEndian::read_f64(&self.take::<8>(what)?);
        }
        Ok(numbers)
    }
    fn name(&mut self, what: &str) -> Result<String> {
        let rest = self.data.get(self.at..).unwrap_or_default();
        let Some(length) = rest.iter().position(|&b| b == 0) else {
            return Err(Error::input(self.path, format!("the file ends within the name of {what}: truncated")));
        };
        if length > MAX_NAME {
            return Err(Error::input(
                self.path,
                format!("{what} has a name of {length} bytes, {MAX_NAME} at most are read"),
            ));
        }
        self.at += length + 1;
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }
    fn skip(&mut self, count: u64, size: u64, what: &str) -> Result<()> {
        let left = (self.data.len() - self.at) as u64;
        match count.checked_mul(size).filter(|&n| n <= left) {
            Some(n) => {
                self.at += n as usize;
                Ok(())
            }
            None => Err(Error::input(self.path, format!("the file ends within {what}: truncated"))),
        }
    }
}

fn read_cameras_bin(path: &Path, access: &FileAccess) -> Result<Cameras> {
    let data = access.read_bytes(path, "COLMAP model", MAX_BYTES)?;
    let mut bytes = BinaryReader { path, data: &data, at: 0 };
    let count = bytes.u64("the number of cameras")?;
    let mut cameras = Cameras::new();
    for index in 0..count {
        let what = format!("camera {index} of {count}");
        let (id, model) = (bytes.u32(&what)?, bytes.u32(&what)?);
        let (width, height) = (bytes.u64(&what)?, bytes.u64(&what)?);
        let Some(&(model, parameters)) = MODELS.get(model as usize) else {
            return Err(Error::input(path, format!("{what}: unknown camera model number {model}")));
        };
        let values = (0..parameters).map(|_| Ok(bytes.numbers::<1>(&what)?[0])).collect::<Result<Vec<_>>>()?;
        let camera = camera(model, width, height, &values).map_err(|e| Error::input(path, format!("{what}: {e}")))?;
        cameras.insert(id, camera);
        check_count(path, "cameras", cameras.len(), access)?;
    }
    Ok(cameras)
}

fn read_images_bin(path: &Path, access: &FileAccess) -> Result<Vec<ColmapPose>> {
    let data = access.read_bytes(path, "COLMAP model", MAX_BYTES)?;
    let mut bytes = BinaryReader { path, data: &data, at: 0 };
    let count = bytes.u64("the number of images")?;
    let mut poses = Vec::new();
    for index in 0..count {
        let what = format!("image {index} of {count}");
        bytes.u32(&what)?;
        let quaternion = bytes.numbers(&what)?;
        let translation = bytes.numbers(&what)?;
        let camera = bytes.u32(&what)?;
        let name = bytes.name(&what)?;
        let points = bytes.u64(&what)?;
        bytes.skip(points, 24, &format!("the points of {what}"))?;
        poses.push(ColmapPose { name, camera, quaternion, translation });
        check_count(path, "images", poses.len(), access)?;
    }
    Ok(poses)
}

fn parse<T: std::str::FromStr>(path: &Path, line: usize, what: &str, word: Option<&str>) -> Result<T> {
    let word = word.ok_or_else(|| Error::input(path, format!("line {line}: {what} is missing")))?;
    word.parse()
        .map_err(|_| Error::input(path, format!("line {line}: {what} should be a number, found {}", quoted(word))))
}

fn read_cameras_txt(path: &Path, access: &FileAccess) -> Result<Cameras> {
    let text = access.read_text(path, "COLMAP model", MAX_BYTES)?;
    let mut cameras = Cameras::new();
    for (line, row) in (1..).zip(text.lines()).filter(|(_, row)| !row.trim().is_empty() && !row.starts_with('#')) {
        let mut words = row.split_whitespace();
        let id = parse(path, line, "CAMERA_ID", words.next())?;
        let model = words.next().unwrap_or_default();
        let width = parse(path, line, "WIDTH", words.next())?;
        let height = parse(path, line, "HEIGHT", words.next())?;
        // No model has more; one too many tells that it is wrong.
        let words = words.take(MODELS.iter().map(|m| m.1).max().unwrap_or(0) + 1);
        let parameters =
            words.map(|w| parse(path, line, "a camera parameter", Some(w))).collect::<Result<Vec<f64>>>()?;
        let camera =
            camera(model, width, height, &parameters).map_err(|e| Error::input(path, format!("line {line}: {e}")))?;
        cameras.insert(id, camera);
        check_count(path, "cameras", cameras.len(), access)?;
    }
    Ok(cameras)
}

fn read_images_txt(path: &Path, access: &FileAccess) -> Result<Vec<ColmapPose>> {
    let text = access.read_text(path, "COLMAP model", MAX_BYTES)?;
    let mut poses = Vec::new();
    let mut points_due = false;
    for (line, row) in (1..).zip(text.lines()) {
        // The line after each image lists its points, or is empty; some programs leave it out.
        if row.starts_with('#') || std::mem::take(&mut points_due) && is_point_list(row) || row.trim().is_empty() {
            continue;
        }
        let mut words = row.split_whitespace();
        parse::<u32>(path, line, "IMAGE_ID", words.next())?;
        let mut numbers = [0.0; 7];
        for (number, what) in numbers.iter_mut().zip(["QW", "QX", "QY", "QZ", "TX", "TY", "TZ"]) {
            *number = parse(path, line, what, words.next())?;
        }
        let camera = parse(path, line, "CAMERA_ID", words.next())?;
        let name = words.collect::<Vec<_>>().join(" ");
        if name.len() > MAX_NAME {
            let length = name.len();
            return Err(Error::input(
                path,
                format!("line {line}: a NAME of {length} bytes, {MAX_NAME} at most are read"),
            ));
        }
        if name.is_empty() {
            return Err(Error::input(path, format!("line {line}: NAME is missing")));
        }
        let [qw, qx, qy, qz, tx, ty, tz] = numbers;
        poses.push(ColmapPose { name, camera, quaternion: [qw, qx, qy, qz], translation: [tx, ty, tz] });
        check_count(path, "images", poses.len(), access)?;
        points_due = true;
    }
    Ok(poses)
}

/// Returns `true` if a line of `images.txt` lists points: x, y and number of each. An image has ten words, of which the last is a name.
fn is_point_list(row: &str) -> bool {
    let mut words = 0;
    row.split_whitespace().all(|word| {
        words += 1;
        word.parse::<f64>().is_ok()
    }) && words % 3 == 0
}

/// Number of images of a model; `None` where the folder holds none that can be read.
fn image_count(folder: &Path, access: &FileAccess) -> Option<u64> {
    if let Some((_, images)) = files(folder, "bin") {
        let mut count = [0; 8];
        crate::input::open(&images).ok()?.0.read_exact(&mut count).ok()?;
        return Some(LittleEndian::read_u64(&count));
    }
    let (_, images) = files(folder, "txt")?;
    read_images_txt(&images, access).ok().map(|poses| poses.len() as u64)
}

/// The model of a workspace: COLMAP numbers those that it could not join, and the one with the most images is taken, the first of several.
/// Beside it what should be said of the others. `None` where there is none.
pub(super) fn find_model(workspace: &Path, access: &FileAccess) -> Option<(PathBuf, Option<String>)> {
    for parent in [workspace.join("sparse"), workspace.join("colmap/sparse")] {
        let numbered =
            (0..MAX_NUMBERED).map(|number| parent.join(number.to_string())).take_while(|folder| folder.is_dir());
        let models: Vec<(u64, PathBuf)> = numbered
            .filter(|folder| is_model(folder))
            .map(|folder| (image_count(&folder, access).unwrap_or(0), folder))
            .collect();
        if let Some(most) = models.iter().map(|(count, _)| *count).max() {
            let (_, chosen) = models.iter().find(|(count, _)| *count == most)?;
            let others: Vec<String> = (models.iter().filter(|(_, folder)| folder != chosen))
                .map(|(count, folder)| format!("{} has {count}", folder.display()))
                .collect();
            let said = (!others.is_empty()).then(|| {
                format!(
                    "{} is read, the model of the most photographs ({most}); {}",
                    chosen.display(),
                    others.join(", ")
                )
            });
            return Some((chosen.clone(), said));
        }
        if is_model(&parent) {
            return Some((parent, None));
        }
    }
    is_model(workspace).then(|| (workspace.to_owned(), None))
}
