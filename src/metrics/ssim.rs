//! Structural similarity (Wang et al. 2004) of the brightness of the square-root signal.

use super::signal;
use crate::image::{Mask, RgbImage};

/// Half width of the square window; 7 x 7 pixels, equal weights, as scikit-image's default.
const REACH: usize = 3;

/// Mean SSIM over the windows whose pixels all lie in `mask`; `None` where there is none. Brightness
/// `0.2126 R + 0.7152 G + 0.0722 B` of the signals, dynamic range 1.
pub fn ssim(a: &RgbImage, b: &RgbImage, mask: &Mask, white: [f64; 3]) -> Option<f64> {
    let (width, height) = (mask.width, mask.height);
    // Sums over rectangles from the top left: 1, a, b, aa, bb, ab.
    let mut table = vec![[0f64; 6]; (width + 1) * (height + 1)];
    let brightness = |image: &RgbImage, k: usize| {
        let [r, g, b] = std::array::from_fn(|c| signal(image.data[k][c], white[c]));
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    for y in 0..height {
        let mut row = [0f64; 6];
        for x in 0..width {
            let k = y * width + x;
            let (p, q) = (brightness(a, k), brightness(b, k));
            if mask.data[k] && p.is_finite() && q.is_finite() {
                for (sum, value) in row.iter_mut().zip([1.0, p, q, p * p, q * q, p * q]) {
                    *sum += value;
                }
            }
            table[(y + 1) * (width + 1) + x + 1] = std::array::from_fn(|i| table[y * (width + 1) + x + 1][i] + row[i]);
        }
    }
    let side = 2 * REACH + 1;
    let full = (side * side) as f64;
    let (mut sum, mut count) = (0.0, 0u64);
    for y in side..=height {
        for x in side..=width {
            let at = |x: usize, y: usize, i: usize| table[y * (width + 1) + x][i];
            let window = |i: usize| at(x, y, i) - at(x - side, y, i) - at(x, y - side, i) + at(x - side, y - side, i);
            if window(0) != full {
                continue;
            }
            let [ma, mb, aa, bb, ab] = [1, 2, 3, 4, 5].map(|i| window(i) / full);
            // Sample variances.
            let unbias = full / (full - 1.0);
            let (va, vb, vab) = (unbias * (aa - ma * ma), unbias * (bb - mb * mb), unbias * (ab - ma * mb));
            let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
            sum += (2.0 * ma * mb + c1) * (2.0 * vab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
            count += 1;
        }
    }
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use crate::image::Grid;
    use crate::metrics::ssim::*;

    #[test]
    fn equal_is_one_and_noise_lowers_it() {
        let image = |noise: f32| Grid {
            width: 32,
            height: 32,
            data: (0..1024)
                .map(|k| [0.3 + 0.2 * (k as f32 * 0.7).sin() + noise * ((k * 31 % 17) as f32 / 8.0 - 1.0); 3])
                .collect(),
        };
        let mask = Grid::filled(32, 32, true);
        let compare = |noise| ssim(&image(0.0), &image(noise), &mask, [1.0; 3]).unwrap();
        assert!((compare(0.0) - 1.0).abs() < 1e-9);
        assert!(compare(0.02) < 0.999 && compare(0.1) < compare(0.02) - 0.02, "{} {}", compare(0.02), compare(0.1));
        assert_eq!(ssim(&image(0.0), &image(0.0), &Grid::filled(32, 32, false), [1.0; 3]), None);
    }
}
