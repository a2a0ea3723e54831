//! Light from all around: environment maps, spherical Gaussians fitted to them, prefiltered levels.

pub mod codec;
pub mod environment;
#[cfg(feature = "encode")]
pub mod fit;
#[cfg(feature = "encode")]
pub mod follow;
#[cfg(feature = "encode")]
pub mod levels;
pub mod prefiltered;
#[cfg(feature = "encode")]
pub mod projection;
#[cfg(feature = "encode")]
pub mod read;

pub use crate::sphere::gaussian::SphericalGaussian;
pub use environment::EnvironmentMap;
pub use prefiltered::{EnvironmentLobes, PrefilteredMap};
