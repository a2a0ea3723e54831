//! Captures with faults and captures of other kinds, from the photographs to the file and back.

use crate::support;
use crate::support::{encode_default, read, sample, shared, variant};
use tsuya::Component;
use tsuya::Error;
use tsuya::decoder::{DecodeOptions, decode};
use tsuya::encoder::encode;
use tsuya::metrics;
use tsuya::{EncodeOptions, EncodeTarget, Photograph, Profile, Refinement, SpecularModel};

/// What an error should be and say.
fn fails(result: tsuya::Result<impl Sized>, words: &str) {
    let Err(error) = result else { panic!("no error: {words}") };
    assert!(error.to_string().contains(words), "{error}\nexpected: {words}");
}

fn without_polarisers(description: &mut serde_json::Value) {
    for frame in description["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("cross_file_path");
    }
    description["white_reference"].as_object_mut().unwrap().remove("cross_file_path");
}

#[test]
fn one_component_without_polarisers_in_both_profiles() {
    let capture = variant(8, |description, _| without_polarisers(description));
    for (profile, least) in [(Profile::Predictive, 36.0), (Profile::WaveletTexture, 24.0)] {
        let options = EncodeOptions { profile, ..Default::default() };
        let encoded = encode(read(capture.path()).unwrap(), &options).unwrap();
        let (psnr, coverage) = (encoded.image_psnr, encoded.coverage);
        assert!(psnr.sum.unwrap() > least && coverage > 0.94, "{psnr:?}");
        assert_eq!((psnr.diffuse, psnr.specular), (None, None));
        let asset = decode(&encoded.bytes, &DecodeOptions::default()).unwrap();
        assert_eq!(asset.components, [Component::Combined]);
        assert_eq!(asset.photographs.iter().flatten().count(), 8);
    }
}

#[test]
fn without_masks_the_mesh_says_what_is_object() {
    let capture = variant(5, |description, _| {
        for frame in description["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("mask_path");
        }
    });
    let encoded = encode_default(capture.path()).unwrap();
    assert_eq!(encoded.coverage, 1.0);
    assert!(encoded.image_psnr.sum.unwrap() > 36.0);
}

#[test]
fn a_capture_without_a_mesh_is_encoded_with_its_hull() {
    let capture = variant(36, |description, folder| {
        description.as_object_mut().unwrap().remove("mesh_file");
        std::fs::remove_file(folder.join("scan.ply")).unwrap();
    });
    let fault = read(capture.path()).err().unwrap().to_string();
    assert!(fault.contains("names no mesh") && fault.contains("`capture::visual_hull`"), "{fault}");
    let hull = capture.path().join("hull.ply");
    let path = support::text(capture.path());
    let found = support::json(&["hull", path, "-o", support::text(&hull), "--json"]);
    assert_eq!((&found["views"], &found["resolution"]), (&36.into(), &40.into()));
    let checked = support::json(&["check", path, "--json"]);
    assert!(checked["agreement"]["silhouette_iou"].as_f64().unwrap() > 0.95, "{checked}");
    let encoded = encode_default(capture.path()).unwrap();
    assert!(
        encoded.image_psnr.sum.unwrap() > 36.0 && encoded.coverage > 0.9,
        "{:?} {}",
        encoded.image_psnr,
        encoded.coverage
    );
}

#[test]
fn unknown_lights_make_a_file_that_cannot_be_relit() {
    let capture = variant(6, |description, _| {
        description.as_object_mut().unwrap().remove("light");
        for frame in description["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("light_position");
        }
    });
    let encoded = encode_default(capture.path()).unwrap();
    let asset = decode(&encoded.bytes, &DecodeOptions::default()).unwrap();
    assert!(!asset.reflectance.as_ref().unwrap().relightable);
    let light = tsuya::PointLight { position: [1.0, 2.0, 3.0], intensity: [9.0; 3] };
    let options = tsuya::relight::RenderOptions {
        lighting: tsuya::relight::RenderLighting::Points(vec![light]),
        ..Default::default()
    };
    assert!(tsuya::relight::render(&asset, &asset.views[0].camera, &options).is_err());
}

