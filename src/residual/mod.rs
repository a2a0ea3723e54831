//! Residual: what is left of a photograph when its prediction is known.

pub mod coefficients;
mod contexts;
mod direct;
pub mod gains;
pub mod mask;
mod mixed;
pub mod volume;
