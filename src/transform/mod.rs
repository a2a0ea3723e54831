//! Wavelet transforms.

pub mod daubechies;
pub mod colour;
