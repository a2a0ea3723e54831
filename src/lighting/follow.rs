//! Light that changes: lobes and prefiltered maps of an environment from those of the one before, many times a second.
//!
//! Lobes start from the last ones. Sharp maps are blurred along rows, then along columns, of the latitude-longitude image reduced to
//! what the lobe can show: with the angles `t` from the pole and `p` around it
//! `exp(l (cos a - 1)) = exp(l (cos(t - t') - 1)) exp(-l sin t sin t' (1 - cos(p - p')))`, where `sin t` in the second factor is taken to be
//! `sin t'`. Around the poles, where that fails, and for wide lobes all pixels of a small image are summed, with weights that depend on its
//! size alone.

use super::EnvironmentMap;
use super::environment::direction_at;
use super::fit::TestLobeProjection;
use super::prefiltered::{EnvironmentLobes, PrefilteredMap, SHARPNESS};
use crate::image::RgbImage;
use crate::sphere::octahedral::directions;
use crate::vector::dot;
use glam::Vec3A;
use std::sync::{Arc, OnceLock};

/// Columns of the image at most.
const COLUMNS: usize = 512;
/// Sharp maps, blurred by rows and columns.
const SHARP: usize = 4;
/// Columns at least of the images for wide maps: a pixel is less than half of the lobe's standard deviation.
const WIDE_COLUMNS: [usize; 3] = [128, 64, 32];
/// Cells along a side of the maps, at most: half of the image's columns.
const SIZES: [usize; 7] = [256, 256, 256, 184, 64, 32, 24];
/// Within this many standard deviations of a lobe from a pole cells are summed directly.
const POLAR: f64 = 4.0;
/// A wide lobe ends where it has fallen to `exp(-FALLEN)`.
const FALLEN: f64 = 7.0;
/// Samples of a blur end at this many standard deviations.
const REACH: f64 = 3.3;

/// Returns how often the image is halved for a sharp map.
fn halvings(level: usize) -> usize {
    level.saturating_sub(1)
}

/// Returns how often an image, whose columns are a multiple of 128, is halved for a wide map.
fn wide_halvings(columns: usize, level: usize) -> usize {
    (columns / WIDE_COLUMNS[level - SHARP]).ilog2() as usize
}

/// Cells along a side of a map.
fn size(columns: usize, level: usize) -> usize {
    SIZES[level].min(columns / 2)
}

/// Follows an environment from frame to frame.
pub struct LightFollower {
    /// Lobes of the fit.
    lobes: usize,
    plans: Vec<BlurPlan>,
    wide: Vec<WideBlur>,
    projection: Option<TestLobeProjection>,
    light: Arc<EnvironmentLobes>,
}

/// The sums of a wide map, which depend on the size of the image alone.
struct WideBlur {
    size: usize,
    /// For each cell where its pixels begin, and at last their number.
    starts: Vec<u32>,
    /// Pixels and their weights, of all cells.
    pixels: Vec<(u32, f32)>,
}

impl WideBlur {
    /// Prepares a map of `size` cells along a side of an image of `width` x `width / 2` pixels.
    fn new(width: usize, number: usize, size: usize) -> Self {
        use std::f64::consts::PI;
        let height = width / 2;
        let pixel = PI / height as f64;
        let cell = 4.0 * PI / (size * size) as f64;
        // Pixels are means, and readers interpolate between cells.
        let sharpness = 1.0 / (1.0 / SHARPNESS[number] - cell / 6.0 - pixel * pixel / 12.0);
        let around: Vec<([f64; 3], f64)> = (0..width * height)
            .map(|k| {
                let [x, y] = [k % width, k / width].map(|at| at as f64 + 0.5);
                (direction_at(width, height, x, y), (PI * y / height as f64).sin())
            })
            .collect();
        let (mut starts, mut pixels) = (vec![0], Vec::new());
        for direction in directions(size) {
            let first = pixels.len();
            let mut total = 0.0;
            for (k, &(towards, share)) in around.iter().enumerate() {
                let exponent = sharpness * (dot(direction, towards) - 1.0);
                if exponent > -FALLEN {
                    let weight = exponent.exp() * share;
                    total += weight;
                    pixels.push((k as u32, weight as f32));
                }
            }
            pixels[first..].iter_mut().for_each(|(_, weight)| *weight /= total as f32);
            starts.push(pixels.len() as u32);
        }
        WideBlur { size, starts, pixels }
    }

