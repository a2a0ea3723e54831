//! Lamps beside the camera or the object: where they stand and how strong they are.

use super::{AssumedLight, LightEvidence};
use crate::error::Result;
use crate::reflectance::ReflectionGeometry;
use crate::reflectance::lambert::LambertSums;
use crate::views::{Camera, PointLight};
use glam::DVec3;

/// Albedo of the object's brightest parts under a lamp of unknown intensity, and the share of its surface that is darker.
pub(super) const BRIGHT_ALBEDO: f64 = 0.8;
const DARKER: f64 = 0.95;
/// Sightings nearer to the mirror direction than this may hold highlight, radians between normal and half vector.
const HIGHLIGHT: f32 = 0.35;
/// Halvings of the steps in which the offset of a lamp is looked for; the first is this share of the distance to the object.
const HALVINGS: usize = 8;
const FIRST_STEP: f64 = 0.25;
/// Most of an offset over the distance to the object.
const MAX_OFFSET: f64 = 0.7;
/// An offset that explains the photographs no better than by this share of the error is none.
const WORTH: f64 = 0.02;

/// A lamp at an offset, to the right, upwards and backwards, from a camera.
pub(super) fn beside(camera: &Camera, offset: [f64; 3], intensity: [f64; 3]) -> PointLight {
    let [right, down, ahead] = camera.rotation.map(DVec3::from_array);
    let [x, y, z] = offset;
    let position = DVec3::from_array(camera.centre()) + x * right - y * down - z * ahead;
    PointLight { position: position.to_array(), intensity }
}

/// A lamp at a place of the capture's coordinates, whose origin was moved.
pub(super) fn within(position: [f64; 3], origin: [f64; 3], intensity: [f64; 3]) -> PointLight {
    PointLight { position: std::array::from_fn(|k| position[k] - origin[k]), intensity }
}

pub(super) fn of_camera(
    evidence: &LightEvidence,
    offset: Option<[f64; 3]>,
    intensity: Option<[f64; 3]>,
    warnings: &mut Vec<String>,
) -> Result<AssumedLight> {
    let mut fitted = Vec::new();
    let place = offset.unwrap_or_else(|| {
        let (found, gain) = find_offset(evidence);
        let percent = 100.0 * gain;
        warnings.push(if found == [0.0; 3] {
            "the lamp is taken to be at the camera: no place beside it explains the photographs better".into()
        } else {
            let [x, y, z] = found.map(|x| format!("{x:.3}"));
            format!(
                "the lamp is taken to be {x} to the right of the camera, {y} above and {z} behind it, which explains the photographs \
                 {percent:.0} % better than at the camera; option `light` takes a measured offset"
            )
        });
        fitted.push("offset".into());
        found
    });
    let lamp = |camera: &Camera| beside(camera, place, [1.0; 3]);
    let intensity = intensity.unwrap_or_else(|| {
        fitted.push("intensity".into());
        find_intensity(evidence, &lamp, warnings)
    });
    Ok(AssumedLight::Camera { offset: place, intensity, fitted })
}

pub(super) fn of_object(
    evidence: &LightEvidence,
    position: [f64; 3],
    origin: [f64; 3],
    intensity: Option<[f64; 3]>,
    warnings: &mut Vec<String>,
) -> Result<AssumedLight> {
    let mut fitted = Vec::new();
    let intensity = intensity.unwrap_or_else(|| {
        fitted.push("intensity".into());
        find_intensity(evidence, &|_| within(position, origin, [1.0; 3]), warnings)
    });
    Ok(AssumedLight::Lamp { position, intensity, fitted })
}

/// Sums of the diffuse fit of a point under lamps of intensity 1, away from highlights where it was seen there often enough.
fn matte(evidence: &LightEvidence, point: usize, lamp: &(dyn Fn(&Camera) -> PointLight + Sync)) -> LambertSums {
    let (mut all, mut away) = (LambertSums::default(), LambertSums::default());
    let (place, normal) = evidence.points[point];
    for sighting in &evidence.sightings[point] {
        let camera = &evidence.cameras[sighting.camera as usize];
        let geometry = ReflectionGeometry::new(place, normal, camera.centre(), &lamp(camera));
        all.add(sighting.radiance, &geometry);
        if geometry.alpha > HIGHLIGHT {
            away.add(sighting.radiance, &geometry);
        }
    }
    if away.weight() > 1.0 { away } else { all }
}

