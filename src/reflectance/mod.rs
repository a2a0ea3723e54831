//! Fitted reflectance: Lambert for the diffuse component, Torrance-Sparrow for the specular one (Miyazaki 2007).

pub(crate) mod codec;
pub(crate) mod geometry;
pub(crate) mod lambert;
pub(crate) mod lobes;
pub(crate) mod maps;
pub(crate) mod palette;

#[cfg(feature = "encode")]
pub(crate) mod gather;
#[cfg(feature = "encode")]
pub(crate) mod sightings;
#[cfg(feature = "encode")]
pub(crate) mod stage;
pub(crate) mod torrance_sparrow;

pub use geometry::ReflectionGeometry;
pub(crate) use torrance_sparrow::TorranceSparrowLobe;
