//! Captures as other programs write them: Metashape, RealityCapture, Meshroom and OpenMVG.
//!
//! Each becomes the same description: pinhole cameras in OpenCV's axes, with the lens apart. Programs name photographs by paths of the machine
//! they ran on; the files are looked for by what is left of those paths in the capture's folder.

mod foreign;
mod meshroom;
mod metashape;
mod openmvg;
mod photographs;
mod reality_capture;
#[cfg(test)]
mod tests;
mod xml;

pub(super) use foreign::{is_foreign, refusal};

use super::description::{CaptureDescription, FrameDescription, camera_fault, folder_name};
use super::lens::Lens;
use super::photograph::PhotographFiles;
use super::transforms::nearest_rotation;
use crate::error::{Error, Result};
use crate::input::{FileAccess, Folder, escaped};
use crate::vector::dot;
use crate::views::{Camera, View};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes at the beginning of a file that tell its kind.
const HEAD_BYTES: u64 = 1 << 16;
/// Files of a folder that are looked at.
const MAX_ENTRIES: usize = 200_000;
/// Views that a warning names, at most.
const MAX_NAMED: usize = 8;

/// A description that this module reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ImportKind {
    Metashape,
    RealityCaptureTable,
    RealityCaptureSidecar,
    Meshroom,
    OpenMvg,
}

/// One view as a program's file has it.
struct ImportedView {
    /// Photograph's name or path, as the file gives it.
    named: String,
    camera: Camera,
    lens: Lens,
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// The beginning of a file as text, whatever its encoding; empty if it can't be read.
fn head(path: &Path) -> String {
    let mut bytes = Vec::new();
    let Ok((file, _)) = crate::input::open(path) else { return String::new() };
    let _ = file.take(HEAD_BYTES).read_to_end(&mut bytes);
    // Of UTF-16 the letters are left, which tell as much.
    bytes.retain(|&byte| byte != 0);
    String::from_utf8_lossy(&bytes).into_owned()
}

fn kind(path: &Path) -> Option<ImportKind> {
    let extension = extension(path);
    if !["xml", "csv", "txt", "xmp", "sfm", "json"].contains(&extension.as_str()) {
        return None;
    }
    let head = head(path);
    let has = |words: &[&str]| words.iter().all(|word| head.contains(word));
    match extension.as_str() {
        "xml" if has(&["<document", "<chunk"]) => Some(ImportKind::Metashape),
        "csv" | "txt" if reality_capture::is_table(&head) => Some(ImportKind::RealityCaptureTable),
        "xmp" if has(&["capturingreality.com/ns/xcr"]) => Some(ImportKind::RealityCaptureSidecar),
        "sfm" => Some(ImportKind::Meshroom),
        "json" if has(&["\"sfm_data_version\""]) => Some(ImportKind::OpenMvg),
        "json" if has(&["\"viewId\""]) || has(&["\"featuresFolders\""]) => Some(ImportKind::Meshroom),
        _ => None,
    }
}

fn describe_as(kind: ImportKind, path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    match kind {
        ImportKind::Metashape => metashape::describe(path, access),
        ImportKind::RealityCaptureTable => reality_capture::describe_table(path, access),
        ImportKind::RealityCaptureSidecar => reality_capture::describe_sidecars(path, access),
        ImportKind::Meshroom => meshroom::describe(path, access),
        ImportKind::OpenMvg => openmvg::describe(path, access),
    }
}

/// Reads a file of one of these programs; `None` if it is none.
pub(super) fn describe_file(path: &Path, access: &FileAccess) -> Option<Result<CaptureDescription>> {
    kind(path).map(|kind| describe_as(kind, path, access))
}

/// Reads what one of these programs left in a folder; `None` if there is nothing of theirs. Sidecars may lie in its folder of photographs.
pub(super) fn describe_folder(folder: &Path, access: &FileAccess) -> Result<Option<CaptureDescription>> {
    let mut files = entries(folder)?;
    if !files.iter().any(|path| kind(path).is_some()) {
        let below = folder.join("images");
        files = if below.is_dir() { entries(&below)? } else { Vec::new() };
        files.retain(|path| extension(path) == "xmp");
    }
    let mut found: Option<(ImportKind, PathBuf)> = None;
    for path in files {
        // One sidecar stands for all.
        if let Some((ImportKind::RealityCaptureSidecar, _)) = &found
            && extension(&path) == "xmp"
        {
            continue;
        }
        match (kind(&path), &found) {
            (Some(ImportKind::RealityCaptureSidecar), Some(_)) => {}
            (Some(kind), None | Some((ImportKind::RealityCaptureSidecar, _))) => found = Some((kind, path)),
            (Some(_), Some((_, other))) => {
                let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let (a, b) = (name(other), name(&path));
                let message =
                    format!("{} and {} both describe cameras: give the one to read", escaped(&a), escaped(&b));
                return Err(Error::input(folder, message));
            }
            (None, _) => {}
        }
    }
    found.map(|(kind, path)| describe_as(kind, &path, access)).transpose()
}

/// The files in a folder in the order of their names, hidden ones left out.
fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut files: Vec<PathBuf> = entries
        .take(MAX_ENTRIES)
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')))
        .collect();
    files.sort();
    Ok(files)
}

