//! Materials (BRDFs), measured and modelled: reading MERL tables and RGL files, fitting them in several forms, planning measurements.

mod angles;
pub(crate) mod binding;
pub(crate) mod compact;
#[cfg(feature = "encode")]
pub(crate) mod directions;
pub(crate) mod dsbrdf;
#[cfg(feature = "encode")]
pub(crate) mod errors;
#[cfg(feature = "encode")]
pub(crate) mod forms;
pub(crate) mod materials;
#[cfg(feature = "encode")]
pub(crate) mod measured;
#[cfg(feature = "encode")]
pub(crate) mod merl;
pub(crate) mod models;
#[cfg(feature = "encode")]
pub(crate) mod plan;
#[cfg(feature = "encode")]
pub(crate) mod preview;
#[cfg(feature = "encode")]
pub(crate) mod rgl;
mod sample;
#[cfg(all(test, feature = "encode"))]
mod test_data;

pub use angles::HalfDifference;
#[cfg(feature = "encode")]
pub use binding::encode_binding;
pub use binding::{TriangleBinding, decode_binding};
pub use compact::{COMPACT_DEGREES, CompactMaterial};
#[cfg(feature = "encode")]
pub use compact::{CompactFitOptions, FitDirections, fit_compact};
#[cfg(feature = "encode")]
pub use directions::{DirectionPair, parse_directions};
pub use dsbrdf::{DsbrdfFitOptions, DsbrdfLobe, DsbrdfMaterial, LobeCount, LobeError, fit_dsbrdf};
#[cfg(feature = "encode")]
pub use errors::{
    ALBEDO_ANGLES_DEG, CellErrors, ErrorReport, MeasuredReference, albedo, cell_errors, log_rmse, max_albedo,
    reciprocity_error,
};
#[cfg(feature = "encode")]
pub use forms::{
    BrdfForm, FitSettings, FittedBrdf, fit_planned, fit_samples, fit_table, planned_samples, table_samples,
};
pub use materials::{FittedMaterial, NamedMaterial, decode_materials, encode_materials};
#[cfg(feature = "encode")]
pub use measured::{MeasuredFit, MeasuredSamples, NoiseSource, fit_measured};
#[cfg(feature = "encode")]
pub use merl::{InterpolatedMerl, MERL_CELLS, MerlCell, MerlGrid, MerlTable, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
#[cfg(feature = "encode")]
pub use models::{
    ClassicalForm, FitObjective, MeasuredPair, PublishedFit, fit_classical, fit_classical_pairs, read_published,
};
pub use models::{ClassicalLobe, ClassicalModel, Microfacets, ScatteringAngles, ShiftedGamma};
#[cfg(feature = "encode")]
pub use plan::{
    GoniometerAngles, MaterialPosterior, MaterialPrior, MeasurementPlan, NextAngles, PLAN_FORMAT, PlanMethod,
    PlannedAngles, Population, PopulationComponents, goniometer_csv, goniometer_rows,
};
#[cfg(feature = "encode")]
pub use preview::{
    POINT_LIGHT, PreviewEnvironment, SphereImages, SpherePair, SpherePsnr, SphereScenes, sphere_exposure,
    studio_environment,
};
#[cfg(feature = "encode")]
pub use rgl::{ReciprocalRgl, RglMaterial};
pub use sample::BrdfSample;
#[cfg(feature = "encode")]
pub use sample::MeasuredSample;

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
