//! Residual: photographs less their predictions, as coded coefficients and masks.

pub(crate) mod coefficients;
mod contexts;
mod direct;
pub(crate) mod gains;
pub(crate) mod mask;
mod mixed;
pub(crate) mod volume;
