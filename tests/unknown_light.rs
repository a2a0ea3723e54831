//! Captures that do not state their light: a lamp is assumed or fitted, and the object is relit.

use crate::support;
use crate::support::{bundled, complaint, json, read, text};
use tsuya::capture::{Capture, CaptureFrame};
use tsuya::decoder::{DecodeOptions, decode};
use tsuya::encoder::{EncodedFile, encode};
use tsuya::lighting::EnvironmentMap;
use tsuya::relight::{
    AssetShading, EnvironmentRender, ReferenceOptions, RenderLighting, RenderObject, RenderOptions, reference, render,
};
use tsuya::{Asset, AssumedLight, CaptureLight, EncodeOptions, PointLight, Profile, Refinement, View};

/// A bundled capture without its lights, and those.
fn without_lights(name: &str) -> (Capture, Vec<PointLight>) {
    let mut capture = read(&bundled(name)).unwrap();
    let lights = capture.frames.iter_mut().map(|frame| frame.view.light.take().unwrap()).collect();
    (capture, lights)
}

fn encode_lit(capture: Capture, light: Option<CaptureLight>) -> (EncodedFile, Asset) {
    let encoded = encode(capture, &EncodeOptions { light, check: false, ..Default::default() }).unwrap();
    let asset = decode(&encoded.bytes, &DecodeOptions::default()).unwrap();
    (encoded, asset)
}

/// PSNR between two renders of an asset from its third camera, by the square root of radiance over the brightest, after the best factor.
fn relit_psnr(one: &Asset, other: &Asset, light: PointLight) -> f64 {
    let options = RenderOptions { lighting: RenderLighting::Points(vec![light]), ..Default::default() };
    let [a, b] = [one, other].map(|asset| render(asset, &one.views[2].camera, &options).unwrap().image.data);
    let sums = a.as_flattened().iter().zip(b.as_flattened()).fold([0.0; 2], |s, (a, b)| [s[0] + a * b, s[1] + b * b]);
    let (gain, most) = (sums[0] / sums[1], a.as_flattened().iter().fold(0f32, |most, &x| most.max(x)));
    let shown: Vec<(f32, f32)> = (a.as_flattened().iter().zip(b.as_flattened()))
        .map(|(&a, &b)| (a, gain * b))
        .filter(|(a, _)| *a > 0.0)
        .collect();
    let squares = shown.iter().map(|(a, b)| f64::from(((a / most).sqrt() - (b / most).sqrt()).powi(2)));
    -10.0 * (squares.sum::<f64>() / shown.len() as f64).log10()
}

#[test]
fn a_lamp_beside_the_camera_is_found() {
    let (capture, lights) = without_lights("unpolarised");
    let stated = encode_lit(read(&bundled("unpolarised")).unwrap(), None).1;
    let plain = encode_lit(capture.clone(), None).0;
    let (encoded, asset) = encode_lit(capture.clone(), Some(CaptureLight::Camera { offset: None, intensity: None }));
    let Some(AssumedLight::Camera { offset, intensity, fitted }) = encoded.assumed_light else { panic!() };
    assert_eq!(fitted, ["offset", "intensity"]);
    // The lamps of this capture turn a little against the camera; this is the middle one.
    for (found, right) in offset.into_iter().zip([1.09, 2.19, -0.19]) {
        assert!((found - right).abs() < 0.2, "{offset:?}");
    }
    assert!(intensity[0] == intensity[2] && (35.0..60.0).contains(&intensity[0]), "{intensity:?}");
    assert!(encoded.warnings.iter().any(|said| said.contains("neither the intensity nor the colour")));
    assert_eq!(asset.metadata["assumed_light"]["kind"], "camera");
    // The photographs cost hardly more than without any light.
    assert!(encoded.bytes.len() < plain.bytes.len() * 107 / 100, "{} {}", encoded.bytes.len(), plain.bytes.len());
    let lamp = PointLight { position: [-3.0, 2.0, 2.0], intensity: [40.0; 3] };
    let psnr = relit_psnr(&stated, &asset, lamp);
    assert!(psnr > 27.0, "{psnr}");
    // The same file comes of the same capture.
    let again = encode_lit(capture, Some(CaptureLight::Camera { offset: None, intensity: None })).0;
    assert!(again.bytes == encoded.bytes && lights.len() == 10);
}

