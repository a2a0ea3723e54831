//! Reading captures: photographs, cameras, lights, masks, the white board and the mesh.
//!
//! Read are `transforms.json` (nerfstudio's keys, and ours for polarised photographs, lights and the white board), COLMAP models, text or
//! binary, and the cameras of Metashape, RealityCapture, Meshroom and OpenMVG. Photographs become linear radiance of a pinhole camera: display-referred ones are linearised,
//! lens distortion is removed. Keys of `transforms.json` beyond nerfstudio's:
//!
//! - `mesh_file`; `mesh_transform`, 4 x 4 rows, mesh to world (as `tsuya align` finds it);
//! - `light`: `{type: "point", intensity: number or [r, g, b], position: [x, y, z]}`, at the top or per frame; per frame also
//!   `light_position`, `light_intensity`. Irradiance at distance `r` is `intensity / r^2`;
//! - `white_reference`: `{file_path, cross_file_path}`; where a board stands beside the object, `white_region`, at the top or per frame: its
//!   `[left, top, width, height]` in the photograph. Frames are multiplied so that it is as bright as in the reference, or in the first frame;
//! - `color_space`: of integer pictures, see [`crate::image::ColorSpace::from_name`];
//! - per frame `mask_path`, and of polarised photographs `cross_file_path` (specular blocked), alone or with `parallel_file_path`, whose sum with it is the
//!   photograph then; or `polarisers`: a list of `{file_path, angle}` in degrees, three angles at least. `polarisation_mosaic`, here or at the top,
//!   is `{angles: [90, 45, 135, 0], colours: "RGGB"}`, polarisers and (if any) colour filters of a polarisation camera's cells by rows, or `true` for
//!   these angles: then `file_path` is its raw image, linear unless `color_space` is declared, of the camera's size or twice as large;
//! - `exposure_time` in seconds beside any `file_path`; several exposures are `exposures: [{file_path, exposure_time}]` in place of it (`cross`
//!   and `parallel` are objects then).
//!
//! Where no description tells of polarisers, names of files and folders do: those that differ by a word such as `parallel`, `cross` or `pol45`.

mod agreement;
pub(crate) mod align;
#[cfg(feature = "ar")]
mod artoolkit;
#[cfg(feature = "ar")]
pub(crate) mod calibration;
mod clipping;
mod colmap;
mod describe;
mod description;
mod frames;
mod hull;
mod import;
pub(crate) mod json;
mod lens;
mod open;
mod photograph;
mod scale;
mod scratch;
#[cfg(test)]
mod test_capture;
#[cfg(test)]
mod test_dialects;
#[cfg(test)]
mod test_open;
#[cfg(test)]
mod tests;
mod transforms;
mod view_names;
mod white;

pub use agreement::{Agreement, Cause, Misplaced, agreement};
pub use align::{Alignment, Correspondence, align, apply_pose, read_correspondences};
#[cfg(feature = "ar")]
pub use calibration::{Calibration, read_calibration};
pub use clipping::Clipping;
pub use describe::describe;
pub use description::{CaptureDescription, FrameDescription, WhiteReference};
pub use frames::CaptureFrame;
pub use hull::{HullOptions, VisualHull, visual_hull};
pub use lens::Lens;
pub use open::{OpenCapture, OpenFrames, open, open_with_progress};
pub use photograph::{ExposureFile, Exposures, MosaicColours, PhotographFiles, PolarisationMosaic};
#[cfg(feature = "ar")]
pub(crate) use transforms::nearest_rotation;

use crate::error::{Error, Result};
use crate::input::FileAccess;
use crate::limits::Limits;
use crate::mesh::Mesh;
use std::path::{Path, PathBuf};

/// A capture: in memory, or open ([`OpenCapture`]).
#[derive(Debug, Clone)]
pub struct Capture<F = Vec<CaptureFrame>> {
    /// Name of the capture's folder.
    pub name: String,
    /// The frames that could be read, in the capture's order; at least one. Either all have a cross photograph or none.
    pub frames: F,
    /// The mesh, in world coordinates, cleaned ([`crate::mesh::clean`]).
    pub mesh: Mesh,
    /// What was subtracted from the capture's coordinates of mesh, cameras and lights; 0 unless they are too large for single precision.
    pub origin: [f64; 3],
    /// Mean radiance of the unpolarised white board's middle; 1 without a board.
    pub white: [f64; 3],
    /// `on_board / off_board` per colour; given, or measured on the board.
    pub beta: Option<[f64; 3]>,
    /// Colour space of the pixels in memory, always a linear one: `linear-rec709`, or the declared `linear-NAME`.
    pub color_space: String,
    /// Non-fatal problems found while reading, one sentence each.
    pub warnings: Vec<String>,
    /// Frames left out: pictures missing or unreadable, without cross photograph where others have one, with an empty mask.
    pub skipped_frames: usize,
    /// Pixels, inside the masks where there are any, that are NaN or infinite in a photograph as stored.
    pub missing_pixels: u64,
    /// Pixels of the object that are at the most that their files hold.
    pub clipping: Clipping,
}

