//! The light around the sphere: a lat-long picture with its averages.

use crate::image::{Grid, RgbImage};
use std::f64::consts::PI;

/// A lat-long environment, as Mitsuba has it: rows from the zenith (`+y`) to the nadir; columns from `-z` (behind the sphere) over `+x`
/// and `+z` (the middle, behind the camera) once around.
#[derive(Debug, Clone)]
pub struct PreviewEnvironment {
    /// The picture, then each averaged over 2 x 2 texels of the one before.
    levels: Vec<RgbImage>,
    /// Solid angle of a texel of the first level at the horizon.
    texel: f64,
}

impl PreviewEnvironment {
    /// Creates an environment from a lat-long image of linear radiance. Negative values and those that are not numbers count as 0. An empty image is black.
    pub fn new(picture: &RgbImage) -> Self {
        let known = |x: f32| if x.is_finite() { x.max(0.0) } else { 0.0 };
        let mut level = picture.map(|pixel| pixel.map(known));
        if level.data.is_empty() {
            level = Grid::filled(2, 1, [0.0; 3]);
        }
        let texel = 2.0 * PI / level.width as f64 * PI / level.height as f64;
        let mut levels = Vec::new();
        while level.width > 4 && level.height > 2 {
            let next = halved(&level);
            levels.push(std::mem::replace(&mut level, next));
        }
        levels.push(level);
        PreviewEnvironment { levels, texel }
    }

    /// Radiance about a direction, averaged over about the solid angle.
    pub fn average_radiance(&self, direction: [f64; 3], solid_angle: f64) -> [f32; 3] {
        let level = (0.5 * (solid_angle / self.texel).max(1.0).log2()).min((self.levels.len() - 1) as f64);
        let (lower, part) = (level as usize, level.fract() as f32);
        let u = direction[0].atan2(-direction[2]) / (2.0 * PI);
        let v = direction[1].clamp(-1.0, 1.0).acos() / PI;
        let first = self.look_up(lower, u, v);
        if part <= 0.0 {
            return first;
        }
        let second = self.look_up((lower + 1).min(self.levels.len() - 1), u, v);
        std::array::from_fn(|k| first[k] + (second[k] - first[k]) * part)
    }

    /// One level between its texels.
    fn look_up(&self, level: usize, u: f64, v: f64) -> [f32; 3] {
        let picture = &self.levels[level];
        let x = u * picture.width as f64 - 0.5 + picture.width as f64;
        let y = (v * picture.height as f64 - 0.5).clamp(0.0, (picture.height - 1) as f64);
        let (column, row) = (x as usize, y as usize);
        let (along, down) = ((x - column as f64) as f32, (y - row as f64) as f32);
        let at = |i: usize, j: usize| picture.value_at((column + i) % picture.width, (row + j).min(picture.height - 1));
        let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
        std::array::from_fn(|k| {
            let (top, bottom) = (a[k] + (b[k] - a[k]) * along, c[k] + (d[k] - c[k]) * along);
            top + (bottom - top) * down
        })
    }
}

/// Averages over 2 x 2 texels, each with its solid angle; the last row and column of odd sizes join the ones before.
fn halved(picture: &RgbImage) -> RgbImage {
    let (width, height) = (picture.width / 2, picture.height / 2);
    let mut sums = Grid::filled(width, height, [0.0f64; 4]);
    for y in 0..picture.height {
        let weight = ((y as f64 + 0.5) / picture.height as f64 * PI).sin();
        for x in 0..picture.width {
            let sum = sums.value_at_mut((x / 2).min(width - 1), (y / 2).min(height - 1));
            let pixel = picture.value_at(x, y);
            (0..3).for_each(|c| sum[c] += weight * pixel[c] as f64);
            sum[3] += weight;
        }
    }
    sums.map(|sum| std::array::from_fn(|c| (sum[c] / sum[3].max(1e-30)) as f32))
}

/// The standard environment: a dusk sky over dark ground, a low sun, a window of four panes, a strip light and a few lamps. 512 x 256.
pub fn studio_environment() -> RgbImage {
    let (width, height) = (512, 256);
    let pixel = |k: usize| {
        let (azimuth, height_angle) = (
            (((k % width) as f64 + 0.5) / width as f64 + 0.5).fract() * 2.0 * PI - PI,
            PI / 2.0 - ((k / width) as f64 + 0.5) / height as f64 * PI,
        );
        let direction = direction_of(azimuth, height_angle);
        let rise = direction[1];
        let mut light = if rise > 0.0 {
            let fade = (1.0 - rise).powi(3);
            [0.10 + 0.50 * fade, 0.16 + 0.34 * fade, 0.30 + 0.20 * fade]
        } else {
            let near = 0.6 + 0.4 * (-rise);
            [0.12 * near, 0.10 * near, 0.08 * near]
        };
        let mut add = |amount: f64, colour: [f64; 3]| (0..3).for_each(|c| light[c] += amount * colour[c]);
        let (azimuth_deg, height_deg) = (azimuth.to_degrees(), height_angle.to_degrees());
        // The sun: a soft disc of about four degrees.
        add(150.0 * lobe(direction, direction_of(-130f64.to_radians(), 25f64.to_radians()), 900.0), [1.0, 0.72, 0.42]);
        // A window to the right of the camera: four panes with dark bars between.
        let pane = |centre: [f64; 2]| edge(azimuth_deg - centre[0], 9.0) * edge(height_deg - centre[1], 9.0);
        let panes = pane([110.0, 12.0]) + pane([131.0, 12.0]) + pane([110.0, 33.0]) + pane([131.0, 33.0]);
        add(9.0 * panes, [0.85, 0.95, 1.1]);
        // A strip light above, behind the sphere.
        add(14.0 * edge(azimuth_deg - 10.0, 40.0) * edge(height_deg - 62.0, 3.0), [1.0, 0.95, 0.85]);
        for (azimuth, height, colour) in [
            (-40.0f64, 5.0f64, [1.0, 0.3, 0.2]),
            (-65.0, 15.0, [0.3, 1.0, 0.4]),
            (60.0, -10.0, [0.3, 0.4, 1.0]),
            (175.0, 50.0, [1.0, 1.0, 1.0]),
        ] {
            add(25.0 * lobe(direction, direction_of(azimuth.to_radians(), height.to_radians()), 1500.0), colour);
        }
        light.map(|x| x as f32)
    };
    Grid { width, height, data: (0..width * height).map(pixel).collect() }
}

/// Azimuth 0 is towards `-z`, a quarter towards `+x`.
fn direction_of(azimuth: f64, height: f64) -> [f64; 3] {
    let (sine, cosine) = azimuth.sin_cos();
    [height.cos() * sine, height.sin(), -height.cos() * cosine]
}

/// A spherical Gaussian.
fn lobe(direction: [f64; 3], axis: [f64; 3], sharpness: f64) -> f64 {
    (sharpness * (direction[0] * axis[0] + direction[1] * axis[1] + direction[2] * axis[2] - 1.0)).exp()
}

/// 1 within `half` degrees, falling to 0 over one more.
fn edge(distance_deg: f64, half: f64) -> f64 {
    (half + 0.5 - distance_deg.abs()).clamp(0.0, 1.0)
}
