//! An environment map: radiance from all around, as a latitude-longitude image.
//!
//! World axes are right-handed with +Y up. The top row looks along +Y, the bottom row along -Y. From the left edge to the right
//! the image turns from -Z over +X (a quarter), +Z (its middle) and -X back to -Z: `u = atan2(x, -z) / 2 pi`, `v = acos(y) / pi`,
//! as Mitsuba's `envmap` has it. (Mitsuba spreads the centres of the first and the last row over the poles, 0.5 rows away from
//! this one at most.) Pixel `(column, row)` has its centre at `u = (column + 0.5) / width`, `v = (row + 0.5) / height`.

use crate::error::{Error, Result};
use crate::image::RgbImage;
use std::f64::consts::PI;

/// Radiance from all around.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentMap {
    image: RgbImage,
}

/// Pixels that were no light and had to be replaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CleanedPixels {
    /// Pixels with a negative colour, which became 0.
    pub negative: usize,
    /// Pixels that were not finite: the mean of their finite neighbours, or 0.
    pub not_finite: usize,
}

/// Cleans an image: see [`CleanedPixels`].
pub(crate) fn clean(image: &mut RgbImage) -> CleanedPixels {
    let mut cleaned = CleanedPixels::default();
    let finite = |p: &[f32; 3]| p.iter().all(|c| c.is_finite());
    let holes: Vec<usize> = (0..image.data.len()).filter(|&k| !finite(&image.data[k])).collect();
    for pixel in image.data.iter_mut().filter(|p| finite(p)) {
        if pixel.iter().any(|&c| c < 0.0) {
            cleaned.negative += 1;
            *pixel = pixel.map(|c| c.max(0.0));
        }
    }
    let (width, height) = (image.width, image.height);
    let filled: Vec<[f32; 3]> = (holes.iter())
        .map(|&k| {
            let (x, y) = (k % width, k / width);
            let (mut sum, mut count) = ([0.0f64; 3], 0.0f64);
            for ny in y.saturating_sub(1)..(y + 2).min(height) {
                for nx in [(x + width - 1) % width, x, (x + 1) % width] {
                    let pixel = image.value_at(nx, ny);
                    if finite(pixel) {
                        (0..3).for_each(|c| sum[c] += pixel[c] as f64);
                        count += 1.0;
                    }
                }
            }
            sum.map(|s| (s / count.max(1.0)) as f32)
        })
        .collect();
    cleaned.not_finite = holes.len();
    holes.into_iter().zip(filled).for_each(|(k, pixel)| image.data[k] = pixel);
    cleaned
}

