//! The encoder's half: quantises positions and finds the symbols.

use super::connectivity::NONE;
use super::*;
use crate::entropy::RangeEncoder;
use std::collections::HashMap;

/// Options of the mesh encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshOptions {
    /// Bits of a coordinate on the longest side of the bounding box, 1 to 24.
    pub position_bits: u8,
}

impl Default for MeshOptions {
    fn default() -> Self {
        MeshOptions { position_bits: 12 }
    }
}

/// A coded mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EncodedMesh {
    /// The section.
    pub bytes: Vec<u8>,
    /// The mesh that decoding returns.
    pub mesh: Mesh,
    /// For each decoded triangle its index in the given mesh. Its corners may be rotated.
    pub triangle_order: Vec<u32>,
    /// For each decoded vertex its index in the given mesh.
    pub vertex_order: Vec<u32>,
}

impl EncodedMesh {
    /// Values of the given mesh's corners, one for each triangle's, in the order in which the coded mesh has them.
    pub fn corner_values<T: Copy>(&self, given: &Mesh, values: &[[T; 3]]) -> Vec<[T; 3]> {
        let coded = self.mesh.triangles.iter().zip(&self.triangle_order);
        let turned = |(triangle, &number): (&[u32; 3], &u32)| {
            let (corners, own) = (given.triangles[number as usize], values[number as usize]);
            let first = self.vertex_order[triangle[0] as usize];
            let turn = corners.iter().position(|&vertex| vertex == first).unwrap_or(0);
            std::array::from_fn(|k| own[(k + turn) % 3])
        };
        coded.map(turned).collect()
    }
}

/// Codes a mesh. Positions are rounded to the lattice; triangles and vertices come in another order, and the corners of a
/// triangle may be rotated. Nothing is merged or dropped.
pub fn encode(mesh: &Mesh, options: &MeshOptions) -> Result<EncodedMesh> {
    let counts = [mesh.positions.len(), mesh.triangles.len()];
    if counts.iter().any(|&count| count as u64 > MAX_COUNT) {
        return Err(Error::parameter(format!("mesh with more than {MAX_COUNT} vertices or triangles")));
    }
    if mesh.triangles.as_flattened().iter().any(|&vertex| vertex as usize >= mesh.positions.len()) {
        return Err(Error::parameter("triangle with a vertex that the mesh does not have"));
    }
    let header = lattice_of(mesh, options)?;
    let mut coder = RangeEncoder::new();
    header.code(&mut coder);
    let (growth, triangle_order, vertex_order) = encode_connectivity(&mut coder, mesh);
    let surface = CornerTable::new(&growth.triangles, &growth.opposite, mesh.positions.len());
    let mut lattice: Vec<Lattice> =
        vertex_order.iter().map(|&v| nearest(&header, mesh.positions[v as usize])).collect();
    positions::code(&mut coder, &surface, &mut lattice, header.max_coordinate())
        .map_err(|()| Error::parameter("position outside the lattice"))?;
    code_end(&mut coder);
    let mut bytes = vec![VERSION];
    bytes.extend(coder.finish());
    bytes.resize(bytes.len().max(1 + min_bytes(header.vertices, header.triangles)), 0);
    let positions = lattice.into_iter().map(|point| header.position(point)).collect();
    Ok(EncodedMesh { bytes, mesh: Mesh { positions, triangles: growth.triangles }, triangle_order, vertex_order })
}

/// The cubic lattice of the bounding box.
fn lattice_of(mesh: &Mesh, options: &MeshOptions) -> Result<MeshHeader> {
    let bits = options.position_bits as u32;
    if !POSITION_BITS.contains(&bits) {
        return Err(Error::parameter("position bits must be 1 to 24"));
    }
    if !mesh.positions.iter().all(is_within_range) {
        return Err(Error::parameter("mesh with a position that is not finite or beyond 1e12"));
    }
    let [origin, end] = mesh.bounding_box().unwrap_or_default();
    let longest = (0..3).map(|k| end[k] as f64 - origin[k] as f64).fold(0.0, f64::max);
    let exact = longest / ((1u64 << bits) - 1) as f64;
    // Never too short for the longest side.
    let step = if exact as f32 as f64 >= exact { exact as f32 } else { (exact as f32).next_up() };
    let (vertices, triangles) = (mesh.positions.len() as u32, mesh.triangles.len() as u32);
    let header = MeshHeader { vertices, triangles, bits, origin, step };
    // The lattice is a cube and reaches as far along all axes.
    if !header.is_within_range() {
        return Err(Error::parameter("mesh whose longest side leads beyond 1e12"));
    }
    Ok(header)
}

