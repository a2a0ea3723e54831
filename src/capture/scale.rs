//! Where the mesh stands in the world: its unit of length, its pose, and an origin near it.

use super::align::{is_mirroring, moved_point};
use super::description::{CaptureDescription, FrameDescription};
use crate::error::{Error, Result};
use crate::mesh::read::PreciseMesh;
use glam::{DMat3, DVec3};
use std::path::Path;

/// Share of what the median camera sees at its distance that an object fills: half its size over half the picture's.
const USUAL_SHARE: f64 = 0.6;
/// Beyond this factor, either way, the unit must be another one. Rooms seen from within, and objects in a corner of the pictures, stay
/// below it.
const SUSPICIOUS_FACTOR: f64 = 30.0;
/// Half the picture's size in focal lengths, at most.
const WIDEST: f64 = 3.0;
/// Vertices that are looked at.
const MAX_VERTICES: usize = 100_000;
/// A mesh farther from the origin than so many times its size gets an origin of its own: single precision holds 24 bits, and of a thousandth of the
/// size some 13 are wanted.
const FAR: f64 = 128.0;

/// Brings a mesh into the world: scaled by `scale`, moved by `pose`. An error where no scale is given and the cameras say that the mesh
/// is in another unit than they.
pub(super) fn place(
    path: &Path,
    mesh: &mut PreciseMesh,
    pose: Option<[[f64; 4]; 4]>,
    scale: Option<f64>,
    frames: &[FrameDescription],
) -> Result<()> {
    if let Some(scale) = scale {
        if !(scale.is_finite() && scale > 0.0) {
            return Err(Error::parameter(format!("the mesh's scale should be a positive number, it is {scale}")));
        }
        mesh.positions.iter_mut().flatten().for_each(|c| *c *= scale);
    }
    if let Some(pose) = pose {
        mesh.positions.iter_mut().for_each(|p| *p = moved_point(&pose, *p));
        if is_mirroring(&pose) {
            mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
    }
    if mesh.positions.iter().flatten().any(|c| !c.is_finite()) {
        return Err(Error::input(path, "scaled and moved, the mesh has a vertex that is not finite"));
    }
    match factor(mesh, frames) {
        Some(factor) if scale.is_none() && !(1.0 / SUSPICIOUS_FACTOR..=SUSPICIOUS_FACTOR).contains(&factor) => {
            Err(Error::input(path, message(factor)))
        }
        _ => Ok(()),
    }
}

/// Returns an origin for a mesh that lies so far from the world's that single precision would lose its shape, as with coordinates of a national grid;
/// 0 for others.
pub(super) fn origin(mesh: &PreciseMesh) -> [f64; 3] {
    let range =
        |k: usize| mesh.positions.iter().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p[k]), high.max(p[k])));
    let ranges: [(f64, f64); 3] = std::array::from_fn(range);
    let size = ranges.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
    let distance = ranges.iter().map(|(low, high)| low.abs().max(high.abs())).fold(0.0, f64::max);
    if size.is_nan() || size <= 0.0 || distance <= FAR * size {
        return [0.0; 3];
    }
    // Few digits, so that it can be told and added again.
    let step = 10f64.powf(size.log10().floor());
    ranges.map(|(low, high)| (0.5 * (low + high) / step).round() * step)
}

/// Moves cameras and lights to another origin.
pub(super) fn move_origin(description: &mut CaptureDescription, origin: [f64; 3]) {
    for view in description.frames.iter_mut().map(|frame| &mut frame.view) {
        view.camera.translation = view.camera.to_camera(origin);
        if let Some(light) = &mut view.light {
            (0..3).for_each(|k| light.position[k] -= origin[k]);
        }
    }
}

fn message(factor: f64) -> String {
    let power = factor.log10().round();
    let unit = match power {
        2.0 => ": centimetres?",
        3.0 => ": millimetres?",
        -2.0 => ": metres, and the cameras in centimetres?",
        -3.0 => ": metres, and the cameras in millimetres?",
        _ => ", which is no unit of length.",
    };
    let (times, word) = (grouped(10f64.powf(power.abs())), if factor > 1.0 { "larger" } else { "smaller" });
    let scale = 10f64.powf(-power);
    format!(
        "the mesh is about {times} times {word} than the cameras' distance{unit} Scale it with option `mesh_scale` {scale}, or take it as \
         it is with option `mesh_scale` 1"
    )
}

/// A power of ten with commas between thousands.
fn grouped(number: f64) -> String {
    let digits = format!("{number:.0}");
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Returns how many times larger the mesh is than an object that the cameras were pointed at. `None` if the cameras don't determine how far away
/// they stand: a single one, or all in parallel.
fn factor(mesh: &PreciseMesh, frames: &[FrameDescription]) -> Option<f64> {
    // The point nearest to all optical axes.
    let axes: Vec<(DVec3, DVec3)> = (frames.iter())
        .map(|frame| {
            let camera = &frame.view.camera;
            (DVec3::from_array(camera.centre()), DVec3::from_array(camera.rotation[2]).normalize_or_zero())
        })
        .collect();
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (centre, axis) in &axes {
        let across = DMat3::IDENTITY - DMat3::from_cols(*axis * axis.x, *axis * axis.y, *axis * axis.z);
        matrix += across;
        right += across * *centre;
    }
    // Axes that meet at less than some three degrees meet nowhere in particular.
    if axes.len() < 2 || matrix.determinant() < 2e-3 * (axes.len() as f64).powi(3) {
        return None;
    }
    let target = matrix.inverse() * right;
    let seen: Vec<f64> = (frames.iter().zip(&axes))
        .map(|(frame, (centre, _))| {
            let camera = &frame.view.camera;
            let half = 0.5 * f64::from(camera.width.min(camera.height)) / camera.focal[0].min(camera.focal[1]);
            // Wide lenses bend what they see.
            (*centre - target).length() * half.min(WIDEST)
        })
        .collect();
    let stride = (mesh.positions.len() / MAX_VERTICES).max(1);
    let vertices: Vec<DVec3> = mesh.positions.iter().step_by(stride).map(|p| DVec3::from_array(*p)).collect();
    let middle = DVec3::from_array(std::array::from_fn(|k| median(vertices.iter().map(|p| p[k]).collect())));
    let size = median(vertices.iter().map(|p| (*p - middle).length()).collect());
    let factor = size / median(seen) / USUAL_SHARE;
    (factor.is_finite() && factor > 0.0).then_some(factor)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
