//! Check of the mesh's unit of length against the cameras'.

use super::align::apply_pose;
use super::description::FrameDescription;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
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

/// Brings a mesh into the world: scaled by `scale`, moved by `pose`. An error where no scale is given and the cameras say that the mesh
/// is in another unit than they.
pub(super) fn place(
    path: &Path,
    mesh: &mut Mesh,
    pose: Option<[[f64; 4]; 4]>,
    scale: Option<f64>,
    frames: &[FrameDescription],
) -> Result<()> {
    if let Some(scale) = scale {
        if !(scale.is_finite() && scale > 0.0) {
            return Err(Error::parameter(format!("the mesh's scale should be a positive number, it is {scale}")));
        }
        mesh.positions.iter_mut().flatten().for_each(|c| *c = (f64::from(*c) * scale) as f32);
    }
    if let Some(pose) = pose {
        apply_pose(mesh, &pose);
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
fn factor(mesh: &Mesh, frames: &[FrameDescription]) -> Option<f64> {
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
    let vertices: Vec<DVec3> =
        mesh.positions.iter().step_by(stride).map(|p| DVec3::from_array(p.map(f64::from))).collect();
    let middle = DVec3::from_array(std::array::from_fn(|k| median(vertices.iter().map(|p| p[k]).collect())));
    let size = median(vertices.iter().map(|p| (*p - middle).length()).collect());
    let factor = size / median(seen) / USUAL_SHARE;
    (factor.is_finite() && factor > 0.0).then_some(factor)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
