//! Meshes: reading, cleaning, coding.

#[cfg(feature = "encode")]
pub(crate) mod clean;
pub(crate) mod codec;
#[cfg(feature = "encode")]
pub(crate) mod read;

#[cfg(feature = "encode")]
pub use clean::{CleanReport, clean};
pub use codec::decode;
#[cfg(feature = "encode")]
pub use codec::{EncodedMesh, MeshOptions, encode};
#[cfg(feature = "encode")]
pub use read::{EXTENSIONS, parse, read, texture_coordinates};

use glam::DVec3;

/// Triangle mesh in world coordinates (the capture's unit). Triangles are counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices of the triangles.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Middle of the mesh's bounding box and radius of the sphere around it that holds the mesh.
    pub fn bounding_sphere(&self) -> ([f64; 3], f64) {
        let points = || self.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
        let Some(first) = points().next() else { return ([0.0; 3], 1.0) };
        let (low, high) = points().fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
        let middle = (low + high) / 2.0;
        let radius = points().map(|p| (p - middle).length()).fold(0.0, f64::max);
        (middle.to_array(), radius)
    }
}
