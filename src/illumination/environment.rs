//! The environment of photographs that were taken in unknown light, together with the object's diffuse reflectance.
//!
//! A vertex of albedo `rho` shows `B = rho / pi E`; its irradiance `E` is a sum over the environment's lobes, weighted by what the vertex sees
//! of them, plus the light that the object itself sends there, whose radiance is in the photographs. One environment and one albedo a vertex
//! are not told apart by photographs alone: taken is the environment that explains most with few albedos, which are grouped anew while
//! it is solved for. Scale and colour stay unknown: the light is white on the mean, the brightest parts of the object are nearly so.

use super::lamp::{BRIGHT_ALBEDO, brightest};
use super::transport::{LOBES, VertexRays, VertexTransport};
use super::vertex_radiance::VertexRadiance;
use crate::error::Result;
use crate::lighting::fit::spread_directions;
use crate::lighting::{EnvironmentLobes, EnvironmentMap, LightCodingOptions, SphericalGaussian};
use crate::mesh::Mesh;
use crate::optimise::nonnegative::minimise_nonnegative;
use crate::views::source::PhotographSource;
use crate::views::{Component, View};
use std::f64::consts::PI;

/// Sharpness of the lobes: each reaches to its neighbours.
const SHARPNESS: f64 = 14.0;
/// Vertices that the environment is solved with, at most.
const VERTICES: usize = 5000;
/// Rounds of environment and albedo, and sweeps of each solution.
const ROUNDS: usize = 16;
const SWEEPS: usize = 40;
/// Albedos that the object is taken to be made of, about.
const GROUPS: usize = 4;
/// Pull of the amplitudes to their mean, over the mean of the equations' diagonal.
const SMOOTHING: f64 = 0.001;
/// Logarithm of the albedo's error beyond which a vertex counts less and less.
const LIMIT: f64 = 0.5;
/// Steps in which the scale of the light is found.
const SCALINGS: usize = 8;
/// Cells along a side of the sharpest prefiltered map.
const MAP_SIZE: usize = 16;
/// Columns of the environment that the maps are made of.
const COLUMNS: usize = 64;
/// Step of the maps, in 1/64 of a doubling: finer than the light is known.
const MAP_STEP: f32 = 6.0;

/// An environment and what it does to the mesh.
#[derive(Debug)]
pub(crate) struct EnvironmentEstimate {
    /// The section `lIGt`.
    pub(crate) section: Vec<u8>,
    /// Irradiance of the mesh's vertices, the object's own light included.
    pub(crate) irradiance: Vec<[f32; 3]>,
    /// Mean radiance of all directions.
    pub(super) mean: [f64; 3],
    /// Share of the spread of the vertices' brightness that the light explains, 0 to 1.
    pub(super) explained: f64,
}

/// Estimates the environment of photographs, which stood still relative to the object.
pub(super) fn estimate(
    mesh: &Mesh,
    views: &[View],
    components: &[Component],
    photographs: &dyn PhotographSource,
    mean_radiance: Option<[f64; 3]>,
) -> Result<EnvironmentEstimate> {
    let seen = VertexRadiance::gather(mesh, views, components, photographs)?;
    let radiance = seen.filled(mesh);
    let mut lobes: Vec<SphericalGaussian> =
        spread_directions(LOBES).map(|axis| SphericalGaussian::grey(axis, SHARPNESS, 1.0)).collect();
    let rays = VertexRays::new(mesh, &lobes);
    let shown: Vec<usize> = (0..seen.places.len()).filter(|&vertex| seen.radiance[vertex].is_some()).collect();
    let chosen: Vec<usize> =
        (0..shown.len().min(VERTICES)).map(|k| shown[k * shown.len() / shown.len().min(VERTICES)]).collect();
    let transports = crate::parallel::map(chosen.len(), |k| rays.transport(seen.places[chosen[k]], &radiance));
    let equations: Vec<Equation> = chosen
        .iter()
        .zip(&transports)
        .map(|(&vertex, transport)| Equation { transport, radiance: radiance[vertex].map(f64::from) })
        .collect();
    let mut amplitudes = solve(&equations);
    // The light of the object itself has the scale of the photographs, only the environment's is free: not solved in one step.
    for _ in 0..SCALINGS {
        let factors = match mean_radiance {
            Some(wanted) => {
                let found = mean(&lobes, &amplitudes);
                std::array::from_fn(|c| wanted[c] / found[c].max(1e-12))
            }
            None => factors(&equations, &amplitudes),
        };
        amplitudes.iter_mut().for_each(|amplitude| (0..3).for_each(|c| amplitude[c] *= factors[c]));
    }
    let irradiance = rays.irradiances(&seen.places, &radiance, &amplitudes);
    for (lobe, amplitude) in lobes.iter_mut().zip(&amplitudes) {
        lobe.amplitude = *amplitude;
    }
    let mean = mean(&lobes, &amplitudes);
    let explained = explained(&equations, &amplitudes);
    let map = EnvironmentMap::from_fn(COLUMNS, |direction| {
        let mut sum = [0f32; 3];
        for lobe in &lobes {
            let part = lobe.evaluate(direction);
            (0..3).for_each(|c| sum[c] += part[c] as f32);
        }
        sum
    });
    lobes.retain(|lobe| lobe.amplitude.iter().any(|&a| a > 0.0));
    let prefiltered = crate::lighting::prefiltered_maps(&map, MAP_SIZE);
    let light = EnvironmentLobes { diffuse: lobes, prefiltered };
    let (section, _) = crate::lighting::encode(&light, &LightCodingOptions { step: MAP_STEP })?;
    Ok(EnvironmentEstimate { section, irradiance, mean, explained })
}

