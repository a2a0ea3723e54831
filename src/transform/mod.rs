//! Transforms: rotate colours and decorrelate samples before they are quantised.

pub(crate) mod colour;
pub(crate) mod daubechies;
pub(crate) mod frame;
mod lifting;
pub(crate) mod masked;
pub(crate) mod shape_adaptive;
