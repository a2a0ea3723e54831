//! An environment made ready for rendering: compact bright sources as distant lights, everything else prefiltered on octahedral grids.

use super::octahedral_map::OctahedralMap;
use crate::lighting::PrefilteredMap;
use crate::lighting::prefiltered::SHARPNESS;
#[cfg(feature = "encode")]
use crate::lighting::{EnvironmentMap, levels::prefiltered_maps};
use crate::sphere::octahedral::{directions, solid_angles, taps};
use glam::Vec3;
use std::sync::OnceLock;

/// Cells along a side of the sharpest maps' grids.
#[cfg(feature = "encode")]
const MAX_MAP_SIZE: usize = 256;
/// Most distant lights.
#[cfg(feature = "encode")]
const MAX_LIGHTS: usize = 64;

/// A map that still shows where light comes from and has few cells: sharpness 82.
const BLURRED: usize = 4;
/// Cells along a side of the grid that it is summed in.
pub(super) const BLURRED_SIDE: usize = 32;

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

/// Options of [`PreparedEnvironment::new`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreparedEnvironmentOptions {
    /// Distant lights at most, 64 or fewer; 0 leaves all light in the maps.
    pub distant_lights: usize,
    /// Radiance, in units of the mean, above which a pixel may belong to a distant light.
    pub threshold: f32,
}

impl Default for PreparedEnvironmentOptions {
    fn default() -> Self {
        PreparedEnvironmentOptions { distant_lights: 16, threshold: 20.0 }
    }
}

/// Environment light for a renderer.
#[derive(Clone)]
pub struct PreparedEnvironment {
    /// Compact bright sources.
    pub(super) distant: Vec<DistantLight>,
    levels: Vec<OctahedralMap>,
    /// [`Self::blurred_cell_flux`], once they were asked for.
    blurred: OnceLock<Vec<Vec3>>,
    /// The maps are a file's, with all light in them.
    pub(super) is_stored: bool,
}

impl PreparedEnvironment {
    /// Takes the environment apart and filters it.
    #[cfg(feature = "encode")]
    pub fn new(environment: &EnvironmentMap, options: &PreparedEnvironmentOptions) -> Self {
        let (rest, distant) = extract_bright_sources(environment, options);
        let levels = prefiltered_maps(&rest, MAX_MAP_SIZE);
        PreparedEnvironment { distant, is_stored: false, ..Self::from_prefiltered(&levels) }
    }

    /// From a file's prefiltered maps, one for each of `SHARPNESS`; black where there are not as many.
    pub fn from_prefiltered(levels: &[PrefilteredMap]) -> Self {
        let read = |level: &PrefilteredMap| {
            let side = level.size();
            OctahedralMap::new(side, |x, y| Vec3::from_array(level.cells()[y * side + x]))
        };
        let mut levels: Vec<OctahedralMap> = levels.iter().take(SHARPNESS.len()).map(read).collect();
        levels.resize_with(SHARPNESS.len(), || OctahedralMap::new(1, |_, _| Vec3::ZERO));
        PreparedEnvironment { distant: Vec::new(), levels, blurred: OnceLock::new(), is_stored: true }
    }

    /// Radius of a disc with a light's [`DistantLight::radius`], radians.
    pub(super) fn disc_radius(light: &DistantLight) -> f64 {
        std::f64::consts::SQRT_2 * light.radius as f64
    }

    /// The compact bright sources.
    pub fn distant_lights(&self) -> &[DistantLight] {
        &self.distant
    }

    /// Radiance around a direction, given by its position on the octahedral square, averaged with a spherical Gaussian; without the
    /// distant lights. `level` counts in `SHARPNESS`.
    #[inline]
    pub(super) fn filtered_radiance(&self, square: glam::Vec2, level: f32) -> Vec3 {
        let level = level.clamp(0.0, (SHARPNESS.len() - 1) as f32);
        let first = (level as usize).min(SHARPNESS.len() - 2);
        let part = level - first as f32;
        let (fine, coarse) =
            (self.levels[first].sample_bilinear(square), self.levels[first + 1].sample_bilinear(square));
        fine + (coarse - fine) * part
    }

    /// Irradiance of a surface with this unit normal that nothing shades.
    pub fn irradiance(&self, normal: [f32; 3]) -> [f32; 3] {
        let normal = Vec3::from_array(normal);
        let cosine = |d: Vec3| d.dot(normal).max(0.0);
        let cells = self.blurred_cell_flux().iter().zip(directions(BLURRED_SIDE));
        let even: Vec3 = cells.map(|(light, d)| light * cosine(Vec3::from_array(d.map(|x| x as f32)))).sum();
        let distant =
            self.distant.iter().map(|l| Vec3::from_array(l.irradiance) * cosine(Vec3::from_array(l.direction)));
        (even + distant.sum::<Vec3>()).to_array()
    }

