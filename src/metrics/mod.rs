//! Errors of decoded photographs: image PSNR, SSIM, largest error.

mod coverage;
mod display;
mod distortion;
mod psnr;
mod ssim;

pub use crate::transform::signal::measured as signal;
pub use coverage::coverage;
pub use display::{DisplayImage, difference, to_display};
pub use distortion::Distortion;
pub use psnr::{ImagePsnr, PhotographError, SquaredError, psnr_db};
pub use ssim::ssim;
