//! One step of Gauss and Newton: the linear system of all displacements, never written out.

use super::evidence::VertexEvidence;
use super::rings::Rings;
use crate::optimise::conjugate_gradient;
use crate::parallel;
use crate::vector::{cross, dot, unit};

/// Relative residual at which the solver stops, and its steps at most.
const TOLERANCE: f64 = 1e-2;
const ITERATIONS: usize = 100;
/// Added to each block's diagonal.
const LEAST: f64 = 1e-9;

/// Weights of the terms that hold where photographs say little.
#[derive(Clone, Copy)]
pub(super) struct Priors {
    /// Of the umbrella operator on the displaced surface: facets and noise go.
    pub(super) smoothness: f64,
    /// Of the displacement itself.
    pub(super) anchor: f64,
    /// Damping of the normals.
    pub(super) damping: f64,
}

/// A displaced surface: `point = base + displacement * along`.
pub(super) struct DisplacedSurface<'a> {
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) rings: &'a Rings,
    pub(super) base: &'a [[f64; 3]],
    /// Unit vectors.
    pub(super) along: &'a [[f64; 3]],
    /// Mean length of an edge.
    pub(super) edge: f64,
}

impl DisplacedSurface<'_> {
    /// Positions of the vertices.
    pub(super) fn points(&self, displacement: &[f64]) -> Vec<[f64; 3]> {
        let place = |v: usize| std::array::from_fn(|k| self.base[v][k] + displacement[v] * self.along[v][k]);
        (0..self.base.len()).map(place).collect()
    }

    /// Sums of the triangles' normals, as long as twice their areas, around each vertex.
    fn area_normals(&self, points: &[[f64; 3]]) -> Vec<[f64; 3]> {
        parallel::map(points.len(), |v| {
            let mut sum = [0.0; 3];
            for &triangle in self.rings.triangles_of(v) {
                let [a, b, c] = self.triangles[triangle as usize].map(|corner| points[corner as usize]);
                let normal = cross(difference(b, a), difference(c, a));
                (0..3).for_each(|k| sum[k] += normal[k]);
            }
            sum
        })
    }

    /// Unit normals of the vertices.
    pub(super) fn normals(&self, points: &[[f64; 3]]) -> Vec<[f64; 3]> {
        self.area_normals(points).into_iter().map(|n| unit(n).0).collect()
    }

    /// Umbrella operator along the directions of displacement: mean of the neighbours minus the vertex.
    fn bend(&self, points: &[[f64; 3]], vertex: usize) -> f64 {
        let [own, others @ ..] = self.rings.ring(vertex) else { return 0.0 };
        let mut sum = [0.0; 3];
        for &other in others {
            (0..3).for_each(|k| sum[k] += points[other as usize][k] - points[*own as usize][k]);
        }
        dot(self.along[vertex], sum) / others.len().max(1) as f64
    }

    /// Returns the step of the displacements that lowers the error most, after linearisation.
    pub(super) fn step(&self, displacement: &[f64], evidence: &[VertexEvidence], priors: &Priors) -> Vec<f64> {
        let points = self.points(displacement);
        let system = LinearSystem::new(self, &points, evidence, priors);
        // The slope of everything at the present displacements.
        let bend = parallel::map(points.len(), |v| self.bend(&points, v));
        let push = |v: usize| {
            let [x, y, z, d] = evidence[v].gradient.map(|x| x as f32);
            [x, y, z, d, bend[v] as f32]
        };
        let pushed: Vec<[f32; 5]> = (0..points.len()).map(push).collect();
        let right = system.transposed(&pushed, displacement);
        let right: Vec<f64> = right.into_iter().map(|x| -x).collect();
        conjugate_gradient::solve(|x| system.apply(x), &system.diagonal(), &right, TOLERANCE, ITERATIONS)
    }
}

#[inline(always)]
fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// `G^T H G + smoothness B^T B + anchor`, with the normals' derivatives `G`, the blocks `H` and the umbrella operator `B`.
struct LinearSystem<'a> {
    surface: &'a DisplacedSurface<'a>,
    /// Derivative of the vertex's normal by the displacement of each entry of its ring.
    slopes: Vec<[f32; 3]>,
    /// The same by columns: derivative of the normal of each entry by the vertex's displacement.
    transposed: Vec<[f32; 3]>,
    /// Cosine between the directions of displacement of a vertex and each of its ring.
    cosines: Vec<f32>,
    /// One over the number of each vertex's neighbours.
    shares: Vec<f32>,
    /// Upper triangles, row by row.
    blocks: Vec<[f32; 10]>,
    smoothness: f64,
    anchor: f64,
}

