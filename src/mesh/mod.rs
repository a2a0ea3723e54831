//! Meshes: reading, cleaning, coding.

#[cfg(feature = "encode")]
pub(crate) mod clean;
pub(crate) mod codec;
pub(crate) mod coordinates;
#[cfg(feature = "encode")]
pub(crate) mod read;

#[cfg(feature = "encode")]
pub use clean::{CleanReport, clean, clean_with_order};
pub use codec::decode;
#[cfg(feature = "encode")]
pub use codec::{EncodedMesh, MeshOptions, encode};
#[cfg(feature = "encode")]
pub use coordinates::encode_coordinates;
pub use coordinates::{CornerCoordinates, decode_coordinates};
#[cfg(feature = "encode")]
pub(crate) use read::material_names;
#[cfg(feature = "encode")]
pub use read::{EXTENSIONS, MeshGroups, parse, parse_with_groups, read, texture_coordinates};

use glam::DVec3;

/// Triangle mesh in world coordinates (the capture's unit). Triangles are counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices of the triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// Largest coordinate of a position, on either side of 0. Products of four coordinates, summed over a mesh, stay within single precision
/// as the squares of this bound do.
const MAX_COORDINATE: f32 = 1e12;

/// Whether all coordinates of a position are numbers within [`MAX_COORDINATE`].
pub(crate) fn is_within_range(position: &[f32; 3]) -> bool {
    position.iter().all(|x| x.abs() <= MAX_COORDINATE)
}

impl Mesh {
    /// Returns the lowest and the highest corner of the axis-aligned bounding box; `None` without a finite vertex.
    pub fn bounding_box(&self) -> Option<[[f32; 3]; 2]> {
        let mut finite = self.positions.iter().filter(|p| p.iter().all(|x| x.is_finite()));
        let first = *finite.next()?;
        let grow = |[low, high]: [[f32; 3]; 2], p: &[f32; 3]| {
            [std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k]))]
        };
        Some(finite.fold([first, first], grow))
    }

    /// Returns half the longest side of the bounding box, above 0.
    #[cfg(feature = "encode")]
    pub(crate) fn half_longest_side(&self) -> f64 {
        let [low, high] = self.bounding_box().unwrap_or_default();
        (0..3).map(|k| 0.5 * (high[k] as f64 - low[k] as f64)).fold(1e-12, f64::max)
    }

    /// Returns the length of the bounding box's diagonal; 0 without a finite vertex.
    pub fn diagonal(&self) -> f64 {
        let [low, high] = self.bounding_box().unwrap_or_default();
        (0..3).map(|k| (high[k] as f64 - low[k] as f64).powi(2)).sum::<f64>().sqrt()
    }

    /// Returns the middle of the bounding box and the radius of the sphere around it that holds the mesh; the unit sphere
    /// around the origin without a finite vertex.
    pub fn bounding_sphere(&self) -> ([f64; 3], f64) {
        let Some([low, high]) = self.bounding_box() else { return ([0.0; 3], 1.0) };
        let middle = DVec3::from_array(std::array::from_fn(|k| (low[k] as f64 + high[k] as f64) / 2.0));
        let points = self.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
        let radius = points.map(|p| (p - middle).length()).fold(0.0, f64::max);
        (middle.to_array(), radius)
    }
}
