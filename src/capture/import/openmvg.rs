//! OpenMVG's `sfm_data.json`: views, intrinsics and extrinsics as cereal writes them.
//!
//! A pose is the rotation from world to camera by rows, and the camera's centre. The name of a type stands where the type comes first; later ones
//! have its number alone.

use super::super::description::{CaptureDescription, capture_folder};
use super::super::json::{JsonDocument, JsonNode};
use super::super::lens::Lens;
use super::{ImportedView, description, left_out, pose};
use crate::error::Result;
use crate::input::{FileAccess, Folder, quoted};
use crate::views::Camera;
use std::collections::BTreeMap;
use std::path::Path;

/// Set in the number of a type that comes for the first time.
const FIRST: u64 = 1 << 31;
/// Parameters of a lens, at most.
const MAX_NUMBERS: usize = 32;
/// An identifier of nothing.
const NONE: &str = "4294967295";

pub(super) fn describe(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let document = JsonDocument::read(path, access)?;
    let root = document.root();
    let folder = Folder::new(capture_folder(path), path, access.allows_outside());
    let most = access.budget().limits().views as usize;
    let list = |key: &str| root.optional(key, |node| node.items(most)).map(Option::unwrap_or_default);
    let mut types: BTreeMap<u64, &str> = BTreeMap::new();
    let mut intrinsics = BTreeMap::new();
    for node in list("intrinsics")? {
        let value = node.required("value")?;
        let number = value.optional("polymorphic_id", JsonNode::number)?.unwrap_or(0.0) as u64 & !FIRST;
        if let Some(name) = value.get("polymorphic_name") {
            types.insert(number, name.text()?);
        }
        let name = types.get(&number).copied();
        intrinsics.insert(node.required("key")?.identifier()?, read_intrinsics(&data(&value)?, name)?);
    }
    let mut poses = BTreeMap::new();
    for node in list("extrinsics")? {
        let value = node.required("value")?;
        let rotation = value.required("rotation")?;
        let lines = rotation.items(3)?.iter().map(JsonNode::numbers::<3>).collect::<Result<Vec<_>>>()?;
        let rows =
            <[[f64; 3]; 3]>::try_from(lines).map_err(|_| rotation.error("expected three rows of three numbers"))?;
        let pose = pose(rows, value.required("center")?.numbers()?).map_err(|fault| rotation.error(fault))?;
        poses.insert(node.required("key")?.identifier()?, pose);
    }
    let mut views = Vec::new();
    let mut without_pose = Vec::new();
    for node in root.required("views")?.items(most)? {
        let view = data(&node.required("value")?)?;
        let file = view.required("filename")?.text()?;
        let local = view.optional("local_path", JsonNode::text)?.unwrap_or_default();
        let named = if local.is_empty() { file.to_owned() } else { format!("{local}/{file}") };
        let pose = poses.get(&view.required("id_pose")?.identifier()?);
        let id = view.required("id_intrinsic")?.identifier()?;
        let Some((&(rotation, translation), false)) = pose.map(|pose| (pose, id == NONE)) else {
            without_pose.push(named);
            continue;
        };
        let Some(&(camera, lens)) = intrinsics.get(&id) else {
            return Err(view.error(format!("there are no intrinsics {}", quoted(&id))));
        };
        views.push(ImportedView { named, camera: Camera { rotation, translation, ..camera }, lens });
    }
    let warnings = left_out(&without_pose, "without a pose, which OpenMVG did not reconstruct, are");
    description(path, &folder, views, warnings.into_iter().collect())
}

/// The object behind a shared pointer.
fn data<'a>(value: &JsonNode<'a>) -> Result<JsonNode<'a>> {
    value.required("ptr_wrapper")?.required("data")
}

fn read_intrinsics(data: &JsonNode, name: Option<&str>) -> Result<(Camera, Lens)> {
    // Some versions put the pinhole's part into an object of its own.
    let base = data.get("value0");
    let find = |key: &str| match base.as_ref().and_then(|base| base.get(key)) {
        Some(node) => Ok(node),
        None => data.required(key),
    };
    let coefficients = |key: &str| find(key)?.written_numbers(MAX_NUMBERS);
    let by_key = || {
        let keys =
            [("disto_k1", "pinhole_radial_k1"), ("disto_k3", "pinhole_radial_k3"), ("disto_t2", "pinhole_brown_t2")];
        let found = keys.into_iter().chain([("fisheye", "fisheye")]).find(|(key, _)| data.get(key).is_some());
        found.map_or("pinhole", |(_, name)| name)
    };
    let name = name.unwrap_or_else(by_key);
    let lens = match name {
        "pinhole" => Lens::Pinhole,
        "pinhole_radial_k1" | "pinhole_radial_k3" | "pinhole_brown_t2" => {
            let key = match name {
                "pinhole_radial_k1" => "disto_k1",
                "pinhole_radial_k3" => "disto_k3",
                _ => "disto_t2",
            };
            let k = coefficients(key)?;
            let at = |index: usize| k.get(index).copied().unwrap_or(0.0);
            let numerator = [at(0), at(1), at(2), 0.0];
            Lens::Radial { numerator, denominator: [0.0; 3], tangential: [at(3), at(4)], shear: 0.0 }
        }
        "fisheye" => {
            let k = coefficients("fisheye")?;
            Lens::Fisheye { coefficients: std::array::from_fn(|index| k.get(index).copied().unwrap_or(0.0)) }
        }
        other => {
            return Err(data.error(format!(
                "a camera of type {} is not supported; pinhole, pinhole_radial_k1, pinhole_radial_k3, pinhole_brown_t2 and fisheye are",
                quoted(other)
            )));
        }
    };
    let focal = find("focal_length")?.number()?;
    let camera = Camera {
        width: find("width")?.count()?,
        height: find("height")?.count()?,
        focal: [focal; 2],
        principal: find("principal_point")?.numbers()?,
        ..Camera::default()
    };
    Ok((camera, lens))
}