/// World to camera from the camera's axes in the world, as rows of the rotation from world to camera, and its centre; or the fault of the axes.
fn pose(rows: [[f64; 3]; 3], centre: [f64; 3]) -> std::result::Result<([[f64; 3]; 3], [f64; 3]), String> {
    let rotation = nearest_rotation(rows)?;
    let translation = rotation.map(|row| -dot(row, centre));
    Ok((rotation, translation))
}

fn transposed(rows: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i]))
}

/// Rows of nine numbers.
fn rows(numbers: [f64; 9]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| numbers[3 * i + j]))
}

/// The description of these views, in the order of their names.
fn description(
    path: &Path,
    folder: &Folder,
    views: Vec<ImportedView>,
    warnings: Vec<String>,
) -> Result<CaptureDescription> {
    let mut frames = Vec::with_capacity(views.len());
    for view in views {
        if let Some(fault) = camera_fault(&view.camera) {
            let named = escaped(&view.named);
            return Err(Error::input(path, format!("photograph {named}: the camera has {fault}")));
        }
        let (photograph, name) = photographs::find(folder, &view.named)?;
        let mask = photographs::find_mask(folder, &name)?;
        let lens = if view.lens.is_pinhole() { Lens::Pinhole } else { view.lens };
        let view = View { name, camera: view.camera, light: None };
        frames.push(FrameDescription {
            photograph: PhotographFiles::single(photograph),
            board: None,
            mask,
            lens,
            view,
        });
    }
    frames.sort_by(|a, b| a.view.name.cmp(&b.view.name));
    Ok(CaptureDescription {
        path: path.to_owned(),
        name: folder_name(folder.path()),
        frames,
        mesh_file: None,
        mesh_pose: None,
        white_reference: None,
        color_space: None,
        warnings,
    })
}

/// A sentence about views that are left out; none if there are none.
fn left_out(names: &[String], why: &str) -> Option<String> {
    let shown: Vec<String> = names.iter().take(MAX_NAMED).map(|name| escaped(name)).collect();
    let more = if names.len() > MAX_NAMED { ", ..." } else { "" };
    (!names.is_empty()).then(|| format!("{} photographs {why} left out: {}{more}", names.len(), shown.join(", ")))
}

/// An error where a file has more views than the limit.
fn check_views(path: &Path, count: usize, access: &FileAccess) -> Result<()> {
    let most = access.budget().limits().views as usize;
    if count <= most { Ok(()) } else { Err(Error::input(path, format!("more than {most} photographs"))) }
}
