//! Which kind of description a capture has.

use super::description::CaptureDescription;
use super::photograph::pair_by_names;
use super::{colmap, import, transforms};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use std::path::Path;

/// Said where nothing is known.
const NO_FILE: &str = "a capture is a folder, a transforms.json, a COLMAP model, or the cameras of Metashape (XML), RealityCapture (XMP, CSV), \
                       Meshroom (.sfm) or OpenMVG (sfm_data.json)";
const NO_CAPTURE: &str = "no capture here: neither transforms.json (or transforms_train.json) nor a COLMAP model (cameras and images, .bin or \
                          .txt, in sparse/0 or sparse), nor cameras of Metashape, RealityCapture, Meshroom or OpenMVG";

/// Reads a capture's description: a folder with `transforms.json`, a COLMAP model (in `sparse/0`, `sparse` or itself), or the cameras of
/// Metashape, RealityCapture, Meshroom or OpenMVG; or such a file itself. Files that it names must lie in the capture's folder, unless `access`
/// allows more.
pub fn describe(path: impl AsRef<Path>, access: &FileAccess) -> Result<CaptureDescription> {
    let path = path.as_ref();
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    let mut description = if metadata.is_dir() { describe_folder(path, access) } else { describe_file(path, access) }?;
    if description.frames.is_empty() {
        let said = description.warnings.first().map_or(String::new(), |warning| format!(": {warning}"));
        return Err(Error::input(&description.path, format!("the capture has no frame{said}")));
    }
    pair_by_names(&mut description, access);
    Ok(description)
}

fn describe_file(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    if let Some(description) = import::describe_file(path, access) {
        return description;
    }
    let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match path.extension().and_then(|e| e.to_str()) {
        Some("bin" | "txt") if colmap::is_model(folder) => colmap::describe(folder, access),
        Some("json") if !import::is_foreign(path) => transforms::describe(path, access),
        _ => Err(import::refusal(path, NO_FILE)),
    }
}

fn describe_folder(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let own = path.join("transforms.json");
    if own.is_file() {
        return transforms::describe(&own, access);
    }
    if let Some((folder, said)) = colmap::find_model(path, access) {
        let mut description = colmap::describe(&folder, access)?;
        description.warnings.extend(said);
        return Ok(description);
    }
    let train = path.join("transforms_train.json");
    if train.is_file() {
        let mut description = transforms::describe(&train, access)?;
        let others =
            ["transforms_val.json", "transforms_test.json"].into_iter().filter(|name| path.join(name).is_file());
        let others = others.collect::<Vec<_>>();
        if !others.is_empty() {
            let others = others.join(" and ");
            description.warnings.push(format!("the views of {others} are not read, as they are kept for tests"));
        }
        return Ok(description);
    }
    match import::describe_folder(path, access)? {
        Some(description) => Ok(description),
        None => Err(import::refusal(path, NO_CAPTURE)),
    }
}
