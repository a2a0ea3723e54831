//! Arithmetic of the prediction of positions: only `+ - * /`, `sqrt`, `floor` and comparisons of IEEE doubles in the order
//! written here, so that every machine predicts the same.

use super::lattice::Lattice;

pub(super) type Vector = [f64; 3];

pub(super) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
pub(super) fn subtract(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
pub(super) fn scale(a: Vector, by: f64) -> Vector {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// The axis of the largest magnitude, the last one of equals.
pub(super) fn dominant_axis(a: Vector) -> usize {
    let mut axis = 2;
    for k in [1, 0] {
        if a[k].abs() > a[axis].abs() {
            axis = k;
        }
    }
    axis
}

/// Heights over `base` along the last of `axes`, where the two others are known: on the planes of the two normals, and where the
/// guess lies over the first plane. No farther than four edge lengths.
pub(super) fn heights(
    base: Vector,
    guess: Vector,
    position: Lattice,
    normals: [Vector; 2],
    [u, v, w]: [usize; 3],
    length: f64,
) -> [f64; 3] {
    let bound = 4.0 * length;
    let slope = |n: Vector, du: f64, dv: f64| -(n[u] * du + n[v] * dv) / n[w];
    let mut heights = [0.0; 3];
    let (du, dv) = (position[u] as f64 - base[u], position[v] as f64 - base[v]);
    for k in 0..2 {
        if normals[k][w] != 0.0 {
            heights[k] = slope(normals[k], du, dv).clamp(-bound, bound);
        }
    }
    if normals[0][w] != 0.0 {
        let over = guess[w] - base[w] - slope(normals[0], guess[u] - base[u], guess[v] - base[v]);
        heights[2] = over.clamp(-bound, bound);
    }
    heights
}

/// Samples after which what was learned loses half of its weight. Part of the format.
const MEMORY: u32 = 256;
/// Weight of the first weights, in samples of the mean square length. Part of the format.
const FIRST: f64 = 3.0;

/// Weights of three features, by least squares over the samples so far, held near the first weights.
#[derive(Debug, Clone)]
pub(super) struct Learned {
    squares: [[f64; 3]; 3],
    products: [f64; 3],
    first: [f64; 3],
    /// Sum of the squares of the samples' lengths, and how many they are.
    lengths: f64,
    samples: u32,
}

impl Learned {
    pub(super) fn new(first: [f64; 3]) -> Self {
        Learned { squares: [[0.0; 3]; 3], products: [0.0; 3], first, lengths: 0.0, samples: 0 }
    }

    /// Solves the normal equations by elimination; the lengths seen so far and `length` give the first weights' weight.
    pub(super) fn weights(&self, length: f64) -> [f64; 3] {
        let hold = FIRST * ((self.lengths + length * length) / (self.samples + 1) as f64);
        let (mut m, mut b) = (self.squares, self.products);
        for k in 0..3 {
            m[k][k] += hold;
            b[k] += hold * self.first[k];
        }
        for k in 0..3 {
            // Rounding can't get here unless all is zero.
            if m[k][k] <= 0.0 {
                return self.first;
            }
            for i in k + 1..3 {
                let factor = m[i][k] / m[k][k];
                for j in k..3 {
                    m[i][j] -= factor * m[k][j];
                }
                b[i] -= factor * b[k];
            }
        }
        let z = b[2] / m[2][2];
        let y = (b[1] - m[1][2] * z) / m[1][1];
        let x = (b[0] - m[0][1] * y - m[0][2] * z) / m[0][0];
        [x, y, z]
    }

    /// Takes in one value of the features and what they should have given.
    pub(super) fn learn(&mut self, features: [f64; 3], truth: f64) {
        for i in 0..3 {
            for j in 0..3 {
                self.squares[i][j] += features[i] * features[j];
            }
            self.products[i] += features[i] * truth;
        }
    }

    /// Ends a sample.
    pub(super) fn count(&mut self, length: f64) {
        self.lengths += length * length;
        self.samples += 1;
        if self.samples == MEMORY {
            self.samples /= 2;
            self.lengths *= 0.5;
            self.squares = self.squares.map(|row| row.map(|x| x * 0.5));
            self.products = self.products.map(|x| x * 0.5);
        }
    }
}
