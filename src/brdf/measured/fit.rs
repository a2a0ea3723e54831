//! Fitting materials to measured values at any directions.

use crate::brdf::dsbrdf::{self, DsbrdfFitOptions, LobeCount};
use crate::brdf::forms::RECONSTRUCTED_BINS;
use crate::brdf::materials::FittedMaterial;
use crate::brdf::{
    Brdf, BrdfForm, BrdfSample, FitSettings, FittedBrdf, MaterialPosterior, MaterialPrior, MeasuredSample, compact,
    models,
};
use crate::error::{Error, Result};

/// A material that was fitted to measured values.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredFit {
    /// The material.
    pub fitted: FittedBrdf,
    /// Root mean square of `ln(1 + f cos) - ln(1 + f' cos)` over the samples, colours together.
    pub log_rmse_at_samples: f64,
    /// Log RMSE over a whole table that is expected, given the population: of the most probable material and of the form's differences to
    /// it.
    pub expected_log_rmse: f64,
}

/// Bins of the most probable material that classical models are fitted to beside the measured values.
const CLASSICAL_BINS: [usize; 3] = [30, 12, 5];
/// Most measured values beside which the most probable material is used: more say enough by themselves.
const MAX_SPARSE: usize = 2000;

/// Fits a material to measured values. Form `compact` is fitted to the most probable material, given the values, their noise and the
/// population; lobes to the values alone; classical models to both, anisotropic ones to the values at their actual directions alone.
/// # Errors
/// [`Error::Parameter`] for fewer samples than the form takes.
pub fn fit_measured(
    samples: &[MeasuredSample],
    prior: &MaterialPrior,
    form: BrdfForm,
    settings: &FitSettings,
) -> Result<MeasuredFit> {
    let posterior = prior.posterior(samples)?;
    let fitted = match form {
        BrdfForm::Compact => {
            let probable = posterior.reconstruct(RECONSTRUCTED_BINS);
            FittedBrdf::Coded(FittedMaterial::Compact(compact::fit_compact(&probable, &settings.compact)?))
        }
        BrdfForm::Dsbrdf => {
            let isotropic: Vec<BrdfSample> = samples.iter().map(MeasuredSample::isotropic).collect();
            check_lobes(&isotropic, &settings.dsbrdf)?;
            FittedBrdf::Coded(FittedMaterial::Dsbrdf(dsbrdf::fit_dsbrdf(&isotropic, &settings.dsbrdf)?))
        }
        BrdfForm::Classical(form) => {
            let sparse = !form.is_anisotropic() && samples.len() <= MAX_SPARSE;
            let probable = if sparse { posterior.reconstruct(CLASSICAL_BINS) } else { Vec::new() };
            let model = models::fit_classical_measured(samples, &probable, form, settings.objective)?;
            FittedBrdf::Classical(model)
        }
    };
    let log_rmse_at_samples = error_at_samples(samples, &fitted);
    let expected_log_rmse = expected_error(&posterior, &fitted);
    Ok(MeasuredFit { fitted, log_rmse_at_samples, expected_log_rmse })
}

fn error_at_samples(samples: &[MeasuredSample], fitted: &FittedBrdf) -> f64 {
    let square = |sample: &MeasuredSample| {
        let found = fitted.evaluate(sample.incoming, sample.outgoing);
        let cos = sample.incoming[2];
        (0..3).map(|c| ((sample.value[c] * cos).ln_1p() - (found[c] * cos).ln_1p()).powi(2)).sum::<f64>()
    };
    (samples.iter().map(square).sum::<f64>() / (3 * samples.len()).max(1) as f64).sqrt()
}

/// The squared error of the most probable material, and the squared difference between that and the fit over a coarse table.
fn expected_error(posterior: &MaterialPosterior, fitted: &FittedBrdf) -> f64 {
    let probable = posterior.reconstruct(RECONSTRUCTED_BINS);
    let mut squares = 0.0;
    let (mut pairs, mut values) = (Vec::new(), Vec::new());
    for row in probable.chunk_by(|a, b| (a.theta_h, a.theta_d) == (b.theta_h, b.theta_d)) {
        pairs.clear();
        values.clear();
        pairs.extend(row.iter().map(directions));
        fitted.evaluate_row(row[0].theta_h, row[0].theta_d, &pairs, &mut values);
        for (sample, value) in row.iter().zip(&values) {
            let signal = |f: f64| (f * sample.cos_incoming).ln_1p();
            squares += (0..3).map(|c| (signal(sample.value[c]) - signal(value[c])).powi(2)).sum::<f64>();
        }
    }
    (posterior.expected_log_rmse().powi(2) + squares / (3 * probable.len()).max(1) as f64).sqrt()
}

/// Directions with the angles of a sample, half vector at azimuth 0.
pub(super) fn directions(sample: &BrdfSample) -> [[f64; 3]; 2] {
    // cos_incoming - cos_outgoing = -2 sin theta_h sin theta_d cos phi_d.
    let scale = 2.0 * sample.theta_h.sin() * sample.theta_d.sin();
    let cos_phi = if scale > 1e-12 { (sample.cos_outgoing - sample.cos_incoming) / scale } else { 0.0 };
    let phi_d = cos_phi.clamp(-1.0, 1.0).acos();
    let angles = crate::brdf::HalfDifference { theta_h: sample.theta_h, theta_d: sample.theta_d, phi_d };
    let (incoming, outgoing) = angles.directions();
    [incoming, outgoing]
}

/// Difference angle from which slices need no samples, degrees: directions there graze the surface.
const MAX_NEEDED_THETA_D: f64 = 75.0;

/// Checks that each slice has as many half angles as its lobes have numbers.
fn check_lobes(samples: &[BrdfSample], options: &DsbrdfFitOptions) -> Result<()> {
    let lobes = match options.lobes {
        LobeCount::Given(count) => count,
        LobeCount::ByError => 1,
    };
    let needed = lobes * (2 + usize::from(options.amplitudes));
    let width = 90.0 / options.slices.max(1) as f64;
    let found = dsbrdf::half_angles(samples, options);
    let lacking: Vec<String> = (found.iter().enumerate())
        .filter(|&(slice, &count)| count < needed && (slice as f64 + 0.5) * width < MAX_NEEDED_THETA_D)
        .map(|(slice, count)| format!("{:.0}-{:.0} ({count})", slice as f64 * width, (slice + 1) as f64 * width))
        .collect();
    if lacking.is_empty() {
        return Ok(());
    }
    let shown = lacking.iter().take(6).cloned().collect::<Vec<_>>().join(", ");
    let more = if lacking.len() > 6 { ", ..." } else { "" };
    Err(Error::parameter(format!(
        "form dsbrdf takes {needed} half angles from {} degrees on in each slice of theta_d below {MAX_NEEDED_THETA_D} degrees ({} slices, {lobes} lobes); \
         too few at theta_d {shown}{more} degrees. Fewer slices or lobes take fewer (option `slices`, option `lobes`); form compact takes any",
        options.min_theta_h_deg, options.slices,
    )))
}
