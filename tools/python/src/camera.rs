//! Cameras and lamps.

use crate::arrays::{RowArray, from_rows, to_rows};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A pinhole camera in OpenCV's axes: x right, y down, z forward.
///
/// A world point ``p`` has camera coordinates ``q = rotation @ p + translation`` and the image position
/// ``focal * q[:2] / q[2] + principal`` in pixels; pixel (0, 0) covers 0 to 1, its centre is at 0.5.
#[pyclass(frozen, eq, from_py_object, module = "tsuya")]
#[derive(Clone, Copy, PartialEq)]
pub struct Camera(pub tsuya::Camera);

#[pymethods]
impl Camera {
    #[new]
    fn new(
        width: u32,
        height: u32,
        focal: [f64; 2],
        principal: [f64; 2],
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
    ) -> PyResult<Self> {
        let camera = tsuya::Camera { width, height, focal, principal, rotation, translation };
        Self(camera).checked()
    }

    /// The camera at ``position`` that looks at ``target``, with ``up`` (+Y by default) upwards in the image; ``fov`` is the field of view of the longer side
    /// in degrees.
    #[staticmethod]
    #[pyo3(signature = (position, target, *, width, height, up=None, fov=35.0))]
    fn look_at(
        position: [f64; 3],
        target: [f64; 3],
        width: u32,
        height: u32,
        up: Option<[f64; 3]>,
        fov: f64,
    ) -> PyResult<Self> {
        if !(1.0..=170.0).contains(&fov) {
            return Err(PyValueError::new_err("fov goes from 1 to 170 degrees"));
        }
        let focal = 0.5 * f64::from(width.max(height)) / (0.5 * fov.to_radians()).tan();
        Self(tsuya::relight::look_at(position, target, up.unwrap_or([0.0, 1.0, 0.0]), focal, width, height)).checked()
    }

    /// Width of the image in pixels.
    #[getter]
    fn width(&self) -> u32 {
        self.0.width
    }
    /// Height of the image in pixels.
    #[getter]
    fn height(&self) -> u32 {
        self.0.height
    }
    /// Focal lengths in pixels, across and down: (2,).
    #[getter]
    fn focal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.focal)
    }
    /// Principal point in pixels: (2,).
    #[getter]
    fn principal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.principal)
    }
    /// World to camera: (3, 3).
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, self.0.rotation.to_vec())
    }
    /// World to camera: (3,).
    #[getter]
    fn translation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.translation)
    }
    /// The camera's place in the world: (3,).
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.centre())
    }
    /// Intrinsic matrix: (3, 3).
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let tsuya::Camera { focal, principal, .. } = self.0;
        from_rows(py, vec![[focal[0], 0.0, principal[0]], [0.0, focal[1], principal[1]], [0.0, 0.0, 1.0]])
    }

    /// The same view in an image of another size.
    fn resized(&self, width: u32, height: u32) -> PyResult<Self> {
        let factor = [f64::from(width) / f64::from(self.0.width), f64::from(height) / f64::from(self.0.height)];
        Self(self.0.scaled([width, height], factor)).checked()
    }

    /// Image positions (count, 2) in pixels and depths (count,) of world points (count, 3); not a number behind the camera.
    fn project<'py>(
        &self,
        py: Python<'py>,
        points: RowArray<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)> {
        let points: Vec<[f64; 3]> = to_rows("points", &points)?;
        let projected = points.iter().map(|&point| self.0.project(point).unwrap_or(([f64::NAN; 2], f64::NAN)));
        let (positions, depths): (Vec<_>, Vec<_>) = projected.unzip();
        Ok((from_rows(py, positions)?, PyArray1::from_vec(py, depths)))
    }

    /// For copies and pickles.
    fn __getnewargs__(&self) -> (u32, u32, [f64; 2], [f64; 2], [[f64; 3]; 3], [f64; 3]) {
        let tsuya::Camera { width, height, focal, principal, rotation, translation } = self.0;
        (width, height, focal, principal, rotation, translation)
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.0.centre();
        format!("Camera({} x {} at {x:.4}, {y:.4}, {z:.4})", self.0.width, self.0.height)
    }
}

impl Camera {
    /// The camera, if it is one.
    fn checked(self) -> PyResult<Self> {
        let tsuya::Camera { width, height, focal, principal, rotation, translation } = self.0;
        let mut numbers = focal.iter().chain(&principal).chain(&translation).chain(rotation.as_flattened());
        if width == 0 || height == 0 || !numbers.all(|x| x.is_finite()) || focal.iter().any(|&f| f <= 0.0) {
            let message = "a camera has finite numbers, focal lengths above 0 and at least one pixel";
            return Err(PyValueError::new_err(message));
        }
        let row = |i: usize, j: usize| (0..3).map(|k| rotation[i][k] * rotation[j][k]).sum::<f64>();
        let is_orthonormal = (0..3).all(|i| (0..3).all(|j| (row(i, j) - f64::from(u8::from(i == j))).abs() < 1e-4));
        if !is_orthonormal {
            return Err(PyValueError::new_err("a camera's rotation has orthonormal rows, world to camera"));
        }
        Ok(self)
    }
}

/// A point light: irradiance at distance ``r`` is ``intensity / r ** 2``.
#[pyclass(frozen, eq, from_py_object, module = "tsuya")]
#[derive(Clone, Copy, PartialEq)]
pub struct PointLight(pub tsuya::PointLight);

#[pymethods]
impl PointLight {
    #[new]
    fn new(position: [f64; 3], intensity: [f64; 3]) -> PyResult<Self> {
        if !position.iter().chain(&intensity).all(|x| x.is_finite()) || intensity.iter().any(|&i| i < 0.0) {
            return Err(PyValueError::new_err("a light has a finite place and a finite intensity, not below 0"));
        }
        Ok(Self(tsuya::PointLight { position, intensity }))
    }
    /// Place in the world: (3,).
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.position)
    }
    /// Radiant intensity, red, green, blue: (3,).
    #[getter]
    fn intensity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.intensity)
    }
    /// For copies and pickles.
    fn __getnewargs__(&self) -> ([f64; 3], [f64; 3]) {
        (self.0.position, self.0.intensity)
    }
    fn __repr__(&self) -> String {
        let tsuya::PointLight { position: [x, y, z], intensity: [r, g, b] } = self.0;
        format!("PointLight(({x:.4}, {y:.4}, {z:.4}), ({r:.4}, {g:.4}, {b:.4}))")
    }
}
