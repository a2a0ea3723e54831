//! Description of a capture, read before any photograph is opened.

use super::CaptureReadOptions;
use super::lens::Lens;
use super::photograph::PhotographFiles;
use crate::error::{Error, Result};
use crate::image::Region;
use crate::input::Folder;
use crate::limits::Limits;
use crate::views::{Camera, View};
use std::path::{Path, PathBuf};

/// A capture without its pictures: cameras, lights and where the files are.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureDescription {
    /// The file that describes it.
    pub path: PathBuf,
    /// Name of the capture's folder.
    pub name: String,
    /// The frames, in the capture's order.
    pub frames: Vec<FrameDescription>,
    /// The mesh file that the capture names.
    pub mesh_file: Option<PathBuf>,
    /// Mesh to world, rows; `None` where the mesh is already registered.
    pub mesh_pose: Option<[[f64; 4]; 4]>,
    /// Photographs of the white board.
    pub white_reference: Option<WhiteReference>,
    /// Declared colour space of display-referred pictures.
    pub color_space: Option<String>,
    /// Non-fatal problems, one sentence each.
    pub warnings: Vec<String>,
}

/// Photographs of a white diffuse board under the capture's light.
#[derive(Debug, Clone, PartialEq)]
pub struct WhiteReference {
    /// Its image files.
    pub photograph: PhotographFiles,
}

/// One frame before its pictures are read.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameDescription {
    /// Name, pinhole camera and light.
    pub view: View,
    /// Lens distortion of the photograph as it is stored.
    pub lens: Lens,
    /// Image files of the photograph, or of the pair through polarisers.
    pub photograph: PhotographFiles,
    /// Pixels that show the object.
    pub mask: Option<PathBuf>,
    /// Part of the photograph, as it is stored, that shows a white diffuse board.
    pub board: Option<Region>,
}

impl FrameDescription {
    /// Returns the image files and the mask.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.photograph.files().chain(self.mask.as_deref())
    }
}

impl CaptureDescription {
    /// Returns the image files and masks of the frames and of the white board.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let boards = self.white_reference.iter().flat_map(|white| white.photograph.files());
        boards.chain(self.frames.iter().flat_map(FrameDescription::files))
    }

    /// The mesh file: the given one, the one that the capture names, or the only one beside the description.
    pub fn find_mesh(&self, options: &CaptureReadOptions) -> Result<PathBuf> {
        if let Some(mesh) = options.mesh.as_ref().or(self.mesh_file.as_ref()) {
            return Ok(mesh.clone());
        }
        let folder = capture_folder(&self.path);
        let entries = std::fs::read_dir(&folder).map_err(|e| Error::io(&folder, e))?;
        let is_mesh = |path: &PathBuf| {
            let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
            let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            !hidden && crate::mesh::read::EXTENSIONS.contains(&extension.as_str())
        };
        let mut found: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).filter(is_mesh).collect();
        found.sort();
        // A point cloud beside its mesh, as COLMAP's dense workspaces have it.
        if found.len() > 1 {
            found.retain(|path| !crate::mesh::read::is_point_cloud(path));
        }
        match found.as_slice() {
            // It may be a link, too.
            [one] => {
                let name = one.file_name().unwrap_or_default();
                Folder::new(&folder, &self.path, options.allow_outside).resolve_path(Path::new(name))
            }
            [] => Err(Error::input(
                &folder,
                "the capture names no mesh and there is none beside it (a point cloud is none: make a mesh of it by Poisson's method or ball \
                 pivoting); give one with option `mesh`, or make one from the masks with `capture::visual_hull`",
            )),
            [a, b, ..] => Err(Error::input(
                &folder,
                format!("several meshes ({}, {}, ...): give one with option `mesh`", a.display(), b.display()),
            )),
        }
    }
}

/// The folder that a capture's name and its mesh are looked for in: the one of `transforms.json`, the one above `sparse`.
pub(super) fn capture_folder(description: &Path) -> PathBuf {
    let parent = |path: &Path| match path.parent() {
        Some(p) if p.as_os_str().is_empty() => PathBuf::from("."),
        Some(p) => p.to_owned(),
        None => PathBuf::from("."),
    };
    let mut folder = parent(description);
    if description.extension().is_some_and(|e| e == "json") {
        return folder;
    }
    // Sidecars lie beside the photographs.
    if description.extension().is_some_and(|e| e.eq_ignore_ascii_case("xmp"))
        && folder.file_name().is_some_and(|n| n == "images")
    {
        return parent(&folder);
    }
    let is_number = |name: &std::ffi::OsStr| name.to_str().is_some_and(|name| name.parse::<u32>().is_ok());
    if folder.file_name().is_some_and(is_number) && parent(&folder).file_name().is_some_and(|n| n == "sparse") {
        folder = parent(&folder);
    }
    if folder.file_name().is_some_and(|n| n == "sparse") {
        folder = parent(&folder);
        // nerfstudio keeps COLMAP's work beside the photographs.
        if folder.file_name().is_some_and(|n| n == "colmap") && !folder.join("images").exists() {
            folder = parent(&folder);
        }
    }
    folder
}

pub(super) fn folder_name(folder: &Path) -> String {
    let full = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    full.file_name().map_or_else(|| "capture".to_owned(), |n| n.to_string_lossy().into_owned())
}

/// Returns why a camera is unusable, or `None`.
pub(super) fn camera_fault(camera: &Camera) -> Option<String> {
    let side = Limits::default().image_side;
    let size_fits = (1..=side).contains(&camera.width) && (1..=side).contains(&camera.height);
    if !size_fits {
        return Some(format!("a picture of {} x {} pixels (1 to {side} each way)", camera.width, camera.height));
    }
    let focal_fits = camera.focal.iter().all(|f| f.is_finite() && *f > 0.0);
    if !focal_fits {
        return Some(format!("a focal length of {} x {} pixels", camera.focal[0], camera.focal[1]));
    }
    let numbers = camera.principal.iter().chain(camera.rotation.iter().flatten()).chain(&camera.translation);
    numbers.into_iter().any(|v| !v.is_finite()).then(|| "a number that is not finite".to_owned())
}
