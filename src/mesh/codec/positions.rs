//! Positions: each vertex is predicted from the triangles around it that are already known. Specified in `spec/mesh.md`.

use super::connectivity::NONE;
use super::lattice::Lattice;
use super::prediction;
use super::prediction::{Learned, Vector, add, scale, subtract};
use crate::entropy::{BitCoder, BitModel, NumberModel, code_raw};
use crate::vector::{cross, dot};

/// Connectivity as the prediction needs it.
pub(super) struct CornerTable<'a> {
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) opposite: &'a [u32],
    /// For each vertex where its corners begin in `corners`.
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl<'a> CornerTable<'a> {
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
        CornerTable { triangles, opposite, starts, corners }
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
    fn new(surface: &CornerTable, vertices: usize) -> Self {
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
    fn learn(&mut self, surface: &CornerTable, vertex: u32) {
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
                let apex = surface.vertex(CornerTable::turn(CornerTable::turn(other)));
                let count = &mut self.parallelograms[apex as usize];
                if !self.known[apex as usize] && (*count as usize) < self.stacks.len() {
                    *count += 1;
                    self.stacks[*count as usize - 1].push(apex);
                }
            }
        }
    }
}

/// Classes of vertices: parallelograms (0 to 4) and triangles around the vertex beyond them (0 to 9). Part of the format.
const PARALLELOGRAMS: usize = 4;
const MISSING: usize = 9;
/// Weights that the prediction along the surface starts with, by missing triangles. Part of the format.
const FIRST_WEIGHTS: [f64; MISSING + 1] = [0.05, 0.05, 0.24, 0.38, 0.5, 0.6, 0.68, 0.77, 0.8, 0.8];
/// Weights that the prediction of heights starts with. Part of the format.
const FIRST_SLOPES: [f64; 3] = [0.5, 0.5, 0.0];
/// Kinds of residuals: along the surface, and off it.
const ALONG: usize = 0;
const OFF: usize = 1;

/// Prediction features of a vertex from its known neighbours.
struct VertexNeighbourhood {
    class: usize,
    parallelograms: usize,
    /// Mean of the known neighbours, weighted by the known triangle corners beside each.
    base: Vector,
    /// Contributions of parallelograms: across their edges, along them, and their edges' middles.
    features: [Vector; 3],
    /// Mean length of these edges.
    length: f64,
    /// Sum of the normals of the parallelograms' known triangles, and of all known triangles at the neighbours.
    normals: [Vector; 2],
    /// Mean magnitudes of the neighbours' residuals.
    near: [f64; 2],
}

/// Codes residuals of one kind, scaled by what is expected of them.
struct Residuals {
    high: [NumberModel; 6],
    sign: BitModel,
}

impl Residuals {
    fn code<C: BitCoder>(&mut self, coder: &mut C, expected: f64, residual: i32) -> i64 {
        let halves = 64 - ((4.0 * (expected * expected)) as u64).leading_zeros();
        let shift = (halves.saturating_sub(2) / 2).saturating_sub(1);
        let size = residual.unsigned_abs();
        let high = self.high[(halves - 2 * shift) as usize].code(coder, size >> shift);
        let low = code_raw(coder, shift, size);
        let size = (high as i64) << shift | low as i64;
        if size != 0 && self.sign.code(coder, residual < 0) { -size } else { size }
    }
}

/// State of the coding of positions.
struct Positions<'a> {
    surface: &'a CornerTable<'a>,
    known: Vec<bool>,
    /// Magnitudes of the residuals coded at each vertex.
    magnitudes: Vec<[f64; 2]>,
    /// Sums of the normals of the known triangles at each vertex.
    normals: Vec<Vector>,
    along: Vec<Learned>,
    off: Vec<Learned>,
    /// Sums of magnitudes and of edge lengths, for each class.
    scales: Vec<([f64; 2], f64)>,
    last: Lattice,
}

