//! Light from all around: environment maps, spherical Gaussians fitted to them, prefiltered maps.

pub(crate) mod codec;
pub(crate) mod environment;
#[cfg(feature = "encode")]
pub(crate) mod fit;
#[cfg(feature = "encode")]
pub(crate) mod follow;
#[cfg(feature = "encode")]
pub(crate) mod levels;
pub(crate) mod prefiltered;
#[cfg(feature = "encode")]
pub(crate) mod projection;
#[cfg(feature = "encode")]
pub(crate) mod read;

pub use crate::sphere::gaussian::SphericalGaussian;
pub use codec::decode;
#[cfg(feature = "encode")]
pub use codec::{LightCodingOptions, encode};
pub use environment::{CleanedPixels, EnvironmentMap, turn_y};
#[cfg(feature = "encode")]
pub use fit::{LobeFitOptions, fit, irradiance_error};
#[cfg(feature = "encode")]
pub use follow::LightFollower;
#[cfg(feature = "encode")]
pub use levels::{prefiltered_errors, prefiltered_map, prefiltered_maps};
pub use prefiltered::{EnvironmentLobes, PrefilteredMap};
#[cfg(feature = "encode")]
pub use projection::{EnvironmentProjection, FisheyeAxis, FisheyeModel, Unwrapper};
#[cfg(feature = "encode")]
pub use read::{EnvironmentReadOptions, raise_clipped, read_environment};
