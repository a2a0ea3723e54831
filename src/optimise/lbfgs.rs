//! Minimisation within bounds by a quasi-Newton method of limited memory (Byrd, Lu, Nocedal & Zhu 1995, with their Cauchy step
//! replaced by projection): the two-loop recursion on the variables that are off their bounds, then a line search along the
//! projected path.

use crate::vector::dot_slices;

/// Pairs of steps and gradient changes that are remembered.
const MEMORY: usize = 10;
/// Decrease that a step must reach, as a share of what the slope promises.
const SUFFICIENT: f64 = 1e-4;

/// Criterion that ends the minimisation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StopCriterion {
    /// Most evaluations of the function.
    pub evaluations: usize,
    /// Relative decrease of the value below which five steps in a row end the search.
    pub decrease: f64,
}

/// Minimises `function`, which gives the value and writes the gradient, starting from `x`, with `lower <= x <= upper`.
/// Returns the least value found and leaves its place in `x`.
pub(crate) fn minimise(
    x: &mut [f64],
    lower: &[f64],
    upper: &[f64],
    stop: StopCriterion,
    mut function: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> f64 {
    let n = x.len();
    let project = |x: &mut [f64]| (0..n).for_each(|k| x[k] = x[k].max(lower[k]).min(upper[k]));
    project(x);
    let mut gradient = vec![0.0; n];
    let mut value = function(x, &mut gradient);
    let mut left = stop.evaluations.saturating_sub(1);
    let mut memory: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::new();
    let (mut next, mut next_gradient) = (vec![0.0; n], vec![0.0; n]);
    let mut small_steps = 0;
    while left > 0 && small_steps < 5 {
        let held = |k: usize| (x[k] <= lower[k] && gradient[k] > 0.0) || (x[k] >= upper[k] && gradient[k] < 0.0);
        let mut direction: Vec<f64> = (0..n).map(|k| if held(k) { 0.0 } else { -gradient[k] }).collect();
        let steepest = direction.clone();
        if steepest.iter().all(|&d| d == 0.0) {
            break;
        }
        let mut factors = Vec::with_capacity(memory.len());
        for (step, change, product) in memory.iter().rev() {
            let factor = dot_slices(step, &direction) / product;
            (0..n).for_each(|k| direction[k] -= factor * change[k]);
            factors.push(factor);
        }
        match memory.last() {
            Some((_, change, product)) => {
                let scale = product / dot_slices(change, change);
                direction.iter_mut().for_each(|d| *d *= scale);
            }
            None => {
                let scale = 0.1 / dot_slices(&steepest, &steepest).sqrt();
                direction.iter_mut().for_each(|d| *d *= scale);
            }
        }
        for ((step, change, product), factor) in memory.iter().zip(factors.into_iter().rev()) {
            let back = dot_slices(change, &direction) / product;
            (0..n).for_each(|k| direction[k] += (factor - back) * step[k]);
        }
        (0..n).for_each(|k| direction[k] = if held(k) { 0.0 } else { direction[k] });
        if dot_slices(&direction, &gradient) >= 0.0 {
            direction = steepest;
            memory.clear();
        }
        // Along the projected path, halving the step until the value falls as it should.
        let mut length = 1.0;
        let improved = loop {
            if left == 0 {
                break None;
            }
            (0..n).for_each(|k| next[k] = x[k] + length * direction[k]);
            project(&mut next);
            let promised: f64 = (0..n).map(|k| gradient[k] * (next[k] - x[k])).sum();
            let found = function(&next, &mut next_gradient);
            left -= 1;
            if found.is_finite() && found <= value + SUFFICIENT * promised.min(0.0) {
                break Some(found);
            }
            length *= 0.4;
            if length < 1e-8 {
                break None;
            }
        };
        let Some(found) = improved else {
            // A bad memory may be why; without one the search is over.
            if memory.is_empty() || left == 0 {
                break;
            }
            memory.clear();
            continue;
        };
        let step: Vec<f64> = (0..n).map(|k| next[k] - x[k]).collect();
        let change: Vec<f64> = (0..n).map(|k| next_gradient[k] - gradient[k]).collect();
        let product = dot_slices(&step, &change);
        if product > 1e-12 * dot_slices(&change, &change).sqrt() * dot_slices(&step, &step).sqrt() {
            if memory.len() == MEMORY {
                memory.remove(0);
            }
            memory.push((step, change, product));
        }
        small_steps = if value - found < stop.decrease * found.abs().max(1e-300) { small_steps + 1 } else { 0 };
        x.copy_from_slice(&next);
        gradient.copy_from_slice(&next_gradient);
        value = found;
    }
    value
}

#[cfg(test)]
mod tests {
    use crate::optimise::lbfgs::*;

    #[test]
    fn valleys_and_bounds() {
        let rosenbrock = |x: &[f64], g: &mut [f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            (g[0], g[1]) = (-2.0 * a - 400.0 * x[0] * b, 200.0 * b);
            a * a + 100.0 * b * b
        };
        let stop = StopCriterion { evaluations: 200, decrease: 1e-14 };
        let mut x = [-1.2, 1.0];
        assert!(minimise(&mut x, &[-9.0; 2], &[9.0; 2], stop, rosenbrock) < 1e-10, "{x:?}");
        // With x0 <= 0.5 the least value is 0.25 at (0.5, 0.25).
        let mut x = [-1.2, 1.0];
        let value = minimise(&mut x, &[-9.0; 2], &[0.5, 9.0], stop, rosenbrock);
        assert!((value - 0.25).abs() < 1e-8 && (x[0] - 0.5).abs() < 1e-9 && (x[1] - 0.25).abs() < 1e-5, "{x:?}");
    }
}
