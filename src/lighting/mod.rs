//! Light from all around: environment maps, spherical Gaussians fitted to them, prefiltered levels.

pub mod spherical_gaussian;

pub use spherical_gaussian::SphericalGaussian;
