//! Functions on the sphere of directions: octahedral maps and spherical Gaussians.

pub(crate) mod gaussian;
pub(crate) mod octahedral;
