//! Principal components of a few vectors, and small linear systems.

use crate::vector::dot_slices;

/// Mean, components (unit length, by falling variance) and the variances along them.
pub(super) struct PrincipalComponents {
    pub mean: Vec<f64>,
    pub components: Vec<Vec<f64>>,
    pub variances: Vec<f64>,
}

/// At most `most` components, from the eigenvectors of the vectors' products.
pub(super) fn components(vectors: &[Vec<f64>], most: usize) -> PrincipalComponents {
    let count = vectors.len();
    let size = vectors.first().map_or(0, Vec::len);
    let mean: Vec<f64> = (0..size).map(|k| vectors.iter().map(|v| v[k]).sum::<f64>() / count.max(1) as f64).collect();
    let rest: Vec<Vec<f64>> = vectors.iter().map(|v| v.iter().zip(&mean).map(|(v, m)| v - m).collect()).collect();
    let products = rest.iter().map(|a| rest.iter().map(|b| dot_slices(a, b)).collect()).collect();
    let (values, directions) = eigen(products);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let greatest = order.first().map_or(0.0, |&n| values[n]);
    let (mut components, mut variances) = (Vec::new(), Vec::new());
    for n in order.into_iter().take(most).filter(|&n| values[n] > 1e-9 * greatest) {
        let length = values[n].sqrt();
        let of = |k: usize| (0..count).map(|v| directions[v][n] * rest[v][k]).sum::<f64>() / length;
        components.push((0..size).map(of).collect());
        variances.push(values[n] / count as f64);
    }
    PrincipalComponents { mean, components, variances }
}

/// Eigenvalues and, as columns, eigenvectors of a symmetric matrix by Jacobi's rotations.
fn eigen(mut a: Vec<Vec<f64>>) -> (Vec<f64>, Vec<Vec<f64>>) {
    let count = a.len();
    let mut vectors: Vec<Vec<f64>> = (0..count).map(|i| (0..count).map(|j| (i == j) as u8 as f64).collect()).collect();
    for _ in 0..30 {
        let off: f64 = (0..count).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| a[i][j] * a[i][j]).sum();
        let whole: f64 = (0..count).map(|i| a[i][i] * a[i][i]).sum();
        if off <= 1e-24 * whole {
            break;
        }
        for p in 0..count {
            for q in p + 1..count {
                if a[p][q] == 0.0 {
                    continue;
                }
                let ratio = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = ratio.signum() / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for row in a.iter_mut() {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                for k in 0..count {
                    (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                }
                for row in vectors.iter_mut() {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
            }
        }
    }
    ((0..count).map(|i| a[i][i]).collect(), vectors)
}

/// Puts the Cholesky factor of a positive definite matrix in the place of its lower triangle.
fn factorise(a: &mut [Vec<f64>]) {
    for i in 0..a.len() {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
            a[i][j] = if i == j { sum.max(1e-300).sqrt() } else { sum / a[j][j] };
        }
    }
}

/// Solves a positive definite system, of which the lower triangle is given, for three right sides.
pub(super) fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let count = a.len();
    factorise(&mut a);
    for c in 0..3 {
        for i in 0..count {
            b[i][c] = (b[i][c] - (0..i).map(|k| a[i][k] * b[k][c]).sum::<f64>()) / a[i][i];
        }
        for i in (0..count).rev() {
            b[i][c] = (b[i][c] - (i + 1..count).map(|k| a[k][i] * b[k][c]).sum::<f64>()) / a[i][i];
        }
    }
    b
}

/// Inverts a positive definite matrix of which the lower triangle is given.
pub(super) fn inverse(mut a: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let count = a.len();
    factorise(&mut a);
    // The factor's inverse, in its place.
    for j in 0..count {
        a[j][j] = 1.0 / a[j][j];
        for i in j + 1..count {
            let sum: f64 = (j..i).map(|k| a[i][k] * a[k][j]).sum();
            a[i][j] = -sum / a[i][i];
        }
    }
    let of = |i: usize, j: usize| (i.max(j)..count).map(|k| a[k][i] * a[k][j]).sum::<f64>();
    (0..count).map(|i| (0..count).map(|j| of(i, j)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_directions_are_found() {
        let vectors: Vec<Vec<f64>> = (0..40)
            .map(|n| {
                let (a, b) = (((n * 7) % 40) as f64 - 19.5, ((n * 13) % 11) as f64 - 5.0);
                vec![1.0 + 0.6 * a, 2.0 + 0.8 * a, b, 0.0]
            })
            .collect();
        let found = components(&vectors, 3);
        assert_eq!(found.components.len(), 2);
        assert!((found.components[0][0].abs() - 0.6).abs() < 0.01 && (found.components[1][2].abs() - 1.0).abs() < 0.01);
        let x = solve(vec![vec![4.0, 0.0], vec![2.0, 3.0]], vec![[8.0, 4.0, 0.0], [7.0, 2.0, 0.0]]);
        let inverse = inverse(vec![vec![4.0, 0.0, 0.0], vec![2.0, 3.0, 0.0], vec![1.0, 1.0, 5.0]]);
        let matrix = [[4.0, 2.0, 1.0], [2.0, 3.0, 1.0], [1.0, 1.0, 5.0]];
        for (i, row) in matrix.iter().enumerate() {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| row[k] * inverse[k][j]).sum();
                assert!((product - f64::from(u8::from(i == j))).abs() < 1e-12, "{inverse:?}");
            }
        }
        assert!((x[0][0] - 1.25).abs() < 1e-12 && (x[1][0] - 1.5).abs() < 1e-12 && x[0][2] == 0.0);
    }
}
