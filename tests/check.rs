//! The check of captures: what is wrong is named, what is right is not doubted.

use crate::support::{bundled, complaint, json, sample, shared, text, tsuya, variant};
use tsuya::Camera;
use tsuya::capture::{Agreement, Capture, CaptureReadOptions, agreement, read};
use tsuya::image::Grid;

fn unchecked(path: &std::path::Path) -> Capture {
    read(path, &CaptureReadOptions { unchecked: true, ..Default::default() }).unwrap()
}

/// A copy with other photographs in the frames' places, their masks staying.
fn reordered(right: &Capture, order: impl Fn(usize) -> usize) -> Capture {
    let mut wrong = right.clone();
    for (k, frame) in wrong.frames.iter_mut().enumerate() {
        let other = &right.frames[order(k) % right.frames.len()];
        (frame.photograph, frame.cross) = (other.photograph.clone(), other.cross.clone());
    }
    wrong
}

fn with_cameras(right: &Capture, change: impl Fn(&mut Camera)) -> Capture {
    let mut wrong = right.clone();
    wrong.frames.iter_mut().for_each(|frame| change(&mut frame.view.camera));
    wrong
}

fn with_mesh(right: &Capture, change: impl Fn([f32; 3]) -> [f32; 3]) -> Capture {
    let mut wrong = right.clone();
    wrong.mesh.positions.iter_mut().for_each(|p| *p = change(*p));
    wrong
}

/// The capture with the left sixth of each picture cut away: its principal point is not in the middle.
fn cropped(right: &Capture) -> Capture {
    fn crop<T: Clone>(grid: &Grid<T>, left: usize) -> Grid<T> {
        let data = (0..grid.height).flat_map(|y| grid.row(y)[left..].to_vec()).collect();
        Grid { width: grid.width - left, height: grid.height, data }
    }
    let mut cropped = right.clone();
    for frame in &mut cropped.frames {
        let left = frame.photograph.width / 6;
        frame.photograph = crop(&frame.photograph, left);
        frame.cross = frame.cross.as_ref().map(|cross| crop(cross, left));
        frame.mask = frame.mask.as_ref().map(|mask| crop(mask, left));
        frame.view.camera.width -= left as u32;
        frame.view.camera.principal[0] -= left as f64;
    }
    cropped
}

/// The capture with its photographs turned by 180 degrees.
fn upside_down(right: &Capture) -> Capture {
    let mut wrong = right.clone();
    for frame in &mut wrong.frames {
        frame.photograph.data.reverse();
        frame.cross.iter_mut().for_each(|cross| cross.data.reverse());
        frame.mask.iter_mut().for_each(|mask| mask.data.reverse());
    }
    wrong
}

fn with_a_camera_inside(right: &Capture, inside: [f64; 3]) -> Capture {
    let mut wrong = right.clone();
    let camera = &mut wrong.frames[3].view.camera;
    camera.translation = [0.0; 3];
    camera.translation = camera.to_camera(inside).map(|x| -x);
    wrong
}

fn transposed(r: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]))
}

