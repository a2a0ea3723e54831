//! Errors of a fitted material against the measured one.

use super::Brdf;
use super::merl::{MerlGrid, MerlTable, THETA_D_BINS, THETA_H_BINS};
use super::preview::SpherePsnr;
use super::preview::{SphereImages, SphereScenes};
use crate::parallel;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// The figures of one fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorReport {
    /// Root mean square of `ln(1 + f cos) - ln(1 + f' cos)` over valid cells, colours together; `cos` is that of the incident light.
    pub log_rmse: f64,
    /// `log_rmse` over cells whose `theta_h` is 5 degrees or more: without the centre of the highlight.
    pub log_rmse_from_5_deg: f64,
    /// Root mean square of `(f - f') cos` over valid cells, colours together.
    pub cosine_rmse: f64,
    /// The fitted material's greatest [`albedo`] over [`ALBEDO_ANGLES_DEG`] and colours; values above 1 violate energy conservation.
    pub albedo_max: f64,
    /// The fitted material's [`reciprocity_error`].
    pub reciprocity: f64,
    /// PSNR of a rendered sphere, dB.
    pub sphere_psnr_db: SpherePsnr,
}

/// A measured material with its pictures, so that several fits can be compared with it.
pub struct MeasuredReference<'a> {
    measured: &'a MerlTable,
    scenes: &'a SphereScenes,
    pictures: SphereImages,
}

impl<'a> MeasuredReference<'a> {
    /// Renders the measured material's spheres.
    pub fn new(measured: &'a MerlTable, scenes: &'a SphereScenes) -> Self {
        MeasuredReference { measured, scenes, pictures: scenes.images(&measured.interpolated()) }
    }

    /// Computes the errors of a fitted material.
    pub fn report(&self, fitted: &impl Brdf) -> ErrorReport {
        let cells = cell_errors(self.measured, fitted);
        ErrorReport {
            log_rmse: cells.log_rmse,
            log_rmse_from_5_deg: cells.log_rmse_from_5_deg,
            cosine_rmse: cells.cosine_rmse,
            albedo_max: max_albedo(fitted),
            reciprocity: reciprocity_error(fitted),
            sphere_psnr_db: self.scenes.psnr_of(&self.pictures, fitted),
        }
    }
}

impl ErrorReport {
    /// Compares a fitted material with a measured one.
    pub fn compare(measured: &MerlTable, fitted: &impl Brdf, scenes: &SphereScenes) -> Self {
        MeasuredReference::new(measured, scenes).report(fitted)
    }
}

/// Error metrics over the valid cells of a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellErrors {
    /// See [`ErrorReport::log_rmse`].
    pub log_rmse: f64,
    /// See [`ErrorReport::log_rmse_from_5_deg`].
    pub log_rmse_from_5_deg: f64,
    /// See [`ErrorReport::cosine_rmse`].
    pub cosine_rmse: f64,
}

/// See [`ErrorReport::log_rmse`].
pub fn log_rmse(measured: &MerlTable, fitted: &impl Brdf) -> f64 {
    cell_errors(measured, fitted).log_rmse
}

/// The errors over valid cells, in one go.
pub fn cell_errors(measured: &MerlTable, fitted: &impl Brdf) -> CellErrors {
    let grid = MerlGrid::new();
    let sums = parallel::map(THETA_H_BINS, |plane| {
        let mut sums = [0.0; 3];
        let (mut indices, mut pairs) = (Vec::new(), Vec::new());
        let (mut valid, mut cells, mut found) = (Vec::new(), Vec::new(), Vec::new());
        for row in plane * THETA_D_BINS..(plane + 1) * THETA_D_BINS {
            let [theta_h, theta_d] = grid.row(row, &mut indices, &mut pairs);
            cells.clear();
            valid.clear();
            found.clear();
            for (&index, &pair) in indices.iter().zip(&pairs) {
                let Some(value) = measured.cell(index) else { continue };
                cells.push(value);
                valid.push(pair);
            }
            fitted.evaluate_row(theta_h, theta_d, &valid, &mut found);
            for ((value, [incoming, _]), found) in cells.iter().zip(&valid).zip(&found) {
                for c in 0..3 {
                    let (a, b) = (value[c] * incoming[2], found[c] * incoming[2]);
                    // ln(1 + a) - ln(1 + b) in one logarithm.
                    let log = ((1.0 + a) / (1.0 + b)).ln();
                    sums[0] += log * log;
                    sums[1] += (a - b) * (a - b);
                }
                sums[2] += 3.0;
            }
        }
        sums
    });
    let first = (5f64 / 90.0).sqrt() * THETA_H_BINS as f64 - 0.5;
    let total = |from: usize| {
        let all = sums.iter().skip(from).fold([0.0; 3], |all, one| std::array::from_fn(|k| all[k] + one[k]));
        let [log, linear, count] = all;
        [log, linear].map(|sum| (sum / f64::max(count, 1.0)).sqrt())
    };
    let ([log_rmse, cosine_rmse], [log_rmse_from_5_deg, _]) = (total(0), total(first.ceil() as usize));
    CellErrors { log_rmse, log_rmse_from_5_deg, cosine_rmse }
}

