//! One capture in every format, written by the formats' documented conventions, must have COLMAP's cameras.

mod original;

use super::*;
use crate::capture::{CaptureReadOptions, describe, read};
use glam::DVec3;
use original::Original;
use std::fs;

const FORMATS: [&str; 6] = ["metashape", "xmp", "meshroom", "csv", "old meshroom", "openmvg"];

#[test]
fn cameras_of_all_formats_are_colmaps() {
    for (stretch, formats) in [(1.02, &FORMATS[..3]), (1.0, &FORMATS[..])] {
        let original = Original::new([-0.12, 0.03, 0.002, -0.004], stretch, [1.25, -0.75]);
        let (_outer, folder) = original.folder();
        let expected = describe(original.write("colmap", &folder), &FileAccess::default()).unwrap().frames;
        for format in formats {
            let (_outer, folder) = original.folder();
            let found = describe(original.write(format, &folder), &FileAccess::default()).unwrap();
            assert_eq!(found.frames.len(), expected.len(), "{format}: {:?}", found.warnings);
            for (a, b) in found.frames.iter().zip(&expected) {
                assert_eq!((&a.view.name, a.photograph.first().is_file()), (&b.view.name, true), "{format}");
                let (c, d) = (a.view.camera, b.view.camera);
                assert_eq!((c.width, c.height), (d.width, d.height));
                let numbers = |c: Camera| {
                    let lens = a.lens.distort([0.3, -0.2]);
                    let turn = c.rotation.into_iter().flatten();
                    turn.chain(c.translation).chain(c.focal).chain(c.principal).chain(lens).collect::<Vec<f64>>()
                };
                let lens = [a.lens, b.lens].map(|lens| lens.distort([0.3, -0.2]));
                let off = numbers(c).iter().zip(numbers(d)).map(|(p, q)| (p - q).abs()).fold(0.0, f64::max);
                let bent = (lens[0][0] - lens[1][0]).hypot(lens[0][1] - lens[1][1]);
                assert!(off < 1e-6 && bent < 1e-9, "{format}, {}: {off} {bent}\n{c:?}\n{d:?}", a.view.name);
            }
            let said = found.warnings.join("; ");
            match *format {
                "metashape" => {
                    assert!(said.contains("disabled in Metashape are left out: off") && said.contains("lost"))
                }
                "meshroom" | "old meshroom" => assert!(said.contains("lost.png"), "{said}"),
                _ => assert_eq!(said, ""),
            }
        }
    }
}

#[test]
fn files_of_all_formats_are_the_same_bytes() {
    let original = Original::new([0.0; 4], 1.0, [0.0; 2]);
    let encoded = |format: &str| {
        let (_outer, folder) = original.folder();
        let path = original.write(format, &folder);
        let capture = read(path, &CaptureReadOptions::default()).unwrap();
        crate::encoder::encode(capture, &crate::EncodeOptions::default()).unwrap().bytes
    };
    let expected = encoded("colmap");
    for format in ["metashape", "xmp", "csv", "meshroom", "openmvg"] {
        assert!(encoded(format) == expected, "{format}");
    }
}

#[test]
fn folders_are_searched() {
    let original = Original::new([0.0; 4], 1.0, [0.0; 2]);
    let (_outer, folder) = original.folder();
    // Sidecars among photographs below the folder, and masks beside.
    let below = folder.join("images");
    fs::create_dir(&below).unwrap();
    fs::create_dir(folder.join("masks")).unwrap();
    for (index, name) in original.names.iter().enumerate() {
        fs::rename(folder.join(name), below.join(name)).unwrap();
        let stem = name.trim_end_matches(".png");
        let mask = [
            format!("masks/{stem}.png"),
            format!("masks/{name}.png"),
            format!("masks/{stem}_mask.png"),
            format!("images/{name}.mask.png"),
        ];
        fs::write(folder.join(&mask[index % 4]), "").unwrap();
    }
    original.write("xmp", &below);
    let access = FileAccess::default();
    let found = describe(&folder, &access).unwrap();
    assert!(found.frames.iter().all(|frame| frame.mask.is_some() && frame.view.name.starts_with("images/")));
    assert!(found.find_mesh(&CaptureReadOptions::default()).unwrap().ends_with("scan.ply"));
    // Another program's cameras beside them are meant rather than the sidecars; two others are not guessed between.
    original.write("meshroom", &folder);
    assert!(describe(&folder, &access).unwrap().path.ends_with("cameras.sfm"));
    original.write("openmvg", &folder);
    let error = describe(&folder, &access).unwrap_err().to_string();
    assert!(error.ends_with("cameras.sfm and sfm_data.json both describe cameras: give the one to read"), "{error}");
    assert_eq!(describe(folder.join("sfm_data.json"), &access).unwrap().frames.len(), original.names.len());
}

