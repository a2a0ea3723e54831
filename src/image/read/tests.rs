use crate::image::read::*;

#[test]
fn transfer_functions_at_known_codes() {
    let srgb = ColorSpace::from_name("sRGB").unwrap();
    assert!((srgb.linear(188.0 / 255.0) - 0.502_886_5).abs() < 1e-6);
    assert!((srgb.linear(10.0 / 255.0) - 10.0 / 255.0 / 12.92).abs() < 1e-8);
    assert_eq!((srgb.linear(0.0), srgb.linear(1.0)), (0.0, 1.0));
    let rec709 = ColorSpace::from_name("rec709").unwrap();
    assert!((rec709.linear(0.5) - ((0.5f32 + 0.099) / 1.099).powf(1.0 / 0.45)).abs() < 2e-5);
    let gamma = ColorSpace::from_name("gamma-2.2").unwrap();
    assert!((gamma.linear(128.0 / 255.0) - (128.0f32 / 255.0).powf(2.2)).abs() < 1e-6);
    let other = ColorSpace::from_name("linear-rec2020").unwrap();
    assert_eq!((other.linear(1.0), other.linear_name.as_str()), (1.0, "linear-rec2020"));
    assert!(matches!(ColorSpace::from_name("gamma-x"), Err(Error::Unsupported(_))));
    assert!(matches!(ColorSpace::from_name("slog3"), Err(Error::Unsupported(_))));
}

#[test]
fn every_format_gives_the_same_radiance() {
    let folder = tempfile::tempdir().unwrap();
    let space = ColorSpace::from_name("srgb").unwrap();
    let read = |name: &str| {
        let path = folder.path().join(name);
        match read_radiance_image(&path, &FileAccess::default(), &space, Some((3, 2))) {
            Ok(picture) => picture,
            Err(fault) => panic!("{}", Error::from(fault)),
        }
    };
    let codes: Vec<u8> = (0..18).map(|i| i * 15).collect();
    let picture = image::RgbImage::from_raw(3, 2, codes.clone()).unwrap();
    picture.save(folder.path().join("a.png")).unwrap();
    picture.save(folder.path().join("a.tiff")).unwrap();
    let deep: Vec<u16> = codes.iter().map(|&c| c as u16 * 257).collect();
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(3, 2, deep).unwrap();
    deep.save(folder.path().join("b.png")).unwrap();
    let linear = |i: usize| space.linear(codes[i] as f32 / 255.0);
    exr::prelude::write_rgb_file(folder.path().join("a.exr"), 3, 2, |x, y| {
        let at = (y * 3 + x) * 3;
        (linear(at), linear(at + 1), linear(at + 2))
    })
    .unwrap();
    for name in ["a.png", "b.png", "a.tiff", "a.exr"] {
        let picture = read(name);
        assert!(picture.alpha.is_none());
        let found: Vec<f32> = picture.colour.data.iter().flatten().copied().collect();
        assert_eq!(found, (0..18).map(linear).collect::<Vec<_>>(), "{name}");
    }
    let grey = image::GrayImage::from_raw(3, 2, vec![0, 50, 100, 150, 200, 255]).unwrap();
    grey.save(folder.path().join("g.jpg")).unwrap();
    let picture = read("g.jpg");
    assert!((picture.colour.data[5][1] - 1.0).abs() < 0.1);
    let mut clear = image::RgbaImage::from_pixel(3, 2, image::Rgba([9, 9, 9, 255]));
    clear.put_pixel(1, 1, image::Rgba([9, 9, 9, 100]));
    clear.save(folder.path().join("c.png")).unwrap();
    assert_eq!(read("c.png").alpha.unwrap().data, [true, true, true, true, false, true]);
}

