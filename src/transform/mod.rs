//! Wavelet transforms: decorrelate samples before they are quantised.

pub mod daubechies;
pub mod shape_adaptive;
pub mod colour;
