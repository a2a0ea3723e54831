//! From a capture to a file.

use crate::camera::PointLight;
use crate::capture::{Capture, Reading};
use crate::source::detached;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use pythonize::{depythonize, pythonize};
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use tsuya::capture::open;
use tsuya::encoder::EncodedFile;
use tsuya::metrics::ImagePsnr;
use tsuya::{
    CaptureLight, DecodeSpeed, EncodeOptions, EncodeTarget, Profile, Refinement, SpecularModel,
    encode as encode_capture,
};

/// An encoded file and its figures.
#[pyclass(frozen, module = "tsuya")]
pub struct Encoded(EncodedFile);

#[pymethods]
impl Encoded {
    /// The file.
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.bytes)
    }
    /// Bytes of each section by its four letters, in the file's order.
    #[getter]
    fn sections<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let sections = PyDict::new(py);
        self.0.sections.iter().try_for_each(|(tag, bytes)| sections.set_item(tag, bytes))?;
        Ok(sections)
    }
    /// PSNR of the photographs as a decoder gives them back, in dB: "sum" of all components, and "diffuse" and "specular" where there are both.
    /// Without those where nothing differs or nothing was compared.
    #[getter]
    fn psnr<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let ImagePsnr { diffuse, specular, sum } = self.0.image_psnr;
        let figures = PyDict::new(py);
        for (name, db) in [("sum", sum), ("diffuse", diffuse), ("specular", specular)] {
            if let Some(db) = db {
                figures.set_item(name, db)?;
            }
        }
        Ok(figures)
    }
    /// Share of the masks' pixels that the mesh covers, 0 to 1: what it does not cover is not in the file.
    #[getter]
    fn coverage(&self) -> f64 {
        self.0.coverage
    }
    /// Light that was assumed, where ``light`` asked for it: a dict, or None.
    #[getter]
    fn assumed_light<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &self.0.assumed_light)?)
    }
    /// What was found wrong and did not stop the work: sentences.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.clone()
    }
    fn __len__(&self) -> usize {
        self.0.bytes.len()
    }
    fn __repr__(&self) -> String {
        let psnr = self.0.image_psnr.sum.map_or(String::new(), |db| format!(", {db:.2} dB"));
        format!("Encoded({} bytes{psnr})", self.0.bytes.len())
    }
}

/// Encodes a capture: a path (a folder, its transforms.json, a COLMAP model, cameras of other programs), or a Capture made of arrays.
///
/// One of ``quality`` (0 to 100, 75 by default), ``psnr`` (dB, at least), ``max_bytes``, ``max_error`` (of ``sqrt(x / white)``) and
/// ``keep_percent`` (profile "wavelet-texture") is the bound to reach. ``profile`` is "predictive" or "wavelet-texture", ``decode_speed``
/// "automatic", "normal", "fast" or "fastest", ``specular`` "automatic", "torrance-sparrow", "dsbrdf" or "ggx", ``refine`` "automatic", "none" or
/// "surface". ``hold_out`` leaves every k-th view out. ``light`` is that of photographs whose light is unknown: "camera", "environment", a
/// PointLight, or a place. ``metadata`` is a dict of whatever the file should say of itself, such as title, licence, units, provenance.
/// ``check`` decodes the finished file and compares every photograph. The others say how the capture's files are read, as `tsuya help encode`
/// has them. The same input gives the same bytes, for any number of threads.
#[pyfunction]
#[pyo3(signature = (capture, *, quality=None, psnr=None, max_bytes=None, max_error=None, keep_percent=None, profile="predictive",
    decode_speed="automatic", specular="automatic", refine="automatic", hold_out=None, position_bits=None, light=None, metadata=None,
    check=true, mesh=None, mesh_scale=None, beta=None, color_space=None, invert_masks=false, unchecked=false, exif_exposure=false,
    allow_outside=false, memory_bytes=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn encode(
    py: Python<'_>,
    capture: &Bound<'_, PyAny>,
    quality: Option<f64>,
    psnr: Option<f64>,
    max_bytes: Option<u64>,
    max_error: Option<f64>,
    keep_percent: Option<f64>,
    profile: &str,
    decode_speed: &str,
    specular: &str,
    refine: &str,
    hold_out: Option<usize>,
    position_bits: Option<u8>,
    light: Option<&Bound<'_, PyAny>>,
    metadata: Option<&Bound<'_, PyDict>>,
    check: bool,
    mesh: Option<PathBuf>,
    mesh_scale: Option<f64>,
    beta: Option<[f64; 3]>,
    color_space: Option<String>,
    invert_masks: bool,
    unchecked: bool,
    exif_exposure: bool,
    allow_outside: bool,
    memory_bytes: Option<u64>,
) -> PyResult<Encoded> {
    let targets = [
        quality.map(EncodeTarget::Quality),
        psnr.map(EncodeTarget::PsnrDb),
        max_bytes.map(EncodeTarget::MaxBytes),
        max_error.map(EncodeTarget::MaxError),
        keep_percent.map(EncodeTarget::KeepPercent),
    ];
    let targets: Vec<EncodeTarget> = targets.into_iter().flatten().collect();
    if targets.len() > 1 {
        let message = "one of quality, psnr, max_bytes, max_error and keep_percent can be asked for";
        return Err(PyValueError::new_err(message));
    }
    let mut options = EncodeOptions {
        target: targets.first().copied(),
        profile: named("profile", profile, &PROFILES)?,
        decode_speed: named("decode_speed", decode_speed, &DECODE_SPEEDS)?,
        specular: named("specular", specular, &SPECULAR_MODELS)?,
        refine: named("refine", refine, &REFINEMENTS)?,
        hold_out,
        position_bits,
        light: light.map(capture_light).transpose()?,
        metadata: metadata.map_or(Ok(Default::default()), |metadata| from_dict("metadata", metadata))?,
        check,
        ..EncodeOptions::default()
    };
    let reading = Reading {
        mesh,
        mesh_scale,
        beta,
        color_space,
        invert_masks,
        unchecked,
        exif_exposure,
        allow_outside,
        memory_bytes,
    };
    let encoded = if let Ok(capture) = capture.cast::<Capture>() {
        let capture = capture.get().copied()?;
        detached(py, || encode_capture(capture, &options))?
    } else {
        let path: PathBuf = capture.extract().map_err(|_| PyTypeError::new_err("a capture is a path or a Capture"))?;
        let reading = reading.options();
        detached(py, || {
            let capture = open(&path, &reading)?;
            if capture.origin != [0.0; 3] {
                options.metadata.entry("origin").or_insert_with(|| serde_json::json!(capture.origin));
            }
            encode_capture(capture, &options)
        })?
    };
    Ok(Encoded(encoded))
}

