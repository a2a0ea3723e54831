use super::*;

const CAMERAS: &str = "# list\n3 OPENCV 640 480 500 510 320 240 0.1 0.01 0.001 0.002\n\
    4 SIMPLE_PINHOLE 64 48 50 32 24\n5 SIMPLE_RADIAL 64 48 50 32 24 0.2\n";
const IMAGES: &str = "# list\n2 0.5 0.5 0.5 0.5 1 2 3 3 b c.png\n1 2 3 4 5 6\n1 1 0 0 0 1 2 3 4 a.png\n\n";

fn binary() -> (Vec<u8>, Vec<u8>) {
    let mut cameras = 3u64.to_le_bytes().to_vec();
    let models: [(u32, u32, u64, u64, &[f64]); 3] = [
        (3, 4, 640, 480, &[500.0, 510.0, 320.0, 240.0, 0.1, 0.01, 0.001, 0.002]),
        (4, 0, 64, 48, &[50.0, 32.0, 24.0]),
        (5, 2, 64, 48, &[50.0, 32.0, 24.0, 0.2]),
    ];
    for (id, model, width, height, parameters) in models {
        cameras.extend(id.to_le_bytes().iter().chain(&model.to_le_bytes()));
        cameras.extend(width.to_le_bytes().iter().chain(&height.to_le_bytes()));
        parameters.iter().for_each(|p| cameras.extend(p.to_le_bytes()));
    }
    let mut images = 2u64.to_le_bytes().to_vec();
    type Row<'a> = (u32, [f64; 7], u32, &'a [u8], u64);
    let rows: [Row; 2] = [
        (2, [0.5, 0.5, 0.5, 0.5, 1.0, 2.0, 3.0], 3, b"b c.png\0", 2),
        (1, [1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0], 4, b"a.png\0", 0),
    ];
    for (id, numbers, camera, name, points) in rows {
        images.extend(id.to_le_bytes());
        numbers.iter().for_each(|n| images.extend(n.to_le_bytes()));
        images.extend(camera.to_le_bytes().iter().chain(name).chain(&points.to_le_bytes()));
        images.extend(vec![0; 24 * points as usize]);
    }
    (cameras, images)
}

#[test]
fn text_and_binary_say_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (text, bin) = (folder.path().join("t/sparse/0"), folder.path().join("t/sparse"));
    std::fs::create_dir_all(&text).unwrap();
    std::fs::write(text.join("cameras.txt"), CAMERAS).unwrap();
    std::fs::write(text.join("images.txt"), IMAGES).unwrap();
    let (cameras, images) = binary();
    std::fs::write(bin.join("cameras.bin"), cameras).unwrap();
    std::fs::write(bin.join("images.bin"), images).unwrap();
    let mut from_text = describe(&text, &FileAccess::default()).unwrap();
    let from_bin = describe(&bin, &FileAccess::default()).unwrap();
    from_text.path = from_bin.path.clone();
    assert_eq!(from_text, from_bin);
    assert_eq!(from_bin.name, "t");
    let [a, b] = from_bin.frames.as_slice() else { panic!() };
    assert_eq!((a.view.name.as_str(), b.view.name.as_str()), ("a.png", "b c.png"));
    assert_eq!(a.view.camera.to_camera([10.0, 20.0, 30.0]), [11.0, 22.0, 33.0]);
    // The quaternion (1, 1, 1, 1) / 2 turns x into y, y into z, z into x.
    assert_eq!(b.view.camera.to_camera([10.0, 20.0, 30.0]), [31.0, 12.0, 23.0]);
    let expected = Lens::Radial {
        numerator: [0.1, 0.01, 0.0, 0.0],
        denominator: [0.0; 3],
        tangential: [0.001, 0.002],
        shear: 0.0,
    };
    assert_eq!((a.lens, b.lens), (Lens::Pinhole, expected));
}

#[test]
fn lines_of_points_may_be_missing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("images.txt");
    let names = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let poses = read_images_txt(&path, &FileAccess::default())?;
        Ok::<Vec<String>, Error>(poses.into_iter().map(|pose| pose.name).collect())
    };
    let image = |name: &str| format!("1 1 0 0 0 1 2 3 4 {name}\n");
    let [a, b, number] = ["a.png", "b 2.png", "000001"].map(image);
    for points in ["", "\n", "1.5 2 -1 3 4 7\n", "# a note\n"] {
        let text = format!("{a}{points}{b}{points}{number}{points}");
        assert_eq!(names(&text).unwrap(), ["a.png", "b 2.png", "000001"], "{points:?}");
    }
    let error = names(&format!("{a}1.5 2 -1 3\n{b}")).unwrap_err().to_string();
    assert!(error.contains("line 2: IMAGE_ID should be a number, found \"1.5\""), "{error}");
}

