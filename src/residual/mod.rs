//! Residual: photographs less their predictions, as coded coefficients and masks.

mod band;
pub(crate) mod coefficients;
mod contexts;
mod direct;
pub(crate) mod gains;
pub(crate) mod mask;
mod mixed;
mod prediction;
mod task;
mod tile_coder;
pub(crate) mod tiles;
pub(crate) mod volume;
