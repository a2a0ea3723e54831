//! Sample points on a mesh, finer than its vertices: every triangle is cut along a grid, as mesh colours are
//! (Yuksel, Keyser & House 2010). Normative for `spec/visibility.md`.

use crate::error::{Error, Result};
use crate::limits::Budget;
use crate::mesh::Mesh;
use std::borrow::Cow;
use std::collections::HashMap;

/// Most parts of an edge. Part of the format.
pub(crate) const MAX_PARTS: u8 = 32;

/// The places of a mesh: its vertices first, then those on edges and within triangles, in the order in which the triangles name them.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceSamples {
    spacing: f32,
    vertices: usize,
    /// Triangles and the place in their grids of what is no vertex.
    inner: Vec<InnerSample>,
    /// Empty where the places are the vertices.
    cuts: Vec<TriangleGrid>,
    /// Triangles of places, those of each triangle of the mesh one after the other.
    triangles: Vec<[u32; 3]>,
}

/// Column and row in the grid of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct InnerSample {
    triangle: u32,
    at: [u8; 2],
}

/// Subdivision of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct TriangleGrid {
    parts: u8,
    first: u32,
}

impl SurfaceSamples {
    /// The vertices alone.
    pub fn at_vertices(vertices: usize) -> Self {
        SurfaceSamples { spacing: 0.0, vertices, inner: Vec::new(), cuts: Vec::new(), triangles: Vec::new() }
    }

    /// Cuts edges into 1, 2, 4 ... 32 parts, until these are no longer than `spacing`; a triangle is cut as its longest edge. With a
    /// spacing of 0 the places are the vertices.
    /// # Errors
    /// [`Error::Parameter`] where the spacing is negative or no number; [`Error::Limits`] where the memory is not there.
    pub fn new(mesh: &Mesh, spacing: f32, budget: &Budget) -> Result<Self> {
        if !(spacing.is_finite() && spacing >= 0.0) {
            return Err(Error::parameter(format!("places cannot be {spacing} apart")));
        }
        let vertices = mesh.positions.len();
        if spacing == 0.0 {
            return Ok(Self::at_vertices(vertices));
        }
        let parts: Vec<u8> = mesh.triangles.iter().map(|corners| parts(mesh, corners, spacing)).collect();
        let grids: u64 = parts.iter().map(|&parts| parts as u64 * parts as u64).sum();
        // A triangle of places, about half a place, and half an entry in the list of those on edges.
        budget.charge_items("places on the mesh", grids, 48)?;
        let mut places = Self { spacing, ..Self::at_vertices(vertices) };
        let mut on_edges: HashMap<(u32, u32, u8), u32> = HashMap::new();
        let mut numbers = Vec::new();
        for (index, (corners, &parts)) in mesh.triangles.iter().zip(&parts).enumerate() {
            places.cuts.push(TriangleGrid { parts, first: places.triangles.len() as u32 });
            numbers.clear();
            for j in 0..=parts {
                for i in 0..=parts - j {
                    let next = (vertices + places.inner.len()) as u32;
                    let number = match key(corners, parts, [i, j]) {
                        SampleKey::Vertex(vertex) => vertex,
                        SampleKey::Edge(key) => *on_edges.entry(key).or_insert(next),
                        SampleKey::Inside => next,
                    };
                    if number == next {
                        places.inner.push(InnerSample { triangle: index as u32, at: [i, j] });
                    }
                    numbers.push(number);
                }
            }
            let n = parts as usize;
            // Rows of n + 1, n, n - 1 ... places.
            let row = |j: usize| j * (n + 1) - j * j.saturating_sub(1) / 2;
            for j in 0..n {
                for i in 0..n - j {
                    let (here, above) = (row(j) + i, row(j + 1) + i);
                    places.triangles.push([here, here + 1, above].map(|k| numbers[k]));
                    if i + j + 1 < n {
                        places.triangles.push([above + 1, above, here + 1].map(|k| numbers[k]));
                    }
                }
            }
        }
        Ok(places)
    }