fn nearest(header: &MeshHeader, position: [f32; 3]) -> Lattice {
    std::array::from_fn(|k| {
        let steps = (position[k] as f64 - header.origin[k] as f64) / header.step as f64;
        // 0 / 0 of a mesh without extent becomes 0.
        (steps.round() as i32).clamp(0, header.max_coordinate())
    })
}

/// Triangles of a mesh by their directed edges.
struct Edges<'a> {
    mesh: &'a Mesh,
    first: HashMap<(u32, u32), u32>,
    /// For each half-edge the next one between the same vertices.
    next: Vec<u32>,
    coded: Vec<bool>,
}

impl<'a> Edges<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let mut first = HashMap::with_capacity(mesh.triangles.len() * 3);
        let mut next = vec![NONE; mesh.triangles.len() * 3];
        for (t, triangle) in mesh.triangles.iter().enumerate().rev() {
            for k in 0..3 {
                let half_edge = 3 * t as u32 + k as u32;
                let before = first.insert((triangle[k], triangle[(k + 1) % 3]), half_edge);
                next[half_edge as usize] = before.unwrap_or(NONE);
            }
        }
        Edges { mesh, first, next, coded: vec![false; mesh.triangles.len()] }
    }
    /// A triangle not yet coded that has the edge `a -> b`, and its third vertex.
    fn find(&mut self, a: u32, b: u32) -> Option<(u32, u32)> {
        let head = self.first.get_mut(&(a, b))?;
        while *head != NONE && self.coded[*head as usize / 3] {
            *head = self.next[*head as usize];
        }
        let half_edge = Some(*head).filter(|half_edge| *half_edge != NONE)?;
        let (t, k) = (half_edge / 3, half_edge as usize % 3);
        Some((t, self.mesh.triangles[t as usize][(k + 2) % 3]))
    }
}

/// Codes the triangles; returns them with the original indices of triangles and vertices.
fn encode_connectivity(coder: &mut RangeEncoder, mesh: &Mesh) -> (Growth, Vec<u32>, Vec<u32>) {
    let mut edges = Edges::new(mesh);
    let mut growth = Growth::new();
    let mut models = ConnectivityModels::new();
    let mut triangle_order: Vec<u32> = Vec::with_capacity(mesh.triangles.len());
    let mut vertex_order: Vec<u32> = Vec::with_capacity(mesh.positions.len());
    let mut renumbered = vec![NONE; mesh.positions.len()];
    let mut seed = 0;
    while triangle_order.len() < mesh.triangles.len() {
        let Some(gate) = growth.next_gate() else {
            while edges.coded[seed] {
                seed += 1;
            }
            let mut corners = [0; 3];
            for (k, &vertex) in mesh.triangles[seed].iter().enumerate() {
                let known = Some(renumbered[vertex as usize]).filter(|v| *v != NONE);
                // Known vertices are always found again.
                let _ = models.seed_vertex(coder, growth.vertices, k, known);
                corners[k] = known.unwrap_or_else(|| {
                    vertex_order.push(vertex);
                    renumbered[vertex as usize] = growth.new_vertex();
                    renumbered[vertex as usize]
                });
            }
            growth.seed(corners);
            edges.coded[seed] = true;
            triangle_order.push(seed as u32);
            continue;
        };
        let (a, b) = growth.ends(gate);
        let found = edges.find(vertex_order[a as usize], vertex_order[b as usize]);
        let symbol = match found {
            None => GateSymbol::Border,
            Some((_, third)) => match renumbered[third as usize] {
                NONE => GateSymbol::New,
                w if growth.previous_vertex(gate) == Some(w) => GateSymbol::Previous,
                w if growth.next_vertex(gate) == Some(w) => GateSymbol::Next,
                w => growth.near(gate, w).unwrap_or(GateSymbol::Known(w)),
            },
        };
        models.symbol(coder, &growth, gate, symbol);
        growth.apply(gate, symbol);
        if let Some((triangle, third)) = found {
            edges.coded[triangle as usize] = true;
            triangle_order.push(triangle);
            if symbol == GateSymbol::New {
                renumbered[third as usize] = vertex_order.len() as u32;
                vertex_order.push(third);
            }
        }
    }
    // Vertices without triangles come last.
    vertex_order.extend((0..mesh.positions.len() as u32).filter(|&v| renumbered[v as usize] == NONE));
    (growth, triangle_order, vertex_order)
}
