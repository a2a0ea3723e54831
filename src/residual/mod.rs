//! Residual: what is left of a photograph when its prediction is known.

pub mod coefficients;
mod contexts;
pub mod gains;
pub mod mask;
pub mod volume;
