//! Cameras that were not captured.

use crate::asset::Asset;
use crate::mesh::Mesh;
use crate::views::Camera;
use glam::{DMat3, DQuat, DVec3};

/// Distance of a camera that frames a mesh, over that at which the sphere around it fills the image.
const FRAMING_MARGIN: f64 = 1.03;

/// A camera at `eye` that looks at `target`, with `up` upwards in the image. `focal` in pixels.
pub fn look_at(eye: [f64; 3], target: [f64; 3], up: [f64; 3], focal: f64, width: u32, height: u32) -> Camera {
    let (eye, target, up) = (DVec3::from_array(eye), DVec3::from_array(target), DVec3::from_array(up));
    let forward = (target - eye).normalize_or(DVec3::Z);
    let right = forward.cross(up).normalize_or(forward.any_orthonormal_vector());
    let down = forward.cross(right);
    let principal = [width as f64 / 2.0, height as f64 / 2.0];
    posed(Camera { width, height, focal: [focal; 2], principal, ..Camera::default() }, [right, down, forward], eye)
}

/// Returns `count` cameras around a mesh that show it whole: the first stands turned by `azimuth` and raised by `elevation` (radians) from +Z,
/// with +Y upwards in the image, the others are turned around +Y from there. `field` is the angle of the longer side, radians.
pub fn framing(
    mesh: &Mesh,
    [azimuth, elevation]: [f64; 2],
    field: f64,
    [width, height]: [u32; 2],
    count: usize,
) -> Vec<Camera> {
    let (middle, radius) = mesh.bounding_sphere();
    let focal = 0.5 * f64::from(width.max(height)) / (0.5 * field).tan();
    let shorter = (0.5 * f64::from(width.min(height)) / focal).atan();
    let distance = FRAMING_MARGIN * radius.max(1e-12) / shorter.sin();
    let camera = |k: usize| {
        let turn = azimuth + std::f64::consts::TAU * k as f64 / count as f64;
        let direction = DVec3::new(turn.sin() * elevation.cos(), elevation.sin(), turn.cos() * elevation.cos());
        let eye = DVec3::from_array(middle) + distance * direction;
        look_at(eye.to_array(), middle, [0.0, 1.0, 0.0], focal, width, height)
    };
    (0..count).map(camera).collect()
}

fn posed(camera: Camera, rows: [DVec3; 3], eye: DVec3) -> Camera {
    Camera { rotation: rows.map(|r| r.to_array()), translation: rows.map(|r| -r.dot(eye)), ..camera }
}

/// `count` cameras on the captured ring: the first captured camera turned around the axis of the capture, the first not turned.
/// The axis is upright in the mean of the photographs and passes where the cameras look. Empty without views.
pub fn orbit(asset: &Asset, count: usize) -> Vec<Camera> {
    let Some(first) = asset.views.first().map(|v| v.camera) else { return Vec::new() };
    let row = |camera: &Camera, k: usize| DVec3::from_array(camera.rotation[k]);
    let up: DVec3 = asset.views.iter().map(|v| -row(&v.camera, 1)).sum();
    // The point nearest to all optical axes.
    let mut matrix = DMat3::ZERO;
    let mut right_side = DVec3::ZERO;
    for view in &asset.views {
        let (centre, axis) = (DVec3::from_array(view.camera.centre()), row(&view.camera, 2));
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        right_side += across * centre;
    }
    let views = asset.views.len() as f64;
    let middle = DVec3::from_array(asset.mesh.bounding_sphere().0);
    let target = if matrix.determinant() > 1e-6 * views.powi(3) { matrix.inverse() * right_side } else { middle };
    let up = up.normalize_or(-row(&first, 1));
    let centres: Vec<DVec3> = asset.views.iter().map(|v| DVec3::from_array(v.camera.centre())).collect();
    let axis = match ring_axis(&centres) {
        // Cameras may lie on their side; then only the ring says what is upright.
        Some(axis) => {
            if axis.dot(up) < 0.0 {
                -axis
            } else {
                axis
            }
        }
        None => up,
    };
    let eye = DVec3::from_array(first.centre());
    (0..count)
        .map(|k| {
            let turn = DQuat::from_axis_angle(axis, std::f64::consts::TAU * k as f64 / count as f64);
            posed(first, [0, 1, 2].map(|i| turn * row(&first, i)), target + turn * (eye - target))
        })
        .collect()
}

