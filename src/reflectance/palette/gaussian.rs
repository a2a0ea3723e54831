//! Palettes for those who know Torrance and Sparrow's lobe only: each width's shape as the Gaussian that is nearest to it.

use super::{PaletteEntry, shape};
use crate::reflectance::maps::ReflectanceMaps;
use crate::reflectance::torrance_sparrow::SIGMA_LEVELS;
use crate::reflectance::torrance_sparrow::SIGMA_RANGE;
use crate::reflectance::torrance_sparrow::{level_of_sigma, sigma_of_level};
use std::borrow::Cow;
use std::f64::consts::FRAC_PI_2;

/// Difference angle at which a shape is taken, radians. Captures seldom see one of 0; at grazing angles no Gaussian is near.
const DIFFERENCE: f64 = 0.35;

impl ReflectanceMaps {
    /// The maps without their palette: for each texel the colour and the width of `K_s exp(-alpha^2 / (2 sigma^2)) / (cos_i cos_r)` that differs
    /// least, squared over the solid angle of the half vector, from what the palette says where the half vector is about 20 degrees
    /// from light and view. Maps without a palette stay as they are.
    pub fn without_palette(&self) -> Cow<'_, ReflectanceMaps> {
        if self.palette.is_empty() {
            return Cow::Borrowed(self);
        }
        // Maps as they are decoded have few different widths.
        let mut nearest: Vec<Option<(f32, [f32; 3])>> = vec![None; SIGMA_LEVELS as usize + 1];
        let mut plain = ReflectanceMaps { palette: Vec::new(), ..self.clone() };
        for (sigma, colour) in plain.sigma.data.iter_mut().zip(&mut plain.specular.data) {
            if *sigma <= 0.0 {
                continue;
            }
            let level = (level_of_sigma(*sigma).round() as usize).min(SIGMA_LEVELS as usize);
            let (width, factor) = *nearest[level].get_or_insert_with(|| gaussian(&self.palette, level as i32));
            *sigma = width;
            (0..3).for_each(|c| colour[c] *= factor[c]);
        }
        Cow::Owned(plain)
    }
}

/// Width of the nearest Gaussian, and its height for each colour.
fn gaussian(palette: &[PaletteEntry], level: i32) -> (f32, [f32; 3]) {
    const STEPS: usize = 120;
    let sigma = sigma_of_level(level);
    let end = FRAC_PI_2.min(8.0 * sigma as f64);
    let cosines = DIFFERENCE.cos().powi(2);
    let seen: Vec<(f64, [f64; 3])> = (0..STEPS)
        .map(|k| (k as f64 + 0.5) / STEPS as f64 * end)
        .map(|angle| (angle, shape(palette, sigma, angle, DIFFERENCE).map(|f| f * cosines)))
        .collect();
    // What is left over of the squares, and the heights.
    let fitted = |width: f64| {
        let (mut products, mut square) = ([0.0; 3], 0.0);
        for (angle, values) in &seen {
            let lobe = (-0.5 * (angle / width).powi(2)).exp() * angle.sin();
            square += lobe * (-0.5 * (angle / width).powi(2)).exp();
            (0..3).for_each(|c| products[c] += lobe * values[c]);
        }
        let square = square.max(1e-300);
        (-products.iter().map(|p| p * p / square).sum::<f64>(), products.map(|p| p / square))
    };
    // Golden section over the logarithm of the width.
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    let (least, most) = (SIGMA_RANGE.0 as f64, SIGMA_RANGE.1 as f64);
    let middle = sigma as f64;
    let (mut low, mut high) = ((0.3 * middle).max(least).ln(), (3.0 * middle).min(most).ln());
    for _ in 0..30 {
        let (one, two) = (high - ratio * (high - low), low + ratio * (high - low));
        if fitted(one.exp()).0 < fitted(two.exp()).0 { high = two } else { low = one }
    }
    let width = (0.5 * (low + high)).exp();
    (width as f32, fitted(width).1.map(|height| height as f32))
}