impl<'a> LinearSystem<'a> {
    fn new(
        surface: &'a DisplacedSurface<'a>,
        points: &[[f64; 3]],
        evidence: &[VertexEvidence],
        priors: &Priors,
    ) -> Self {
        let rings = surface.rings;
        let normals = surface.area_normals(points);
        let rows = parallel::map(points.len(), |v| {
            let ring = rings.ring(v);
            let mut row = vec![[0f64; 3]; ring.len()];
            for &triangle in rings.triangles_of(v) {
                let corners = surface.triangles[triangle as usize].map(|corner| corner as usize);
                for k in 0..3 {
                    let edge = difference(points[corners[(k + 1) % 3]], points[corners[(k + 2) % 3]]);
                    let slope = cross(surface.along[corners[k]], edge);
                    let at =
                        if corners[k] == v { 0 } else { 1 + ring[1..].partition_point(|&w| (w as usize) < corners[k]) };
                    (0..3).for_each(|c| row[at][c] += slope[c]);
                }
            }
            let (normal, squared) = unit(normals[v]);
            let scale = if squared > 1e-30 { 1.0 / squared.sqrt() } else { 0.0 };
            let tangential = |slope: [f64; 3]| {
                let along = dot(slope, normal);
                std::array::from_fn(|c| (scale * (slope[c] - along * normal[c])) as f32)
            };
            row.into_iter().map(tangential).collect::<Vec<[f32; 3]>>()
        });
        let slopes: Vec<[f32; 3]> = rows.concat();
        let mut transposed = Vec::with_capacity(rings.entries());
        let mut cosines = Vec::with_capacity(rings.entries());
        for v in 0..rings.vertices() {
            transposed.extend(rings.twins(v).iter().map(|&twin| slopes[twin as usize]));
            cosines.extend(rings.ring(v).iter().map(|&w| dot(surface.along[v], surface.along[w as usize]) as f32));
        }
        let block = |evidence: &VertexEvidence| {
            let mut block = evidence.hessian;
            for (k, at) in [0, 4, 7, 9].into_iter().enumerate() {
                block[at] += (LEAST + if k < 3 { priors.damping } else { 0.0 }) as f32;
            }
            block
        };
        LinearSystem {
            slopes,
            transposed,
            cosines,
            shares: (0..rings.vertices()).map(|v| 1.0 / (rings.ring(v).len() - 1).max(1) as f32).collect(),
            blocks: evidence.iter().map(block).collect(),
            smoothness: priors.smoothness / (surface.edge * surface.edge),
            anchor: priors.anchor / (surface.edge * surface.edge),
            surface,
        }
    }

    fn apply(&self, x: &[f64]) -> Vec<f64> {
        let rings = self.surface.rings;
        let pushed: Vec<[f32; 5]> = parallel::map(x.len(), |v| {
            let (row, ring) = (rings.row(v), rings.ring(v));
            let (mut moved, mut bend) = ([0f32, 0.0, 0.0, x[v] as f32], 0f32);
            for ((&w, slope), &cosine) in ring.iter().zip(&self.slopes[row.clone()]).zip(&self.cosines[row]) {
                let x = x[w as usize] as f32;
                moved[0] += slope[0] * x;
                moved[1] += slope[1] * x;
                moved[2] += slope[2] * x;
                bend += cosine * x;
            }
            // The sum holds the vertex itself, with a cosine of 1.
            bend = (bend - moved[3]) * self.shares[v] - moved[3];
            let [x, y, z, d] = product(&self.blocks[v], moved);
            [x, y, z, d, bend]
        });
        self.transposed(&pushed, x)
    }

    /// `G^T f + smoothness B^T b + anchor x` for forces `f` and bends `b` of each vertex.
    fn transposed(&self, pushed: &[[f32; 5]], x: &[f64]) -> Vec<f64> {
        let rings = self.surface.rings;
        parallel::map(x.len(), |v| {
            let (row, ring) = (rings.row(v), rings.ring(v));
            let own = &pushed[v];
            let (mut sum, mut bent) = (own[3], 0f32);
            for ((&w, slope), &cosine) in ring.iter().zip(&self.transposed[row.clone()]).zip(&self.cosines[row]) {
                let force = &pushed[w as usize];
                sum += slope[0] * force[0] + slope[1] * force[1] + slope[2] * force[2];
                bent += cosine * force[4] * self.shares[w as usize];
            }
            bent -= own[4] * self.shares[v] + own[4];
            sum as f64 + self.smoothness * bent as f64 + self.anchor * x[v]
        })
    }

    fn diagonal(&self) -> Vec<f64> {
        let rings = self.surface.rings;
        parallel::map(self.blocks.len(), |v| {
            let mut sum = self.anchor + self.smoothness;
            for (k, (&w, slope)) in rings.ring(v).iter().zip(&self.transposed[rings.row(v)]).enumerate() {
                let moved = [slope[0], slope[1], slope[2], if k == 0 { 1.0 } else { 0.0 }];
                let forces = product(&self.blocks[w as usize], moved);
                sum += (0..4).map(|i| (moved[i] * forces[i]) as f64).sum::<f64>();
                if k > 0 {
                    let share = (self.cosines[rings.row(v)][k] * self.shares[w as usize]) as f64;
                    sum += self.smoothness * share * share;
                }
            }
            sum
        })
    }
}

/// A symmetric block, given by its upper triangle, times a vector.
#[inline(always)]
fn product(b: &[f32; 10], x: [f32; 4]) -> [f32; 4] {
    [
        b[0] * x[0] + b[1] * x[1] + b[2] * x[2] + b[3] * x[3],
        b[1] * x[0] + b[4] * x[1] + b[5] * x[2] + b[6] * x[3],
        b[2] * x[0] + b[5] * x[1] + b[7] * x[2] + b[8] * x[3],
        b[3] * x[0] + b[6] * x[1] + b[8] * x[2] + b[9] * x[3],
    ]
}
