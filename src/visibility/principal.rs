//! Principal components of many functions on the sphere, by subspace iteration on their covariance.

use nalgebra::{DMatrix, DMatrixView, SymmetricEigen};

/// Rows whose products are summed at a time; the result does not depend on threads because blocks are summed in order.
const BLOCK: usize = 512;
/// Vectors iterated beyond those wanted, and iterations.
const EXTRA: usize = 12;
const ITERATIONS: usize = 8;
/// Bound on the iterations of the eigenvalues of the small matrix: about two are taken for each value.
const MAX_EIGEN_ITERATIONS: usize = 10_000;

/// Mean and principal components of `rows.len() / columns` functions of `columns` values, `count` components at most (fewer where
/// the functions span fewer dimensions; the others are 0). Components are orthonormal, the one of largest variance first.
pub(crate) fn components(rows: &[f32], columns: usize, count: usize) -> (Vec<f32>, Vec<Vec<f32>>) {
    let samples = rows.len() / columns;
    let mut sums = vec![0.0f64; columns];
    for row in rows.chunks_exact(columns) {
        sums.iter_mut().zip(row).for_each(|(sum, &x)| *sum += x as f64);
    }
    let mean: Vec<f32> = sums.iter().map(|sum| (sum / samples.max(1) as f64) as f32).collect();
    let covariance = covariance(rows, &mean);
    let components = leading(&covariance, count, samples);
    (mean, components)
}

/// Returns the eigenvectors of the largest eigenvalues.
fn leading(covariance: &DMatrix<f32>, count: usize, samples: usize) -> Vec<Vec<f32>> {
    let columns = covariance.ncols();
    let width = (count + EXTRA).min(columns);
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut vectors = DMatrix::from_fn(columns, width, |_, _| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    });
    for _ in 0..ITERATIONS {
        vectors = (covariance * &vectors).qr().q();
    }
    // Rayleigh and Ritz: the principal directions within the subspace.
    let small = vectors.transpose() * (covariance * &vectors);
    let mut result = vec![vec![0.0; columns]; count];
    let Some(eigen) = SymmetricEigen::try_new(small, f32::EPSILON, MAX_EIGEN_ITERATIONS) else { return result };
    let rotated = vectors * &eigen.eigenvectors;
    let values = &eigen.eigenvalues;
    let mut order: Vec<usize> = (0..width).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    for (component, &column) in result.iter_mut().zip(&order).take(samples) {
        if values[column] > 1e-7 * values[order[0]] && values[column] > 0.0 {
            component.iter_mut().zip(&rotated.column(column)).for_each(|(x, &value)| *x = value);
            // The sign is free: the largest value is positive.
            let largest = component.iter().fold(0.0f32, |a, &b| if b.abs() > a.abs() { b } else { a });
            component.iter_mut().for_each(|x| *x *= largest.signum());
        }
    }
    result
}

fn covariance(rows: &[f32], mean: &[f32]) -> DMatrix<f32> {
    let columns = mean.len();
    let blocks: Vec<&[f32]> = rows.chunks(BLOCK * columns).collect();
    let products = crate::parallel::map(blocks.len(), |k| {
        let block = blocks[k];
        let centred: Vec<f32> = block.iter().enumerate().map(|(i, x)| x - mean[i % columns]).collect();
        let matrix = DMatrix::from_vec(columns, block.len() / columns, centred);
        &matrix * matrix.transpose()
    });
    let mut sum = DMatrix::zeros(columns, columns);
    products.iter().for_each(|product| sum += product);
    sum.fill_upper_triangle_with_lower_triangle();
    sum
}

/// Returns the rows of `left` (of `columns` values) times a matrix of `columns` rows, row by row. The matrix is given transposed.
pub(crate) fn project(left: &[f32], columns: usize, transposed: &DMatrix<f32>) -> Vec<f32> {
    let rows = DMatrixView::from_slice(left, columns, left.len() / columns);
    (transposed * rows).as_slice().to_vec()
}

/// Returns the matrix that gives the least-squares weights of a function from its values: `(bases^T bases)^-1 bases^T`, one row a
/// base. Bases that are 0 have weights of 0.
pub(crate) fn least_squares(bases: &[Vec<f32>]) -> DMatrix<f32> {
    let columns = bases.first().map_or(0, Vec::len);
    let count = bases.len();
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| *x as f64 * *y as f64).sum::<f64>();
    let gram = DMatrix::from_fn(count, count, |i, j| {
        let product = dot(&bases[i], &bases[j]);
        if i == j && product <= 0.0 { 1.0 } else { product }
    });
    let matrix = DMatrix::from_fn(count, columns, |k, i| bases[k][i] as f64);
    match gram.lu().solve(&matrix) {
        Some(solved) => solved.map(|x| x as f32),
        None => DMatrix::zeros(count, columns),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_space_of_three_dimensions_is_found() {
        let columns = 40;
        let base = |k: usize| (0..columns).map(move |i| ((i * (k + 1)) as f32 * 0.3).sin());
        let bases: Vec<Vec<f32>> = (0..3).map(|k| base(k).collect()).collect();
        let rows: Vec<f32> = (0..700)
            .flat_map(|n| {
                let weight = move |k: usize| ((n * (2 * k + 3)) as f32 * 0.71).cos() * [5.0, 2.0, 0.5][k];
                let bases = &bases;
                (0..columns).map(move |i| 1.0 + (0..3).map(|k| weight(k) * bases[k][i]).sum::<f32>())
            })
            .collect();
        let (mean, found) = components(&rows, columns, 5);
        assert!(found[3].iter().all(|&x| x.abs() < 1e-2 || found[3].iter().map(|x| x * x).sum::<f32>() < 1.01));
        let weights = project(
            &rows.iter().enumerate().map(|(i, x)| x - mean[i % columns]).collect::<Vec<_>>(),
            columns,
            &least_squares(&found[..3]),
        );
        for (n, row) in rows.chunks_exact(columns).enumerate() {
            for i in 0..columns {
                let value = mean[i] + (0..3).map(|k| weights[3 * n + k] * found[k][i]).sum::<f32>();
                assert!((value - row[i]).abs() < 1e-3, "{n} {i}: {value} {}", row[i]);
            }
        }
    }
}
