//! RealityCapture's and RealityScan's cameras: XMP sidecars beside the photographs, and the table "Internal/External camera parameters".
//!
//! Lengths are in units of the photograph's longer side ("RealityCapture XMP Camera Math", Capturing Reality 2022): the focal length is
//! `FocalLength35mm / 36`, the principal point is an offset from the middle. The pose is world to camera with OpenCV's axes in sidecars; heading,
//! pitch and roll in degrees of the table turn a camera that looks down with its upper edge to the north (+y).

use super::super::description::{CaptureDescription, capture_folder};
use super::super::lens::Lens;
use super::photographs;
use super::xml::{self, XmlElement};
use super::{ImportedView, check_views, description, entries, extension, left_out, pose, rows};
use crate::error::{Error, Result};
use crate::image::read::read_size;
use crate::input::{FileAccess, Folder, escaped, quoted};
use crate::views::Camera;
use glam::DMat3;
use std::collections::BTreeMap;
use std::path::Path;

/// Width of the film that focal lengths refer to, in millimetres.
const FILM: f64 = 36.0;
/// Bytes of a table, at most.
const MAX_TABLE_BYTES: u64 = 64 << 20;
/// Columns of a table, at most.
const MAX_COLUMNS: usize = 256;

/// Intrinsics in units of the longer side.
struct Intrinsics {
    /// 35 mm equivalent.
    focal: f64,
    principal: [f64; 2],
    /// Focal length down over that across.
    aspect: f64,
    skew: f64,
    /// `k1 k2 k3 k4 t1 t2`.
    distortion: [f64; 6],
}

impl Intrinsics {
    fn camera(&self, (width, height): (u32, u32)) -> (Camera, Lens) {
        let [w, h] = [width, height].map(f64::from);
        let longer = w.max(h);
        let focal = self.focal / FILM;
        let [k1, k2, k3, k4, t1, t2] = self.distortion;
        // OpenCV's p1 and p2 are t2 and t1.
        let tangential = [t2, t1];
        let lens =
            Lens::Radial { numerator: [k1, k2, k3, k4], denominator: [0.0; 3], tangential, shear: self.skew / focal };
        let camera = Camera {
            width,
            height,
            focal: [focal * longer, focal * self.aspect * longer],
            principal: [0.5 * w + self.principal[0] * longer, 0.5 * h + self.principal[1] * longer],
            ..Camera::default()
        };
        (camera, lens)
    }
}

/// All sidecars of the folder that one of them lies in.
pub(super) fn describe_sidecars(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let folder = Folder::new(capture_folder(path), path, access.allows_outside());
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let below = parent.strip_prefix(folder.path()).ok().and_then(|below| below.to_str()).unwrap_or_default();
    let (mut views, mut without_pose, mut without_photograph) = (Vec::new(), Vec::new(), Vec::new());
    for sidecar in entries(parent)?.iter().filter(|path| extension(path) == "xmp") {
        let name = sidecar.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let name = if below.is_empty() { name.to_owned() } else { format!("{below}/{name}") };
        check_views(path, views.len() + without_pose.len() + without_photograph.len() + 1, access)?;
        let Some(photograph) = photographs::beside(&folder, &name) else {
            without_photograph.push(name);
            continue;
        };
        match xml::read(&folder.resolve(&name)?, access, |root| read_sidecar(&root))? {
            Some((intrinsics, (rotation, translation))) => {
                let (camera, lens) = intrinsics.camera(read_size(&folder.resolve(&photograph)?, access)?);
                views.push(ImportedView {
                    named: photograph,
                    camera: Camera { rotation, translation, ..camera },
                    lens,
                });
            }
            None => without_pose.push(photograph),
        }
    }
    let mut warnings: Vec<String> = left_out(&without_pose, "without a pose in their XMP files").into_iter().collect();
    if !without_photograph.is_empty() {
        let count = without_photograph.len();
        warnings.push(format!(
            "{count} XMP files have no photograph beside them: {}, ...",
            escaped(&without_photograph[0])
        ));
    }
    description(path, &folder, views, warnings)
}

type Pose = ([[f64; 3]; 3], [f64; 3]);

/// `None` if the sidecar has no pose, as of photographs that were not aligned, or of other programs.
fn read_sidecar(root: &XmlElement) -> Result<Option<(Intrinsics, Pose)>> {
    let Some(element) = root.descendants("Description").find(|d| d.property("Rotation").is_some()) else {
        return Ok(None);
    };
    let (Some(rotation), Some(position)) = (element.property("Rotation"), element.property("Position")) else {
        return Ok(None);
    };
    if let Some(coordinates) = element.property("Coordinates").filter(|word| *word != "absolute") {
        return Err(element.error(format!(
            "the pose is in {} coordinates, those of a rig; export it with absolute ones",
            quoted(coordinates)
        )));
    }
    let Some(focal) = element.number("FocalLength35mm")? else {
        return Err(element.error("FocalLength35mm is missing: export the XMP files with calibration"));
    };
    let mut distortion = match element.property("DistortionCoeficients") {
        Some(text) => element.numbers("DistortionCoeficients", text)?,
        None => [0.0; 6],
    };
    let model = element.property("DistortionModel").unwrap_or("perspective");
    let used: &[usize] = match model {
        "perspective" => &[],
        "brown3" => &[0, 1, 2],
        "brown4" => &[0, 1, 2, 3],
        "brown3t2" => &[0, 1, 2, 4, 5],
        "brown4t2" => &[0, 1, 2, 3, 4, 5],
        _ if distortion == [0.0; 6] => &[],
        _ => {
            return Err(element.error(format!(
                "the distortion model {} is not supported: choose a Brown model in RealityCapture's alignment settings, or export undistorted photographs",
                quoted(model)
            )));
        }
    };
    (0..6).filter(|index| !used.contains(index)).for_each(|index| distortion[index] = 0.0);
    let number = |name: &'static str, default: f64| Ok::<f64, Error>(element.number(name)?.unwrap_or(default));
    let intrinsics = Intrinsics {
        focal,
        principal: [number("PrincipalPointU", 0.0)?, number("PrincipalPointV", 0.0)?],
        aspect: number("AspectRatio", 1.0)?,
        skew: number("Skew", 0.0)?,
        distortion,
    };
    let rotation = rows(element.numbers("Rotation", rotation)?);
    let position = element.numbers("Position", position)?;
    let pose = pose(rotation, position).map_err(|fault| element.error(fault))?;
    Ok(Some((intrinsics, pose)))
}

