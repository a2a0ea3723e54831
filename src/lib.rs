//! tsuya (艶, lustre): a file format and codec for objects whose look was measured.
//!
//! The way of the data is told by the conductors, [`encoder`] and [`decoder`]; every other module is one stage of it.

pub mod asset;
pub mod entropy;
pub mod error;
pub mod image;
pub mod limits;
pub mod paper;
pub mod quantise;
pub mod reflectance;
pub mod residual;
pub mod surface;
pub mod transform;

pub use error::{Error, Result};
pub use limits::{Budget, Limits};
