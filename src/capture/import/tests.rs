//! One capture in every format, written by the formats' documented conventions, must have COLMAP's cameras.

use super::*;
use crate::capture::{CaptureReadOptions, describe, read};
use glam::{DMat3, DQuat, DVec3};
use std::fmt::Write;
use std::fs;

/// A capture's cameras, all of one lens.
struct Original {
    names: Vec<String>,
    cameras: Vec<Camera>,
    /// `k1 k2 p1 p2` in OpenCV's order.
    lens: [f64; 4],
}

impl Original {
    /// The bundled capture without polarisers, as a pinhole or through a lens.
    fn new(lens: [f64; 4], stretch: f64, shift: [f64; 2]) -> Self {
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/unpolarised");
        let description = describe(&bundled, &FileAccess::default()).unwrap();
        let names = description.frames.iter().map(|frame| frame.view.name.clone()).collect();
        let mut cameras: Vec<Camera> = description.frames.iter().map(|frame| frame.view.camera).collect();
        for camera in &mut cameras {
            camera.focal[1] *= stretch;
            (0..2).for_each(|k| camera.principal[k] += shift[k]);
        }
        Original { names, cameras, lens }
    }

    /// A folder of the capture's photographs and mesh, which all formats name alike.
    fn folder(&self) -> (tempfile::TempDir, PathBuf) {
        let outer = tempfile::tempdir().unwrap();
        let folder = outer.path().join("capture");
        fs::create_dir(&folder).unwrap();
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/unpolarised");
        for name in self.names.iter().map(String::as_str).chain(["scan.ply"]) {
            fs::copy(bundled.join(name), folder.join(name)).unwrap();
        }
        (outer, folder)
    }

    fn write(&self, format: &str, folder: &Path) -> PathBuf {
        let put = |name: &str, text: String| {
            fs::write(folder.join(name), text).unwrap();
            folder.join(name)
        };
        match format {
            "colmap" => {
                put("cameras.txt", self.colmap_cameras());
                put("images.txt", self.colmap_images());
                folder.to_owned()
            }
            "metashape" => put("cameras.xml", self.metashape()),
            "xmp" => {
                for (name, camera) in self.names.iter().zip(&self.cameras) {
                    put(&name.replace(".png", ".xmp"), self.sidecar(camera));
                }
                folder.to_owned()
            }
            "csv" => put("cameras.csv", self.table()),
            "meshroom" => put("cameras.sfm", self.meshroom(true)),
            "old meshroom" => put("sfm.json", self.meshroom(false)),
            "openmvg" => put("sfm_data.json", self.openmvg()),
            other => panic!("{other}"),
        }
    }

    fn colmap_cameras(&self) -> String {
        let Camera { width, height, focal: [f, g], principal: [x, y], .. } = self.cameras[0];
        let [k1, k2, p1, p2] = self.lens;
        format!("1 OPENCV {width} {height} {f} {g} {x} {y} {k1} {k2} {p1} {p2}\n")
    }