/// Mean radiance of all directions of lobes of these amplitudes.
fn mean(lobes: &[SphericalGaussian], amplitudes: &[[f64; 3]; LOBES]) -> [f64; 3] {
    let share =
        |lobe: &SphericalGaussian| SphericalGaussian::grey(lobe.axis, lobe.sharpness, 1.0).integral()[0] / (4.0 * PI);
    std::array::from_fn(|c| lobes.iter().zip(amplitudes).map(|(lobe, amplitude)| share(lobe) * amplitude[c]).sum())
}

/// A vertex: how light comes to it, and its radiance.
struct Equation<'a> {
    transport: &'a VertexTransport,
    radiance: [f64; 3],
}

impl Equation<'_> {
    /// Irradiance under an environment, in one colour.
    fn irradiance(&self, amplitudes: &[[f64; 3]; LOBES], colour: usize) -> f64 {
        let sum: f64 = (0..LOBES).map(|l| f64::from(self.transport.lobes[l]) * amplitudes[l][colour]).sum();
        sum + f64::from(self.transport.bounce[colour])
    }
    /// Logarithms of radiance over irradiance.
    fn log_reflectance(&self, amplitudes: &[[f64; 3]; LOBES]) -> [f64; 3] {
        std::array::from_fn(|c| (self.radiance[c] / self.irradiance(amplitudes, c).max(1e-12)).max(1e-9).ln())
    }
}

/// Solves for the environment, up to its scale in each colour: vertices of a group have one reflectance.
fn solve(equations: &[Equation]) -> [[f64; 3]; LOBES] {
    // Reflectance of a grey object, so that the object's own light has its place.
    let mut reflectance = vec![[0.5 / PI; 3]; equations.len()];
    let mut weights = vec![1.0; equations.len()];
    let mut amplitudes = [[0.0; 3]; LOBES];
    for round in 0..ROUNDS {
        for c in 0..3 {
            solve_colour(equations, &reflectance, &weights, c, &mut amplitudes);
        }
        let logs: Vec<[f64; 3]> = equations.iter().map(|e| e.log_reflectance(&amplitudes)).collect();
        let groups = if round < 2 { 1 } else { GROUPS };
        let centres = centres(&logs, groups);
        // The brightest group gives the scale.
        let brightest = centres.iter().flatten().fold(f64::MIN, |most, &x| most.max(x));
        let shift = (BRIGHT_ALBEDO / PI).ln() - brightest;
        for ((log, reflectance), weight) in logs.iter().zip(&mut reflectance).zip(&mut weights) {
            let centre = centres[nearest(&centres, log)];
            *reflectance = centre.map(|x| (x + if groups > 1 { shift } else { 0.0 }).exp());
            if groups == 1 {
                *reflectance = [0.5 / PI; 3];
            }
            let error = (0..3).map(|c| (log[c] - centre[c]).powi(2)).sum::<f64>() / 3.0;
            *weight = 1.0 / (1.0 + error / (LIMIT * LIMIT)).powi(2);
        }
    }
    amplitudes
}

