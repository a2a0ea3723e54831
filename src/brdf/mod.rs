//! Materials whose reflectance was measured: reading tables, fitting lobes, planning what to measure.

mod angles;
pub mod compact;
#[cfg(feature = "encode")]
pub mod directions;
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
pub mod plan;
#[cfg(feature = "encode")]
pub mod preview;
#[cfg(feature = "encode")]
pub mod rgl;
mod sample;
#[cfg(all(test, feature = "encode"))]
mod test_data;

pub use angles::HalfDifference;
pub use sample::BrdfSample;

/// A bidirectional reflectance distribution function.
///
/// Directions are unit vectors from the surface, `z` along its normal. Values are linear red, green, blue, per steradian, without
/// the cosine of the incident light, and 0 where a direction lies at or below the horizon.
pub trait Brdf: Sync {
    /// Value for light from `incoming` seen from `outgoing`.
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3];

    /// Appends the values for pairs of directions (incoming, outgoing; both above the horizon, half vectors at azimuth 0) that share
    /// `theta_h` and `theta_d`, radians, as the cells of a table do. Forms of these angles do most of their work once.
    fn evaluate_row(&self, theta_h: f64, theta_d: f64, pairs: &[[[f64; 3]; 2]], values: &mut Vec<[f64; 3]>) {
        let _ = (theta_h, theta_d);
        values.extend(pairs.iter().map(|&[incoming, outgoing]| self.evaluate(incoming, outgoing)));
    }
}