/// Names of a column, of which the later ones are RealityScan's.
const COLUMNS: [(&str, &[&str]); 16] = [
    ("name", &["name"]),
    ("x", &["x"]),
    ("y", &["y"]),
    ("alt", &["alt"]),
    ("heading", &["heading", "yaw"]),
    ("pitch", &["pitch"]),
    ("roll", &["roll"]),
    ("f", &["f", "f_35mm"]),
    ("px", &["px", "px_norm"]),
    ("py", &["py", "py_norm"]),
    ("k1", &["k1"]),
    ("k2", &["k2"]),
    ("k3", &["k3"]),
    ("k4", &["k4"]),
    ("t1", &["t1"]),
    ("t2", &["t2"]),
];
/// Columns at the beginning of [`COLUMNS`] that a table must have.
const REQUIRED: usize = 8;

/// The columns of a table by the first line that is one of their names.
fn columns(line: &str) -> Option<BTreeMap<&'static str, usize>> {
    let heads: Vec<String> = line
        .split(',')
        .take(MAX_COLUMNS)
        .map(|head| head.trim().trim_start_matches(['#', '\u{feff}']).trim().to_ascii_lowercase())
        .collect();
    let found: BTreeMap<&str, usize> = COLUMNS
        .iter()
        .filter_map(|(name, names)| Some((*name, heads.iter().position(|head| names.contains(&head.as_str()))?)))
        .collect();
    COLUMNS[..REQUIRED].iter().all(|(name, _)| found.contains_key(name)).then_some(found)
}

/// Returns `true` if a text begins as a table of camera parameters does, after lines of notes.
pub(super) fn is_table(head: &str) -> bool {
    head.lines().take(8).any(|line| columns(line).is_some())
}

pub(super) fn describe_table(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let folder = Folder::new(capture_folder(path), path, access.allows_outside());
    let text = access.read_text(path, "table of cameras", MAX_TABLE_BYTES)?;
    let mut lines = (1..).zip(text.lines());
    let Some(columns) = lines.by_ref().take(8).find_map(|(_, line)| columns(line)) else {
        return Err(Error::input(path, "no line names the columns name, x, y, alt, heading, pitch, roll and f"));
    };
    let (mut views, mut missing) = (Vec::new(), Vec::new());
    for (line, row) in lines.filter(|(_, row)| !row.trim().is_empty() && !row.starts_with('#')) {
        let cells: Vec<&str> = row.split(',').take(MAX_COLUMNS).map(|cell| cell.trim().trim_matches('"')).collect();
        let cell = |name: &str| columns.get(name).and_then(|&index| cells.get(index)).copied();
        let number = |name: &str| match cell(name) {
            Some(word) => {
                let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
                number.ok_or_else(|| {
                    Error::input(path, format!("line {line}: {name} should be a number, found {}", quoted(word)))
                })
            }
            None if columns.contains_key(name) => Err(Error::input(path, format!("line {line}: {name} is missing"))),
            None => Ok(0.0),
        };
        let distortion = [number("k1")?, number("k2")?, number("k3")?, number("k4")?, number("t1")?, number("t2")?];
        let principal = [number("px")?, number("py")?];
        let intrinsics = Intrinsics { focal: number("f")?, principal, aspect: 1.0, skew: 0.0, distortion };
        check_views(path, views.len() + missing.len() + 1, access)?;
        let named = cell("name").unwrap_or_default().to_owned();
        let (photograph, _) = photographs::find(&folder, &named)?;
        // Sizes are not in the table.
        if !photograph.is_file() {
            missing.push(named);
            continue;
        }
        let (camera, lens) = intrinsics.camera(read_size(&photograph, access)?);
        let [heading, pitch, roll] = [number("heading")?, number("pitch")?, number("roll")?].map(f64::to_radians);
        let axes = DMat3::from_rotation_z(-heading) * DMat3::from_rotation_x(pitch) * DMat3::from_rotation_y(roll);
        let to_camera = [axes.x_axis, -axes.y_axis, -axes.z_axis].map(|axis| axis.to_array());
        let (rotation, translation) = pose(to_camera, [number("x")?, number("y")?, number("alt")?])
            .map_err(|fault| Error::input(path, format!("line {line}: {fault}")))?;
        views.push(ImportedView { named, camera: Camera { rotation, translation, ..camera }, lens });
    }
    let warnings = left_out(&missing, "that are not in the capture's folder are").into_iter().collect();
    description(path, &folder, views, warnings)
}
