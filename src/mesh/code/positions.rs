//! Positions: each vertex is predicted from the triangles around it that are already known. Specified in `spec/mesh.md`.

use super::connectivity::NONE;
use crate::entropy::{BitCoder, Number};

/// Lattice positions.
pub(super) type Lattice = [i32; 3];

/// Connectivity as the prediction needs it.
pub(super) struct Surface<'a> {
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) opposite: &'a [u32],
    /// For each vertex where its corners begin in `corners`.
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl<'a> Surface<'a> {
    pub(super) fn new(triangles: &'a [[u32; 3]], opposite: &'a [u32], vertices: usize) -> Self {
        let mut starts = vec![0u32; vertices + 1];
        for &vertex in triangles.as_flattened() {
            starts[vertex as usize + 1] += 1;
        }
        for k in 0..vertices {
            starts[k + 1] += starts[k];
        }
        let mut fill = starts.clone();
        let mut corners = vec![0; triangles.len() * 3];
        for (corner, &vertex) in triangles.as_flattened().iter().enumerate() {
            corners[fill[vertex as usize] as usize] = corner as u32;
            fill[vertex as usize] += 1;
        }
        Surface { triangles, opposite, starts, corners }
    }
    fn corners_of(&self, vertex: u32) -> &[u32] {
        &self.corners[self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize]
    }
    fn vertex(&self, corner: u32) -> u32 {
        self.triangles.as_flattened()[corner as usize]
    }
    /// The next corner of the same triangle.
    fn turn(corner: u32) -> u32 {
        if corner % 3 == 2 { corner - 2 } else { corner + 1 }
    }
}

/// The order in which vertices are coded: always one for which the most parallelograms are known.
pub(super) struct Order {
    known: Vec<bool>,
    known_corners: Vec<u8>,
    parallelograms: Vec<u8>,
    /// Vertices with one, two, three and more parallelograms. A vertex stays in the lower ones when it moves up.
    stacks: [Vec<u32>; 4],
    next: usize,
}

impl Order {
    fn new(surface: &Surface, vertices: usize) -> Self {
        Order {
            known: vec![false; vertices],
            known_corners: vec![0; surface.triangles.len()],
            parallelograms: vec![0; vertices],
            stacks: Default::default(),
            next: 0,
        }
    }
    fn pop(&mut self) -> u32 {
        for stack in self.stacks.iter_mut().rev() {
            while let Some(vertex) = stack.pop() {
                if !self.known[vertex as usize] {
                    return vertex;
                }
            }
        }
        while self.known[self.next] {
            self.next += 1;
        }
        self.next as u32
    }
    fn learn(&mut self, surface: &Surface, vertex: u32) {
        self.known[vertex as usize] = true;
        for &corner in surface.corners_of(vertex) {
            let triangle = corner / 3;
            self.known_corners[triangle as usize] += 1;
            if self.known_corners[triangle as usize] < 3 {
                continue;
            }
            for half_edge in 3 * triangle..3 * triangle + 3 {
                let other = surface.opposite[half_edge as usize];
                if other == NONE {
                    continue;
                }
                let apex = surface.vertex(Surface::turn(Surface::turn(other)));
                let count = &mut self.parallelograms[apex as usize];
                if !self.known[apex as usize] && (*count as usize) < self.stacks.len() {
                    *count += 1;
                    self.stacks[*count as usize - 1].push(apex);
                }
            }
        }
    }
}


/// Numbers of parallelograms, and of triangles around a vertex beyond them, that are told apart.
const PARALLELOGRAMS: usize = 4;
const MISSING: usize = 10;
/// Half octaves of expected magnitude.
const MAGNITUDES: usize = 30;
const FEATURES: usize = 3;

/// Weights that are learned by least squares as the vertices come.
#[derive(Clone)]
struct Weights {
    /// Sums of products of the features, and of each feature with the truth.
    squares: [[f64; FEATURES]; FEATURES],
    products: [f64; FEATURES],
    prior: [f64; FEATURES],
    /// Sums of residuals and of edge lengths.
    errors: [f64; 2],
    lengths: f64,
}

