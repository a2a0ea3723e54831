//! Positions: each vertex is predicted from the triangles around it that are already known. Specified in `spec/mesh.md`.

use super::connectivity::NONE;
use crate::entropy::{BitCoder, BitModel, Number};

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

pub(super) struct Models {
    numbers: Vec<Number>,
    sign: [BitModel; 3],
}

const BUCKETS: usize = 12;

impl Models {
    pub(super) fn new() -> Self {
        Models { numbers: vec![Number::default(); 3 * 3 * BUCKETS], sign: Default::default() }
    }
}

/// Codes all positions; in decoding those given are ignored and replaced.
pub(super) fn code<C: BitCoder>(coder: &mut C, surface: &Surface, positions: &mut [Lattice], largest: i32) -> Result<(), ()> {
    let vertices = positions.len();
    let mut models = Models::new();
    let mut order = Order::new(surface, vertices);
    let mut magnitudes: Vec<[u32; 3]> = vec![[0; 3]; vertices];
    let mut last: Lattice = [0; 3];
    let mut stats = [[0f64; 3]; 4];
    let mut hist = std::collections::HashMap::<(usize, usize, i32), u32>::new();
    for _ in 0..vertices {
        let v = order.pop();
        let mut sum = [0i64; 3];
        let mut count = 0i64;
        let mut normal = [0i64; 3];
        let mut single: Option<u32> = None;
        let mut near = [0u32; 3];
        let mut near_count = 0;
        for &corner in surface.corners_of(v) {
            let edge = Surface::turn(corner);
            let x = surface.vertex(edge);
            let y = surface.vertex(Surface::turn(edge));
            if order.known[x as usize] { single = Some(x); }
            if order.known[y as usize] { single = Some(y); }
            let other = surface.opposite[edge as usize];
            if other == NONE || !order.known[x as usize] || !order.known[y as usize] {
                continue;
            }
            let c = surface.vertex(Surface::turn(Surface::turn(other)));
            if !order.known[c as usize] || c == v {
                continue;
            }
            let [px, py, pc] = [x, y, c].map(|k| positions[k as usize].map(|z| z as i64));
            for k in 0..3 {
                sum[k] += px[k] + py[k] - pc[k];
            }
            for u in [x, y, c] {
                for k in 0..3 {
                    near[k] += magnitudes[u as usize][k];
                }
                near_count += 1;
            }
            let (e, f): (Vec<i64>, Vec<i64>) = ((0..3).map(|k| px[k] - pc[k]).collect(), (0..3).map(|k| py[k] - pc[k]).collect());
            normal[0] += e[1] * f[2] - e[2] * f[1];
            normal[1] += e[2] * f[0] - e[0] * f[2];
            normal[2] += e[0] * f[1] - e[1] * f[0];
            count += 1;
        }
        let mut predicted: Lattice = if count > 0 {
            sum.map(|s| ((2 * s + count).div_euclid(2 * count)).clamp(0, largest as i64) as i32)
        } else if let Some(x) = single {
            positions[x as usize]
        } else {
            last
        };
        let third = (0..3).max_by_key(|&k| (normal[k].abs(), k)).unwrap_or(2);
        let axes = [(third + 1) % 3, (third + 2) % 3, third];
        let class = (count as usize).min(2);
        let mut position = positions[v as usize];
        let mut moved = 0i64;
        let mut signed_first = 0;
        for (place, &axis) in axes.iter().enumerate() {
            if place == 2 && count > 0 && normal[third] != 0 {
                let slope = -(normal[axes[0]] * (position[axes[0]] - predicted[axes[0]]) as i64
                    + normal[axes[1]] * (position[axes[1]] - predicted[axes[1]]) as i64);
                let n = normal[third];
                let shift = (2 * slope + n).div_euclid(2 * n);
                predicted[third] = (predicted[third] as i64 + shift).clamp(0, largest as i64) as i32;
            }
            let expect = if near_count > 0 { if place == 2 { near[2] * 2 / near_count } else { (near[0] + near[1]) / near_count } } else { 0 };
            let expect = expect as i64 + if place == 0 { 0 } else { moved / 2 };
            let bucket = (64 - (expect as u64).leading_zeros() as usize).min(BUCKETS - 1);
            let residual = models.numbers[((place.min(2)) * 3 + class) * BUCKETS + bucket].code_signed(coder, position[axis] - predicted[axis]);
            let value = predicted[axis] as i64 + residual as i64;
            if !(0..=largest as i64).contains(&value) {
                return Err(());
            }
            position[axis] = value as i32;
            magnitudes[v as usize][place] = residual.unsigned_abs();
            moved += residual.unsigned_abs() as i64;
            signed_first = residual;
            stats[class][place] += residual.abs() as f64;
            *hist.entry((class, place, residual)).or_default() += 1;
        }
        let _ = signed_first;
        positions[v as usize] = position;
        last = position;
        order.learn(surface, v);
    }
    if !C::DECODES && std::env::var("MESH_STATS").is_ok() {
        for class in 0..3 {
            for place in 0..3 {
                let n: u32 = hist.iter().filter(|(k, _)| k.0 == class && k.1 == place).map(|(_, n)| n).sum();
                let h: f64 = hist.iter().filter(|(k, _)| k.0 == class && k.1 == place).map(|(_, &c)| -(c as f64) * (c as f64 / n as f64).log2()).sum();
                println!("  class {class} place {place}: n {n} mean |r| {:.2} entropy0 {:.2}", stats[class][place] / n as f64, h / n as f64);
            }
        }
    }
    Ok(())
}
