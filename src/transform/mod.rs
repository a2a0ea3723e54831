//! Transforms: rotate colours and decorrelate samples before they are quantised.

pub mod colour;
pub mod daubechies;
pub mod frame;
mod lifting;
pub mod masked;
pub mod shape_adaptive;