#[test]
fn cropped_and_damaged_exr() {
    use exr::prelude::*;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cropped.exr");
    let values = SpecificChannels::rgb(|p: Vec2<usize>| {
        if p == Vec2(1, 0) { (f32::INFINITY, 1.0, 1.0) } else { (p.x() as f32 + 1.0, p.y() as f32, 3.0) }
    });
    let mut layer = LayerAttributes::named("main");
    layer.layer_position = Vec2(11, 6);
    let layer = Layer::new((2, 2), layer, Encoding::FAST_LOSSLESS, values);
    let window = IntegerBounds { position: Vec2(10, 5), size: Vec2(4, 3) };
    Image { attributes: ImageAttributes::new(window), layer_data: layer }.write().to_file(&path).unwrap();
    let space = ColorSpace::from_name("srgb").unwrap();
    let picture = read_radiance_image(&path, &FileAccess::default(), &space, Some((4, 3))).ok().unwrap().colour;
    assert_eq!(*picture.value_at(0, 0), [0.0; 3]);
    assert_eq!(*picture.value_at(1, 1), [1.0, 0.0, 3.0]);
    assert_eq!(*picture.value_at(2, 2), [2.0, 1.0, 3.0]);
    assert!(picture.value_at(2, 1).iter().all(|c| c.is_nan()));
    let whole = std::fs::read(&path).unwrap();
    for length in [0, 1, 4, 20, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(
            matches!(read_radiance_image(&path, &FileAccess::default(), &space, None), Err(ImageFault::Unreadable(_))),
            "{length}"
        );
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let picture = image::RgbImage::from_fn(9, 7, |x, y| image::Rgb([(x * 20) as u8, (y * 30) as u8, 5]));
    for name in ["a.png", "a.tiff", "a.jpg", "a.exr"] {
        let file = folder.path().join(name);
        match name {
            "a.exr" => exr::prelude::write_rgb_file(&file, 9, 7, |x, y| (x as f32, y as f32, 0.5)).unwrap(),
            _ => picture.save(&file).unwrap(),
        }
        let whole = std::fs::read(&file).unwrap();
        for at in 0..whole.len().min(700) {
            for value in [0, 0x7f, 0xff, whole[at] ^ 1] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                let access = FileAccess::default();
                let read = |raw: &RawImage| raw.values.len();
                if let Ok(count) = decode(&file, &bytes, &access, Some((9, 7)), read) {
                    assert_eq!(count, 4 * 63);
                }
            }
        }
    }
}

#[test]
fn sizes_come_from_the_header_alone() {
    let folder = tempfile::tempdir().unwrap();
    let picture = image::RgbImage::from_fn(300, 200, |x, y| image::Rgb([(x * 7) as u8, (y * 11) as u8, (x * y) as u8]));
    for name in ["a.png", "a.jpg", "a.exr", "a.hdr"] {
        let path = folder.path().join(name);
        match name {
            "a.exr" => {
                exr::prelude::write_rgb_file(&path, 300, 200, |x, y| (x as f32, y as f32, (x * y % 7) as f32)).unwrap();
            }
            "a.hdr" => image::DynamicImage::from(picture.clone()).into_rgb32f().save(&path).unwrap(),
            _ => picture.save(&path).unwrap(),
        }
        let whole = std::fs::read(&path).unwrap();
        // Hours of film behind the header would not be read.
        std::fs::write(&path, &whole[..whole.len().min(1400)]).unwrap();
        assert_eq!(read_size(&path, &FileAccess::default()).unwrap(), (300, 200), "{name}");
        for length in 0..whole.len().min(400) {
            std::fs::write(&path, &whole[..length]).unwrap();
            let _ = read_size(&path, &FileAccess::default());
        }
    }
}

#[test]
fn the_part_with_colour_is_placed_and_charged() {
    use exr::prelude::*;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("parts.exr");
    let write = |sampling: usize, width: usize| {
        let channel = |name: &str, value: f32, sampling: usize| {
            let samples = FlatSamples::F32(vec![value; (width / sampling) * (2 / sampling)]);
            AnyChannel { sampling: Vec2(sampling, sampling), ..AnyChannel::new(name, samples) }
        };
        let part = |name: &str, at: i32, channels| {
            let mut attributes = LayerAttributes::named(name);
            attributes.layer_position = Vec2(at, 0);
            Layer::new((width, 2), attributes, Encoding::UNCOMPRESSED, AnyChannels::sort(channels))
        };
        let colour = [channel("R", 1.0, 1), channel("G", 2.0, 1), channel("B", 3.0, sampling)];
        let parts = vec![
            part("depth", 0, [channel("Z", 9.0, 1)].into_iter().collect()),
            part("beauty", 2, colour.into_iter().collect()),
        ];
        let window = ImageAttributes::new(IntegerBounds::from_dimensions((4, 3)));
        Image::from_layers(window, parts).write().to_file(&path)
    };
    let read = |memory_bytes: u64| {
        let limits = crate::limits::Limits { memory_bytes, ..Default::default() };
        read_radiance(&path, &FileAccess::new(limits))
    };
    write(1, 4).unwrap();
    let black = [0.0; 3];
    let row = [black, black, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]];
    assert_eq!(read(1 << 20).unwrap().data, [row, row, [black; 4]].concat());
    // Its blocks may be wider than the picture.
    write(1, 40_000).unwrap();
    assert_eq!(read(8 << 20).unwrap().data, [row, row, [black; 4]].concat());
    assert!(matches!(read(2 << 20), Err(crate::Error::InputMemory { .. })));
    if write(2, 4).is_ok() {
        let error = read(1 << 20).unwrap_err().to_string();
        assert!(error.contains("subsampled channels are not supported"), "{error}");
    }
}

