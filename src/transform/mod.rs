//! Wavelet transforms.

pub mod daubechies;
