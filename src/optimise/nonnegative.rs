//! Nonnegative least squares of few unknowns, by coordinate descent on the normal equations.

/// Minimises `x^T A x / 2 - b^T x` over `x >= 0`, in `sweeps` passes from `x`. `a` is symmetric, its diagonal positive.
pub(crate) fn minimise_nonnegative<const N: usize>(a: &[[f64; N]; N], b: &[f64; N], x: &mut [f64; N], sweeps: usize) {
    for _ in 0..sweeps {
        for k in 0..N {
            let mut rest = b[k];
            for l in (0..N).filter(|&l| l != k) {
                rest -= a[k][l] * x[l];
            }
            x[k] = if rest > 0.0 && a[k][k] > 0.0 { rest / a[k][k] } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_be_negative_is_zero() {
        let a = [[2.0, 1.0], [1.0, 2.0]];
        let mut x = [0.0; 2];
        minimise_nonnegative(&a, &[4.0, 5.0], &mut x, 60);
        assert!((x[0] - 1.0).abs() < 1e-9 && (x[1] - 2.0).abs() < 1e-9, "{x:?}");
        minimise_nonnegative(&a, &[-1.0, 3.0], &mut x, 60);
        assert_eq!(x, [0.0, 1.5]);
    }
}