    /// The finest of a mesh that has no more than `most` places, found by halving; the vertices alone where there are that many.
    #[cfg(feature = "encode")]
    pub fn with_max_count(mesh: &Mesh, most: usize) -> Result<Self> {
        let longest = (mesh.triangles.iter())
            .flat_map(|corners| (0..3).map(|k| squared_length(mesh, corners[k], corners[(k + 1) % 3])))
            .fold(0.0, f64::max)
            .sqrt();
        let mut best = Self::at_vertices(mesh.positions.len());
        if most <= best.count() {
            return Ok(best);
        }
        let (mut fine, mut coarse) = (longest / (2.0 * MAX_PARTS as f64), longest);
        for _ in 0..12 {
            let middle = (fine * coarse).sqrt();
            // More than six times as many triangles as places are wanted need not be tried.
            let cut = |corners: &[u32; 3]| (parts(mesh, corners, middle as f32) as usize).pow(2);
            let triangles: usize = mesh.triangles.iter().map(cut).sum();
            let found = (triangles <= most.saturating_mul(6))
                .then(|| Self::new(mesh, middle as f32, &Budget::new(crate::Limits::default())));
            match found.transpose()? {
                Some(found) if found.count() <= most => (best, coarse) = (found, middle),
                _ => fine = middle,
            }
        }
        Ok(best)
    }

    /// Number of places.
    pub fn count(&self) -> usize {
        self.vertices + self.inner.len()
    }
    /// Number of them that are vertices of the mesh.
    pub fn vertices(&self) -> usize {
        self.vertices
    }
    /// Whether these may be places of a mesh: as many vertices and triangles.
    pub fn are_on(&self, mesh: &Mesh) -> bool {
        self.vertices == mesh.positions.len() && (self.cuts.is_empty() || self.cuts.len() == mesh.triangles.len())
    }
    /// Longest part of an edge that is not cut into `MAX_PARTS`, in units of the mesh; 0 where the places are the vertices.
    pub fn spacing(&self) -> f32 {
        self.spacing
    }

    /// The three places around a point of a triangle, and their weights. `corners` are the triangle's vertices, `weights` theirs.
    #[inline]
    pub fn interpolation(&self, triangle: usize, corners: [u32; 3], weights: [f32; 3]) -> ([u32; 3], [f32; 3]) {
        let Some(&TriangleGrid { parts, first }) = self.cuts.get(triangle) else { return (corners, weights) };
        if parts == 1 {
            return (corners, weights);
        }
        let n = parts as usize;
        let (x, y) = (weights[1] * parts as f32, weights[2] * parts as f32);
        let j = (y.max(0.0) as usize).min(n - 1);
        let i = (x.max(0.0) as usize).min(n - 1 - j);
        let (s, t) = (x - i as f32, y - j as f32);
        // Rows of 2 n - 1, 2 n - 3 ... triangles.
        let at = first as usize + 2 * n * j - j * j + 2 * i;
        if s + t <= 1.0 || i + j + 1 == n {
            (self.triangles[at], [1.0 - s - t, s, t])
        } else {
            (self.triangles[at + 1], [s + t - 1.0, 1.0 - s, 1.0 - t])
        }
    }

    /// For each place beyond the vertices the triangle that it lies in, and the weights of that triangle's corners.
    pub fn inner(&self) -> impl ExactSizeIterator<Item = (usize, [f64; 3])> {
        self.inner.iter().map(|&InnerSample { triangle, at: [i, j] }| {
            let parts = self.cuts[triangle as usize].parts as f64;
            let (b, c) = (i as f64 / parts, j as f64 / parts);
            (triangle as usize, [1.0 - b - c, b, c])
        })
    }

    /// The mesh cut at its places, which are the vertices of it.
    pub fn subdivided<'a>(&self, mesh: &'a Mesh) -> Cow<'a, Mesh> {
        if self.cuts.is_empty() {
            return Cow::Borrowed(mesh);
        }
        let inner = self.inner().map(|(triangle, weights)| {
            let corners = mesh.triangles[triangle].map(|v| mesh.positions[v as usize]);
            std::array::from_fn(|k| (0..3).map(|c| weights[c] * corners[c][k] as f64).sum::<f64>() as f32)
        });
        let positions = mesh.positions.iter().copied().chain(inner).collect();
        Cow::Owned(Mesh { positions, triangles: self.triangles.clone() })
    }
}

enum SampleKey {
    Vertex(u32),
    /// The edge's ends, the smaller first, and how many 32nds of it the place lies from there.
    Edge((u32, u32, u8)),
    Inside,
}