impl EnvironmentMap {
    /// Makes an environment of a latitude-longitude image of at least 2 x 1 pixels, cleaned.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a smaller image.
    pub fn new(mut image: RgbImage) -> Result<(Self, CleanedPixels)> {
        if image.width < 2 || image.height < 1 || image.data.len() != image.width * image.height {
            return Err(Error::parameter("an environment needs 2 x 1 pixels at least"));
        }
        let cleaned = clean(&mut image);
        Ok((EnvironmentMap { image }, cleaned))
    }
    /// An environment from a function of the direction, `width` x `width / 2` pixels (`width` at least 2), negative and not finite
    /// values cleaned.
    pub fn from_fn(width: usize, radiance: impl Fn([f64; 3]) -> [f32; 3]) -> Self {
        let (width, height) = (width.max(2), (width / 2).max(1));
        let mut image = RgbImage::filled(width, height, [0.0; 3]);
        for y in 0..height {
            for x in 0..width {
                *image.value_at_mut(x, y) = radiance(direction_at(width, height, x as f64 + 0.5, y as f64 + 0.5));
            }
        }
        clean(&mut image);
        EnvironmentMap { image }
    }
    /// The image, row by row, all finite and not negative.
    pub fn image(&self) -> &RgbImage {
        &self.image
    }
    /// Returns the world direction of a position in the image, in pixels (centres at +0.5).
    pub fn direction(&self, x: f64, y: f64) -> [f64; 3] {
        direction_at(self.image.width, self.image.height, x, y)
    }
    /// Returns the position in the image, in pixels, of a unit direction.
    pub fn pixel_at(&self, direction: [f64; 3]) -> [f64; 2] {
        let u = direction[0].atan2(-direction[2]) / (2.0 * PI);
        let v = direction[1].clamp(-1.0, 1.0).acos() / PI;
        [(u - u.floor()) * self.image.width as f64, v * self.image.height as f64]
    }
    /// Radiance from a unit direction, bilinear between pixels.
    pub fn radiance(&self, direction: [f64; 3]) -> [f32; 3] {
        let [x, y] = self.pixel_at(direction);
        let (width, height) = (self.image.width, self.image.height);
        let (x, y) = (x - 0.5, y - 0.5);
        let (a, b) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
        let column = |x: f64| (x as isize).rem_euclid(width as isize) as usize;
        let row = |y: f64| (y as isize).clamp(0, height as isize - 1) as usize;
        let (left, right) = (column(x.floor()), column(x.floor() + 1.0));
        let (top, bottom) = (row(y.floor()), row(y.floor() + 1.0));
        let (p, q) = (self.image.value_at(left, top), self.image.value_at(right, top));
        let (r, s) = (self.image.value_at(left, bottom), self.image.value_at(right, bottom));
        std::array::from_fn(|c| (1.0 - b) * ((1.0 - a) * p[c] + a * q[c]) + b * ((1.0 - a) * r[c] + a * s[c]))
    }
    /// Solid angle of a pixel of a row.
    pub fn solid_angle(&self, row: usize) -> f64 {
        let edge = |y: usize| (PI * y as f64 / self.image.height as f64).cos();
        (edge(row) - edge(row + 1)) * 2.0 * PI / self.image.width as f64
    }
    /// Integral of the radiance over the sphere.
    pub fn integral(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for y in 0..self.image.height {
            let angle = self.solid_angle(y);
            for pixel in self.image.row(y) {
                (0..3).for_each(|c| sum[c] += angle * pixel[c] as f64);
            }
        }
        sum
    }
    /// With all radiance times `scale`.
    pub fn scaled(&self, scale: f32) -> Self {
        EnvironmentMap { image: self.image.map(|p| p.map(|c| (c * scale).clamp(0.0, f32::MAX))) }
    }
    /// Turned about +Y: what came from `d` comes from [`turn_y`]`(d, degrees)`, as Mitsuba's `rotate(y, degrees)` does.
    pub fn rotated_y(&self, degrees: f64) -> Self {
        let columns = -degrees / 360.0 * self.image.width as f64;
        let mut image = self.image.clone();
        let width = image.width;
        let whole = columns.floor();
        let part = (columns - whole) as f32;
        for y in 0..image.height {
            let source = self.image.row(y);
            for x in 0..width {
                let at = |step: f64| source[((x as f64 - whole - step).rem_euclid(width as f64)) as usize % width];
                let (near, far) = (at(0.0), at(1.0));
                *image.value_at_mut(x, y) = std::array::from_fn(|c| (1.0 - part) * near[c] + part * far[c]);
            }
        }
        EnvironmentMap { image }
    }
    /// Resampled to another size: means over the area of the new pixels where those are larger, bilinear where they are smaller.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (width, height) = (width.max(2), height.max(1));
        if width > self.image.width || height > self.image.height {
            return EnvironmentMap { image: self.enlarged(width, height) };
        }
        let columns = overlaps(self.image.width, width);
        let rows = overlaps(self.image.height, height);
        let angles: Vec<f64> = (0..self.image.height).map(|y| self.solid_angle(y)).collect();
        let mut image = RgbImage::filled(width, height, [0.0; 3]);
        let mut sums = vec![([0.0f64; 3], 0.0f64); width];
        for y in 0..height {
            sums.fill(([0.0; 3], 0.0));
            for &(source, share_of_row) in &rows[y] {
                let weight_of_row = share_of_row * angles[source];
                let row = self.image.row(source);
                for ((sum, total), columns) in sums.iter_mut().zip(&columns) {
                    for &(x, share) in columns {
                        let weight = weight_of_row * share;
                        (0..3).for_each(|c| sum[c] += weight * row[x][c] as f64);
                        *total += weight;
                    }
                }
            }
            for (x, (sum, total)) in sums.iter().enumerate() {
                *image.value_at_mut(x, y) = sum.map(|s| (s / total) as f32);
            }
        }
        EnvironmentMap { image }
    }
    fn enlarged(&self, width: usize, height: usize) -> RgbImage {
        let (w, h) = (self.image.width, self.image.height);
        let place = |k: usize, new: usize, old: usize| (k as f64 + 0.5) * old as f64 / new as f64 - 0.5;
        let mut image = RgbImage::filled(width, height, [0.0; 3]);
        for y in 0..height {
            let v = place(y, height, h);
            let b = (v - v.floor()) as f32;
            let row = |v: f64| self.image.row((v.max(0.0) as usize).min(h - 1));
            let (top, bottom) = (row(v.floor()), row(v.floor() + 1.0));
            for x in 0..width {
                let u = place(x, width, w);
                let a = (u - u.floor()) as f32;
                let left = (u.floor() as isize).rem_euclid(w as isize) as usize;
                let right = if left + 1 == w { 0 } else { left + 1 };
                *image.value_at_mut(x, y) = std::array::from_fn(|c| {
                    (1.0 - b) * ((1.0 - a) * top[left][c] + a * top[right][c])
                        + b * ((1.0 - a) * bottom[left][c] + a * bottom[right][c])
                });
            }
        }
        image
    }
}

