//! Cameras that are inside the mesh, or absurdly near it.

use crate::mesh::Mesh;
use crate::parallel;
use crate::views::Camera;
use glam::DVec3;
use std::f64::consts::TAU;

/// Share of the full solid angle that the mesh fills around a camera, beyond which the camera is inside. In the plane of a closed mesh's wall it is
/// one half.
const INSIDE: f64 = 0.6;
/// Distances of cameras and vertices that are measured, at most.
const MAX_DISTANCES: usize = 50_000_000;

/// Where the cameras stand beside the mesh.
pub(super) struct Vicinity {
    /// Indices of the cameras inside the mesh, unless most are: then it is a room.
    pub(super) inside: Vec<usize>,
    /// The smallest distance of a camera to a vertex, over the mesh's size.
    pub(super) nearest: Option<f64>,
}

pub(super) fn vicinity(mesh: &Mesh, cameras: &[Camera]) -> Vicinity {
    let [low, high] = mesh.bounding_box().unwrap_or_default().map(|p| p.map(f64::from));
    let size = mesh.diagonal();
    let stride = (mesh.positions.len().saturating_mul(cameras.len()) / MAX_DISTANCES).max(1);
    let found = parallel::map(cameras.len(), |k| {
        let centre = cameras[k].centre();
        let within = (0..3).all(|axis| (low[axis]..=high[axis]).contains(&centre[axis]));
        let centre = DVec3::from_array(centre);
        let distance = |p: &[f32; 3]| (DVec3::from_array(p.map(f64::from)) - centre).length_squared();
        let nearest = mesh.positions.iter().step_by(stride).map(distance).fold(f64::INFINITY, f64::min).sqrt();
        (within && solid_angle(mesh, centre).abs() > INSIDE * 2.0 * TAU, nearest / size)
    });
    let mut inside: Vec<usize> = (0..cameras.len()).filter(|&k| found[k].0).collect();
    if 2 * inside.len() > cameras.len() {
        inside.clear();
    }
    let nearest = found.iter().map(|(_, distance)| *distance).min_by(f64::total_cmp);
    Vicinity { inside, nearest: nearest.filter(|distance| distance.is_finite()) }
}

/// The solid angle of a mesh, positive where its backs are seen (van Oosterom and Strackee 1983).
fn solid_angle(mesh: &Mesh, from: DVec3) -> f64 {
    let angle = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)) - from);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        2.0 * a.dot(b.cross(c)).atan2(below)
    };
    mesh.triangles.iter().map(angle).sum()
}
