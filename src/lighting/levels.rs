//! The environment through lobes of falling sharpness, for specular reflection.
//!
//! For each level the environment is resampled so that a lobe covers some ten pixels each way, rows near the poles with fewer
//! columns; then every cell of the level sums the pixels about its direction. Averaging pixels before blurs by their own width,
//! interpolating between cells after by that of a cell: both are taken off the lobe's.

use super::octahedral::{directions, solid_angles};
use super::prefiltered::{Level, SHARPNESS};
use super::{Environment, fit::spread};

/// Pixels for the standard deviation of a lobe, `1 / sqrt(sharpness)`.
const PIXELS: f64 = 1.5;
/// A lobe ends where it has fallen to `exp(-REACH)`.
const REACH: f64 = 7.5;
/// Steps of the table of `exp(-x)` in one unit of `x`.
const TABLE_STEPS: f32 = 256.0;

/// Cells along a side of the level of a sharpness: some three for a standard deviation, `largest` at most.
pub fn level_size(sharpness: f64, largest: usize) -> usize {
    let wanted = 10.1 * sharpness.sqrt();
    (wanted.min(8192.0) as usize).next_multiple_of(8).min(largest.max(8))
}

/// All levels of [`SHARPNESS`], the sharpest with `largest` cells a side at most (512 is a good number for environments of
/// 512 x 256 pixels).
pub fn levels(environment: &Environment, largest: usize) -> Vec<Level> {
    SHARPNESS.iter().filter_map(|&sharpness| level(environment, sharpness, level_size(sharpness, largest))).collect()
}

/// One level.
pub fn level(environment: &Environment, sharpness: f64, size: usize) -> Option<Level> {
    let rows = Rows::new(environment, sharpness);
    let table: Vec<f32> =
        (0..=(REACH as f32 * TABLE_STEPS) as usize + 1).map(|k| (-(k as f32) / TABLE_STEPS).exp()).collect();
    let (directions, angles) = (directions(size), solid_angles(size));
    let cells = crate::paper::parallel::map(size, |row| {
        let cells = directions.iter().zip(&angles).skip(row * size).take(size);
        cells.map(|(&d, &angle)| rows.mean(d, angle / 6.0, &table)).collect::<Vec<_>>()
    });
    Level::new(sharpness, size, cells.concat())
}

/// The resampled environment.
struct Rows {
    /// `1 / sharpness` of the lobe less the pixels' own blur.
    variance: f64,
    rows: Vec<Row>,
}

struct Row {
    /// Angle from +Y, its cosine and sine.
    theta: f64,
    cosine: f64,
    sine: f64,
    /// Unit directions and radiance of the pixels; every one has the same solid angle.
    pixels: Vec<([f32; 3], [f32; 3])>,
    solid_angle: f32,
}

impl Rows {
    fn new(environment: &Environment, sharpness: f64) -> Self {
        let width = (2.0 * std::f64::consts::PI * PIXELS * sharpness.sqrt()).ceil() as usize;
        // Even the sharpest lobe sees no more than what lies between pixels, which is bilinear.
        let width = width.clamp(32, (4 * environment.image().width).max(32)).next_multiple_of(32);
        let small = environment.resized(width, width / 2);
        let averaged = small.image().width < environment.image().width;
        let pixel = 2.0 * std::f64::consts::PI / width as f64;
        let own_blur = if averaged { pixel * pixel / 12.0 } else { 0.0 };
        let rows = (0..small.image().height)
            .map(|y| {
                let theta = std::f64::consts::PI * (y as f64 + 0.5) / small.image().height as f64;
                let (sine, cosine) = theta.sin_cos();
                // Pixels of a row near a pole are put together in twos, fours, ...
                let mut group = 1;
                while group < 16 && sine * (group as f64) < 0.5 {
                    group *= 2;
                }
                let pixels = (small.image().row(y).chunks_exact(group).enumerate())
                    .map(|(k, pixels)| {
                        let at = (k as f64 + 0.5) * group as f64;
                        let direction = small.direction(at, y as f64 + 0.5).map(|x| x as f32);
                        let sum = pixels.iter().fold([0.0; 3], |s, p| std::array::from_fn(|c| s[c] + p[c]));
                        (direction, sum.map(|s: f32| s / group as f32))
                    })
                    .collect();
                Row { theta, cosine, sine, pixels, solid_angle: (small.solid_angle(y) * group as f64) as f32 }
            })
            .collect();
        Rows { variance: 1.0 / sharpness - own_blur, rows }
    }

