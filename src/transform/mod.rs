//! Wavelet transforms: decorrelate samples before they are quantised.

pub mod shape_adaptive;
//! Wavelet transforms.

pub mod daubechies;
