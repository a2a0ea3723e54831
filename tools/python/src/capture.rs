//! Captures: out of files, or made of arrays.

use crate::arrays::{ColourArray, MaskArray, RowArray, to_image, to_mask, to_rows};
use crate::camera::{Camera, PointLight};
use crate::source::{detached, limits};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pythonize::pythonize;
use serde_json::json;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use tsuya::capture::{self, CaptureFrame, CaptureReadOptions, Clipping, OpenCapture};
use tsuya::mesh::clean;
use tsuya::{Mesh, View};

/// Photographs, cameras and a mesh in memory, to be encoded.
///
/// ``positions`` (vertices, 3) and ``triangles`` (triangles, 3) are the mesh, in the units of the cameras; triangles are counter-clockwise from
/// outside. ``white`` is the radiance of a white board under the light (1 by default). ``beta`` is the ratio of what crossed polarisers let through of
/// diffuse light, 0.5 for linear ones; photographs with ``cross`` need it.
#[pyclass(frozen, module = "tsuya")]
pub struct Capture(Mutex<capture::Capture>);

#[pymethods]
impl Capture {
    #[new]
    #[pyo3(signature = (positions, triangles, *, name="capture", white=None, beta=None))]
    fn new(
        positions: RowArray<'_, f32>,
        triangles: RowArray<'_, i64>,
        name: &str,
        white: Option<[f64; 3]>,
        beta: Option<[f64; 3]>,
    ) -> PyResult<Self> {
        let positions = to_rows("positions", &positions)?;
        let count = positions.len();
        let vertex = |index: i64| u32::try_from(index).ok().filter(|&index| (index as usize) < count);
        let triangle = |[a, b, c]: [i64; 3]| Some([vertex(a)?, vertex(b)?, vertex(c)?]);
        let triangles: Option<Vec<[u32; 3]>> = to_rows("triangles", &triangles)?.into_iter().map(triangle).collect();
        let Some(triangles) = triangles else {
            return Err(PyValueError::new_err(format!("triangles name vertices from 0 to {}", count.max(1) - 1)));
        };
        if positions.as_flattened().iter().any(|x| !x.is_finite()) {
            return Err(PyValueError::new_err("positions are finite"));
        }
        let white = white.unwrap_or([1.0; 3]);
        if white.iter().chain(beta.iter().flatten()).any(|x| !(x.is_finite() && *x > 0.0)) {
            return Err(PyValueError::new_err("white and beta are finite and above 0"));
        }
        let (mesh, report) = clean(Mesh { positions, triangles });
        if mesh.triangles.is_empty() {
            return Err(PyValueError::new_err("the mesh has no triangle with an area"));
        }
        let warnings = if report.is_clean() { Vec::new() } else { vec![report.to_string()] };
        Ok(Capture(Mutex::new(capture::Capture {
            name: name.to_owned(),
            frames: Vec::new(),
            mesh,
            origin: [0.0; 3],
            white,
            beta,
            color_space: "linear-rec709".into(),
            warnings,
            skipped_frames: 0,
            missing_pixels: 0,
            clipping: Clipping::default(),
        })))
    }

    /// Adds a photograph: linear radiance (height, width, 3), as large as the camera says; not a number where it is missing.
    ///
    /// ``cross`` is the photograph of the same view through crossed polarisers, which all have or none. ``mask`` (height, width) is True where the
    /// object is. ``light`` is the lamp, where it is known.
    #[pyo3(signature = (name, camera, photograph, *, cross=None, mask=None, light=None))]
    fn add(
        &self,
        name: &str,
        camera: Camera,
        photograph: ColourArray<'_>,
        cross: Option<ColourArray<'_>>,
        mask: Option<MaskArray<'_>>,
        light: Option<PointLight>,
    ) -> PyResult<()> {
        let frame = CaptureFrame {
            view: View { name: name.to_owned(), camera: camera.0, light: light.map(|light| light.0) },
            photograph: to_image("photograph", &photograph)?,
            cross: cross.map(|cross| to_image("cross", &cross)).transpose()?,
            mask: mask.map(|mask| to_mask(&mask)),
        };
        let mut capture = self.lock();
        if capture.frames.iter().any(|other| other.view.name == name) {
            return Err(PyValueError::new_err(format!("there is a photograph called '{name}' already")));
        }
        if capture.frames.first().is_some_and(|first| first.cross.is_some() != frame.cross.is_some()) {
            return Err(PyValueError::new_err("either all photographs have one through crossed polarisers or none"));
        }
        frame.check().map_err(crate::errors::raise)?;
        capture.frames.push(frame);
        Ok(())
    }

