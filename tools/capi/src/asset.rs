//! Open files.

use crate::error::{Error, Status, c_string};
use crate::mesh::MeshData;
use crate::textures::TextureData;
use crate::{give, guarded, put};
use std::ffi::{CStr, CString, c_char};
use std::io::{Cursor, Read, Seek};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock};
use tsuya::container::Container;
use tsuya::decoder::{DecodeOptions, ViewSelection, decode_from};

/// Bounds on what a file may ask for.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Limits {
    /// Bytes of memory for everything that the file sizes, together.
    pub memory_bytes: u64,
    /// Views.
    pub views: u32,
    /// Width or height of an image, in pixels.
    pub image_side: u32,
    /// Vertices or triangles of the mesh.
    pub mesh_elements: u32,
}

/// Component of reflection that an image shows.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Component {
    /// Diffuse reflection.
    Diffuse = 0,
    /// Specular reflection. May be negative.
    Specular = 1,
    /// Both together, of a capture without polarisers.
    Combined = 2,
}

/// A pinhole camera: a world point p has camera coordinates q = rotation p + translation and the image position
/// (focal[0] q.x / q.z + principal[0], focal[1] q.y / q.z + principal[1]); pixel (0, 0) covers 0 to 1.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Camera {
    /// Width of the image in pixels.
    pub width: u32,
    /// Height of the image in pixels.
    pub height: u32,
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub principal: [f64; 2],
    /// World to camera, rows.
    pub rotation: [[f64; 3]; 3],
    /// World to camera.
    pub translation: [f64; 3],
}

impl From<tsuya::Camera> for Camera {
    fn from(camera: tsuya::Camera) -> Self {
        let tsuya::Camera { width, height, focal, principal, rotation, translation } = camera;
        Camera { width, height, focal, principal, rotation, translation }
    }
}

/// A point light: irradiance at distance r is intensity / r^2.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointLight {
    /// World position.
    pub position: [f64; 3],
    /// Radiant intensity, red, green, blue.
    pub intensity: [f64; 3],
}

/// A captured view.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct View {
    /// Name of the photograph, UTF-8; belongs to the asset.
    pub name: *const c_char,
    /// Its camera.
    pub camera: Camera,
    /// Whether its light is known.
    pub has_light: bool,
    /// Its light, zero where it is not known.
    pub light: PointLight,
}

/// What a container is read from.
pub(crate) trait Stream: Read + Seek {}
impl<T: Read + Seek> Stream for T {}

enum Source {
    Path(PathBuf),
    Bytes(Arc<[u8]>),
}

/// An open file.
pub struct Asset {
    source: Source,
    pub(crate) limits: tsuya::Limits,
    /// Metadata, views and mesh.
    pub(crate) outline: tsuya::Asset,
    metadata: CString,
    names: Vec<CString>,
    /// All but the photographs, once it was asked for.
    model: OnceLock<tsuya::Asset>,
    pub(crate) captured: OnceLock<MeshData>,
    pub(crate) drawn: OnceLock<MeshData>,
    pub(crate) textured: OnceLock<MeshData>,
    pub(crate) textures: Mutex<Vec<TextureData>>,
}

impl Source {
    fn open(&self, limits: tsuya::Limits) -> tsuya::Result<Container<Box<dyn Stream>>> {
        let stream: Box<dyn Stream> = match self {
            Source::Path(path) => Box::new(tsuya::input::open(path)?.0),
            Source::Bytes(bytes) => Box::new(Cursor::new(bytes.clone())),
        };
        Container::open_seek(stream, limits)
    }
}

impl Asset {
    fn new(source: Source, limits: Option<&Limits>) -> Result<Self, Error> {
        let limits = limits.map_or(tsuya::Limits::default(), |limits| tsuya::Limits {
            memory_bytes: limits.memory_bytes,
            views: limits.views,
            image_side: limits.image_side,
            mesh_elements: limits.mesh_elements,
        });
        let options =
            DecodeOptions { limits, selection: ViewSelection::None, photographs_only: true, ..Default::default() };
        let outline = decode_from(&mut source.open(limits)?, &options)?;
        let metadata = serde_json::to_string(&outline.metadata).unwrap_or_default();
        let names = outline.views.iter().map(|view| c_string(&view.name)).collect();
        let (captured, drawn, textured, textures, model) = Default::default();
        let metadata = c_string(&metadata);
        Ok(Asset { source, limits, outline, metadata, names, model, captured, drawn, textured, textures })
    }

    /// Opens the container anew.
    pub(crate) fn open(&self) -> tsuya::Result<Container<Box<dyn Stream>>> {
        self.source.open(self.limits)
    }

    /// All but the photographs.
    pub(crate) fn model(&self) -> Result<&tsuya::Asset, Error> {
        if let Some(model) = self.model.get() {
            return Ok(model);
        }
        let options = DecodeOptions { limits: self.limits, selection: ViewSelection::None, ..DecodeOptions::default() };
        let model = decode_from(&mut self.open()?, &options)?;
        Ok(self.model.get_or_init(|| model))
    }

    /// A view that exists.
    pub(crate) fn check_view(&self, view: u32) -> Result<usize, Error> {
        let (view, views) = (view as usize, self.outline.views.len());
        let message = || format!("view {view} does not exist: the file has {views} views");
        if view < views { Ok(view) } else { Err(Error::new(Status::Parameter, &message())) }
    }
}

