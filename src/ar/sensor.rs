//! The camera's noise, and the gain of exposure and white balance, read off the marker's paper.

use super::plate::{Plate, SrgbCurve};
use crate::image::Grid;
use crate::marker::detection::MarkerDetection;

/// Reflectance that a marker's paper is taken to have.
pub const PAPER_ALBEDO: f64 = 0.8;
/// Places along each side of a marker at which its brightness is read.
const PLACES: usize = 24;

/// Standard deviation of the noise in display values, of the median of the differences that a plane or an edge does not show (Immerkaer 1996, with a
/// median in place of the mean).
pub(super) fn noise_sigma(grey: &Grid<u8>) -> f32 {
    let mut counts = [0usize; 2048];
    let mut total = 0;
    for y in (1..grey.height.saturating_sub(1)).step_by(5) {
        let [above, here, below] = [y - 1, y, y + 1].map(|y| grey.row(y));
        for x in (1..grey.width.saturating_sub(1)).step_by(2) {
            let around = |row: &[u8]| [row[x - 1] as i32, row[x] as i32, row[x + 1] as i32];
            let ([a, b, c], [d, e, f], [g, h, i]) = (around(above), around(here), around(below));
            // Clipped pixels have lost theirs.
            if e <= 4 || e >= 251 {
                continue;
            }
            let value = (a + c + g + i) - 2 * (b + d + f + h) + 4 * e;
            counts[(value.unsigned_abs() as usize).min(2047)] += 1;
            total += 1;
        }
    }
    let mut below = 0;
    for (value, count) in counts.iter().enumerate() {
        if 2 * (below + count) >= total && *count > 0 {
            // Within the whole number the values lie evenly.
            let part = (0.5 * total as f32 - below as f32) / *count as f32;
            let median = if value == 0 { 0.5 * part } else { value as f32 - 0.5 + part };
            return median / (6.0 * 0.6745);
        }
        below += count;
    }
    0.0
}

/// Linear colour of a marker's paper: the mean of the brighter tenth of it and its margin, without what is clipped. `None` where the image
/// shows too little of it.
pub(super) fn paper_radiance(curve: &SrgbCurve, plate: &Plate, marker: &MarkerDetection) -> Option<[f32; 3]> {
    let [width, height] = plate.size();
    let [a, b, c, d] = marker.corners;
    let mut found: Vec<[f32; 3]> = Vec::with_capacity(PLACES * PLACES);
    for k in 0..PLACES * PLACES {
        // From the middle of the margin on one side to that of the other, bilinear: the places need not be exact.
        let place = |k: usize| -0.06 + 1.12 * (k as f64 + 0.5) / PLACES as f64;
        let (u, v) = (place(k % PLACES), place(k / PLACES));
        let [x, y] = [0, 1].map(|i| {
            let (upper, lower) = (a[i] + (b[i] - a[i]) * u, d[i] + (c[i] - d[i]) * u);
            upper + (lower - upper) * v
        });
        if x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64 {
            found.push(curve.pixel(plate, y as usize * width + x as usize));
        }
    }
    let luminance = |p: &[f32; 3]| p[0] + 2.0 * p[1] + p[2];
    found.retain(|p| p.iter().all(|&c| c < 0.98));
    if found.len() < PLACES * PLACES / 4 {
        return None;
    }
    found.sort_by(|a, b| luminance(b).total_cmp(&luminance(a)));
    // The very brightest may be a glint.
    let part = &found[found.len() / 50..found.len() / 8 + 1];
    let mean: [f32; 3] = std::array::from_fn(|c| part.iter().map(|p| p[c]).sum::<f32>() / part.len() as f32);
    mean.iter().all(|&c| c > 1e-3).then_some(mean)
}

/// A number for each pixel, colour and frame, near to a Gaussian of standard deviation 1: the sum of four even ones.
#[inline]
pub(super) fn grain(pixel: u32, frame: u32) -> [f32; 3] {
    // PCG's output function over a counter (Jarzynski and Olano 2020).
    let mut state = pixel.wrapping_mul(747_796_405).wrapping_add(frame.wrapping_mul(2_891_336_453)).wrapping_add(1);
    std::array::from_fn(|_| {
        let mut sum = 0u32;
        for _ in 0..2 {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
            let word = (word >> 22) ^ word;
            sum += (word & 0xffff) + (word >> 16);
        }
        // Four numbers of 0 to 65535: mean 2 * 65535, standard deviation 65536 / sqrt(3).
        (sum as f32 - 131_070.0) / 37_837.2
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_that_is_added_is_found() {
        for sigma in [1.0, 3.0, 6.0] {
            let mut picture = Grid::filled(320, 240, 0u8);
            for k in 0..picture.data.len() {
                let ramp = 60.0 + 0.3 * (k % 320) as f32 + if k % 320 > 160 { 40.0 } else { 0.0 };
                picture.data[k] = (ramp + sigma * grain(k as u32, 7)[1]).round().clamp(0.0, 255.0) as u8;
            }
            let found = noise_sigma(&picture);
            assert!((found / sigma - 1.0).abs() < 0.12, "{sigma}: {found}");
        }
        assert!(noise_sigma(&Grid::filled(64, 64, 100)) < 0.15);
    }
}
