use super::photograph::PhotographReading;
use super::test_capture::{POSE, Small, sample};
use super::*;
use crate::image::{ColorSpace, Mask};
use std::fs;

/// Shared test data, where it is there.
pub(super) fn data(part: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TSUYA_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(part);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

#[test]
fn the_sample_reads_as_measured() {
    let capture = read(sample(), &CaptureReadOptions::default()).unwrap();
    assert_eq!((capture.name.as_str(), capture.frames.len()), ("sample-spot", 36));
    assert_eq!((capture.mesh.positions.len(), capture.mesh.triangles.len()), (752, 1500));
    assert_eq!((capture.skipped_frames, capture.missing_pixels), (0, 0));
    assert!(capture.warnings.is_empty(), "{:?}", capture.warnings);
    assert_eq!(capture.color_space, "linear-rec709");
    // Figures of an independent reader.
    let white = [1.0293731689453125, 0.9779090881347656, 0.9007015228271484];
    (0..3).for_each(|c| assert!((capture.white[c] - white[c]).abs() < 1e-6, "{:?}", capture.white));
    let beta = capture.beta.unwrap();
    assert!(beta.iter().all(|b| (b - 0.25).abs() < 1e-3), "{beta:?}");
    // The mask and the mesh must be in the same place: mesh vertices project into the mask, but for its border.
    let frame = &capture.frames[7];
    let mask = frame.mask.as_ref().unwrap();
    let project = |p: &[f32; 3]| frame.view.camera.project(p.map(f64::from)).unwrap().0;
    let inside = |[x, y]: [f64; 2]| *mask.value_at(x as usize, y as usize);
    let share = capture.mesh.positions.iter().filter(|p| inside(project(p))).count() as f64 / 752.0;
    assert!(share > 0.96, "{share}");
    let light = frame.view.light.unwrap();
    (0..3).for_each(|c| assert!((light.intensity[c] - [60.48, 57.456, 52.92][c]).abs() < 1e-12));
}

#[test]
fn white_boards_of_the_shared_captures() {
    // These figures were summed in single precision, hence the tolerance.
    let figures = [
        ("captures/bunny-ring", 36, [1.0293755531311035, 0.9779027104377747, 0.9007015228271484]),
        ("captures/spot-dome", 72, [1.029374122619629, 0.9779057502746582, 0.9007054567337036]),
    ];
    for (part, frames, white) in figures {
        let Some(path) = data(part) else { continue };
        let description = describe(path.join("transforms.json"), &FileAccess::default()).unwrap();
        assert_eq!(description.frames.len(), frames);
        let (access, space) = (FileAccess::default(), ColorSpace::from_name("srgb").unwrap());
        let reading = PhotographReading { access: &access, space: &space };
        let found =
            white::BoardRadiance::of_reference(&description.white_reference.unwrap(), reading).unwrap().photograph;
        (0..3).for_each(|c| assert!((found[c] - white[c]).abs() < 4e-6, "{part} {:?}", found));
    }
}

#[test]
fn temple_ring_reads_from_colmap() {
    let Some(path) = data("multiview/templeRing") else { return };
    let capture = read(&path, &CaptureReadOptions::default()).unwrap();
    assert_eq!((capture.name.as_str(), capture.frames.len()), ("templeRing", 47));
    assert!((capture.mesh.triangles.len() as i64 - 10_000).abs() < 100);
    let frame = &capture.frames[0];
    assert_eq!((frame.view.name.as_str(), frame.view.light), ("templeR0001.png", None));
    assert!(frame.mask.is_none() && frame.cross.is_none() && capture.beta.is_none());
    assert_eq!((frame.photograph.width, frame.photograph.height), (640, 480));
    // The plaster is bright and the background dark where the hull projects and where it does not.
    let mut covered = Mask::filled(640, 480, false);
    for position in &capture.mesh.positions {
        let ([x, y], _) = frame.view.camera.project(position.map(f64::from)).unwrap();
        for dy in -2..3 {
            for dx in -2..3 {
                *covered.value_at_mut((x as i64 + dx).clamp(0, 639) as usize, (y as i64 + dy).clamp(0, 479) as usize) =
                    true;
            }
        }
    }
    let mean = |inside: bool| {
        let values =
            frame.photograph.data.iter().zip(&covered.data).filter(|(_, m)| **m == inside).map(|(p, _)| p[1] as f64);
        values.clone().sum::<f64>() / values.count() as f64
    };
    assert!(mean(true) > 8.0 * mean(false), "{} {}", mean(true), mean(false));
}

#[test]
fn polarised_captures_have_beta_and_white() {
    let small = Small::new(true);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!((capture.white, capture.beta.unwrap()), ([2.0, 2.0, 4.0], [0.5, 0.8f32 as f64 / 2.0, 0.25]));
    assert_eq!(capture.frames.len(), 3);
    assert_eq!(*capture.frames[1].photograph.value_at(3, 2), [3.0, 2.0, 1.0]);
    assert_eq!(capture.frames[1].cross.as_ref().unwrap().value_at(5, 0)[0], 2.0);
    let given = small.read(&CaptureReadOptions { beta: Some([0.3; 3]), ..Default::default() }).unwrap();
    assert_eq!(given.beta, Some([0.3; 3]));
    assert!(small.read(&CaptureReadOptions { beta: Some([0.3, 0.0, 0.3]), ..Default::default() }).is_err());

    let mut without_board = Small::new(true);
    without_board.keys.clear();
    assert!(without_board.error().contains("`beta`"));
    let given = without_board.read(&CaptureReadOptions { beta: Some([0.3; 3]), ..Default::default() }).unwrap();
    assert_eq!(given.white, [1.0; 3]);

    // A frame without cross photograph among others that have one.
    let mut mixed = Small::new(true);
    mixed.frames[1] = format!("\"file_path\": \"1.exr\", \"transform_matrix\": {POSE}");
    let capture = mixed.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!((capture.frames.len(), capture.skipped_frames), (2, 1));
    assert!(
        capture.warnings[0].contains("1 frames without a cross photograph skipped")
            && capture.warnings[0].contains("1.exr")
    );

    small.picture("white.exr", |_, _| (f32::NAN, 1.0, 1.0));
    assert!(small.error().contains("white.exr: the white board has a mean radiance of [NaN, NaN, NaN]"));
    fs::remove_file(small.path("white_cross.exr")).unwrap();
    assert!(small.read(&CaptureReadOptions::default()).is_err());
}

#[test]
fn a_board_in_each_photograph_makes_them_equal() {
    let mut small = Small::new(true);
    small.keys = ", \"white_region\": [12, 8, 4, 4]".into();
    for (k, [light, ratio]) in [[1.0, 0.5], [2.0, 0.4], [0.25, 0.6]].into_iter().enumerate() {
        let board = |x: usize, y: usize| x >= 12 && y >= 8;
        let value = |x: usize, y: usize| if board(x, y) { 0.8 * light } else { 0.01 * light * (x + y) as f32 };
        small.picture(&format!("{k}.exr"), |x, y| (value(x, y), value(x, y), 0.5 * value(x, y)));
        small.picture(&format!("c{k}.exr"), |x, y| (ratio * value(x, y), ratio * value(x, y), 0.5 * value(x, y)));
    }
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(
        near(capture.white, [0.8, 0.8, 0.4]) && near(capture.beta.unwrap(), [0.5, 0.5, 1.0]),
        "{:?}",
        capture.white
    );
    for frame in &capture.frames {
        let [off, on] = [&frame.photograph, frame.cross.as_ref().unwrap()].map(|image| image.value_at(5, 6)[0]);
        assert!((off - 0.11).abs() < 1e-6 && (on - 0.055).abs() < 1e-6, "{off} {on}");
    }
    // A reference of its own comes first; a frame without a board stays as it is.
    small.picture("white.exr", |_, _| (1.6, 1.6, 1.6));
    small.picture("white_cross.exr", |_, _| (0.8, 0.8, 0.8));
    small.keys =
        ", \"white_reference\": {\"file_path\": \"white.exr\", \"cross_file_path\": \"white_cross.exr\"}".into();
    small.frames.iter_mut().take(2).for_each(|frame| *frame += ", \"white_region\": [12, 8, 4, 4]");
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let values = [0, 1, 2].map(|k: usize| capture.frames[k].photograph.value_at(5, 6)[0]);
    assert!(values.iter().zip([0.22, 0.22, 0.0275]).all(|(a, b)| (a - b).abs() < 1e-6), "{values:?}");
    assert!(capture.warnings.iter().any(|warning| warning.contains("1 frames show no white board")));
    for (region, said) in [
        ("[12, 8, 5, 4]", "1.exr: its white_region leaves its 16 x 12 pixels"),
        ("[0, 0, 1, 1]", "should be positive"),
        ("[0, 0, 1]", "left, top, width and height"),
        ("[0, 0, 0, 1]", "left, top, width and height"),
    ] {
        let mut wrong = Small::new(false);
        wrong.frames[1] += &format!(", \"white_region\": {region}");
        assert!(wrong.error().contains(said), "{}", wrong.error());
    }
}

#[test]
fn missing_and_damaged_photographs_cost_their_frame() {
    type Damage = Box<dyn Fn(&Path)>;
    let damage: [(&str, Damage); 4] = [
        ("0 bytes", Box::new(|path| fs::write(path, "").unwrap())),
        ("No such file", Box::new(|path| fs::remove_file(path).unwrap())),
        ("not a picture", Box::new(|path| fs::write(path, "hello").unwrap())),
        (
            "EXR",
            Box::new(|path| {
                let bytes = fs::read(path).unwrap();
                fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
            }),
        ),
    ];
    for (words, damage) in damage {
        for name in ["1.exr", "c1.exr"] {
            let small = Small::new(true);
            damage(&small.path(name));
            let capture = small.read(&CaptureReadOptions::default()).unwrap();
            assert_eq!((capture.frames.len(), capture.skipped_frames), (2, 1));
            assert!(capture.warnings[0].starts_with("frame 1.exr skipped: "), "{:?}", capture.warnings);
            assert!(
                capture.warnings[0].contains(words) && capture.warnings[0].contains(name),
                "{:?}",
                capture.warnings
            );
        }
    }
    // A truncated PNG.
    let mut small = Small::new(false);
    let noise = image::RgbImage::from_fn(16, 12, |x, y| image::Rgb([(x * 37 % 251) as u8, (y * 91 % 253) as u8, 7]));
    noise.save(small.path("p.png")).unwrap();
    let bytes = fs::read(small.path("p.png")).unwrap();
    fs::write(small.path("p.png"), &bytes[..bytes.len() / 2]).unwrap();
    small.frames[0] = small.frames[0].replace("0.exr", "p.png");
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!((capture.frames.len(), capture.skipped_frames), (2, 1));
    assert!(capture.warnings[0].contains("p.png"), "{:?}", capture.warnings);
    for index in 0..3 {
        let _ = fs::remove_file(small.path(&format!("{index}.exr")));
    }
    assert!(small.error().contains("no frame of 3 could be read"), "{}", small.error());
}

#[test]
fn contradictions_are_errors() {
    let small = Small::new(false);
    exr::prelude::write_rgb_file(small.path("2.exr"), 8, 12, |_, _| (1.0f32, 1.0f32, 1.0f32)).unwrap();
    let error = small.error();
    assert!(
        error.contains("2.exr: the picture is 8 x 12 pixels, its camera is declared as 16 x 12; resize"),
        "{error}"
    );

    let mut small = Small::new(false);
    small.frames[0] += ", \"mask_path\": \"m.png\"";
    small.mask("m.png", 16, 13, true);
    assert!(small.error().contains("m.png: the picture is 16 x 13 pixels"));
    small.mask("m.png", 16, 12, false);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!((capture.frames.len(), capture.skipped_frames), (2, 1));
    assert!(capture.warnings[0].contains("m.png: the mask is empty"), "{:?}", capture.warnings);
    small.mask("m.png", 16, 12, true);
    assert_eq!(small.read(&CaptureReadOptions::default()).unwrap().frames[0].mask.as_ref().unwrap().count(), 192);

    small.keys = ", \"color_space\": \"slog3\"".into();
    assert!(matches!(small.read(&CaptureReadOptions::default()), Err(Error::Unsupported(_))));
    small.frames.clear();
    assert!(small.error().contains("no frame"));
    assert!(matches!(read(small.path("nowhere"), &CaptureReadOptions::default()), Err(Error::Io { .. })));
    let empty = tempfile::tempdir().unwrap();
    assert!(read(empty.path(), &CaptureReadOptions::default()).unwrap_err().to_string().contains("no capture here"));
    fs::write(empty.path().join("transforms.json"), "").unwrap();
    assert!(
        read(empty.path(), &CaptureReadOptions::default()).unwrap_err().to_string().contains("transforms.json: line 1")
    );
}

#[test]
fn missing_pixels_are_counted_within_the_mask() {
    let mut small = Small::new(true);
    small.picture("0.exr", |x, y| if (x, y) == (2, 3) { (1.0, f32::NAN, 1.0) } else { (1.0, 1.0, 1.0) });
    small.picture("c0.exr", |x, y| if x == 7 && y < 2 { (1.0, f32::INFINITY, 1.0) } else { (1.0, 1.0, 1.0) });
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!(capture.missing_pixels, 3);
    assert!(capture.warnings[0].starts_with("3 pixels are NaN or infinite"));
    for image in [&capture.frames[0].photograph, capture.frames[0].cross.as_ref().unwrap()] {
        for (x, y) in [(2, 3), (7, 0), (7, 1)] {
            assert!(image.value_at(x, y).iter().all(|v| v.is_nan()));
        }
        assert_eq!(image.data.iter().filter(|p| p[0].is_nan()).count(), 3);
    }
    let half = image::GrayImage::from_fn(16, 12, |x, _| image::Luma([if x < 5 { 255 } else { 0 }]));
    half.save(small.path("m.png")).unwrap();
    small.frames[0] += ", \"mask_path\": \"m.png\"";
    assert_eq!(small.read(&CaptureReadOptions::default()).unwrap().missing_pixels, 1);
}

#[test]
fn clipped_pixels_of_the_object_are_counted() {
    let mut small = Small::new(false);
    // Three pixels within the mask and two without have a colour at 255; 254 is none.
    let code = |x, y| match (x, y) {
        (1..4, 5) | (9, 1..3) => [20, 255, 40],
        (2, 2) => [254; 3],
        _ => [30, 60, 90],
    };
    image::RgbImage::from_fn(16, 12, |x, y| image::Rgb(code(x, y))).save(small.path("0.png")).unwrap();
    let half = image::GrayImage::from_fn(16, 12, |x, _| image::Luma([if x < 5 { 255 } else { 0 }]));
    half.save(small.path("m.png")).unwrap();
    small.frames[0] = format!("\"file_path\": \"0.png\", \"mask_path\": \"m.png\", \"transform_matrix\": {POSE}");
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!(capture.clipping, Clipping { pixels: 3, object_pixels: 60, photographs: 1 });
    let said = "3 pixels in 1 of 3 photographs are at the most that their files hold, 5.00 % of the object there";
    assert!(capture.warnings[0].starts_with(said), "{:?}", capture.warnings);
    // Only half floats end at 65504. Without a mask the object is where the mesh is.
    small.frames.truncate(1);
    small.picture("0.exr", |x, _| if x == 9 { (65504.0, 1.0, 1.0) } else { (1.0, 65503.0, 1.0) });
    small.frames[0] = format!("\"file_path\": \"0.exr\", \"transform_matrix\": {POSE}");
    let clipping = small.read(&CaptureReadOptions::default()).unwrap().clipping;
    assert_eq!(clipping, Clipping::default(), "single floats have no end within reach");
    image::RgbImage::from_fn(16, 12, |x, _| image::Rgb([if x == 9 { 255 } else { 9 }; 3]))
        .save(small.path("0.png"))
        .unwrap();
    small.frames[0] = format!("\"file_path\": \"0.png\", \"transform_matrix\": {POSE}");
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let covered = crate::metrics::coverage(&capture.mesh, &capture.frames[0].view.camera);
    let column = (0..12).filter(|&y| *covered.value_at(9, y)).count() as u64;
    let object_pixels = covered.count() as u64;
    assert!(column > 0 && object_pixels > column);
    assert_eq!(capture.clipping, Clipping { pixels: column, object_pixels, photographs: 1 });
}

#[test]
fn a_mesh_beside_the_cameras_is_an_error() {
    let small = Small::new(false);
    for (x, z) in [(0.0, 50.0), (100.0, 0.0)] {
        fs::write(small.path("mesh.obj"), format!("v {x} 0 {z}\nv {} 0 {z}\nv {x} 1 {z}\nf 1 2 3\n", x + 1.0)).unwrap();
        let error = small.error();
        assert!(error.contains("none of the mesh's 3 vertices projects into any of the 3 pictures"), "{error}");
        assert!(error.contains("`capture::align`"));
    }
    // Moved into view by a given pose.
    let back = [[1.0, 0.0, 0.0, -100.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let capture = small.read(&CaptureReadOptions { mesh_pose: Some(back), ..Default::default() }).unwrap();
    assert_eq!(capture.mesh.positions[1], [1.0, 0.0, 0.0]);
    // A triangle so large that no corner is in view.
    fs::write(small.path("mesh.obj"), "v -90 -90 0\nv 90 -90 0\nv 0 90 0\nf 1 2 3\n").unwrap();
    assert!(small.read(&CaptureReadOptions::default()).is_ok());
    // One vertex of many.
    let strip: String = (0..100).map(|i| format!("v {} 0 0\nv {} 1 0\n", i * 20, i * 20)).collect();
    fs::write(
        small.path("mesh.obj"),
        format!("{strip}{}", (1..198).map(|i| format!("f {i} {} {}\n", i + 1, i + 2)).collect::<String>()),
    )
    .unwrap();
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert!(capture.warnings.iter().any(|w| w.starts_with("only 1.0")), "{:?}", capture.warnings);
}

#[test]
fn the_mesh_is_found_or_asked_for() {
    let small = Small::new(false);
    fs::copy(small.path("mesh.obj"), small.path("second.obj")).unwrap();
    assert!(small.error().contains("several meshes") && small.error().contains("`mesh`"));
    let options = CaptureReadOptions { mesh: Some(small.path("second.obj")), ..Default::default() };
    assert!(small.read(&options).is_ok());
    fs::remove_file(small.path("mesh.obj")).unwrap();
    assert!(small.read(&CaptureReadOptions::default()).is_ok());
    fs::remove_file(small.path("second.obj")).unwrap();
    assert!(small.error().contains("no mesh") || small.error().contains("names no mesh"));
}

#[test]
fn alignment_of_the_sample_from_a_points_file() {
    let description = describe(sample(), &FileAccess::default()).unwrap();
    let capture = read(sample(), &CaptureReadOptions::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.json");
    // The scan in millimetres, turned: x' = 1000 y, y' = -1000 x.
    let mut points = Vec::new();
    for (frame, name) in [(0, "off/000.exr"), (9, "009.exr"), (20, "./off/020.exr")] {
        for vertex in (0..752).step_by(90) {
            let p = capture.mesh.positions[vertex].map(f64::from);
            let ([x, y], _) = capture.frames[frame].view.camera.project(p).unwrap();
            let mesh = [1000.0 * p[1], -1000.0 * p[0], 1000.0 * p[2]];
            points.push(format!("{{\"frame\": \"{name}\", \"pixel\": [{x}, {y}], \"mesh\": {mesh:?}}}"));
        }
    }
    fs::write(&path, format!("{{\"points\": [\n{}]}}", points.join(",\n"))).unwrap();
    // Names that are not unique must be whole.
    let points = align::read_correspondences(&path, &description, &FileAccess::default()).unwrap();
    let cameras: Vec<_> = description.frames.iter().map(|f| f.view.camera).collect();
    let found = align::align(&cameras, &points, true).unwrap();
    assert!((found.scale - 0.001).abs() < 1e-9 && found.max_pixels < 1e-6, "{found:?}");
    let expected = [[0.0, -0.001, 0.0, 0.0], [0.001, 0.0, 0.0, 0.0], [0.0, 0.0, 0.001, 0.0]];
    for (row, expected) in found.pose.iter().zip(expected) {
        row.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-8, "{:?}", found.pose));
    }

    let fault = |text: &str| {
        fs::write(&path, text).unwrap();
        align::read_correspondences(&path, &description, &FileAccess::default()).unwrap_err().to_string()
    };
    let unknown = fault("{\"points\": [\n{\"frame\": \"off/999.exr\", \"pixel\": [1, 1], \"mesh\": [0, 0, 0]}]}");
    assert!(unknown.contains("line 2, points[0].frame: the capture has no frame \"off/999.exr\""), "{unknown}");
    let outside = fault("{\"points\": [{\"frame\": \"000.exr\",\n \"pixel\": [129, 1], \"mesh\": [0, 0, 0]}]}");
    assert!(outside.contains("line 2, points[0].pixel: outside the picture of 128 x 128"), "{outside}");
    let short = fault("{\"points\": [{\"frame\": \"000.exr\",\n \"pixel\": [12, 1], \"mesh\": [0, 0]}]}");
    assert!(short.contains("points[0].mesh: expected a list of 3 numbers"), "{short}");
}
