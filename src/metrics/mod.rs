//! Errors of decoded photographs: image PSNR, SSIM, largest error.

mod coverage;
mod display;
mod distortion;
mod psnr;
mod ssim;

pub use coverage::coverage;
pub use display::{DisplayImage, difference, to_display};
pub use distortion::Distortion;
pub use psnr::{ImagePsnr, PhotographError, SquaredError, psnr_db, signal};
pub use ssim::ssim;
