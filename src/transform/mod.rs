//! Transforms: rotate colours and decorrelate samples before they are quantised.

pub mod colour;
pub mod daubechies;
pub mod shape_adaptive;
