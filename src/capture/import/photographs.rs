//! Photographs and masks of a capture, by what is left of the paths that another machine had for them.

use crate::error::Result;
use crate::input::Folder;
use std::path::{Path, PathBuf};

/// Folders of photographs within a capture, in the order in which they are tried.
const FOLDERS: [&str; 6] = ["", "images/", "photos/", "photographs/", "undistorted/", "input/"];
/// Extensions that names come without.
const EXTENSIONS: [&str; 12] = ["jpg", "JPG", "jpeg", "JPEG", "png", "PNG", "tif", "TIF", "tiff", "TIFF", "exr", "EXR"];
/// Last parts of a path that are tried together.
const MAX_PARTS: usize = 4;

/// The photograph that a path or name means, and its path relative to the folder, which is the view's name. One that is not there is returned
/// as it would lie in the folder.
pub(super) fn find(folder: &Folder, named: &str) -> Result<(PathBuf, String)> {
    let slashed = named.replace('\\', "/");
    let is_part = |part: &&str| !["", ".", ".."].contains(part) && !part.ends_with(':');
    let parts: Vec<&str> = slashed.split('/').filter(is_part).collect();
    for length in (1..=parts.len().min(MAX_PARTS)).rev() {
        let rest = parts[parts.len() - length..].join("/");
        if let Some(name) = FOLDERS.iter().find_map(|base| with_extension(folder, &format!("{base}{rest}"))) {
            return Ok((folder.resolve(&name)?, name));
        }
    }
    let last = parts.last().copied().unwrap_or_default().to_owned();
    if folder.allows_outside() && Path::new(&slashed).is_file() {
        return Ok((folder.resolve(&slashed)?, last));
    }
    Ok((folder.resolve(&last)?, last))
}

/// The name under which a file is there, with an extension if it has none.
fn with_extension(folder: &Folder, name: &str) -> Option<String> {
    let is_there = |name: &str| folder.path().join(name).is_file();
    if is_there(name) {
        return Some(name.to_owned());
    }
    let has_one = Path::new(name).extension().and_then(|e| e.to_str()).is_some_and(|e| EXTENSIONS.contains(&e));
    if has_one {
        return None;
    }
    EXTENSIONS.iter().map(|extension| format!("{name}.{extension}")).find(|name| is_there(name))
}

/// The photograph of which a sidecar of this path is one; `None` if it is not there.
pub(super) fn beside(folder: &Folder, sidecar: &str) -> Option<String> {
    let (stem, _) = sidecar.rsplit_once('.')?;
    EXTENSIONS.iter().map(|extension| format!("{stem}.{extension}")).find(|name| folder.path().join(name).is_file())
}

/// The mask of a photograph: `masks/NAME.png`, `masks/STEM.png`, `masks/STEM_mask.png`, or beside it `STEM_mask.png`, `STEM.mask.png` or
/// `NAME.mask.png`.
pub(super) fn find_mask(folder: &Folder, name: &str) -> Result<Option<PathBuf>> {
    let (parent, file) = name.rsplit_once('/').map_or(("", name), |(parent, file)| (parent, file));
    let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    // Folders below that of the photographs are kept below that of the masks.
    let below = FOLDERS[1..].iter().find_map(|base| format!("{parent}/").strip_prefix(base).map(str::to_owned));
    let below = below.unwrap_or_else(|| if parent.is_empty() { String::new() } else { format!("{parent}/") });
    let own = if parent.is_empty() { String::new() } else { format!("{parent}/") };
    let apart = ["masks/", "mask/"].into_iter().flat_map(|base| [format!("{base}{below}"), base.to_owned()]);
    let apart = apart.flat_map(|base| {
        [file, stem, &format!("{stem}_mask"), &format!("{file}_mask")].map(|name| format!("{base}{name}.png"))
    });
    let beside = [format!("{stem}_mask"), format!("{stem}.mask"), format!("{file}.mask")];
    let mut all = apart.chain(beside.into_iter().map(|name| format!("{own}{name}.png")));
    all.find(|name| folder.path().join(name).is_file()).map(|name| folder.resolve(&name)).transpose()
}
