//! An environment made ready for rendering: compact bright sources as distant lights, everything else prefiltered on octahedral grids.

use super::octahedral::{Sphere, texel_direction, to_square};
use crate::lighting::Environment;
use crate::lighting::octahedral::{solid_angles, wrap};
use glam::Vec3;

/// Sharpness of the spherical Gaussians that the levels are convolved with (Sonoda 2011), and the side of each level's grid.
pub(super) const LEVELS: [(f32, usize); 7] =
    [(21_000.0, 512), (5_250.0, 512), (1_312.0, 256), (328.0, 128), (82.0, 64), (20.0, 32), (5.0, 16)];

/// A small bright part of the environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistantLight {
    /// Unit direction towards it.
    pub direction: [f32; 3],
    /// Irradiance of a surface that faces it, red, green, blue.
    pub irradiance: [f32; 3],
    /// Root mean square angle of its parts from its middle, radians.
    pub radius: f32,
}

/// How an environment is taken apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurroundOptions {
    /// Distant lights at most; 0 leaves all light in the levels.
    pub distant_lights: usize,
    /// Radiance, in units of the mean, above which a pixel may belong to a distant light.
    pub threshold: f32,
}

impl Default for SurroundOptions {
    fn default() -> Self {
        SurroundOptions { distant_lights: 16, threshold: 20.0 }
    }
}

/// Environment light for a renderer.
pub struct Surround {
    /// The environment as it is.
    pub(super) environment: Environment,
    /// Compact bright sources.
    pub(super) distant: Vec<DistantLight>,
    levels: Vec<Sphere>,
}

impl Surround {
    /// Takes the environment apart and filters it.
    pub fn new(environment: Environment, options: &SurroundOptions) -> Self {
        let (rest, distant) = take_out_bright(&environment, options);
        let mut levels = vec![resampled(&rest, LEVELS[0].1)];
        for k in 1..LEVELS.len() {
            let (finer, coarser) = (LEVELS[k - 1].0, LEVELS[k].0);
            // Of two blurs after each other the reciprocals of the sharpness add up, nearly.
            let kernel = if k == 1 { coarser } else { 1.0 / (1.0 / coarser - 1.0 / finer) };
            let next = convolved(&levels[k - 1], kernel, LEVELS[k].1);
            levels.push(next);
        }
        Surround { environment, distant, levels }
    }

    /// The compact bright sources.
    pub fn lights(&self) -> &[DistantLight] {
        &self.distant
    }

    /// Radiance around a direction, given by its place on the octahedral square, averaged with a spherical Gaussian; without the
    /// distant lights. `level` counts in [`LEVELS`].
    #[inline]
    pub(super) fn filtered(&self, square: glam::Vec2, level: f32) -> Vec3 {
        let level = level.clamp(0.0, (LEVELS.len() - 1) as f32);
        let first = (level as usize).min(LEVELS.len() - 2);
        let part = level - first as f32;
        let (fine, coarse) = (self.levels[first].read(square), self.levels[first + 1].read(square));
        fine + (coarse - fine) * part
    }

    /// Mean radiance, times the solid angle, in each cell of a grid, without the distant lights.
    pub(super) fn cells(&self, side: usize) -> Vec<Vec3> {
        let base = &self.levels[0];
        let angles = solid_angles(base.side);
        let factor = base.side / side;
        let mut cells = vec![Vec3::ZERO; side * side];
        for y in 0..side * factor {
            for x in 0..side * factor {
                cells[y / factor * side + x / factor] += base.at(x, y) * angles[y * base.side + x] as f32;
            }
        }
        cells
    }
}

/// Level of a sharpness, between the stored ones in the logarithm.
#[inline]
pub(super) fn level_of(sharpness: f32) -> f32 {
    // All but the ends are a factor of 4 apart.
    ((LEVELS[0].0.ln() - sharpness.max(1e-3).ln()) / 4f32.ln()).clamp(0.0, 6.0)
}

/// Radiance on the octahedral grid, means of 3 x 3 places in each texel.
fn resampled(environment: &Environment, side: usize) -> Sphere {
    Sphere::new(side, |x, y| {
        let mut sum = Vec3::ZERO;
        for k in 0..9 {
            let at = glam::Vec2::new(
                (x as f32 + (k % 3) as f32 / 3.0 + 1.0 / 6.0) / side as f32,
                (y as f32 + (k / 3) as f32 / 3.0 + 1.0 / 6.0) / side as f32,
            );
            let direction = super::octahedral::to_direction(at).as_dvec3().to_array();
            sum += Vec3::from_array(environment.radiance(direction));
        }
        sum / 9.0
    })
}