impl<F> Capture<F> {
    /// Returns the capture with what `frames` makes of its frames.
    fn map_frames<G>(self, frames: impl FnOnce(F) -> G) -> Capture<G> {
        Capture {
            name: self.name,
            frames: frames(self.frames),
            mesh: self.mesh,
            origin: self.origin,
            white: self.white,
            beta: self.beta,
            color_space: self.color_space,
            warnings: self.warnings,
            skipped_frames: self.skipped_frames,
            missing_pixels: self.missing_pixels,
            clipping: self.clipping,
        }
    }
}

/// Overrides for values that a capture states or lacks, and the limits of reading.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CaptureReadOptions {
    /// The mesh file. Default: the one that the capture names, else the only one in its folder.
    pub mesh: Option<PathBuf>,
    /// Mesh to world, rows, from [`align`]. Default: the capture's `mesh_transform`, else none.
    pub mesh_pose: Option<[[f64; 4]; 4]>,
    /// `on / off` of a white diffuse surface per colour. Default: measured on the capture's white board.
    pub beta: Option<[f64; 3]>,
    /// Colour space of integer pictures, see [`crate::image::ColorSpace::from_name`]. Default: the capture's, else what each picture says (ICC profile, PNG's
    /// chunks), else `srgb`.
    pub color_space: Option<String>,
    /// Factor of the mesh's coordinates, before its pose. Default: 1, and an error where the mesh is so large or so small for the
    /// cameras that its unit must be another than theirs.
    pub mesh_scale: Option<f64>,
    /// `true` if the masks show the background, not the object.
    pub invert_masks: bool,
    /// Takes mesh, cameras and masks as they are, whether they agree or not, and the mesh's winding. Default: a mesh that is wound inwards is
    /// turned, and an error where the mesh's silhouette and the masks have nothing to do with each other or photographs are not those of their
    /// cameras, see [`agreement`].
    pub unchecked: bool,
    /// Divides photographs by their exposures as EXIF tells them (time, sensitivity, aperture), over the first one's. Default: a warning where these
    /// differ; times that the capture states come first.
    pub exif_exposure: bool,
    /// Limits of everything that is read, together.
    pub limits: Limits,
    /// Allows files that the capture names to be hidden, or to lie outside its folder.
    pub allow_outside: bool,
}

impl CaptureReadOptions {
    /// Returns the memory account and rules of access of one capture.
    pub fn access(&self) -> FileAccess {
        FileAccess::new(self.limits).allow_outside(self.allow_outside)
    }
}

/// Reads a capture: a folder or its `transforms.json` or COLMAP file. See the module for what is read, [`Capture`] for what
/// comes out. A photograph that is missing or damaged costs its frame and a warning; contradictions are errors.
pub fn read(path: impl AsRef<Path>, options: &CaptureReadOptions) -> Result<Capture> {
    read_with_progress(path, options, &|_, _| {})
}

