//! Pixels that the mesh covers: those that errors are measured on.

use crate::image::Mask;
use crate::mesh::Mesh;
use crate::surface::raster::rasterise;
use crate::views::Camera;

/// Returns the pixels of a camera whose central ray meets the mesh.
pub fn coverage(mesh: &Mesh, camera: &Camera) -> Mask {
    rasterise(mesh, camera).coverage()
}