/// Nonnegative least squares of one colour of the environment, errors relative to each vertex's radiance.
fn solve_colour(
    equations: &[Equation],
    reflectance: &[[f64; 3]],
    weights: &[f64],
    c: usize,
    amplitudes: &mut [[f64; 3]; LOBES],
) {
    let (mut a, mut b) = (Box::new([[0.0; LOBES]; LOBES]), [0.0; LOBES]);
    let mean = equations.iter().map(|e| e.radiance[c]).sum::<f64>() / equations.len().max(1) as f64;
    for ((equation, reflectance), weight) in equations.iter().zip(reflectance).zip(weights) {
        let wanted = equation.radiance[c] / reflectance[c];
        // Dark vertices are known less well.
        let scale = (equation.radiance[c] + 0.2 * mean) / reflectance[c];
        let weight = weight / (scale * scale).max(1e-30);
        let rest = weight * (wanted - f64::from(equation.transport.bounce[c]));
        let row = equation.transport.lobes.map(f64::from);
        for k in 0..LOBES {
            b[k] += rest * row[k];
            let scaled = weight * row[k];
            a[k].iter_mut().zip(&row).for_each(|(sum, x)| *sum += scaled * x);
        }
    }
    // Towards the uniform environment that explains the sum.
    let (rows, sums) = (a.iter().flatten().sum::<f64>(), b.iter().sum::<f64>());
    let uniform = if rows > 0.0 { (sums / rows).max(0.0) } else { 0.0 };
    let pull = SMOOTHING * (0..LOBES).map(|k| a[k][k]).sum::<f64>() / LOBES as f64;
    for k in 0..LOBES {
        a[k][k] += pull;
        b[k] += pull * uniform;
    }
    let mut x: [f64; LOBES] = std::array::from_fn(|k| amplitudes[k][c]);
    minimise_nonnegative(&a, &b, &mut x, SWEEPS);
    (0..LOBES).for_each(|k| amplitudes[k][c] = x[k]);
}

/// Which of the centres is nearest.
fn nearest(centres: &[[f64; 3]], log: &[f64; 3]) -> usize {
    let distance = |centre: &[f64; 3]| (0..3).map(|c| (centre[c] - log[c]).powi(2)).sum::<f64>();
    (0..centres.len()).min_by(|&a, &b| distance(&centres[a]).total_cmp(&distance(&centres[b]))).unwrap_or(0)
}

/// Centres of groups of values (k-means), the first ones along the sorted brightness.
fn centres(logs: &[[f64; 3]], groups: usize) -> Vec<[f64; 3]> {
    let mut sorted: Vec<[f64; 3]> = logs.to_vec();
    sorted.sort_by(|a, b| (a[0] + a[1] + a[2]).total_cmp(&(b[0] + b[1] + b[2])));
    let mut centres: Vec<[f64; 3]> =
        (0..groups).filter_map(|k| sorted.get((2 * k + 1) * sorted.len() / (2 * groups)).copied()).collect();
    for _ in 0..12 {
        let mut sums = vec![([0.0; 3], 0.0); centres.len()];
        for log in logs {
            let (sum, count) = &mut sums[nearest(&centres, log)];
            (0..3).for_each(|c| sum[c] += log[c]);
            *count += 1.0;
        }
        for (centre, (sum, count)) in centres.iter_mut().zip(&sums) {
            if *count > 0.0 {
                *centre = sum.map(|x| x / count);
            }
        }
    }
    centres
}

/// Factors of the colours that make the light white on the mean and the object's brightest parts nearly so.
fn factors(equations: &[Equation], amplitudes: &[[f64; 3]; LOBES]) -> [f64; 3] {
    let mean: [f64; 3] = std::array::from_fn(|c| (0..LOBES).map(|l| amplitudes[l][c]).sum::<f64>().max(1e-12));
    let white = mean.map(|m| mean[1] / m);
    let bright: Vec<f64> = equations
        .iter()
        .map(|e| {
            (0..3).map(|c| PI * e.radiance[c] / (white[c] * e.irradiance(amplitudes, c)).max(1e-12)).fold(0.0, f64::max)
        })
        .collect();
    let at = brightest(bright);
    white.map(|w| w * at / BRIGHT_ALBEDO)
}

/// Share of the variance of the logarithms of the radiance that goes with that of the irradiance.
fn explained(equations: &[Equation], amplitudes: &[[f64; 3]; LOBES]) -> f64 {
    let variance = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        values.iter().map(|v| (v - mean).powi(2)).sum::<f64>()
    };
    let seen: Vec<f64> = equations.iter().map(|e| e.radiance[1].max(1e-9).ln()).collect();
    let left: Vec<f64> = equations.iter().map(|e| e.log_reflectance(amplitudes)[1]).collect();
    (1.0 - variance(&left) / variance(&seen).max(1e-30)).clamp(0.0, 1.0)
}