/// Mistakes of the mesh and the cameras, and what is said of them.
fn wrong_geometry(right: &Capture) -> Vec<(Capture, &'static str)> {
    vec![
        (with_mesh(right, |p| p.map(|x| 1000.0 * x)), "set mesh_scale to 0.001"),
        (with_mesh(right, |p| p.map(|x| 0.001 * x)), "set mesh_scale to 1000"),
        (
            with_mesh(right, |[x, y, z]| [x, -z, y]),
            "set its pose to [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]",
        ),
        // nerfstudio's applied_transform, which the mesh was not taken through.
        (
            with_mesh(right, |[x, y, z]| [y, x, -z]),
            "made before an applied_transform?); set its pose to [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]",
        ),
        (
            with_cameras(right, |camera| {
                for row in 1..3 {
                    camera.rotation[row] = camera.rotation[row].map(|x| -x);
                    camera.translation[row] *= -1.0;
                }
            }),
            "in OpenCV's axes (y down, z forward), not in OpenGL's",
        ),
        (
            // World to camera in OpenGL's axes, read as camera to world.
            with_cameras(right, |camera| {
                let flip = |r: [[f64; 3]; 3]| [r[0], r[1].map(|x| -x), r[2].map(|x| -x)];
                let (to_camera, t) =
                    (flip(camera.rotation), [camera.translation[0], -camera.translation[1], -camera.translation[2]]);
                camera.rotation = flip(transposed(to_camera));
                camera.translation = [0.0; 3];
                camera.translation = camera.to_camera(t).map(|x| -x);
            }),
            "world to camera, not camera to world",
        ),
        (
            with_cameras(right, |camera| {
                let centre = camera.centre();
                (camera.rotation, camera.translation) = (transposed(camera.rotation), centre);
            }),
            "camera to world, not world to camera",
        ),
        (
            with_cameras(right, |camera| camera.focal = camera.focal.map(|f| 0.7 * f)),
            "the focal lengths are not those of the photographs",
        ),
        (
            with_cameras(right, |camera| {
                [camera.focal, camera.principal] =
                    [camera.focal, camera.principal].map(|values| values.map(|x| 2.0 * x));
            }),
            "those of pictures of 2 times the size",
        ),
        (with_cameras(&cropped(right), |camera| camera.principal.swap(0, 1)), "exchange cx and cy"),
        (upside_down(right), "upside down beside their cameras"),
    ]
}

/// Mistakes of the photographs' order.
fn wrong_order(right: &Capture) -> Vec<(Capture, &'static str)> {
    let count = right.frames.len();
    let step = [7, 5].into_iter().find(|&step| !count.is_multiple_of(step)).unwrap();
    let last = count - count % 2;
    vec![
        (reordered(right, |k| step * k + 3), "are not those of their cameras"),
        (reordered(right, |k| if k < last { k ^ 1 } else { k }), "are not those of their cameras"),
        (reordered(right, |k| [0, 1, 3, 2].get(k).copied().unwrap_or(k)), "2 of"),
        (reordered(right, |k| k + 1), "each is that of the camera after it"),
        (reordered(right, |k| count - 1 - k), "in reversed order"),
    ]
}

fn wrong_masks(right: &Capture) -> Vec<(Capture, &'static str)> {
    let mut inverted = right.clone();
    inverted
        .frames
        .iter_mut()
        .flat_map(|frame| frame.mask.as_mut())
        .flat_map(|m| &mut m.data)
        .for_each(|shown| *shown = !*shown);
    // Poses permuted: masks go with their photographs.
    let mut permuted = right.clone();
    for (k, frame) in permuted.frames.iter_mut().enumerate() {
        frame.view.camera = right.frames[(5 * k + 2) % right.frames.len()].view.camera;
    }
    let mut inwards = right.clone();
    inwards.mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    vec![
        (inverted, "the masks are inverted"),
        (permuted, "are not those of their cameras"),
        (inwards, "it is wound inwards"),
    ]
}

fn expect(found: &Agreement, words: &str) {
    let sentences = found.sentences().join("; ");
    assert!(sentences.contains(words), "expected: {words}\n{sentences}\n{found:?}");
}