/// Means with a spherical Gaussian of this sharpness around each texel of a coarser grid.
fn convolved(fine: &Sphere, sharpness: f32, side: usize) -> Sphere {
    let angles = solid_angles(fine.side);
    let directions: Vec<Vec3> = (0..fine.side * fine.side)
        .map(|k| texel_direction(fine.side, k % fine.side, k / fine.side))
        .collect();
    // Beyond three standard deviations nothing counts. Cells are 2.2 / side wide at least.
    let least = 1.0 - (5.0 / sharpness).min(2.0);
    let window = (least.acos() * fine.side as f32 / 2.2).ceil() as isize + 1;
    let whole = 2 * window + 1 >= fine.side as isize;
    Sphere::new(side, |x, y| {
        let axis = texel_direction(side, x, y);
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        let mut add = |index: usize| {
            let cosine = axis.dot(directions[index]);
            if cosine > least {
                let weight = (sharpness * (cosine - 1.0)).exp() * angles[index] as f32;
                sum += weight * fine.at(index % fine.side, index / fine.side);
                total += weight;
            }
        };
        if whole {
            (0..fine.side * fine.side).for_each(add);
        } else {
            let centre = to_square(axis) * fine.side as f32;
            let (cx, cy) = (centre.x as isize, centre.y as isize);
            for dy in -window..=window {
                for dx in -window..=window {
                    add(beyond(cx + dx, cy + dy, fine.side));
                }
            }
        }
        sum / total.max(1e-20)
    })
}

/// The cell of a place up to one side beyond the square.
fn beyond(column: isize, row: isize, side: usize) -> usize {
    let last = side as isize - 1;
    let fold = |at: isize| if at < 0 { -1 - at } else if at > last { 2 * last + 1 - at } else { at };
    let (mut column, mut row) = (column, row);
    if fold(column) != column {
        (column, row) = (fold(column), last - row);
    }
    if fold(row) != row {
        (column, row) = (last - column, fold(row));
    }
    wrap(column, row, side)
}

/// The environment without its compact bright parts, and those as distant lights: median cut of what lies above the threshold.
fn take_out_bright(environment: &Environment, options: &SurroundOptions) -> (Environment, Vec<DistantLight>) {
    let image = environment.image();
    let whole = environment.integral();
    let luminance = |c: [f64; 3]| (c[0] + c[1] + c[2]) / 3.0;
    let mean = luminance(whole) / (4.0 * std::f64::consts::PI);
    let limit = (options.threshold as f64 * mean) as f32;
    let mut rest = image.clone();
    let mut bright: Vec<Bright> = Vec::new();
    if options.distant_lights > 0 && limit > 0.0 {
        for y in 0..image.height {
            let angle = environment.solid_angle(y);
            for x in 0..image.width {
                let pixel = *image.at(x, y);
                let peak = (pixel[0] + pixel[1] + pixel[2]) / 3.0;
                if peak <= limit {
                    continue;
                }
                let keep = 0.25 * limit / peak;
                let energy = pixel.map(|c| (c * (1.0 - keep)) as f64 * angle);
                *rest.at_mut(x, y) = pixel.map(|c| c * keep);
                let direction = glam::DVec3::from_array(environment.direction(x as f64 + 0.5, y as f64 + 0.5));
                bright.push(Bright { direction, energy: glam::DVec3::from_array(energy) });
            }
        }
    }
    let mut parts = if bright.is_empty() { Vec::new() } else { vec![bright] };
    while parts.len() < options.distant_lights {
        // The part whose spread weighs most is cut across its longest extent.
        let spread = |p: &Vec<Bright>| if p.len() < 2 { 0.0 } else { moments(p).2 };
        let Some((most, _)) = (0..parts.len())
            .map(|k| (k, spread(&parts[k])))
            .filter(|&(_, s)| s > 1e-4 * luminance(whole))
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
        else {
            break;
        };
        let part = parts.swap_remove(most);
        let (low, high) = halves(part);
        parts.push(low);
        parts.push(high);
    }
    let lights = parts.iter().filter(|p| !p.is_empty()).map(|part| {
        let (direction, energy, spread) = moments(part);
        let radius = (spread / (energy.element_sum() / 3.0).max(1e-30)).max(0.0).sqrt();
        DistantLight {
            direction: direction.as_vec3().to_array(),
            irradiance: energy.as_vec3().to_array(),
            radius: radius as f32,
        }
    });
    let lights = lights.collect();
    match Environment::new(rest) {
        Ok((rest, _)) => (rest, lights),
        Err(_) => (environment.clone(), Vec::new()),
    }
}