#[test]
fn a_lamp_that_is_given_is_as_good_as_one_that_is_stated() {
    let (mut capture, lights) = without_lights("unpolarised");
    // Frames of one lamp of the three.
    let frames = std::mem::take(&mut capture.frames);
    capture.frames = frames.into_iter().step_by(3).collect();
    let offset = Some([1.319, 2.161, -0.249]);
    let (_, asset) =
        encode_lit(capture.clone(), Some(CaptureLight::Camera { offset, intensity: Some(lights[0].intensity) }));
    for (view, light) in asset.views.iter().zip(lights.iter().step_by(3)) {
        let found = view.light.unwrap();
        assert_eq!(found.intensity, light.intensity);
        (0..3).for_each(|k| assert!((found.position[k] - light.position[k]).abs() < 2e-3, "{found:?} {light:?}"));
    }
    // One that stands still relative to the object, and replaces what the capture states.
    let lit = read(&bundled("unpolarised")).unwrap();
    let lamp = CaptureLight::Lamp { position: [1.0, 2.0, 3.0], intensity: Some([50.0, 49.0, 48.0]) };
    let (encoded, asset) = encode_lit(lit, Some(lamp));
    let standing = PointLight { position: [1.0, 2.0, 3.0], intensity: [50.0, 49.0, 48.0] };
    assert!(
        asset
            .views
            .iter()
            .all(|view| (0..3).all(|k| (view.light.unwrap().position[k] - standing.position[k]).abs() < 1e-3)
                && view.light.unwrap().intensity == standing.intensity)
    );
    assert!(
        encoded.warnings.iter().any(|said| said.contains("replaces the lights that the capture states of 10 views"))
    );
}

/// A quadrant that is bright, above a dim sky and a dimmer ground.
fn hall(towards: [f64; 3]) -> EnvironmentMap {
    EnvironmentMap::from_fn(32, |d| {
        let along: f64 = (0..3).map(|k| d[k] * towards[k]).sum();
        let radiance = 6.0 * (4.0 * (along - 1.0)).exp() + 0.4 + 0.2 * d[1];
        [1.05 * radiance as f32, radiance as f32, 0.93 * radiance as f32]
    })
}

/// An object of the sample's shape and colours under an environment, as some of its cameras see it, by brute force.
fn photographs(asset: &Asset, environment: &EnvironmentMap, views: &[usize]) -> Vec<EnvironmentRender> {
    let object = RenderObject::new(&asset.mesh, None).unwrap();
    let shading = AssetShading::new(asset, 8).unwrap();
    let options = ReferenceOptions { samples: 1, ..Default::default() };
    let view = |&k: &usize| reference(&object, environment, &asset.views[k].camera, &shading, &options).unwrap();
    views.iter().map(view).collect()
}

