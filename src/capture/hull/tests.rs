use super::*;
use crate::image::Mask;
use crate::input::FileAccess;
use crate::views::Camera;
use glam::{DMat3, DVec3};
use silhouette::Silhouette;
use std::collections::BTreeMap;

/// Cameras all around the origin at distance 5 that see what `inside` says of the ray through each pixel.
fn views(inside: impl Fn(DVec3, DVec3) -> bool, ring: bool) -> Vec<Silhouette> {
    let mut all = Vec::new();
    for k in 0..24 {
        let azimuth = f64::from(k) * 2.4;
        let height = if ring { 0.3 } else { f64::from(k) / 12.0 - 1.0 + 1.0 / 24.0 };
        let back = DMat3::from_rotation_y(azimuth) * DVec3::new(0.0, height, (1.0 - height * height).sqrt());
        let right = DVec3::Y.cross(back).normalize();
        let down = right.cross(back);
        let rotation = [right, down, -back].map(|axis| axis.to_array());
        let (width, height) = (160, 120);
        let focal = [150.0; 2];
        let camera = Camera { width, height, focal, principal: [80.0, 60.0], rotation, translation: [0.0, 0.0, 5.0] };
        let mut mask = Mask::filled(width as usize, height as usize, false);
        for y in 0..height as usize {
            for x in 0..width as usize {
                let ray = DVec3::from_array(camera.ray([x as f64 + 0.5, y as f64 + 0.5])).normalize();
                *mask.value_at_mut(x, y) = inside(5.0 * back, ray);
            }
        }
        all.extend(Silhouette::new(&camera, &mask));
    }
    all
}

/// A ray through a ball.
fn ball(origin: DVec3, ray: DVec3, centre: DVec3, radius: f64) -> bool {
    (centre - origin).reject_from_normalized(ray).length() < radius
}

fn hull(views: &[Silhouette], resolution: u32) -> (Mesh, f64) {
    let path = Path::new("some");
    let bounds = field::bounds(path, views).unwrap();
    let grid = field::FieldGrid::new(&bounds, resolution);
    let mut mesh = contour::extract(path, &grid, views, &FileAccess::default()).unwrap();
    finish::keep_large_parts(&mut mesh);
    finish::smooth(&mut mesh, grid.cell);
    (mesh, grid.cell)
}

/// Checks that each edge has a triangle on either side, and returns the volume.
fn volume_of_closed(mesh: &Mesh) -> f64 {
    let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
    let mut volume = 0.0;
    for &triangle in &mesh.triangles {
        for k in 0..3 {
            *edges.entry((triangle[k], triangle[(k + 1) % 3])).or_default() += 1;
        }
        let [a, b, c] = triangle.map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
        volume += a.dot(b.cross(c)) / 6.0;
    }
    assert!(edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1)));
    volume
}

#[test]
fn a_ball_comes_back_as_a_ball() {
    let views = views(|origin, ray| ball(origin, ray, DVec3::new(0.2, 0.1, -0.1), 1.0), false);
    for resolution in [24, 60] {
        let (mesh, cell) = hull(&views, resolution);
        let volume = volume_of_closed(&mesh);
        let exact = 4.0 / 3.0 * std::f64::consts::PI;
        // The hull of 24 views is larger than the ball between them.
        assert!((0.98..1.1).contains(&(volume / exact)), "{resolution}: {volume} of {exact}");
        let off = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from)).distance(DVec3::new(0.2, 0.1, -0.1)) - 1.0;
        let least = mesh.positions.iter().map(off).fold(f64::INFINITY, f64::min);
        assert!(least > -(0.5 * cell + 0.02), "{resolution}: {least}");
    }
}

#[test]
fn parts_and_specks() {
    let (far, speck) = (DVec3::new(1.2, 0.0, 0.0), DVec3::new(-1.3, 0.0, 0.0));
    let two = views(|o, r| ball(o, r, -0.3 * far, 0.6) || ball(o, r, far, 0.3) || ball(o, r, speck, 0.06), false);
    let path = Path::new("some");
    let grid = field::FieldGrid::new(&field::bounds(path, &two).unwrap(), 64);
    let mut mesh = contour::extract(path, &grid, &two, &FileAccess::default()).unwrap();
    assert_eq!(finish::keep_large_parts(&mut mesh), 1);
    let volume = volume_of_closed(&mesh);
    let exact = 4.0 / 3.0 * std::f64::consts::PI * (0.6f64.powi(3) + 0.3f64.powi(3));
    assert!((0.95..1.15).contains(&(volume / exact)), "{volume} of {exact}");
}

#[test]
fn every_case_of_a_cell_is_closed_with_its_neighbours() {
    // Values at random on a small grid: all cases, ambiguous ones, too.
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
    };
    let side = 12;
    let values: Vec<f64> = (0..side * side * side)
        .map(|k| {
            let at = [k % side, k / side % side, k / (side * side)];
            if at.iter().any(|&k| k == 0 || k == side - 1) { -0.1 } else { random() }
        })
        .collect();
    let mesh = contour::contour_values(&values, side);
    assert!(mesh.triangles.len() > 2000);
    assert!(volume_of_closed(&mesh) > 0.0);
}