fn key(corners: &[u32; 3], parts: u8, [i, j]: [u8; 2]) -> SampleKey {
    let edge = |from: u32, to: u32, k: u8| {
        let step = MAX_PARTS / parts;
        SampleKey::Edge(if from <= to { (from, to, k * step) } else { (to, from, (parts - k) * step) })
    };
    let [a, b, c] = *corners;
    match (i, j) {
        (0, 0) => SampleKey::Vertex(a),
        _ if i == parts => SampleKey::Vertex(b),
        _ if j == parts => SampleKey::Vertex(c),
        (i, 0) => edge(a, b, i),
        (0, j) => edge(a, c, j),
        (i, j) if i + j == parts => edge(b, c, j),
        _ => SampleKey::Inside,
    }
}

/// Parts of a triangle's edges: those of its longest.
fn parts(mesh: &Mesh, corners: &[u32; 3], spacing: f32) -> u8 {
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| squared_length(mesh, corners[i], corners[j]));
    let longest = edges.into_iter().fold(0.0, |most: f64, edge| if edge > most { edge } else { most });
    let mut parts = 1;
    while parts < MAX_PARTS && longest > (spacing as f64 * parts as f64) * (spacing as f64 * parts as f64) {
        parts *= 2;
    }
    parts
}

fn squared_length(mesh: &Mesh, a: u32, b: u32) -> f64 {
    let [p, q] = [a, b].map(|v| mesh.positions[v as usize].map(f64::from));
    let d = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
    crate::vector::dot(d, d)
}

#[cfg(test)]
mod tests {
    use crate::Limits;
    use crate::surface::samples::*;

    /// A long and a short triangle at one edge.
    fn mesh() -> Mesh {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0, 9.0, 0.5]];
        Mesh { positions, triangles: vec![[0, 1, 2], [2, 1, 3]] }
    }

    #[test]
    fn every_point_lies_between_its_places() {
        let mesh = mesh();
        let budget = Budget::new(Limits::default());
        let places = SurfaceSamples::new(&mesh, 0.5, &budget).unwrap();
        // 4 parts and 32: of the shared edge the coarse places are among the fine ones.
        assert_eq!(places.count(), 33 * 34 / 2 + 5 * 6 / 2 - 5);
        let cut = places.subdivided(&mesh);
        assert_eq!((cut.positions.len(), cut.triangles.len()), (places.count(), 16 + 1024));
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            for k in 0..200 {
                let (b, c) = ((k as f32 * 0.618).fract(), (k as f32 * 0.414).fract());
                let (b, c) = if b + c > 1.0 { (1.0 - b, 1.0 - c) } else { (b, c) };
                let weights = [1.0 - b - c, b, c];
                let (around, shares) = places.interpolation(triangle, *corners, weights);
                assert!(shares.iter().all(|share| *share > -1e-4), "{shares:?}");
                for axis in 0..3 {
                    let sum = |vertices: [u32; 3], weights: [f32; 3]| -> f32 {
                        (0..3).map(|i| weights[i] * cut.positions[vertices[i] as usize][axis]).sum()
                    };
                    assert!((sum(around, shares) - sum(*corners, weights)).abs() < 1e-5);
                }
            }
            for (k, weights) in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].into_iter().enumerate() {
                let (around, shares) = places.interpolation(triangle, *corners, weights);
                let whole = shares.iter().position(|&share| share > 0.9999).unwrap();
                assert_eq!(around[whole], corners[k]);
            }
        }
        assert_eq!(SurfaceSamples::new(&mesh, 0.0, &budget).unwrap(), SurfaceSamples::at_vertices(4));
        let most = SurfaceSamples::with_max_count(&mesh, 150).unwrap();
        assert!((40..=150).contains(&most.count()), "{}", most.count());
    }

    #[test]
    fn the_memory_is_asked_for_first() {
        let tight = Budget::new(Limits { memory_bytes: 1000, ..Limits::default() });
        assert!(matches!(SurfaceSamples::new(&mesh(), 1e-6, &tight), Err(Error::Limits { .. })));
        let budget = Budget::new(Limits::default());
        assert!(
            [f32::NAN, -1.0, f32::INFINITY]
                .iter()
                .all(|&spacing| SurfaceSamples::new(&mesh(), spacing, &budget).is_err())
        );
    }
}
