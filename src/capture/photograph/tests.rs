use super::{ExposureFile, MosaicColours, PhotographFiles, PolarisationMosaic};
use crate::capture::test_capture::{POSE, Small};
use crate::capture::{Capture, CaptureReadOptions};
use crate::image::Grid;
use std::fs;
use std::path::Path;

/// Diffuse and specular radiance of a pixel, linear in both directions.
fn parts(x: f32, y: f32) -> [[f32; 3]; 2] {
    let diffuse = 0.2 + 0.02 * x + 0.01 * y;
    let specular = 0.3 - 0.01 * x + 0.015 * y;
    [[diffuse, 0.8 * diffuse, 0.5 * diffuse], [specular, specular, 0.9 * specular]]
}

/// Angle of the specular reflection's polarisation, in degrees.
const LIGHT: f32 = 20.0;

/// Radiance of a pixel through a polariser at an angle in degrees.
fn through(angle: f32, x: f32, y: f32) -> [f32; 3] {
    let [diffuse, specular] = parts(x, y);
    let passed = (angle - LIGHT).to_radians().cos().powi(2);
    std::array::from_fn(|c| 0.5 * diffuse[c] + specular[c] * passed)
}

impl Small {
    fn through(&self, name: &str, angle: f32) {
        fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        self.picture(name, |x, y| through(angle, x as f32, y as f32).into());
    }
    /// One frame of these keys.
    fn of_frame(keys: &str) -> Self {
        let mut small = Small::new(false);
        small.frames = vec![format!("{keys}, \"transform_matrix\": {POSE}")];
        small
    }
}

/// Largest errors of both photographs of a capture's frames, where `tested` says so.
fn errors(capture: &Capture, scale: f32, tested: impl Fn(usize, usize) -> bool) -> [f32; 2] {
    let mut worst = [0.0f32; 2];
    for frame in &capture.frames {
        let cross = frame.cross.as_ref().unwrap();
        for (x, y) in (0..12).flat_map(|y| (0..16).map(move |x| (x, y))).filter(|&(x, y)| tested(x, y)) {
            // In pixels of what was drawn.
            let place = |k: usize| scale * (k as f32 + 0.5) - 0.5;
            let [diffuse, specular] = parts(place(x), place(y));
            for c in 0..3 {
                let photograph = frame.photograph.value_at(x, y)[c] - diffuse[c] - specular[c];
                let crossed = cross.value_at(x, y)[c] - 0.5 * diffuse[c];
                worst = [worst[0].max(photograph.abs()), worst[1].max(crossed.abs())];
            }
        }
    }
    worst
}

#[test]
fn polarisers_at_several_angles_separate_and_board_and_clipping_are_read_alike() {
    let list = |angles: &[u32]| {
        let one = |angle: &u32| format!("{{\"file_path\": \"{angle}.exr\", \"angle\": {angle}}}");
        format!("\"polarisers\": [{}]", angles.iter().map(one).collect::<Vec<_>>().join(", "))
    };
    for angles in [&[0, 60, 120][..], &[10, 55, 100, 145], &[0, 30, 45, 100, 190]] {
        let small = Small::of_frame(&list(angles));
        angles.iter().for_each(|&angle| small.through(&format!("{angle}.exr"), angle as f32));
        let capture = small.read(&CaptureReadOptions::default()).unwrap();
        assert_eq!((capture.beta, &*capture.frames[0].view.name), (Some([0.5; 3]), &*format!("{}.exr", angles[0])));
        let worst = errors(&capture, 1.0, |_, _| true);
        assert!(worst.iter().all(|error| *error < 1e-3), "{angles:?}: {worst:?}");
    }
    // 0 and 180 degrees are one angle.
    let error = Small::of_frame(&list(&[0, 90, 180])).error();
    assert!(
        error.contains("polarisers: photographs at 2 angles of the polariser (modulo 180 degrees), 3 at least"),
        "{error}"
    );
    // A pixel that is missing in one is missing in both photographs, and tells its neighbours nothing.
    let small = Small::of_frame(&list(&[0, 60, 120]));
    [0, 60, 120].iter().for_each(|&angle| small.through(&format!("{angle}.exr"), angle as f32));
    small.picture("60.exr", |x, y| {
        if (x, y) == (4, 5) { (f32::NAN, 0.0, 0.0) } else { through(60.0, x as f32, y as f32).into() }
    });
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let frame = &capture.frames[0];
    assert!(frame.photograph.value_at(4, 5)[1].is_nan() && frame.cross.as_ref().unwrap().value_at(4, 5)[1].is_nan());
    assert_eq!(capture.missing_pixels, 1);
    assert!(errors(&capture, 1.0, |x, y| (x, y) != (4, 5)).iter().all(|error| *error < 1e-3));
}

