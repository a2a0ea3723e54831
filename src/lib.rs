//! tsuya (艶, lustre): a file format and codec for objects whose look was measured.
//!
//! The way of the data is told by the conductors, [`encoder`] and [`decoder`]; every other module is one stage of it.

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
pub use error::{Error, Result};
pub use limits::{Budget, Limits};
pub use mesh::Mesh;
pub use options::{DecodeSpeed, EncodeOptions, EncodeTarget, Profile, SpecularModel};
pub use reflectance::maps::ReflectanceMaps;
pub use reflectance::palette::PaletteEntry;
#[cfg(feature = "encode")]
pub use repair::{RepairedFile, repair};
pub use surface::charts::{Chart, Charts};
pub use surface::split::RenderMesh;
pub use views::{Camera, Component, Photograph, PointLight, View};

/// The examples in the README are compiled and run as tests.
#[cfg(all(doctest, feature = "encode"))]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
