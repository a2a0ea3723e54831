//! Materials: measured, fitted and modelled.

use crate::arrays::{RowArray, from_rows, to_rows};
use crate::encode::{from_dict, named};
use crate::errors::raise;
use crate::source::{detached, limits};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use pythonize::pythonize;
use std::path::PathBuf;
use std::sync::Arc;
use tsuya::brdf::{
    Brdf, BrdfForm, ClassicalModel, FitSettings, FittedBrdf, FittedMaterial, MaterialPrior, MeasuredSample,
    MeasuredSamples, MerlTable, NamedMaterial, PlanMethod, Population, RglMaterial, albedo, fit_measured, fit_table,
    goniometer_rows, log_rmse,
};
use tsuya::container::Metadata;
use tsuya::input::FileAccess;

/// A material: a bidirectional reflectance distribution function.
///
/// Made by ``tsuya.brdf.read`` (measured), ``tsuya.brdf.fit`` (fitted), ``Material.classical`` (a model's numbers), or taken from
/// ``Asset.materials``.
#[pyclass(frozen, module = "tsuya.brdf")]
#[derive(Clone)]
pub struct Material {
    /// What it is called.
    #[pyo3(get)]
    name: String,
    kind: Arc<Kind>,
}

enum Kind {
    Merl(MerlTable),
    Rgl(Box<RglMaterial>),
    Coded(FittedMaterial),
}

impl Kind {
    fn table(&self) -> MerlTable {
        match self {
            Kind::Merl(table) => table.clone(),
            Kind::Rgl(material) => MerlTable::tabulate(&material.reciprocal()),
            Kind::Coded(material) => MerlTable::tabulate(material),
        }
    }
}

impl Brdf for Kind {
    /// Between the samples of a table.
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self {
            Kind::Merl(table) => table.interpolated().evaluate(incoming, outgoing),
            Kind::Rgl(material) => material.evaluate(incoming, outgoing),
            Kind::Coded(material) => material.evaluate(incoming, outgoing),
        }
    }
}

impl Material {
    /// One that a file holds.
    pub fn of_file(named: NamedMaterial) -> Self {
        Material { name: named.name, kind: Arc::new(Kind::Coded(named.material)) }
    }

    fn of_fit(name: String, fitted: FittedBrdf) -> Self {
        let material = match fitted {
            FittedBrdf::Coded(material) => material,
            FittedBrdf::Classical(model) => FittedMaterial::Classical(model),
        };
        Material { name, kind: Arc::new(Kind::Coded(material)) }
    }
}

#[pymethods]
impl Material {
    /// A material of a classical model, from a dict: ``{"diffuse": [r, g, b], "specular": [r, g, b], "lobe": {"model": "cook-torrance-ggx",
    /// "roughness": 0.2, "reflectance": 0.04}}``, as ``parameters`` gives it.
    #[staticmethod]
    #[pyo3(signature = (parameters, *, name="material"))]
    fn classical(parameters: &Bound<'_, PyDict>, name: &str) -> PyResult<Self> {
        let model: ClassicalModel = from_dict("parameters", parameters)?;
        model.check().map_err(raise)?;
        Ok(Material::of_fit(name.to_owned(), FittedBrdf::Classical(model)))
    }

