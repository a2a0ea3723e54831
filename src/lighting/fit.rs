//! An environment as a few spherical Gaussians, for diffuse reflection.
//!
//! Both the environment and the lobes are seen through test lobes of one sharpness about many directions, whose inner products
//! with the lobes are known in closed form. The sum of the squared differences is minimised over axes, sharpness and flux. The
//! test lobes are a little narrower than the cosine: shadows cut parts out of it.

use super::{EnvironmentMap, SphericalGaussian};
use crate::optimise::lbfgs::{StopCriterion, minimise};
use crate::sphere::gaussian::sphere_integral;
use crate::vector::dot;

/// Options of [`fit`].
#[derive(Debug, Clone, PartialEq)]
pub struct LobeFitOptions {
    /// Lobes, 1 to 64.
    pub lobes: usize,
    /// Evaluations of the sum of squares and its gradient, at most.
    pub evaluations: usize,
}

impl Default for LobeFitOptions {
    fn default() -> Self {
        LobeFitOptions { lobes: 10, evaluations: 150 }
    }
}

/// Most lobes of a light.
pub(crate) const MAX_LOBES: usize = 64;
/// Sharpness of the test lobes and their number.
const TEST_SHARPNESS: f64 = 8.0;
const TESTS: usize = 160;
/// Columns that the environment is reduced to.
const COLUMNS: usize = 64;
/// Range of the lobes' sharpness.
const SHARPNESS: [f64; 2] = [0.3, 300.0];
/// Evaluations of an update from the fit of a similar environment.
const UPDATE_EVALUATIONS: usize = 25;
/// Numbers of a lobe: axis (of any length), logarithm of the sharpness, flux of three colours.
const NUMBERS: usize = 7;

/// Fits lobes to an environment. An update starts from `previous`, where that has as many lobes.
pub fn fit(
    environment: &EnvironmentMap,
    options: &LobeFitOptions,
    previous: Option<&[SphericalGaussian]>,
) -> Vec<SphericalGaussian> {
    let cells = EnvironmentCell::of(environment);
    fit_cells(&cells, &TestLobes::through(&cells), options, previous)
}

/// For environments of one size: how their pixels are seen through the test lobes.
pub(super) struct TestLobeProjection {
    directions: Vec<[f64; 3]>,
    /// For each test lobe the weight of each cell.
    weights: Vec<Vec<f32>>,
}

impl TestLobeProjection {
    pub(super) fn new(environment: &EnvironmentMap) -> Self {
        let (cells, directions) = (EnvironmentCell::of(environment), TestLobes::directions());
        let scale = TestLobes::scale();
        let weights = directions.iter().map(|&test| cells.iter().map(|c| (scale * c.seen(test)) as f32).collect());
        TestLobeProjection { weights: weights.collect(), directions }
    }

    /// Fits lobes to an environment of the same size.
    pub(super) fn fit(
        &self,
        environment: &EnvironmentMap,
        lobes: usize,
        previous: Option<&[SphericalGaussian]>,
    ) -> Vec<SphericalGaussian> {
        let cells = EnvironmentCell::of(environment);
        let fluxes: [Vec<f32>; 3] = std::array::from_fn(|c| cells.iter().map(|cell| cell.flux[c] as f32).collect());
        let sum = |weights: &[f32], flux: &[f32]| {
            let (weights, flux) = (weights.as_chunks::<8>().0, flux.as_chunks::<8>().0);
            let mut sums = [0.0f32; 8];
            weights.iter().zip(flux).for_each(|(w, f)| (0..8).for_each(|k| sums[k] += w[k] * f[k]));
            sums.iter().sum::<f32>() as f64
        };
        let targets = self.weights.iter().map(|weights| fluxes.each_ref().map(|flux| sum(weights, flux))).collect();
        let tests = TestLobes { directions: self.directions.clone(), targets };
        fit_cells(&cells, &tests, &LobeFitOptions { lobes, ..LobeFitOptions::default() }, previous)
    }
}