#[test]
fn the_model_of_most_photographs_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let one = "2 1 0 0 0 1 2 3 4 b.png\n\n";
    for (model, images) in [("sparse/0", one.to_owned()), ("sparse/1", format!("1 1 0 0 0 1 2 3 4 a.png\n\n{one}"))] {
        let model = folder.path().join(model);
        std::fs::create_dir_all(&model).unwrap();
        std::fs::write(model.join("cameras.txt"), CAMERAS).unwrap();
        std::fs::write(model.join("images.txt"), images).unwrap();
    }
    let access = FileAccess::default();
    let description = crate::capture::describe(folder.path(), &access).unwrap();
    assert_eq!((description.frames.len(), description.warnings.len()), (2, 1));
    assert!(description.warnings[0].contains("sparse/1 is read, the model of the most photographs (2)"));
    assert_eq!(description.name, folder_name(folder.path()));
    // nerfstudio's layout: the model below colmap/, photographs beside it.
    let below = folder.path().join("colmap");
    std::fs::create_dir(&below).unwrap();
    std::fs::rename(folder.path().join("sparse"), below.join("sparse")).unwrap();
    std::fs::create_dir(folder.path().join("images")).unwrap();
    std::fs::write(folder.path().join("images/a.png"), "a").unwrap();
    let description = crate::capture::describe(folder.path(), &access).unwrap();
    assert!({
        let file = description.frames[0].photograph.first();
        file.ends_with("images/a.png") && file.exists()
    });
}

#[test]
fn every_truncation_of_the_binary_files_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let (cameras, images) = (folder.path().join("cameras.bin"), folder.path().join("images.bin"));
    let whole = binary();
    let access = FileAccess::default();
    for length in 0..whole.0.len() {
        std::fs::write(&cameras, &whole.0[..length]).unwrap();
        assert!(read_cameras_bin(&cameras, &access).err().unwrap().to_string().contains("truncated"), "{length}");
    }
    for length in 0..whole.1.len() {
        std::fs::write(&images, &whole.1[..length]).unwrap();
        assert!(read_images_bin(&images, &access).err().unwrap().to_string().contains("truncated"), "{length}");
    }
    // A count of points that overflows.
    let mut hostile = whole.1.clone();
    let at = hostile.len() - 8;
    hostile[at..].fill(0xff);
    std::fs::write(&images, &hostile).unwrap();
    assert!(read_images_bin(&images, &access).is_err());
}

#[test]
fn text_faults_name_the_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.txt");
    let access = FileAccess::default();
    let check = |text: &str, images: bool, expected: &str| {
        std::fs::write(&path, text).unwrap();
        let error = if images { read_images_txt(&path, &access).err() } else { read_cameras_txt(&path, &access).err() };
        let error = error.unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    };
    check("#\n1 EUCM 4 4 1 1 1 1 1 1", false, "line 2: camera model EUCM is not supported; undistort the photographs");
    check("1 PINHOLE 4 4 1 1 1", false, "line 1: camera model PINHOLE has 4 parameters, found 3");
    check("1 PINHOLE 4 x 1 1 1 1", false, "line 1: HEIGHT should be a number, found \"x\"");
    check("\n1 1 0 0", true, "line 2: QZ is missing");
    check("1 1 0 0 0 0 0 0 1", true, "line 1: NAME is missing");
}

#[test]
fn all_camera_models_are_read_or_refused_by_name() {
    let parameters: Vec<f64> = (0..16).map(|k| [50.0, 51.0, 31.5, 24.0, 0.1, 0.02][k.min(5)]).collect();
    for (model, count) in MODELS {
        match camera(model, 64, 48, &parameters[..count]) {
            Ok((camera, lens)) => {
                assert!(camera.focal[0] == 50.0 && lens.distort([0.1, 0.0])[0] != 0.0, "{model}");
            }
            Err(error) => {
                let refused = ["THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "EUCM", "EQUIRECTANGULAR"];
                assert!(refused.contains(&model) && error.contains(model), "{error}");
            }
        }
    }
    // COLMAP's own formulas at one position.
    let at = |model: &str, parameters: &[f64]| camera(model, 64, 48, parameters).unwrap().1.distort([0.6, -0.8]);
    let [x, y] = at("FOV", &[50.0, 50.0, 32.0, 24.0, 0.9]);
    let factor = (2.0 * 0.45f64.tan()).atan() / 0.9;
    assert!((x - 0.6 * factor).abs() < 1e-12 && (y + 0.8 * factor).abs() < 1e-12);
    let [x, _] = at("SIMPLE_DIVISION", &[50.0, 32.0, 24.0, -0.2]);
    assert!((x - 0.6 * 2.0 / (1.0 + 1.8f64.sqrt())).abs() < 1e-12);
    // A division by 1 + k r^2 leads back.
    assert!((x / (1.0 - 0.2 * (x / 0.6).powi(2)) - 0.6).abs() < 1e-12);
}

#[test]
fn rigs_and_frames_beside_a_model_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("cameras.txt", CAMERAS);
    put("images.txt", IMAGES);
    let access = FileAccess::default();
    let before = crate::capture::describe(folder.path(), &access).unwrap();
    put("rigs.txt", "# RIG_ID NUM_SENSORS ...\n1 2 CAMERA 3 CAMERA 4 1 1 0 0 0 0.1 0 0\n");
    put("frames.txt", "# FRAME_ID RIG_ID RIG_FROM_WORLD[] ...\n1 1 0.5 0.5 0.5 0.5 1 2 3 2 CAMERA 3 2 CAMERA 4 1\n");
    for path in [folder.path().to_owned(), folder.path().join("rigs.txt"), folder.path().join("frames.txt")] {
        assert_eq!(crate::capture::describe(path, &access).unwrap(), before);
    }
}
