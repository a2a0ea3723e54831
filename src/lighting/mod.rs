//! Light from all around: environment maps, spherical Gaussians fitted to them, prefiltered levels.

pub mod code;
pub mod environment;
#[cfg(feature = "encode")]
pub mod fit;
#[cfg(feature = "encode")]
pub mod follow;
#[cfg(feature = "encode")]
pub mod levels;
#[cfg(feature = "encode")]
mod minimise;
pub mod octahedral;
pub mod prefiltered;
#[cfg(feature = "encode")]
pub mod projection;
#[cfg(feature = "encode")]
pub mod read;
pub mod spherical_gaussian;

pub use environment::Environment;
pub use prefiltered::{Level, Light};
pub use spherical_gaussian::SphericalGaussian;