fn fit_cells(
    cells: &[EnvironmentCell],
    tests: &TestLobes,
    options: &LobeFitOptions,
    previous: Option<&[SphericalGaussian]>,
) -> Vec<SphericalGaussian> {
    let count = options.lobes.clamp(1, MAX_LOBES);
    let total: f64 = cells.iter().map(EnvironmentCell::energy).sum();
    if total <= 0.0 {
        return Vec::new();
    }
    let previous = previous.filter(|lobes| lobes.len() == count);
    let start = previous.map_or_else(|| cluster(cells, count), <[SphericalGaussian]>::to_vec);
    let mut x: Vec<f64> = start.iter().flat_map(|lobe| to_numbers(lobe, total)).collect();
    let mut lower = vec![-2.0; x.len()];
    let mut upper = vec![2.0; x.len()];
    for lobe in 0..start.len() {
        (lower[lobe * NUMBERS + 3], upper[lobe * NUMBERS + 3]) = (SHARPNESS[0].ln(), SHARPNESS[1].ln());
        (4..NUMBERS).for_each(|k| (lower[lobe * NUMBERS + k], upper[lobe * NUMBERS + k]) = (0.0, 1e3));
    }
    let evaluations =
        if previous.is_some() { UPDATE_EVALUATIONS.min(options.evaluations) } else { options.evaluations };
    let stop = StopCriterion { evaluations, decrease: 1e-5 };
    minimise(&mut x, &lower, &upper, stop, |x, gradient| tests.difference(x, total, gradient));
    let mut lobes: Vec<SphericalGaussian> =
        x.chunks_exact(NUMBERS).map(|numbers| from_numbers(numbers, total)).collect();
    let flux = |lobe: &SphericalGaussian| lobe.integral().iter().sum::<f64>();
    lobes.sort_by(|a, b| flux(b).total_cmp(&flux(a)));
    lobes
}

fn to_numbers(lobe: &SphericalGaussian, total: f64) -> [f64; NUMBERS] {
    let [r, g, b] = lobe.integral().map(|flux| flux / total);
    [lobe.axis[0], lobe.axis[1], lobe.axis[2], lobe.sharpness.clamp(SHARPNESS[0], SHARPNESS[1]).ln(), r, g, b]
}

fn from_numbers(numbers: &[f64], total: f64) -> SphericalGaussian {
    let (axis, _) = unit([numbers[0], numbers[1], numbers[2]]);
    let sharpness = numbers[3].exp();
    let scale = total / sphere_integral(sharpness);
    SphericalGaussian { axis, sharpness, amplitude: [numbers[4] * scale, numbers[5] * scale, numbers[6] * scale] }
}

fn unit(v: [f64; 3]) -> ([f64; 3], f64) {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
    (v.map(|x| x / length), length)
}

/// A part of the sphere and the light that comes from it.
struct EnvironmentCell {
    direction: [f64; 3],
    /// Radiance times solid angle.
    flux: [f64; 3],
}

impl EnvironmentCell {
    fn of(environment: &EnvironmentMap) -> Vec<EnvironmentCell> {
        let columns = COLUMNS.min(environment.image().width);
        let small = environment.resized(columns, (columns / 2).max(1));
        let image = small.image();
        (0..image.data.len())
            .map(|k| {
                let (x, y) = (k % image.width, k / image.width);
                let angle = small.solid_angle(y);
                EnvironmentCell {
                    direction: small.direction(x as f64 + 0.5, y as f64 + 0.5),
                    flux: image.data[k].map(|c| c as f64 * angle),
                }
            })
            .collect()
    }
    fn energy(&self) -> f64 {
        self.flux.iter().sum()
    }
    /// Returns the weight of a test lobe, 1 at its axis, in the cell's direction.
    fn seen(&self, test: [f64; 3]) -> f64 {
        (TEST_SHARPNESS * (dot(self.direction, test) - 1.0)).exp()
    }
}

/// The environment through the test lobes.
struct TestLobes {
    directions: Vec<[f64; 3]>,
    /// Mean radiance, weighted by the test lobe.
    targets: Vec<[f64; 3]>,
}

impl TestLobes {
    fn directions() -> Vec<[f64; 3]> {
        spread_directions(TESTS).collect()
    }

    /// Makes the test lobes' integrals 1.
    fn scale() -> f64 {
        1.0 / sphere_integral(TEST_SHARPNESS)
    }

    fn through(cells: &[EnvironmentCell]) -> Self {
        let (directions, scale) = (Self::directions(), Self::scale());
        let targets = crate::parallel::map(directions.len(), |k| {
            let mut sum = [0.0; 3];
            for cell in cells {
                let weight = scale * cell.seen(directions[k]);
                (0..3).for_each(|c| sum[c] += weight * cell.flux[c]);
            }
            sum
        });
        TestLobes { directions, targets }
    }

