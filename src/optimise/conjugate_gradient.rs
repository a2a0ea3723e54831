//! Conjugate gradients with Jacobi's preconditioner, for symmetric positive definite systems (Hestenes and Stiefel 1952).

use crate::parallel;

/// Numbers summed one after the other before the sums are: fixed, so that no result depends on the number of threads.
const RUN: usize = 4096;

/// Solves `A x = b` from `x = 0`, until the residual is `tolerance` times `b` or `iterations` are done. `apply` multiplies by `A`,
/// `diagonal` is that of `A`, positive.
pub(crate) fn solve(
    apply: impl Fn(&[f64]) -> Vec<f64>,
    diagonal: &[f64],
    b: &[f64],
    tolerance: f64,
    iterations: usize,
) -> Vec<f64> {
    let mut x = vec![0.0; b.len()];
    let mut residual = b.to_vec();
    let mut direction: Vec<f64> = residual.iter().zip(diagonal).map(|(r, d)| r / d).collect();
    let mut product = dot(&residual, &direction);
    let least = tolerance * tolerance * dot(b, b);
    for iteration in 0..iterations {
        let image = apply(&direction);
        let curvature = dot(&direction, &image);
        if curvature.is_nan() || curvature <= 0.0 {
            break;
        }
        let step = product / curvature;
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= step * i);
        if dot(&residual, &residual) <= least {
            tracing::debug!("conjugate gradients: {iteration} iterations");
            break;
        }
        let scaled: Vec<f64> = residual.iter().zip(diagonal).map(|(r, d)| r / d).collect();
        let next = dot(&residual, &scaled);
        let share = next / product;
        product = next;
        direction.iter_mut().zip(&scaled).for_each(|(d, s)| *d = s + share * *d);
    }
    x
}

/// Scalar product, summed in runs.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let run = |k: usize| {
        let range = k * RUN..((k + 1) * RUN).min(a.len());
        a[range.clone()].iter().zip(&b[range]).map(|(a, b)| a * b).sum::<f64>()
    };
    parallel::map(a.len().div_ceil(RUN), run).iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_of_springs_is_solved() {
        let n = 300;
        let apply = |x: &[f64]| {
            let at = |k: usize| x.get(k).copied().unwrap_or(0.0);
            (0..n).map(|k| 2.1 * x[k] - at(k.wrapping_sub(1)) - at(k + 1)).collect::<Vec<f64>>()
        };
        let wanted: Vec<f64> = (0..n).map(|k| (k as f64 * 0.37).sin()).collect();
        let found = solve(apply, &vec![2.1; n], &apply(&wanted), 1e-9, 400);
        assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