    fn colmap_images(&self) -> String {
        let mut text = String::new();
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let q = DQuat::from_mat3(&matrix(camera).transpose());
            let [x, y, z] = camera.translation;
            let _ = writeln!(text, "{index} {} {} {} {} {x} {y} {z} 1 {name}\n", q.w, q.x, q.y, q.z);
        }
        text
    }

    /// In a chunk of its own turn, place and unit, with a camera that is disabled and one that is not aligned.
    fn metashape(&self) -> String {
        let (turn, place, scale) = (DMat3::from_rotation_y(0.7), DVec3::new(3.0, -2.0, 5.0), 12.5);
        let Camera { width, height, focal, principal, .. } = self.cameras[0];
        let [k1, k2, p1, p2] = self.lens;
        let (w, h) = (f64::from(width), f64::from(height));
        let mut cameras = String::new();
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let centre = turn.transpose() * (DVec3::from_array(camera.centre()) - place) / scale;
            let axes = turn.transpose() * matrix(camera);
            let [x, y, z] = axes.transpose().to_cols_array_2d();
            let row = |r: [f64; 3], c: f64| format!("{} {} {} {c}", r[0], r[1], r[2]);
            let stem = name.trim_end_matches(".png");
            let _ = writeln!(
                cameras,
                "<camera id=\"{index}\" sensor_id=\"7\" component_id=\"0\" label=\"{stem}\"><transform>{} {} {} 0 0 0 1</transform></camera>",
                row(x, centre.x),
                row(y, centre.y),
                row(z, centre.z)
            );
        }
        let rows = turn.transpose().to_cols_array().map(|v| v.to_string()).join(" ");
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\"><chunk label=\"Chunk 1\" enabled=\"true\">
            <sensors next_id=\"8\"><sensor id=\"7\" label=\"unknown\" type=\"frame\"><resolution width=\"{width}\" height=\"{height}\"/>
            <calibration type=\"frame\" class=\"initial\"><f>1</f></calibration>
            <calibration type=\"frame\" class=\"adjusted\"><resolution width=\"{width}\" height=\"{height}\"/>
            <f>{}</f><cx>{}</cx><cy>{}</cy><b1>{}</b1><k1>{k1}</k1><k2>{k2}</k2><p1>{p2}</p1><p2>{p1}</p2></calibration></sensor></sensors>
            <components active_id=\"0\"><component id=\"0\"><transform><rotation locked=\"true\">{rows}</rotation>
            <translation>{} {} {}</translation><scale>{scale}</scale></transform></component></components>
            <cameras><group id=\"0\">{cameras}</group><camera id=\"90\" sensor_id=\"7\" label=\"off\" enabled=\"false\"/>
            <camera id=\"91\" sensor_id=\"7\" label=\"lost\"/></cameras></chunk></document>",
            focal[1],
            principal[0] - 0.5 * w,
            principal[1] - 0.5 * h,
            focal[0] - focal[1],
            place.x,
            place.y,
            place.z
        )
    }

    fn sidecar(&self, camera: &Camera) -> String {
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let longer = w.max(h);
        let [k1, k2, p1, p2] = self.lens;
        let join = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        format!(
            "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">
            <rdf:Description xcr:Version=\"3\" xcr:PosePrior=\"locked\" xcr:Coordinates=\"absolute\" xcr:DistortionModel=\"brown3t2\"
            xcr:FocalLength35mm=\"{}\" xcr:Skew=\"0\" xcr:AspectRatio=\"{}\" xcr:PrincipalPointU=\"{}\" xcr:PrincipalPointV=\"{}\"
            xmlns:xcr=\"http://www.capturingreality.com/ns/xcr/1.1#\"><xcr:Rotation>{}</xcr:Rotation><xcr:Position>{}</xcr:Position>
            <xcr:DistortionCoeficients>{k1} {k2} 0 0 {p2} {p1}</xcr:DistortionCoeficients></rdf:Description></rdf:RDF></x:xmpmeta>",
            36.0 * camera.focal[0] / longer,
            camera.focal[1] / camera.focal[0],
            (camera.principal[0] - 0.5 * w) / longer,
            (camera.principal[1] - 0.5 * h) / longer,
            join(camera.rotation.as_flattened()),
            join(&camera.centre())
        )
    }

    fn table(&self) -> String {
        let mut text = "#cameras 10\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n".to_owned();
        let [k1, k2, p1, p2] = self.lens;
        for (name, camera) in self.names.iter().zip(&self.cameras) {
            let (w, h) = (f64::from(camera.width), f64::from(camera.height));
            let longer = w.max(h);
            let [x, y, z] = camera.centre();
            // Columns: right, up and back; as a turn by -heading around z, pitch around x, roll around y.
            let [right, down, ahead] = camera.rotation;
            let (up, back) = (down.map(|v| -v), ahead.map(|v| -v));
            let heading = -(-up[0]).atan2(up[1]).to_degrees();
            let (pitch, roll) = (up[2].asin().to_degrees(), (-right[2]).atan2(back[2]).to_degrees());
            let _ = writeln!(
                text,
                "{name},{x},{y},{z},{heading},{pitch},{roll},{},{},{},{k1},{k2},0,0,{p2},{p1}",
                36.0 * camera.focal[0] / longer,
                (camera.principal[0] - 0.5 * w) / longer,
                (camera.principal[1] - 0.5 * h) / longer
            );
        }
        text
    }

    fn meshroom(&self, new: bool) -> String {
        let Camera { width, height, focal: [f, g], principal: [x, y], .. } = self.cameras[0];
        let (w, h) = (f64::from(width), f64::from(height));
        let [k1, k2, p1, p2] = self.lens;
        let quoted = |numbers: &[f64]| numbers.iter().map(|v| format!("\"{v}\"")).collect::<Vec<_>>().join(", ");
        let lens = quoted(&[k1, k2, 0.0, p1, p2]);
        let intrinsic = if new {
            format!(
                "\"sensorWidth\": \"23.5\", \"sensorHeight\": \"15.6\", \"type\": \"pinhole\", \"distortionType\": \"brown\", \"undistortionType\": \"none\",
                \"focalLength\": \"{}\", \"initialFocalLength\": \"-1\", \"pixelRatio\": \"{}\", \"principalPoint\": [{}], \"locked\": \"false\"",
                g * 23.5 / w,
                g / f,
                quoted(&[x - 0.5 * w, y - 0.5 * h])
            )
        } else {
            format!(
                "\"type\": \"brown\", \"pxFocalLength\": \"{f}\", \"principalPoint\": [{}], \"locked\": \"1\"",
                quoted(&[x, y])
            )
        };
        let (mut views, mut poses) = (String::new(), String::new());
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let id = 9_000_000 + index;
            let comma = if index == 0 { "" } else { "," };
            let _ = write!(
                views,
                "{comma}{{\"viewId\": \"{id}\", \"poseId\": \"{id}\", \"intrinsicId\": \"5\", \"path\": \"D:\\\\elsewhere\\\\photos\\\\{name}\"}}"
            );
            // Columns of world to camera.
            let columns = transposed(camera.rotation);
            let _ = write!(
                poses,
                "{comma}{{\"poseId\": \"{id}\", \"pose\": {{\"transform\": {{\"rotation\": [{}], \"center\": [{}]}}, \"locked\": \"0\"}}}}",
                quoted(columns.as_flattened()),
                quoted(&camera.centre())
            );
        }
        let version = if new { "[\"1\", \"2\", \"11\"]" } else { "[\"1\", \"0\", \"0\"]" };
        format!(
            "{{\"version\": {version}, \"featuresFolders\": [], \"views\": [{views}, {{\"viewId\": \"1\", \"path\": \"/x/lost.png\"}}],
            \"intrinsics\": [{{\"intrinsicId\": \"5\", \"width\": \"{width}\", \"height\": \"{height}\", {intrinsic}, \"distortionParams\": [{lens}]}}],
            \"poses\": [{poses}]}}"
        )
    }

    /// Each photograph with intrinsics of its own, of which only the first have their type's name.
    fn openmvg(&self) -> String {
        let [k1, k2, p1, p2] = self.lens;
        let (mut views, mut intrinsics, mut extrinsics) = (String::new(), String::new(), String::new());
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let Camera { width, height, focal: [f, _], principal: [x, y], rotation, .. } = camera;
            let comma = if index == 0 { "" } else { "," };
            let kind = match index {
                0 => "\"polymorphic_id\": 2147483649, \"polymorphic_name\": \"pinhole_brown_t2\"".to_owned(),
                _ => "\"polymorphic_id\": 1".to_owned(),
            };
            let _ = write!(
                views,
                "{comma}{{\"key\": {index}, \"value\": {{\"polymorphic_id\": 1073741824, \"ptr_wrapper\": {{\"id\": {}, \"data\": {{\"local_path\": \"\",
                \"filename\": \"{name}\", \"width\": {width}, \"height\": {height}, \"id_view\": {index}, \"id_intrinsic\": {index}, \"id_pose\": {index}}}}}}}}}",
                2_147_483_649u64 + index as u64
            );
            let _ = write!(
                intrinsics,
                "{comma}{{\"key\": {index}, \"value\": {{{kind}, \"ptr_wrapper\": {{\"id\": 9, \"data\": {{\"width\": {width}, \"height\": {height},
                \"focal_length\": {f}, \"principal_point\": [{x}, {y}], \"disto_t2\": [{k1}, {k2}, 0.0, {p1}, {p2}]}}}}}}}}"
            );
            let _ = write!(
                extrinsics,
                "{comma}{{\"key\": {index}, \"value\": {{\"rotation\": {rotation:?}, \"center\": {:?}}}}}",
                camera.centre()
            );
        }
        format!(
            "{{\"sfm_data_version\": \"0.3\", \"root_path\": \"/elsewhere\", \"views\": [{views}], \"intrinsics\": [{intrinsics}],
            \"extrinsics\": [{extrinsics}], \"structure\": [], \"control_points\": []}}"
        )
    }
}

/// Camera to world: columns are the camera's axes.
fn matrix(camera: &Camera) -> DMat3 {
    DMat3::from_cols_array_2d(&camera.rotation)
}

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
                assert_eq!((&a.view.name, a.photograph.is_file()), (&b.view.name, true), "{format}");
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
    assert!(found.frames.len() == 1 && found.frames[0].photograph.ends_with("train.PNG"));
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