    /// Mean of the squared differences over the mean radiance squared, and its gradient.
    fn difference(&self, x: &[f64], total: f64, gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let k = TEST_SHARPNESS;
        let fade_k = -(-2.0 * k).exp_m1();
        let lobes: Vec<([f64; 3], f64, f64, f64)> = (x.chunks_exact(NUMBERS))
            .map(|numbers| {
                let (axis, length) = unit([numbers[0], numbers[1], numbers[2]]);
                let l = numbers[3].exp();
                (axis, length, l, -(-2.0 * l).exp_m1())
            })
            .collect();
        let mut sum = 0.0;
        let mut kernels = vec![(0.0, 0.0, 0.0); lobes.len()];
        // Radiance is counted in units of its mean over the sphere.
        let scale = 4.0 * std::f64::consts::PI;
        for (&direction, target) in self.directions.iter().zip(&self.targets) {
            let mut residual = target.map(|t| -t * scale / total);
            for ((&(axis, _, l, fade_l), numbers), kernel) in
                lobes.iter().zip(x.chunks_exact(NUMBERS)).zip(&mut kernels)
            {
                // The normalised inner product of lobe and test lobe, and its derivatives by the cosine and by ln l.
                let cosine = dot(axis, direction).clamp(-1.0, 1.0);
                let d = (l * l + k * k + 2.0 * l * k * cosine).max(1e-12).sqrt();
                // Beyond that 1 stays 1, and underflow is slow.
                let e = (-2.0 * d.min(300.0)).exp();
                let fade_d = (1.0 - e).max(1e-12);
                // Without cancellation: d - l - k.
                let exponent = 2.0 * l * k * (cosine - 1.0) / (d + l + k);
                let value = l * k / (2.0 * std::f64::consts::PI) * exponent.exp() * fade_d / (d * fade_l * fade_k);
                let by_d = (1.0 + e) / fade_d - 1.0 / d;
                let by_cosine = value * by_d * l * k / d;
                let by_l = value * (1.0 / l - 2.0 * (1.0 - fade_l) / fade_l - 1.0 + by_d * (l + k * cosine) / d);
                *kernel = (value * scale, by_cosine * scale, by_l * l * scale);
                (0..3).for_each(|c| residual[c] += numbers[4 + c] * kernel.0);
            }
            sum += residual.iter().map(|r| r * r).sum::<f64>();
            let parts = gradient.chunks_exact_mut(NUMBERS).zip(x.chunks_exact(NUMBERS));
            for ((part, numbers), (&(axis, length, ..), &(value, by_cosine, by_log))) in
                parts.zip(lobes.iter().zip(&kernels))
            {
                let along: f64 = (0..3).map(|c| residual[c] * numbers[4 + c]).sum();
                let cosine = dot(axis, direction);
                (0..3).for_each(|i| part[i] += along * by_cosine * (direction[i] - cosine * axis[i]) / length);
                part[3] += along * by_log;
                (0..3).for_each(|c| part[4 + c] += residual[c] * value);
            }
        }
        let mean = 1.0 / self.directions.len() as f64;
        gradient.iter_mut().for_each(|g| *g *= 2.0 * mean);
        sum * mean
    }
}

/// Directions spread evenly over the sphere (a Fibonacci spiral).
pub(crate) fn spread_directions(count: usize) -> impl Iterator<Item = [f64; 3]> {
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |k| {
        let y = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let (sine, cosine) = (turn * k as f64).sin_cos();
        let radius = (1.0 - y * y).sqrt();
        [radius * cosine, y, radius * sine]
    })
}

/// Starts: clusters of the light, one lobe each (k-means on the sphere).
fn cluster(cells: &[EnvironmentCell], count: usize) -> Vec<SphericalGaussian> {
    // Each next centre is where most light is farthest from the centres so far.
    let mut centres: Vec<[f64; 3]> = Vec::with_capacity(count);
    let mut far = vec![1.0f64; cells.len()];
    for _ in 0..count {
        let score = |k: usize| cells[k].energy() * far[k];
        let Some(best) = (0..cells.len()).max_by(|&a, &b| score(a).total_cmp(&score(b))) else { break };
        let centre = cells[best].direction;
        centres.push(centre);
        far.iter_mut().zip(cells).for_each(|(far, cell)| *far = far.min(1.0 - dot(cell.direction, centre)));
    }
    let mut lobes = Vec::new();
    for _ in 0..6 {
        let mut sums = vec![([0.0; 3], [0.0; 3], 0.0); centres.len()];
        for cell in cells {
            let cosine = |k: usize| dot(centres[k], cell.direction);
            let Some(nearest) = (0..centres.len()).max_by(|&a, &b| cosine(a).total_cmp(&cosine(b))) else { break };
            let (moment, flux, energy) = &mut sums[nearest];
            let here = cell.energy();
            (0..3).for_each(|i| moment[i] += here * cell.direction[i]);
            (0..3).for_each(|c| flux[c] += cell.flux[c]);
            *energy += here;
        }
        lobes.clear();
        for (centre, (moment, flux, energy)) in centres.iter_mut().zip(sums) {
            let (axis, length) = unit(moment);
            if energy <= 0.0 {
                lobes.push(SphericalGaussian { axis: *centre, sharpness: 1.0, amplitude: [0.0; 3] });
                continue;
            }
            *centre = axis;
            // Sharpness by the mean length of the directions (Banerjee 2005).
            let r = (length / energy).min(0.9999);
            let sharpness = (r * (3.0 - r * r) / (1.0 - r * r)).clamp(SHARPNESS[0], SHARPNESS[1]);
            let amplitude = flux.map(|f| f / sphere_integral(sharpness));
            lobes.push(SphericalGaussian { axis, sharpness, amplitude });
        }
    }
    lobes
}

