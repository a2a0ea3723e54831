//! Fitted reflectance: Lambert for the diffuse component, Torrance-Sparrow for the specular one (Miyazaki 2007).

pub mod codec;
pub mod geometry;
pub mod lambert;
pub mod maps;
pub mod palette;

#[cfg(feature = "encode")]
pub mod gather;
pub mod torrance_sparrow;

pub use geometry::ReflectionGeometry;
pub use torrance_sparrow::TorranceSparrowLobe;