    /// Mean radiance, times the solid angle, in each cell of a grid, without the distant lights.
    pub(super) fn cell_flux(&self, side: usize) -> Vec<Vec3> {
        self.cells_of(0, side)
    }

    /// Returns [`Self::cell_flux`] in a grid of [`BLURRED_SIDE`] from a blurred map, which has fewer cells to sum.
    pub(super) fn blurred_cell_flux(&self) -> &[Vec3] {
        self.blurred.get_or_init(|| self.cells_of(BLURRED, BLURRED_SIDE))
    }

    fn cells_of(&self, level: usize, side: usize) -> Vec<Vec3> {
        let level = &self.levels[level];
        let mut cells = vec![Vec3::ZERO; side * side];
        let angles = solid_angles(level.side);
        for (k, direction) in directions(level.side).into_iter().enumerate() {
            let radiance = level.texel(k % level.side, k / level.side) * angles[k] as f32;
            let around = taps(direction, side);
            for (cell, weight) in around.cells.into_iter().zip(around.weights) {
                cells[cell as usize] += weight * radiance;
            }
        }
        cells
    }
}

/// Level of a sharpness, between the stored ones in the logarithm.
#[inline]
pub(super) fn level_of(sharpness: f32) -> f32 {
    // All but the ends are a factor of 4 apart.
    0.5 * (log2(SHARPNESS[0] as f32) - log2(sharpness.max(1e-3)))
}

/// Logarithm to the base 2 of a positive number that is not subnormal, within 1e-5; maps need no more.
#[inline]
pub(super) fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let mantissa = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
    // From 1 .. 2 to sqrt(1/2) .. sqrt(2), where the series of the inverse hyperbolic tangent is short.
    let large = mantissa > std::f32::consts::SQRT_2;
    let (mantissa, exponent) = if large { (0.5 * mantissa, exponent + 1) } else { (mantissa, exponent) };
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let squared = s * s;
    exponent as f32 + s * (2.885_39 + squared * (0.961_796_7 + squared * 0.577_078))
}

/// Exponential function, within 3e-6 of itself, and not below 2^-126.
#[inline]
pub(super) fn exp(x: f32) -> f32 {
    use std::f32::consts::{LN_2, LOG2_E};
    // Rounded by adding what has no room for parts; then a power of 2 times Taylor's series of what is left.
    const WHOLE: f32 = (3 << 22) as f32;
    let power = (x * LOG2_E).clamp(-126.0, 126.0);
    let whole = (power + WHOLE) - WHOLE;
    let rest = (power - whole) * LN_2;
    let series = 1.0 + rest * (1.0 + rest * (0.5 + rest * (1.0 / 6.0 + rest * (1.0 / 24.0 + rest * (1.0 / 120.0)))));
    f32::from_bits(((whole as i32 + 127) as u32) << 23) * series
}

