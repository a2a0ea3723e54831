//! tsuya (艶, lustre): a file format and codec for objects whose look was measured.
//!
//! The way of the data is told by the conductors, [`encoder`] and [`decoder`]; every other module is one stage of it.

#[cfg(feature = "ar")]
pub mod ar;
pub mod asset;
pub mod brdf;
#[cfg(feature = "encode")]
pub mod capture;
pub mod container;
pub mod decoder;
mod elementary;
#[cfg(feature = "encode")]
pub mod encoder;
pub mod entropy;
pub mod error;
#[cfg(feature = "gltf")]
pub mod gltf;
pub mod image;
pub mod input;
pub mod lighting;
pub mod limits;
#[cfg(feature = "ar")]
pub mod marker;
pub mod mesh;
pub mod metrics;
pub mod optimise;
pub mod options;
pub(crate) mod parallel;
pub mod predictive;
pub mod quantise;
#[cfg(feature = "encode")]
pub mod rate;
pub mod reflectance;
pub mod relight;
#[cfg(feature = "encode")]
pub mod repair;
pub mod residual;
#[cfg(feature = "encode")]
pub mod separate;
pub mod sphere;
pub mod surface;
pub mod transform;
mod vector;
pub mod views;
pub mod visibility;
pub mod wavelet_texture;

pub use error::{Error, Result};
pub use limits::{Budget, Limits};

/// The examples in the README are compiled and run as tests.
#[cfg(all(doctest, feature = "encode"))]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