#[test]
fn texts_of_other_systems_are_read() {
    let original = Original::new([-0.1, 0.02, 0.0, 0.0], 1.0, [0.5, 0.0]);
    for format in FORMATS.into_iter().chain(["colmap"]) {
        let (_outer, folder) = original.folder();
        let path = original.write(format, &folder);
        let expected = describe(&path, &FileAccess::default()).unwrap();
        let texts = entries(&folder).unwrap();
        let texts: Vec<(PathBuf, String)> = texts
            .into_iter()
            .filter(|path| !["png", "ply"].contains(&extension(path).as_str()))
            .map(|path| (path.clone(), fs::read_to_string(path).unwrap()))
            .collect();
        let marked = |text: &str| [b"\xef\xbb\xbf", text.replace('\n', "\r\n").as_bytes()].concat();
        let wide = |text: &str| {
            let units = std::iter::once(0xfeff).chain(text.encode_utf16());
            units.flat_map(u16::to_le_bytes).collect::<Vec<u8>>()
        };
        for encode in [&marked as &dyn Fn(&str) -> Vec<u8>, &wide] {
            texts.iter().for_each(|(path, text)| fs::write(path, encode(text)).unwrap());
            // As a file and as its folder.
            for path in [&path, &folder] {
                assert_eq!(describe(path, &FileAccess::default()).unwrap(), expected, "{format}");
            }
        }
    }
}

#[test]
fn views_kept_for_tests_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let pose = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]";
    let text = |name: &str| {
        format!(
            "{{\"camera_angle_x\": 0.7, \"frames\": [{{\"file_path\": \".\\\\{name}\", \"transform_matrix\": {pose}}}]}}"
        )
    };
    for (name, extension) in [("train", "PNG"), ("test", "png")] {
        let picture = folder.path().join(format!("{name}.{extension}"));
        image::GrayImage::new(6, 4).save_with_format(picture, image::ImageFormat::Png).unwrap();
        fs::write(folder.path().join(format!("transforms_{name}.json")), text(name)).unwrap();
    }
    let found = describe(folder.path(), &FileAccess::default()).unwrap();
    assert_eq!(found.warnings, ["the views of transforms_test.json are not read, as they are kept for tests"]);
    assert!(found.frames.len() == 1 && found.frames[0].photograph.first().ends_with("train.PNG"));
    let test = describe(folder.path().join("transforms_test.json"), &FileAccess::default()).unwrap();
    assert_eq!((test.frames[0].view.name.as_str(), test.frames[0].view.camera.width), ("test", 6));
}

