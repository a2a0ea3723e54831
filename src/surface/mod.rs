//! The surface: which triangle each pixel sees, which photographs see each sample, where the samples lie, and how one
//! view is read from another through the mesh.

pub mod atlas;
pub mod charts;
pub mod find;
#[cfg(feature = "encode")]
mod layout;
pub mod patches;
pub mod places;
pub mod raster;
pub mod split;
pub mod texels;
#[cfg(feature = "encode")]
pub mod visibility;
pub mod warp;