    fn level(&self, picture: &ColourPlanes, number: usize) -> Option<PrefilteredMap> {
        let size = self.size;
        let picture = picture.pixels();
        let mut cells = vec![[0.0; 3]; size * size];
        crate::parallel::for_each_chunk(&mut cells, size, |row, cells| {
            for (cell, ends) in cells.iter_mut().zip(self.starts[row * size..].windows(2)) {
                *cell = sum(picture, &self.pixels[ends[0] as usize..ends[1] as usize]);
            }
        });
        PrefilteredMap::new(SHARPNESS[number], size, cells)
    }
}

/// Blur of a sharp map, as far as it depends on the size of the image alone.
struct BlurPlan {
    size: usize,
    width: usize,
    height: usize,
    /// For each row the weights of the blur along it, from its middle outwards.
    along: Vec<Vec<f32>>,
    /// For each row the first row that it takes and the weights of those.
    down: Vec<(usize, Vec<f32>)>,
    places: Vec<CellSource>,
    /// Pixels and their weights, of all cells around the poles.
    polar: Vec<(u32, f32)>,
}

/// Source of a cell's value.
#[derive(Clone, Copy)]
enum CellSource {
    /// In the blurred image, whose rows are one pixel longer: the upper left pixel and the position between that and the next.
    Between(u32, f32, f32),
    /// Around a pole: a sum over a part of [`BlurPlan::polar`].
    Polar(u32, u32),
}

impl LightFollower {
    /// For environments of up to 512 columns (larger ones are reduced) and lights of `lobes` lobes, 1 to 64.
    pub fn new(lobes: usize) -> Self {
        LightFollower { lobes, plans: Vec::new(), wide: Vec::new(), projection: None, light: Arc::default() }
    }

    /// Returns the light of the last environment; black before the first.
    pub fn light(&self) -> &Arc<EnvironmentLobes> {
        &self.light
    }

    /// Sets the light that the next update starts from.
    pub fn start(&mut self, light: EnvironmentLobes) {
        self.light = Arc::new(light);
    }

    /// Fits and filters the next environment and returns its light.
    pub fn update(&mut self, environment: &EnvironmentMap) -> &Arc<EnvironmentLobes> {
        let image = environment.image();
        let columns = COLUMNS.min(image.width).next_multiple_of(128);
        let reduced;
        let image = if (image.width, image.height) == (columns, columns / 2) {
            image
        } else {
            reduced = environment.resized(columns, columns / 2);
            reduced.image()
        };
        let halved = |level: usize| if level < SHARP { halvings(level) } else { wide_halvings(columns, level) };
        if self.plans.first().is_none_or(|plan| plan.width != columns) {
            self.plans = (0..SHARP).map(|k| BlurPlan::new(columns >> halved(k), k, size(columns, k))).collect();
            self.wide =
                (SHARP..SHARPNESS.len()).map(|k| WideBlur::new(columns >> halved(k), k, size(columns, k))).collect();
            self.projection = None;
        }
        let mut pictures = vec![ColourPlanes::of(image)];
        for k in 1..=(0..SHARPNESS.len()).map(halved).max().unwrap_or(0) {
            let next = pictures[k - 1].halved();
            pictures.push(next);
        }
        let Some(coarse) = pictures[halved(SHARP - 1)].environment() else { return &self.light };
        let LightFollower { lobes, plans, wide, projection, light } = self;
        let before = Some(&light.diffuse[..]).filter(|before| before.len() == *lobes);
        let projection = projection.get_or_insert_with(|| TestLobeProjection::new(&coarse));
        let (diffuse, levels) = crate::parallel::join(
            || projection.fit(&coarse, *lobes, before),
            || {
                let sharp = plans.iter().enumerate().filter_map(|(k, plan)| plan.level(&pictures[halved(k)], k));
                let wide = wide.iter().zip(SHARP..).filter_map(|(sums, k)| sums.level(&pictures[halved(k)], k));
                sharp.chain(wide).collect::<Vec<PrefilteredMap>>()
            },
        );
        self.light = Arc::new(EnvironmentLobes { diffuse, prefiltered: levels });
        &self.light
    }
}

