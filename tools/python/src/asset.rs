//! Open files: what they hold is decoded when it is asked for.

use crate::arrays::{from_grid, from_image, from_rows};
use crate::brdf::Material;
use crate::camera::{Camera, PointLight};
use crate::environment::Environment;
use crate::errors::raise;
use crate::photograph::{Photograph, Photographs, component_name, decode_one};
use crate::render::{RenderArguments, Rendering, render};
use crate::source::{Source, detached, limits};
use numpy::{PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods};
use pyo3::exceptions::{PyIndexError, PyKeyError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyString, PyTuple};
use pythonize::pythonize;
use std::sync::{Arc, OnceLock};
use tsuya::container::{Tag, decode_thumbnail};
use tsuya::decoder::{DecodeOptions, ViewSelection, decode_from};
use tsuya::image::{Grid, Region};
use tsuya::{Limits, RenderMesh};

/// Opens a ``.tsuya`` file: a path, bytes, or anything with ``read()``.
///
/// Its metadata, views and mesh are decoded now, the rest when it is asked for. ``memory_bytes`` bounds what the file may ask for (4 GiB by
/// default). Raises OSError, FormatError, LimitError or UnsupportedError.
#[pyfunction]
#[pyo3(signature = (file, *, memory_bytes=None))]
pub fn open(py: Python<'_>, file: &Bound<'_, PyAny>, memory_bytes: Option<u64>) -> PyResult<Asset> {
    let (source, limits) = (Source::new(file)?, limits(memory_bytes));
    let opened = detached(py, move || {
        let mut file = source.open(limits)?;
        let sections = file.sections().iter().map(|section| (section.tag.to_string(), section.stored)).collect();
        let bytes = file.file_bytes();
        let selection = ViewSelection::None;
        let options = DecodeOptions { limits, selection, photographs_only: true, ..Default::default() };
        let outline = decode_from(&mut file, &options)?;
        let (model, whole) = Default::default();
        Ok(Opened { source, limits, sections, bytes, outline, model, whole })
    })?;
    Ok(Asset(Arc::new(opened)))
}

/// What an open file is made of.
struct Opened {
    source: Source,
    limits: Limits,
    /// Four letters and bytes.
    sections: Vec<(String, u64)>,
    bytes: u64,
    /// Metadata, views and mesh.
    outline: tsuya::Asset,
    /// All but the photographs, once it was asked for.
    model: OnceLock<tsuya::Asset>,
    /// With the photographs, once images were asked for.
    whole: OnceLock<tsuya::Asset>,
}

impl Opened {
    /// Decodes what was not decoded yet.
    fn decoded<'a>(
        &self,
        py: Python<'_>,
        slot: &'a OnceLock<tsuya::Asset>,
        selection: ViewSelection,
    ) -> PyResult<&'a tsuya::Asset> {
        if let Some(decoded) = slot.get() {
            return Ok(decoded);
        }
        let options = DecodeOptions { limits: self.limits, selection, ..Default::default() };
        let decoded = detached(py, || decode_from(&mut self.source.open(self.limits)?, &options))?;
        Ok(slot.get_or_init(|| decoded))
    }

    fn model(&self, py: Python<'_>) -> PyResult<&tsuya::Asset> {
        self.decoded(py, &self.model, ViewSelection::None)
    }

    /// Index of a view that is given as such, counted from the end where it is below 0, or by name.
    fn find(&self, wanted: &Bound<'_, PyAny>) -> PyResult<usize> {
        let views = &self.outline.views;
        if let Ok(view) = wanted.cast::<View>() {
            return Ok(view.get().index);
        }
        if let Ok(name) = wanted.cast::<PyString>() {
            let name = name.to_str()?;
            let found = views.iter().position(|view| view.name == name);
            return found.ok_or_else(|| PyKeyError::new_err(format!("no view called '{name}'")));
        }
        let given: isize = wanted.extract().map_err(|_| PyTypeError::new_err("a view is given by number or name"))?;
        let index = if given < 0 { given.checked_add_unsigned(views.len()).unwrap_or(-1) } else { given };
        let index = usize::try_from(index).ok().filter(|&index| index < views.len());
        let message = || format!("view {given} does not exist: the file has {} views", views.len());
        index.ok_or_else(|| PyIndexError::new_err(message()))
    }

    /// How photographs are decoded.
    fn options(&self, selection: ViewSelection, reduction: i64, region: Option<[i64; 4]>) -> PyResult<DecodeOptions> {
        let wrong = |message: &str| PyValueError::new_err(message.to_owned());
        let reduction = u8::try_from(reduction).map_err(|_| wrong("reduction goes from 0 to 5"))?;
        let number = |number: i64| {
            u32::try_from(number)
                .map_err(|_| wrong("region is (left, top, width, height), in pixels of the photograph"))
        };
        let region = match region {
            None => None,
            Some([left, top, width, height]) => {
                Some(Region { left: number(left)?, top: number(top)?, width: number(width)?, height: number(height)? })
            }
        };
        Ok(DecodeOptions { limits: self.limits, selection, reduction, region, photographs_only: true })
    }
}