#[test]
fn noise_of_dull_pixels_is_not_specular() {
    // Diffuse alone, with noise of 1 % from a small generator.
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let mut fit = super::polariser::PolariserFit::new(&[0.0, 45.0, 90.0, 135.0], 64, 64);
    for number in 0..4 {
        let data = (0..64 * 64).map(|_| std::array::from_fn(|_| 0.5 + 0.0087 * noise())).collect();
        fit.add(number, &Grid { width: 64, height: 64, data });
    }
    let (photograph, cross) = fit.split();
    let specular = |k: usize| f64::from(photograph.data[k][1] - 2.0 * cross.data[k][1]);
    let mean = (0..64 * 64).map(specular).sum::<f64>() / 4096.0;
    // By the length of each colour alone it is 0.0089.
    assert!((0.0..0.0025).contains(&mean), "{mean}");
}

#[test]
fn parallel_and_crossed_photographs_add_up_and_a_board_corrects_the_ratio() {
    let mut small = Small::of_frame("\"parallel_file_path\": \"p.exr\", \"cross_file_path\": \"c.exr\"");
    small.through("p.exr", LIGHT);
    small.through("c.exr", LIGHT + 90.0);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert_eq!((capture.beta, capture.white, &*capture.frames[0].view.name), (Some([0.5; 3]), [1.0; 3], "p.exr"));
    assert!(errors(&capture, 1.0, |_, _| true).iter().all(|error| *error < 1e-3));
    small.picture("wp.exr", |_, _| (1.0, 1.0, 2.0));
    small.picture("wc.exr", |_, _| (1.0, 0.6, 2.0));
    small.keys = ", \"white_reference\": {\"parallel_file_path\": \"wp.exr\", \"cross_file_path\": \"wc.exr\"}".into();
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let expected = [0.5, f64::from(0.6f32) / f64::from(1.6f32), 0.5];
    assert!(capture.beta.unwrap().iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6) && capture.white[2] == 4.0);
    let error = Small::of_frame("\"parallel_file_path\": \"p.exr\"").error();
    assert!(error.contains("frames[0]: a photograph through parallel polarisers needs the crossed one"), "{error}");
    let error =
        Small::of_frame("\"file_path\": \"a.exr\", \"cross_file_path\": \"p.exr\", \"polarisation_mosaic\": true")
            .error();
    assert!(error.contains("are told in one way"), "{error}");
}

/// A raw image of 16 bits, and how much a pixel of it is of what is drawn.
fn write_mosaic(small: &Small, mosaic: &PolarisationMosaic, width: u32, height: u32) {
    let value = |x: u32, y: u32| {
        let angle = mosaic.angles[(x % 2 + y % 2 * 2) as usize];
        let colour = match mosaic.colours {
            MosaicColours::Monochrome => 0,
            MosaicColours::Bayer(cells) => cells[(x / 2 % 2 + y / 2 % 2 * 2) as usize],
        };
        image::Luma([(65535.0 * through(angle as f32, x as f32, y as f32)[usize::from(colour)]).round() as u16])
    };
    image::ImageBuffer::from_fn(width, height, value).save(small.path("raw.png")).unwrap();
}

