//! Light from all around, and images of files.

use crate::arrays::{ColourArray, from_image, to_image};
use crate::errors::raise;
use crate::source::{detached, limits};
use numpy::PyArray3;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;
use tsuya::input::FileAccess;
use tsuya::lighting::{EnvironmentMap, EnvironmentReadOptions, read_environment};

/// Light from all around, infinitely far.
///
/// Made from an image of linear radiance (height, width, 3), twice as wide as high: rows from +Y to -Y, columns from -Z over +X, +Z and -X.
/// ``Environment.read`` reads files.
#[pyclass(frozen, module = "tsuya")]
pub struct Environment(pub Arc<EnvironmentMap>);

#[pymethods]
impl Environment {
    #[new]
    fn new(radiance: ColourArray<'_>) -> PyResult<Self> {
        let (environment, cleaned) = EnvironmentMap::new(to_image("radiance", &radiance)?).map_err(raise)?;
        match cleaned.negative + cleaned.not_finite {
            0 => Ok(Environment(Arc::new(environment))),
            count => Err(PyValueError::new_err(format!("{count} values of the radiance are below 0 or not finite"))),
        }
    }

    /// Reads an environment: OpenEXR, Radiance HDR, PNG, JPEG or TIFF; 2:1 latitude and longitude, a cube or a mirror ball. Negative and
    /// missing pixels are replaced.
    #[staticmethod]
    #[pyo3(signature = (path, *, memory_bytes=None))]
    fn read(py: Python<'_>, path: PathBuf, memory_bytes: Option<u64>) -> PyResult<Self> {
        let options = EnvironmentReadOptions { limits: limits(memory_bytes), ..Default::default() };
        let environment = detached(py, || Ok(read_environment(&[path], &options)?.0))?;
        Ok(Environment(Arc::new(environment)))
    }

    /// The same light, brighter by a factor and turned about +Y.
    #[pyo3(signature = (*, scale=1.0, degrees=0.0))]
    fn turned(&self, scale: f32, degrees: f64) -> PyResult<Self> {
        if !(scale.is_finite() && scale >= 0.0 && degrees.is_finite()) {
            return Err(PyValueError::new_err("scale is finite and not below 0, degrees are finite"));
        }
        let scaled = self.0.scaled(scale);
        Ok(Environment(Arc::new(if degrees == 0.0 { scaled } else { scaled.rotated_y(degrees) })))
    }

    /// Linear radiance: (height, width, 3), float32.
    #[getter]
    fn radiance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        from_image(py, self.0.image().clone())
    }

    fn __repr__(&self) -> String {
        format!("Environment({} x {})", self.0.image().width, self.0.image().height)
    }
}

/// Reads an image as linear radiance (height, width, 3), float32: OpenEXR, Radiance HDR, PNG, JPEG or TIFF. ``color_space`` is that of
/// integers: "srgb", "linear", "rec709" or whatever else a capture may state.
#[pyfunction]
#[pyo3(signature = (path, *, color_space="srgb", memory_bytes=None))]
pub fn read_image<'py>(
    py: Python<'py>,
    path: PathBuf,
    color_space: &str,
    memory_bytes: Option<u64>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let access = FileAccess::new(limits(memory_bytes));
    let image = detached(py, || tsuya::image::read_linear_image(&path, &access, color_space))?;
    from_image(py, image)
}
