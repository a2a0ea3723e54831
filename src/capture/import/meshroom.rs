//! Meshroom's cameras: AliceVision's SfMData as JSON (`cameras.sfm`, `sfm.json`).
//!
//! Numbers may be written as texts. The nine numbers of a pose's rotation are columns of world to camera, in OpenCV's axes. What intrinsics mean
//! changed with the version of the file: principal points are offsets from the middle since 1.2.1, focal lengths millimetres since 1.2.2,
//! `pixelRatio` means its inverse before 1.2.5 (AliceVision's sfmDataIO).

use super::super::description::{CaptureDescription, capture_folder};
use super::super::json::{JsonDocument, JsonNode};
use super::super::lens::Lens;
use super::{ImportedView, description, left_out, pose, rows, transposed};
use crate::error::Result;
use crate::input::{FileAccess, Folder, quoted};
use crate::views::Camera;
use std::collections::BTreeMap;
use std::path::Path;

/// Parameters of a lens, numbers of a list, at most.
const MAX_NUMBERS: usize = 32;
/// Cameras of a rig, at most.
const MAX_RIG: usize = 1024;

/// Version of the file: major, minor, micro.
type Version = [u32; 3];
/// World to camera: rows of the rotation, and the camera's centre.
type Placement = ([[f64; 3]; 3], [f64; 3]);

pub(super) fn describe(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let document = JsonDocument::read(path, access)?;
    let root = document.root();
    let folder = Folder::new(capture_folder(path), path, access.allows_outside());
    let most = access.budget().limits().views as usize;
    let version = match root.get("version") {
        Some(node) => {
            let numbers = node.written_numbers(MAX_NUMBERS)?;
            std::array::from_fn(|index| numbers.get(index).map_or(0, |&number| number as u32))
        }
        None => [1, 2, 13],
    };
    let list = |key: &str| root.optional(key, |node| node.items(most)).map(Option::unwrap_or_default);
    let mut intrinsics = BTreeMap::new();
    for node in list("intrinsics")? {
        intrinsics.insert(node.required("intrinsicId")?.identifier()?, node);
    }
    let mut poses = BTreeMap::new();
    for node in list("poses")? {
        let transform = node.required("pose")?;
        let transform = transform.get("transform").unwrap_or(transform);
        poses.insert(node.required("poseId")?.identifier()?, placement(&transform)?);
    }
    let mut rigs = BTreeMap::new();
    for node in list("rigs")? {
        rigs.insert(node.required("rigId")?.identifier()?, node.required("subPoses")?.items(MAX_RIG)?);
    }
    let mut views = Vec::new();
    let mut without_pose = Vec::new();
    for view in root.required("views")?.items(most)? {
        let named = view.required("path")?.text()?.to_owned();
        let own = |key: &str| view.optional(key, JsonNode::identifier);
        let found = own("poseId")?.and_then(|id| poses.get(&id));
        let (Some(&placed), Some(id)) = (found, own("intrinsicId")?) else {
            without_pose.push(named);
            continue;
        };
        let placed = match rig_pose(&view, &rigs)? {
            Some(part) => in_rig(part, placed),
            None => placed,
        };
        let Some(node) = intrinsics.get(&id) else {
            return Err(view.error(format!("there are no intrinsics {}", quoted(&id))));
        };
        let (camera, lens) = read_intrinsics(node, version)?;
        let (rotation, translation) =
            pose(placed.0, placed.1).map_err(|fault| view.error(format!("its pose: {fault}")))?;
        views.push(ImportedView { named, camera: Camera { rotation, translation, ..camera }, lens });
    }
    let warnings = left_out(&without_pose, "without a pose, which Meshroom did not reconstruct, are");
    description(path, &folder, views, warnings.into_iter().collect())
}

fn placement(transform: &JsonNode) -> Result<Placement> {
    let numbers = |key: &str| transform.required(key)?.written_numbers(MAX_NUMBERS);
    let rotation = <[f64; 9]>::try_from(numbers("rotation")?)
        .map_err(|_| transform.error("\"rotation\" should be nine numbers"))?;
    let centre =
        <[f64; 3]>::try_from(numbers("center")?).map_err(|_| transform.error("\"center\" should be three numbers"))?;
    Ok((transposed(rows(rotation)), centre))
}

/// The pose of a view's camera in its rig, where the view's pose is the rig's.
fn rig_pose(view: &JsonNode, rigs: &BTreeMap<String, Vec<JsonNode>>) -> Result<Option<Placement>> {
    let (Some(rig), Some(part)) = (view.get("rigId"), view.get("subPoseId")) else { return Ok(None) };
    let independent = match view.get("isPoseIndependant") {
        Some(node) => node.is_true() || matches!(node.text(), Ok("true" | "1")),
        // Before the key was there, each view of a rig was part of it; a rig's pose is shared.
        None => view.optional("viewId", JsonNode::identifier)? == view.optional("poseId", JsonNode::identifier)?,
    };
    // An identifier of no rig.
    let Some(parts) = rigs.get(&rig.identifier()?) else { return Ok(None) };
    if independent {
        return Ok(None);
    }
    let index = part.written_number()?;
    let Some(node) = parts.get(index as usize).filter(|_| index >= 0.0) else {
        return Err(part.error(format!("the rig has {} cameras", parts.len())));
    };
    let node = node.required("pose")?;
    placement(&node.get("transform").unwrap_or(node)).map(Some)
}

