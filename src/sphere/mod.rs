//! Functions on the sphere of directions: octahedral maps and spherical Gaussians.

pub mod gaussian;
pub mod octahedral;