/// An open ``.tsuya`` file.
#[pyclass(frozen, module = "tsuya")]
pub struct Asset(Arc<Opened>);

#[pymethods]
impl Asset {
    /// Title, licence, provenance, units, what the file states of its error, and whatever else it says of itself: a new dict.
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &self.0.outline.metadata)?)
    }

    /// Bytes of each section by its four letters, in the file's order.
    #[getter]
    fn sections<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let sections = PyDict::new(py);
        self.0.sections.iter().try_for_each(|(tag, bytes)| sections.set_item(tag, bytes))?;
        Ok(sections)
    }

    /// Size of the file in bytes.
    #[getter]
    fn file_bytes(&self) -> u64 {
        self.0.bytes
    }

    /// Names of the components of each photograph: ("diffuse", "specular") or ("combined",).
    #[getter]
    fn components<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.0.outline.components.iter().map(|&component| component_name(component)))
    }

    /// Radiance of the white board, red, green, blue: what is white in the photographs. (3,)
    #[getter]
    fn white<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.outline.white)
    }

    /// A small picture of the object, as the bytes of a PNG; None in a file without one.
    #[getter]
    fn thumbnail<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let content = detached(py, || self.0.source.open(self.0.limits)?.read_optional(Tag::THUMBNAIL))?;
        let thumbnail = content.map(decode_thumbnail).transpose().map_err(raise)?;
        Ok(thumbnail.map(|thumbnail| PyBytes::new(py, &thumbnail.png)))
    }

    /// The captured views: name, camera and light, and the photograph when it is asked for.
    #[getter]
    fn views<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let view = |index| Py::new(py, View { opened: self.0.clone(), index });
        PyTuple::new(py, (0..self.0.outline.views.len()).map(view).collect::<PyResult<Vec<_>>>()?)
    }

    /// A view by its number, counted from the end where it is below 0, or by its name.
    fn view(&self, which: &Bound<'_, PyAny>) -> PyResult<View> {
        Ok(View { opened: self.0.clone(), index: self.0.find(which)? })
    }

    /// Decodes photographs, of ``views`` (numbers or names; all by default), and hands them out one by one, as soon as they are done and
    /// in any order: memory does not grow with their number. ``reduction`` and ``region`` as in ``View.photograph``.
    #[pyo3(signature = (views=None, *, reduction=0, region=None))]
    fn photographs(
        &self,
        views: Option<&Bound<'_, PyAny>>,
        reduction: i64,
        region: Option<[i64; 4]>,
    ) -> PyResult<Photographs> {
        let selection = match views {
            None => ViewSelection::All,
            Some(views) => {
                let views = views.try_iter()?.map(|view| self.0.find(&view?));
                ViewSelection::Views(views.collect::<PyResult<_>>()?)
            }
        };
        Ok(Photographs::start(self.0.source.clone(), self.0.options(selection, reduction, region)?))
    }

    /// The mesh that the photographs are mapped on: positions and triangles.
    #[getter]
    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        Mesh::plain(py, &self.0.outline.mesh)
    }

    /// The mesh to draw: the finer surface where the file has one, with normals, tangents and the texture coordinates that the reflectance
    /// has; vertices are split where charts meet.
    #[getter]
    fn render_mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        let asset = self.0.model(py)?;
        let mesh = py.detach(|| {
            let surface = || RenderMesh::of_surface(&asset.mesh, asset.charts.as_ref()?, asset.surface.as_ref()?);
            let atlas = || asset.charts.as_ref().map(|charts| RenderMesh::with_atlas(&asset.mesh, charts));
            surface().or_else(atlas).unwrap_or_else(|| RenderMesh::without_atlas(&asset.mesh))
        });
        Mesh::to_draw(py, mesh)
    }

    /// The fitted reflectance as textures of ``render_mesh``; None in a file without one.
    #[getter]
    fn reflectance(&self, py: Python<'_>) -> PyResult<Option<Reflectance>> {
        self.0.model(py)?.reflectance.as_ref().map(|maps| Reflectance::new(py, maps)).transpose()
    }

    /// Materials that the file holds, by name.
    #[getter]
    fn materials<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let materials = PyDict::new(py);
        for named in &self.0.model(py)?.materials {
            materials.set_item(&named.name, Material::of_file(named.clone()))?;
        }
        Ok(materials)
    }

    /// Renders images of the object from a camera, or several.
    ///
    /// The light is that of the capture by default; ``lights`` are point lights, ``environment`` is light from all around. ``layers`` are
    /// those shown, of "diffuse", "specular", "model", "residual", "interreflection" (all by default). ``shadows`` says whether the
    /// object shadows itself. ``samples`` of a pixel along each side are 1 to 8 (1 by default, under an environment 2). Of a capture under
    /// several lights ``capture_light`` chooses one, 0 the most used. Returns a Rendering, or a list of them for a list of cameras. The
    /// decoded photographs stay in memory for further images.
    #[pyo3(signature = (camera, *, lights=None, environment=None, layers=None, shadows=true, samples=None, capture_light=0))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: &Bound<'py, PyAny>,
        lights: Option<Vec<PointLight>>,
        environment: Option<&Bound<'py, Environment>>,
        layers: Option<Vec<String>>,
        shadows: bool,
        samples: Option<u32>,
        capture_light: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let one = camera.extract::<Camera>().ok();
        let cameras = match &one {
            Some(camera) => vec![*camera],
            None => camera.extract().map_err(|_| PyTypeError::new_err("camera is a Camera or a list of them"))?,
        };
        let cameras: Vec<tsuya::Camera> = cameras.into_iter().map(|camera: Camera| camera.0).collect();
        let environment = environment.map(|environment| &*environment.get().0);
        if environment.is_some() && lights.is_some() {
            return Err(PyValueError::new_err("the light is either `lights` or `environment`"));
        }
        let lights = lights.map(|lights| lights.into_iter().map(|light| light.0).collect());
        let arguments = RenderArguments::new(lights, environment, layers.as_deref(), shadows, samples, capture_light)?;
        let selection = if arguments.layers.residual { ViewSelection::All } else { ViewSelection::None };
        let slot = if arguments.layers.residual { &self.0.whole } else { &self.0.model };
        let asset = self.0.decoded(py, slot, selection)?;
        let images = detached(py, || render(asset, &cameras, &arguments))?;
        let mut images = images.into_iter().map(|image| Rendering::new(py, image)).collect::<PyResult<Vec<_>>>()?;
        match one.and_then(|_| images.pop()) {
            Some(image) => Ok(Bound::new(py, image)?.into_any()),
            None => images.into_pyobject(py),
        }
    }

    fn __len__(&self) -> usize {
        self.0.outline.views.len()
    }

    fn __repr__(&self) -> String {
        let (views, triangles) = (self.0.outline.views.len(), self.0.outline.mesh.triangles.len());
        format!("Asset({}: {} views, {} triangles)", self.0.source.name(), views, triangles)
    }
}