fn vector(position: Lattice) -> Vector {
    position.map(|x| x as f64)
}

/// Codes all positions; in decoding those given are ignored and replaced. An error if a decoded one is outside the lattice.
pub(super) fn code<C: BitCoder>(
    coder: &mut C,
    surface: &CornerTable,
    positions: &mut [Lattice],
    largest: i32,
) -> Result<(), ()> {
    let vertices = positions.len();
    let classes = (PARALLELOGRAMS + 1) * (MISSING + 1);
    let mut state = Positions {
        surface,
        known: vec![false; vertices],
        magnitudes: vec![[0.0; 2]; vertices],
        normals: vec![[0.0; 3]; vertices],
        along: (0..classes).map(|class| Learned::new([FIRST_WEIGHTS[class % (MISSING + 1)]; 3])).collect(),
        off: vec![Learned::new(FIRST_SLOPES); classes],
        scales: vec![([0.5, 0.25], 1.0); classes],
        last: [0; 3],
    };
    let mut residuals: [Residuals; 2] =
        std::array::from_fn(|_| Residuals { high: Default::default(), sign: BitModel::default() });
    let mut order = Order::new(surface, vertices);
    for _ in 0..vertices {
        let vertex = order.pop();
        let position = state.vertex(coder, &mut residuals, positions, vertex, largest)?;
        positions[vertex as usize] = position;
        order.learn(surface, vertex);
        state.finish(positions, vertex);
    }
    Ok(())
}