/// Upright of the plane that the cameras stand in, where they stand in one and not in a line.
fn ring_axis(centres: &[DVec3]) -> Option<DVec3> {
    let mean = centres.iter().sum::<DVec3>() / centres.len() as f64;
    let outer = |d: DVec3| DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    let spread = centres.iter().fold(DMat3::ZERO, |sum, &c| sum + outer(c - mean));
    let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
    if trace.is_nan() || trace <= 0.0 {
        return None;
    }
    // Inverse iteration: the direction of least spread.
    let inverse = (spread * (1.0 / trace) + DMat3::IDENTITY * 1e-6).inverse();
    let axis = (0..30).fold(DVec3::new(0.48, 0.6, 0.64), |axis, _| (inverse * axis).normalize_or(DVec3::Y));
    let least = (spread * axis).dot(axis) / trace;
    // The middle one follows from the largest, which power iteration finds.
    let longest = (0..30).fold(axis.any_orthonormal_vector(), |d, _| (spread * d).normalize_or(DVec3::X));
    let middle = 1.0 - least - (spread * longest).dot(longest) / trace;
    (least < 0.02 * middle).then_some(axis)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::View;

    #[test]
    fn an_orbit_passes_the_captured_cameras() {
        let captured = |k: usize| {
            let angle = k as f64 * 0.1745;
            look_at([4.0 * angle.sin(), 1.2, 4.0 * angle.cos()], [0.0, 0.1, 0.0], [0.0, 1.0, 0.0], 500.0, 64, 48)
        };
        let views = (0..36).map(|k| View { name: String::new(), camera: captured(k), light: None }).collect();
        let asset = Asset { views, ..Asset::default() };
        let orbit = orbit(&asset, 4);
        let ninety = look_at([4.0, 1.2, 0.0], [0.0, 0.1, 0.0], [0.0, 1.0, 0.0], 500.0, 64, 48);
        for (k, wanted) in [(0, captured(0)), (1, ninety)] {
            let gap = DVec3::from_array(orbit[k].centre()) - DVec3::from_array(wanted.centre());
            assert!(gap.length() < 1e-6, "{gap}");
            let (at, _) = orbit[k].project([0.1, 0.3, 0.2]).unwrap();
            let (expected, _) = wanted.project([0.1, 0.3, 0.2]).unwrap();
            assert!((at[0] - expected[0]).abs() + (at[1] - expected[1]).abs() < 1e-4);
        }
    }

    #[test]
    fn a_ring_of_cameras_on_their_side_is_still_a_ring() {
        // Two thirds of a ring, images turned by a quarter.
        let captured = |k: usize| {
            let angle = k as f64 * 0.1;
            let upward = [angle.cos(), 0.0, -angle.sin()];
            look_at([4.0 * angle.sin(), 1.2, 4.0 * angle.cos()], [0.0, 0.1, 0.0], upward, 500.0, 64, 48)
        };
        let views = (0..40).map(|k| View { name: String::new(), camera: captured(k), light: None }).collect();
        let asset = Asset { views, ..Asset::default() };
        for camera in orbit(&asset, 5) {
            let centre = camera.centre();
            assert!((centre[1] - 1.2).abs() < 1e-3 && (centre[0].hypot(centre[2]) - 4.0).abs() < 1e-3, "{centre:?}");
        }
    }

    #[test]
    fn a_camera_looks_at_its_target_upright() {
        let camera = look_at([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 100.0, 200, 100);
        assert_eq!(camera.project([0.0; 3]).unwrap(), ([100.0, 50.0], 5.0));
        assert!(camera.project([0.0, 1.0, 0.0]).unwrap().0[1] < 50.0);
        assert!(camera.project([1.0, 0.0, 0.0]).unwrap().0[0] > 100.0);
    }
}