/// An image as three lists.
struct ColourPlanes {
    width: usize,
    height: usize,
    lists: [Vec<f32>; 3],
    /// [`Self::pixels`], once they were asked for: several maps take one image.
    pixels: OnceLock<Vec<Vec3A>>,
}

impl ColourPlanes {
    fn of(image: &RgbImage) -> Self {
        let lists = std::array::from_fn(|c| image.data.iter().map(|p| p[c]).collect());
        ColourPlanes { width: image.width, height: image.height, lists, pixels: OnceLock::new() }
    }

    /// Colours side by side.
    fn pixels(&self) -> &[Vec3A] {
        let [r, g, b] = &self.lists;
        self.pixels.get_or_init(|| r.iter().zip(g).zip(b).map(|((&r, &g), &b)| Vec3A::new(r, g, b)).collect())
    }

    /// Means of four pixels, rows by the sines of their angles.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let sine = |y: usize| (std::f32::consts::PI * (y as f32 + 0.5) / self.height as f32).sin();
        let lists = self.lists.each_ref().map(|list| {
            let mut out = Vec::with_capacity(width * height);
            for y in 0..height {
                let (a, b) = (sine(2 * y), sine(2 * y + 1));
                let [upper, lower] =
                    [2 * y, 2 * y + 1].map(|y| list[y * self.width..][..self.width].as_chunks::<2>().0);
                let (a, b) = (0.5 * a / (a + b), 0.5 * b / (a + b));
                out.extend(upper.iter().zip(lower).map(|(u, l)| a * (u[0] + u[1]) + b * (l[0] + l[1])));
            }
            out
        });
        ColourPlanes { width, height, lists, pixels: OnceLock::new() }
    }

    fn environment(&self) -> Option<EnvironmentMap> {
        let data = (0..self.width * self.height).map(|k| std::array::from_fn(|c| self.lists[c][k])).collect();
        EnvironmentMap::new(RgbImage { width: self.width, height: self.height, data }).ok().map(|(e, _)| e)
    }
}

impl BlurPlan {
    /// Prepares a map of `size` cells along a side of an image of `width` x `width / 2` pixels.
    fn new(width: usize, number: usize, size: usize) -> Self {
        use std::f64::consts::PI;
        let (height, sharpness) = (width / 2, SHARPNESS[number]);
        let pixel = PI / height as f64;
        let cell = 4.0 * PI / (size * size) as f64;
        // The first image's pixels are meant to be spread over tents. Reading between this image's spreads them likewise, its own
        // being means of several (a twelfth of the square) adds to it; so does reading between cells.
        let first = pixel / (1 << halvings(number)) as f64;
        let averaged = 0.25 * (pixel * pixel - first * first);
        let variance = (1.0 / sharpness - cell / 6.0 - averaged).max(0.05 / sharpness);
        let sine = |y: usize| (PI * (y as f64 + 0.5) / height as f64).sin();
        let along = (0..height).map(|y| kernel(variance / (pixel * sine(y)).powi(2), width / 2 - 1)).collect();
        let down = (0..height)
            .map(|y| {
                let half = kernel(variance / (pixel * pixel), height);
                let reach = half.len() - 1;
                let first = y.saturating_sub(reach);
                let rows = first..(y + reach + 1).min(height);
                let weights = rows.map(|row| half[row.abs_diff(y)] * (sine(row) / sine(y)).sqrt() as f32);
                let weights: Vec<f32> = weights.collect();
                let total: f32 = weights.iter().sum();
                (first, weights.into_iter().map(|w| w / total).collect())
            })
            .collect();
        let around = (POLAR / sharpness.sqrt()).min(1.2).max(1.5 * pixel).sin();
        let direct = (1.0 / sharpness - cell / 6.0 - pixel * pixel / 12.0).max(0.3 * pixel * pixel);
        let mut polar: Vec<(u32, f32)> = Vec::new();
        let places = directions(size)
            .iter()
            .map(|d| {
                let (theta, phi) = (d[1].clamp(-1.0, 1.0).acos(), d[0].atan2(-d[2]));
                if (d[0] * d[0] + d[2] * d[2]).sqrt() < around {
                    let first = polar.len();
                    sum_around([theta, phi], direct, width, &mut polar);
                    return CellSource::Polar(first as u32, polar.len() as u32);
                }
                let u = (phi / (2.0 * PI)).rem_euclid(1.0) * width as f64 - 0.5;
                let v = (theta / PI * height as f64 - 0.5).clamp(0.0, height as f64 - 1.001);
                let column = (u.floor() as isize).rem_euclid(width as isize) as usize;
                let row = v as usize;
                // Rows have their first pixel once more at the end.
                CellSource::Between(
                    (row * (width + 1) + column) as u32,
                    (u - u.floor()) as f32,
                    (v - row as f64) as f32,
                )
            })
            .collect();
        BlurPlan { size, width, height, along, down, places, polar }
    }

