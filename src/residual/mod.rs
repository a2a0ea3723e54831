//! Residual: what is left of a photograph when its prediction is known.

pub mod coefficients;
pub mod gains;
pub mod mask;
//! What the model leaves: measured minus predicted.

pub mod volume;
