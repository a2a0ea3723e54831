//! Image PSNR on the square-root signal.
//!
//! The signal is `s = sqrt(max(x, 0) / white)` per colour, not clamped above so that highlights count;
//! `PSNR = -10 log10 mean (s - s')^2` over the pixels of the mask that the mesh covers, and over the colours.

use crate::image::Mask;
use crate::transform::signal::measured;
use crate::views::{Component, Photograph};

/// PSNR in dB of a mean squared error of signals; `None` where there is no error (infinite).
pub fn psnr_db(mean_squared_error: f64) -> Option<f64> {
    (mean_squared_error > 0.0).then(|| -10.0 * mean_squared_error.log10())
}

/// A sum of squared differences; sums of several frames add up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SquaredError {
    /// Sum of `(s - s')^2`.
    pub sum: f64,
    /// Number of differences.
    pub count: u64,
}

impl SquaredError {
    /// Adds one difference.
    pub fn add(&mut self, difference: f64) {
        self.sum += difference * difference;
        self.count += 1;
    }
    /// Adds another sum.
    pub fn merge(&mut self, other: &SquaredError) {
        self.sum += other.sum;
        self.count += other.count;
    }
    /// PSNR in dB; `None` where nothing differs (infinite) or nothing was compared (see `count`).
    pub fn psnr_db(&self) -> Option<f64> {
        if self.count == 0 { None } else { psnr_db(self.sum / self.count as f64) }
    }
}

/// The errors of one frame, or of several joined.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PhotographError {
    /// Error of the diffuse image; nothing compared without polarisers.
    pub diffuse: SquaredError,
    /// Error of the specular image; nothing compared without polarisers.
    pub specular: SquaredError,
    /// Error of their sum; of the photograph itself without polarisers.
    pub sum: SquaredError,
    /// Pixels of the mask.
    pub masked_pixels: u64,
    /// Pixels of the mask that the mesh covers.
    pub covered_pixels: u64,
    /// Covered pixels not compared: not finite in the photograph.
    pub missing_pixels: u64,
}

/// PSNR of each image. `None` where nothing was compared or nothing differs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImagePsnr {
    /// dB, diffuse image.
    pub diffuse: Option<f64>,
    /// dB, specular image, `max(x, 0)`.
    pub specular: Option<f64>,
    /// dB, their sum.
    pub sum: Option<f64>,
}

impl PhotographError {
    /// Compares one decoded frame with its photograph on the pixels of the photograph's mask that `covered` has too.
    /// Both hold `components`; all have the mask's size.
    pub fn compare(
        original: &Photograph,
        decoded: &Photograph,
        components: &[Component],
        covered: &Mask,
        white: [f64; 3],
    ) -> Self {
        let mut error = PhotographError::default();
        let place = |component| components.iter().position(|&c| c == component);
        let polarised = place(Component::Diffuse).zip(place(Component::Specular));
        for k in (0..original.mask.data.len()).filter(|&k| original.mask.data[k]) {
            error.masked_pixels += 1;
            if !covered.data[k] {
                continue;
            }
            error.covered_pixels += 1;
            if original.images.iter().any(|image| image.data[k].iter().any(|x| !x.is_finite())) {
                error.missing_pixels += 1;
                continue;
            }
            for c in 0..3 {
                let value = |photograph: &Photograph, index: usize| photograph.images[index].data[k][c];
                let compare = |total: &mut SquaredError, a: f32, b: f32| {
                    // A decoded value that is not a number is as wrong as black.
                    let b = if b.is_finite() { b } else { 0.0 };
                    total.add(measured(a, white[c]) - measured(b, white[c]));
                };
                match polarised {
                    Some((d, s)) => {
                        let (diffuse, specular) = (value(original, d), value(original, s).max(0.0));
                        let (diffuse2, specular2) = (value(decoded, d), value(decoded, s).max(0.0));
                        compare(&mut error.diffuse, diffuse, diffuse2);
                        compare(&mut error.specular, specular, specular2);
                        compare(&mut error.sum, diffuse.max(0.0) + specular, diffuse2.max(0.0) + specular2);
                    }
                    None => compare(&mut error.sum, value(original, 0), value(decoded, 0)),
                }
            }
        }
        error
    }

    /// Adds another frame's errors.
    pub fn merge(&mut self, other: &PhotographError) {
        self.diffuse.merge(&other.diffuse);
        self.specular.merge(&other.specular);
        self.sum.merge(&other.sum);
        self.masked_pixels += other.masked_pixels;
        self.covered_pixels += other.covered_pixels;
        self.missing_pixels += other.missing_pixels;
    }

    /// The figures.
    pub fn psnr(&self) -> ImagePsnr {
        ImagePsnr { diffuse: self.diffuse.psnr_db(), specular: self.specular.psnr_db(), sum: self.sum.psnr_db() }
    }

    /// Share of the masks' pixels that the mesh covers; 1 without a masked pixel.
    pub fn coverage(&self) -> f64 {
        if self.masked_pixels == 0 { 1.0 } else { self.covered_pixels as f64 / self.masked_pixels as f64 }
    }
}

#[cfg(test)]
mod tests {
    use crate::image::Grid;
    use crate::metrics::psnr::*;

    const BOTH: [Component; 2] = [Component::Diffuse, Component::Specular];

    fn photograph(f: impl Fn(usize) -> [f32; 3]) -> Photograph {
        let image = Grid { width: 20, height: 10, data: (0..200).map(f).collect() };
        Photograph {
            mask: Grid { width: 20, height: 10, data: (0..200).map(|k| k % 20 < 15).collect() },
            images: vec![image.clone(), image],
        }
    }

    #[test]
    fn known_errors_have_the_known_figures() {
        let white = [0.5, 0.4, 0.3];
        // Signals 0.5 and 0.6: a difference of 0.1 everywhere is 20 dB; of the sums sqrt(2) (0.6 - 0.5): 16.99 dB.
        let level = |s: f64| move |_| white.map(|w| (s * s * w) as f32);
        let (a, b) = (photograph(level(0.5)), photograph(level(0.6)));
        let mut covered = a.mask.clone();
        covered.data[0] = false;
        let error = PhotographError::compare(&a, &b, &BOTH, &covered, white);
        assert!((error.psnr().diffuse.unwrap() - 20.0).abs() < 1e-4);
        assert!((error.psnr().specular.unwrap() - 20.0).abs() < 1e-4);
        assert!((error.psnr().sum.unwrap() - 16.9897).abs() < 1e-4);
        assert_eq!((error.masked_pixels, error.covered_pixels), (150, 149));
        let mut both = error;
        both.merge(&PhotographError::compare(&a, &a, &BOTH, &covered, white));
        assert!((both.psnr().diffuse.unwrap() - 23.0103).abs() < 1e-4);
    }

    #[test]
    fn a_capture_is_equal_to_itself_and_missing_pixels_are_counted() {
        let a = photograph(|k| [k as f32, -1.0, if k == 21 { f32::NAN } else { 0.3 }]);
        let error = PhotographError::compare(&a, &a, &BOTH, &a.mask, [1.0; 3]);
        assert_eq!(error.psnr(), ImagePsnr::default());
        assert_eq!((error.missing_pixels, error.sum.count), (1, 149 * 3));
    }
}
