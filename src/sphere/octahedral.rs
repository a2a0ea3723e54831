//! The sphere on a square: directions on the octahedron `|x| + |y| + |z| = 1`, unfolded (Engelhardt & Dachsbacher 2008).
//!
//! The upper half (`y >= 0`) is the diamond in the middle of the square, the lower half is folded out to its corners. Cell
//! `(column, row)` of an N x N grid stands for the direction of its centre, `u = (column + 0.5) 2 / N - 1` along x and
//! `v = (row + 0.5) 2 / N - 1` along z. Cells keep areas within a factor of 5.2.

/// Direction (unit) of a place of the square, both coordinates -1 to 1.
pub(crate) fn direction(u: f64, v: f64) -> [f64; 3] {
    let y = 1.0 - u.abs() - v.abs();
    let fold = (-y).max(0.0);
    let (x, z) = (u - fold.copysign(u), v - fold.copysign(v));
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// Place of a direction (of any length but 0) on the square, both coordinates -1 to 1.
#[inline]
pub(crate) fn square_position(direction: [f64; 3]) -> [f64; 2] {
    let [x, y, z] = direction;
    let sum = x.abs() + y.abs() + z.abs();
    let (u, v) = (x / sum, z / sum);
    if y >= 0.0 { [u, v] } else { [(1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v)] }
}

/// Four cells around a direction and their bilinear weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OctahedralTaps {
    /// Indices of cells, `row * size + column`.
    pub cells: [u32; 4],
    /// Weights, which sum to 1.
    pub weights: [f32; 4],
}

/// The four cells around a direction in a grid of `size * size` cells (`size` at least 1).
#[inline]
pub(crate) fn taps(direction: [f64; 3], size: usize) -> OctahedralTaps {
    let n = size as f64;
    let [u, v] = square_position(direction).map(|x| {
        let at = (x + 1.0) * 0.5 * n - 0.5;
        // A direction that is not a number falls on the first cell.
        if at >= -0.5 { at.min(n - 0.5) } else { -0.5 }
    });
    let (column, row) = (u.floor(), v.floor());
    let (a, b) = ((u - column) as f32, (v - row) as f32);
    let (column, row) = (column as isize, row as isize);
    let cell = |c: isize, r: isize| wrap(c, r, size) as u32;
    OctahedralTaps {
        cells: [cell(column, row), cell(column + 1, row), cell(column, row + 1), cell(column + 1, row + 1)],
        weights: [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b],
    }
}

/// Index of a cell that may lie one step beyond the square, where the sphere goes on at the mirrored place of the same edge.
#[inline]
pub(crate) fn wrap(column: isize, row: isize, size: usize) -> usize {
    let last = size as isize - 1;
    let (mut c, mut r) = (column, row);
    if !(0..=last).contains(&c) {
        (c, r) = (c.clamp(0, last), last - r);
    }
    if !(0..=last).contains(&r) {
        (c, r) = (last - c, r.clamp(0, last));
    }
    r as usize * size + c as usize
}

/// Directions of all cells, row by row.
pub fn directions(size: usize) -> Vec<[f64; 3]> {
    let at = |k: usize| (k as f64 + 0.5) * 2.0 / size as f64 - 1.0;
    (0..size * size).map(|k| direction(at(k % size), at(k / size))).collect()
}

/// Solid angles of all cells, row by row; they sum to 4 pi.
pub fn solid_angles(size: usize) -> Vec<f64> {
    // Per area of the square: a face of the octahedron has the density `1 / |p|^3`, p on the face, times a constant.
    const PARTS: usize = 4;
    let density = |u: f64, v: f64| {
        let y = 1.0 - u.abs() - v.abs();
        let fold = (-y).max(0.0);
        let (x, z) = (u.abs() - fold, v.abs() - fold);
        let squared = x * x + y * y + z * z;
        1.0 / (squared * squared.sqrt())
    };
    let fine = 2.0 / (size * PARTS) as f64;
    let cell = |column: usize, row: usize| {
        let at = |i: usize| (i as f64 + 0.5) * fine - 1.0;
        (0..PARTS * PARTS).map(|p| density(at(column * PARTS + p % PARTS), at(row * PARTS + p / PARTS))).sum::<f64>()
    };
    // An eighth of the square has all that there are.
    let mut angles = vec![0.0; size * size];
    for row in 0..size.div_ceil(2) {
        for column in 0..=row {
            let angle = cell(column, row);
            for (c, r) in [(column, row), (row, column)] {
                let (right, below) = (size - 1 - c, size - 1 - r);
                for (c, r) in [(c, r), (right, r), (c, below), (right, below)] {
                    angles[r * size + c] = angle;
                }
            }
        }
    }
    let scale = 4.0 * std::f64::consts::PI / angles.iter().sum::<f64>();
    angles.iter_mut().for_each(|angle| *angle *= scale);
    angles
}

#[cfg(test)]
mod tests {
    use crate::sphere::octahedral::*;

    #[test]
    fn places_and_directions_are_inverse_and_edges_meet() {
        for size in [1, 7, 16] {
            for (k, d) in directions(size).into_iter().enumerate() {
                let back = taps(d, size);
                let largest = (0..4).max_by(|&a, &b| back.weights[a].total_cmp(&back.weights[b])).unwrap();
                assert_eq!((back.cells[largest] as usize, back.weights[largest] > 0.999), (k, true), "{size} {d:?}");
            }
            let total: f64 = solid_angles(size).iter().sum();
            assert!((total - 4.0 * std::f64::consts::PI).abs() < 1e-9);
        }
        // Across an edge the neighbour is near.
        let size = 32;
        let all = directions(size);
        for k in 0..size as isize {
            for (a, b) in [((0, k), (-1, k)), ((31, k), (32, k)), ((k, 0), (k, -1)), ((k, 31), (k, 32))] {
                let (p, q) = (all[wrap(a.0, a.1, size)], all[wrap(b.0, b.1, size)]);
                let cosine: f64 = (0..3).map(|i| p[i] * q[i]).sum();
                assert!(cosine > 0.98, "{a:?} {b:?} {cosine}");
            }
        }
        // The extremes of the range of cells' areas are those that the module's text claims.
        let angles = solid_angles(64);
        let (low, high) = angles.iter().fold((f64::MAX, 0.0f64), |(l, h), &a| (l.min(a), h.max(a)));
        assert!(high / low < 5.2, "{}", high / low);
        assert!(taps([f64::NAN; 3], 4).cells.iter().all(|&c| c < 16));
    }
}