/// A picture of one colour with an ICC profile or EXIF data.
fn with_metadata(
    format: image::ImageFormat,
    codes: [u8; 3],
    profile: Option<Vec<u8>>,
    exif: Option<Vec<u8>>,
) -> Vec<u8> {
    use image::ImageEncoder;
    let mut bytes = std::io::Cursor::new(Vec::new());
    let pixels = codes.repeat(64);
    macro_rules! encode {
        ($encoder:expr, $pixels:expr, $kind:expr) => {{
            let mut encoder = $encoder;
            profile.into_iter().for_each(|profile| encoder.set_icc_profile(profile).unwrap());
            exif.into_iter().for_each(|exif| encoder.set_exif_metadata(exif).unwrap());
            encoder.write_image($pixels, 8, 8, $kind).unwrap();
        }};
    }
    match format {
        image::ImageFormat::Png => {
            encode!(image::codecs::png::PngEncoder::new(&mut bytes), &pixels, image::ExtendedColorType::Rgb8)
        }
        image::ImageFormat::Jpeg => encode!(
            image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 100),
            &pixels,
            image::ExtendedColorType::Rgb8
        ),
        _ => {
            let deep: Vec<u8> = pixels.iter().flat_map(|&code| (u16::from(code) * 257).to_ne_bytes()).collect();
            encode!(image::codecs::tiff::TiffEncoder::new(&mut bytes), &deep, image::ExtendedColorType::Rgb16)
        }
    }
    bytes.into_inner()
}

