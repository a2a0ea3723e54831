//! Error of decoded photographs in the figures that an encoder's target is given in.

use super::{PhotographError, signal};
use crate::image::Mask;
use crate::views::{Component, Photograph};

/// Error of all photographs of a file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Squared errors of all views together.
    pub error: PhotographError,
    /// Largest difference of a component's signal on a covered pixel.
    pub max_error: f64,
}

impl Distortion {
    /// Compares a decoded photograph with its original on the pixels that `covered` has too.
    /// Both hold `components` and have the size of their masks.
    pub fn compare(
        original: &Photograph,
        decoded: &Photograph,
        covered: &Mask,
        components: &[Component],
        white: [f64; 3],
    ) -> Self {
        let error = PhotographError::compare(original, decoded, components, covered, white);
        let mut max_error = 0f64;
        for (wanted, found) in original.images.iter().zip(&decoded.images) {
            for k in (0..covered.data.len()).filter(|&k| covered.data[k] && original.mask.data[k]) {
                for c in 0..3 {
                    let [wanted, found] = [wanted, found].map(|image| signal(image.data[k][c], white[c]));
                    max_error = max_error.max((wanted - found).abs());
                }
            }
        }
        Distortion { error, max_error }
    }

    /// Adds another photograph's error.
    pub fn merge(&mut self, other: &Distortion) {
        self.error.merge(&other.error);
        self.max_error = self.max_error.max(other.max_error);
    }

    /// Image PSNR of the sum in dB; infinite where nothing differs.
    pub fn psnr_db(&self) -> f64 {
        self.error.psnr().sum.unwrap_or(f64::INFINITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;

    #[test]
    fn only_covered_pixels_of_the_mask_count() {
        let photograph = |value: f32| Photograph {
            mask: Mask { width: 3, height: 1, data: vec![true, true, false] },
            images: vec![RgbImage { width: 3, height: 1, data: vec![[0.25; 3], [value; 3], [value; 3]] }],
        };
        let compare = |covered: [bool; 3]| {
            let covered = Mask { width: 3, height: 1, data: covered.to_vec() };
            Distortion::compare(&photograph(0.25), &photograph(0.49), &covered, &[Component::Combined], [1.0; 3])
        };
        let distortion = compare([true; 3]);
        assert!((distortion.max_error - 0.2).abs() < 1e-6);
        assert!((distortion.psnr_db() - 16.9897).abs() < 1e-3);
        assert_eq!(compare([true, false, true]).psnr_db(), f64::INFINITY);
        assert_eq!(compare([true, false, true]).max_error, 0.0);
    }
}
