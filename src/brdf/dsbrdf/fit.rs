//! Expectation maximisation with Levenberg-Marquardt steps, slice by slice.
//!
//! E-step: each lobe is given its part of the measured value, `q_k = lobe_k / sum lobe_j`. M-step: each lobe is fitted to `q_k y` by
//! Levenberg-Marquardt steps in the logarithms of its parameters, which keeps them positive. A slice starts from its neighbour's result, so
//! that lobes keep their identity over `theta_d` and can be interpolated.

use super::{DsbrdfLobe, DsbrdfMaterial, MAX_LOBES, MAX_SLICES, RANGE, STEP};
use crate::brdf::BrdfSample;
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

/// Number of lobes of each colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LobeCount {
    /// This many, 1 to 5.
    Given(usize),
    /// The fewest of 1 to 5 whose error is within a twentieth of the least.
    ByError,
}

/// Error that a fit of lobes minimises in each slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LobeError {
    /// Relative squares over the means of bins of `theta_h`, for a fixed number of rounds: dark parts count as much as highlights.
    #[default]
    Relative,
    /// Plain squares over the samples, until the rounds converge, as published (DSBRDF, equation 9): highlights count most.
    Squares,
}

/// Options of [`fit_dsbrdf`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DsbrdfFitOptions {
    /// Slices of `theta_d`: 1 to 90; the authors use 18 of 5 degrees and 6 of 15 degrees.
    pub slices: usize,
    /// Number of lobes of each colour.
    pub lobes: LobeCount,
    /// `true` gives each lobe an amplitude of its own.
    pub amplitudes: bool,
    /// Samples of a smaller `theta_h` are left out, degrees: measurements close to the highlight's centre are unreliable.
    pub min_theta_h_deg: f64,
    /// Rounds of expectation maximisation for a slice; for [`LobeError::Squares`] the least.
    pub rounds: usize,
    /// Error that the fit minimises.
    pub error: LobeError,
}

impl Default for DsbrdfFitOptions {
    fn default() -> Self {
        DsbrdfFitOptions {
            slices: 18,
            lobes: LobeCount::Given(3),
            amplitudes: false,
            min_theta_h_deg: 5.0,
            rounds: 14,
            error: LobeError::Relative,
        }
    }
}

/// Bins of `theta_h`, growing with its square, in which samples of a slice are averaged.
const BINS: usize = 90;
/// Tens of rounds after which a fit of plain squares ends at the latest.
const MAX_CONVERGENCE: usize = 30;
/// Levenberg-Marquardt steps of an M-step.
const STEPS: usize = 2;
/// A part of the mean added to a value when its squared error is divided by its square: the relative error counts, but not of black.
const RELATIVE_FLOOR: f64 = 0.1;

/// A lobe's peak, which lies where no sample was taken, is at most this many times the greatest value of the slice.
const MAX_PEAK_FACTOR: f64 = 8.0;
/// Half angle, radians, up to which the centre of a highlight counts as measured.
const CENTRE: f64 = 0.02;

/// Mean values of a slice's bins.
struct DifferenceSlice {
    /// `ln cos theta_h`, weight, red, green, blue.
    bins: Vec<(f64, f64, [f64; 3])>,
}

/// Fits lobes to samples in any order.
/// # Errors
/// [`Error::Parameter`] where counts are out of range or no sample is usable.
pub fn fit_dsbrdf(samples: &[BrdfSample], options: &DsbrdfFitOptions) -> Result<DsbrdfMaterial> {
    let count_is_valid = match options.lobes {
        LobeCount::Given(count) => (1..=MAX_LOBES).contains(&count),
        LobeCount::ByError => true,
    };
    if !(1..=MAX_SLICES).contains(&options.slices) || !count_is_valid {
        return Err(Error::parameter("a material takes 1 to 90 slices and 1 to 5 lobes"));
    }
    let slices = match options.error {
        LobeError::Relative => gather(samples, options),
        LobeError::Squares => gather_exactly(samples, options),
    };
    if slices.iter().all(|s| s.bins.is_empty()) {
        return Err(Error::parameter(
            "no sample to fit: all are negative, not finite, below the horizon or too near the highlight",
        ));
    }
    match options.lobes {
        LobeCount::Given(count) => Ok(fit_count(&slices, count, options).0),
        LobeCount::ByError => {
            let all: Vec<(DsbrdfMaterial, f64)> =
                (1..=MAX_LOBES).map(|count| fit_count(&slices, count, options)).collect();
            let least = all.iter().map(|(_, error)| *error).fold(f64::INFINITY, f64::min);
            let first = all.into_iter().find(|(_, error)| *error <= 1.05 * least + 1e-12);
            first.map(|(material, _)| material).ok_or_else(|| Error::parameter("values too large to fit"))
        }
    }
}

