//! Markers, poses and pictures with an object put in: on photographs, and on frames drawn here whose truth is known.

mod support;

use std::path::Path;
use support::shared;
use tsuya::asset::Camera;
use tsuya::capture::{Lens, read_radiance};
use tsuya::image::{Grid, to_srgb};
use tsuya::marker::detect::Detector;
use tsuya::marker::track::Tracker;
use tsuya::marker::{Family, Pose, Rig, estimate};

/// Rows of white (1) and black cells of marker 0, without its border.
const TAG36H11_0: [&str; 6] = ["110101", "011101", "011000", "101000", "010110", "000100"];
const ARUCO_0: [&str; 5] = ["10000"; 5];

fn grey(path: &Path) -> Grid<u8> {
    let code = |p: &[f32; 3]| (255.0 * to_srgb(p[1].clamp(0.0, 1.0) as f64)).round() as u8;
    read_radiance(path).unwrap().map(code)
}

fn camera(width: u32, height: u32, focal: f64) -> Camera {
    let principal = [0.5 * width as f64, 0.5 * height as f64];
    Camera { width, height, focal: [focal; 2], principal, rotation: Pose::IDENTITY.rotation, translation: [0.0; 3] }
}

/// A marker of side 0.1 on white paper, as a camera sees it before a grey wall, with noise.
fn draw(camera: &Camera, lens: &Lens, cells: &[&str], pose: &Pose, seed: u32) -> Grid<u8> {
    const SAMPLES: usize = 4;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let count = cells.len() as f64 + 2.0;
    let back = pose.inverse();
    let value = |x: f64, y: f64| {
        let bent = [(x - camera.principal[0]) / camera.focal[0], (y - camera.principal[1]) / camera.focal[1]];
        let Some([dx, dy]) = lens.undistort(bent) else { return 90.0 };
        let (from, to) = (back.apply([0.0; 3]), back.apply([dx, dy, 1.0]));
        let t = from[2] / (from[2] - to[2]);
        let [u, v] = [0, 1].map(|k| (from[k] + t * (to[k] - from[k])) / 0.1);
        if t <= 0.0 || u.abs() > 0.5 + 1.0 / count || v.abs() > 0.5 + 1.0 / count {
            return 90.0;
        }
        let (column, row) = ((u + 0.5) * count - 1.0, (0.5 - v) * count - 1.0);
        if u.abs() > 0.5 || v.abs() > 0.5 {
            return 225.0;
        }
        let cell = |k: f64| if k < 0.0 { None } else { Some(k as usize) };
        let white =
            cell(row).zip(cell(column)).and_then(|(r, c)| cells.get(r)?.as_bytes().get(c)).is_some_and(|&b| b == b'1');
        if white { 225.0 } else { 25.0 }
    };
    // Only around the marker the samples are worth it.
    let reach = 0.1 * camera.focal[0] / pose.translation[2] * 1.1;
    let corner = pose.apply([0.0; 3]);
    let (cx, cy) = {
        let [x, y] = lens.distort([corner[0] / corner[2], corner[1] / corner[2]]);
        (camera.focal[0] * x + camera.principal[0], camera.focal[1] * y + camera.principal[1])
    };
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let mut noise = || {
        // The sum of four is near enough to a Gaussian; standard deviation 2.
        let mut sum = 0.0;
        for _ in 0..4 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            sum += (state >> 8) as f64 / (1u32 << 24) as f64 - 0.5;
        }
        sum * 2.0 * 3f64.sqrt()
    };
    let mut picture = Grid::filled(width, height, 0u8);
    for k in 0..picture.data.len() {
        let (x, y) = ((k % width) as f64, (k / width) as f64);
        let n = if (x - cx).abs() < reach && (y - cy).abs() < reach { SAMPLES } else { 1 };
        let at = |i: usize| (i as f64 + 0.5) / n as f64;
        let sum: f64 = (0..n * n).map(|i| value(x + at(i % n), y + at(i / n))).sum();
        picture.data[k] = (sum / (n * n) as f64 + noise()).round().clamp(0.0, 255.0) as u8;
    }
    picture
}

/// The print's axes in the camera's, first as if hung before it, then turned about x, y and z (degrees), at a place.
fn posed([x, y, z]: [f64; 3], translation: [f64; 3]) -> Pose {
    let turn = |axis: usize, degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut rotation = Pose::IDENTITY.rotation;
        (rotation[i][i], rotation[i][j], rotation[j][i], rotation[j][j]) = (c, -s, s, c);
        Pose { rotation, translation: [0.0; 3] }
    };
    let hung = turn(0, 180.0);
    let Pose { rotation, .. } = turn(2, z).after(&turn(1, y)).after(&turn(0, x)).after(&hung);
    Pose { rotation, translation }
}

