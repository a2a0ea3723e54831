//! The surface: which triangle each pixel sees, which photographs see each sample, where the samples lie, and how one
//! view is read from another through the mesh.

pub mod atlas;
pub mod charts;
#[cfg(feature = "encode")]
mod layout;
#[cfg(feature = "encode")]
pub mod occluders;
pub mod patches;
pub mod raster;
pub mod reproject;
pub mod samples;
pub mod split;
pub mod texels;
pub mod view_geometry;
pub mod warp;
