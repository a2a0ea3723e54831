//! Wavelet transforms.

pub mod colour;
pub mod daubechies;
