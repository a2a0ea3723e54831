//! Levenberg-Marquardt least squares for a small, fixed number of parameters. Deterministic, bounded iterations.

/// Normal equations `J^T W J` and `J^T W r` of a sum of weighted squares, gathered one residual at a time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NormalEquations<const P: usize> {
    matrix: [[f64; P]; P],
    gradient: [f64; P],
    cost: f64,
}

impl<const P: usize> NormalEquations<P> {
    fn new() -> Self {
        NormalEquations { matrix: [[0.0; P]; P], gradient: [0.0; P], cost: 0.0 }
    }

    /// Adds one residual `r` (model minus measured), its derivatives by the parameters and its weight.
    #[inline]
    pub(crate) fn add(&mut self, residual: f64, derivatives: &[f64; P], weight: f64) {
        self.add_sparse(residual, std::array::from_fn(|i| i), derivatives, weight);
    }

    /// Adds a residual that depends on some parameters alone, whose indices ascend.
    #[inline]
    pub(crate) fn add_sparse<const S: usize>(
        &mut self,
        residual: f64,
        which: [usize; S],
        derivatives: &[f64; S],
        weight: f64,
    ) {
        self.cost += weight * residual * residual;
        for (i, &row) in which.iter().enumerate() {
            let scaled = weight * derivatives[i];
            self.gradient[row] += scaled * residual;
            for (j, &column) in which[..=i].iter().enumerate() {
                self.matrix[row][column] += scaled * derivatives[j];
            }
        }
    }

    /// Solves `(A + damping diag(A)) x = -g` by Cholesky; `None` where the matrix is not positive definite.
    fn step(&self, damping: f64) -> Option<[f64; P]> {
        let mut lower = self.matrix;
        for i in 0..P {
            lower[i][i] += damping * self.matrix[i][i].max(1e-30);
        }
        for i in 0..P {
            for j in 0..=i {
                let sum = (0..j).fold(lower[i][j], |sum, k| sum - lower[i][k] * lower[j][k]);
                if i == j {
                    if sum.is_nan() || sum <= 0.0 {
                        return None;
                    }
                    lower[i][i] = sum.sqrt();
                } else {
                    lower[i][j] = sum / lower[j][j];
                }
            }
        }
        let mut x = self.gradient.map(|g| -g);
        for i in 0..P {
            x[i] = (0..i).fold(x[i], |sum, k| sum - lower[i][k] * x[k]) / lower[i][i];
        }
        for i in (0..P).rev() {
            x[i] = (i + 1..P).fold(x[i], |sum, k| sum - lower[k][i] * x[k]) / lower[i][i];
        }
        Some(x)
    }
}

/// Result of [`minimise`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Minimum<const P: usize> {
    /// The parameters, within their bounds.
    pub parameters: [f64; P],
    /// The sum of weighted squares there.
    pub cost: f64,
    /// Evaluations of the residuals.
    pub evaluations: u32,
}

/// Minimises a sum of weighted squares from `start`, every parameter kept in its `bounds` (lowest, highest).
///
/// `residuals` adds every residual with its derivatives at the given parameters. At most `evaluations` calls.
pub(crate) fn minimise<const P: usize>(
    start: [f64; P],
    bounds: &[(f64, f64); P],
    evaluations: u32,
    mut residuals: impl FnMut(&[f64; P], &mut NormalEquations<P>),
) -> Minimum<P> {
    let bounded = |p: [f64; P]| -> [f64; P] { std::array::from_fn(|i| p[i].clamp(bounds[i].0, bounds[i].1)) };
    let mut evaluate = |p: &[f64; P]| {
        let mut equations = NormalEquations::new();
        residuals(p, &mut equations);
        equations
    };
    let mut best = bounded(start);
    let mut equations = evaluate(&best);
    let mut damping = 1e-3;
    let mut count = 1;
    while count < evaluations {
        let Some(step) = equations.step(damping) else {
            if damping > 1e12 {
                break;
            }
            damping *= 10.0;
            continue;
        };
        let trial = bounded(std::array::from_fn(|i| best[i] + step[i]));
        let moved = (0..P).any(|i| (trial[i] - best[i]).abs() > 1e-10 * (best[i].abs() + 1e-10));
        if !moved {
            break;
        }
        let next = evaluate(&trial);
        count += 1;
        if next.cost < equations.cost {
            let gain = equations.cost - next.cost;
            let settled = gain <= 1e-9 * equations.cost;
            (best, equations) = (trial, next);
            damping = (damping * 0.1).max(1e-9);
            if settled {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    Minimum { parameters: best, cost: equations.cost, evaluations: count }
}

#[cfg(test)]
mod tests {
    use crate::optimise::levenberg_marquardt::*;

    #[test]
    fn the_banana_valley_is_followed_to_its_end() {
        // Rosenbrock's function as two residuals: 10 (y - x^2) and 1 - x.
        let found = minimise([-1.2, 1.0], &[(-5.0, 5.0); 2], 200, |p, equations| {
            equations.add(10.0 * (p[1] - p[0] * p[0]), &[-20.0 * p[0], 10.0], 1.0);
            equations.add(1.0 - p[0], &[-1.0, 0.0], 1.0);
        });
        assert!((found.parameters[0] - 1.0).abs() < 1e-6 && (found.parameters[1] - 1.0).abs() < 1e-6, "{found:?}");
        assert!(found.evaluations < 60, "{found:?}");
    }

    #[test]
    fn bounds_hold() {
        let found = minimise([0.0], &[(-1.0, 2.0)], 50, |p, equations| equations.add(p[0] - 3.0, &[1.0], 1.0));
        assert_eq!(found.parameters, [2.0]);
    }
}