/// The environment without its compact bright parts, and those as distant lights: median cut of what lies above the threshold.
#[cfg(feature = "encode")]
fn extract_bright_sources(
    environment: &EnvironmentMap,
    options: &PreparedEnvironmentOptions,
) -> (EnvironmentMap, Vec<DistantLight>) {
    let image = environment.image();
    let whole = environment.integral();
    let luminance = |c: [f64; 3]| (c[0] + c[1] + c[2]) / 3.0;
    let mean = luminance(whole) / (4.0 * std::f64::consts::PI);
    let limit = (options.threshold as f64 * mean) as f32;
    let mut rest = image.clone();
    let mut bright: Vec<BrightSource> = Vec::new();
    if options.distant_lights > 0 && limit > 0.0 {
        for y in 0..image.height {
            let angle = environment.solid_angle(y);
            for x in 0..image.width {
                let pixel = *image.value_at(x, y);
                let peak = (pixel[0] + pixel[1] + pixel[2]) / 3.0;
                if peak <= limit {
                    continue;
                }
                let keep = 0.25 * limit / peak;
                let energy = pixel.map(|c| (c * (1.0 - keep)) as f64 * angle);
                *rest.value_at_mut(x, y) = pixel.map(|c| c * keep);
                let direction = glam::DVec3::from_array(environment.direction(x as f64 + 0.5, y as f64 + 0.5));
                bright.push(BrightSource { direction, energy: glam::DVec3::from_array(energy) });
            }
        }
    }
    let mut parts = if bright.is_empty() { Vec::new() } else { vec![bright] };
    while parts.len() < options.distant_lights.min(MAX_LIGHTS) {
        // The part whose spread weighs most is cut across its longest extent.
        let spread = |p: &Vec<BrightSource>| if p.len() < 2 { 0.0 } else { moments(p).2 };
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
    match EnvironmentMap::new(rest) {
        Ok((rest, _)) => (rest, lights),
        Err(_) => (environment.clone(), Vec::new()),
    }
}

/// A bright pixel: direction and irradiance.
#[cfg(feature = "encode")]
#[derive(Clone, Copy)]
struct BrightSource {
    direction: glam::DVec3,
    energy: glam::DVec3,
}

/// Middle, energy, and the sum of energy times squared angle.
#[cfg(feature = "encode")]
fn moments(part: &[BrightSource]) -> (glam::DVec3, glam::DVec3, f64) {
    let weight = |b: &BrightSource| b.energy.element_sum() / 3.0;
    let direction = part.iter().map(|b| b.direction * weight(b)).sum::<glam::DVec3>().normalize_or(glam::DVec3::Y);
    let energy = part.iter().map(|b| b.energy).sum();
    let spread = part.iter().map(|b| weight(b) * (b.direction - direction).length_squared()).sum();
    (direction, energy, spread)
}

/// Cut where half the energy lies on either side, across the axis of the largest spread.
#[cfg(feature = "encode")]
fn halves(mut part: Vec<BrightSource>) -> (Vec<BrightSource>, Vec<BrightSource>) {
    let weight = |b: &BrightSource| b.energy.element_sum();
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

#[cfg(all(test, feature = "encode"))]
mod tests {
    use crate::lighting::SphericalGaussian;
    use crate::relight::environment_light::*;
    use crate::relight::octahedral_map::to_square;

    #[test]
    fn levels_are_the_environment_convolved() {
        let lobe = SphericalGaussian { axis: [0.6, 0.48, 0.64], sharpness: 50.0, amplitude: [3.0, 1.0, 0.5] };
        let environment = EnvironmentMap::from_fn(256, |d| lobe.evaluate(d).map(|v| v as f32));
        let light = PreparedEnvironment::new(
            &environment,
            &PreparedEnvironmentOptions { distant_lights: 0, ..PreparedEnvironmentOptions::default() },
        );
        for (k, &sharpness) in SHARPNESS.iter().enumerate() {
            for axis in [[0.6, 0.48, 0.64], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]] {
                let filter = SphericalGaussian::grey(axis, sharpness, 1.0);
                let expected = lobe.inner_product(&filter)[0] / filter.integral()[0];
                let square = to_square(Vec3::from_array(axis.map(|x| x as f32)).normalize());
                let found = light.filtered_radiance(square, k as f32).x as f64;
                assert!((found - expected).abs() < 0.1 * expected.max(0.2), "{sharpness}: {found} for {expected}");
            }
        }
        let total: Vec3 = light.cell_flux(32).into_iter().sum();
        assert!((total.x as f64 / lobe.integral()[0] - 1.0).abs() < 0.01);
        assert!((level_of(82.0) - 4.0).abs() < 0.01 && (level_of(1312.0) - 2.0).abs() < 0.01);
    }

    #[test]
    fn quick_functions_are_near_the_exact_ones() {
        for k in -850..=850 {
            let x = 0.1 * k as f32;
            let (found, exact) = (exp(x) as f64, (x as f64).exp());
            assert!((found / exact - 1.0).abs() < 3e-6 + 1e-7 * x.abs() as f64, "exp {x}: {found} for {exact}");
            let power = (x as f64).exp() as f32;
            assert!((log2(power) - power.log2()).abs() < 2e-5, "log2 {power}");
        }
        assert!(exp(-1e9) > 0.0 && exp(-1e9) < 1e-37 && exp(1e9).is_finite());
    }

    #[test]
    fn suns_become_distant_lights() {
        let suns = [[0.6f64, 0.8, 0.0], [-0.8, 0.36, 0.48]];
        let cosine = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
        let bright = |d: [f64; 3]| suns.iter().any(|&s| cosine(d, s) > 0.9995);
        let environment = EnvironmentMap::from_fn(512, |d| if bright(d) { [900.0, 800.0, 700.0] } else { [0.2; 3] });
        let whole = environment.integral();
        let light = PreparedEnvironment::new(
            &environment,
            &PreparedEnvironmentOptions { distant_lights: 2, ..PreparedEnvironmentOptions::default() },
        );
        assert_eq!(light.distant.len(), 2);
        for sun in suns {
            let near = light.distant.iter().map(|l| cosine(l.direction.map(f64::from), sun)).fold(-1.0, f64::max);
            assert!(near > 0.9999, "{near}");
        }
        let rest: Vec3 = light.cell_flux(32).into_iter().sum();
        let distant: f32 = light.distant.iter().map(|l| l.irradiance[0]).sum();
        assert!(((rest.x + distant) as f64 / whole[0] - 1.0).abs() < 0.01);
    }
}
