//! Between photographs and surface: which surface point each pixel sees, and from one view to another through the mesh;
//! charts, the atlas they are packed into, texels.

pub mod atlas;
pub mod charts;
#[cfg(feature = "encode")]
mod layout;
pub mod raster;
pub mod warp;
pub mod texels;
//! The object's surface: where its samples lie and which photographs see them.

pub mod patches;
#[cfg(feature = "encode")]
pub mod visibility;
