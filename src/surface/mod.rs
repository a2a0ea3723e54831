//! The surface: which triangle each pixel sees, and how one view is read from another through the mesh.

pub mod raster;
pub mod warp;
