//! Transforms: rotate colours and decorrelate samples before they are quantised.

pub(crate) mod band_masks;
pub(crate) mod colour;
pub(crate) mod daubechies;
mod lifting;
pub(crate) mod masked;
pub(crate) mod rectangle;
pub(crate) mod region;
pub(crate) mod shape_adaptive;
pub(crate) mod signal;
pub(crate) mod synthesis;
pub(crate) mod window;
