//! What other programs write: keys, masks, parts of files, lenses.

use super::test_capture::{POSE, Small};
use super::*;
use std::fs;

#[test]
fn dialects_of_transforms_are_read() {
    let small = Small::new(false);
    let plain = small.read(&CaptureReadOptions::default()).unwrap();
    // Blender's synthetic sets: an angle, no sizes, no extensions, another name of the file.
    fs::create_dir(small.path("images")).unwrap();
    (0..3).for_each(|k| fs::rename(small.path(&format!("{k}.exr")), small.path(&format!("images/{k}.exr"))).unwrap());
    let frames: Vec<_> =
        (0..3).map(|k| format!("{{\"file_path\": \"./images/{k}\", \"transform_matrix\": {POSE}}}")).collect();
    let angle = 2.0 * (8.0f64 / 20.0).atan();
    let text = format!("{{\"camera_angle_x\": {angle}, \"frames\": [{}]}}", frames.join(","));
    fs::remove_file(small.path("transforms.json")).unwrap();
    fs::write(small.path("transforms_train.json"), &text).unwrap();
    let blender = read(small.folder.path(), &CaptureReadOptions::default()).unwrap();
    for (a, b) in plain.frames.iter().zip(&blender.frames) {
        assert_eq!((a.view.camera.width, a.view.camera.height), (b.view.camera.width, b.view.camera.height));
        assert!((a.view.camera.focal[0] - b.view.camera.focal[0]).abs() < 1e-9);
        assert_eq!(a.photograph, b.photograph);
    }
    // Windows: backslashes, byte order marks, UTF-16.
    let windows = text.replace("./images/", "images\\\\");
    let utf16: Vec<u8> = windows.encode_utf16().flat_map(u16::to_le_bytes).collect();
    for bytes in [[b"\xef\xbb\xbf", windows.as_bytes()].concat(), [&[0xff, 0xfe][..], &utf16].concat()] {
        fs::write(small.path("transforms_train.json"), bytes).unwrap();
        let read = read(small.folder.path(), &CaptureReadOptions::default()).unwrap();
        let names: Vec<_> = read.frames.iter().map(|frame| frame.view.name.as_str()).collect();
        assert_eq!(names, ["images/0", "images/1", "images/2"]);
        assert_eq!(read.frames[2].photograph, plain.frames[2].photograph);
    }
    // What is not used is said.
    let applied = text.replacen('{', "{\"applied_transform\": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], ", 1);
    fs::write(small.path("transforms_train.json"), applied).unwrap();
    let read = read(small.folder.path(), &CaptureReadOptions::default()).unwrap();
    assert!(read.warnings.iter().any(|warning| warning.contains("applied_transform")), "{:?}", read.warnings);
}

#[test]
fn masks_of_other_programs_are_read() {
    let mut small = Small::new(false);
    small.frames.iter_mut().for_each(|frame| *frame += ", \"mask_path\": \"mask.png\"");
    let shown = |x: u32| x < 5;
    let pixels = |of: &dyn Fn(bool) -> [u8; 4]| {
        image::RgbaImage::from_fn(16, 12, |x, _| image::Rgba(of(shown(x)))).save(small.path("mask.png")).unwrap();
        let capture = small.read(&CaptureReadOptions::default()).unwrap();
        capture.frames[0].mask.as_ref().unwrap().count()
    };
    let white_cut_out = |shown: bool| [255u8, 255, 255, if shown { 255u8 } else { 0 }];
    let black_cut_out = |shown: bool| [0u8, 0, 0, if shown { 255u8 } else { 0 }];
    let ones = |shown: bool| [u8::from(shown), u8::from(shown), u8::from(shown), 255];
    let usual = |shown: bool| [if shown { 255u8 } else { 20 }; 4].map(|v| v.max(1));
    for of in [&white_cut_out as &dyn Fn(bool) -> [u8; 4], &black_cut_out, &ones, &usual] {
        assert_eq!(pixels(of), 60);
    }
}

#[test]
fn the_colour_of_a_file_of_several_parts_is_read() {
    use exr::prelude::*;
    let small = Small::new(false);
    let part = |name: &str, channels: Vec<(&str, f32)>| {
        let channels = channels.into_iter().map(|(name, value)| {
            AnyChannel::new(name, FlatSamples::F32((0..16 * 12).map(|at| value + at as f32).collect()))
        });
        Layer::new(
            (16, 12),
            LayerAttributes::named(name),
            Encoding::FAST_LOSSLESS,
            AnyChannels::sort(channels.collect()),
        )
    };
    let write = |layers: Vec<Layer<AnyChannels<FlatSamples>>>| {
        let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((16, 12)));
        Image::from_layers(attributes, layers).write().to_file(small.path("0.exr")).unwrap();
    };
    write(vec![part("depth", vec![("Z", 900.0)]), part("beauty", vec![("B", 0.25), ("G", 0.5), ("R", 1.0)])]);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!(*capture.frames[0].photograph.value_at(3, 1), [20.0, 19.5, 19.25]);
    write(vec![part("depth", vec![("Z", 900.0)])]);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!(capture.skipped_frames, 1);
    assert!(
        capture.warnings.iter().any(|w| w.contains("channels R, G, B or Y are needed, found Z")),
        "{:?}",
        capture.warnings
    );
}