#[test]
fn an_environment_is_found_and_the_object_relit() {
    let as_scanned = EncodeOptions { refine: Refinement::None, ..Default::default() };
    let truth = encode(read(&support::sample()).unwrap(), &as_scanned).unwrap();
    let truth = decode(&truth.bytes, &DecodeOptions::default()).unwrap();
    let (here, there) = (hall([0.6, 0.64, 0.48]), hall([-0.8, 0.6, 0.0]));
    let chosen: Vec<usize> = (0..36).step_by(3).collect();
    let mut capture = read(&support::sample()).unwrap();
    (capture.white, capture.beta) = ([1.0; 3], None);
    let all = std::mem::take(&mut capture.frames);
    for (&k, seen) in chosen.iter().zip(photographs(&truth, &here, &chosen)) {
        let view = View { light: None, ..all[k].view.clone() };
        let mask = Some(seen.coverage.map(|&covered| covered > 0.5));
        capture.frames.push(CaptureFrame { view, photograph: seen.image, cross: None, mask });
    }
    let (plain, unlit) = encode_lit(capture.clone(), None);
    let (encoded, asset) = encode_lit(capture, Some(CaptureLight::Environment { mean_radiance: None }));
    assert!(!unlit.reflectance.unwrap().relightable && asset.reflectance.as_ref().unwrap().relightable);
    assert!(matches!(&encoded.assumed_light, Some(AssumedLight::Environment { explained, .. }) if *explained > 0.3));
    // The photographs come back as they do without, bit for bit; the light and the maps are little beside them.
    assert_eq!(asset.photographs, unlit.photographs);
    let bytes =
        |file: &EncodedFile, tag: &str| file.sections.iter().find(|(t, _)| t == tag).map_or(0, |(_, bytes)| *bytes);
    let grown = encoded.bytes.len() as u64 - plain.bytes.len() as u64;
    println!("{grown} bytes more, {} of light, maps {}", bytes(&encoded, "lIGt"), bytes(&encoded, "RFLC"));
    assert_eq!(bytes(&encoded, "PLAN"), bytes(&plain, "PLAN"));
    assert!(bytes(&encoded, "lIGt") < 6000 && grown < 12_000, "{grown}");
    // Brighter from where it comes.
    let light = asset.light.as_ref().unwrap();
    let [lit, dark] = [[0.6, 0.64, 0.48], [-0.6, -0.64, -0.48]].map(|normal| light.irradiance(normal)[1]);
    assert!(lit > 3.0 * dark, "{lit} {dark}");
    // Under another environment, up to the scale and the colour that no photograph tells.
    let [right, found] = [&truth, &asset].map(|asset| {
        let views: Vec<usize> = (0..asset.views.len()).step_by(asset.views.len() / 4).collect();
        photographs(asset, &there, &views)
    });
    let mut squares = (0.0, 0);
    for c in 0..3 {
        let pairs: Vec<(f32, f32)> = (right.iter().zip(&found))
            .flat_map(|(a, b)| (0..a.image.data.len()).map(move |k| (a, b, k)))
            .filter(|(a, b, k)| a.coverage.data[*k] > 0.5 && b.coverage.data[*k] > 0.5)
            .map(|(a, b, k)| (a.image.data[k][c], b.image.data[k][c]))
            .collect();
        let sums = pairs.iter().fold([0.0; 2], |s, (a, b)| [s[0] + a * b, s[1] + b * b]);
        let display = |x: f32| x.clamp(0.0, 1.0).powf(1.0 / 2.2);
        for (a, b) in pairs {
            squares = (squares.0 + f64::from(display(a) - display(sums[0] / sums[1] * b)).powi(2), squares.1 + 1);
        }
    }
    let psnr = -10.0 * (squares.0 / f64::from(squares.1)).log10();
    println!("relit {psnr:.2} dB");
    // Measured: 25.0 (24.998).
    assert!(psnr > 24.5, "{psnr}");
}

#[test]
fn lights_that_are_none_are_refused() {
    let (capture, _) = without_lights("unpolarised");
    for light in [
        CaptureLight::Camera { offset: Some([f64::NAN, 0.0, 0.0]), intensity: None },
        CaptureLight::Camera { offset: None, intensity: Some([1.0, 0.0, 1.0]) },
        CaptureLight::Lamp { position: [1e300, 0.0, 0.0], intensity: None },
        CaptureLight::Lamp { position: [1.0, 0.0, 0.0], intensity: Some([f64::INFINITY; 3]) },
        CaptureLight::Environment { mean_radiance: Some([1.0, -1.0, 1.0]) },
    ] {
        let error = encode(capture.clone(), &EncodeOptions { light: Some(light), ..Default::default() }).unwrap_err();
        assert!(error.to_string().contains("`light`"), "{light:?}: {error}");
    }
    let options = EncodeOptions {
        light: Some(CaptureLight::Environment { mean_radiance: None }),
        profile: Profile::WaveletTexture,
        ..Default::default()
    };
    assert!(encode(capture, &options).unwrap_err().to_string().contains("profile `predictive` only"));
    let folder = tempfile::tempdir().unwrap();
    let (file, capture) = (folder.path().join("a.tsuya"), bundled("unpolarised"));
    for light in ["flash", "1,2", "camera:1,2", "camera::1,2", "1,2,3:4:5", "1,2,x", "environment:1,2"] {
        let said = complaint(1, &["encode", text(&capture), "-o", text(&file), "--light", light]);
        assert!(said.contains("--light"), "{light}: {said}");
    }
    let report =
        json(&["encode", text(&capture), "-o", text(&file), "--light", "camera:1,2,0:45", "--json", "--no-check"]);
    assert_eq!(report["assumed_light"]["intensity"], serde_json::json!([45.0, 45.0, 45.0]));
    assert_eq!(report["assumed_light"]["offset"], serde_json::json!([1.0, 2.0, 0.0]));
}
