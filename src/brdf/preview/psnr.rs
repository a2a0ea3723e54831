//! Exposure, encoding and PSNR of pictures.

use crate::image::{Mask, RgbImage, to_srgb};

/// Returns the radiance shown as white: the 95th percentile over the mask of each pixel's greatest colour.
pub fn sphere_exposure(picture: &RgbImage, mask: &Mask) -> f64 {
    let greatest = |pixel: &[f32; 3]| pixel.iter().copied().fold(0.0, f32::max);
    let inside = picture.data.iter().zip(&mask.data).filter(|(_, inside)| **inside);
    let mut values: Vec<f32> = inside.map(|(pixel, _)| greatest(pixel)).collect();
    values.sort_by(f32::total_cmp);
    let at = (values.len() as f64 * 0.95) as usize;
    values.get(at.min(values.len().saturating_sub(1))).map_or(1.0, |&x| f64::from(x).max(1e-12))
}

/// PSNR in dB of sRGB-encoded values over the mask, colours together; 100 where nothing differs.
pub(crate) fn psnr_db(measured: &RgbImage, fitted: &RgbImage, mask: &Mask, white: f64) -> f64 {
    let signal = |x: f32| to_srgb((f64::from(x) / white).clamp(0.0, 1.0));
    let (mut squares, mut count) = (0.0, 0.0);
    for k in (0..mask.data.len()).filter(|&k| mask.data[k]) {
        for c in 0..3 {
            squares += (signal(measured.data[k][c]) - signal(fitted.data[k][c])).powi(2);
            count += 1.0;
        }
    }
    let mean = squares / f64::max(count, 1.0);
    if mean <= 1e-10 { 100.0 } else { -10.0 * mean.log10() }
}
