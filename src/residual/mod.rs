//! Residual: what is left of a photograph when its prediction is known.

pub(crate) mod coefficients;
mod contexts;
mod direct;
pub(crate) mod gains;
pub(crate) mod mask;
mod mixed;
pub(crate) mod volume;