/// World to camera of a part of a rig.
fn in_rig((turn, place): Placement, (rig_turn, rig_place): Placement) -> Placement {
    let product = |i: usize, j: usize| (0..3).map(|k| turn[i][k] * rig_turn[k][j]).sum();
    let rotation = std::array::from_fn(|i| std::array::from_fn(|j| product(i, j)));
    let back = |i: usize| (0..3).map(|k| rig_turn[k][i] * place[k]).sum::<f64>();
    (rotation, std::array::from_fn(|i| rig_place[i] + back(i)))
}

fn read_intrinsics(node: &JsonNode, version: Version) -> Result<(Camera, Lens)> {
    let number = |key: &str| node.optional(key, JsonNode::written_number);
    let side =
        |key: &str| Ok::<u32, crate::Error>(node.required(key)?.written_number()?.clamp(0.0, u32::MAX.into()) as u32);
    let (width, height) = (side("width")?, side("height")?);
    let offset = node.optional("principalPoint", |node| node.written_numbers(MAX_NUMBERS))?.unwrap_or_default();
    let [x, y] = <[f64; 2]>::try_from(offset).map_err(|_| node.error("\"principalPoint\" should be two numbers"))?;
    let half = if version < [1, 2, 1] { [0.0; 2] } else { [width, height].map(|side| 0.5 * f64::from(side)) };
    let focal = if version < [1, 2, 2] {
        let pixels = node.required("pxFocalLength")?;
        match if pixels.is_list() { pixels.written_numbers(MAX_NUMBERS)? } else { vec![pixels.written_number()?] }[..] {
            [both] => [both, both],
            [across, down] => [across, down],
            _ => return Err(pixels.error("expected one number or two")),
        }
    } else {
        let millimetres = node.required("focalLength")?.written_number()?;
        let pixels = millimetres * f64::from(width) / number("sensorWidth")?.unwrap_or(36.0);
        let ratio = number("pixelRatio")?.unwrap_or(1.0);
        match version {
            _ if version < [1, 2, 5] => [pixels, pixels / ratio],
            _ if version < [1, 2, 11] => [pixels, pixels * ratio],
            _ => [pixels / ratio, pixels],
        }
    };
    let text = |key: &str| node.optional(key, JsonNode::text).map(Option::unwrap_or_default);
    let undistortion = text("undistortionType")?;
    if !["", "none"].contains(&undistortion) {
        return Err(node.error(format!("the undistortion {} is not supported, distortions are", quoted(undistortion))));
    }
    // The type named the lens, too, before version 1.2.8.
    let kind = match (text("type")?, text("distortionType")?) {
        ("pinhole", lens) => lens,
        (other, "" | "none") => other,
        _ => return Err(node.error("only pinhole cameras are supported")),
    };
    let k = node.optional("distortionParams", |node| node.written_numbers(MAX_NUMBERS))?.unwrap_or_default();
    let at = |index: usize| k.get(index).copied().unwrap_or(0.0);
    let radial =
        |numerator: [f64; 4], tangential| Lens::Radial { numerator, denominator: [0.0; 3], tangential, shear: 0.0 };
    let mut scale = 1.0;
    let lens = match kind {
        "" | "none" | "pinhole" => Lens::Pinhole,
        "radial1" | "radialk1" => radial([at(0), 0.0, 0.0, 0.0], [0.0; 2]),
        "radial3" | "radialk3" => radial([at(0), at(1), at(2), 0.0], [0.0; 2]),
        "radial3pt" | "radialk3pt" => {
            scale = 1.0 / (1.0 + at(0) + at(1) + at(2));
            radial([at(0), at(1), at(2), 0.0], [0.0; 2])
        }
        "brown" => radial([at(0), at(1), at(2), 0.0], [at(3), at(4)]),
        "fisheye4" | "fisheye" => Lens::Fisheye { coefficients: [at(0), at(1), at(2), at(3)] },
        "fisheye1" if at(0) == 0.0 => Lens::Pinhole,
        "fisheye1" => Lens::FieldOfView { omega: at(0) },
        other => {
            return Err(node.error(format!(
                "a lens of type {} is not supported: undistort the photographs first (Meshroom's PrepareDenseScene)",
                quoted(other)
            )));
        }
    };
    let focal = focal.map(|focal| focal * scale);
    Ok((Camera { width, height, focal, principal: [x + half[0], y + half[1]], ..Camera::default() }, lens))
}
