//! The surface: which triangle each pixel sees, which photographs see each sample, where the samples lie, and how one
//! view is read from another through the mesh.

pub(crate) mod atlas;
pub(crate) mod charts;
pub(crate) mod displacement;
#[cfg(feature = "encode")]
mod layout;
#[cfg(feature = "encode")]
pub(crate) mod occluders;
pub(crate) mod patches;
pub(crate) mod raster;
pub(crate) mod reproject;
pub(crate) mod samples;
pub(crate) mod split;
pub(crate) mod subdivision;
pub(crate) mod view_geometry;
pub(crate) mod warp;
