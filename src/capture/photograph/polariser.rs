//! Diffuse and specular parts of linearly polarised light, out of images through a linear polariser at several angles.

use crate::image::RgbImage;

/// Angles that differ by less, modulo 180 degrees, are one.
const SAME_ANGLE: f64 = 1.0;
/// Images that the fit needs, at different angles.
pub(super) const MIN_ANGLES: usize = 3;
/// Pixels on either side whose phase a pixel takes part in.
const PHASE_RADIUS: usize = 1;

/// Returns the number of angles that differ from all before them, modulo 180 degrees.
pub(super) fn distinct(angles: &[f64]) -> usize {
    let differs = |a: f64, b: f64| {
        let turn = (a - b).rem_euclid(180.0);
        turn.min(180.0 - turn) >= SAME_ANGLE
    };
    (0..angles.len()).filter(|&k| angles[..k].iter().all(|&before| differs(angles[k], before))).count()
}

/// Sums of a least-squares fit of `I(t) = a + b cos 2t + c sin 2t` to the images of each angle.
pub(super) struct PolariserFit {
    /// For each image, its parts of `a`, `b` and `c`.
    weights: Vec<[f32; 3]>,
    sums: [RgbImage; 3],
}

impl PolariserFit {
    /// A fit of images of this size at these angles, in degrees, of which at least three are distinct.
    pub(super) fn new(angles: &[f64], width: usize, height: usize) -> Self {
        let rows: Vec<glam::DVec3> = angles
            .iter()
            .map(|angle| (2.0 * angle).to_radians())
            .map(|twice| glam::DVec3::new(1.0, twice.cos(), twice.sin()))
            .collect();
        let normal = rows
            .iter()
            .fold(glam::DMat3::ZERO, |sum, &row| sum + glam::DMat3::from_cols(row * row.x, row * row.y, row * row.z));
        let inverse = normal.inverse();
        PolariserFit {
            weights: rows.iter().map(|&row| (inverse * row).as_vec3().to_array()).collect(),
            sums: std::array::from_fn(|_| RgbImage::filled(width, height, [0.0; 3])),
        }
    }

    /// Adds the image of the angle of this number; what is missing in one is missing in all.
    pub(super) fn add(&mut self, number: usize, image: &RgbImage) {
        for (sum, weight) in self.sums.iter_mut().zip(self.weights[number]) {
            for (sum, value) in sum.data.iter_mut().zip(&image.data) {
                (0..3).for_each(|c| sum[c] += weight * value[c]);
            }
        }
    }

    /// Returns the photograph without the polariser before the camera, and half of its diffuse part.
    ///
    /// The phase is that of all colours and of the neighbours together: the length of `(b, c)` alone is never negative, so that noise of dull
    /// pixels would look specular.
    pub(super) fn split(self) -> (RgbImage, RgbImage) {
        let [mean, cosine, sine] = self.sums;
        let (width, height) = (mean.width, mean.height);
        let grey = |image: &RgbImage, index: usize| -> f32 { image.data[index].iter().sum() };
        // Missing pixels say nothing about their neighbours' phase.
        let known = |sum: f32| if sum.is_nan() { 0.0 } else { sum };
        let phase = |index: usize| -> [f32; 2] {
            let (x, y) = (index % width, index / width);
            let columns = x.saturating_sub(PHASE_RADIUS)..(x + PHASE_RADIUS + 1).min(width);
            let rows = y.saturating_sub(PHASE_RADIUS)..(y + PHASE_RADIUS + 1).min(height);
            let mut sum = [0.0f32; 2];
            for index in rows.flat_map(|y| columns.clone().map(move |x| y * width + x)) {
                sum[0] += known(grey(&cosine, index));
                sum[1] += known(grey(&sine, index));
            }
            let length = (sum[0] * sum[0] + sum[1] * sum[1]).sqrt();
            if length > 0.0 { sum.map(|part| part / length) } else { [1.0, 0.0] }
        };
        let crossed = |index: usize| {
            let [along, across] = phase(index);
            std::array::from_fn(|c| mean.data[index][c] - along * cosine.data[index][c] - across * sine.data[index][c])
        };
        let cross = RgbImage { width, height, data: (0..mean.data.len()).map(crossed).collect() };
        (mean.map(|value| value.map(|part| 2.0 * part)), cross)
    }
}
