//! Python module `tsuya._native`: what the package `tsuya` is made of. Each file is a group of its classes.
//!
//! Work that takes long is done without the interpreter's lock, so that other threads of Python go on meanwhile.

mod arrays;
mod asset;
mod brdf;
mod camera;
mod capture;
mod encode;
mod environment;
mod errors;
mod photograph;
mod render;
mod source;

use pyo3::pymodule;

/// The module; `tsuya/__init__.py` hands its content on.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::asset::{Asset, Mesh, Reflectance, View, open};
    #[pymodule_export]
    use crate::brdf::{Fit, Material, encode_materials, fit_material, plan_measurements, read_material};
    #[pymodule_export]
    use crate::camera::{Camera, PointLight};
    #[pymodule_export]
    use crate::capture::{Capture, check};
    #[pymodule_export]
    use crate::encode::{Encoded, encode};
    #[pymodule_export]
    use crate::environment::{Environment, read_image};
    #[pymodule_export]
    use crate::errors::{CheckError, Error, FormatError, InputError, LimitError, UnsupportedError};
    #[pymodule_export]
    use crate::photograph::{Photograph, Photographs};
    #[pymodule_export]
    use crate::render::Rendering;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
