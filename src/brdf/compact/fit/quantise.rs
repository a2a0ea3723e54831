//! Integers for the coefficients: least squared error plus what their bits are worth.

use super::codec::{MAX_MAGNITUDE, cost, level};
use crate::brdf::compact::{CHANNEL_STEPS, TermDegrees, step_size};

/// Squared steps that a bit is worth.
const BIT_WORTH: f64 = 0.1;
/// Largest number of changes of the gain.
const ROUNDS_OF_GAIN: usize = 4;
/// Added to the diagonal of the normal equations, whose entries are of order 1: where no sample lies, the smallest coefficients win.
const RIDGE: f64 = 1e-5;
/// Rounds over all coefficients, each changed alone.
const ROUNDS: usize = 8;

/// Normal equations of the three coded channels.
pub(super) struct CompactNormalEquations<'a> {
    degrees: &'a [TermDegrees],
    matrix: Vec<Vec<f64>>,
    /// Coefficients by their relative degree: low ones are chosen last and take up what the high ones miss.
    order: Vec<usize>,
    /// Upper triangle with `R^T R` = the matrix in that order.
    triangle: Vec<Vec<f64>>,
    /// Right sides of mean and differences.
    sides: [Vec<f64>; 3],
    /// `R^-T` of them, in that order.
    solved: [Vec<f64>; 3],
}

impl<'a> CompactNormalEquations<'a> {
    /// From the matrix and the right sides of red, green, blue.
    pub(super) fn new(mut matrix: Vec<Vec<f64>>, sides: [Vec<f64>; 3], degrees: &'a [TermDegrees]) -> Self {
        let count = degrees.len();
        (0..count).for_each(|n| matrix[n][n] += RIDGE);
        let [a, b, m] = crate::brdf::compact::COMPACT_DEGREES;
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_key(|&n| degrees[n][0] * b * m + degrees[n][1] * a * m + degrees[n][2] * a * b);
        let triangle = cholesky(&matrix, &order);
        let [red, green, blue] = sides;
        let combine = |of: &dyn Fn(usize) -> f64| (0..count).map(of).collect::<Vec<f64>>();
        let sides = [
            combine(&|n| (red[n] + green[n] + blue[n]) / 3.0),
            combine(&|n| (red[n] - blue[n]) / 2.0),
            combine(&|n| (red[n] - 2.0 * green[n] + blue[n]) / 6.0),
        ];
        let solved = [0, 1, 2].map(|c| {
            let mut z: Vec<f64> = order.iter().map(|&n| sides[c][n]).collect();
            for i in 0..count {
                z[i] /= triangle[i][i];
                let known = z[i];
                (i + 1..count).for_each(|j| z[j] -= triangle[i][j] * known);
            }
            z
        });
        CompactNormalEquations { degrees, matrix, order, triangle, sides, solved }
    }

    /// Coefficients of a channel, not quantised.
    pub(super) fn solution(&self, channel: usize) -> Vec<f64> {
        let count = self.order.len();
        let mut x = self.solved[channel].clone();
        for i in (0..count).rev() {
            let above: f64 = (i + 1..count).map(|j| self.triangle[i][j] * x[j]).sum();
            x[i] = (x[i] - above) / self.triangle[i][i];
        }
        let mut solution = vec![0.0; count];
        self.order.iter().zip(x).for_each(|(&n, x)| solution[n] = x);
        solution
    }

    /// Coefficients of a channel in units of its step, and the gain that suits them.
    pub(super) fn quantise(&self, channel: usize, step: u8) -> (Vec<i32>, u8) {
        let unit = step_size(step) * CHANNEL_STEPS[channel];
        let levels = |gain: u8| self.degrees.iter().map(move |&d| level(d, channel, gain)).collect::<Vec<i32>>();
        let best_gain = |whole: &[i32]| {
            let bits = |gain: u8| -> f64 {
                self.degrees.iter().zip(whole).map(|(&d, &q)| cost(level(d, channel, gain), q.unsigned_abs())).sum()
            };
            (0..32u8).min_by(|&a, &b| bits(a).total_cmp(&bits(b))).unwrap_or(0)
        };
        let mut whole = self.round(channel, unit, &levels(0), 0.0);
        let mut gain = best_gain(&whole);
        for _ in 0..ROUNDS_OF_GAIN {
            whole = self.refine(channel, unit, &levels(gain), self.round(channel, unit, &levels(gain), BIT_WORTH));
            let best = best_gain(&whole);
            if best == gain {
                break;
            }
            gain = best;
        }
        (whole, gain)
    }

