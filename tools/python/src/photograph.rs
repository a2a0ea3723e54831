//! Decoded photographs, one or one after the other.

use crate::arrays::{from_grid, from_image};
use crate::camera::Camera;
use crate::errors::raise;
use crate::source::{Source, detached};
use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, sync_channel};
use tsuya::decoder::{DecodeOptions, decode_each, decode_from};
use tsuya::{Component, View};

/// Name of a component of reflection.
pub fn component_name(component: Component) -> &'static str {
    match component {
        Component::Diffuse => "diffuse",
        Component::Specular => "specular",
        Component::Combined => "combined",
    }
}

/// The photograph of a view, decoded: linear radiance for each component of reflection, 0 outside the mask.
#[pyclass(frozen, module = "tsuya", mapping)]
pub struct Photograph {
    /// Index of the view in the file.
    #[pyo3(get)]
    index: usize,
    /// Name of the view.
    #[pyo3(get)]
    name: String,
    camera: Camera,
    /// Pixels that show the object: (height, width), bool.
    #[pyo3(get)]
    mask: Py<PyArray2<bool>>,
    components: Vec<(Component, Py<PyArray3<f32>>)>,
    sum: Py<PyArray3<f32>>,
}

#[pymethods]
impl Photograph {
    /// Its camera, that of the decoded size and region.
    #[getter]
    fn camera(&self) -> Camera {
        self.camera
    }

    /// Radiance by component, "diffuse" and "specular" or "combined": (height, width, 3), float32.
    #[getter]
    fn components<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let components = PyDict::new(py);
        for (component, image) in &self.components {
            components.set_item(component_name(*component), image)?;
        }
        Ok(components)
    }

    /// Radiance of all components together, specular radiance below zero counted as 0: (height, width, 3), float32.
    #[getter]
    fn radiance(&self, py: Python<'_>) -> Py<PyArray3<f32>> {
        self.sum.clone_ref(py)
    }

    fn __getitem__(&self, py: Python<'_>, component: &str) -> PyResult<Py<PyArray3<f32>>> {
        let mut components = self.components.iter();
        let found = components.find(|(known, _)| component_name(*known) == component);
        found.map(|(_, image)| image.clone_ref(py)).ok_or_else(|| PyKeyError::new_err(component.to_owned()))
    }

    fn __repr__(&self) -> String {
        let names: Vec<&str> = self.components.iter().map(|(component, _)| component_name(*component)).collect();
        format!("Photograph({}: {} x {}, {})", self.name, self.camera.0.width, self.camera.0.height, names.join(", "))
    }
}

impl Photograph {
    /// What a decoder gave for a view.
    fn new(py: Python<'_>, decoded: Decoded, components: &[Component]) -> PyResult<Self> {
        let Decoded { index, view, photograph } = decoded;
        let sum = photograph.sum();
        let images = photograph.images.into_iter().map(|image| Ok(from_image(py, image)?.unbind()));
        let images = images.collect::<PyResult<Vec<_>>>()?;
        Ok(Photograph {
            index,
            name: view.name,
            camera: Camera(view.camera),
            mask: from_grid(py, photograph.mask)?.unbind(),
            components: components.iter().copied().zip(images).collect(),
            sum: from_image(py, sum)?.unbind(),
        })
    }
}

/// A photograph on its way to the interpreter.
struct Decoded {
    index: usize,
    view: View,
    photograph: tsuya::Photograph,
}

/// Decodes the photograph of one view; `None` where the file holds none of it.
pub fn decode_one(
    py: Python<'_>,
    source: &Source,
    index: usize,
    options: &DecodeOptions,
) -> PyResult<Option<Photograph>> {
    let (decoded, components) = detached(py, || {
        let mut asset = decode_from(&mut source.open(options.limits)?, options)?;
        let photograph = asset.photographs.get_mut(index).and_then(Option::take);
        let decoded = photograph.map(|photograph| Decoded { index, view: asset.views.swap_remove(index), photograph });
        Ok((decoded, asset.components))
    })?;
    decoded.map(|decoded| Photograph::new(py, decoded, &components)).transpose()
}

/// What the thread that decodes says.
type Message = tsuya::Result<(Vec<Decoded>, Vec<Component>)>;

/// Photographs of a file, decoded side by side and handed out in the order in which they are done; only those in use are in memory.
#[pyclass(frozen, module = "tsuya")]
pub struct Photographs(Mutex<Pending>);

struct Pending {
    /// `None` once all have come, or an error has.
    messages: Option<Receiver<Message>>,
    ready: Vec<Decoded>,
    components: Vec<Component>,
}

impl Photographs {
    /// Begins to decode.
    pub fn start(source: Source, options: DecodeOptions) -> Self {
        // A batch waits while the one before it is in use.
        let (sender, messages) = sync_channel(0);
        std::thread::spawn(move || {
            let work = || {
                decode_each(&mut source.open(options.limits)?, &options, |asset, decoded| {
                    let decoded = decoded.into_iter().map(|(index, photograph)| Decoded {
                        index,
                        view: asset.views[index].clone(),
                        photograph,
                    });
                    // Nobody waits for them any more: the error ends the work, and goes nowhere.
                    let gone = |_| tsuya::Error::parameter("the photographs are not asked for any more");
                    sender.send(Ok((decoded.collect(), asset.components.clone()))).map_err(gone)
                })
            };
            if let Err(error) = work() {
                let _ = sender.send(Err(error));
            }
        });
        Photographs(Mutex::new(Pending { messages: Some(messages), ready: Vec::new(), components: Vec::new() }))
    }
}

#[pymethods]
impl Photographs {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Photograph>> {
        let next = py.detach(|| {
            let mut pending = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            while pending.ready.is_empty() {
                let Some(messages) = &pending.messages else { return Ok(None) };
                match messages.recv() {
                    Ok(Ok((mut decoded, components))) => {
                        decoded.reverse();
                        (pending.ready, pending.components) = (decoded, components);
                    }
                    Ok(Err(error)) => {
                        pending.messages = None;
                        return Err(error);
                    }
                    Err(_) => pending.messages = None,
                }
            }
            Ok(pending.ready.pop().map(|decoded| (decoded, pending.components.clone())))
        });
        let next = next.map_err(raise)?;
        next.map(|(decoded, components)| Photograph::new(py, decoded, &components)).transpose()
    }
}