const PROFILES: [(&str, Profile); 2] =
    [("predictive", Profile::Predictive), ("wavelet-texture", Profile::WaveletTexture)];
const DECODE_SPEEDS: [(&str, DecodeSpeed); 4] = [
    ("automatic", DecodeSpeed::Automatic),
    ("normal", DecodeSpeed::Normal),
    ("fast", DecodeSpeed::Fast),
    ("fastest", DecodeSpeed::Fastest),
];
const SPECULAR_MODELS: [(&str, SpecularModel); 4] = [
    ("automatic", SpecularModel::Automatic),
    ("torrance-sparrow", SpecularModel::TorranceSparrow),
    ("dsbrdf", SpecularModel::Dsbrdf),
    ("ggx", SpecularModel::GgxLobes),
];
const REFINEMENTS: [(&str, Refinement); 3] =
    [("automatic", Refinement::Automatic), ("none", Refinement::None), ("surface", Refinement::Surface)];

/// What a dict says, in Rust.
pub fn from_dict<T: DeserializeOwned>(argument: &str, given: &Bound<'_, PyDict>) -> PyResult<T> {
    depythonize(given).map_err(|error| PyValueError::new_err(format!("{argument}: {error}")))
}

/// The value of a name.
pub fn named<T: Copy>(argument: &str, given: &str, known: &[(&str, T)]) -> PyResult<T> {
    match known.iter().find(|(name, _)| *name == given) {
        Some((_, value)) => Ok(*value),
        None => {
            let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
            Err(PyValueError::new_err(format!("{argument} is '{given}': there are {}", names.join(", "))))
        }
    }
}

/// Light of photographs whose light is unknown.
fn capture_light(given: &Bound<'_, PyAny>) -> PyResult<CaptureLight> {
    if let Ok(PointLight(light)) = given.extract() {
        return Ok(CaptureLight::Lamp { position: light.position, intensity: Some(light.intensity) });
    }
    if let Ok(position) = given.extract::<[f64; 3]>() {
        return Ok(CaptureLight::Lamp { position, intensity: None });
    }
    match given.extract::<String>().as_deref() {
        Ok("camera") => Ok(CaptureLight::Camera { offset: None, intensity: None }),
        Ok("environment") => Ok(CaptureLight::Environment { mean_radiance: None }),
        _ => Err(PyValueError::new_err("light is 'camera', 'environment', a PointLight or a place (x, y, z)")),
    }
}
