//! Normal equations of Chebyshev products, by way of moments.
//!
//! `T_a T_a' = (T_(a+a') + T_|a-a'|) / 2`, so that all entries follow from the weighted sums of `T_a T_b T_c` up to twice the degree, and
//! samples of one `theta_h`, one `theta_d` share the work.

use crate::brdf::BrdfSample;
use crate::brdf::compact::{COMPACT_DEGREES, TermDegrees, chebyshev, coordinates};

const X: usize = COMPACT_DEGREES[0];
const Y: usize = COMPACT_DEGREES[1];
const S: usize = COMPACT_DEGREES[2];
const X2: usize = 2 * X - 1;
const Y2: usize = 2 * Y - 1;
const S2: usize = 2 * S - 1;

/// A sample with what it counts.
pub(super) struct WeightedSample<'a> {
    pub sample: &'a BrdfSample,
    pub weight: f64,
    pub logarithm: [f64; 3],
}

/// Sums over samples of equal `theta_h` and `theta_d`, over those of equal `theta_h`, and over all.
pub(super) struct Moments {
    reciprocal: bool,
    at: [f64; 2],
    weight_s: [f64; S2],
    value_s: [[f64; 3]; S],
    weight_ys: Vec<[f64; S2]>,
    value_ys: Vec<[[f64; 3]; S]>,
    weight: Vec<[f64; S2]>,
    value: Vec<[[f64; 3]; S]>,
    total: f64,
}

impl Moments {
    pub(super) fn new(reciprocal: bool) -> Self {
        Moments {
            reciprocal,
            at: [f64::NAN; 2],
            weight_s: [0.0; S2],
            value_s: [[0.0; 3]; S],
            weight_ys: vec![[0.0; S2]; Y2],
            value_ys: vec![[[0.0; 3]; S]; Y],
            weight: vec![[0.0; S2]; X2 * Y2],
            value: vec![[[0.0; 3]; S]; X * Y],
            total: 0.0,
        }
    }

    pub(super) fn add(&mut self, of: &WeightedSample) {
        let sample = of.sample;
        let [x, y, s] = coordinates(sample.theta_h, sample.theta_d, sample.cos_incoming, sample.cos_outgoing);
        if [x, y] != self.at {
            self.close_y();
            if x != self.at[0] {
                self.close_x();
            }
            self.at = [x, y];
        }
        self.total += 1.0;
        // A reciprocal material has even degrees only; T_2k(s) = T_k(T_2(s)).
        let (s, degrees) = if self.reciprocal { (2.0 * s * s - 1.0, S / 2) } else { (s, S) };
        let along = chebyshev::<S2>(s);
        for (sum, t) in self.weight_s.iter_mut().zip(along).take(2 * degrees - 1) {
            *sum += of.weight * t;
        }
        let value = of.logarithm.map(|l| l * of.weight);
        for (sum, t) in self.value_s.iter_mut().zip(along).take(degrees) {
            (0..3).for_each(|c| sum[c] += value[c] * t);
        }
    }

    fn close_y(&mut self) {
        if self.at[1].is_nan() {
            return;
        }
        let along = chebyshev::<Y2>(self.at[1]);
        for (sums, t) in self.weight_ys.iter_mut().zip(along) {
            (0..S2).for_each(|k| sums[k] += self.weight_s[k] * t);
        }
        for (sums, t) in self.value_ys.iter_mut().zip(along) {
            for (sum, value) in sums.iter_mut().zip(&self.value_s) {
                (0..3).for_each(|c| sum[c] += value[c] * t);
            }
        }
        self.weight_s = [0.0; S2];
        self.value_s = [[0.0; 3]; S];
    }

    fn close_x(&mut self) {
        if self.at[0].is_nan() {
            return;
        }
        let along = chebyshev::<X2>(self.at[0]);
        for (plane, t) in self.weight.chunks_exact_mut(Y2).zip(along) {
            for (sums, row) in plane.iter_mut().zip(&self.weight_ys) {
                (0..S2).for_each(|k| sums[k] += row[k] * t);
            }
        }
        for (plane, t) in self.value.chunks_exact_mut(Y).zip(along) {
            for (sums, row) in plane.iter_mut().zip(&self.value_ys) {
                for (sum, value) in sums.iter_mut().zip(row) {
                    (0..3).for_each(|c| sum[c] += value[c] * t);
                }
            }
        }
        self.weight_ys.fill([0.0; S2]);
        self.value_ys.fill([[0.0; 3]; S]);
    }

    /// The matrix (rows of `degrees`) and the right sides of red, green, blue, divided by the number of samples.
    pub(super) fn finish(mut self, degrees: &[TermDegrees]) -> (Vec<Vec<f64>>, [Vec<f64>; 3]) {
        self.close_y();
        self.close_x();
        let scale = 1.0 / self.total.max(1.0);
        let third = |d: &TermDegrees| if self.reciprocal { d[2] / 2 } else { d[2] };
        let entry = |p: &TermDegrees, q: &TermDegrees| {
            let (p2, q2) = (third(p), third(q));
            let mut sum = 0.0;
            for a in [p[0] + q[0], p[0].abs_diff(q[0])] {
                for b in [p[1] + q[1], p[1].abs_diff(q[1])] {
                    let row = &self.weight[a * Y2 + b];
                    sum += row[p2 + q2] + row[p2.abs_diff(q2)];
                }
            }
            sum * (0.125 * scale)
        };
        let matrix = degrees.iter().map(|p| degrees.iter().map(|q| entry(p, q)).collect()).collect();
        let side = |c: usize| degrees.iter().map(|d| self.value[d[0] * Y + d[1]][third(d)][c] * scale).collect();
        (matrix, [side(0), side(1), side(2)])
    }
}