/// Irradiance of an environment on a surface, by summing all its pixels.
pub(crate) fn irradiance(environment: &EnvironmentMap, normal: [f64; 3]) -> [f64; 3] {
    let image = environment.image();
    let mut sum = [0.0; 3];
    for y in 0..image.height {
        let angle = environment.solid_angle(y);
        for (x, pixel) in image.row(y).iter().enumerate() {
            let cosine = dot(environment.direction(x as f64 + 0.5, y as f64 + 0.5), normal);
            if cosine > 0.0 {
                (0..3).for_each(|c| sum[c] += angle * cosine * pixel[c] as f64);
            }
        }
    }
    sum
}

/// Root mean square error of the lobes' irradiance over the root mean square irradiance, on 60 normals, against the sum over all
/// pixels.
pub fn irradiance_error(environment: &EnvironmentMap, lobes: &[SphericalGaussian]) -> f64 {
    const NORMALS: usize = 60;
    let normals: Vec<[f64; 3]> = spread_directions(NORMALS).collect();
    let light = super::EnvironmentLobes { diffuse: lobes.to_vec(), prefiltered: Vec::new() };
    let sums = crate::parallel::map(NORMALS, |k| {
        let (exact, found) = (irradiance(environment, normals[k]), light.irradiance(normals[k]));
        let squared = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
        (squared(std::array::from_fn(|c| found[c] - exact[c])), squared(exact))
    });
    let (error, whole) = sums.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    if whole > 0.0 { (error / whole).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> EnvironmentMap {
        let lobes = [
            ([0.6, 0.8, 0.0], 40.0, [9.0, 8.0, 6.0]),
            ([0.0, 1.0, 0.0], 1.5, [0.4, 0.6, 1.0]),
            ([0.0, -0.6, 0.8], 5.0, [0.5, 0.2, 0.1]),
        ];
        EnvironmentMap::from_fn(128, |d| {
            let sum = lobes.iter().fold([0.0; 3], |sum, &(axis, sharpness, amplitude)| {
                let value = SphericalGaussian { axis, sharpness, amplitude }.evaluate(d);
                std::array::from_fn(|c| sum[c] + value[c])
            });
            sum.map(|x| x as f32)
        })
    }

    #[test]
    fn the_gradient_is_the_slope() {
        let cells = EnvironmentCell::of(&scene());
        let tests = TestLobes::through(&cells);
        let total: f64 = cells.iter().map(EnvironmentCell::energy).sum();
        let x: Vec<f64> = cluster(&cells, 3).iter().flat_map(|lobe| to_numbers(lobe, total)).collect();
        let mut gradient = vec![0.0; x.len()];
        tests.difference(&x, total, &mut gradient);
        let mut ignored = vec![0.0; x.len()];
        for k in 0..x.len() {
            let mut at = |step: f64| {
                let mut moved = x.clone();
                moved[k] += step;
                tests.difference(&moved, total, &mut ignored)
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((slope - gradient[k]).abs() < 1e-5 * (1.0 + slope.abs()), "{k}: {slope} {}", gradient[k]);
        }
    }

    #[test]
    fn lobes_are_found_again_and_follow() {
        let environment = scene();
        let options = LobeFitOptions { lobes: 3, evaluations: 300 };
        let lobes = fit(&environment, &options, None);
        assert!(irradiance_error(&environment, &lobes) < 4e-3, "{lobes:?}");
        let turned = environment.rotated_y(4.0);
        let before = irradiance_error(&turned, &lobes);
        let after = irradiance_error(&turned, &fit(&turned, &options, Some(&lobes)));
        assert!(after < 0.01 && after < 0.5 * before, "{before} {after}");
        assert!(fit(&EnvironmentMap::from_fn(8, |_| [0.0; 3]), &options, None).is_empty());
    }
}