#[test]
fn missing_pixels_are_counted_and_not_compared() {
    let capture = variant(4, |_, folder| {
        let path = folder.join("off/002.exr");
        let image = exr::prelude::read_first_rgba_layer_from_file(
            &path,
            |size, _| vec![[0f32; 3]; size.0 * size.1],
            |pixels: &mut Vec<[f32; 3]>, at, (r, g, b, _): (f32, f32, f32, f32)| pixels[at.1 * 128 + at.0] = [r, g, b],
        )
        .unwrap();
        let pixels = image.layer_data.channel_data.pixels;
        exr::prelude::write_rgb_file(&path, 128, 128, |x, y| {
            let [r, g, b] = pixels[y * 128 + x];
            match (x, y) {
                (60..70, 70) => (f32::NAN, g, b),
                (60..70, 71) => (r, f32::INFINITY, b),
                _ => (r, g, b),
            }
        })
        .unwrap();
    });
    let read_back = read(capture.path()).unwrap();
    assert_eq!((read_back.missing_pixels, read_back.skipped_frames), (20, 0));
    let encoded = encode(read_back, &EncodeOptions::default()).unwrap();
    assert!(encoded.warnings.iter().any(|w| w.contains("20 pixels")), "{:?}", encoded.warnings);
    assert!(encoded.image_psnr.sum.unwrap() > 36.0);
}

#[test]
fn missing_photographs_are_skipped_and_counted() {
    let capture = variant(5, |_, folder| {
        std::fs::remove_file(folder.join("off/001.exr")).unwrap();
        std::fs::write(folder.join("cross/002.exr"), b"").unwrap();
        let mask = image::GrayImage::new(128, 128);
        mask.save(folder.join("mask/003.png")).unwrap();
    });
    let read_back = read(capture.path()).unwrap();
    assert_eq!((read_back.skipped_frames, read_back.frames.len()), (3, 2));
    assert_eq!(read_back.warnings.len(), 3);
    assert!(read_back.warnings[2].contains("mask is empty"));
    let encoded = encode(read_back, &EncodeOptions::default()).unwrap();
    assert_eq!(decode(&encoded.bytes, &DecodeOptions::default()).unwrap().views.len(), 2);
}

#[test]
fn wrong_captures_say_what_is_wrong() {
    let size = variant(2, |_, folder| {
        exr::prelude::write_rgb_file(folder.join("off/001.exr"), 64, 64, |_, _| (0.5, 0.5, 0.5)).unwrap();
    });
    fails(read(size.path()), "64 x 64 pixels, its camera is declared as 128 x 128");
    let beside = variant(2, |_, folder| {
        std::fs::write(
            folder.join("scan.ply"),
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
             property list uchar int vertex_indices\nend_header\n900 900 900\n901 900 900\n900 901 900\n3 0 1 2\n",
        )
        .unwrap();
    });
    fails(read(beside.path()), "capture::align");
    let empty = variant(2, |_, folder| std::fs::write(folder.join("scan.ply"), b"").unwrap());
    fails(read(empty.path()), "0 bytes");
    let nothing = variant(2, |_, folder| {
        for name in ["000", "001"] {
            image::GrayImage::new(128, 128).save(folder.join(format!("mask/{name}.png"))).unwrap();
        }
    });
    fails(read(nothing.path()), "mask is empty");
    let truncated = variant(1, |_, folder| {
        let path = folder.join("transforms.json");
        std::fs::write(path, b"{").unwrap();
    });
    std::fs::write(truncated.path().join("transforms.json"), b"{\"frames\": [").unwrap();
    assert!(matches!(read(truncated.path()), Err(Error::Input { .. })));
}

#[test]
fn targets_are_reached() {
    let capture = read(variant(6, |_, _| {}).path()).unwrap();
    let with = |target| {
        let options = EncodeOptions { target: Some(target), ..Default::default() };
        encode(capture.clone(), &options).unwrap()
    };
    let encoded = with(EncodeTarget::PsnrDb(42.0));
    assert!((42.0..42.6).contains(&encoded.image_psnr.sum.unwrap()), "{:?}", encoded.image_psnr);
    let small = with(EncodeTarget::MaxBytes(20_000));
    assert!(small.bytes.len() <= 20_000 && small.bytes.len() > 15_000, "{}", small.bytes.len());
    let asset = decode(&with(EncodeTarget::MaxError(0.1)).bytes, &DecodeOptions::default()).unwrap();
    let observed = tsuya::encoder::separate(&mut capture.clone()).unwrap();
    let mut largest = 0f64;
    for ((frame, view), decoded) in observed.views.iter().zip(&asset.views).zip(asset.photographs.iter().flatten()) {
        let covered = tsuya::internals::surface::rasterise(&asset.mesh, &view.camera).coverage();
        let mask = frame.mask.as_ref().unwrap();
        for (wanted, got) in frame.images.iter().zip(&decoded.images) {
            for at in (0..mask.data.len()).filter(|&at| mask.data[at] && covered.data[at]) {
                for c in 0..3 {
                    let signal = |image: &tsuya::image::RgbImage| metrics::signal(image.data[at][c], asset.white[c]);
                    largest = largest.max((signal(wanted) - signal(got)).abs());
                }
            }
        }
    }
    assert!(largest <= 0.1 + 1e-6, "{largest}");
}

