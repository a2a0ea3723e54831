//! The white board: the unit of radiance, and what the crossed polarisers take away.

use super::description::WhiteReference;
use super::photograph::PhotographReading;
use crate::error::{Error, Result};
use crate::image::RgbImage;

/// Radiance of the unpolarised white board, and `beta = on_board / off_board` per colour (Miyazaki 2007, equation A.2), both
/// over the middle quarter of the picture each way.
pub(super) fn calibrate(
    reference: &WhiteReference,
    reading: PhotographReading<'_>,
) -> Result<([f64; 3], Option<[f64; 3]>)> {
    let read = reading.read(&reference.photograph, None)?;
    let mean = |image: &RgbImage, number: usize| -> Result<[f64; 3]> {
        let mean = middle_mean(image);
        let bright = mean.iter().all(|m| m.is_finite() && *m > 0.0);
        let path = reference.photograph.files().nth(number).unwrap_or(reference.photograph.first());
        let message =
            || format!("the white board has a mean radiance of {mean:?} in its middle: it should be positive");
        if bright { Ok(mean) } else { Err(Error::input(path, message())) }
    };
    let white = mean(&read.photograph, 0)?;
    let cross = read.cross.map(|cross| mean(&cross, 1)).transpose()?;
    Ok((white, cross.map(|on| std::array::from_fn(|c| on[c] / white[c]))))
}

/// Mean of the middle quarter (each way) of a picture, missing pixels left out; NaN if all are missing.
fn middle_mean(image: &RgbImage) -> [f64; 3] {
    let range = |side: usize| side * 3 / 8..(side * 5).div_ceil(8);
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for y in range(image.height) {
        for pixel in &image.row(y)[range(image.width)] {
            if !pixel[0].is_nan() {
                (0..3).for_each(|c| sum[c] += pixel[c] as f64);
                count += 1.0;
            }
        }
    }
    sum.map(|s| s / count)
}