#[test]
fn mosaics_of_polarisation_cameras_are_taken_apart() {
    let inner = |x: usize, y: usize| (4..12).contains(&x) && (4..8).contains(&y);
    let small = Small::of_frame("\"file_path\": \"raw.png\", \"polarisation_mosaic\": true");
    let sony = PolarisationMosaic::SONY;
    write_mosaic(&small, &sony, 16, 12);
    let grey = |capture: Capture| {
        // Without colour filters all colours are the red ones of what was drawn.
        assert!(capture.frames[0].photograph.data.iter().all(|pixel| pixel[0] == pixel[1] && pixel[0] == pixel[2]));
        let [diffuse, specular] = parts(7.0, 5.0);
        let frame = &capture.frames[0];
        let photograph = frame.photograph.value_at(7, 5)[0] - diffuse[0] - specular[0];
        [photograph, frame.cross.as_ref().unwrap().value_at(7, 5)[0] - 0.5 * diffuse[0]]
    };
    let found = grey(small.read(&CaptureReadOptions::default()).unwrap());
    assert!(found.iter().all(|error| error.abs() < 1e-4), "{found:?}");

    // Colours, at the raw image's size and at half of it.
    for (letters, cells) in [("RGGB", [0, 1, 1, 2]), ("GBRG", [1, 2, 0, 1])] {
        let mosaic = PolarisationMosaic { angles: [0.0, 45.0, 135.0, 90.0], colours: MosaicColours::Bayer(cells) };
        let mut small = Small::of_frame("\"file_path\": \"raw.png\"");
        small.keys = format!(", \"polarisation_mosaic\": {{\"angles\": [0, 45, 135, 90], \"colours\": \"{letters}\"}}");
        for scale in [1, 2] {
            write_mosaic(&small, &mosaic, 16 * scale, 12 * scale);
            let capture = small.read(&CaptureReadOptions::default()).unwrap();
            let worst = errors(&capture, scale as f32, inner);
            assert!(worst.iter().all(|error| *error < 1e-4), "{letters}, {scale}: {worst:?}");
            let everywhere = errors(&capture, scale as f32, |_, _| true);
            assert!(everywhere.iter().all(|error| *error < 0.1), "{letters}, {scale}: {everywhere:?}");
        }
        write_mosaic(&small, &mosaic, 32, 12);
        assert!(small.error().contains("raw.png: the picture is 32 x 12 pixels"), "{}", small.error());
    }
    let wrong =
        |keys: &str| Small::of_frame(&format!("\"file_path\": \"raw.png\", \"polarisation_mosaic\": {keys}")).error();
    assert!(wrong("{\"angles\": [0, 45, 90, 180]}").contains("the four angles of a cell differ"));
    assert!(wrong("{\"angles\": [0, 45, 90, 135], \"colours\": \"RGBB\"}").contains("are told as RGGB"));
    let coloured = Small::of_frame("\"file_path\": \"0.exr\", \"polarisation_mosaic\": true");
    assert!(
        coloured.error().contains("0.exr: a polarisation camera's raw image has one channel"),
        "{}",
        coloured.error()
    );
    // Taps at the edges of all sizes stay inside.
    for (width, height) in (4..10).flat_map(|width| (4..8).map(move |height| (width, height))) {
        let raw = Grid::filled(width, height, 0.5);
        for (polariser, step) in (0..4).flat_map(|polariser| [(polariser, 1), (polariser, 2)]) {
            let image = PolarisationMosaic { angles: sony.angles, colours: MosaicColours::Bayer([0, 1, 1, 2]) }
                .image(polariser, &raw, step);
            assert!(image.data.iter().flatten().all(|value| *value == 0.5));
        }
    }
}