    /// From the highest degree down, each coefficient given those above it (Babai 1986).
    fn round(&self, channel: usize, unit: f64, levels: &[i32], bit_worth: f64) -> Vec<i32> {
        let count = self.order.len();
        let mut whole = vec![0; count];
        let mut target: Vec<f64> = self.solved[channel].iter().map(|z| z / unit).collect();
        let mut chosen = vec![0.0; count];
        for i in (0..count).rev() {
            let row = &self.triangle[i];
            let n = self.order[i];
            let above: f64 = (i + 1..count).map(|j| row[j] * chosen[j]).sum();
            target[i] = (target[i] - above) / row[i];
            chosen[i] = cheapest_integer(target[i], row[i] * row[i], levels[n], bit_worth, &[]);
            whole[n] = chosen[i] as i32;
        }
        whole
    }

    /// Changes one coefficient at a time while it pays.
    fn refine(&self, channel: usize, unit: f64, levels: &[i32], mut whole: Vec<i32>) -> Vec<i32> {
        let count = whole.len();
        let mut slope: Vec<f64> = self.sides[channel].iter().map(|s| s / unit).collect();
        for n in 0..count {
            if whole[n] != 0 {
                (0..count).for_each(|k| slope[k] -= self.matrix[n][k] * whole[n] as f64);
            }
        }
        for _ in 0..ROUNDS {
            let mut changed = false;
            for n in 0..count {
                let now = whole[n] as f64;
                let curvature = self.matrix[n][n];
                let best = cheapest_integer(
                    now + slope[n] / curvature,
                    curvature,
                    levels[n],
                    BIT_WORTH,
                    &[now, now - 1.0, now + 1.0],
                );
                if best != now {
                    (0..count).for_each(|k| slope[k] -= self.matrix[n][k] * (best - now));
                    whole[n] = best as i32;
                    changed = true;
                }
            }
            if !changed {
                break;
            }
        }
        whole
    }
}

/// The cheapest integer near a target, or 0, or one of the others.
fn cheapest_integer(target: f64, curvature: f64, level: i32, bit_worth: f64, others: &[f64]) -> f64 {
    let below = target.floor();
    let mut best = (f64::INFINITY, 0.0);
    for candidate in [below, below + 1.0, 0.0].into_iter().chain(others.iter().copied()) {
        let candidate = candidate.clamp(-(MAX_MAGNITUDE as f64), MAX_MAGNITUDE as f64);
        let apart = candidate - target;
        let price = curvature * apart * apart + bit_worth * cost(level, candidate.abs() as u32);
        if price < best.0 {
            best = (price, candidate);
        }
    }
    best.1
}

fn cholesky(matrix: &[Vec<f64>], order: &[usize]) -> Vec<Vec<f64>> {
    let count = order.len();
    let mut triangle: Vec<Vec<f64>> = order.iter().map(|&n| order.iter().map(|&k| matrix[n][k]).collect()).collect();
    for i in 0..count {
        // Rounding may leave a pivot below zero; the ridge is its least value.
        let pivot = triangle[i][i].max(RIDGE * 1e-3).sqrt();
        triangle[i][i] = pivot;
        (i + 1..count).for_each(|j| triangle[i][j] /= pivot);
        let (done, rest) = triangle.split_at_mut(i + 1);
        let row = &done[i];
        for (offset, other) in rest.iter_mut().enumerate() {
            let j = i + 1 + offset;
            let factor = row[j];
            if factor != 0.0 {
                (j..count).for_each(|k| other[k] -= factor * row[k]);
            }
        }
    }
    triangle
}
