//! How near decoded pictures are to the photographs.

mod display;
mod hold_out;
mod psnr;
mod ssim;

pub use display::{Picture, difference, to_display};
pub use hold_out::{HeldOut, hold_out};
pub use psnr::{FrameError, ImagePsnr, SquaredError, psnr_db, signal};
pub use ssim::ssim;
