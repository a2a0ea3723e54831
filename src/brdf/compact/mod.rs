//! The `compact` form: the logarithm of the BRDF as a polynomial of three angles, quantised and range-coded; a material takes 256 bytes.
//!
//! With `x = sqrt(theta_h / (pi/2))`, `y = theta_d / (pi/2)` and `s = (cos_i - cos_o) / (cos_i + cos_o)`, which is
//! `-tan theta_h tan theta_d cos phi_d` and runs from -1 to 1 between the horizons,
//! `ln(f + floor) = sum c_abm T_a(2x - 1) T_b(2y - 1) T_m(s)` with Chebyshev polynomials `T`. The square root spends degrees on the
//! highlight; the floor, a hundredth of what shows as white, keeps relative errors of what is black from counting. `s` carries shadowing, masking and retro-reflection,
//! which depend on both directions and which lobes of the half angle alone miss; only even `m` for a reciprocal material.
//! The three channels are coded as their mean and two differences.

mod codec;
#[cfg(feature = "encode")]
mod fit;
mod prior;

#[cfg(feature = "encode")]
pub(super) use fit::coefficients;
#[cfg(feature = "encode")]
pub use fit::{CompactFitOptions, FitDirections, fit_compact};

use super::Brdf;
use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

/// Degrees in `x`, `y` and `s` stay below these; their parts of them add up to 1 at most. Part of the format.
pub const COMPACT_DEGREES: [usize; 3] = [16, 10, 8];
/// Quantiser steps of the mean and the two differences, in units of the material's step: errors of the three add up alike
/// in the channels. Part of the format.
const CHANNEL_STEPS: [f64; 3] = [9.0 / 16.0, 11.0 / 16.0, 13.0 / 32.0];

/// Degrees of one coefficient in `x`, `y`, `s`.
type TermDegrees = [usize; 3];

/// All coefficients in the order of the format: by `a`, then `b`, then `m`.
fn degrees(reciprocal: bool) -> &'static [TermDegrees] {
    static ALL: LazyLock<[Vec<TermDegrees>; 2]> = LazyLock::new(|| {
        let [a, b, m] = COMPACT_DEGREES;
        let within = |d: &TermDegrees| d[0] * b * m + d[1] * a * m + d[2] * a * b <= a * b * m;
        let each = (0..a).flat_map(|i| (0..b).flat_map(move |j| (0..m).map(move |k| [i, j, k])));
        let all: Vec<TermDegrees> = each.filter(within).collect();
        [all.clone(), all.into_iter().filter(|d| d[2].is_multiple_of(2)).collect()]
    });
    &ALL[reciprocal as usize]
}

/// Header of a coded material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct CompactHeader {
    /// `true` if exchanging both directions changes nothing.
    reciprocal: bool,
    /// Step number, 0 to 63: the step is `(8 + n % 8) * 2^(n / 8 - 13)`.
    step: u8,
    /// The floor is `2^-floor`; 0 to 31.
    floor: u8,
    /// The logarithm is not above `ceiling / 4 - 8`; 0 to 127.
    ceiling: u8,
    /// Half octaves by which the coefficients of the mean and the differences are larger than the format's prior says; 0 to 31.
    gains: [u8; 3],
}

/// Terms of a reciprocal material.
#[cfg(feature = "encode")]
pub(super) const TERMS: usize = 186;

/// The terms of a reciprocal material at the angles (radians) and the cosines of both directions.
#[cfg(feature = "encode")]
pub(super) fn terms(theta_h: f64, theta_d: f64, cos_incoming: f64, cos_outgoing: f64) -> Vec<f64> {
    let [x, y, s] = coordinates(theta_h, theta_d, cos_incoming, cos_outgoing);
    let (along_x, along_y, along_s) = (
        chebyshev::<{ COMPACT_DEGREES[0] }>(x),
        chebyshev::<{ COMPACT_DEGREES[1] }>(y),
        chebyshev::<{ COMPACT_DEGREES[2] }>(s),
    );
    degrees(true).iter().map(|&[a, b, m]| along_x[a] * along_y[b] * along_s[m]).collect()
}

/// A material in the compact form.
#[derive(Debug, Clone, PartialEq)]
pub struct CompactMaterial {
    header: CompactHeader,
    /// Quantised coefficients of the mean and the differences.
    coefficients: [Vec<i32>; 3],
    /// Coefficients of red, green, blue: `[a][b][m]`, zeros where there are none.
    dense: Vec<[f64; 3]>,
}

impl CompactMaterial {
    fn new(header: CompactHeader, coefficients: [Vec<i32>; 3]) -> Self {
        let CompactHeader { reciprocal, step, .. } = header;
        let mut dense = vec![[0.0; 3]; COMPACT_DEGREES.iter().product()];
        let step_size = step_size(step);
        for (n, &[a, b, m]) in degrees(reciprocal).iter().enumerate() {
            let of = |c: usize| {
                let whole = coefficients[c].get(n).copied().unwrap_or(0);
                whole as f64 * (step_size * CHANNEL_STEPS[c])
            };
            let (mean, red_blue, green) = (of(0), of(1), of(2));
            dense[(a * COMPACT_DEGREES[1] + b) * COMPACT_DEGREES[2] + m] =
                [mean + red_blue + green, mean - 2.0 * green, mean - red_blue + green];
        }
        CompactMaterial { header, coefficients, dense }
    }