    /// "merl" or "rgl" of measured materials; the form of fitted and modelled ones.
    #[getter]
    fn form(&self) -> &'static str {
        match &*self.kind {
            Kind::Merl(_) => "merl",
            Kind::Rgl(_) => "rgl",
            Kind::Coded(material) => material.form(),
        }
    }

    /// Bytes of a fitted or modelled material in a file; None of a measured one.
    #[getter]
    fn coded_bytes(&self) -> Option<usize> {
        match &*self.kind {
            Kind::Coded(material) => Some(material.encode().len()),
            _ => None,
        }
    }

    /// Parameters of a classical model as a dict; None of others.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        match &*self.kind {
            Kind::Coded(FittedMaterial::Classical(model)) => Ok(Some(pythonize(py, model)?)),
            _ => Ok(None),
        }
    }

    /// Values per steradian (count, 3), red, green, blue, without the cosine, for light from ``incoming`` seen from ``outgoing``: (count, 3)
    /// each, unit vectors from the surface, z along its normal. 0 where a direction is at or below the horizon.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        incoming: RowArray<'py, f64>,
        outgoing: RowArray<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pairs = directions(&incoming, &outgoing)?;
        let values = py.detach(|| pairs.iter().map(|&[i, o]| self.kind.evaluate(i, o)).collect());
        from_rows(py, values)
    }

    /// Share of the light from all around that is reflected towards a viewer at this angle from the normal, in degrees: (3,).
    #[pyo3(signature = (degrees=0.0))]
    fn albedo<'py>(&self, py: Python<'py>, degrees: f64) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if !(0.0..90.0).contains(&degrees) {
            return Err(PyValueError::new_err("degrees go from 0 to below 90"));
        }
        let share = py.detach(|| albedo(&*self.kind, degrees.to_radians()));
        Ok(PyArray1::from_slice(py, &share))
    }

    fn __repr__(&self) -> String {
        format!("Material({}: {})", self.name, self.form())
    }
}

/// Pairs of unit vectors, light first.
fn directions(incoming: &RowArray<'_, f64>, outgoing: &RowArray<'_, f64>) -> PyResult<Vec<[[f64; 3]; 2]>> {
    let (incoming, outgoing) = (to_rows("incoming", incoming)?, to_rows("outgoing", outgoing)?);
    if incoming.len() != outgoing.len() {
        return Err(PyValueError::new_err("incoming and outgoing have the same number of rows"));
    }
    let unit = |v: [f64; 3]| {
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        (length.is_finite() && length > 0.0).then(|| v.map(|x| x / length))
    };
    let pairs = incoming.into_iter().zip(outgoing).map(|(i, o)| Some([unit(i)?, unit(o)?]));
    pairs.collect::<Option<_>>().ok_or_else(|| PyValueError::new_err("directions are finite and not zero"))
}

/// Reads a measured material: a MERL table (.binary) or an isotropic RGL material (.bsdf).
#[pyfunction]
#[pyo3(signature = (path, *, memory_bytes=None))]
pub fn read_material(py: Python<'_>, path: PathBuf, memory_bytes: Option<u64>) -> PyResult<Material> {
    let access = FileAccess::new(limits(memory_bytes));
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let kind = match extension.as_str() {
        "binary" => Kind::Merl(detached(py, || MerlTable::read(&path, &access))?),
        "bsdf" => Kind::Rgl(Box::new(detached(py, || RglMaterial::read(&path, &access))?)),
        _ => {
            let message = "a measured material's name ends with .binary (MERL) or .bsdf (RGL)";
            return Err(PyValueError::new_err(format!("{}: {message}", path.display())));
        }
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Material { name, kind: Arc::new(kind) })
}

/// A fitted material and how far it is from what was measured.
#[pyclass(frozen, module = "tsuya.brdf")]
pub struct Fit {
    material: Material,
    /// Root mean square of the differences of ``log(1 + f cos)``, over a table's cells or the measured values.
    #[pyo3(get)]
    log_rmse: f64,
    /// The same as it is expected over a whole table, where only some values were measured; else None.
    #[pyo3(get)]
    expected_log_rmse: Option<f64>,
    /// What is odd about the measured values: sentences.
    #[pyo3(get)]
    warnings: Vec<String>,
}

#[pymethods]
impl Fit {
    /// The material.
    #[getter]
    fn material(&self) -> Material {
        self.material.clone()
    }
    fn __repr__(&self) -> String {
        format!("Fit({}: {}, log RMSE {:.4})", self.material.name, self.material.form(), self.log_rmse)
    }
}

