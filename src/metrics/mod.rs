//! Errors of decoded photographs: PSNR, SSIM, held-out views.

mod coverage;
mod display;
mod hold_out;
mod psnr;
mod ssim;

pub use coverage::coverage;
pub use display::{DisplayImage, difference, to_display};
pub use hold_out::{HeldOut, hold_out};
pub use psnr::{ImagePsnr, PhotographError, SquaredError, psnr_db, signal};
pub use ssim::ssim;