impl Positions<'_> {
    fn look_around(&self, positions: &[Lattice], vertex: u32) -> VertexNeighbourhood {
        let surface = self.surface;
        let known = |u: u32| self.known[u as usize];
        let place = |u: u32| vector(positions[u as usize]);
        let [mut across_sum, mut along_sum, mut middle_sum, mut neighbours] = [[0.0; 3]; 4];
        let mut normals = [[0.0; 3]; 2];
        let (mut count, mut neighbour_count, mut length, mut near) = (0, 0.0, 0.0, [0.0; 2]);
        for &corner in surface.corners_of(vertex) {
            let edge = CornerTable::turn(corner);
            let (x, y) = (surface.vertex(edge), surface.vertex(CornerTable::turn(edge)));
            for u in [x, y] {
                if known(u) {
                    neighbours = add(neighbours, place(u));
                    normals[1] = add(normals[1], self.normals[u as usize]);
                    neighbour_count += 1.0;
                    for k in 0..2 {
                        near[k] += self.magnitudes[u as usize][k];
                    }
                }
            }
            let other = surface.opposite[edge as usize];
            if other == NONE || !known(x) || !known(y) {
                continue;
            }
            let c = surface.vertex(CornerTable::turn(CornerTable::turn(other)));
            if !known(c) {
                continue;
            }
            let (x, y, c) = (place(x), place(y), place(c));
            let edge = subtract(y, x);
            let middle = scale(add(x, y), 0.5);
            let reach = subtract(middle, c);
            let square = dot(edge, edge);
            let along = if square > 0.0 { scale(edge, dot(reach, edge) / square) } else { [0.0; 3] };
            across_sum = add(across_sum, subtract(reach, along));
            along_sum = add(along_sum, along);
            middle_sum = add(middle_sum, middle);
            normals[0] = add(normals[0], cross(subtract(x, c), subtract(y, c)));
            length += square.sqrt();
            count += 1;
        }
        let missing = (surface.corners_of(vertex).len() - count).min(MISSING);
        let class = count.min(PARALLELOGRAMS) * (MISSING + 1) + missing;
        let (mut base, mut features) = (vector(self.last), [[0.0; 3]; 3]);
        if neighbour_count > 0.0 {
            base = scale(neighbours, 1.0 / neighbour_count);
            near = near.map(|sum| sum / neighbour_count);
        }
        if count > 0 {
            let share = 1.0 / count as f64;
            features = [scale(across_sum, share), scale(along_sum, share), subtract(scale(middle_sum, share), base)];
            length *= share;
        }
        VertexNeighbourhood { class, parallelograms: count, base, features, length, normals, near }
    }

    /// Codes one position.
    fn vertex<C: BitCoder>(
        &mut self,
        coder: &mut C,
        residuals: &mut [Residuals; 2],
        positions: &[Lattice],
        vertex: u32,
        largest: i32,
    ) -> Result<Lattice, ()> {
        let around = self.look_around(positions, vertex);
        let VertexNeighbourhood { class, parallelograms, base, features, length, normals, near } = around;
        let mut guess = base;
        if parallelograms > 0 {
            let weights = self.along[class].weights(length);
            for (feature, weight) in features.into_iter().zip(weights) {
                guess = add(guess, scale(feature, weight));
            }
        }
        // The axis that the surface faces most comes last: its height follows from the two others.
        let facing = prediction::dominant_axis(normals[0]);
        let axes = [(facing + 1) % 3, (facing + 2) % 3, facing];
        let expected: [f64; 2] = std::array::from_fn(|kind| {
            let (errors, lengths) = self.scales[class];
            let own = errors[kind] / lengths * length;
            let expected = if parallelograms > 0 { 0.35 * near[kind] + 0.65 * own } else { largest as f64 / 16.0 };
            expected.min(16_777_216.0)
        });
        let mut position = positions[vertex as usize];
        let mut coded = [0.0; 3];
        let mut heights = [0.0; 3];
        for (turn, &axis) in axes.iter().enumerate() {
            let (mut wanted, mut expect, mut kind) = (guess[axis], expected[ALONG], ALONG);
            if turn == 1 {
                expect = 0.75 * expect + 0.25 * coded[0];
            }
            if turn == 2 {
                (kind, expect) = (OFF, expected[OFF]);
                if parallelograms > 0 {
                    heights = prediction::heights(base, guess, position, normals, axes, length);
                    let weights = self.off[class].weights(length);
                    wanted = base[axis] + heights[0] * weights[0] + heights[1] * weights[1] + heights[2] * weights[2];
                }
            }
            let predicted = (wanted + 0.5).floor().clamp(0.0, largest as f64) as i32;
            let residual = residuals[kind].code(coder, expect, position[axis].wrapping_sub(predicted));
            let value = predicted as i64 + residual;
            if !(0..=largest as i64).contains(&value) {
                return Err(());
            }
            position[axis] = value as i32;
            coded[turn] = residual.abs() as f64;
        }
        let magnitudes = [(coded[0] + coded[1]) * 0.5, coded[2]];
        self.magnitudes[vertex as usize] = magnitudes;
        if parallelograms > 0 {
            let truth = subtract(vector(position), base);
            for k in 0..3 {
                self.along[class].learn([features[0][k], features[1][k], features[2][k]], truth[k]);
            }
            self.along[class].count(length);
            self.off[class].learn(heights, truth[axes[2]]);
            self.off[class].count(length);
            let (errors, lengths) = &mut self.scales[class];
            errors[ALONG] += magnitudes[ALONG];
            errors[OFF] += magnitudes[OFF];
            *lengths += length;
        }
        Ok(position)
    }

    /// Makes a coded vertex known, with the triangles that it completes.
    fn finish(&mut self, positions: &[Lattice], vertex: u32) {
        self.known[vertex as usize] = true;
        self.last = positions[vertex as usize];
        for &corner in self.surface.corners_of(vertex) {
            let corners = self.surface.triangles[corner as usize / 3];
            if corners.iter().all(|&u| self.known[u as usize]) {
                let [a, b, c] = corners.map(|u| vector(positions[u as usize]));
                let normal = cross(subtract(b, a), subtract(c, a));
                for u in corners {
                    self.normals[u as usize] = add(self.normals[u as usize], normal);
                }
            }
        }
    }
}
