//! Exposures of one scene, merged into one image.

use super::read::RadianceImage;
use super::{Mask, RgbImage};

/// Exposures that are being merged, the shortest first.
///
/// Each pixel is the mean of its values over their times, weighted by the squares of the times, which is the best estimate where noise is the same
/// whatever the exposure, as that of reading and rounding is (Robertson, Borman and Stevenson 2003). Exposures whose pixel or one of its neighbours
/// is clipped are left out there, as camera software interpolates colours; where all are clipped the shortest counts, and the pixel is clipped.
pub(crate) struct ExposureBracket {
    /// Sums of values times their times; what is missing is NaN. Clipped is what all exposures are.
    image: RadianceImage,
    /// Sum of the weights of each pixel; none while there is one exposure.
    weights: Vec<f32>,
    shortest: f32,
}

impl ExposureBracket {
    /// Begins with the shortest exposure, of this time.
    pub(crate) fn new(image: RadianceImage, time: f64) -> Self {
        ExposureBracket { image, weights: Vec::new(), shortest: time as f32 }
    }

    /// Width and height.
    pub(crate) fn size(&self) -> (u32, u32) {
        self.image.colour.size()
    }

    /// Adds an image of the same size and at least the same time.
    pub(crate) fn add(&mut self, other: &RadianceImage, time: f64) {
        let (shortest, time) = (self.shortest, time as f32);
        let pixels = self.image.colour.data.len();
        if self.weights.is_empty() {
            self.weights = vec![shortest * shortest; pixels];
            self.image.colour.data.iter_mut().for_each(|pixel| *pixel = pixel.map(|value| value * shortest));
        }
        let unusable = other
            .clipped
            .as_ref()
            .map_or_else(|| plateau(&other.colour), |clipped| Some(clipped.clone()))
            .map(|clipped| widened(&clipped));
        for index in 0..pixels {
            let value = other.colour.data[index];
            if value[0].is_nan() || unusable.as_ref().is_some_and(|mask| mask.data[index]) {
                continue;
            }
            let (sum, weight) = (&mut self.image.colour.data[index], &mut self.weights[index]);
            let is_clipped = self.image.clipped.as_ref().is_some_and(|mask| mask.data[index]);
            if sum[0].is_nan() || is_clipped {
                (*sum, *weight) = ([0.0; 3], 0.0);
            }
            (0..3).for_each(|c| sum[c] += time * value[c]);
            *weight += time * time;
            if let Some(clipped) = &mut self.image.clipped {
                clipped.data[index] = false;
            }
        }
    }

    /// Returns the radiance at time 1.
    pub(crate) fn finish(mut self) -> RadianceImage {
        let pixels = self.image.colour.data.iter_mut();
        match self.weights.as_slice() {
            [] if self.shortest == 1.0 => {}
            [] => pixels.for_each(|pixel| *pixel = pixel.map(|value| value / self.shortest)),
            weights => pixels.zip(weights).for_each(|(pixel, weight)| *pixel = pixel.map(|sum| sum / weight)),
        }
        self.image.clipped = self.image.clipped.filter(|clipped| clipped.data.contains(&true));
        self.image
    }
}

/// A mask and all neighbours of its pixels.
fn widened(mask: &Mask) -> Mask {
    let (width, height) = (mask.width, mask.height);
    let mut wide = Mask::filled(width, height, false);
    for (index, _) in mask.data.iter().enumerate().filter(|(_, set)| **set) {
        let (x, y) = (index % width, index / width);
        for row in y.saturating_sub(1)..(y + 2).min(height) {
            wide.data[row * width + x.saturating_sub(1)..row * width + (x + 2).min(width)].fill(true);
        }
    }
    wide
}

/// Part of an image that has its largest value where that is no highlight's but the sensor's.
const PLATEAU: f64 = 0.0005;

/// Pixels at the largest value of an image whose file says nothing about clipping, if that many are.
fn plateau(image: &RgbImage) -> Option<Mask> {
    let brightest = |pixel: &[f32; 3]| pixel[0].max(pixel[1]).max(pixel[2]);
    let most = image.data.iter().map(brightest).fold(0.0, f32::max);
    let mask = image.map(|pixel| brightest(pixel) >= 0.999 * most);
    (most > 0.0 && mask.count() as f64 > PLATEAU * mask.data.len() as f64).then_some(mask)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::ImageOrientation;

    #[test]
    fn a_bracket_gives_the_range_that_one_image_has_not() {
        let radiance = |k: usize| 1e-3 * 1.5f32.powi(k as i32);
        let exposed = |time: f64, says: bool| {
            let mut colour = RgbImage::filled(30, 12, [0.0; 3]);
            for (index, pixel) in colour.data.iter_mut().enumerate() {
                // Eight bits of the encoded value.
                let code = ((radiance(index % 30) * time as f32).min(1.0).sqrt() * 255.0).round() / 255.0;
                *pixel = [code * code; 3];
            }
            let clipped = says.then(|| colour.map(|pixel| pixel[0] >= 1.0));
            RadianceImage { colour, alpha: None, clipped, orientation: ImageOrientation::default() }
        };
        for says in [true, false] {
            let mut bracket = ExposureBracket::new(exposed(1.0 / 256.0, says), 1.0 / 256.0);
            [1.0 / 16.0, 1.0, 16.0].into_iter().for_each(|time| bracket.add(&exposed(time, says), time));
            let merged = bracket.finish();
            for k in 0..30 {
                let ratio = merged.colour.row(7)[k][1] / radiance(k);
                assert!((ratio - 1.0).abs() < 0.04, "{says}, {k}: {ratio}");
            }
            assert!(merged.clipped.is_none());
        }
        // What is clipped in all is that of the shortest.
        let mut bracket = ExposureBracket::new(exposed(1.0, true), 1.0);
        bracket.add(&exposed(2.0, true), 2.0);
        let merged = bracket.finish();
        let clipped = merged.clipped.unwrap();
        assert!((0..30).all(|k| clipped.row(0)[k] == (radiance(k) >= 1.0)) && merged.colour.row(0)[29][0] == 1.0);
    }
}
