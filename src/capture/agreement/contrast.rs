//! Local contrast of a photograph: logarithms of its brightness, without their mean around each pixel and over their deviation there.

use crate::image::{Grid, RgbImage};

/// Half the side of the window around each pixel, in pixels.
pub(super) const RADIUS: usize = 3;
/// Deviations of logarithms below this are noise.
const NOISE: f32 = 0.02;
/// Brightness below this share of the photograph's mean is dark.
const DARK: f32 = 0.05;

/// Local contrast; 0 where a pixel is missing.
pub(super) type Contrast = Grid<f32>;

/// Returns the local contrast of a photograph at a smaller size.
pub(super) fn contrast(photograph: &RgbImage, width: usize, height: usize) -> Contrast {
    let small = reduced(photograph, width, height);
    let (sum, count) = small.data.iter().filter(|x| x.is_finite()).fold((0.0, 0u32), |(s, n), x| (s + x, n + 1));
    let dark = (DARK * sum / count.max(1) as f32).max(f32::MIN_POSITIVE);
    let signal = small.map(|x| (x + dark).ln());
    // Sums of values, of their squares, and numbers: over rows, then over columns.
    let window = |size: usize, at: usize| at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(size);
    let mut rows = Grid::filled(width, height, [0.0f32; 3]);
    for y in 0..height {
        for x in 0..width {
            let values = signal.row(y)[window(width, x)].iter().filter(|value| value.is_finite());
            *rows.value_at_mut(x, y) = values.fold([0.0; 3], |[s, q, n], v| [s + v, q + v * v, n + 1.0]);
        }
    }
    let mut contrast = Contrast::filled(width, height, 0.0);
    for y in 0..height {
        for x in 0..width {
            let value = *signal.value_at(x, y);
            if value.is_finite() {
                let sums = window(height, y).map(|row| *rows.value_at(x, row));
                let [sum, squares, count] = sums.fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
                let mean = sum / count;
                let deviation = (squares / count - mean * mean).max(0.0).sqrt();
                *contrast.value_at_mut(x, y) = (value - mean) / (deviation + NOISE);
            }
        }
    }
    contrast
}

/// Mean brightness, sums of the colours and not below zero, of the pixels that each pixel of a smaller picture covers; missing ones do not count,
/// and are NaN where there are no others.
fn reduced(image: &RgbImage, width: usize, height: usize) -> Grid<f32> {
    let bounds = |at: usize, small: usize, large: usize| {
        let from = (at * large / small).min(large - 1);
        from..((at + 1) * large / small).clamp(from + 1, large)
    };
    let mut small = Grid::filled(width, height, f32::NAN);
    for y in 0..height {
        let rows = bounds(y, height, image.height);
        for x in 0..width {
            let columns = bounds(x, width, image.width);
            let pixels = rows.clone().flat_map(|row| &image.row(row)[columns.clone()]);
            let (mut sum, mut count) = (0.0f32, 0u32);
            for [red, green, blue] in pixels {
                let brightness = red + green + blue;
                if brightness.is_finite() {
                    sum += brightness.max(0.0);
                    count += 1;
                }
            }
            if count > 0 {
                *small.value_at_mut(x, y) = sum / count as f32;
            }
        }
    }
    small
}