/// Fits a material to measurements: a Material that was read, a path of measured values (.csv, .json), or a tuple (incoming, outgoing, values) of
/// arrays (count, 3), directions as in ``Material.evaluate``.
///
/// ``form`` is "compact" (the least error for its bytes, ``max_bytes`` of them), "dsbrdf" or a classical model: "lambert", "blinn-phong",
/// "cook-torrance-beckmann", "cook-torrance-ggx", "ward", "ashikhmin-shirley", "lafortune". ``noise`` is the relative standard deviation of
/// values that are given as arrays (0.02 by default). Between the measured angles the fit follows ``population``, Materials like the one that was measured (by
/// default classical models).
#[pyfunction]
#[pyo3(signature = (measured, form="compact", *, max_bytes=256, noise=None, population=None, name=None, memory_bytes=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn fit_material(
    py: Python<'_>,
    measured: &Bound<'_, PyAny>,
    form: &str,
    max_bytes: u16,
    noise: Option<f64>,
    population: Option<Vec<Bound<'_, Material>>>,
    name: Option<String>,
    memory_bytes: Option<u64>,
) -> PyResult<Fit> {
    let form = BrdfForm::from_name(form).ok_or_else(|| {
        let known: Vec<&str> = BrdfForm::all().into_iter().map(BrdfForm::name).collect();
        PyValueError::new_err(format!("no form '{form}'; there are {}", known.join(", ")))
    })?;
    if !(32..=4096).contains(&max_bytes) {
        return Err(PyValueError::new_err("max_bytes goes from 32 to 4096"));
    }
    let mut settings = FitSettings::default();
    settings.compact.bytes = max_bytes.into();
    if let Ok(material) = measured.cast::<Material>() {
        let material = material.get();
        let (fitted, log_rmse) = detached(py, || {
            let table = material.kind.table();
            let fitted = fit_table(&table, form, &settings)?;
            let error = log_rmse(&table, &fitted);
            Ok((fitted, error))
        })?;
        let material = Material::of_fit(name.unwrap_or_else(|| material.name.clone()), fitted);
        return Ok(Fit { material, log_rmse, expected_log_rmse: None, warnings: Vec::new() });
    }
    let (samples, warnings, stem) =
        measured_samples(py, measured, noise.unwrap_or(MeasuredSamples::ASSUMED_NOISE), memory_bytes)?;
    let population: Option<Vec<Arc<Kind>>> =
        population.map(|materials| materials.iter().map(|material| material.get().kind.clone()).collect());
    let fit = detached(py, || {
        let prior: MaterialPrior = match &population {
            Some(materials) => gather(materials)?.prior()?,
            None => Population::of_classical_models().prior()?,
        };
        fit_measured(&samples, &prior, form, &settings)
    })?;
    let material = Material::of_fit(name.unwrap_or(stem), fit.fitted);
    let (log_rmse, expected_log_rmse) = (fit.log_rmse_at_samples, Some(fit.expected_log_rmse));
    Ok(Fit { material, log_rmse, expected_log_rmse, warnings })
}