impl Weights {
    fn new(prior: [f64; FEATURES]) -> Self {
        Weights { squares: Default::default(), products: [0.0; FEATURES], prior, errors: [0.5, 0.25], lengths: 1.0 }
    }
    /// Solves the normal equations, held near the prior by `ridge`.
    fn solve(&self, ridge: f64) -> [f64; FEATURES] {
        let mut m = self.squares;
        let mut b = self.products;
        for k in 0..FEATURES {
            m[k][k] += ridge;
            b[k] += ridge * self.prior[k];
        }
        for k in 0..FEATURES {
            for i in k + 1..FEATURES {
                let factor = m[i][k] / m[k][k];
                for j in k..FEATURES {
                    m[i][j] -= factor * m[k][j];
                }
                b[i] -= factor * b[k];
            }
        }
        let mut x = [0.0; FEATURES];
        for k in (0..FEATURES).rev() {
            let mut rest = b[k];
            for j in k + 1..FEATURES {
                rest -= m[k][j] * x[j];
            }
            x[k] = rest / m[k][k];
        }
        x
    }
    fn learn(&mut self, features: &[[f64; 3]; FEATURES], truth: [f64; 3]) {
        for i in 0..FEATURES {
            for j in 0..FEATURES {
                for k in 0..3 {
                    self.squares[i][j] += features[i][k] * features[j][k];
                }
            }
            for k in 0..3 {
                self.products[i] += features[i][k] * truth[k];
            }
        }
    }
}

fn env(name: &str, default: f64) -> f64 { std::env::var(name).ok().and_then(|x| x.parse().ok()).unwrap_or(default) }

fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}
fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn scale(a: [f64; 3], by: f64) -> [f64; 3] {
    a.map(|x| x * by)
}
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Codes all positions; in decoding those given are ignored and replaced.
pub(super) fn code<C: BitCoder>(coder: &mut C, surface: &Surface, positions: &mut [Lattice], largest: i32) -> Result<(), ()> {
    let vertices = positions.len();
    let shrink = [0.05, 0.05, 0.24, 0.38, 0.5, 0.6, 0.68, 0.77, 0.8, 0.8];
    let mut weights: Vec<Weights> = (0..(PARALLELOGRAMS + 1) * MISSING).map(|c| Weights::new([shrink[c % MISSING]; 3])).collect();
    let mut slopes: Vec<Weights> = (0..(PARALLELOGRAMS + 1) * MISSING).map(|_| Weights::new([0.5, 0.5, 0.0])).collect();
    let mut numbers = vec![Number::default(); 3 * MAGNITUDES];
    let mut order = Order::new(surface, vertices);
    // Magnitude of what was coded at each vertex: along the surface, and off it.
    let mut magnitudes: Vec<[f64; 2]> = vec![[0.0; 2]; vertices];
    let mut normals: Vec<[f64; 3]> = vec![[0.0; 3]; vertices];
    let mut last: Lattice = [0; 3];
    let mut stats = [[0f64; 3]; 4];
    let mut counts = [0; 4];
    let (wn, wc, ridge_n, ridge_s) = (env("WN", 0.5), env("WC", 0.5), env("RN", 3.0), env("RS", 3.0));
    for _ in 0..vertices {
        let v = order.pop();
        let known = |u: u32| order.known[u as usize];
        let place = |u: u32| positions[u as usize].map(|x| x as f64);
        let mut count = 0;
        let (mut perpendicular, mut shear, mut middle) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        let (mut normal, mut wide) = ([0.0; 3], [0.0; 3]);
        let (mut neighbours, mut neighbour_count, mut length) = ([0.0; 3], 0.0, 0.0);
        let mut near = [0.0; 2];
        for &corner in surface.corners_of(v) {
            let edge = Surface::turn(corner);
            let (x, y) = (surface.vertex(edge), surface.vertex(Surface::turn(edge)));
            for u in [x, y] {
                if known(u) {
                    neighbours = add(neighbours, place(u));
                    wide = add(wide, normals[u as usize]);
                    neighbour_count += 1.0;
                    for k in 0..2 {
                        near[k] += magnitudes[u as usize][k];
                    }
                }
            }
            let other = surface.opposite[edge as usize];
            if other == NONE || !known(x) || !known(y) {
                continue;
            }
            let c = surface.vertex(Surface::turn(Surface::turn(other)));
            if !known(c) {
                continue;
            }
            let (px, py, pc) = (place(x), place(y), place(c));
            let along = subtract(py, px);
            let half = scale(add(px, py), 0.5);
            let across = subtract(half, pc);
            let square = dot(along, along);
            let part = if square > 0.0 { scale(along, dot(across, along) / square) } else { [0.0; 3] };
            shear = add(shear, part);
            perpendicular = add(perpendicular, subtract(across, part));
            middle = add(middle, half);
            normal = add(normal, cross(subtract(px, pc), subtract(py, pc)));
            length += square.sqrt();
            count += 1;
        }
        let missing = (surface.corners_of(v).len() - count).min(MISSING - 1);
        let class = count.min(PARALLELOGRAMS) * MISSING + missing;
        let base = if neighbour_count > 0.0 { scale(neighbours, 1.0 / neighbour_count) } else { last.map(|x| x as f64) };
        let mut features = [[0.0; 3]; FEATURES];
        let mut guess = base;
        if count > 0 {
            let share = 1.0 / count as f64;
            features = [scale(perpendicular, share), scale(shear, share), subtract(scale(middle, share), base)];
            length *= share;
            let solution = weights[class].solve(ridge_n * length * length);
            for (feature, weight) in features.iter().zip(solution) {
                guess = add(guess, scale(*feature, weight));
            }
        }
        let third = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())).unwrap_or(2);
        let axes = [(third + 1) % 3, (third + 2) % 3, third];
        let clamp = |x: f64| (x + 0.5).floor().clamp(0.0, largest as f64) as i32;
        let near = near.map(|sum| if neighbour_count > 0.0 { sum / neighbour_count } else { 0.0 });
        let expected: [f64; 2] = std::array::from_fn(|k| {
            let own = weights[class].errors[k] / weights[class].lengths * length;
            if count > 0 { wn * near[k] + wc * own } else { largest as f64 / 16.0 }
        });
        let mut position = positions[v as usize];
        let mut residuals = [0i32; 3];
        let mut planes = [[0.0; 3]; FEATURES];
        for (turn, &axis) in axes.iter().enumerate() {
            let mut wanted = guess[axis];
            let mut expect = expected[0];
            if turn == 1 {
                expect = 0.75 * expect + 0.25 * residuals[0].abs() as f64;
            }
            if turn == 2 {
                expect = expected[1];
                if count > 0 {
                    // Heights over the mean of the neighbours by the planes of both normals.
                    let (du, dv) = (position[axes[0]] as f64 - base[axes[0]], position[axes[1]] as f64 - base[axes[1]]);
                    for (plane, n) in planes.iter_mut().zip([normal, wide]) {
                        if n[axis] != 0.0 {
                            let height = -(n[axes[0]] * du + n[axes[1]] * dv) / n[axis];
                            let bound = 4.0 * length;
                            plane[0] = height.clamp(-bound, bound);
                        }
                    }
                    let (gu, gv) = (guess[axes[0]] - base[axes[0]], guess[axes[1]] - base[axes[1]]);
                    if normal[axis] != 0.0 {
                        planes[2][0] = guess[axis] - base[axis] + (normal[axes[0]] * gu + normal[axes[1]] * gv) / normal[axis];
                        planes[2][0] = planes[2][0].clamp(-4.0 * length, 4.0 * length);
                    }
                    let solution = slopes[class].solve(ridge_s * length * length);
                    wanted = base[axis] + planes[0][0] * solution[0] + planes[1][0] * solution[1] + planes[2][0] * solution[2];
                }
            }
            let predicted = clamp(wanted);
            let bucket = {
                let squared = (expect * expect * 4.0) as u64;
                (64 - squared.leading_zeros() as usize).min(MAGNITUDES - 1)
            };
            let residual = numbers[turn * MAGNITUDES + bucket].code_signed(coder, position[axis].wrapping_sub(predicted));
            let value = predicted as i64 + residual as i64;
            if !(0..=largest as i64).contains(&value) {
                return Err(());
            }
            position[axis] = value as i32;
            residuals[turn] = residual;
            stats[count.min(3)][turn] += residual.abs() as f64;
        }
        counts[count.min(3)] += 1;
        positions[v as usize] = position;
        last = position;
        magnitudes[v as usize] = [(residuals[0].abs() + residuals[1].abs()) as f64 * 0.5, residuals[2].abs() as f64];
        if count > 0 {
            let truth = subtract(position.map(|x| x as f64), base);
            let class = &mut weights[class];
            class.learn(&features, truth);
            class.errors[0] += magnitudes[v as usize][0];
            class.errors[1] += magnitudes[v as usize][1];
            class.lengths += length;
            let class = count.min(PARALLELOGRAMS) * MISSING + missing;
            slopes[class].learn(&planes, [truth[axes[2]], 0.0, 0.0]);
        }
        order.learn(surface, v);
        // Normals of the triangles that became known.
        for &corner in surface.corners_of(v) {
            let corners = surface.triangles[corner as usize / 3];
            if corners.iter().all(|&u| order.known[u as usize]) {
                let [a, b, c] = corners.map(|u| positions[u as usize].map(|x| x as f64));
                let n = cross(subtract(b, a), subtract(c, a));
                for u in corners {
                    normals[u as usize] = add(normals[u as usize], n);
                }
            }
        }
    }
    if !C::DECODES && std::env::var("MESH_STATS").is_ok() {
        for c in 0..4 { println!("  class {c}: n {} mean |r| {:?}", counts[c], stats[c].map(|x| (x * 10.0 / counts[c] as f64).round() / 10.0)); }
    }
    Ok(())
}