fn expect_all(wrong: Vec<(Capture, &'static str)>) -> usize {
    for (capture, words) in &wrong {
        expect(&agreement(capture), words);
    }
    wrong.len()
}

fn expect_none(capture: &Capture, name: &str) -> Agreement {
    let found = agreement(capture);
    assert_eq!(found.sentences(), [""; 0], "{name}: {found:?}");
    assert!(!found.is_refused());
    found
}

#[test]
fn wrong_variants_of_the_sample_are_named() {
    let right = unchecked(&sample());
    let found = expect_none(&right, "sample");
    assert!(found.photo_consistency.unwrap() > 0.85 && found.permuted_consistency.unwrap().abs() < 0.1, "{found:?}");
    expect_none(&cropped(&right), "cropped");
    let named = expect_all(wrong_geometry(&right)) + expect_all(wrong_order(&right)) + expect_all(wrong_masks(&right));
    assert_eq!(named, 19);
    let inside = agreement(&with_a_camera_inside(&right, [0.0; 3]));
    expect(&inside, "1 camera is inside the mesh (off/003.exr)");
    assert_eq!(inside.cameras_inside, ["off/003.exr"]);
    // The cow is as good as symmetric from left to right: mirrored from top to bottom she is turned as well.
    expect(&agreement(&with_mesh(&right, |[x, y, z]| [x, -y, z])), "set its pose to");
    // By its photographs alone.
    let without_masks = reordered(&right, |k| k ^ 1);
    let moved = agreement(&without_masks).misplaced.unwrap();
    assert_eq!((moved.photographs.len(), moved.pattern), (36, Some("two and two exchanged")));
    assert_eq!(moved.photographs[0], ["off/001.exr", "off/000.exr"]);
    assert!(moved.given_consistency < 0.2 && moved.found_consistency > 0.85, "{moved:?}");
}

#[test]
fn captures_that_are_right_are_not_doubted() {
    for name in ["unpolarised", "lens", "sizes"] {
        expect_none(&unchecked(&bundled(name)), name);
    }
    let field = [
        "13-winding-inverted",
        "14-utm-coordinates",
        "15-colmap-no-empty-lines",
        "19-blender-synthetic",
        "23-obj-shift-jis",
    ];
    let mut all =
        ["bunny-ring", "bunny-clean", "sample-spot", "spot-dome"].map(|name| format!("captures/{name}")).to_vec();
    all.push("multiview/templeRing".into());
    all.extend(field.map(|name| format!("../cases/field/{name}")));
    for path in all.iter().filter_map(|name| shared(name)) {
        let mut capture = unchecked(&path);
        if path.ends_with("13-winding-inverted") {
            capture.mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        }
        expect_none(&capture, text(&path));
    }
}

#[test]
fn wrong_variants_of_larger_captures_are_named() {
    if let Some(path) = shared("captures/bunny-ring") {
        let right = unchecked(&path);
        expect_all(wrong_geometry(&right));
        expect_all(wrong_order(&right));
        expect_all(wrong_masks(&right));
        expect(&agreement(&with_mesh(&right, |[x, y, z]| [x, -y, z])), "the mesh is mirrored");
        expect(&agreement(&with_a_camera_inside(&right, [0.0; 3])), "inside the mesh (off/003.exr)");
    }
    // Without masks: by its photographs alone.
    if let Some(path) = shared("multiview/templeRing") {
        let right = unchecked(&path);
        expect_all(wrong_geometry(&right));
        expect_all(wrong_order(&right));
        let [x, y, z] = right.mesh.positions[0].map(f64::from);
        let (middle, _) = right.mesh.bounding_sphere();
        let inwards = |p: f64, m: f64| p + 0.01 * (m - p);
        let inside = [inwards(x, middle[0]), inwards(y, middle[1]), inwards(z, middle[2])];
        let found = agreement(&with_a_camera_inside(&right, inside));
        assert!(
            found.sentences().join("; ").contains("templeR0004") || found.nearest_camera.unwrap() < 0.02,
            "{found:?}"
        );
    }
}

#[test]
fn the_program_says_what_is_wrong() {
    let shuffled = variant(36, |description, _| {
        let frames = description["frames"].as_array_mut().unwrap();
        let poses: Vec<_> = frames.iter().map(|frame| frame["transform_matrix"].clone()).collect();
        frames
            .iter_mut()
            .zip(poses.into_iter().cycle().skip(1))
            .for_each(|(frame, pose)| frame["transform_matrix"] = pose);
    });
    let run = tsuya(&["check", text(shuffled.path()), "--json"]).code(4);
    let found: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    assert_eq!(found["agreement"]["misplaced"]["photographs"].as_array().unwrap().len(), 36, "{found}");
    assert_eq!(found["agreement"]["misplaced"]["pattern"], "each is that of the camera before it");
    assert!(found["faults"][0].as_str().unwrap().contains("check the names and the order"), "{found}");
    let file = shuffled.path().join("out.tsuya");
    let refused = complaint(3, &["encode", text(shuffled.path()), "-o", text(&file)]);
    assert!(refused.contains("are not those of their cameras") && refused.contains("unchecked"), "{refused}");
    let right = json(&["check", text(&sample()), "--json"]);
    assert_eq!((&right["agrees"], &right["faults"]), (&true.into(), &serde_json::json!([])), "{right}");
}