    /// Mean radiance about a direction, where interpolation will add `blur` to the variance.
    fn mean(&self, direction: [f64; 3], blur: f64, table: &[f32]) -> [f32; 3] {
        use std::f64::consts::PI;
        let sharpness = 1.0 / (self.variance - blur.min(0.5 * self.variance));
        let least = 1.0 - REACH / sharpness;
        let radius = if least > -1.0 { least.acos() } else { PI };
        let theta = direction[1].clamp(-1.0, 1.0).acos();
        let phi = direction[0].atan2(-direction[2]);
        let (cosine, sine) = (direction[1], (1.0 - direction[1] * direction[1]).max(0.0).sqrt());
        let to_rows = self.rows.len() as f64 / PI;
        let first = ((theta - radius) * to_rows - 0.5).floor().max(0.0) as usize;
        let last = (((theta + radius) * to_rows - 0.5).ceil() as usize).min(self.rows.len() - 1);
        let direction = direction.map(|x| x as f32);
        let scale = sharpness as f32 * TABLE_STEPS;
        let (mut sum, mut total) = ([0.0f32; 3], 0.0f32);
        for row in &self.rows[first..=last] {
            if (row.theta - theta).abs() > radius + 1.0 / to_rows {
                continue;
            }
            let count = row.pixels.len();
            // Columns within the lobe's reach.
            let limit = (least - row.cosine * cosine) / (row.sine * sine).max(1e-12);
            let half = if limit <= -1.0 {
                PI
            } else if limit >= 1.0 {
                0.0
            } else {
                limit.acos()
            };
            let to_columns = count as f64 / (2.0 * PI);
            let middle = phi.rem_euclid(2.0 * PI) * to_columns - 0.5;
            let reach = half * to_columns;
            let (start, end) = if reach * 2.0 + 2.0 >= count as f64 {
                (0, count as isize - 1)
            } else {
                ((middle - reach).floor() as isize, (middle + reach).ceil() as isize)
            };
            let (mut row_sum, mut row_total) = ([0.0f32; 3], 0.0f32);
            for column in start..=end {
                let column = if column < 0 {
                    column + count as isize
                } else if column >= count as isize {
                    column - count as isize
                } else {
                    column
                };
                let (d, radiance) = &row.pixels[column as usize];
                let cosine = d[0] * direction[0] + d[1] * direction[1] + d[2] * direction[2];
                let at = ((1.0 - cosine) * scale).max(0.0);
                let index = at as usize;
                if index + 1 < table.len() {
                    let weight = table[index] + (at - index as f32) * (table[index + 1] - table[index]);
                    (0..3).for_each(|c| row_sum[c] += weight * radiance[c]);
                    row_total += weight;
                }
            }
            (0..3).for_each(|c| sum[c] += row.solid_angle * row_sum[c]);
            total += row.solid_angle * row_total;
        }
        sum.map(|s| s / total.max(f32::MIN_POSITIVE))
    }
}

/// The environment between pixels, for sums over all of it.
struct Fine {
    /// Directions, by row, and radiance times the sine of the row's angle.
    environment: Environment,
    turns: Vec<[f64; 2]>,
}

impl Fine {
    fn new(environment: &Environment) -> Self {
        let image = environment.image();
        let parts = 1024usize.div_ceil(image.width).clamp(1, 4);
        let environment = environment.resized(image.width * parts, image.height * parts);
        let width = environment.image().width;
        let turn = |x: usize| (2.0 * std::f64::consts::PI * (x as f64 + 0.5) / width as f64).sin_cos();
        let turns = (0..width).map(|x| turn(x).into()).collect();
        Fine { environment, turns }
    }
    /// Mean radiance weighted by a lobe: the sum over all points.
    fn mean(&self, direction: [f64; 3], sharpness: f64) -> [f64; 3] {
        let image = self.environment.image();
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for y in 0..image.height {
            let (sine, cosine) = (std::f64::consts::PI * (y as f64 + 0.5) / image.height as f64).sin_cos();
            let constant = sharpness * (direction[1] * cosine - 1.0);
            let across = sharpness * sine;
            for (&[sx, cx], radiance) in self.turns.iter().zip(image.row(y)) {
                let exponent = constant + across * (direction[0] * sx - direction[2] * cx);
                if exponent > -25.0 {
                    let weight = exponent.exp() * sine;
                    (0..3).for_each(|c| sum[c] += weight * radiance[c] as f64);
                    total += weight;
                }
            }
        }
        sum.map(|s| s / total)
    }
}

/// For each level the root mean square error over the root mean square, in `count` directions between its cells, against
/// the sum over all points of the environment.
pub fn relative_errors(environment: &Environment, levels: &[Level], count: usize) -> Vec<f64> {
    let directions: Vec<[f64; 3]> = spread(count).collect();
    let fine = Fine::new(environment);
    levels
        .iter()
        .map(|level| {
            let sums = crate::paper::parallel::map(count, |k| {
                let exact = fine.mean(directions[k], level.sharpness());
                let found = level.mean(directions[k]);
                let squared = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
                (squared(std::array::from_fn(|c| found[c] as f64 - exact[c])), squared(exact))
            });
            let (error, whole) = sums.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            if whole > 0.0 { (error / whole).sqrt() } else { 0.0 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        let sizes: Vec<usize> = SHARPNESS.iter().map(|&sharpness| level_size(sharpness, 512)).collect();
        assert_eq!(sizes, [512, 512, 368, 184, 96, 48, 24]);
    }

    #[test]
    fn levels_agree_with_sums_over_all_pixels() {
        let environment = Environment::from_fn(64, |d| {
            let sun = (60.0 * (d[0] * 0.6 + d[1] * 0.8 - 1.0)).exp() as f32;
            [0.2 + 20.0 * sun, 0.3 + d[1].max(0.0) as f32, if d[2] > 0.3 { 1.0 } else { 0.1 }]
        });
        for (sharpness, bound) in [(1312.0, 0.02), (82.0, 0.01), (5.0, 0.01)] {
            let level = level(&environment, sharpness, level_size(sharpness, 256)).unwrap();
            let error = relative_errors(&environment, &[level], 24)[0];
            assert!(error < bound, "{sharpness}: {error}");
        }
    }
}