#[test]
fn exposures_are_merged_where_they_are_not_clipped() {
    // 8 bits, linear, a tenth and ten times as long; the darkest pixels have one or two levels in the first.
    let truth = |x: u32, y: u32| 0.004 * 1.4f64.powi(x as i32) * (1.0 + 0.05 * y as f64);
    let mut small = Small::of_frame(
        "\"exposures\": [{\"file_path\": \"b.png\", \"exposure_time\": 0.01}, {\"file_path\": \"a.png\", \"exposure_time\": 0.001},
          {\"file_path\": \"c.png\", \"exposure_time\": 0.1}]",
    );
    small.keys = ", \"color_space\": \"linear-rec709\"".into();
    for (name, time) in [("a.png", 0.1), ("b.png", 1.0), ("c.png", 10.0)] {
        let value = |x, y| image::Rgb([(255.0 * (truth(x, y) * time).min(1.0)).round() as u8; 3]);
        image::RgbImage::from_fn(16, 12, value).save(small.path(name)).unwrap();
    }
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let image = &capture.frames[0].photograph;
    for (x, y) in (0..12).flat_map(|y| (0..16).map(move |x| (x, y))) {
        let (found, truth) = (f64::from(image.value_at(x, y)[0]), truth(x as u32, y as u32));
        assert!((found / truth - 1.0).abs() < 0.04, "{x}, {y}: {found}, {truth}");
    }
    assert_eq!((&*capture.frames[0].view.name, capture.clipping.pixels), ("b.png", 0));
    // Times are stated for all, or for none.
    let frame = |keys: &str| format!("\"file_path\": \"a.png\"{keys}, \"transform_matrix\": {POSE}");
    small.frames = vec![frame(", \"exposure_time\": 0.5"), frame(", \"exposure_time\": 0.25")];
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let [first, second] = [0, 1].map(|k: usize| capture.frames[k].photograph.value_at(9, 9)[0]);
    assert_eq!(second, 2.0 * first);
    small.frames[1] = frame("");
    assert!(small.error().contains("frames[1] has no exposure_time, as others have"), "{}", small.error());
    small.frames[1] = frame(", \"exposure_time\": -1");
    assert!(small.error().contains("frames[1].exposure_time: an exposure time is positive"), "{}", small.error());
    small.frames = vec![format!("\"exposures\": [], \"transform_matrix\": {POSE}")];
    assert!(small.error().contains("frames[0]"), "{}", small.error());
}

/// A JPEG of one colour that says how it was exposed: time as a fraction, sensitivity, f-number as a fraction.
fn write_exposed(path: &Path, value: u8, [time, sensitivity, aperture]: [[u32; 2]; 3]) {
    let [seconds, f_number] =
        [time, aperture].map(|[a, b]| exif::Value::Rational(vec![exif::Rational { num: a, denom: b }]));
    let fields = [
        (exif::Tag::ExposureTime, seconds),
        (exif::Tag::FNumber, f_number),
        (exif::Tag::PhotographicSensitivity, exif::Value::Short(vec![sensitivity[0] as u16])),
    ]
    .map(|(tag, value)| exif::Field { tag, ifd_num: exif::In::PRIMARY, value });
    let mut writer = exif::experimental::Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut data = std::io::Cursor::new(Vec::new());
    writer.write(&mut data, false).unwrap();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(fs::File::create(path).unwrap(), 100);
    image::ImageEncoder::set_exif_metadata(&mut encoder, data.into_inner()).unwrap();
    encoder.encode_image(&image::RgbImage::from_pixel(16, 12, image::Rgb([value; 3]))).unwrap();
}

#[test]
fn exposures_that_files_tell_are_named_or_applied() {
    let mut small = Small::new(false);
    small.keys = ", \"color_space\": \"linear-rec709\"".into();
    let frame = |k: usize| format!("\"file_path\": \"{k}.jpg\", \"transform_matrix\": {POSE}");
    small.frames = (0..3).map(frame).collect();
    write_exposed(&small.path("0.jpg"), 100, [[1, 100], [200, 1], [80, 10]]);
    write_exposed(&small.path("1.jpg"), 200, [[1, 50], [200, 1], [80, 10]]);
    write_exposed(&small.path("2.jpg"), 100, [[1, 100], [800, 1], [16, 1]]);
    let applied = CaptureReadOptions { exif_exposure: true, ..Default::default() };
    let brightness =
        |capture: Capture| [0, 1, 2].map(|k: usize| capture.frames[k].photograph.value_at(3, 3)[1] * 255.0);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let said = "photographs were exposed differently, by up to a factor of 2.00 (EXIF), and are taken as they are; option `exif_exposure`";
    assert!(capture.warnings.iter().any(|warning| warning.contains(said)), "{:?}", capture.warnings);
    assert_eq!(brightness(capture).map(f32::round), [100.0, 200.0, 100.0]);
    assert_eq!(brightness(small.read(&applied).unwrap()).map(f32::round), [100.0; 3]);
    // Times that are stated come first.
    small.frames = [0, 1, 2].map(|k| frame(k) + &format!(", \"exposure_time\": {}", [1, 4, 1][k])).to_vec();
    let capture = small.read(&applied).unwrap();
    assert!(capture.warnings.iter().all(|warning| !warning.contains("EXIF")));
    assert_eq!(brightness(capture).map(f32::round), [100.0, 50.0, 100.0]);
    small.frames = (0..3).map(frame).collect();
    image::RgbImage::from_pixel(16, 12, image::Rgb([9; 3])).save(small.path("1.jpg")).unwrap();
    let error = small.read(&applied).unwrap_err().to_string();
    assert!(error.contains("1.jpg: it does not say how it was exposed (EXIF's ExposureTime)"), "{error}");
}

#[test]
fn names_tell_of_filters() {
    let frames = |small: &mut Small, names: &[&str]| {
        small.frames =
            names.iter().map(|name| format!("\"file_path\": \"{name}\", \"transform_matrix\": {POSE}")).collect();
    };
    let files = |frame: &PhotographFiles, small: &Small| -> Vec<String> {
        frame.files().map(|file| file.strip_prefix(small.folder.path()).unwrap().display().to_string()).collect()
    };
    let described = |small: &Small| {
        let _ = small.read(&CaptureReadOptions::default());
        super::super::describe(small.folder.path(), &Default::default()).unwrap()
    };
    // Folders; only one of the pair has cameras; a board beside them.
    let mut small = Small::new(false);
    for k in 0..3 {
        small.through(&format!("images/Parallel/{k}.exr"), LIGHT);
        small.through(&format!("images/Cross/{k}.exr"), LIGHT + 90.0);
    }
    frames(&mut small, &["images/Parallel/0.exr", "./images/Parallel/1.exr", "images/Parallel/2.exr"]);
    let description = described(&small);
    assert!(matches!(description.frames[1].photograph, PhotographFiles::Parallel { .. }));
    assert_eq!(files(&description.frames[1].photograph, &small), ["images/Parallel/1.exr", "images/Cross/1.exr"]);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    let said =
        "3 photographs are through parallel and crossed polarisers, by the names of their files: images/Parallel/0.exr";
    assert!(capture.warnings.iter().any(|warning| warning.contains(said)), "{:?}", capture.warnings);
    assert!(errors(&capture, 1.0, |_, _| true).iter().all(|error| *error < 1e-3) && capture.beta == Some([0.5; 3]));
    small.through("white_par.exr", LIGHT);
    small.through("white_xpol.exr", LIGHT + 90.0);
    assert_eq!(
        files(&described(&small).white_reference.unwrap().photograph, &small),
        ["white_par.exr", "white_xpol.exr"]
    );
    // Both have cameras: one frame, that of the first filter.
    frames(&mut small, &["images/Cross/0.exr", "images/Parallel/0.exr", "images/Parallel/1.exr", "images/Cross/1.exr"]);
    let names: Vec<_> = described(&small).frames.into_iter().map(|frame| frame.view.name).collect();
    assert_eq!(names, ["images/Parallel/0.exr", "images/Parallel/1.exr"]);

    // Angles, by words of the names.
    let mut small = Small::new(false);
    let angles = [0, 45, 90, 135];
    for (k, angle) in (0..2).flat_map(|k| angles.map(|angle| (k, angle))) {
        small.through(&format!("IMG_{k}_pol{angle:03}.exr"), angle as f32);
    }
    frames(&mut small, &["IMG_0_pol000.exr", "IMG_1_pol000.exr"]);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert!(errors(&capture, 1.0, |_, _| true).iter().all(|error| *error < 1e-3));
    // A pair whose ratio must be measured, or given.
    let mut small = Small::new(false);
    small.through("0_cross.exr", 90.0);
    small.through("cross/1.exr", 90.0);
    frames(&mut small, &["0.exr", "1.exr"]);
    assert!(small.error().contains("add one, or give the board's on / off ratio"), "{}", small.error());
    assert_eq!(small.read(&CaptureReadOptions { beta: Some([0.5; 3]), ..Default::default() }).unwrap().frames.len(), 2);

    // Words that are there by chance: a few among many, turntables' angles, an object of that name, two files for one filter.
    let mut small = Small::new(false);
    small.picture("1_cross.exr", |_, _| (0.0, 0.0, 0.0));
    frames(&mut small, &["0.exr", "1.exr", "2.exr"]);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert!(
        capture.beta.is_none()
            && capture.warnings.iter().any(|warning| warning.contains("as 2 are not, all are taken as they are"))
    );
    let mut small = Small::new(false);
    for k in 0..3 {
        small.picture(&format!("cross_{k}0deg.exr"), |_, _| (1.0, 1.0, 1.0));
        small.picture(&format!("par_{k}.png.exr"), |_, _| (1.0, 1.0, 1.0));
    }
    frames(&mut small, &["cross_00deg.exr", "cross_10deg.exr", "cross_20deg.exr"]);
    let capture = small.read(&CaptureReadOptions::default()).unwrap();
    assert!(capture.beta.is_none() && capture.frames.len() == 3);
    let single = PhotographFiles::single(Path::new("a").to_owned());
    assert_eq!(
        single,
        PhotographFiles::Unpolarised { photograph: vec![ExposureFile { path: "a".into(), time: 1.0 }], cross: None }
    );
}
