//! Fitted reflectance: Lambert for the diffuse component, Torrance-Sparrow for the specular one (Miyazaki 2007).

#[cfg(feature = "encode")]
pub mod levenberg_marquardt;

pub mod code;
pub mod geometry;
pub mod lambert;
pub mod maps;
pub mod palette;

#[cfg(feature = "encode")]
mod gather;
pub mod torrance_sparrow;

pub use geometry::Geometry;
pub use torrance_sparrow::Lobe;
