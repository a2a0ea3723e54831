//! Weights of lobes that neighbouring points share: no point's highlight was seen from all sides, that of its surroundings was.

use super::LOBES;
use super::equations::LobeEquations;
use super::kinds::HighlightKinds;
use crate::parallel;
use std::collections::BTreeMap;

/// Passes of the minimiser over the lobes of a cell.
const SWEEPS: usize = 60;
/// Pull towards a lobe's weight in the highlights of the same kind, over the mean of all cells' equations: where no highlight of that width
/// was seen, all that is left are tails, from which little follows for the peak.
const PULL: f64 = 1.0;

/// How far weights are shared, in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SharingScale {
    /// Edge of the cells whose points have one solution.
    pub cell: f64,
    /// Standard deviation of the distance within which a cell takes its neighbours' equations into account.
    pub smoothing: f64,
}

/// Cells of a grid in space.
struct Cells {
    /// Of each point.
    cell: Vec<u32>,
    members: Vec<Vec<u32>>,
    centre: Vec<[f64; 3]>,
    /// Those next to each cell, itself among them.
    near: Vec<Vec<u32>>,
}

impl Cells {
    fn new(points: &[[f64; 3]], edge: f64) -> Self {
        let mut numbers: BTreeMap<[i64; 3], u32> = BTreeMap::new();
        let mut cells = Cells { cell: Vec::new(), members: Vec::new(), centre: Vec::new(), near: Vec::new() };
        for (index, point) in points.iter().enumerate() {
            let key = point.map(|x| (x / edge).floor() as i64);
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
        for (&at, &number) in &numbers {
            let around = (0..27).map(|n| [at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1]);
            cells.near[number as usize] = around.filter_map(|at| numbers.get(&at).copied()).collect();
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

/// Fits weights for each point, shared with its surroundings and drawn towards those of highlights of the same kind all over the object.
/// `equations` returns those of a point.
pub(crate) fn share_weights<const C: usize>(
    points: &[[f64; 3]],
    scale: SharingScale,
    equations: impl Fn(usize) -> LobeEquations<C> + Sync + Send,
) -> Vec<[[f32; LOBES]; C]> {
    let cells = Cells::new(points, scale.cell);
    let own = parallel::map(cells.members.len(), |k| {
        let mut sum = LobeEquations::default();
        cells.members[k].iter().for_each(|&point| sum.merge(&equations(point as usize), 1.0));
        sum
    });
    let around = parallel::map(own.len(), |k| {
        let mut sum = LobeEquations::default();
        cells.weights(k, cells.centre[k], scale.smoothing).for_each(|(other, weight)| sum.merge(&own[other], weight));
        sum
    });
    let mean = |k: usize| own.iter().map(|own| own.square[k][k]).sum::<f64>() / own.len().max(1) as f64;
    let pull = std::array::from_fn(|k| PULL * mean(k));
    let kinds = HighlightKinds::new(&own, &around, &pull);
    let solved = parallel::map(own.len(), |k| around[k].solve(&kinds.weights[kinds.of[k]], &pull, SWEEPS));
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
    fn what_shows_no_peak_takes_that_of_its_kind() {
        let points: Vec<[f64; 3]> = (0..1600).map(|k| [0.01 * (k % 40) as f64, 0.01 * (k / 40) as f64, 0.0]).collect();
        let truth = |p: &[f64; 3]| if p[0] < 0.2 { [0.0, 0.04, 0.0, 0.0, 0.0] } else { [0.0, 0.0, 0.9, 0.0, 0.0] };
        // Above, peaks are seen; below, only how they end.
        let lit = |p: &[f64; 3]| p[1] > 0.2;
        let equations = |k: usize| {
            let half = if lit(&points[k]) { 1.0 } else { 0.975 } - 0.002 * (k * 7 % 20) as f64;
            let values = lobe_values(&LobeCosines { light: 0.9, view: 0.8, half });
            let seen: f64 = (0..LOBES).map(|l| values[l] * truth(&points[k])[l]).sum();
            let mut sum = LobeEquations::<1>::default();
            sum.add(&values, [seen + 1e-4 * (k % 5) as f64], 1.0 / (seen + 0.05));
            sum
        };
        let found = share_weights(&points, SharingScale { cell: 0.05, smoothing: 0.05 }, equations);
        let far_from_the_edge = |p: &&[f64; 3]| (p[0] - 0.2).abs() > 0.08 && (p[1] - 0.2).abs() > 0.08;
        // Least and most of what is found over what is right, of either highlight.
        let mut range = [[f64::INFINITY, 0.0]; 2];
        for (found, point) in found.iter().zip(&points).filter(|(_, point)| far_from_the_edge(point)) {
            let values = lobe_values(&LobeCosines { light: 0.9, view: 0.8, half: 0.9995 });
            let shown = |weight: &dyn Fn(usize) -> f64| (0..LOBES).map(|k| weight(k) * values[k]).sum::<f64>();
            let ratio = shown(&|k| found[0][k] as f64) / shown(&|k| truth(point)[k]);
            let [least, most] = &mut range[(point[0] > 0.2) as usize];
            (*least, *most) = (least.min(ratio), most.max(ratio));
        }
        let [[faint_least, faint_most], [bright_least, bright_most]] = range;
        assert!(bright_least > 0.85 && bright_most < 1.15, "{range:?}");
        // What is added to all sightings is a good part of how the faint one ends.
        assert!(faint_least > 0.85 && faint_most < 1.8, "{range:?}");
    }
}