#[test]
fn distorted_photographs_become_pinhole_ones() {
    let mut small = Small::new(true);
    small.keys += ", \"camera_model\": \"SIMPLE_RADIAL\", \"k1\": 0.5";
    small.frames[0] += ", \"mask_path\": \"m.png\"";
    small.mask("m.png", 16, 12, true);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let frame = &capture.frames[0];
    // k1 > 0: the corners of the pinhole picture lie outside the photograph.
    assert!(frame.photograph.value_at(0, 0)[0].is_nan() && frame.cross.as_ref().unwrap().value_at(0, 0)[0].is_nan());
    assert!(!*frame.mask.as_ref().unwrap().value_at(0, 0));
    // The picture is a ramp in x: the value tells the source position.
    let ideal = [(12.5 - 8.0) / 20.0, (6.5 - 6.0) / 20.0];
    let bent =
        Lens::Radial { numerator: [0.5, 0.0, 0.0, 0.0], denominator: [0.0; 3], tangential: [0.0; 2], shear: 0.0 }
            .distort(ideal);
    let expected = bent[0] * 20.0 + 8.0 - 0.5;
    assert!((frame.photograph.value_at(12, 6)[0] as f64 - expected).abs() < 1e-5);
    assert_eq!(capture.missing_pixels, 0);
}

#[test]
fn display_referred_photographs_with_alpha() {
    let mut small = Small::new(false);
    let picture = image::RgbaImage::from_fn(16, 12, |x, _| image::Rgba([188, 188, 188, if x < 4 { 0 } else { 255 }]));
    picture.save(small.path("p.png")).unwrap();
    small.frames = vec![format!("\"file_path\": \"p\", \"transform_matrix\": {POSE}")];
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert!((capture.frames[0].photograph.value_at(9, 9)[0] - 0.502_886_5).abs() < 1e-5);
    assert_eq!(capture.frames[0].mask.as_ref().unwrap().count(), 12 * 12);
    let linear =
        small.read(&CaptureReadOptions { color_space: Some("linear-rec709".into()), ..Default::default() }).unwrap();
    assert_eq!(linear.frames[0].photograph.value_at(9, 9)[0], (188.0f64 * 257.0 / 65535.0) as f32);
}

#[test]
fn coordinates_of_a_national_grid_keep_the_shape() {
    let small = Small::new(false);
    let near = small.read(&CaptureReadOptions::default()).unwrap();
    // The camera of POSE stands at 0, 0, 5.
    let origin = [448_262.125f64, 5_411_933.25, 121.5];
    let moved = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| p[k] + origin[k]) };
    let [x, y, z] = moved([0.0, 0.0, 5.0]);
    let pose = format!("[[1, 0, 0, {x}], [0, 1, 0, {y}], [0, 0, 1, {z}], [0, 0, 0, 1]]");
    let vertices = near.mesh.positions.iter().map(|p| moved(p.map(f64::from)).map(|c| format!("{c}")).join(" "));
    let vertices: Vec<String> = vertices.collect();
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n{}\n3 0 1 2\n",
        vertices.join("\n")
    );
    let obj = format!("v {}\nf 1 2 3\n", vertices.join("\nv "));
    for (name, text) in [("mesh.ply", ply), ("mesh.obj", obj)] {
        let mut far = Small::new(false);
        fs::remove_file(far.path("mesh.obj")).unwrap();
        fs::write(far.path(name), text).unwrap();
        far.frames.iter_mut().for_each(|frame| {
            *frame = frame.replace(POSE, &pose) + ", \"light_position\": [448262.125, 5411933.25, 131.5]"
        });
        let far = far.read(&CaptureReadOptions::default()).unwrap();
        let warned = |warning: &String| warning.contains("(448263, 5411934, 122) is subtracted");
        assert!(far.origin == [448_263.0, 5_411_934.0, 122.0] && far.warnings.iter().any(warned), "{:?}", far.warnings);
        for (a, b) in near.mesh.positions.iter().zip(&far.mesh.positions) {
            assert!((0..3).all(|k| f64::from(a[k]) + origin[k] - far.origin[k] == f64::from(b[k])), "{a:?} {b:?}");
        }
        let (a, b) = (&near.frames[0].view.camera, &far.frames[0].view.camera);
        for (p, q) in near.mesh.positions.iter().zip(&far.mesh.positions) {
            let (p, q) = (a.project(p.map(f64::from)).unwrap(), b.project(q.map(f64::from)).unwrap());
            assert!((0..2).all(|k| (p.0[k] - q.0[k]).abs() < 1e-6) && (p.1 - q.1).abs() < 1e-8, "{p:?} {q:?}");
        }
        assert_eq!(far.frames[0].view.light.unwrap().position, [-0.875, -0.75, 9.5]);
    }
}