/// Samples that can be fitted, with their slices.
fn usable<'a>(
    samples: &'a [BrdfSample],
    options: &'a DsbrdfFitOptions,
) -> impl Iterator<Item = (usize, &'a BrdfSample)> + 'a {
    let is_usable = |s: &&BrdfSample| {
        s.value.iter().all(|v| v.is_finite() && *v >= 0.0)
            && s.theta_h >= options.min_theta_h_deg.to_radians()
            && s.theta_h < FRAC_PI_2
            && s.cos_incoming > 0.0
            && s.cos_outgoing > 0.0
    };
    let slice = |s: &BrdfSample| ((s.theta_d / FRAC_PI_2 * options.slices as f64) as usize).min(options.slices - 1);
    samples.iter().filter(is_usable).map(move |s| (slice(s), s))
}

fn bin_of(theta_h: f64) -> usize {
    (((theta_h / FRAC_PI_2).sqrt() * BINS as f64) as usize).min(BINS - 1)
}

/// Number of half angles, bins of `theta_h`, that each slice has samples in.
pub(in crate::brdf) fn half_angles(samples: &[BrdfSample], options: &DsbrdfFitOptions) -> Vec<usize> {
    let mut there = vec![[false; BINS]; options.slices];
    usable(samples, options).for_each(|(slice, s)| there[slice][bin_of(s.theta_h)] = true);
    there.iter().map(|bins| bins.iter().filter(|there| **there).count()).collect()
}

fn gather(samples: &[BrdfSample], options: &DsbrdfFitOptions) -> Vec<DifferenceSlice> {
    let mut sums = vec![[0.0f64; 5]; options.slices * BINS];
    for (slice, s) in usable(samples, options) {
        let sum = &mut sums[slice * BINS + bin_of(s.theta_h)];
        sum[0] += 1.0;
        sum[1] += s.theta_h;
        (0..3).for_each(|c| sum[2 + c] += s.value[c]);
    }
    let mean = |sum: &[f64; 5]| {
        let theta_h = sum[1] / sum[0];
        (theta_h.cos().ln(), 1.0, [sum[2] / sum[0], sum[3] / sum[0], sum[4] / sum[0]])
    };
    let slice = |bins: &[[f64; 5]]| DifferenceSlice { bins: bins.iter().filter(|s| s[0] > 0.0).map(mean).collect() };
    sums.chunks_exact(BINS).map(slice).collect()
}

/// Samples of a slice, those of exactly one `theta_h` as their mean with their number as its weight: lobes depend on nothing else, so that
/// plain squares over the samples have the same least.
fn gather_exactly(samples: &[BrdfSample], options: &DsbrdfFitOptions) -> Vec<DifferenceSlice> {
    let mut slices = vec![BTreeMap::<u64, [f64; 4]>::new(); options.slices];
    for (slice, s) in usable(samples, options) {
        // Positive numbers are in the order of their bits.
        let sum = slices[slice].entry(s.theta_h.to_bits()).or_default();
        sum[0] += 1.0;
        (0..3).for_each(|c| sum[1 + c] += s.value[c]);
    }
    let mean = |(theta_h, [count, r, g, b]): (u64, [f64; 4])| {
        (f64::from_bits(theta_h).cos().ln(), count, [r / count, g / count, b / count])
    };
    slices.into_iter().map(|sums| DifferenceSlice { bins: sums.into_iter().map(mean).collect() }).collect()
}

/// The material and its mean squared relative error.
fn fit_count(slices: &[DifferenceSlice], count: usize, options: &DsbrdfFitOptions) -> (DsbrdfMaterial, f64) {
    let parameters = 2 + options.amplitudes as usize;
    let mut quantised = vec![0; 3 * count * parameters * slices.len()];
    let (mut error, mut points) = (0.0, 0usize);
    for colour in 0..3 {
        let mut lobes: Vec<DsbrdfLobe> = vec![];
        for (at, slice) in slices.iter().enumerate() {
            let points_of: Vec<BinPoint> = points_of(slice, colour, options.error);
            if !points_of.is_empty() {
                let first = lobes.is_empty();
                if first {
                    lobes = start(&points_of, count);
                }
                let rounds = if first { 2 * options.rounds } else { options.rounds };
                maximise(&points_of, &mut lobes, options, rounds);
                if options.error == LobeError::Squares {
                    converge(&points_of, &mut lobes, options);
                }
                error += points_of.iter().map(|p| p.weight * (total(&lobes, p) - p.value).powi(2)).sum::<f64>();
                points += points_of.len();
            }
            for (l, lobe) in lobes.iter().enumerate() {
                for (p, value) in [lobe.kappa, lobe.gamma, lobe.amplitude].into_iter().take(parameters).enumerate() {
                    let whole = (value.ln() / STEP).round().clamp(-RANGE as f64, RANGE as f64) as i32;
                    quantised[((colour * count + l) * parameters + p) * slices.len() + at] = whole;
                }
            }
        }
        // Slices before the first measured one take its lobes.
        let measured = slices.iter().position(|s| !s.bins.is_empty()).unwrap_or(0);
        for curve in quantised.chunks_exact_mut(slices.len()).skip(colour * count * parameters).take(count * parameters)
        {
            let first = curve[measured];
            curve[..measured].fill(first);
        }
    }
    let material = DsbrdfMaterial::new(slices.len(), count, options.amplitudes, quantised)
        .expect("as many parameters as the counts say, all within their range");
    (material, error / points.max(1) as f64)
}

/// A mean value at an angle.
struct BinPoint {
    logarithm_of_cosine: f64,
    value: f64,
    weight: f64,
}

fn points_of(slice: &DifferenceSlice, colour: usize, error: LobeError) -> Vec<BinPoint> {
    let mean = slice.bins.iter().map(|b| b.2[colour]).sum::<f64>() / slice.bins.len().max(1) as f64;
    let point = |b: &(f64, f64, [f64; 3])| {
        let value = b.2[colour];
        let weight = match error {
            LobeError::Relative => b.1 / (value + RELATIVE_FLOOR * mean + 1e-6).powi(2),
            LobeError::Squares => b.1,
        };
        BinPoint { logarithm_of_cosine: b.0, value, weight }
    };
    slice.bins.iter().map(point).collect()
}

fn lobe_value(lobe: &DsbrdfLobe, point: &BinPoint) -> f64 {
    lobe.amplitude * (lobe.kappa * (lobe.gamma * point.logarithm_of_cosine).exp()).exp_m1()
}

fn total(lobes: &[DsbrdfLobe], point: &BinPoint) -> f64 {
    lobes.iter().map(|lobe| lobe_value(lobe, point)).sum()
}

/// A broad lobe as high as the values far from the highlight, and ever narrower ones that share the rest of the peak.
fn start(points: &[BinPoint], count: usize) -> Vec<DsbrdfLobe> {
    let highest = points.iter().map(|p| p.value).fold(0.0, f64::max).max(1e-6);
    let lowest = points.iter().map(|p| p.value).fold(f64::INFINITY, f64::min).max(1e-3 * highest);
    (0..count)
        .map(|k| {
            let part = if count > 1 { k as f64 / (count - 1) as f64 } else { 0.0 };
            let peak = lowest.powf(1.0 - part) * highest.powf(part);
            DsbrdfLobe { kappa: (peak / count as f64).ln_1p(), gamma: 0.3 * 1000f64.powf(part), amplitude: 1.0 }
        })
        .collect()
}

/// Further rounds until the squared error changes by less than a hundred-thousandth in ten of them.
fn converge(points: &[BinPoint], lobes: &mut [DsbrdfLobe], options: &DsbrdfFitOptions) {
    let error =
        |lobes: &[DsbrdfLobe]| -> f64 { points.iter().map(|p| p.weight * (total(lobes, p) - p.value).powi(2)).sum() };
    let mut now = error(lobes);
    for _ in 0..MAX_CONVERGENCE {
        maximise(points, lobes, options, 10);
        let then = error(lobes);
        if (now - then).abs() <= 1e-5 * now {
            break;
        }
        now = then;
    }
}

/// Greatest height of a lobe. Plain squares hardly feel a lobe that rises where no sample was taken: there a lobe is at most half as high again
/// as `ln f`, straight over `theta_h^2` between the first half angle and twice that, becomes at 0.
fn max_peak(points: &[BinPoint], error: LobeError) -> f64 {
    let highest = points.iter().map(|p| p.value).fold(0.0, f64::max);
    let first = points.iter().map(|p| p.logarithm_of_cosine).fold(f64::NEG_INFINITY, f64::max);
    // The logarithm of the cosine is -theta_h^2 / 2.
    if error == LobeError::Relative || first > -0.5 * CENTRE * CENTRE {
        return MAX_PEAK_FACTOR * highest;
    }
    let (mut sums, mut count) = ([0.0; 4], 0.0);
    for point in points.iter().filter(|p| p.logarithm_of_cosine >= 4.0 * first) {
        let (x, y) = (point.logarithm_of_cosine, point.value.max(1e-4 * highest).max(1e-12).ln());
        (0..4).for_each(|k| sums[k] += [x, y, x * x, x * y][k]);
        count += 1.0;
    }
    let [x, y, xx, xy] = sums.map(|sum| sum / count);
    let slope = if xx - x * x > 1e-12 { ((xy - x * y) / (xx - x * x)).max(0.0) } else { 0.0 };
    let at_first = (y + slope * (first - x)).exp();
    1.5 * ((y - slope * x).exp()).min(MAX_PEAK_FACTOR * at_first)
}

fn maximise(points: &[BinPoint], lobes: &mut [DsbrdfLobe], options: &DsbrdfFitOptions, rounds: usize) {
    let amplitudes = options.amplitudes;
    let max_kappa = max_peak(points, options.error).ln_1p().max(1e-6);
    if options.error == LobeError::Squares {
        // Those of the neighbouring slice, or of the start, may be higher.
        lobes.iter_mut().for_each(|lobe| lobe.kappa = lobe.kappa.min(max_kappa));
    }
    let mut values = vec![0.0; lobes.len()];
    let mut targets = vec![vec![0.0; points.len()]; lobes.len()];
    for _ in 0..rounds {
        for (n, point) in points.iter().enumerate() {
            lobes.iter().zip(&mut values).for_each(|(lobe, value)| *value = lobe_value(lobe, point));
            let sum = values.iter().sum::<f64>().max(1e-300);
            targets.iter_mut().zip(&values).for_each(|(target, value)| target[n] = value / sum * point.value);
        }
        for (lobe, target) in lobes.iter_mut().zip(&targets) {
            improve(points, target, lobe, amplitudes, max_kappa);
        }
    }
}

/// Levenberg-Marquardt in `ln kappa`, `ln gamma` and, where it is free, `ln amplitude`.
fn improve(points: &[BinPoint], target: &[f64], lobe: &mut DsbrdfLobe, amplitudes: bool, max_kappa: f64) {
    let error = |lobe: &DsbrdfLobe| -> f64 {
        points.iter().zip(target).map(|(p, y)| p.weight * (lobe_value(lobe, p) - y).powi(2)).sum()
    };
    let mut now = error(lobe);
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let (mut matrix, mut side) = ([[0.0; 3]; 3], [0.0; 3]);
        for (point, y) in points.iter().zip(target) {
            let power = (lobe.gamma * point.logarithm_of_cosine).exp();
            let grown = (lobe.kappa * power).exp();
            let value = lobe.amplitude * (lobe.kappa * power).exp_m1();
            let by_kappa = lobe.amplitude * grown * power * lobe.kappa;
            let by_gamma = by_kappa * point.logarithm_of_cosine * lobe.gamma;
            let slopes = [by_kappa, by_gamma, if amplitudes { value } else { 0.0 }];
            for i in 0..3 {
                side[i] += point.weight * slopes[i] * (y - value);
                (0..3).for_each(|j| matrix[i][j] += point.weight * slopes[i] * slopes[j]);
            }
        }
        let mut better = false;
        for _ in 0..4 {
            let [a, b, c] = solve(matrix, side, damping).map(|step| step.clamp(-1.0, 1.0).exp());
            let trial = DsbrdfLobe {
                kappa: (lobe.kappa * a).clamp(1e-7, max_kappa),
                gamma: (lobe.gamma * b).clamp(1e-3, 1e6),
                amplitude: if amplitudes { (lobe.amplitude * c).clamp(1e-6, 1e6) } else { 1.0 },
            };
            let then = error(&trial);
            if then < now {
                (*lobe, now, better) = (trial, then, true);
                damping *= 0.3;
                break;
            }
            damping *= 10.0;
        }
        if !better {
            break;
        }
    }
}

/// `(A + damping diag A + tiny) x = b` by Cramer's rule.
fn solve(mut a: [[f64; 3]; 3], b: [f64; 3], damping: f64) -> [f64; 3] {
    let tiny = 1e-12 * (a[0][0] + a[1][1] + a[2][2]) + 1e-300;
    (0..3).for_each(|i| a[i][i] += damping * a[i][i] + tiny);
    let determinant = |m: [[f64; 3]; 3]| {
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    };
    let whole = determinant(a);
    std::array::from_fn(|k| {
        let mut with = a;
        (0..3).for_each(|i| with[i][k] = b[i]);
        let x = determinant(with) / whole;
        if x.is_finite() { x } else { 0.0 }
    })
}