/// A direction turned about +Y, counter-clockwise seen from above: +Z goes to +X at 90 degrees.
pub fn turn_y(direction: [f64; 3], degrees: f64) -> [f64; 3] {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let [x, y, z] = direction;
    [cosine * x + sine * z, y, cosine * z - sine * x]
}

/// Returns the direction of a position, in pixels, of a latitude-longitude image.
pub(crate) fn direction_at(width: usize, height: usize, x: f64, y: f64) -> [f64; 3] {
    let (phi, theta) = (2.0 * PI * x / width as f64, PI * y / height as f64);
    let (sine, cosine) = theta.sin_cos();
    [phi.sin() * sine, cosine, -phi.cos() * sine]
}

/// For each of `new` equal parts the old parts that it covers and how much of each.
fn overlaps(old: usize, new: usize) -> Vec<Vec<(usize, f64)>> {
    let scale = old as f64 / new as f64;
    (0..new)
        .map(|k| {
            let (start, end) = (k as f64 * scale, (k + 1) as f64 * scale);
            let last = (end.ceil() as usize).min(old);
            (start.floor() as usize..last)
                .map(|s| (s, end.min(s as f64 + 1.0) - start.max(s as f64)))
                .filter(|&(_, share)| share > 1e-9)
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> EnvironmentMap {
        let mut image = RgbImage::filled(32, 16, [0.0; 3]);
        (0..512).for_each(|k| image.data[k] = [(k % 32) as f32, (k / 32) as f32, 1.0]);
        EnvironmentMap::new(image).unwrap().0
    }

    #[test]
    fn directions_are_those_of_mitsuba() {
        // Values of Mitsuba 3.9's `envmap` for this image.
        let ramp = ramp();
        for (direction, column) in [([1.0, 0.0, 0.0], 7.5), ([0.0, 0.0, 1.0], 15.5), ([-1.0, 0.0, 0.0], 23.5)] {
            let found = ramp.radiance(direction);
            assert!((found[0] - column).abs() < 1e-5 && (found[1] - 7.5).abs() < 1e-5, "{direction:?} {found:?}");
        }
        assert!((ramp.radiance([0.0, 0.0, -1.0])[0] - 15.5).abs() < 1e-5, "between the last and the first column");
        let turned = ramp.rotated_y(90.0);
        for (direction, column) in [([0.0, 0.0, -1.0], 7.5), ([1.0, 0.0, 0.0], 15.5), ([0.0, 0.0, 1.0], 23.5)] {
            assert!((turned.radiance(direction)[0] - column).abs() < 1e-4, "{direction:?}");
        }
        let d = [0.3, 0.5, -(1.0f64 - 0.34).sqrt()];
        let moved = ramp.rotated_y(33.75).radiance(turn_y(d, 33.75));
        assert!((0..3).all(|c| (moved[c] - ramp.radiance(d)[c]).abs() < 1e-4));
        for (x, y) in [(0.2, 0.7), (31.9, 15.0), (12.5, 3.5)] {
            let [px, py] = ramp.pixel_at(ramp.direction(x, y));
            assert!((px - x).abs() < 1e-9 && (py - y).abs() < 1e-9);
        }
    }

    #[test]
    fn bad_pixels_are_replaced_and_counted() {
        let mut image = RgbImage::filled(8, 4, [1.0; 3]);
        image.data[3] = [-0.5, 2.0, 1.0];
        image.data[12] = [f32::NAN, 0.0, 0.0];
        image.data[13] = [f32::INFINITY, 0.0, 0.0];
        let (environment, cleaned) = EnvironmentMap::new(image).unwrap();
        assert_eq!(cleaned, CleanedPixels { negative: 1, not_finite: 2 });
        assert_eq!(environment.image().data[3], [0.0, 2.0, 1.0]);
        assert!((environment.image().data[13][0] - 1.0).abs() < 0.2);
        assert!(EnvironmentMap::new(RgbImage::filled(1, 1, [0.0; 3])).is_err());
    }

    #[test]
    fn size_does_not_change_the_light() {
        let environment = EnvironmentMap::from_fn(96, |d| [1.0 + d[1] as f32, (d[0].max(0.0) * 3.0) as f32, 0.5]);
        let whole = environment.integral();
        assert!((whole[2] - 2.0 * PI).abs() < 1e-9 && (whole[0] - 4.0 * PI).abs() < 0.02);
        for (width, height) in [(32, 16), (20, 11), (48, 24)] {
            let small = environment.resized(width, height).integral();
            assert!((0..3).all(|c| (small[c] / whole[c] - 1.0).abs() < 1e-3), "{width} {small:?} {whole:?}");
        }
    }
}
