//! Materials whose reflectance was measured: reading tables, fitting lobes, planning what to measure.

mod angles;
pub mod dsbrdf;
#[cfg(feature = "encode")]
pub mod errors;
#[cfg(feature = "encode")]
pub mod forms;
pub mod materials;
#[cfg(feature = "encode")]
pub mod merl;
pub mod models;
#[cfg(feature = "encode")]
#[cfg(feature = "encode")]
pub mod plan;
#[cfg(feature = "encode")]
pub mod rgl;
mod sample;
#[cfg(feature = "encode")]
pub mod sphere;
#[cfg(all(test, feature = "encode"))]
mod test_data;
pub mod tuned;

pub use angles::HalfDifference;
pub use sample::Sample;

/// A bidirectional reflectance distribution function.
///
/// Directions are unit vectors from the surface, `z` along its normal. Values are linear red, green, blue, per steradian, without
/// the cosine of the incident light, and 0 where a direction lies at or below the horizon.
pub trait Brdf: Sync {
    /// Value for light from `incoming` seen from `outgoing`.
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3];
}