    fn __len__(&self) -> usize {
        self.lock().frames.len()
    }

    fn __repr__(&self) -> String {
        let capture = self.lock();
        format!(
            "Capture({}: {} photographs, {} triangles)",
            capture.name,
            capture.frames.len(),
            capture.mesh.triangles.len()
        )
    }
}

impl Capture {
    fn lock(&self) -> MutexGuard<'_, capture::Capture> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is encoded, a copy.
    pub fn copied(&self) -> PyResult<OpenCapture> {
        let capture = self.lock();
        if capture.frames.is_empty() {
            return Err(PyValueError::new_err("the capture has no photograph: Capture.add adds one"));
        }
        Ok(capture.clone().into())
    }
}

/// What is said of a capture that is read from files.
#[derive(Default)]
pub struct Reading {
    pub mesh: Option<PathBuf>,
    pub mesh_scale: Option<f64>,
    pub beta: Option<[f64; 3]>,
    pub color_space: Option<String>,
    pub invert_masks: bool,
    pub unchecked: bool,
    pub exif_exposure: bool,
    pub allow_outside: bool,
    pub memory_bytes: Option<u64>,
}

impl Reading {
    pub fn options(self) -> CaptureReadOptions {
        let Reading {
            mesh,
            mesh_scale,
            beta,
            color_space,
            invert_masks,
            unchecked,
            exif_exposure,
            allow_outside,
            memory_bytes,
        } = self;
        let (mesh_pose, limits) = (None, limits(memory_bytes));
        CaptureReadOptions {
            mesh,
            mesh_pose,
            mesh_scale,
            beta,
            color_space,
            invert_masks,
            unchecked,
            exif_exposure,
            limits,
            allow_outside,
        }
    }
}

/// Checks whether mesh, cameras, masks and photographs of a capture belong together.
///
/// Returns a dict: ``agrees``, ``faults`` (sentences that say what is wrong and which option mends it), ``agreement`` with the figures,
/// ``frames``, ``skipped_frames``, ``vertices``, ``triangles``, ``clipped_share``, ``warnings``. Raises InputError where the capture can't be read.
#[pyfunction]
#[pyo3(signature = (capture, *, mesh=None, mesh_scale=None, color_space=None, invert_masks=false, allow_outside=false, memory_bytes=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn check<'py>(
    py: Python<'py>,
    capture: PathBuf,
    mesh: Option<PathBuf>,
    mesh_scale: Option<f64>,
    color_space: Option<String>,
    invert_masks: bool,
    allow_outside: bool,
    memory_bytes: Option<u64>,
) -> PyResult<Bound<'py, PyAny>> {
    // As it is: what the check finds is told, not mended.
    let reading = Reading {
        unchecked: true,
        mesh,
        mesh_scale,
        color_space,
        invert_masks,
        allow_outside,
        memory_bytes,
        ..Reading::default()
    };
    let options = reading.options();
    let report = detached(py, || {
        let capture = capture::open(&capture, &options)?;
        let found = capture.agreement()?;
        Ok(json!({
            "agrees": !found.is_refused(),
            "faults": found.sentences(),
            "agreement": found,
            "frames": capture.views().len(),
            "skipped_frames": capture.skipped_frames,
            "vertices": capture.mesh.positions.len(),
            "triangles": capture.mesh.triangles.len(),
            "clipped_share": capture.clipping.share(),
            "warnings": capture.warnings,
        }))
    })?;
    Ok(pythonize(py, &report)?)
}