/// Values out of a file or arrays, what is odd about them, and their name.
fn measured_samples(
    py: Python<'_>,
    measured: &Bound<'_, PyAny>,
    noise: f64,
    memory_bytes: Option<u64>,
) -> PyResult<(Vec<MeasuredSample>, Vec<String>, String)> {
    if let Ok((incoming, outgoing, values)) =
        measured.extract::<(RowArray<'_, f64>, RowArray<'_, f64>, RowArray<'_, f64>)>()
    {
        let pairs = directions(&incoming, &outgoing)?;
        let values: Vec<[f64; 3]> = to_rows("values", &values)?;
        if values.len() != pairs.len() {
            return Err(PyValueError::new_err("there is a value for each pair of directions"));
        }
        let is_wrong = |value: &f64| !(value.is_finite() && *value >= 0.0);
        if values.as_flattened().iter().any(is_wrong) || is_wrong(&noise) {
            return Err(PyValueError::new_err("values and noise are finite and not below 0"));
        }
        if pairs.as_flattened().iter().any(|direction| direction[2] <= 0.0) {
            return Err(PyValueError::new_err("all directions are above the horizon: z along the normal, above 0"));
        }
        let sample = |([incoming, outgoing], value): ([[f64; 3]; 2], [f64; 3])| MeasuredSample {
            incoming,
            outgoing,
            value,
            deviation: value.map(|value| noise * value),
        };
        return Ok((pairs.into_iter().zip(values).map(sample).collect(), Vec::new(), "measured".into()));
    }
    let path: PathBuf = measured.extract().map_err(|_| {
        PyTypeError::new_err("measurements are a Material, a path, or arrays (incoming, outgoing, values)")
    })?;
    let read = detached(py, || MeasuredSamples::read(&path, &FileAccess::new(limits(memory_bytes))))?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok((read.samples, read.remarks, stem))
}

/// Materials as a population.
fn gather(materials: &[Arc<Kind>]) -> tsuya::Result<Population> {
    let mut population = Population::new();
    for material in materials {
        match &**material {
            Kind::Merl(table) => population.add(table)?,
            // Only the cells that are asked for are evaluated, not a whole table.
            Kind::Rgl(rgl) => add(&mut population, &rgl.reciprocal())?,
            Kind::Coded(coded) => add(&mut population, coded)?,
        }
    }
    Ok(population)
}

fn add(population: &mut Population, material: &impl Brdf) -> tsuya::Result<()> {
    population.add_values(|_, angles| {
        let (incoming, outgoing) = angles.directions();
        Some(material.evaluate(incoming, outgoing))
    })
}

/// Plans which directions to measure a material at that is like those of ``population``, ``count`` of them.
///
/// ``method`` is "optimal" (each where it lowers the expected error most), "variance" or "uniform". Returns a dict: ``incoming`` and
/// ``outgoing`` (count, 3), unit vectors in an order that moves a goniometer little, and ``expected_log_rmse``.
#[pyfunction]
#[pyo3(signature = (population, count, *, method="optimal"))]
pub fn plan_measurements<'py>(
    py: Python<'py>,
    population: Vec<Bound<'py, Material>>,
    count: usize,
    method: &str,
) -> PyResult<Bound<'py, PyDict>> {
    const METHODS: [(&str, PlanMethod); 3] =
        [("optimal", PlanMethod::Optimal), ("variance", PlanMethod::Variance), ("uniform", PlanMethod::Uniform)];
    let method = named("method", method, &METHODS)?;
    let materials: Vec<Arc<Kind>> = population.iter().map(|material| material.get().kind.clone()).collect();
    let plan = detached(py, || gather(&materials)?.plan(count, method))?;
    let rows = goniometer_rows(&plan.angles);
    let (incoming, outgoing) = rows.iter().map(|row| row.directions()).unzip::<_, _, Vec<_>, Vec<_>>();
    let result = PyDict::new(py);
    result.set_item("incoming", from_rows(py, incoming)?)?;
    result.set_item("outgoing", from_rows(py, outgoing)?)?;
    result.set_item("expected_log_rmse", plan.expected_log_rmse)?;
    Ok(result)
}

/// Returns a ``.tsuya`` file of fitted or modelled materials, each under its name; ``metadata`` is what the file says of itself.
#[pyfunction]
#[pyo3(signature = (materials, *, metadata=None))]
pub fn encode_materials<'py>(
    py: Python<'py>,
    materials: Vec<Bound<'py, Material>>,
    metadata: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyBytes>> {
    let coded = |material: &Bound<'_, Material>| match &*material.get().kind {
        Kind::Coded(coded) => Ok(NamedMaterial { name: material.get().name.clone(), material: coded.clone() }),
        _ => Err(PyTypeError::new_err("a measured material is fitted before it is written: tsuya.brdf.fit")),
    };
    let materials = materials.iter().map(coded).collect::<PyResult<Vec<_>>>()?;
    let metadata = Metadata(metadata.map_or(Ok(Default::default()), |metadata| from_dict("metadata", metadata))?);
    Ok(PyBytes::new(py, &tsuya::encoder::encode_materials(&materials, &metadata).map_err(raise)?))
}