/// A captured view.
#[pyclass(frozen, module = "tsuya")]
pub struct View {
    opened: Arc<Opened>,
    /// Number of the view in the file.
    #[pyo3(get)]
    index: usize,
}

impl View {
    fn view(&self) -> &tsuya::View {
        &self.opened.outline.views[self.index]
    }
}

#[pymethods]
impl View {
    /// Name of the photograph, as the capture calls it.
    #[getter]
    fn name(&self) -> &str {
        &self.view().name
    }
    /// Its camera.
    #[getter]
    fn camera(&self) -> Camera {
        Camera(self.view().camera)
    }
    /// Its light; None where it is not known.
    #[getter]
    fn light(&self) -> Option<PointLight> {
        self.view().light.map(PointLight)
    }

    /// Decodes the photograph; None where the file holds none of this view.
    ///
    /// ``reduction`` halves its size so often, 0 to 5, and nothing of the finer levels is read. ``region`` (left, top, width, height) is the
    /// part to decode, in pixels of that size. Only the bytes are read that this takes.
    #[pyo3(signature = (*, reduction=0, region=None))]
    fn photograph(&self, py: Python<'_>, reduction: i64, region: Option<[i64; 4]>) -> PyResult<Option<Photograph>> {
        let options = self.opened.options(ViewSelection::Views(vec![self.index]), reduction, region)?;
        decode_one(py, &self.opened.source, self.index, &options)
    }

    fn __repr__(&self) -> String {
        format!("View({}: {})", self.index, self.name())
    }
}

/// Vertices and triangles.
#[pyclass(frozen, module = "tsuya")]
pub struct Mesh {
    /// Positions: (vertices, 3), float32.
    #[pyo3(get)]
    positions: Py<PyArray2<f32>>,
    /// Vertices of each triangle, counter-clockwise from outside: (triangles, 3), uint32.
    #[pyo3(get)]
    triangles: Py<PyArray2<u32>>,
    /// Unit normals (vertices, 3), float32; None of a mesh that is not made to be drawn.
    #[pyo3(get)]
    normals: Option<Py<PyArray2<f32>>>,
    /// Tangents (vertices, 4), float32: the direction of growing u, and the sign with which normal x tangent points up in the texture; or None.
    #[pyo3(get)]
    tangents: Option<Py<PyArray2<f32>>>,
    /// Texture coordinates (vertices, 2), float32, 0 to 1, v downwards as the rows of the maps; or None.
    #[pyo3(get)]
    texture_coordinates: Option<Py<PyArray2<f32>>>,
}

