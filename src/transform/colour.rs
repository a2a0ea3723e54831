//! Orthonormal rotation of colours, chosen for a file.

/// Rows are the axes, strongest first.
pub(crate) type ColourRotation = [[f32; 3]; 3];

/// No rotation.
pub(crate) const IDENTITY: ColourRotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Colour to axes.
#[inline(always)]
pub(crate) fn forward(rotation: &ColourRotation, x: [f32; 3]) -> [f32; 3] {
    rotation.map(|axis| axis[0] * x[0] + axis[1] * x[1] + axis[2] * x[2])
}

/// Axes to colour: the transpose.
#[inline(always)]
pub(crate) fn inverse(rotation: &ColourRotation, y: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| rotation[0][c] * y[0] + rotation[1][c] * y[1] + rotation[2][c] * y[2])
}

/// The axes of the largest second moments: eigenvectors of `sum x x^T` by Jacobi rotations.
pub(crate) fn principal_axes(moments: [[f64; 3]; 3]) -> ColourRotation {
    let mut a = moments;
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0f64]];
    if !moments.iter().flatten().all(|x| x.is_finite()) {
        return IDENTITY;
    }
    for _ in 0..16 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q].abs() <= 1e-300 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            for k in 0..3 {
                let (x, y) = (a[k][p], a[k][q]);
                (a[k][p], a[k][q]) = (cosine * x - sine * y, sine * x + cosine * y);
            }
            for k in 0..3 {
                let (x, y) = (a[p][k], a[q][k]);
                (a[p][k], a[q][k]) = (cosine * x - sine * y, sine * x + cosine * y);
                let (x, y) = (axes[p][k], axes[q][k]);
                (axes[p][k], axes[q][k]) = (cosine * x - sine * y, sine * x + cosine * y);
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]));
    order.map(|i| {
        // The sign is free: mostly positive.
        let sign = if axes[i].iter().sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
        axes[i].map(|x| (sign * x) as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_main_axis_is_found_and_rotations_come_back() {
        let axis = [0.6f64, 0.64, 0.48];
        let moments = std::array::from_fn(|i| {
            std::array::from_fn(|j| 5.0 * axis[i] * axis[j] + if i == j { 0.1 + 0.1 * i as f64 } else { 0.0 })
        });
        let rotation = principal_axes(moments);
        assert!((0..3).all(|c| (rotation[0][c] as f64 - axis[c]).abs() < 0.03), "{rotation:?}");
        let x = [0.3, -2.0, 0.7];
        let back = inverse(&rotation, forward(&rotation, x));
        assert!((0..3).all(|c| (back[c] - x[c]).abs() < 1e-6), "{back:?}");
        assert_eq!(principal_axes([[0.0; 3]; 3]), IDENTITY);
    }
}