#[test]
fn real_photographs_with_a_colmap_model() {
    let Some(path) = shared("multiview/templeRing") else { return };
    let mut capture = read(&path).unwrap();
    assert_eq!(capture.frames.len(), 47);
    capture.frames.truncate(4);
    let encoded = encode(capture, &EncodeOptions::default()).unwrap();
    assert!(encoded.image_psnr.sum.unwrap() > 36.0, "{:?}", encoded.image_psnr);
    let asset = decode(&encoded.bytes, &DecodeOptions::default()).unwrap();
    assert_eq!(asset.components, [Component::Combined]);
    assert!(!asset.reflectance.unwrap().relightable);
}

#[test]
fn the_sample_is_what_it_says() {
    let capture = read(&sample()).unwrap();
    assert_eq!((capture.frames.len(), capture.mesh.triangles.len()), (36, 1500));
    let beta = capture.beta.unwrap();
    assert!(beta.iter().all(|b| (b - 0.25).abs() < 0.01), "{beta:?}");
}

/// Normals out of shading and highlights: views that the refinement never saw come back better, with any number of threads.
#[test]
fn a_refined_surface_explains_views_that_were_left_out() {
    let held_out = |refine: Refinement, specular: SpecularModel| {
        let options = EncodeOptions { refine, specular, hold_out: Some(6), ..Default::default() };
        let encoded = encode(read(&sample()).unwrap(), &options).unwrap();
        let asset = decode(&encoded.bytes, &DecodeOptions::default()).unwrap();
        let observations = tsuya::encoder::separate(&mut read(&sample()).unwrap()).unwrap();
        let left_out = observations.views.into_iter().skip(5).step_by(6);
        let (views, originals): (Vec<_>, Vec<_>) = left_out
            .map(|view| (view.view, Photograph { mask: view.mask.unwrap_or_default(), images: view.images }))
            .unzip();
        tsuya::relight::hold_out(&asset, &views, &originals).unwrap().interpolated.psnr()
    };
    let scan = held_out(Refinement::None, SpecularModel::TorranceSparrow);
    let refined = held_out(Refinement::Surface, SpecularModel::GgxLobes);
    println!("{scan:?} {refined:?}");
    assert!(refined.specular.unwrap() > scan.specular.unwrap() + 1.0, "{scan:?} {refined:?}");
    assert!(refined.sum.unwrap() > scan.sum.unwrap() + 0.5, "{scan:?} {refined:?}");

    let refine = |threads: usize| {
        let mut capture = read(&sample()).unwrap();
        let mesh = capture.mesh.clone();
        let observations = tsuya::encoder::separate(&mut capture).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| tsuya::internals::refine::refine_observations(&mesh, &observations)).unwrap()
    };
    assert_eq!(refine(1), refine(3));
}

/// Without known lights there is nothing to refine by; the file is made and says so.
#[test]
fn a_surface_that_cannot_be_refined_stays() {
    let capture = variant(4, |description, _| without_polarisers(description));
    let options = EncodeOptions { refine: Refinement::Surface, ..Default::default() };
    let capture = read(capture.path()).unwrap();
    let triangles = capture.mesh.triangles.len();
    let encoded = encode(capture, &options).unwrap();
    assert!(encoded.warnings.iter().any(|warning| warning.starts_with("the surface stays")), "{:?}", encoded.warnings);
    assert_eq!(decode(&encoded.bytes, &DecodeOptions::default()).unwrap().mesh.triangles.len(), triangles);
}
