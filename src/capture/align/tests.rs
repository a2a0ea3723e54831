use super::*;
use glam::{DMat3, DQuat, DVec3};

/// Cameras on a ring of radius 4 about the origin, looking at it.
fn ring(count: usize) -> Vec<Camera> {
    let camera = |index: usize| {
        let angle = index as f64 * 0.7;
        let centre = DVec3::new(4.0 * angle.cos(), 4.0 * angle.sin(), 1.0);
        let forward = -centre.normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let rotation = [right.to_array(), forward.cross(right).to_array(), forward.to_array()];
        let translation = rotation.map(|row| -DVec3::from_array(row).dot(centre));
        Camera { width: 800, height: 600, focal: [900.0, 910.0], principal: [405.0, 298.0], rotation, translation }
    };
    (0..count).map(camera).collect()
}

fn truth(scale: f64) -> Similarity {
    Similarity {
        rotation: DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.9, -1.7, 0.4))),
        translation: DVec3::new(0.2, -0.1, 0.3),
        scale,
    }
}

/// A deterministic sequence in -1..1.
fn noise(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn marked(cameras: &[Camera], pose: &Similarity, per_frame: usize, pixels: f64) -> Vec<Correspondence> {
    let mut seed = 7;
    let mut points = Vec::new();
    for (frame, camera) in cameras.iter().enumerate() {
        let mut shared = 3;
        for _ in 0..per_frame {
            // The same mesh points in every frame.
            let mesh = [noise(&mut shared), noise(&mut shared), noise(&mut shared)].map(|v| 0.8 * v / pose.scale);
            let (pixel, _) = camera.project(pose.transform(DVec3::from_array(mesh)).to_array()).unwrap();
            let pixel = pixel.map(|v| v + pixels * noise(&mut seed));
            points.push(Correspondence { frame, pixel, mesh });
        }
    }
    points
}

/// Largest distance that the found pose moves a point of the unit cube from where it should be, in world units.
fn pose_error(found: &Alignment, truth: &Similarity) -> f64 {
    let mut worst: f64 = 0.0;
    for corner in 0..8 {
        let p = DVec3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64) / truth.scale;
        let q: [f64; 3] = std::array::from_fn(|i| {
            let row = found.pose[i];
            row[0] * p.x + row[1] * p.y + row[2] * p.z + row[3]
        });
        worst = worst.max((DVec3::from_array(q) - truth.transform(p)).length());
    }
    worst
}

#[test]
fn exact_points_give_the_exact_pose() {
    for (frames, per_frame, scale) in
        [(1, 6, None), (1, 20, None), (4, 8, Some(0.013)), (2, 3, None), (2, 4, Some(25.0))]
    {
        let (cameras, pose) = (ring(frames), truth(scale.unwrap_or(1.0)));
        let points = marked(&cameras, &pose, per_frame, 0.0);
        let found = align(&cameras, &points, scale.is_some()).unwrap();
        let error = pose_error(&found, &pose);
        assert!(
            error < 1e-8 && found.max_pixels < 1e-6,
            "{frames} {per_frame} {scale:?}: {error} {}",
            found.max_pixels
        );
        assert!((found.scale / pose.scale - 1.0).abs() < 1e-9);
    }
}

#[test]
fn noisy_points_give_a_near_pose() {
    // Half a pixel of uniform noise each way (0.41 px RMS) at a distance of 4 and 900 px focal length.
    let (cameras, pose) = (ring(5), truth(1.0));
    let points = marked(&cameras, &pose, 12, 0.5);
    let found = align(&cameras, &points, false).unwrap();
    let error = pose_error(&found, &pose);
    assert!(error < 1.5e-3, "{error}");
    assert!(
        (0.3..0.5).contains(&found.rms_pixels) && found.max_pixels < 1.0,
        "{} {}",
        found.rms_pixels,
        found.max_pixels
    );
    let scaled = truth(2.0);
    let found = align(&cameras, &marked(&cameras, &scaled, 12, 0.5), true).unwrap();
    assert!((found.scale / 2.0 - 1.0).abs() < 1e-3, "{}", found.scale);
    // One frame only: depth is the weak direction.
    let points = marked(&cameras[..1], &pose, 12, 0.5);
    let found = align(&cameras[..1], &points, false).unwrap();
    let error = pose_error(&found, &pose);
    assert!(error < 2e-2, "{error}");
    // A mistaken point stands out.
    let mut points = marked(&cameras, &pose, 12, 0.5);
    points[17].pixel[0] += 40.0;
    let found = align(&cameras, &points, false).unwrap();
    let worst = (0..points.len()).max_by(|&a, &b| found.errors_pixels[a].total_cmp(&found.errors_pixels[b]));
    assert_eq!(worst, Some(17));
}

#[test]
fn degenerate_points_are_named() {
    let (cameras, pose) = (ring(2), truth(1.0));
    let points = marked(&cameras[..1], &pose, 10, 0.0);
    let message = |points: &[Correspondence], scale| align(&cameras, points, scale).unwrap_err().to_string();
    assert!(message(&points[..5], false).contains("5 points are given, 6 at least"));
    assert!(message(&points, true).contains("second frame"));
    let project = |mut point: Correspondence, mesh: [f64; 3]| {
        point.mesh = mesh;
        point.pixel = cameras[point.frame].project(pose.transform(DVec3::from_array(mesh)).to_array()).unwrap().0;
        point
    };
    let flat: Vec<_> = points.iter().map(|p| project(*p, [p.mesh[0], p.mesh[1], 0.3 * p.mesh[0] + 0.1])).collect();
    assert!(message(&flat, false).contains("coplanar"));
    let line: Vec<_> = points.iter().map(|p| project(*p, [p.mesh[0], 2.0 * p.mesh[0], 0.1])).collect();
    assert!(message(&line, false).contains("collinear"));
    let same = vec![points[0]; 9];
    assert!(message(&same, false).contains("collinear"));
    // Coplanar points are enough when two frames see them.
    let both: Vec<_> = flat.iter().flat_map(|p| [*p, project(Correspondence { frame: 1, ..*p }, p.mesh)]).collect();
    assert!(pose_error(&align(&cameras, &both, false).unwrap(), &pose) < 1e-8);
    let stray = [&points[..], &[Correspondence { frame: 9, ..points[0] }]].concat();
    assert!(message(&stray, false).contains("frame 9"));
}

#[test]
fn apply_moves_and_keeps_the_outside_outside() {
    let mut mesh = Mesh { positions: vec![[1.0, 2.0, 3.0]; 3], triangles: vec![[0, 1, 2]] };
    apply_pose(&mut mesh, &[[0.0, -2.0, 0.0, 1.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, -1.0], [0.0, 0.0, 0.0, 1.0]]);
    assert_eq!((mesh.positions[0], mesh.triangles[0]), ([-3.0, 2.0, 5.0], [0, 1, 2]));
    apply_pose(&mut mesh, &[[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
    assert_eq!(mesh.triangles[0], [0, 2, 1]);
}