impl Mesh {
    fn plain(py: Python<'_>, mesh: &tsuya::Mesh) -> PyResult<Self> {
        Ok(Mesh {
            positions: from_rows(py, mesh.positions.clone())?.unbind(),
            triangles: from_rows(py, mesh.triangles.clone())?.unbind(),
            normals: None,
            tangents: None,
            texture_coordinates: None,
        })
    }

    fn to_draw(py: Python<'_>, mesh: RenderMesh) -> PyResult<Self> {
        let has_atlas = !mesh.coordinates.is_empty();
        let of_atlas = |rows| -> PyResult<_> { Ok(Some(from_rows(py, rows)?.unbind())) };
        Ok(Mesh {
            positions: from_rows(py, mesh.positions)?.unbind(),
            triangles: from_rows(py, mesh.triangles)?.unbind(),
            normals: Some(from_rows(py, mesh.normals)?.unbind()),
            tangents: if has_atlas { Some(from_rows(py, mesh.tangents)?.unbind()) } else { None },
            texture_coordinates: if has_atlas { of_atlas(mesh.coordinates)? } else { None },
        })
    }
}

#[pymethods]
impl Mesh {
    /// The mesh as a ``trimesh.Trimesh``, vertices as they are; takes the package trimesh.
    fn to_trimesh<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let arguments = PyDict::new(py);
        arguments.set_item("vertices", &self.positions)?;
        arguments.set_item("faces", &self.triangles)?;
        arguments.set_item("vertex_normals", &self.normals)?;
        arguments.set_item("process", false)?;
        py.import("trimesh")?.call_method("Trimesh", (), Some(&arguments))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (vertices, triangles) = (self.positions.bind(py).len()?, self.triangles.bind(py).len()?);
        Ok(format!("Mesh({vertices} vertices, {triangles} triangles)"))
    }
}

/// Reflectance maps: textures of ``Asset.render_mesh``.
///
/// Under a point light of intensity L at the distance r the diffuse radiance is ``diffuse * L / r**2 * cos(theta_i)``; highlights are those
/// of Torrance and Sparrow with ``specular`` and ``sigma``, or the sum of GGX lobes (`spec/reflectance.md`).
#[pyclass(frozen, module = "tsuya")]
pub struct Reflectance {
    /// Whether the lights were known, so that ``diffuse`` is a reflectance and no mean radiance.
    #[pyo3(get)]
    relightable: bool,
    /// (height, width, 3), float32.
    #[pyo3(get)]
    diffuse: Py<PyArray3<f32>>,
    /// (height, width, 3), float32; None where highlights were not fitted. Of a file with lobes their nearest single lobe, as ``sigma``.
    #[pyo3(get)]
    specular: Option<Py<PyArray3<f32>>>,
    /// Width of the highlight in radians: (height, width), float32; or None.
    #[pyo3(get)]
    sigma: Option<Py<PyArray2<f32>>>,
    /// Weights of GGX lobes: (lobes, height, width, 3), float32; None of other models.
    #[pyo3(get)]
    lobes: Option<Py<PyArray4<f32>>>,
    /// Roughness of each lobe: (lobes,).
    #[pyo3(get)]
    lobe_roughness: Py<PyArray1<f64>>,
}

impl Reflectance {
    fn new(py: Python<'_>, maps: &tsuya::ReflectanceMaps) -> PyResult<Self> {
        let image = |map: &Grid<[f32; 3]>| -> PyResult<Option<_>> {
            let is_there = !map.data.is_empty();
            is_there.then(|| Ok(from_image(py, map.clone())?.unbind())).transpose()
        };
        let sigma = (!maps.sigma.data.is_empty()).then(|| from_grid(py, maps.sigma.clone())).transpose()?;
        let lobes = match maps.lobes.first() {
            Some(first) => {
                let weights: Vec<f32> = maps.lobes.iter().flat_map(|lobe| lobe.data.as_flattened()).copied().collect();
                let shape = [maps.lobes.len(), first.height, first.width, 3];
                Some(PyArray1::from_vec(py, weights).reshape(shape)?.unbind())
            }
            None => None,
        };
        Ok(Reflectance {
            relightable: maps.relightable,
            diffuse: from_image(py, maps.diffuse.clone())?.unbind(),
            specular: image(&maps.specular)?,
            sigma: sigma.map(Bound::unbind),
            lobes,
            lobe_roughness: PyArray1::from_slice(py, maps.lobe_roughness()).unbind(),
        })
    }
}
