//! Every form that a measured material can be fitted in, by name.

use super::compact;
use super::dsbrdf;
use super::materials::FittedMaterial;
use super::merl::{MerlGrid, MerlTable, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use super::models::{self, ClassicalForm, ClassicalModel, FitObjective};
use super::plan::{MeasurementPlan, PlanMethod, PlannedAngles};
use super::{Brdf, BrdfSample};
use crate::Result;

/// A form that a measured material can be fitted in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BrdfForm {
    /// [`compact::CompactMaterial`]: a polynomial of three angles, the smallest error for its bytes.
    Compact,
    /// [`dsbrdf::DsbrdfMaterial`]: lobes of the half angle.
    Dsbrdf,
    /// A classical model.
    Classical(ClassicalForm),
}

impl BrdfForm {
    /// Returns all forms.
    pub fn all() -> Vec<BrdfForm> {
        let classical = ClassicalForm::ALL.into_iter().map(BrdfForm::Classical);
        [BrdfForm::Compact, BrdfForm::Dsbrdf].into_iter().chain(classical).collect()
    }

    /// Returns the form's name, as the CLI and reports have it.
    pub fn name(self) -> &'static str {
        match self {
            BrdfForm::Compact => "compact",
            BrdfForm::Dsbrdf => "dsbrdf",
            BrdfForm::Classical(form) => form.name(),
        }
    }

    /// Returns the form of a name, `None` for an unknown one.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            // Names of earlier versions.
            "tuned" => Some(BrdfForm::Compact),
            "published" => Some(BrdfForm::Dsbrdf),
            _ => Self::all().into_iter().find(|form| form.name() == name),
        }
    }
}

/// Fit options for each kind of form.
#[derive(Debug, Clone, Copy, Default)]
pub struct FitSettings {
    /// Options of [`BrdfForm::Compact`].
    pub compact: compact::CompactFitOptions,
    /// Options of [`BrdfForm::Dsbrdf`].
    pub dsbrdf: dsbrdf::DsbrdfFitOptions,
    /// Objective of [`BrdfForm::Classical`].
    pub objective: FitObjective,
}

/// A material fitted in any form.
#[derive(Debug, Clone, PartialEq)]
pub enum FittedBrdf {
    /// One that files hold.
    Coded(FittedMaterial),
    /// A classical model.
    Classical(ClassicalModel),
}

impl FittedBrdf {
    /// Bytes of the coded material; of a classical model, four a number.
    pub fn bytes(&self) -> usize {
        match self {
            FittedBrdf::Coded(material) => material.encode().len(),
            FittedBrdf::Classical(model) => 4 * model.parameter_count(),
        }
    }
}

impl Brdf for FittedBrdf {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self {
            FittedBrdf::Coded(material) => material.evaluate(incoming, outgoing),
            FittedBrdf::Classical(model) => model.evaluate(incoming, outgoing),
        }
    }

    fn evaluate_row(&self, theta_h: f64, theta_d: f64, pairs: &[[[f64; 3]; 2]], values: &mut Vec<[f64; 3]>) {
        match self {
            FittedBrdf::Coded(material) => material.evaluate_row(theta_h, theta_d, pairs, values),
            FittedBrdf::Classical(model) => model.evaluate_row(theta_h, theta_d, pairs, values),
        }
    }
}

/// Fits a table in a form.
///
/// # Errors
/// [`crate::Error::Parameter`] where the table has too few valid cells, or settings are out of range.
pub fn fit_table(table: &MerlTable, form: BrdfForm, settings: &FitSettings) -> Result<FittedBrdf> {
    match form {
        BrdfForm::Classical(form) => Ok(FittedBrdf::Classical(models::fit_classical(table, form, settings.objective)?)),
        BrdfForm::Compact | BrdfForm::Dsbrdf => fit_samples(&table_samples(table), form, settings),
    }
}

/// Fits samples, such as a plan asks for.
///
/// # Errors
/// [`crate::Error::Parameter`] for too few samples, and as [`fit_table`].
pub fn fit_samples(samples: &[BrdfSample], form: BrdfForm, settings: &FitSettings) -> Result<FittedBrdf> {
    Ok(match form {
        BrdfForm::Compact => {
            FittedBrdf::Coded(FittedMaterial::Compact(compact::fit_compact(samples, &settings.compact)?))
        }
        BrdfForm::Dsbrdf => FittedBrdf::Coded(FittedMaterial::Dsbrdf(dsbrdf::fit_dsbrdf(samples, &settings.dsbrdf)?)),
        BrdfForm::Classical(form) => {
            FittedBrdf::Classical(models::fit_classical_samples(samples, form, settings.objective)?)
        }
    })
}

/// Fits a table from its values at a plan's angles only.
///
/// # Errors
/// [`crate::Error::Parameter`] for too few samples, and if no angle has a value.
pub fn fit_planned(
    table: &MerlTable,
    plan: &MeasurementPlan,
    form: BrdfForm,
    settings: &FitSettings,
) -> Result<FittedBrdf> {
    fit_samples(&planned_samples(table, plan, form)?, form, settings)
}

/// Returns the samples that a form is fitted to from a table's values at a plan's angles: the values themselves for lobes, else the most
/// probable material. Values are interpolated between cells.
///
/// # Errors
/// [`crate::Error::Parameter`] where no angle has a value.
pub fn planned_samples(table: &MerlTable, plan: &MeasurementPlan, form: BrdfForm) -> Result<Vec<BrdfSample>> {
    let values = plan.measure(|angles| {
        let (incoming, outgoing) = angles.half_difference().directions();
        let value = table.interpolated().evaluate(incoming, outgoing);
        // Where the table has no valid cell it answers 0 for all colours.
        (incoming[2] > 0.0 && outgoing[2] > 0.0 && value != [0.0; 3]).then_some(value)
    });
    if form != BrdfForm::Dsbrdf || plan.method == PlanMethod::Optimal {
        return plan.reconstruct(&values, RECONSTRUCTED_BINS);
    }
    let sample = |(angles, value): (&PlannedAngles, Option<[f64; 3]>)| {
        let angles = angles.half_difference();
        let (incoming, outgoing) = angles.directions();
        let (cos_incoming, cos_outgoing) = (incoming[2], outgoing[2]);
        value.map(|value| BrdfSample {
            theta_h: angles.theta_h,
            theta_d: angles.theta_d,
            cos_incoming,
            cos_outgoing,
            value,
        })
    };
    Ok(plan.angles.iter().zip(values).filter_map(sample).collect())
}

/// Bins of `theta_h`, `theta_d` and `phi_d` in which a material is made from a plan's samples before it is fitted.
pub(super) const RECONSTRUCTED_BINS: [usize; 3] = [90, 24, 9];

/// Some 20,000 of a table's valid cells: every bin of `theta_h`, every fourth of `theta_d` and the last three, every 16th of `phi_d`,
/// shifted from row to row.
pub fn table_samples(table: &MerlTable) -> Vec<BrdfSample> {
    let grid = MerlGrid::new();
    let mut samples = Vec::new();
    for h in 0..THETA_H_BINS {
        for d in (0..THETA_D_BINS).filter(|d| (d + h) % 4 == 0 || d + 3 >= THETA_D_BINS) {
            for p in (2 * d % 16..PHI_D_BINS).step_by(16) {
                let index = (h * THETA_D_BINS + d) * PHI_D_BINS + p;
                samples.extend(table.cell(index).and_then(|value| grid.cell(index, value)).map(BrdfSample::from));
            }
        }
    }
    samples
}
