//! Light from all around: environment maps, spherical Gaussians fitted to them, prefiltered levels.

pub mod environment;
pub mod octahedral;
pub mod prefiltered;
pub mod spherical_gaussian;

pub use environment::Environment;
pub use prefiltered::{Level, Light};
pub use spherical_gaussian::SphericalGaussian;