    fn level(&self, picture: &ColourPlanes, number: usize) -> Option<PrefilteredMap> {
        let (width, size) = (self.width, self.size);
        let blurred: Vec<[Vec<f32>; 3]> = crate::parallel::map(self.height, |y| {
            picture.lists.each_ref().map(|list| blur(&list[y * width..][..width], &self.along[y]))
        });
        // Each row with its first pixel once more at the end.
        let mut rows = vec![[0.0f32; 3]; self.height * (width + 1)];
        crate::parallel::for_each_chunk(&mut rows, width + 1, |y, sums| {
            let (first, weights) = &self.down[y];
            let mut lists = [0, 1, 2].map(|_| vec![0.0f32; width]);
            for (row, &weight) in blurred[*first..].iter().zip(weights) {
                for (list, blurred) in lists.iter_mut().zip(row) {
                    list.iter_mut().zip(blurred).for_each(|(sum, value)| *sum += weight * value);
                }
            }
            for (k, sum) in sums[..width].iter_mut().enumerate() {
                *sum = lists.each_ref().map(|list| list[k]);
            }
            sums[width] = sums[0];
        });
        let pixels = picture.pixels();
        let cells = crate::parallel::map(size, |row| {
            let cells = (row * size..(row + 1) * size).map(|k| match self.places[k] {
                CellSource::Polar(first, end) => sum(pixels, &self.polar[first as usize..end as usize]),
                CellSource::Between(at, s, t) => {
                    let at = at as usize;
                    let (upper, lower) = (&rows[at..at + 2], &rows[at + width + 1..at + width + 3]);
                    std::array::from_fn(|c| {
                        let a = upper[0][c] + (upper[1][c] - upper[0][c]) * s;
                        let b = lower[0][c] + (lower[1][c] - lower[0][c]) * s;
                        a + (b - a) * t
                    })
                }
            });
            cells.collect::<Vec<[f32; 3]>>()
        });
        PrefilteredMap::new(SHARPNESS[number], size, cells.concat())
    }
}

/// Sum of weighted pixels.
fn sum(picture: &[Vec3A], pixels: &[(u32, f32)]) -> [f32; 3] {
    // Two at a time, which do not wait for each other.
    let (pairs, rest) = pixels.as_chunks::<2>();
    let weighted = |&(at, weight): &(u32, f32)| picture[at as usize] * weight;
    let [even, odd] =
        pairs.iter().fold([Vec3A::ZERO; 2], |[even, odd], [a, b]| [even + weighted(a), odd + weighted(b)]);
    rest.iter().fold(even + odd, |sum, pixel| sum + weighted(pixel)).to_array()
}

