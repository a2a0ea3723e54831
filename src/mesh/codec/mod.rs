//! Mesh codec: connectivity by region growing, positions on a lattice by prediction. Specified in `spec/mesh.md`.

mod connectivity;
mod lattice;
mod positions;
mod prediction;

use super::{Mesh, is_within_range};
use crate::container::Tag;
use crate::entropy::{NumberModel, RangeDecoder, code_end, code_raw};
use crate::limits::{Budget, check};
use crate::{Error, Result};
use connectivity::{ConnectivityModels, GateSymbol, Growth};
use lattice::Lattice;
use positions::CornerTable;

#[cfg(feature = "encode")]
mod write;
#[cfg(feature = "encode")]
pub use write::{EncodedMesh, MeshOptions, encode};

/// First byte of the section. Part of the format.
const VERSION: u8 = 0;
/// Most vertices, and most triangles. Part of the format.
const MAX_COUNT: u64 = 1 << 28;
/// Vertices or triangles that one byte of the section may stand for, so that the work is bounded by the bytes: the cheapest
/// triangle costs one bit of probability 65504 / 65536, the 11354th part of a byte. Part of the format.
const ELEMENTS_PER_BYTE: u64 = 16_384;
/// Bits of a lattice coordinate on the longest side. Part of the format.
const POSITION_BITS: std::ops::RangeInclusive<u32> = 1..=24;

/// Memory that decoding takes for a triangle and for a vertex; 12 bytes of each stay.
const TRIANGLE_BYTES: u64 = 256;
const VERTEX_BYTES: u64 = 128;

/// Header of the section: counts and lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MeshHeader {
    vertices: u32,
    triangles: u32,
    bits: u32,
    origin: [f32; 3],
    step: f32,
}

impl MeshHeader {
    fn max_coordinate(&self) -> i32 {
        (1 << self.bits) - 1
    }
    /// The place of a lattice point: computed in double precision, rounded once.
    fn position(&self, lattice: Lattice) -> [f32; 3] {
        std::array::from_fn(|k| (self.origin[k] as f64 + lattice[k] as f64 * self.step as f64) as f32)
    }
    fn is_within_range(&self) -> bool {
        [0, self.max_coordinate()].iter().all(|&end| is_within_range(&self.position([end; 3])))
    }
    fn code<C: crate::entropy::BitCoder>(&self, coder: &mut C) -> MeshHeader {
        let mut number = NumberModel::default();
        let vertices = number.code(coder, self.vertices);
        let triangles = number.code(coder, self.triangles);
        let bits = number.code(coder, self.bits);
        let mut float = |value: f32| f32::from_bits(code_raw(coder, 32, value.to_bits()));
        MeshHeader { vertices, triangles, bits, origin: self.origin.map(&mut float), step: float(self.step) }
    }
}

fn wrong(message: &str) -> Error {
    Error::format(Tag::MESH, 1u8, message)
}

/// Fewest bytes after the first one that may code a mesh of this size.
fn min_bytes(vertices: u32, triangles: u32) -> usize {
    (vertices.max(triangles) as u64 / ELEMENTS_PER_BYTE) as usize
}

/// Reads the section.
pub fn decode(bytes: &[u8], budget: &Budget) -> Result<Mesh> {
    let Some((&version, stream)) = bytes.split_first() else {
        return Err(Error::format(Tag::MESH, 0u8, "empty"));
    };
    if version != VERSION {
        return Err(Error::Unsupported(format!("section MESH of version {version}, this build reads {VERSION}")));
    }
    let mut coder = RangeDecoder::new(stream);
    let nothing = MeshHeader { vertices: 0, triangles: 0, bits: 0, origin: [0.0; 3], step: 0.0 };
    let header = nothing.code(&mut coder);
    check_header(&header, stream.len(), budget)?;
    let growth = decode_connectivity(&mut coder, &header)?;
    let vertices = header.vertices as usize;
    let surface = CornerTable::new(&growth.triangles, &growth.opposite, vertices);
    let mut lattice = vec![[0; 3]; vertices];
    positions::code(&mut coder, &surface, &mut lattice, header.max_coordinate())
        .map_err(|()| wrong("position outside the lattice"))?;
    if !code_end(&mut coder) || !coder.ends_as_written(min_bytes(header.vertices, header.triangles)) {
        return Err(wrong("bytes do not end with the last position"));
    }
    let positions = lattice.into_iter().map(|point| header.position(point)).collect();
    budget.release(header.triangles as u64 * (TRIANGLE_BYTES - 12) + header.vertices as u64 * (VERTEX_BYTES - 12));
    let mut triangles = growth.triangles;
    triangles.shrink_to_fit();
    Ok(Mesh { positions, triangles })
}

fn check_header(header: &MeshHeader, stream_bytes: usize, budget: &Budget) -> Result<()> {
    let &MeshHeader { vertices, triangles, bits, step, .. } = header;
    let most = MAX_COUNT.min(budget.limits().mesh_elements as u64);
    check("vertices of the mesh", vertices as u64, most)?;
    check("triangles of the mesh", triangles as u64, most)?;
    if stream_bytes < min_bytes(vertices, triangles) {
        return Err(wrong("more vertices or triangles than the bytes can tell"));
    }
    if !POSITION_BITS.contains(&bits) {
        return Err(wrong("lattice of less than 1 or more than 24 bits"));
    }
    if !step.is_finite() || step < 0.0 {
        return Err(wrong("step of the lattice below 0 or not finite"));
    }
    if !header.is_within_range() {
        return Err(wrong("lattice reaches beyond 1e12"));
    }
    budget.charge("triangles of the mesh", triangles as u64 * TRIANGLE_BYTES)?;
    budget.charge("vertices of the mesh", vertices as u64 * VERTEX_BYTES)
}

fn decode_connectivity(coder: &mut RangeDecoder, header: &MeshHeader) -> Result<Growth> {
    let mut growth = Growth::new();
    let mut models = ConnectivityModels::new();
    let unknown = || wrong("a vertex that did not come before");
    while growth.triangles.len() < header.triangles as usize {
        if growth.vertices > header.vertices {
            return Err(wrong("more vertices than the header says"));
        }
        match growth.next_gate() {
            Some(gate) => {
                let symbol = models.symbol(coder, &growth, gate, GateSymbol::Border).ok_or_else(unknown)?;
                growth.apply(gate, symbol);
            }
            None => {
                let mut corners = [0; 3];
                for (k, corner) in corners.iter_mut().enumerate() {
                    let known = models.seed_vertex(coder, growth.vertices, k, None).map_err(|()| unknown())?;
                    *corner = known.unwrap_or_else(|| growth.new_vertex());
                }
                growth.seed(corners);
            }
        }
    }
    if growth.vertices > header.vertices {
        return Err(wrong("more vertices than the header says"));
    }
    Ok(growth)
}

#[cfg(test)]
mod tests;
