//! Which kind of description a capture has.

use super::description::CaptureDescription;
use super::{colmap, transforms};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use std::path::Path;

/// Reads a capture's description: a folder with `transforms.json` or a COLMAP model (in `sparse/0`, `sparse` or itself), or
/// such a file itself. Files that it names must lie in the capture's folder, unless `access` allows more.
pub fn describe(path: impl AsRef<Path>, access: &FileAccess) -> Result<CaptureDescription> {
    let path = path.as_ref();
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    let description = if !metadata.is_dir() {
        match path.extension().and_then(|e| e.to_str()) {
            Some("json") => transforms::describe(path, access),
            Some("bin" | "txt") => colmap::describe(path.parent().unwrap_or(Path::new(".")), access),
            _ => Err(Error::input(path, "a capture is a folder, a transforms.json or a COLMAP model")),
        }
    } else if path.join("transforms.json").is_file() {
        transforms::describe(&path.join("transforms.json"), access)
    } else {
        match (colmap::find_model(path, access), path.join("transforms_train.json")) {
            (Some((folder, said)), _) => colmap::describe(&folder, access).map(|mut description| {
                description.warnings.extend(said);
                description
            }),
            (None, train) if train.is_file() => transforms::describe(&train, access),
            (None, _) => Err(Error::input(
                path,
                "no capture here: neither transforms.json (or transforms_train.json) nor a COLMAP model (cameras and images, .bin or \
                 .txt, in sparse/0 or sparse)",
            )),
        }
    }?;
    if description.frames.is_empty() {
        return Err(Error::input(&description.path, "the capture has no frame"));
    }
    Ok(description)
}
