//! Images for people: 8-bit sRGB, and differences.

use super::signal;
use crate::image::{Grid, Mask, RgbImage, to_srgb};

/// 8-bit sRGB pixels.
pub type DisplayImage = Grid<[u8; 3]>;

/// Linear radiance as 8-bit sRGB; `white` becomes 255. Values beyond are clamped, those that are not numbers black.
pub fn to_display(image: &RgbImage, white: [f64; 3]) -> DisplayImage {
    image.map(|pixel| {
        std::array::from_fn(|c| {
            let x = (pixel[c] as f64 / white[c]).clamp(0.0, 1.0);
            // NaN becomes 0.
            (to_srgb(x) * 255.0).round() as u8
        })
    })
}

/// `128 + amplification * 127 * (s - s')` of the signals on the pixels of `mask`, grey 128 elsewhere: what is too dark in `decoded`
/// is bright.
pub fn difference(
    original: &RgbImage,
    decoded: &RgbImage,
    mask: &Mask,
    white: [f64; 3],
    amplification: f64,
) -> DisplayImage {
    let pixel = |k: usize| {
        std::array::from_fn(|c| {
            let gap = signal(original.data[k][c], white[c]) - signal(decoded.data[k][c], white[c]);
            let shown = mask.data[k] && gap.is_finite();
            if shown { (128.0 + amplification * 127.0 * gap).round().clamp(0.0, 255.0) as u8 } else { 128 }
        })
    };
    Grid { width: mask.width, height: mask.height, data: (0..mask.data.len()).map(pixel).collect() }
}

#[cfg(test)]
mod tests {
    use crate::metrics::display::*;

    #[test]
    fn white_is_255_and_differences_are_signed() {
        let image: RgbImage = Grid { width: 2, height: 1, data: vec![[0.5, 0.25, 9.0], [f32::NAN, -1.0, 0.107]] };
        let shown = to_display(&image, [0.5; 3]);
        assert_eq!(shown.data, vec![[255, 188, 255], [0, 0, 127]]);
        let darker = image.map(|p| p.map(|x| x * 0.81));
        let gaps = difference(&image, &darker, &Grid { width: 2, height: 1, data: vec![true, true] }, [0.5; 3], 5.0);
        // s = 1 against 0.9: 5 * 127 * 0.1 above the middle.
        assert!((191..=192).contains(&gaps.data[0][0]));
        assert_eq!(gaps.data[1], [128, 128, gaps.data[1][2]]);
    }
}