/// Pixels around a direction (angle from +Y, angle around it) and their weights in a lobe of this variance.
fn sum_around([theta, phi]: [f64; 2], variance: f64, width: usize, pixels: &mut Vec<(u32, f32)>) {
    use std::f64::consts::PI;
    let (height, first) = (width / 2, pixels.len());
    let reach = (REACH * variance.sqrt()).max(2.0 * PI / width as f64);
    let at = |angle: f64| (angle / PI * height as f64).clamp(0.0, height as f64);
    let mut total = 0.0;
    for y in at(theta - reach) as usize..at(theta + reach).ceil() as usize {
        let angle = PI * (y as f64 + 0.5) / height as f64;
        for x in 0..width {
            let turn = 2.0 * PI * (x as f64 + 0.5) / width as f64 - phi;
            let drop = 1.0 - (theta.cos() * angle.cos() + theta.sin() * angle.sin() * turn.cos());
            if drop < 0.5 * REACH * REACH * variance + 1e-12 || drop < 0.5 * (PI / height as f64).powi(2) {
                let weight = (-drop / variance).exp() * angle.sin();
                total += weight;
                pixels.push(((y * width + x) as u32, weight as f32));
            }
        }
    }
    pixels[first..].iter_mut().for_each(|(_, weight)| *weight /= total.max(1e-30) as f32);
}

/// Weights of a Gaussian of a variance, in squared pixels, at 0, 1, 2, ... pixels from its middle; with the other side they sum to 1.
fn kernel(variance: f64, most: usize) -> Vec<f32> {
    if variance < 0.4 {
        // Three weights have this variance exactly.
        return vec![(1.0 - variance) as f32, (0.5 * variance) as f32];
    }
    let reach = ((REACH * variance.sqrt()).ceil() as usize).min(most).max(1);
    let weight = |k: usize| (-0.5 * (k * k) as f64 / variance).exp();
    let total: f64 = 1.0 + 2.0 * (1..=reach).map(weight).sum::<f64>();
    (0..=reach).map(|k| (weight(k) / total) as f32).collect()
}

/// A closed row through a symmetric kernel.
fn blur(row: &[f32], half: &[f32]) -> Vec<f32> {
    let (width, reach) = (row.len(), half.len() - 1);
    let mut padded = Vec::with_capacity(width + 2 * reach);
    padded.extend_from_slice(&row[width - reach..]);
    padded.extend_from_slice(row);
    padded.extend_from_slice(&row[..reach]);
    let mut sums: Vec<f32> = row.iter().map(|x| x * half[0]).collect();
    for (k, &weight) in half.iter().enumerate().skip(1) {
        let (left, right) = (&padded[reach - k..][..width], &padded[reach + k..][..width]);
        sums.iter_mut().zip(left).zip(right).for_each(|((sum, a), b)| *sum += weight * (a + b));
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::super::fit::irradiance_error;
    use super::super::levels::prefiltered_errors;
    use super::*;

    #[test]
    fn a_turning_environment_is_followed() {
        let scene = |turn: f64| {
            EnvironmentMap::from_fn(512, |d| {
                let d = super::super::environment::turn_y(d, turn);
                let sun = (300.0 * (d[0] * 0.6 + d[1] * 0.8 - 1.0)).exp() as f32;
                [0.2 + 20.0 * sun, 0.3 + d[1].max(0.0) as f32, if d[2] > 0.3 { 1.0 } else { 0.1 }]
            })
        };
        let mut follower = LightFollower::new(6);
        follower.update(&scene(0.0));
        for turn in [4.0, 8.0] {
            let environment = scene(turn);
            let light = follower.update(&environment).clone();
            assert!(irradiance_error(&environment, &light.diffuse) < 0.02);
            let errors = prefiltered_errors(&environment, &light.prefiltered, 40);
            println!("{errors:?}");
            assert!(errors.len() == 7 && errors.iter().all(|&e| e < 0.03), "{errors:?}");
        }
    }
}
