//! Weights of lobes that neighbouring points share: no point's highlight was seen from all sides, that of its surroundings was.

use super::LOBES;
use crate::optimise::nonnegative::minimise_nonnegative;
use crate::parallel;
use std::collections::BTreeMap;

/// Passes of the minimiser over the lobes of a cell, and of the whole object.
const SWEEPS: [usize; 2] = [60, 200];
/// Added to the diagonal, as a share of the cell's mean.
const RIDGE: f64 = 1e-3;
/// Pull towards the whole object's weight of a lobe, over the mean of all cells' equations: where no highlight of that width was seen,
/// all that is left are tails, from which nothing follows for the peak.
const PULL: f64 = 0.01;

/// Normal equations of the lobes' weights, for `C` colours with the same lobes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LobeEquations<const C: usize> {
    square: [[f64; LOBES]; LOBES],
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
    fn solve(&self, usual: &[[f64; LOBES]; C], pull: &[f64; LOBES], sweeps: usize) -> [[f64; LOBES]; C] {
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
}

/// How far weights are shared, in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SharingScale {
    /// Edge of the cells whose points have one solution.
    pub cell: f64,
    /// Standard deviation of the distance within which a cell takes its neighbours' equations into account.
    pub smoothing: f64,
}

/// Cells of a grid in space, of points of one material.
struct Cells {
    /// Of each point.
    cell: Vec<u32>,
    members: Vec<Vec<u32>>,
    centre: Vec<[f64; 3]>,
    /// Those next to each cell, itself among them, of the same material.
    near: Vec<Vec<u32>>,
}

impl Cells {
    fn new(points: &[[f64; 3]], material: &[u8], edge: f64) -> Self {
        let mut numbers: BTreeMap<(u8, [i64; 3]), u32> = BTreeMap::new();
        let mut cells = Cells { cell: Vec::new(), members: Vec::new(), centre: Vec::new(), near: Vec::new() };
        for (index, point) in points.iter().enumerate() {
            let key = (material.get(index).copied().unwrap_or(0), point.map(|x| (x / edge).floor() as i64));
            let next = numbers.len() as u32;
            let number = *numbers.entry(key).or_insert(next);
            if number == next {
                cells.members.push(Vec::new());
                cells.centre.push([0.0; 3]);
            }
            cells.cell.push(number);
            cells.members[number as usize].push(index as u32);
            (0..3).for_each(|k| cells.centre[number as usize][k] += point[k]);
        }
        for (centre, members) in cells.centre.iter_mut().zip(&cells.members) {
            *centre = centre.map(|x| x / members.len() as f64);
        }
        cells.near = vec![Vec::new(); cells.members.len()];
        for (&(material, at), &number) in &numbers {
            let around = (0..27).map(|n| [at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1]);
            cells.near[number as usize] = around.filter_map(|at| numbers.get(&(material, at)).copied()).collect();
        }
        cells
    }
    /// Weight of each near cell at a point.
    fn weights<'a>(&'a self, cell: usize, at: [f64; 3], deviation: f64) -> impl Iterator<Item = (usize, f64)> + 'a {
        self.near[cell].iter().map(move |&other| {
            let d: [f64; 3] = std::array::from_fn(|k| self.centre[other as usize][k] - at[k]);
            let squared = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / (deviation * deviation);
            (other as usize, (-0.5 * squared).exp() + 1e-9)
        })
    }
}

/// Fits weights for each point, shared with its surroundings of the same material. `equations` returns those of a point;
/// `material` may be empty where there is but one.
pub(crate) fn share_weights<const C: usize>(
    points: &[[f64; 3]],
    material: &[u8],
    scale: SharingScale,
    equations: impl Fn(usize) -> LobeEquations<C> + Sync + Send,
) -> Vec<[[f32; LOBES]; C]> {
    let cells = Cells::new(points, material, scale.cell);
    let own = parallel::map(cells.members.len(), |k| {
        let mut sum = LobeEquations::default();
        cells.members[k].iter().for_each(|&point| sum.merge(&equations(point as usize), 1.0));
        sum
    });
    let mut all = LobeEquations::default();
    own.iter().for_each(|equations| all.merge(equations, 1.0));
    let usual = all.solve(&[[0.0; LOBES]; C], &[0.0; LOBES], SWEEPS[1]);
    let pull = std::array::from_fn(|k| PULL * all.square[k][k] / own.len().max(1) as f64);
    let solved = parallel::map(own.len(), |k| {
        let mut sum = LobeEquations::default();
        cells.weights(k, cells.centre[k], scale.smoothing).for_each(|(other, weight)| sum.merge(&own[other], weight));
        sum.solve(&usual, &pull, SWEEPS[0])
    });
    parallel::map(points.len(), |point| {
        let (mut sum, mut total) = ([[0.0; LOBES]; C], 0.0);
        for (other, weight) in cells.weights(cells.cell[point] as usize, points[point], 0.6 * scale.cell) {
            total += weight;
            for c in 0..C {
                (0..LOBES).for_each(|k| sum[c][k] += weight * solved[other][c][k]);
            }
        }
        sum.map(|colour| colour.map(|x| (x / total) as f32))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflectance::lobes::{LobeCosines, lobe_values};

    #[test]
    fn materials_keep_to_themselves() {
        let points: Vec<[f64; 3]> = (0..400).map(|k| [0.01 * (k % 20) as f64, 0.01 * (k / 20) as f64, 0.0]).collect();
        let material: Vec<u8> = points.iter().map(|p| (p[0] > 0.1) as u8).collect();
        let truth = |material: u8| if material == 0 { [0.0, 0.2, 0.0, 0.0, 0.1] } else { [0.0, 0.0, 1.0, 0.0, 0.0] };
        // Each point shows one angle only.
        let equations = |k: usize| {
            let half = 1.0 - 0.002 * (k * 7 % 40) as f64;
            let values = lobe_values(&LobeCosines { light: 0.9, view: 0.8, half });
            let seen: f64 = (0..LOBES).map(|l| values[l] * truth(material[k])[l]).sum();
            let mut sum = LobeEquations::<1>::default();
            sum.add(&values, [seen], 1.0 / (seen + 0.05));
            sum
        };
        let found = share_weights(&points, &material, SharingScale { cell: 0.05, smoothing: 0.05 }, equations);
        for (found, &material) in found.iter().zip(&material) {
            for half in [0.99, 0.96, 0.93] {
                let values = lobe_values(&LobeCosines { light: 0.9, view: 0.8, half });
                let shown = |weight: &dyn Fn(usize) -> f64| (0..LOBES).map(|k| weight(k) * values[k]).sum::<f64>();
                let (seen, expected) = (shown(&|k| found[0][k] as f64), shown(&|k| truth(material)[k]));
                assert!((seen / expected - 1.0).abs() < 0.25, "{material} {half} {seen} {expected}");
            }
        }
    }
}
