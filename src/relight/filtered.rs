//! The better evaluator: diffuse light summed over the whole sphere at each place of the mesh, compact sources apart with exact shadows, specular
//! light from several places of the lobe.

use super::appearance::{PreparedSpecular, ShadingParameters};
use super::environment_light::{PreparedEnvironment, log2};
use super::occlusion::visibility_ramp;
use super::octahedral_map::{texel_direction, to_square};
use super::scene::{EnvironmentScene, RenderObject, ShadingPoint};
use crate::sphere::octahedral::solid_angles;
use glam::Vec3;
use std::f32::consts::PI;

/// Side of the grid that diffuse light is summed over where there is no visibility with a grid of its own.
const SIDE: usize = 32;

/// Irradiance of every place from everything but the distant lights.
pub(super) fn irradiance(object: &RenderObject, surround: &PreparedEnvironment, shadows: bool) -> Vec<Vec3> {
    let occlusion = object.occlusion.filter(|_| shadows);
    let side = occlusion.map_or(SIDE, |o| o.side());
    let cells = surround.cell_flux(side);
    let directions: Vec<Vec3> = (0..side * side).map(|k| texel_direction(side, k % side, k / side)).collect();
    // A cell as a lobe of its solid angle.
    let sharpness: Vec<f32> = solid_angles(side).into_iter().map(|a| 2.0 * PI / a as f32).collect();
    crate::parallel::map(object.normals.len(), |place| {
        let normal = object.normals[place];
        let mut sum = Vec3::ZERO;
        for k in 0..cells.len() {
            let cosine = normal.dot(directions[k]);
            if cosine <= 0.0 {
                continue;
            }
            let seen =
                occlusion.map_or(1.0, |o| visibility_ramp(o.cell_distance(place, k % side, k / side), sharpness[k]));
            sum += cells[k] * (cosine * seen);
        }
        sum
    })
}

/// Radiance towards the camera, diffuse and specular.
pub(super) fn radiance(scene: &EnvironmentScene, point: &ShadingPoint, appearance: &ShadingParameters) -> [Vec3; 2] {
    let [a, b, c] = point.places.map(|place| scene.irradiance[place as usize]);
    let mut irradiance = a * point.shares.x + b * point.shares.y + c * point.shares.z;
    let specular = appearance.specular.filter(|_| appearance.specular_scale.max_element() > 0.0);
    let frame = point.basis();
    let outgoing = frame.transpose() * point.outgoing;
    let mut shine = Vec3::ZERO;
    for (k, light) in scene.surround.distant.iter().enumerate() {
        let direction = Vec3::from_array(light.direction);
        let cosine = point.normal.dot(direction);
        if cosine <= 0.0 || (scene.options.shadows && point.geometric.dot(direction) <= 0.0) {
            continue;
        }
        let reach = match scene.shadows.get(k) {
            Some(Some(map)) => {
                let (position, normal) = (point.position.as_dvec3(), point.geometric.as_dvec3());
                map.soft_visibility(position.to_array(), normal.to_array(), PreparedEnvironment::disc_radius(light))
                    as f32
            }
            _ => 1.0,
        };
        let arriving = Vec3::from_array(light.irradiance) * (cosine * reach);
        irradiance += arriving;
        if let Some(prepared) = specular.filter(|_| reach > 0.0) {
            shine += arriving * evaluate_brdf(prepared, frame.transpose() * direction, outgoing);
        }
    }
    if let Some(prepared) = specular {
        shine +=
            reflected(scene, point, prepared, |_, _, incoming, outgoing| evaluate_brdf(prepared, incoming, outgoing));
    }
    [appearance.albedo * irradiance / PI, appearance.specular_scale * shine]
}

/// The reflection function between two directions in the tangent frame.
pub(super) fn evaluate_brdf(prepared: &PreparedSpecular, incoming: Vec3, outgoing: Vec3) -> Vec3 {
    let f = prepared.specular.brdf.evaluate(incoming.as_dvec3().to_array(), outgoing.as_dvec3().to_array());
    Vec3::from_array(f.map(|x| x as f32))
}

/// Specular reflection of everything but the distant lights: half vectors drawn from the lobes, each with the light around its own
/// direction averaged over the solid angle that it stands for. `brdf` gets the half vector, its cosine to either direction, and the
/// incoming and outgoing direction, all in the tangent frame.
#[inline]
pub(super) fn reflected(
    scene: &EnvironmentScene,
    point: &ShadingPoint,
    prepared: &PreparedSpecular,
    brdf: impl Fn(Vec3, f32, Vec3, Vec3) -> Vec3,
) -> Vec3 {
    let frame = point.basis();
    let outgoing = frame.transpose() * point.outgoing;
    let occlusion = scene.object.occlusion.filter(|_| scene.options.shadows);
    let count = prepared.taps.len() as f32;
    let mut sum = Vec3::ZERO;
    for &(half, density, level) in &prepared.taps {
        let cosine = half.dot(outgoing);
        let incoming = 2.0 * cosine * half - outgoing;
        if cosine <= 1e-4 || incoming.z <= 0.0 || half.z <= 0.0 {
            continue;
        }
        let world = frame * incoming;
        if scene.options.shadows && point.geometric.dot(world) <= 0.0 {
            continue;
        }
        // Of i = 2 (o.h) h - o the density is that of h over 4 (o.h).
        let density = density / (4.0 * cosine) * count;
        let sharpness = 2.0 * PI * density;
        let square = to_square(world);
        let seen = occlusion
            .map_or(1.0, |o| visibility_ramp(o.interpolated_distance(point.places, point.shares, square), sharpness));
        if seen <= 0.0 {
            continue;
        }
        // The tap's level is that of the half vector's density; the turn to the reflected one makes it coarser.
        let light = scene.surround.filtered_radiance(square, level + 0.5 * log2(cosine));
        sum += light * brdf(half, cosine, incoming, outgoing) * (incoming.z * seen / density);
    }
    sum
}