/// The albedo of the object's brightest parts; [`BRIGHT_ALBEDO`] where there is none.
pub(super) fn brightest(mut albedo: Vec<f64>) -> f64 {
    albedo.sort_by(f64::total_cmp);
    albedo.get((DARKER * albedo.len() as f64) as usize).copied().unwrap_or(BRIGHT_ALBEDO)
}

/// The intensity, white, under which the object's brightest parts are nearly white.
fn find_intensity(
    evidence: &LightEvidence,
    lamp: &(dyn Fn(&Camera) -> PointLight + Sync),
    warnings: &mut Vec<String>,
) -> [f64; 3] {
    let seen = crate::parallel::map(evidence.points.len(), |point| {
        let solved = matte(evidence, point, lamp).solve()?;
        Some(std::f64::consts::PI * solved.into_iter().fold(0f32, f32::max) as f64)
    });
    let bright = brightest(seen.into_iter().flatten().filter(|albedo| *albedo > 0.0).collect());
    let intensity = bright / BRIGHT_ALBEDO;
    warnings.push(format!(
        "photographs tell neither the intensity nor the colour of their light: it is taken to be white, of intensity {intensity:.4}, with \
         which the object's brightest parts reflect {:.0} % of it; option `light` takes a measured one",
        100.0 * BRIGHT_ALBEDO
    ));
    [intensity; 3]
}

/// Finds the offset under which each point has about the same albedo in all photographs, and by what share of the error it is better than
/// none.
fn find_offset(evidence: &LightEvidence) -> ([f64; 3], f64) {
    let middle = evidence.points.iter().map(|place| DVec3::from_array(place.0)).sum::<DVec3>();
    let middle = middle / evidence.points.len().max(1) as f64;
    let distances = evidence.cameras.iter().map(|camera| (DVec3::from_array(camera.centre()) - middle).length());
    let distance = distances.sum::<f64>() / evidence.cameras.len().max(1) as f64;
    let error = |offset: DVec3| offset_error(evidence, offset.to_array());
    let at_camera = error(DVec3::ZERO);
    let (mut best, mut least) = (DVec3::ZERO, at_camera);
    let mut step = FIRST_STEP * distance;
    for _ in 0..HALVINGS {
        loop {
            let before = least;
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                for tried in [best + step * axis, best - step * axis] {
                    if tried.length() > MAX_OFFSET * distance {
                        continue;
                    }
                    let found = error(tried);
                    if found < least {
                        (best, least) = (tried, found);
                    }
                }
            }
            if least >= before {
                break;
            }
        }
        step *= 0.5;
    }
    let gain = if at_camera > 0.0 { 1.0 - (least / at_camera).sqrt() } else { 0.0 };
    if gain > WORTH { (best.to_array(), gain) } else { ([0.0; 3], 0.0) }
}

/// Mean squared error of the diffuse model over the squared radiance, each sighting's limited so that highlights and shadows count little.
fn offset_error(evidence: &LightEvidence, offset: [f64; 3]) -> f64 {
    let lamp = |camera: &Camera| beside(camera, offset, [1.0; 3]);
    let errors = crate::parallel::map(evidence.points.len(), |point| {
        let (place, normal) = evidence.points[point];
        let Some(solved) = matte(evidence, point, &lamp).solve() else { return (0.0, 0.0) };
        let (mut sum, mut weights) = (0.0, 0.0);
        for sighting in &evidence.sightings[point] {
            let camera = &evidence.cameras[sighting.camera as usize];
            let geometry = ReflectionGeometry::new(place, normal, camera.centre(), &lamp(camera));
            let model = solved[1] * geometry.irradiance[1] * geometry.cos_light.max(0.0);
            let seen = sighting.radiance[1].max(0.0);
            let error = f64::from((model.max(0.0).sqrt() - seen.sqrt()) / (model.max(seen).sqrt() + 1e-6));
            let weight = f64::from(geometry.cos_view.max(0.0));
            sum += weight * error * error / (1.0 + (error / LIMIT).powi(2));
            weights += weight;
        }
        (sum, weights)
    });
    let (sum, weights) = errors.iter().fold((0.0, 0.0), |(s, w), (sum, weight)| (s + sum, w + weight));
    if weights > 0.0 { sum / weights } else { 0.0 }
}

/// Relative error of the square root beyond which a sighting counts less and less.
const LIMIT: f64 = 0.15;