#[test]
fn parts_of_a_rig_stand_where_the_rig_puts_them() {
    let original = Original::new([0.0; 4], 1.0, [0.0; 2]);
    let (_outer, folder) = original.folder();
    let path = original.write("meshroom", &folder);
    let text = fs::read_to_string(&path).unwrap();
    // The first camera's pose becomes that of a rig whose second part stands 2 to its right and is turned to look right.
    let rig = "\"rigs\": [{\"rigId\": \"3\", \"subPoses\": [{}, {\"status\": \"constant\", \"pose\": {\"rotation\":
        [\"0\", \"0\", \"1\", \"0\", \"1\", \"0\", \"-1\", \"0\", \"0\"], \"center\": [\"2\", \"0\", \"0\"]}}]}], \"views\"";
    let text = text.replace("\"views\"", rig).replacen(
        "\"poseId\": \"9000000\"",
        "\"poseId\": \"9000000\", \"rigId\": \"3\", \"subPoseId\": \"1\", \"isPoseIndependant\": \"false\"",
        1,
    );
    fs::write(&path, text).unwrap();
    let found = describe(&path, &FileAccess::default()).unwrap().frames[0].view.camera;
    let first = original.cameras[0];
    // What is 5 ahead of the part is 5 to the right of the first camera's place, 2 on.
    let right = DVec3::from_array(first.rotation[0]);
    let expected = DVec3::from_array(first.centre()) + 7.0 * right;
    let seen = DVec3::from_array(found.to_camera(expected.to_array()));
    assert!(seen.abs_diff_eq(DVec3::new(0.0, 0.0, 5.0), 1e-9), "{seen}");
}

#[test]
fn faults_are_named() {
    let original = Original::new([-0.1, 0.0, 0.0, 0.0], 1.0, [0.0; 2]);
    let fault = |format: &str, from: &str, to: &str| {
        let (_outer, folder) = original.folder();
        let mut path = original.write(format, &folder);
        if format == "xmp" {
            path = folder.join("00.xmp");
        }
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from}");
        fs::write(&path, text.replace(from, to)).unwrap();
        describe(&path, &FileAccess::default()).unwrap_err().to_string()
    };
    let cases = [
        ("metashape", "sensor_id=\"7\"", "sensor_id=\"8\"", "<camera>: there is no sensor \"8\""),
        (
            "metashape",
            "type=\"frame\" class=\"adjusted\"",
            "type=\"spherical\" class=\"adjusted\"",
            "\"spherical\" is not supported",
        ),
        (
            "metashape",
            "0 0 0 1</transform>",
            "0 0 1</transform>",
            "<transform>: a camera's transform should be 16 numbers",
        ),
        ("metashape", "<scale>12.5", "<scale>-1", "<transform>: a scale of -1"),
        ("metashape", "<document", "<!DOCTYPE d [<!ENTITY a \"b\">]><document", "not XML"),
        ("metashape", "</document>", "", "not XML"),
        ("xmp", "brown3t2", "division", "the distortion model \"division\" is not supported"),
        ("xmp", "absolute", "relative", "the pose is in \"relative\" coordinates"),
        ("xmp", "FocalLength35mm=\"", "FocalLength35mm=\"wide", "FocalLength35mm should be numbers, found \"wide"),
        ("csv", "00.png,", "00.png,x", "line 3: x should be a number, found \"x"),
        ("meshroom", "\"brown\"", "\"3deanamorphic4\"", "a lens of type \"3deanamorphic4\" is not supported"),
        (
            "meshroom",
            "\"undistortionType\": \"none\"",
            "\"undistortionType\": \"3deradial4\"",
            "the undistortion \"3deradial4\"",
        ),
        (
            "meshroom",
            "\"intrinsicId\": \"5\", \"width\"",
            "\"intrinsicId\": \"6\", \"width\"",
            "there are no intrinsics \"5\"",
        ),
        ("openmvg", "pinhole_brown_t2", "spherical", "a camera of type \"spherical\" is not supported"),
        ("openmvg", "\"rotation\": [[", "\"rotation\": [[9.0], [", "a list of 4, 3 at most are read"),
    ];
    for (format, from, to, expected) in cases {
        let error = fault(format, from, to);
        assert!(error.contains(expected), "{format}: {error}\nexpected: {expected}");
    }
}

#[test]
fn work_and_memory_of_documents_are_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.xml");
    // Deep, broad, and both larger than what may be used.
    let deep = format!("<document><chunk>{}", "<a>".repeat(200_000));
    let broad = format!("<document><chunk>{}</chunk></document>", "<a b=\"\"/>".repeat(200_000));
    for text in [&deep, &broad] {
        fs::write(&path, text).unwrap();
        assert!(describe(&path, &FileAccess::default()).is_err());
        let access = FileAccess::new(crate::Limits { memory_bytes: 16 << 20, ..Default::default() });
        let error = describe(&path, &access).unwrap_err();
        assert!(matches!(error, Error::InputMemory { .. }), "{error}");
    }
}

#[test]
fn other_formats_are_named_with_what_to_do() {
    let cases: [(&[(&str, &str)], &str); 12] = [
        (&[("a.psx", "")], "a.psx is a Metashape project: export its cameras"),
        (&[("a.rcproj", ""), ("a.ply", "")], "a.rcproj is a RealityCapture project: export its registration"),
        (&[("bundle.out", "# Bundle file v0.3\n")], "bundle.out is a Bundler model: convert it"),
        (&[("model.nvm", "NVM_V3\n")], "model.nvm is a VisualSFM model"),
        (&[("lights.lp", "1\n"), ("1.jpg", "")], "lights of reflectance transformation imaging (RTI): it has one view"),
        (&[("sfm_data.bin", "")], "is an OpenMVG scene in binary: convert it"),
        (&[("database.db", "")], "it holds no poses; run COLMAP's mapper"),
        (&[("clip.MP4", "")], "clip.MP4 is a video: take photographs out of it"),
        (&[("scene.splat", "")], "reconstruct one by Poisson's method or ball pivoting"),
        (&[("scan.ply", "ply\n")], "scan.ply is a mesh without photographs"),
        (&[("1.jpg", ""), ("2.JPG", "")], "there are 2 photographs, but no cameras: find them with COLMAP"),
        (&[], "no capture here"),
    ];
    for (files, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        files.iter().for_each(|(name, text)| fs::write(folder.path().join(name), text).unwrap());
        let error = describe(folder.path(), &FileAccess::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\nexpected: {expected}");
        // The file itself, too.
        if let [(name, _)] = files {
            let error = describe(folder.path().join(name), &FileAccess::default()).unwrap_err().to_string();
            assert!(error.contains(": this is "), "{error}");
        }
    }
}