/// Reads a capture as [`read`] does; `progress(done, total)` is called after each frame, from any thread of the current pool.
pub fn read_with_progress(
    path: impl AsRef<Path>,
    options: &CaptureReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Capture> {
    open::read_whole(path.as_ref(), options, progress)
}

/// Reads the mesh and places it in the world, whose origin may be moved to it; returns where that lies in the capture's coordinates.
fn read_mesh(
    description: &mut CaptureDescription,
    options: &CaptureReadOptions,
    access: &FileAccess,
    warnings: &mut Vec<String>,
) -> Result<(Mesh, [f64; 3])> {
    let path = description.find_mesh(options)?;
    let mut mesh = crate::mesh::read::read_precise(&path, access)?;
    let pose = options.mesh_pose.or(description.mesh_pose);
    scale::place(&path, &mut mesh, pose, options.mesh_scale, &description.frames)?;
    let origin = scale::origin(&mesh);
    if origin != [0.0; 3] {
        scale::move_origin(description, origin);
        let [x, y, z] = origin;
        warnings.push(format!(
            "the coordinates are large for single precision: ({x}, {y}, {z}) is subtracted from mesh, cameras and lights"
        ));
    }
    let mesh = mesh.around(origin);
    crate::mesh::read::check_range(&path, &mesh)?;
    let (mesh, report) = crate::mesh::clean::clean(mesh);
    if mesh.triangles.is_empty() {
        return Err(Error::input(&path, "the mesh has only degenerate triangles"));
    }
    if !report.is_clean() {
        warnings.push(format!("{}: {report}", path.display()));
    }
    check_registration(&path, &mesh, &description.frames, warnings)?;
    Ok((mesh, origin))
}

fn check_beta(description: &CaptureDescription, beta: Option<[f64; 3]>, crossed: bool) -> Result<()> {
    if let Some(beta) = beta
        && !beta.iter().all(|b| b.is_finite() && *b > 0.0)
    {
        return Err(Error::parameter(format!("beta should be positive for each colour, it is {beta:?}")));
    }
    if crossed && beta.is_none() {
        return Err(Error::input(
            &description.path,
            "there are cross photographs but no white_reference with cross_file_path: add one, or give the board's on / off \
             ratio of red, green and blue with option `beta` (0.5 where polarisers are ideal and the light's stays in place)",
        ));
    }
    Ok(())
}

/// Projections of vertices into pictures that are tried, at most.
const MAX_PROJECTIONS: usize = 20_000_000;
/// Below this share of vertices in any picture the user is warned.
const FEW_IN_VIEW: f64 = 0.02;

/// Checks that the cameras look at the mesh at all: the commonest mistake is a mesh in other coordinates.
fn check_registration(path: &Path, mesh: &Mesh, frames: &[FrameDescription], warnings: &mut Vec<String>) -> Result<()> {
    let in_view = |p: [f64; 3]| {
        frames.iter().any(|frame| {
            let camera = &frame.view.camera;
            let inside =
                |[x, y]: [f64; 2]| (0.0..camera.width as f64).contains(&x) && (0.0..camera.height as f64).contains(&y);
            camera.project(p).is_some_and(|(pixel, _)| inside(pixel))
        })
    };
    // Of large meshes every so many vertices say enough.
    let stride = (mesh.positions.len().saturating_mul(frames.len()) / MAX_PROJECTIONS).max(1);
    let asked = mesh.positions.len().div_ceil(stride);
    let seen = mesh.positions.iter().step_by(stride).filter(|p| in_view(p.map(f64::from))).count();
    if seen == 0 {
        // A few large triangles may fill the pictures without a corner in them.
        let met = frames.iter().take(64).any(|frame| {
            let camera = &frame.view.camera;
            let centre = glam::DVec3::from_array(camera.centre());
            (0..25).any(|n| {
                let [u, v] = [n % 5, n / 5].map(|step| (step as f64 + 0.5) / 5.0);
                let pixel = [u * camera.width as f64, v * camera.height as f64];
                let direction = glam::DVec3::from_array(camera.ray(pixel));
                mesh.triangles.iter().take(2000).any(|triangle| ray_meets(mesh, triangle, centre, direction))
            })
        });
        if met {
            return Ok(());
        }
        return Err(Error::input(
            path,
            format!(
                "none of the mesh's {} vertices projects into any of the {} pictures: check its coordinate system and unit, or \
                 register it with `capture::align`",
                mesh.positions.len(),
                frames.len()
            ),
        ));
    }
    let share = seen as f64 / asked as f64;
    if share < FEW_IN_VIEW {
        warnings.push(format!(
            "only {:.2} % of the mesh's vertices project into any picture: is it registered to this capture?",
            100.0 * share
        ));
    }
    Ok(())
}

/// Returns `true` if a ray meets a triangle from either side (Moeller and Trumbore 1997).
fn ray_meets(mesh: &Mesh, triangle: &[u32; 3], origin: glam::DVec3, direction: glam::DVec3) -> bool {
    let [a, b, c] = triangle.map(|v| glam::DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let determinant = ab.dot(across);
    let from_a = origin - a;
    let u = from_a.dot(across) / determinant;
    let beside = from_a.cross(ab);
    let v = direction.dot(beside) / determinant;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && ac.dot(beside) / determinant > 0.0
}