/// Angles of the viewer at which [`max_albedo`] looks, degrees. Nearer to the horizon measurements mean little.
pub const ALBEDO_ANGLES_DEG: [f64; 7] = [0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0];

/// The greatest albedo over [`ALBEDO_ANGLES_DEG`] and colours.
pub fn max_albedo(material: &impl Brdf) -> f64 {
    let albedos = parallel::map(ALBEDO_ANGLES_DEG.len(), |k| albedo(material, ALBEDO_ANGLES_DEG[k].to_radians()));
    albedos.into_iter().flatten().fold(0.0, f64::max)
}

/// Directional albedo, `integral of f cos(theta_i) over i`, seen at an angle to the normal, red, green, blue.
///
/// By a regular quadrature over half vectors, 128 angles times 64 azimuths, the angles as the cube of equal steps, so that lobes of a
/// few minutes of arc are still integrated: `d i = 4 (h.o) d h`.
pub fn albedo(material: &impl Brdf, theta_outgoing: f64) -> [f64; 3] {
    const ANGLES: usize = 128;
    const AZIMUTHS: usize = 64;
    let (sine, cosine) = theta_outgoing.sin_cos();
    let outgoing = [sine, 0.0, cosine];
    let mut sum = [0.0; 3];
    for a in 0..ANGLES {
        let at = (a as f64 + 0.5) / ANGLES as f64;
        let (sin_h, cos_h) = (FRAC_PI_2 * at.powi(3)).sin_cos();
        let area = sin_h * FRAC_PI_2 * 3.0 * at * at / ANGLES as f64 * 2.0 * PI / AZIMUTHS as f64;
        for p in 0..AZIMUTHS {
            let (sin_p, cos_p) = ((p as f64 + 0.5) / AZIMUTHS as f64 * 2.0 * PI).sin_cos();
            let half = [sin_h * cos_p, sin_h * sin_p, cos_h];
            let dot = half[0] * outgoing[0] + half[2] * outgoing[2];
            let incoming: [f64; 3] = std::array::from_fn(|k| 2.0 * dot * half[k] - outgoing[k]);
            if dot <= 0.0 || incoming[2] <= 0.0 {
                continue;
            }
            let value = material.evaluate(incoming, outgoing);
            (0..3).for_each(|c| sum[c] += value[c] * incoming[2] * 4.0 * dot * area);
        }
    }
    sum
}

/// The greatest `|f(i, o) - f(o, i)| / (f(i, o) + f(o, i))` over 1,000 fixed pairs of directions, all more than 5 degrees above the
/// horizon, and colours; 0 for a material that obeys Helmholtz.
pub fn reciprocity_error(material: &impl Brdf) -> f64 {
    let fraction = |k: usize, step: f64| (0.5 + k as f64 * step).fract();
    let direction = |cosine: f64, turn: f64| {
        let cosine = 0.0872 + (1.0 - 0.0872) * cosine;
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let (sin_p, cos_p) = (2.0 * PI * turn).sin_cos();
        [sine * cos_p, sine * sin_p, cosine]
    };
    let mut worst = 0.0f64;
    for k in 0..1000 {
        // A sequence of low discrepancy in four dimensions (powers of the root of x^5 = x + 1).
        let [a, b, c, d] = [0.856_674_883_854_502_9, 0.733_891_856_627_126, 0.628_706_720_785_653, 0.538_597_259_4];
        let (one, other) = (direction(fraction(k, a), fraction(k, b)), direction(fraction(k, c), fraction(k, d)));
        let (there, back) = (material.evaluate(one, other), material.evaluate(other, one));
        for c in 0..3 {
            worst = worst.max((there[c] - back[c]).abs() / (there[c] + back[c]).max(1e-12));
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Constant(f64);
    impl Brdf for Constant {
        fn evaluate(&self, _: [f64; 3], _: [f64; 3]) -> [f64; 3] {
            [self.0; 3]
        }
    }

    #[test]
    fn figures_of_constants() {
        assert!((max_albedo(&Constant(1.0 / PI)) - 1.0).abs() < 2e-3, "{}", max_albedo(&Constant(1.0 / PI)));
        assert_eq!(reciprocity_error(&Constant(0.3)), 0.0);
        let (one, other) = (Constant(0.2), Constant(0.3));
        let table = MerlTable::tabulate(&one);
        let errors = cell_errors(&table, &other);
        let grid = MerlGrid::new();
        let (mut logs, mut squares, mut count) = (0.0, 0.0, 0.0);
        for cell in table.valid_cells(&grid) {
            logs += ((0.2 * cell.cos_incoming).ln_1p() - (0.3 * cell.cos_incoming).ln_1p()).powi(2);
            squares += (0.1 * cell.cos_incoming).powi(2);
            count += 1.0;
        }
        assert!((errors.log_rmse - f64::sqrt(logs / count)).abs() < 1e-6);
        assert!((errors.cosine_rmse - f64::sqrt(squares / count)).abs() < 1e-6);
        assert!(log_rmse(&table, &one) < 1e-7);
    }
}