#[test]
fn what_files_say_about_their_colours_is_applied() {
    use image::ImageFormat::{Jpeg, Png, Tiff};
    use moxcms::ColorProfile;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let read = |bytes: &[u8], space: &ColorSpace| {
        std::fs::write(&path, bytes).unwrap();
        let access = FileAccess::default();
        let picture = read_radiance_image(&path, &access, space, None).map_err(crate::Error::from).unwrap();
        (*picture.colour.value_at(3, 3), access.remarks())
    };
    let near = |found: [f32; 3], expected: [f64; 3], tolerance: f64| {
        assert!((0..3).all(|c| (f64::from(found[c]) - expected[c]).abs() < tolerance), "{found:?} {expected:?}");
    };
    let codes = [200, 100, 50];
    let encoded = codes.map(|code| f64::from(code) / 255.0);
    // Adobe RGB (1998), its matrix to Rec. 709 by hand.
    let [r, g, b] = encoded.map(|v| v.powf(2.199_218_75));
    let adobe = [1.3983 * r - 0.3983 * g, g, -0.0429 * g + 1.0429 * b];
    let space = ColorSpace::from_files();
    for (format, tolerance) in [(Png, 1e-3), (Tiff, 1e-3), (Jpeg, 2e-2)] {
        let profile = ColorProfile::new_adobe_rgb().encode().unwrap();
        let bytes = with_metadata(format, codes, Some(profile), None);
        let (found, remarks) = read(&bytes, &space);
        near(found, adobe, tolerance);
        assert!(remarks.is_empty(), "{remarks:?}");
        let (found, remarks) = read(&bytes, &ColorSpace::from_name("srgb").unwrap());
        near(found, encoded.map(from_srgb), tolerance);
        assert!(remarks[0].contains("is not applied, as a colour space is declared"), "{remarks:?}");
    }
    let mut linear = ColorProfile::new_srgb();
    let straight = Some(moxcms::ToneReprCurve::Lut(Vec::new()));
    (linear.red_trc, linear.green_trc, linear.blue_trc) = (straight.clone(), straight.clone(), straight);
    let tiff = with_metadata(Tiff, codes, Some(linear.encode().unwrap()), None);
    near(read(&tiff, &space).0, encoded, 1e-5);
    let (found, remarks) = read(&with_metadata(Png, codes, Some(b"no profile".to_vec()), None), &space);
    near(found, encoded.map(from_srgb), 1e-6);
    assert!(remarks[0].contains("ICC profile is not applied: it is damaged"), "{remarks:?}");

    // PNG's chunk gAMA, put before the pixels.
    let png = with_metadata(Png, codes, None, None);
    let body = [&b"gAMA"[..], &100_000u32.to_be_bytes()].concat();
    let chunk = [&4u32.to_be_bytes()[..], &body, &crc32fast::hash(&body).to_be_bytes()].concat();
    near(read(&[&png[..33], &chunk, &png[33..]].concat(), &space).0, encoded, 1e-5);

    // Radiance: what the pixels were multiplied with.
    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE=2\nCOLORCORR=1 2 4\n\n-Y 8 +X 7\n";
    let hdr = [&hdr[..], &[128, 128, 128, 129].repeat(56)].concat();
    near(read(&hdr, &space).0, [0.25, 0.125, 0.0625], 1e-2);

    // EXR: Rec. 2020's green in Rec. 709 (ITU-R BT.2407).
    use exr::prelude::*;
    let channels = SpecificChannels::rgb(|_: Vec2<usize>| (0.0f32, 1.0f32, 0.0f32));
    let mut image = Image::from_channels((8, 8), channels);
    image.attributes.chromaticities = Some(exr::meta::attribute::Chromaticities {
        red: Vec2(0.708, 0.292),
        green: Vec2(0.170, 0.797),
        blue: Vec2(0.131, 0.046),
        white: Vec2(0.3127, 0.3290),
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    near(read(bytes.get_ref(), &space).0, [-0.5876, 1.1329, -0.1006], 1e-3);
    let (found, remarks) = read(bytes.get_ref(), &ColorSpace::from_name("linear-rec2020").unwrap());
    assert!(found == [0.0, 1.0, 0.0] && remarks[0].contains("linear-rec2020 is declared"), "{found:?} {remarks:?}");
}

#[test]
fn orientations_are_applied_where_the_camera_is_upright() {
    use image::ImageEncoder;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let stored = Grid { width: 5, height: 3, data: (0..15u8).map(|k| [16 * k, 7, 9]).collect() };
    for number in 1..=8u8 {
        // EXIF of one entry: tag 274, a short.
        let exif = [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[number, 0, 0, 0, 0, 0, 0, 0]].concat();
        let mut bytes = Vec::new();
        let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
        encoder.set_exif_metadata(exif).unwrap();
        encoder.write_image(stored.data.as_flattened(), 5, 3, image::ExtendedColorType::Rgb8).unwrap();
        std::fs::write(&path, bytes).unwrap();
        let orientation = ImageOrientation::from_exif(number).unwrap();
        let upright = orientation.apply(stored.clone());
        let linear = |codes: &Grid<[u8; 3]>| codes.map(|p| p.map(|c| from_srgb(f64::from(c) / 255.0) as f32));
        let space = ColorSpace::from_name("srgb").unwrap();
        let access = FileAccess::default();
        let read = |size| read_radiance_image(&path, &access, &space, size).map_err(Error::from).map(|p| p.colour);
        assert_eq!(read(None).unwrap(), linear(&upright), "{number}");
        assert_eq!(read(Some((5, 3))).unwrap(), linear(&stored), "{number}");
        // Where both sizes are the same, it is said that nothing is turned.
        assert_eq!(access.remarks().len(), usize::from([2, 3, 4].contains(&number)), "{number}");
        match read(Some((3, 5))) {
            Ok(found) => assert!(number >= 5 && found == linear(&upright), "{number}"),
            Err(error) => assert!(number < 5 && error.to_string().contains("the picture is 5 x 3 pixels,"), "{error}"),
        }
        #[cfg(feature = "ar")]
        assert_eq!(read_display_image(&path, &access).unwrap(), Some((upright, orientation)), "{number}");
    }
}