#[test]
fn hulls_that_are_not_are_errors() {
    let path = Path::new("some");
    let ball_at = |centre: DVec3| move |o: DVec3, r: DVec3| ball(o, r, centre, 0.5);
    // One camera bounds nothing; cameras that see different things have nothing in common.
    let one = views(ball_at(DVec3::ZERO), true);
    let error = field::bounds(path, &one[..1]).unwrap_err().to_string();
    assert!(error.contains("photographs from more sides"), "{error}");
    let mut apart = views(ball_at(DVec3::new(0.0, 0.9, 0.0)), true);
    apart.truncate(12);
    apart.extend(views(ball_at(DVec3::new(0.0, -0.9, 0.0)), true));
    let error = field::bounds(path, &apart).unwrap_err().to_string();
    assert!(error.contains("no point is in all silhouettes"), "{error}");
}

#[test]
fn the_sample_has_a_hull_around_its_mesh() {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sample-spot");
    let hull = visual_hull(&sample, &HullOptions::default()).unwrap();
    assert!(
        hull.views == 36 && hull.warnings.iter().all(|said| said.contains("specks of the hull")),
        "{:?}",
        hull.warnings
    );
    let volume = volume_of_closed(&hull.mesh);
    let capture = crate::capture::read(&sample, &CaptureReadOptions::default()).unwrap();
    let scan = crate::capture::Capture { mesh: hull.mesh.clone(), ..capture.clone() };
    let agreement = crate::capture::agreement(&scan);
    assert!(agreement.silhouette_iou.unwrap() > 0.95 && agreement.front_facing.unwrap() > 0.99, "{agreement:?}");
    let own: f64 = capture
        .mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| DVec3::from_array(capture.mesh.positions[v as usize].map(f64::from)));
            a.dot(b.cross(c)) / 6.0
        })
        .sum();
    assert!((1.0..1.5).contains(&(volume / own)), "{volume} around {own}");
    // The same on one thread, and finer when asked for.
    let fine = visual_hull(&sample, &HullOptions { resolution: Some(100), ..Default::default() }).unwrap();
    assert!(fine.resolution == 100 && fine.cell < hull.cell);
    let error = visual_hull(&sample, &HullOptions { resolution: Some(4), ..Default::default() }).unwrap_err();
    assert!(matches!(error, Error::Parameter(_)));
    // Frames of one camera under two lights, of which the second does not reach all that its masks should show.
    if let Some(dome) = crate::capture::tests::data("captures/spot-dome") {
        assert_eq!(visual_hull(dome, &HullOptions::default()).unwrap().views, 36);
    }
    let reading = CaptureReadOptions {
        limits: crate::Limits { memory_bytes: 1 << 20, ..Default::default() },
        ..Default::default()
    };
    let error = visual_hull(&sample, &HullOptions { reading, ..Default::default() }).err();
    assert!(matches!(error, Some(Error::InputMemory { .. })), "{error:?}");
}

#[test]
fn photographs_without_masks_need_a_dark_background() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = Vec::new();
    for (k, pose) in
        ["[[1,0,0,0],[0,1,0,0],[0,0,1,5]]", "[[0,0,1,5],[0,1,0,0],[-1,0,0,0]]", "[[1,0,0,0],[0,0,1,5],[0,-1,0,0]]"]
            .iter()
            .enumerate()
    {
        // A bright square with a dark hole before a background that is nearly black.
        let level = |x: u32, y: u32| match (x.abs_diff(30).max(y.abs_diff(20)), x.abs_diff(30).max(y.abs_diff(20)) < 3)
        {
            (_, true) => 0u8,
            (off, _) if off < 10 => 200,
            _ => 9,
        };
        image::GrayImage::from_fn(60, 40, |x, y| image::Luma([level(x, y)]))
            .save(folder.path().join(format!("{k}.png")))
            .unwrap();
        frames.push(format!("{{\"file_path\": \"{k}.png\", \"transform_matrix\": {pose}}}"));
    }
    let text = format!("{{\"w\": 60, \"h\": 40, \"fl_x\": 50, \"frames\": [{}]}}", frames.join(","));
    std::fs::write(folder.path().join("transforms.json"), text).unwrap();
    let error = visual_hull(folder.path(), &HullOptions::default()).err().unwrap().to_string();
    assert!(error.contains("no view has a mask") && error.contains("option `dark_background`"), "{error}");
    let options = HullOptions { dark_background: Some(0.1), ..HullOptions::default() };
    let hull = visual_hull(folder.path(), &options).unwrap();
    // Three pyramids of 19 pixels at distance 5 meet in a little more than a cube: each side 5 * 19 / 50 at the middle.
    let volume = volume_of_closed(&hull.mesh);
    assert!((5.5..8.5).contains(&volume), "{volume}");
}