#[test]
fn photographs_on_a_turntable() {
    let Some(folder) = shared("ar/apriltag") else { return };
    // As test_info.yaml has it.
    let camera =
        Camera { focal: [329.8729619143081, 332.94611303946357], principal: [528.0, 396.0], ..camera(1056, 792, 1.0) };
    let rig = Rig::single(Family::Tag36h11, None, 0.065).unwrap();
    let mut detector = Detector::new(&[Family::Tag36h11]).unwrap();
    let mut found = Vec::new();
    for angle in [-60, -30, 0, 30, 60] {
        let picture = grey(&folder.join(format!("test_image_rotation_{angle}.png")));
        let detections = detector.detect(&picture, false).unwrap();
        assert!(detections.len() == 1, "{angle}: {detections:?}");
        let best = estimate(&camera, &Lens::Pinhole, &rig, &detections)[0];
        println!("{angle}: {:?}, {:.3} pixels at most", best.pose, best.max_pixels);
        assert!(best.max_pixels < 1.0, "{angle}: {best:?}");
        found.push((angle as f64, best.pose));
    }
    for (a, one) in &found {
        for (b, other) in &found {
            let error = (one.angle_to(other).to_degrees() - (a - b).abs()).abs();
            println!("{a} to {b}: {error:.2} degrees off");
            assert!(error < 1.5, "{a} to {b}: {error}");
        }
    }
}

#[test]
fn a_moving_tag_is_followed() {
    let lens = Lens::Radial { numerator: [-0.12, 0.03, 0.0, 0.0], denominator: [0.0; 3], tangential: [0.001, -0.002] };
    for lens in [Lens::Pinhole, lens] {
        let camera = camera(640, 480, 600.0);
        let mut tracker = Tracker::new(Rig::parse("tag36h11:0:0.1").unwrap(), camera, lens).unwrap();
        let (mut worst_turn, mut worst_place) = (0.0f64, 0.0f64);
        for frame in 0..100 {
            let t = frame as f64 / 100.0 * std::f64::consts::TAU;
            // Tilting to both sides through facing the camera, near and far.
            let turned = [35.0 * (2.0 * t).sin(), 55.0 * t.sin(), 40.0 * (3.0 * t).cos()];
            let distance = 0.65 - 0.25 * (2.0 * t).cos();
            let truth = posed(turned, [0.2 * distance * t.cos(), 0.15 * distance * (2.0 * t).sin(), distance]);
            let picture = draw(&camera, &lens, &TAG36H11_0, &truth, frame);
            let Some((found, _)) = tracker.next(&picture).unwrap() else { panic!("frame {frame}: not found") };
            let turn = found.pose.angle_to(&truth).to_degrees();
            let gap: [f64; 3] = std::array::from_fn(|k| found.pose.translation[k] - truth.translation[k]);
            let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let place = length(gap) / length(truth.translation);
            assert!(turn < 1.0 && place < 0.01, "frame {frame}, {turned:?}: {turn} degrees, {place}, {found:?}");
            (worst_turn, worst_place) = (worst_turn.max(turn), worst_place.max(place));
        }
        println!("at most {worst_turn:.2} degrees, {:.2} % of the distance", 100.0 * worst_place);
    }
}

#[test]
fn aruco_markers_and_rigs() {
    let camera = camera(640, 480, 600.0);
    let truth = posed([25.0, -30.0, 12.0], [0.05, -0.02, 0.6]);
    let picture = draw(&camera, &Lens::Pinhole, &ARUCO_0, &truth, 1);
    let rig = Rig::parse("aruco:0:0.1").unwrap();
    let found = Detector::new(&rig.families()).unwrap().detect(&picture, false).unwrap();
    let best = estimate(&camera, &Lens::Pinhole, &rig, &found)[0];
    let turn = best.pose.angle_to(&truth).to_degrees();
    println!("aruco: {turn:.2} degrees, {best:?}");
    assert!(found.len() == 1 && turn < 1.0 && best.max_pixels < 1.0, "{turn} {best:?}");

    // Two markers, the second a hand's breadth to the right and turned by a quarter: corners projected, not drawn.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.json");
    let text = r#"{"markers": [{"family": "tag36h11", "id": 3, "size": 0.08},
        {"family": "tag36h11", "id": 4, "size": 0.05, "pose": [[0, 0, 1, 0.2], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]}]}"#;
    std::fs::write(&path, text).unwrap();
    let rig = Rig::read(&path).unwrap();
    let project = |x: [f64; 3]| camera.project(truth.apply(x)).unwrap().0;
    let detections: Vec<_> = (rig.markers.iter())
        .map(|m| tsuya::marker::detect::Detection {
            family: m.family,
            id: m.id.unwrap(),
            corners: m.corners().map(project),
        })
        .collect();
    let best = estimate(&camera, &Lens::Pinhole, &rig, &detections)[0];
    assert!(best.markers == 2 && best.pose.angle_to(&truth) < 1e-6 && best.rms_pixels < 1e-6, "{best:?}");
    for (wrong, said) in [("0.08", "-1"), ("tag36h11", "tag99"), ("\"id\": 4", "\"id\": 3")].map(|(from, to)| {
        std::fs::write(&path, text.replace(from, to)).unwrap();
        (to, Rig::read(&path).unwrap_err().to_string())
    }) {
        assert!(said.contains("rig.json: line"), "{wrong}: {said}");
    }
    assert!(Rig::parse("tag36h11:0:big").is_err() && Rig::parse("tag36h11:0:0").is_err());
}
