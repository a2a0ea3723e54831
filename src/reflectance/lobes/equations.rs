//! Normal equations of the weights of lobes.

use super::LOBES;
use crate::optimise::nonnegative::minimise_nonnegative;

/// Added to the diagonal, as a share of the cell's mean.
const RIDGE: f64 = 1e-3;
/// Weights of the lobes, for `C` colours.
pub(super) type Weights<const C: usize> = [[f64; LOBES]; C];

/// Normal equations of the lobes' weights, for `C` colours with the same lobes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LobeEquations<const C: usize> {
    pub(super) square: [[f64; LOBES]; LOBES],
    product: [[f64; LOBES]; C],
}

impl<const C: usize> Default for LobeEquations<C> {
    fn default() -> Self {
        LobeEquations { square: [[0.0; LOBES]; LOBES], product: [[0.0; LOBES]; C] }
    }
}

impl<const C: usize> LobeEquations<C> {
    /// Adds a sighting: the lobes' values, and the specular radiance over the irradiance.
    pub(crate) fn add(&mut self, values: &[f64; LOBES], seen: [f64; C], weight: f64) {
        for k in 0..LOBES {
            let value = weight * values[k];
            for l in 0..=k {
                self.square[k][l] += value * values[l];
            }
            for c in 0..C {
                self.product[c][k] += value * seen[c];
            }
        }
    }
    /// Adds a multiple of other equations.
    pub(crate) fn merge(&mut self, other: &Self, weight: f64) {
        for k in 0..LOBES {
            (0..=k).for_each(|l| self.square[k][l] += weight * other.square[k][l]);
            (0..C).for_each(|c| self.product[c][k] += weight * other.product[c][k]);
        }
    }
    /// Mean of the diagonal.
    fn mean(&self) -> f64 {
        (0..LOBES).map(|k| self.square[k][k]).sum::<f64>() / LOBES as f64
    }
    /// The weights of least error, drawn towards `usual` by the weight of each lobe in `pull`.
    pub(super) fn solve(&self, usual: &Weights<C>, pull: &[f64; LOBES], sweeps: usize) -> Weights<C> {
        let ridge = RIDGE * self.mean() + 1e-30;
        let square = std::array::from_fn(|k| {
            std::array::from_fn(|l| self.square[k.max(l)][k.min(l)] + if k == l { ridge + pull[k] } else { 0.0 })
        });
        std::array::from_fn(|c| {
            let product = std::array::from_fn(|k| self.product[c][k] + pull[k] * usual[c][k]);
            let mut x = usual[c];
            minimise_nonnegative(&square, &product, &mut x, sweeps);
            x
        })
    }
    /// The sum of squared errors under given weights, but for what is the same under all.
    pub(super) fn error(&self, weights: &Weights<C>) -> f64 {
        let of_colour = |(w, product): (&[f64; LOBES], &[f64; LOBES])| {
            let row = |k: usize| (0..LOBES).map(|l| self.square[k.max(l)][k.min(l)] * w[l]).sum::<f64>();
            (0..LOBES).map(|k| w[k] * (row(k) - 2.0 * product[k])).sum::<f64>()
        };
        weights.iter().zip(&self.product).map(of_colour).sum()
    }
}
