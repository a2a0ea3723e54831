//! Kinds of highlight on an object: what the lobes of cells have in common, whose own highlights were not all seen.
//!
//! Lloyd's algorithm (1982) with the error of the cells' equations as distance: a cell belongs to the kind whose weights explain its sightings
//! best. Kinds are added one by one, each starting from the cell that has most to gain by one of its own.

use super::LOBES;
use super::equations::{LobeEquations, Weights};
use crate::parallel;

/// Kinds, at most.
const KINDS: usize = 8;
/// Rounds of assignment after a kind was added.
const ROUNDS: usize = 8;
/// Passes of the minimiser over the lobes of a kind, and of a cell.
const SWEEPS: [usize; 2] = [200, 60];

/// Kinds of highlight.
pub(super) struct HighlightKinds<const C: usize> {
    /// Weights of each.
    pub(super) weights: Vec<Weights<C>>,
    /// Which kind each cell is of.
    pub(super) of: Vec<usize>,
}

impl<const C: usize> HighlightKinds<C> {
    /// Finds the kinds of cells: `own` are their equations, `around` those together with their neighbours', and `pull` is the weight by
    /// which each lobe is drawn towards its kind's.
    pub(super) fn new(own: &[LobeEquations<C>], around: &[LobeEquations<C>], pull: &[f64; LOBES]) -> Self {
        let sum = |of: &mut dyn Iterator<Item = &LobeEquations<C>>| {
            let mut sum = LobeEquations::default();
            of.for_each(|equations| sum.merge(equations, 1.0));
            sum
        };
        let free = [0.0; LOBES];
        let all = sum(&mut own.iter()).solve(&[free; C], &free, SWEEPS[0]);
        let mut kinds = HighlightKinds { weights: vec![all], of: vec![0; own.len()] };
        while kinds.weights.len() < KINDS.min(own.len()) {
            let better = parallel::map(own.len(), |k| {
                let shared = &kinds.weights[kinds.of[k]];
                let alone = around[k].solve(shared, pull, SWEEPS[1]);
                (around[k].error(shared) - around[k].error(&alone), alone)
            });
            let Some((_, alone)) = better.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            kinds.weights.push(alone);
            for _ in 0..ROUNDS {
                kinds.of = parallel::map(own.len(), |k| kinds.nearest(&around[k]));
                for (number, weights) in kinds.weights.iter_mut().enumerate() {
                    let members = own.iter().zip(&kinds.of).filter(|(_, kind)| **kind == number);
                    let equations = sum(&mut members.map(|(equations, _)| equations));
                    *weights = equations.solve(weights, &free, SWEEPS[0]);
                }
            }
        }
        kinds
    }

    /// The kind that explains sightings best.
    fn nearest(&self, equations: &LobeEquations<C>) -> usize {
        let errors = self.weights.iter().map(|weights| equations.error(weights));
        errors.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(number, _)| number)
    }
}
