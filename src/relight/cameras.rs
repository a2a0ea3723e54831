//! Cameras that were not captured.

use crate::asset::{Asset, Camera, Mesh};
use glam::{DMat3, DQuat, DVec3};

/// Middle of the mesh's bounding box and radius of the sphere around it that holds the mesh.
pub fn bounds(mesh: &Mesh) -> ([f64; 3], f64) {
    let points = || mesh.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
    let Some(first) = points().next() else { return ([0.0; 3], 1.0) };
    let (low, high) = points().fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
    let middle = (low + high) / 2.0;
    let radius = points().map(|p| (p - middle).length()).fold(0.0, f64::max);
    (middle.to_array(), radius)
}

/// A camera at `eye` that looks at `target`, with `up` upwards in the picture. `focal` in pixels.
pub fn look_at(eye: [f64; 3], target: [f64; 3], up: [f64; 3], focal: f64, width: u32, height: u32) -> Camera {
    let (eye, target, up) = (DVec3::from_array(eye), DVec3::from_array(target), DVec3::from_array(up));
    let forward = (target - eye).normalize_or(DVec3::Z);
    let right = forward.cross(up).normalize_or(forward.any_orthonormal_vector());
    let down = forward.cross(right);
    let principal = [width as f64 / 2.0, height as f64 / 2.0];
    posed(Camera { width, height, focal: [focal; 2], principal, ..Camera::default() }, [right, down, forward], eye)
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
    let middle = DVec3::from_array(bounds(&asset.mesh).0);
    let target = if matrix.determinant() > 1e-6 * views.powi(3) { matrix.inverse() * right_side } else { middle };
    // On a ring the centres turn around the axis; their cross products say where it points better than a partial ring's uprights.
    let centres: Vec<DVec3> = asset.views.iter().map(|v| DVec3::from_array(v.camera.centre())).collect();
    let mean = centres.iter().sum::<DVec3>() / views;
    let turning: DVec3 = centres
        .windows(2)
        .map(|pair| (pair[0] - mean).cross(pair[1] - mean))
        .map(|c| if c.dot(up) < 0.0 { -c } else { c })
        .sum();
    let up = up.normalize_or(-row(&first, 1));
    let axis = turning.normalize_or(up);
    // Domes have rings of several heights: their cross products are not parallel to the axis.
    let axis = if axis.dot(up) > 0.97 { axis } else { up };
    let eye = DVec3::from_array(first.centre());
    (0..count)
        .map(|k| {
            let turn = DQuat::from_axis_angle(axis, std::f64::consts::TAU * k as f64 / count as f64);
            posed(first, [0, 1, 2].map(|i| turn * row(&first, i)), target + turn * (eye - target))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::View;

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
    fn a_camera_looks_at_its_target_upright() {
        let camera = look_at([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 100.0, 200, 100);
        assert_eq!(camera.project([0.0; 3]).unwrap(), ([100.0, 50.0], 5.0));
        assert!(camera.project([0.0, 1.0, 0.0]).unwrap().0[1] < 50.0);
        assert!(camera.project([1.0, 0.0, 0.0]).unwrap().0[0] > 100.0);
    }
}