/// The limits that are taken where none are given: 4 GiB of memory.
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_default_limits() -> Limits {
    let tsuya::Limits { memory_bytes, views, image_side, mesh_elements } = tsuya::Limits::default();
    Limits { memory_bytes, views, image_side, mesh_elements }
}

/// Version of the library, such as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// Opens a file in memory, which is copied. `limits` may be null. Metadata, views and mesh are decoded now, the rest when it is asked for.
///
/// # Safety
/// `bytes` points to so many bytes; `limits` and `error` are null or valid; `asset` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_open_memory(
    bytes: *const u8,
    length: usize,
    limits: *const Limits,
    asset: *mut *mut Asset,
    error: *mut *mut Error,
) -> Status {
    let open = || {
        if bytes.is_null() || asset.is_null() {
            return Err(Error::null());
        }
        // SAFETY: as the caller says.
        let (bytes, limits) = unsafe { (std::slice::from_raw_parts(bytes, length), limits.as_ref()) };
        let opened = Asset::new(Source::Bytes(bytes.into()), limits)?;
        // SAFETY: as the caller says.
        unsafe { give(asset, opened) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, open) }
}

/// Opens a file by its path, UTF-8. It stays where it is and as it is until the asset is freed: only what is asked for is read.
///
/// # Safety
/// `path` ends with a zero; `limits` and `error` are null or valid; `asset` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_open_file(
    path: *const c_char,
    limits: *const Limits,
    asset: *mut *mut Asset,
    error: *mut *mut Error,
) -> Status {
    let open = || {
        if path.is_null() || asset.is_null() {
            return Err(Error::null());
        }
        // SAFETY: as the caller says.
        let (path, limits) = unsafe { (CStr::from_ptr(path), limits.as_ref()) };
        let path = path.to_str().map_err(|_| Error::new(Status::Parameter, "the path is not UTF-8"))?;
        let opened = Asset::new(Source::Path(path.into()), limits)?;
        // SAFETY: as the caller says.
        unsafe { give(asset, opened) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, open) }
}

/// Frees an asset and all that belongs to it, but not its photographs; null is left alone.
///
/// # Safety
/// `asset` is null or an asset that was not freed, and nothing that belongs to it is used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_asset_free(asset: *mut Asset) {
    // SAFETY: as the caller says.
    unsafe { crate::free(asset) }
}

/// What the file says of itself, a JSON object in UTF-8: title, licence, units, its stated error. Null for null.
///
/// # Safety
/// `asset` is null or an asset that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_metadata(asset: *const Asset) -> *const c_char {
    // SAFETY: as the caller says.
    unsafe { asset.as_ref() }.map_or(std::ptr::null(), |asset| asset.metadata.as_ptr())
}

/// Number of captured views.
///
/// # Safety
/// `asset` is null or an asset that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_view_count(asset: *const Asset) -> u32 {
    // SAFETY: as the caller says.
    unsafe { asset.as_ref() }.map_or(0, |asset| asset.outline.views.len() as u32)
}

/// Number of components of each photograph: two of polarised captures (diffuse and specular), else one.
///
/// # Safety
/// `asset` is null or an asset that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_component_count(asset: *const Asset) -> u32 {
    // SAFETY: as the caller says.
    unsafe { asset.as_ref() }.map_or(0, |asset| asset.outline.components.len() as u32)
}

/// Which component the images of this number show.
///
/// # Safety
/// `asset` and `error` are null or valid; `component` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_component(
    asset: *const Asset,
    number: u32,
    component: *mut Component,
    error: *mut *mut Error,
) -> Status {
    let find = || {
        // SAFETY: as the caller says.
        let asset = unsafe { asset.as_ref() }.ok_or_else(Error::null)?;
        let found = asset.outline.components.get(number as usize);
        let found = found.ok_or_else(|| Error::new(Status::Parameter, "there is no component of this number"))?;
        let found = match found {
            tsuya::Component::Diffuse => Component::Diffuse,
            tsuya::Component::Specular => Component::Specular,
            tsuya::Component::Combined => Component::Combined,
        };
        // SAFETY: as the caller says.
        unsafe { put(component, found) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, find) }
}

/// Radiance of the white board, red, green, blue: what is white in the photographs.
///
/// # Safety
/// `asset` and `error` are null or valid; `white` has room for three numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_white(asset: *const Asset, white: *mut f64, error: *mut *mut Error) -> Status {
    let find = || {
        // SAFETY: as the caller says.
        let asset = unsafe { asset.as_ref() }.ok_or_else(Error::null)?;
        // SAFETY: as the caller says.
        unsafe { put(white.cast::<[f64; 3]>(), asset.outline.white) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, find) }
}

/// Name, camera and light of a view.
///
/// # Safety
/// `asset` and `error` are null or valid; `view` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_view(
    asset: *const Asset,
    index: u32,
    view: *mut View,
    error: *mut *mut Error,
) -> Status {
    let find = || {
        // SAFETY: as the caller says.
        let asset = unsafe { asset.as_ref() }.ok_or_else(Error::null)?;
        let index = asset.check_view(index)?;
        let found = &asset.outline.views[index];
        let light = found.light.map(|light| PointLight { position: light.position, intensity: light.intensity });
        let has_light = light.is_some();
        let light = light.unwrap_or(PointLight { position: [0.0; 3], intensity: [0.0; 3] });
        let found = View { name: asset.names[index].as_ptr(), camera: found.camera.into(), has_light, light };
        // SAFETY: as the caller says.
        unsafe { put(view, found) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, find) }
}
