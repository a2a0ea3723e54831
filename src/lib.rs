//! tsuya (艶, lustre): a file format and codec for objects captured with their measured appearance.
//!
//! A scan mesh and photographs with known cameras become one small `.tsuya` file. From the file come back every photograph, the mesh and
//! reflectance maps, and images from new viewpoints and under new light. Every byte of it is described in the folder `spec/` of the
//! repository.
//!
//! # Usage
//!
//! From a file to a decoded view, and to an image from another viewpoint:
//!
//! ```
//! use tsuya::container::Container;
//! use tsuya::decoder::{ViewSelection, decode_from};
//! use tsuya::relight::{RenderOptions, look_at, render};
//! use tsuya::{DecodeOptions, Limits};
//!
//! # fn main() -> tsuya::Result<()> {
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/spec/vectors/ring-small.tsuya");
//! let limits = Limits { memory_bytes: 256 << 20, ..Limits::default() };
//! let mut file = Container::open_path(path, limits)?;
//! // Only the bytes are read that view 1 needs.
//! let options = DecodeOptions { limits, selection: ViewSelection::Views(vec![1]), ..Default::default() };
//! let asset = decode_from(&mut file, &options)?;
//! let photograph = asset.photographs[1].as_ref().expect("the view that was selected");
//! // One image of linear radiance for each component: diffuse and specular.
//! assert_eq!((photograph.images.len(), photograph.images[0].width), (asset.components.len(), 128));
//!
//! let camera = &asset.views[1].camera;
//! let above = camera.centre().map(|x| 1.2 * x);
//! let camera = look_at(above, [0.0; 3], [0.0, 1.0, 0.0], camera.focal[1], 320, 240);
//! let render = render(&asset, &camera, &RenderOptions::default())?;
//! assert_eq!((render.image.width, render.image.height), (320, 240));
//! # Ok(())
//! # }
//! ```
//!
//! From a capture to a file, with the feature `encode`: [`capture::read`], then [`encode`]. The folder `tools/examples` of the
//! repository has five programs that each fit on a page.
//!
//! # Features
//!
//! - `encode` (default): reading captures, fitting reflectance and materials, writing files.
//! - `gltf` (default): GLB and glTF documents that carry a file ([`gltf`]); also glTF meshes of captures.
//! - `parallel` (default): work on rayon's current thread pool. The library starts no threads of its own, and no result depends on their number.
//! - `ar` (default): objects in the images of a camera ([`ar`], [`marker`]). Builds AprilTag's C library.
//! - `cli` (default): the program `tsuya`.
//!
//! Without any (`default-features = false`) the crate is a decoder and renderer. zstd is the C library, but on WebAssembly.
//!
//! # Limits
//!
//! Whatever a file sizes is charged to one [`Budget`] before it is allocated; a damaged or hostile file is an [`Error`] and never a panic.
//! [`Limits::default`] allows 4 GiB; programs that read files of strangers set their own. There is no limit in seconds. `SECURITY.md` has every promise.
//!
//! An asset is one object under point lights, not a scene; colours are linear red, green and blue; files of captures with unknown lights can't
//! be relit unless a light is assumed (`EncodeOptions::light`).
//!
//! # How it works
//!
//! Start with [`encoder`] and [`decoder`]: they list the stages in order, the decoder from bottom to top.
//!
//! 1. Separation: polarised pairs become diffuse and specular components.
//! 2. [`mesh`]: connectivity and quantised positions, as the decoder will have them.
//! 3. Views: cameras, lights and names.
//! 4. Reflectance: Lambert and Torrance-Sparrow parameters, or a palette of measured lobes, fitted on an atlas.
//! 5. Photographs: profile [`Predictive`](Profile::Predictive) predicts each one through the mesh from those already decoded; the residual goes through a
//!    shape-adaptive wavelet transform, a quantiser, and an entropy coder with mixed contexts. Profile [`WaveletTexture`](Profile::WaveletTexture)
//!    keeps residual volumes over patches of the surface.
//! 6. [`container`]: sections with checksums, found by a directory or one after the other in a stream.
//!
//! [`visibility`], [`lighting`] and [`brdf`] are stages that a file may hold alone; [`relight`] renders what was decoded; [`metrics`] compares.
//!
//! # Stability
//!
//! Version 0.1, format 0.1: both experimental. The interface follows semantic versioning as Cargo takes it. A reader refuses files of any other minor
//! version of format 0; keep what the files were made from. Decoded values are the same bits on every supported processor.

// A decoder alone leaves the encoder's direction of each stage unused; some parts are called by tests and benchmarks only.
#![cfg_attr(not(all(feature = "encode", feature = "internals")), allow(dead_code, unused_imports))]
#![cfg_attr(feature = "internals", warn(unreachable_pub))]

#[cfg(feature = "ar")]
pub mod ar;
mod asset;
pub mod brdf;
#[cfg(feature = "encode")]
pub mod capture;
pub mod container;
pub mod decoder;
mod elementary;
#[cfg(feature = "encode")]
pub mod encoder;
mod entropy;
mod error;
#[cfg(feature = "gltf")]
pub mod gltf;
#[cfg(feature = "encode")]
mod illumination;
pub mod image;
pub mod input;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals;
pub mod lighting;
mod limits;
#[cfg(feature = "ar")]
pub mod marker;
pub mod mesh;
pub mod metrics;
mod optimise;
mod options;
mod parallel;
mod predictive;
mod quantise;
#[cfg(feature = "encode")]
mod rate;
#[cfg(feature = "encode")]
mod refine;
mod reflectance;
pub mod relight;
#[cfg(feature = "encode")]
mod repair;
mod residual;
#[cfg(feature = "encode")]
mod separate;
mod sphere;
mod surface;
mod transform;
mod vector;
mod views;
pub mod visibility;
mod wavelet_texture;

pub use asset::Asset;
pub use decoder::{DecodeOptions, decode};
#[cfg(feature = "encode")]
pub use encoder::encode;
pub use error::{Error, FilePart, Result};
#[cfg(feature = "encode")]
pub use illumination::AssumedLight;
pub use limits::{Budget, Limits, Reservation};
pub use mesh::Mesh;
pub use options::{CaptureLight, DecodeSpeed, EncodeOptions, EncodeTarget, Profile, Refinement, SpecularModel};
pub use reflectance::maps::ReflectanceMaps;
pub use reflectance::palette::PaletteEntry;
#[cfg(feature = "encode")]
pub use repair::{RepairedFile, repair};
pub use surface::charts::{Chart, Charts};
pub use surface::displacement::DisplacedMesh;
pub use surface::split::RenderMesh;
pub use views::{Camera, Component, Photograph, PointLight, View};

/// The examples in the README are compiled and run as tests.
#[cfg(all(doctest, feature = "encode"))]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
