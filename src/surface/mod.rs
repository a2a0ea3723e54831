//! Between photographs and surface: charts, the atlas they are packed into, texels.

pub mod atlas;
pub mod charts;
#[cfg(feature = "encode")]
mod layout;
pub mod texels;