/// A bright pixel: direction and irradiance.
#[derive(Clone, Copy)]
struct Bright {
    direction: glam::DVec3,
    energy: glam::DVec3,
}

/// Middle, energy, and the sum of energy times squared angle.
fn moments(part: &[Bright]) -> (glam::DVec3, glam::DVec3, f64) {
    let weight = |b: &Bright| b.energy.element_sum() / 3.0;
    let direction = part.iter().map(|b| b.direction * weight(b)).sum::<glam::DVec3>().normalize_or(glam::DVec3::Y);
    let energy = part.iter().map(|b| b.energy).sum();
    let spread = part.iter().map(|b| weight(b) * (b.direction - direction).length_squared()).sum();
    (direction, energy, spread)
}

/// Cut where half the energy lies on either side, across the axis of the largest spread.
fn halves(mut part: Vec<Bright>) -> (Vec<Bright>, Vec<Bright>) {
    let weight = |b: &Bright| b.energy.element_sum();
    let (middle, ..) = moments(&part);
    let mut axis = middle.any_orthonormal_vector();
    for _ in 0..20 {
        axis = part
            .iter()
            .map(|b| (b.direction - middle) * (b.direction - middle).dot(axis) * weight(b))
            .sum::<glam::DVec3>()
            .normalize_or(axis);
    }
    part.sort_by(|a, b| a.direction.dot(axis).total_cmp(&b.direction.dot(axis)));
    // Between the two means along the axis rather than at the median of energy: separate lamps stay whole.
    let at = (part.iter().map(|b| weight(b) * b.direction.dot(axis)).sum::<f64>())
        / part.iter().map(weight).sum::<f64>().max(1e-30);
    let cut = part.partition_point(|b| b.direction.dot(axis) < at).clamp(1, part.len() - 1);
    let high = part.split_off(cut);
    (part, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lighting::SphericalGaussian;

    #[test]
    fn levels_are_the_environment_convolved() {
        let lobe = SphericalGaussian { axis: [0.6, 0.48, 0.64], sharpness: 50.0, amplitude: [3.0, 1.0, 0.5] };
        let environment = Environment::from_fn(256, |d| lobe.evaluate(d).map(|v| v as f32));
        let light = Surround::new(environment, &SurroundOptions { distant_lights: 0, ..SurroundOptions::default() });
        for (k, &(sharpness, _)) in LEVELS.iter().enumerate() {
            for axis in [[0.6, 0.48, 0.64], [0.7071, 0.7071, 0.0], [0.0, 0.0, 1.0]] {
                let filter = SphericalGaussian::grey(axis, sharpness as f64, 1.0);
                let expected = lobe.inner_product(&filter)[0] / filter.integral()[0];
                let square = to_square(Vec3::from_array(axis.map(|x| x as f32)).normalize());
                let found = light.filtered(square, k as f32).x as f64;
                assert!((found - expected).abs() < 0.08 * expected.max(0.2), "{sharpness}: {found} for {expected}");
            }
        }
        let total: Vec3 = light.cells(32).into_iter().sum();
        assert!((total.x as f64 / lobe.integral()[0] - 1.0).abs() < 0.01);
        assert!((level_of(82.0) - 4.0).abs() < 0.01 && (level_of(1312.0) - 2.0).abs() < 0.01);
    }

    #[test]
    fn suns_become_distant_lights() {
        let suns = [[0.6f64, 0.8, 0.0], [-0.8, 0.36, 0.48]];
        let cosine = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
        let bright = |d: [f64; 3]| suns.iter().any(|&s| cosine(d, s) > 0.9995);
        let environment = Environment::from_fn(512, |d| if bright(d) { [900.0, 800.0, 700.0] } else { [0.2; 3] });
        let whole = environment.integral();
        let light = Surround::new(environment, &SurroundOptions { distant_lights: 2, ..SurroundOptions::default() });
        assert_eq!(light.distant.len(), 2);
        for sun in suns {
            let near = light.distant.iter().map(|l| cosine(l.direction.map(f64::from), sun)).fold(-1.0, f64::max);
            assert!(near > 0.9999, "{near}");
        }
        let rest: Vec3 = light.cells(32).into_iter().sum();
        let distant: f32 = light.distant.iter().map(|l| l.irradiance[0]).sum();
        assert!(((rest.x + distant) as f64 / whole[0] - 1.0).abs() < 0.01);
    }
}
