//! The environment through lobes of falling sharpness, for specular reflection.
//!
//! For each map the environment is resampled so that a lobe covers some ten pixels each way, rows near the poles with fewer
//! columns; then every cell of the map sums the pixels about its direction. Averaging pixels before blurs by their own width,
//! interpolating between cells after by that of a cell: both are taken off the lobe's.

use super::prefiltered::{PrefilteredMap, SHARPNESS};
use super::{EnvironmentMap, fit::spread_directions};
use crate::sphere::octahedral::{directions, solid_angles};

/// Pixels for the standard deviation of a lobe, `1 / sqrt(sharpness)`.
const PIXELS: f64 = 1.3;
/// A lobe ends where it has fallen to `exp(-REACH)`.
const REACH: f64 = 7.0;
/// Pixels that are worked on at a time.
const LANES: usize = 8;

/// Cells along a side of the map of a sharpness: some three for a standard deviation, `largest` at most.
pub(crate) fn map_size(sharpness: f64, largest: usize) -> usize {
    let wanted = 10.1 * sharpness.sqrt();
    (wanted.min(8192.0) as usize).next_multiple_of(8).min(largest.max(8))
}

/// All maps of `SHARPNESS`, the sharpest with `largest` cells a side at most (512 is a good number for environments of
/// 512 x 256 pixels).
pub fn prefiltered_maps(environment: &EnvironmentMap, largest: usize) -> Vec<PrefilteredMap> {
    SHARPNESS
        .iter()
        .filter_map(|&sharpness| prefiltered_map(environment, sharpness, map_size(sharpness, largest)))
        .collect()
}

/// Returns one map; `None` if `size` or `sharpness` is not positive.
pub fn prefiltered_map(environment: &EnvironmentMap, sharpness: f64, size: usize) -> Option<PrefilteredMap> {
    let rows = EnvironmentRows::new(environment, sharpness);
    let (directions, angles) = (directions(size), solid_angles(size));
    let cells = crate::parallel::map(size, |row| {
        let cells = directions.iter().zip(&angles).skip(row * size).take(size);
        cells.map(|(&d, &angle)| rows.mean(d, angle / 6.0)).collect::<Vec<_>>()
    });
    PrefilteredMap::new(sharpness, size, cells.concat())
}

/// The resampled environment.
struct EnvironmentRows {
    /// `1 / sharpness` of the lobe less the pixels' own blur.
    variance: f64,
    rows: Vec<EnvironmentRow>,
}

struct EnvironmentRow {
    /// Angle from +Y, its cosine and sine.
    theta: f64,
    cosine: f64,
    sine: f64,
    solid_angle: f32,
    /// Pixels in the row, every one of the same solid angle.
    count: usize,
    /// x and z of the pixels' unit directions, then red, green, blue.
    lists: [Vec<f32>; 5],
}

impl EnvironmentRow {
    /// Sum of the weighted radiance and of the weights of some pixels. The weight is `exp(-x)`, `x = constant - a . (x, z)`, as
    /// `(1 - x / 1024)^1024`, which is 0.2 % less at `x = 2` and costs a few products of whole lanes.
    #[inline]
    fn sum(&self, pixels: std::ops::Range<usize>, constant: f32, across: [f32; 2], sums: &mut [[f32; LANES]; 4]) {
        let [x, z, r, g, b] = self.lists.each_ref().map(|list| &list[pixels.clone()]);
        let whole = x.len() / LANES * LANES;
        let weight = |x: f32, z: f32| {
            let base = (constant + across[0] * x + across[1] * z).max(0.0);
            (0..10).fold(base, |power, _| power * power)
        };
        let lanes = |list: &[f32], at: usize| -> [f32; LANES] { std::array::from_fn(|k| list[at + k]) };
        for at in (0..whole).step_by(LANES) {
            let (x, z) = (lanes(x, at), lanes(z, at));
            let (r, g, b) = (lanes(r, at), lanes(g, at), lanes(b, at));
            let weights: [f32; LANES] = std::array::from_fn(|k| weight(x[k], z[k]));
            for k in 0..LANES {
                sums[0][k] += weights[k] * r[k];
                sums[1][k] += weights[k] * g[k];
                sums[2][k] += weights[k] * b[k];
                sums[3][k] += weights[k];
            }
        }
        for k in whole..x.len() {
            let weight = weight(x[k], z[k]);
            for (sum, value) in sums.iter_mut().zip([r[k], g[k], b[k], 1.0]) {
                sum[k - whole] += weight * value;
            }
        }
    }
}