    /// Material of its header's numbers (step, floor, ceiling, gains) and of quantised coefficients, for fuzzing; `None` where one is out
    /// of range.
    #[cfg(feature = "encode")]
    #[doc(hidden)]
    pub fn from_numbers(reciprocal: bool, header: [u8; 6], mut next: impl FnMut() -> i32) -> Option<Self> {
        let [step, floor, ceiling, gains @ ..] = header;
        let coefficients = [(); 3].map(|_| degrees(reciprocal).iter().map(|_| next()).collect::<Vec<i32>>());
        let in_range = header.iter().zip([63, 31, 127, 31, 31, 31]).all(|(number, most)| *number <= most);
        let small = coefficients.iter().flatten().all(|c| c.unsigned_abs() <= codec::MAX_MAGNITUDE);
        let header = CompactHeader { reciprocal, step, floor, ceiling, gains };
        (in_range && small).then(|| Self::new(header, coefficients))
    }

    /// `true` if exchanging both directions changes nothing.
    pub fn is_reciprocal(&self) -> bool {
        self.header.reciprocal
    }

    /// Value at the angles (radians) and the cosines of both directions, which are above 0.
    pub fn value_at(&self, theta_h: f64, theta_d: f64, cos_incoming: f64, cos_outgoing: f64) -> [f64; 3] {
        let [x, y, s] = coordinates(theta_h, theta_d, cos_incoming, cos_outgoing);
        self.value(&self.along_s(x, y), s)
    }

    /// The sums over `a` and `b`: factors of `T_m(s)` for red, green, blue.
    fn along_s(&self, x: f64, y: f64) -> [[f64; 3]; COMPACT_DEGREES[2]] {
        let (along_x, along_y) = (chebyshev::<{ COMPACT_DEGREES[0] }>(x), chebyshev::<{ COMPACT_DEGREES[1] }>(y));
        let mut sums = [[0.0; 3]; COMPACT_DEGREES[2]];
        for (a, plane) in self.dense.chunks_exact(COMPACT_DEGREES[1] * COMPACT_DEGREES[2]).enumerate() {
            // The parts add up to 1 at most: the rest of the plane is zero.
            let rows = COMPACT_DEGREES[1] * (COMPACT_DEGREES[0] - a) / COMPACT_DEGREES[0] + 1;
            for (row, along_y) in plane.chunks_exact(COMPACT_DEGREES[2]).zip(along_y).take(rows) {
                let factor = along_y * along_x[a];
                for (value, sum) in row.iter().zip(&mut sums) {
                    (0..3).for_each(|c| sum[c] += value[c] * factor);
                }
            }
        }
        sums
    }

    fn value(&self, sums: &[[f64; 3]; COMPACT_DEGREES[2]], s: f64) -> [f64; 3] {
        let mut logarithm = [0.0; 3];
        for (sum, along_s) in sums.iter().zip(chebyshev::<{ COMPACT_DEGREES[2] }>(s)) {
            (0..3).for_each(|c| logarithm[c] += sum[c] * along_s);
        }
        let (ceiling, floor) = (self.header.ceiling as f64 / 4.0 - 8.0, floor_size(self.header.floor));
        logarithm.map(|l| (l.min(ceiling).exp() - floor).max(0.0))
    }
}

impl Brdf for CompactMaterial {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        let angles = crate::brdf::HalfDifference::from_directions(incoming, outgoing);
        self.value_at(angles.theta_h, angles.theta_d, incoming[2], outgoing[2])
    }

    fn evaluate_row(&self, theta_h: f64, theta_d: f64, pairs: &[[[f64; 3]; 2]], values: &mut Vec<[f64; 3]>) {
        let [x, y, _] = coordinates(theta_h, theta_d, 1.0, 1.0);
        let sums = self.along_s(x, y);
        values.extend(pairs.iter().map(|[incoming, outgoing]| {
            let [_, _, s] = coordinates(theta_h, theta_d, incoming[2], outgoing[2]);
            self.value(&sums, s)
        }));
    }
}

/// The step of a step number.
fn step_size(number: u8) -> f64 {
    (8 + number % 8) as f64 * 2f64.powi(number as i32 / 8 - 13)
}

/// The floor of its number.
fn floor_size(number: u8) -> f64 {
    2f64.powi(-(number as i32))
}

/// `2x - 1`, `2y - 1` and `s`, each -1 to 1.
fn coordinates(theta_h: f64, theta_d: f64, cos_incoming: f64, cos_outgoing: f64) -> [f64; 3] {
    let part = |angle: f64| (angle / FRAC_PI_2).clamp(0.0, 1.0);
    let sum = cos_incoming + cos_outgoing;
    let s = if sum > 0.0 { ((cos_incoming - cos_outgoing) / sum).clamp(-1.0, 1.0) } else { 0.0 };
    [2.0 * part(theta_h).sqrt() - 1.0, 2.0 * part(theta_d) - 1.0, s]
}

/// `T_0(x)` to `T_(N-1)(x)` by `T_(n+1) = 2 x T_n - T_(n-1)`.
fn chebyshev<const N: usize>(x: f64) -> [f64; N] {
    let mut values = [1.0; N];
    if N > 1 {
        values[1] = x;
    }
    for n in 2..N {
        values[n] = 2.0 * x * values[n - 1] - values[n - 2];
    }
    values
}

#[cfg(test)]
mod tests;
