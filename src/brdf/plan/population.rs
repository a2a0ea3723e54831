//! Statistics of a population of measured materials, and plans made from them.

use super::principal::{self, PrincipalComponents};
use super::{
    MaterialPrior, MeasurementPlan, NOISE, PLAN_FORMAT, PlanMethod, PlannedAngles, PopulationComponents, choose,
};
use crate::brdf::compact::{TERMS, coefficients, terms};
use crate::brdf::merl::{MerlGrid, MerlTable, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use crate::brdf::{BrdfSample, HalfDifference};
use crate::error::{Error, Result};
use crate::vector::dot_slices;

/// Floor added to the BRDF before its logarithm is taken.
const FLOOR: f64 = 0.003;
/// Principal components that are kept.
const COMPONENTS: usize = 40;
/// Least variance in variance plans, as a part of the greatest, unless another is asked for.
const VARIANCE_FLOOR: f64 = 0.01;
/// No direction of a plan is nearer to the horizon: cosine of 85 degrees.
const MIN_COSINE: f64 = 0.087;

/// Materials, gathered one by one, then asked for plans.
#[derive(Debug)]
pub struct Population {
    cells: Vec<usize>,
    angles: Vec<HalfDifference>,
    cosines: Vec<[f64; 2]>,
    rows: Vec<Vec<f64>>,
    /// Coefficients of each colour of each material.
    vectors: Vec<Vec<f64>>,
    /// `ln(f + floor)` at the cells, NaN where there is none; of each colour of each material.
    logarithms: Vec<Vec<f32>>,
    /// Sum over materials of what squared errors of the logarithm count at the cells.
    weights: Vec<f64>,
    variance_floor: f64,
    min_theta_h: f64,
    discrepancy: f64,
}

impl Default for Population {
    fn default() -> Self {
        Self::new()
    }
}

impl Population {
    /// None yet.
    pub fn new() -> Self {
        let grid = MerlGrid::new();
        let mut population = Population {
            cells: vec![],
            angles: vec![],
            cosines: vec![],
            rows: vec![],
            vectors: vec![],
            logarithms: vec![],
            weights: vec![],
            variance_floor: VARIANCE_FLOOR,
            min_theta_h: 0.0,
            discrepancy: 1.0,
        };
        for h in (0..THETA_H_BINS).step_by(2) {
            for d in (1..THETA_D_BINS).step_by(3) {
                for p in (5..PHI_D_BINS).step_by(10) {
                    let index = (h * THETA_D_BINS + d) * PHI_D_BINS + p;
                    let Some(cell) = grid.cell(index, [0.0; 3]) else { continue };
                    population.cells.push(index);
                    population.angles.push(cell.angles);
                    population.cosines.push([cell.cos_incoming, cell.cos_outgoing]);
                    let angles = cell.angles;
                    population.rows.push(terms(angles.theta_h, angles.theta_d, cell.cos_incoming, cell.cos_outgoing));
                }
            }
        }
        population.weights = vec![0.0; population.cells.len()];
        population
    }

    /// With a factor of the squared errors that are expected of materials that are measured, for a population that they are only like.
    pub(super) fn with_discrepancy(mut self, factor: f64) -> Self {
        self.discrepancy = factor;
        self
    }

    /// With another floor of the variance in variance plans, as a part of the greatest variance, above 0.
    pub fn with_variance_floor(mut self, floor: f64) -> Self {
        self.variance_floor = floor.clamp(1e-9, 1.0);
        self
    }

    /// Uniform and variance plans that begin at this half angle, 0 to 80 degrees: what is fitted to them leaves smaller ones out, as
    /// lobes do by default ([`crate::brdf::dsbrdf::DsbrdfFitOptions::min_theta_h_deg`]), so that samples there would be lost. The floor of
    /// the variance is then a part of the greatest beyond it. Optimal plans don't change.
    pub fn with_min_theta_h_deg(mut self, least: f64) -> Self {
        self.min_theta_h = least.clamp(0.0, 80.0).to_radians();
        self
    }

    /// Number of materials.
    pub fn len(&self) -> usize {
        self.vectors.len() / 3
    }

    /// True before the first material.
    pub fn is_empty(&self) -> bool {
        self.vectors.is_empty()
    }

    /// Adds a material.
    /// # Errors
    /// [`Error::Parameter`] where too few cells of the table are valid.
    pub fn add(&mut self, table: &MerlTable) -> Result<()> {
        self.add_values(|cell, _| table.cell(cell))
    }

    /// Adds a material that has values at some cells of a table; the angles are those of the cell's middle.
    /// # Errors
    /// [`Error::Parameter`] where it has too few.
    pub fn add_values(&mut self, value: impl Fn(usize, HalfDifference) -> Option<[f64; 3]>) -> Result<()> {
        let mut samples = Vec::with_capacity(self.cells.len());
        let mut logarithms = [0, 1, 2].map(|_| vec![f32::NAN; self.cells.len()]);
        for (n, &cell) in self.cells.iter().enumerate() {
            let ([cos_incoming, cos_outgoing], angles) = (self.cosines[n], self.angles[n]);
            let Some(value) = value(cell, angles) else { continue };
            samples.push(BrdfSample {
                theta_h: angles.theta_h,
                theta_d: angles.theta_d,
                cos_incoming,
                cos_outgoing,
                value,
            });
            (0..3).for_each(|c| logarithms[c][n] = (value[c] + FLOOR).ln() as f32);
            let mean = value.iter().sum::<f64>() / 3.0;
            self.weights[n] += ((mean + FLOOR) * cos_incoming / (1.0 + mean * cos_incoming)).powi(2);
        }
        if samples.len() < TERMS {
            return Err(Error::parameter("a material with so few values can't be part of a population"));
        }
        self.vectors.extend(coefficients(&samples, FLOOR));
        self.logarithms.extend(logarithms);
        Ok(())
    }

    /// A plan of `count` samples.
    /// # Errors
    /// [`Error::Parameter`] for fewer than 2 materials, or a count of 0 or of more than there are cells.
    pub fn plan(&self, count: usize, method: PlanMethod) -> Result<MeasurementPlan> {
        self.plan_of(count, choose::slices(count), method)
    }

    /// A uniform or variance plan of `slices` of `theta_d`, each of `count` samples; for the optimal one only their product counts.
    /// # Errors
    /// [`Error::Parameter`] as [`Population::plan`].
    pub fn plan_slices(&self, slices: usize, count: usize, method: PlanMethod) -> Result<MeasurementPlan> {
        self.plan_of(slices.saturating_mul(count), slices.clamp(1, 90), method)
    }

    fn plan_of(&self, count: usize, slices: usize, method: PlanMethod) -> Result<MeasurementPlan> {
        if self.len() < 2 {
            return Err(Error::parameter("a plan takes a population of 2 materials or more"));
        }
        if count == 0 || count > self.cells.len() / 4 {
            return Err(Error::parameter(format!("a plan has 1 to {} samples", self.cells.len() / 4)));
        }
        let prior = self.prior()?;
        let theta_h: Vec<f64> = self.angles.iter().map(|a| a.theta_h).collect();
        let design = choose::OptimalDesign {
            along: &prior.along,
            left: &prior.left,
            weights: &prior.weights,
            theta_h: &theta_h,
            variances: &prior.components.variances,
        };
        let angles: Vec<PlannedAngles> = match method {
            PlanMethod::Optimal => {
                let cells = design.optimal(count, &prior.candidates).into_iter();
                cells.map(|n| PlannedAngles::from_angles(self.angles[n], prior.left[n])).collect()
            }
            PlanMethod::Uniform | PlanMethod::Variance => {
                let variance = (method == PlanMethod::Variance).then(|| self.variance_along_theta_h());
                let near =
                    |angles: HalfDifference| PlannedAngles::from_angles(angles, prior.left[prior.nearest(angles)]);
                let steps = choose::ThetaHSteps {
                    min_theta_h: self.min_theta_h,
                    variance: variance.as_deref(),
                    floor: self.variance_floor,
                };
                steps.along_theta_h(count, slices).into_iter().map(near).collect()
            }
        };
        let rows: Vec<(Vec<f64>, f64)> = angles
            .iter()
            .filter_map(|a| {
                let along =
                    |terms: Vec<f64>| prior.components.components.iter().map(|c| dot_slices(c, &terms)).collect();
                a.terms().map(|terms| (along(terms), a.variance))
            })
            .collect();
        let expected_log_rmse = design.expected(&rows);
        Ok(MeasurementPlan {
            format: PLAN_FORMAT.into(),
            method,
            materials: self.len(),
            expected_log_rmse,
            angles,
            components: prior.components,
        })
    }

    /// The population's statistics, for estimates of a material from measured values.
    /// # Errors
    /// [`Error::Parameter`] for fewer than 2 materials.
    pub fn prior(&self) -> Result<MaterialPrior> {
        if self.len() < 2 {
            return Err(Error::parameter("a plan takes a population of 2 materials or more"));
        }
        let PrincipalComponents { mean, components, variances } = principal::components(&self.vectors, COMPONENTS);
        let mut prior = self.prior_of(PopulationComponents { floor: FLOOR, mean, components, variances }, |_| 0.0);
        prior.left = self.left_over(&prior);
        prior.weights = self.weights.iter().map(|w| w / self.len() as f64).collect();
        for (n, candidate) in prior.candidates.iter_mut().enumerate() {
            *candidate &= self.logarithms.iter().all(|l| !l[n].is_nan());
        }
        Ok(prior)
    }

    /// Statistics of given components, with the variance that they leave over at angles.
    pub(super) fn prior_of(
        &self,
        components: PopulationComponents,
        left: impl Fn(HalfDifference) -> f64,
    ) -> MaterialPrior {
        let along = |row: &Vec<f64>| components.components.iter().map(|c| dot_slices(c, row)).collect();
        let above = |cosines: &[f64; 2]| cosines.iter().all(|&cosine| cosine > MIN_COSINE);
        MaterialPrior {
            angles: self.angles.clone(),
            cosines: self.cosines.clone(),
            mean: self.rows.iter().map(|row| dot_slices(&components.mean, row)).collect(),
            along: self.rows.iter().map(along).collect(),
            left: self.angles.iter().map(|&angles| left(angles)).collect(),
            weights: Vec::new(),
            discrepancy: self.discrepancy,
            candidates: self.cosines.iter().map(above).collect(),
            components,
        }
    }

    /// Variance of `ln(1 + f)`, whose errors reports count, over the population at each degree of `theta_h`, over all `theta_d` and
    /// `phi_d`. That of `ln f` itself differs so little between highlight and grazing angles that plans hardly differ from uniform ones.
    fn variance_along_theta_h(&self) -> Vec<f64> {
        let mut sums = vec![[0.0f64; 2]; 90];
        for (n, angles) in self.angles.iter().enumerate() {
            let values: Vec<f64> = (self.logarithms.iter())
                .map(|l| l[n] as f64)
                .filter(|l| !l.is_nan())
                .map(|l| (l.exp() - FLOOR).max(0.0).ln_1p())
                .collect();
            if values.len() > 1 {
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
                let sum = &mut sums[(angles.theta_h.to_degrees() as usize).min(89)];
                *sum = [sum[0] + 1.0, sum[1] + variance];
            }
        }
        // Degrees without a cell take the value before them.
        let first = sums.iter().find(|s| s[0] > 0.0).map_or(1.0, |s| s[1] / s[0]);
        let mut last = first;
        let fill = |sum: &[f64; 2]| {
            if sum[0] > 0.0 {
                last = sum[1] / sum[0];
            }
            last
        };
        sums.iter().map(fill).collect()
    }

    /// Mean squared difference between the logarithms and their part in the components.
    fn left_over(&self, prior: &MaterialPrior) -> Vec<f64> {
        let of = &prior.components;
        let places: Vec<Vec<f64>> = (self.vectors.iter())
            .map(|vector| {
                let rest: Vec<f64> = vector.iter().zip(&of.mean).map(|(v, m)| v - m).collect();
                of.components.iter().map(|c| dot_slices(c, &rest)).collect()
            })
            .collect();
        (0..self.cells.len())
            .map(|n| {
                let (middle, along) = (prior.mean[n], &prior.along[n]);
                let (mut sum, mut count) = (0.0, 0.0);
                for (place, logarithms) in places.iter().zip(&self.logarithms) {
                    let logarithm = logarithms[n] as f64;
                    if !logarithm.is_nan() {
                        sum += (logarithm - middle - dot_slices(place, along)).powi(2);
                        count += 1.0;
                    }
                }
                if count > 0.0 { sum / count } else { 1.0 }
            })
            .map(|variance: f64| variance.max(NOISE * 0.1))
            .collect()
    }
}