impl EnvironmentRows {
    fn new(environment: &EnvironmentMap, sharpness: f64) -> Self {
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
                let mut lists = std::array::from_fn(|_| Vec::new());
                for (k, pixels) in small.image().row(y).chunks_exact(group).enumerate() {
                    let phi = pixel * (k as f64 + 0.5) * group as f64;
                    let sum = pixels.iter().fold([0.0; 3], |s, p| std::array::from_fn(|c| s[c] + p[c]));
                    let [r, g, b] = sum.map(|s: f32| s / group as f32);
                    let values = [(phi.sin() * sine) as f32, (-phi.cos() * sine) as f32, r, g, b];
                    lists.iter_mut().zip(values).for_each(|(list, value): (&mut Vec<f32>, f32)| list.push(value));
                }
                let solid_angle = (small.solid_angle(y) * group as f64) as f32;
                EnvironmentRow { theta, cosine, sine, solid_angle, count: lists[0].len(), lists }
            })
            .collect();
        EnvironmentRows { variance: 1.0 / sharpness - own_blur, rows }
    }

    /// Mean radiance about a direction, where interpolation will add `blur` to the variance.
    fn mean(&self, direction: [f64; 3], blur: f64) -> [f32; 3] {
        use std::f64::consts::PI;
        let sharpness = 1.0 / (self.variance - blur.min(0.5 * self.variance));
        let least = 1.0 - REACH / sharpness;
        let radius = if least > -1.0 { least.acos() } else { PI };
        let theta = direction[1].clamp(-1.0, 1.0).acos();
        let phi = direction[0].atan2(-direction[2]).rem_euclid(2.0 * PI);
        let (cosine, sine) = (direction[1], (1.0 - direction[1] * direction[1]).max(0.0).sqrt());
        let to_rows = self.rows.len() as f64 / PI;
        let first = ((theta - radius) * to_rows - 0.5).floor().max(0.0) as usize;
        let last = (((theta + radius) * to_rows - 0.5).ceil() as usize).min(self.rows.len() - 1);
        // A base of the power: `1 + sharpness (cosine - 1) / 1024`.
        let part = sharpness / 1024.0;
        let across = [(part * direction[0]) as f32, (part * direction[2]) as f32];
        let (mut sum, mut total) = ([0.0f32; 3], 0.0f32);
        for row in &self.rows[first..=last] {
            let constant = (1.0 + part * (direction[1] * row.cosine - 1.0)) as f32;
            // Columns within the lobe's reach.
            let limit = (least - row.cosine * cosine) / (row.sine * sine).max(1e-12);
            if limit >= 1.0 && (row.theta - theta).abs() * to_rows > 1.0 {
                continue;
            }
            let half = limit.clamp(-1.0, 1.0).acos();
            let to_columns = row.count as f64 / (2.0 * PI);
            let (middle, reach) = (phi * to_columns - 0.5, half * to_columns);
            let mut sums = [[0.0f32; LANES]; 4];
            if reach * 2.0 + 3.0 >= row.count as f64 {
                row.sum(0..row.count, constant, across, &mut sums);
            } else {
                let (start, end) = ((middle - reach).floor() as isize, (middle + reach).ceil() as isize + 1);
                let (count, low) = (row.count as isize, start.max(0) as usize);
                row.sum(low..end.min(count) as usize, constant, across, &mut sums);
                // What lies beyond the ends of the row is at its other end.
                if start < 0 {
                    row.sum((start + count) as usize..row.count, constant, across, &mut sums);
                }
                if end > count {
                    row.sum(0..(end - count) as usize, constant, across, &mut sums);
                }
            }
            let [r, g, b, weight] = sums.map(|lanes| lanes.iter().sum::<f32>());
            (0..3).for_each(|c| sum[c] += row.solid_angle * [r, g, b][c]);
            total += row.solid_angle * weight;
        }
        sum.map(|s| s / total.max(f32::MIN_POSITIVE))
    }
}

/// The environment between pixels, for sums over all of it.
struct FineEnvironment {
    /// Directions, by row, and radiance times the sine of the row's angle.
    environment: EnvironmentMap,
    turns: Vec<[f64; 2]>,
}

impl FineEnvironment {
    fn new(environment: &EnvironmentMap) -> Self {
        let image = environment.image();
        let parts = 1024usize.div_ceil(image.width).clamp(1, 4);
        let environment = environment.resized(image.width * parts, image.height * parts);
        let width = environment.image().width;
        let turn = |x: usize| (2.0 * std::f64::consts::PI * (x as f64 + 0.5) / width as f64).sin_cos();
        let turns = (0..width).map(|x| turn(x).into()).collect();
        FineEnvironment { environment, turns }
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

/// For each map the root mean square error over the root mean square, in `count` directions between its cells, against
/// the sum over all points of the environment.
pub fn prefiltered_errors(environment: &EnvironmentMap, levels: &[PrefilteredMap], count: usize) -> Vec<f64> {
    let directions: Vec<[f64; 3]> = spread_directions(count).collect();
    let fine = FineEnvironment::new(environment);
    levels
        .iter()
        .map(|level| {
            let sums = crate::parallel::map(count, |k| {
                let exact = fine.mean(directions[k], level.sharpness());
                let found = level.mean_radiance(directions[k]);
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
        let sizes: Vec<usize> = SHARPNESS.iter().map(|&sharpness| map_size(sharpness, 512)).collect();
        assert_eq!(sizes, [512, 512, 368, 184, 96, 48, 24]);
    }

    #[test]
    fn levels_agree_with_sums_over_all_pixels() {
        let environment = EnvironmentMap::from_fn(64, |d| {
            let sun = (60.0 * (d[0] * 0.6 + d[1] * 0.8 - 1.0)).exp() as f32;
            [0.2 + 20.0 * sun, 0.3 + d[1].max(0.0) as f32, if d[2] > 0.3 { 1.0 } else { 0.1 }]
        });
        for (sharpness, bound) in [(1312.0, 0.02), (82.0, 0.02), (5.0, 0.01)] {
            let level = prefiltered_map(&environment, sharpness, map_size(sharpness, 256)).unwrap();
            let error = prefiltered_errors(&environment, &[level], 24)[0];
            assert!(error < bound, "{sharpness}: {error}");
        }
    }
}
