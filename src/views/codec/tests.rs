use super::*;
use crate::limits::Limits;
use std::path::PathBuf;

fn budget() -> Budget {
    Budget::new(Limits { memory_bytes: 1 << 24, views: 1000, ..Limits::default() })
}

const SCENE: [[f32; 3]; 4] = [[-0.8, -0.8, -0.8], [0.8, 0.9, 0.7], [0.0, 0.9, -0.9], [0.1, -0.4, 0.3]];

/// A turntable whose light goes with the camera, as `rotation about y` after a tilt.
fn turntable(count: usize) -> ViewsSection {
    let views = (0..count).map(|k| {
        let (sin, cos) = (k as f64 * 0.1745).sin_cos();
        let (s, c) = 0.2618f64.sin_cos();
        let rotation = [[cos, 0.0, -sin], [-s * sin, -c, -s * cos], [-c * sin, s, -c * cos]];
        let camera = Camera {
            width: 384,
            height: 384,
            focal: [669.583; 2],
            principal: [192.0; 2],
            rotation,
            translation: [0.0, 0.01, 4.2],
        };
        let place = [0.1, -0.2, 4.1 - 4.2];
        let position = std::array::from_fn(|i| (0..3).map(|j| rotation[j][i] * place[j]).sum());
        let light = Some(PointLight { position, intensity: [60.48, 57.456, 52.92] });
        View { name: format!("off/{k:03}.exr"), camera, light }
    });
    let components = vec![Component::Diffuse, Component::Specular];
    ViewsSection { white: [1.1, 1.0, 0.9], components, views: views.collect() }
}

fn max_movement(a: &ViewsSection, b: &ViewsSection, scene: &[[f32; 3]]) -> f64 {
    let pairs = a.views.iter().zip(&b.views).flat_map(|pair| scene.iter().map(move |p| (pair, p.map(|x| x as f64))));
    pairs
        .map(|((a, b), p)| {
            let (a, b) = (a.camera.project(p).unwrap().0, b.camera.project(p).unwrap().0);
            (a[0] - b[0]).hypot(a[1] - b[1])
        })
        .fold(0.0, f64::max)
}

#[test]
fn turntables_cost_little_and_move_no_pixel() {
    let section = turntable(36);
    let bytes = encode(&section, &SCENE).unwrap();
    let decoded = decode(&bytes, &budget()).unwrap();
    let moved = max_movement(&section, &decoded, &SCENE);
    assert!(moved < 0.01, "{moved} pixels");
    assert!(bytes.len() < 260, "{} bytes", bytes.len());
    for (a, b) in section.views.iter().zip(&decoded.views) {
        assert_eq!(a.name, b.name);
        let (a, b) = (a.light.unwrap(), b.light.unwrap());
        assert!((0..3).all(|k| (a.position[k] - b.position[k]).abs() < 1e-4));
        assert!((0..3).all(|k| a.intensity[k] as f32 as f64 == b.intensity[k]));
    }
    // What was decoded is coded without further loss of names, sizes and components.
    assert_eq!(decoded.components, section.components);
    println!("36 views: {} bytes, {moved:.4} pixels", bytes.len());
}

#[test]
fn odd_views_come_back() {
    let mut section = turntable(12);
    section.components = vec![Component::Combined];
    for (k, view) in section.views.iter_mut().enumerate() {
        view.light = view.light.filter(|_| k % 3 != 0).map(|mut light| {
            light.position = [k as f64, 5.0, -3.0];
            light.intensity[0] = (k % 2) as f64;
            light
        });
        view.camera.width += k as u32 % 3;
        view.camera.focal[1] *= 1.0 + 0.01 * (k % 2) as f64;
        view.name = ["a9", "a10", "a10", "", "b", "b.99.png", "b.99.jpg", "é", "999", "1000", "x", "y"][k].into();
    }
    // A turn by half a circle, and the same place twice.
    section.views[5].camera.rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    section.views[7].camera = section.views[6].camera;
    let bytes = encode(&section, &[]).unwrap();
    let decoded = decode(&bytes, &budget()).unwrap();
    for (a, b) in section.views.iter().zip(&decoded.views) {
        assert_eq!((&a.name, a.camera.width, a.light.is_some()), (&b.name, b.camera.width, b.light.is_some()));
        let pairs = a.camera.rotation.iter().flatten().zip(b.camera.rotation.iter().flatten());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
    }
    assert_eq!(decoded.views[7].camera.rotation, decoded.views[6].camera.rotation);
    let none = ViewsSection { white: [1.0; 3], ..Default::default() };
    assert_eq!(decode(&encode(&none, &[]).unwrap(), &budget()).unwrap(), none);
}

/// Three turntable views written by version 0.1: the bits of their cameras and lights depend on no platform.
const GOLDEN: &str = "00c0733332c07fffffc09999995cfbc165d717683ddb4f63741b1acf59e9ac9106a95437f451ca20bef61a20bc0bd17e33f332816033046b2c51107b5c5a74936241fa4a7680842bc7cf13df5a77c49c840f1273c5ba074e6293dc09a75c143aaa00d560";

#[test]
fn golden_bytes_decode_to_the_same_bits() {
    let digits = GOLDEN.as_bytes().chunks(2);
    let bytes: Vec<u8> =
        digits.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect();
    let decoded = decode(&bytes, &budget()).unwrap();
    let mut hasher = crc32fast::Hasher::new();
    for view in &decoded.views {
        let (r, t) = (view.camera.rotation.as_flattened(), view.camera.translation);
        for value in r.iter().chain(&t).chain(&view.light.unwrap().position) {
            hasher.update(&value.to_le_bytes());
        }
    }
    assert_eq!((decoded.views[2].name.as_str(), hasher.finalize()), ("off/002.exr", 3092400343));
    assert!(max_movement(&turntable(3), &decoded, &SCENE) < 0.01);
}

#[test]
fn hostile_bytes_are_refused() {
    let bytes = encode(&turntable(5), &SCENE).unwrap();
    for length in 0..bytes.len() {
        assert!(decode(&bytes[..length], &budget()).is_err(), "cut to {length}");
    }
    for extra in [0, 1, 128, 255] {
        assert!(decode(&[&bytes[..], &[extra]].concat(), &budget()).is_err(), "one more byte {extra}");
    }
    let mut future = bytes.clone();
    future[0] = 1;
    assert!(matches!(decode(&future, &budget()), Err(Error::Unsupported(_))));
    let many = encode(&turntable(20), &SCENE).unwrap();
    let few = Budget::new(Limits { views: 19, ..Limits::default() });
    assert!(matches!(decode(&many, &few), Err(Error::Limits { .. })));
    let small = Budget::new(Limits { memory_bytes: 1000, ..Limits::default() });
    assert!(matches!(decode(&many, &small), Err(Error::Limits { .. })));
    let narrow = Budget::new(Limits { image_side: 383, ..Limits::default() });
    assert!(matches!(decode(&many, &narrow), Err(Error::Limits { .. })));
    let mut state = 1u64;
    for _ in 0..4000 {
        let mut damaged = bytes.clone();
        for _ in 0..2 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let at = 1 + (state >> 33) as usize % (damaged.len() - 1);
            damaged[at] = (state >> 24) as u8;
        }
        let _ = decode(&damaged, &budget());
    }
}

#[test]
fn impossible_views_are_refused_in_writing() {
    let mut section = turntable(2);
    section.views[1].camera.rotation[0][0] = 3.0;
    assert!(matches!(encode(&section, &SCENE), Err(Error::Parameter(_))));
    let mut section = turntable(2);
    section.views[0].camera.translation[1] = f64::NAN;
    assert!(matches!(encode(&section, &SCENE), Err(Error::Parameter(_))));
    let mut section = turntable(2);
    section.white[2] = 0.0;
    assert!(matches!(encode(&section, &SCENE), Err(Error::Parameter(_))));
}

/// The cameras of the shared captures.
#[test]
fn real_captures() {
    let data = std::env::var_os("TSUYA_DATA").map_or(PathBuf::from("../shared/data"), PathBuf::from);
    for (capture, bound) in [("sample-spot", 300), ("bunny-ring", 300), ("spot-dome", 600)] {
        let Ok(text) = std::fs::read(data.join("captures").join(capture).join("transforms.json")) else {
            println!("skipped: {capture} is not here");
            continue;
        };
        let json: serde_json::Value = serde_json::from_slice(&text).unwrap();
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let views = json["frames"].as_array().unwrap().iter().map(|frame| {
            let m = &frame["transform_matrix"];
            // OpenGL axes, camera to world.
            let sign = [1.0, -1.0, -1.0];
            let rotation = std::array::from_fn(|i| std::array::from_fn(|j| sign[i] * number(&m[j][i])));
            let centre: [f64; 3] = std::array::from_fn(|j| number(&m[j][3]));
            let rotation: [[f64; 3]; 3] = rotation;
            let translation = std::array::from_fn(|i| -(0..3).map(|j| rotation[i][j] * centre[j]).sum::<f64>());
            let camera = Camera {
                width: number(&json["w"]) as u32,
                height: number(&json["h"]) as u32,
                focal: [number(&json["fl_x"]), number(&json["fl_y"])],
                principal: [number(&json["cx"]), number(&json["cy"])],
                rotation,
                translation,
            };
            let light = PointLight {
                position: std::array::from_fn(|j| number(&frame["light_position"][j])),
                intensity: std::array::from_fn(|j| number(&json["light"]["intensity"][j])),
            };
            View { name: frame["file_path"].as_str().unwrap().into(), camera, light: Some(light) }
        });
        let section = ViewsSection { white: [1.0; 3], components: vec![Component::Combined], views: views.collect() };
        let bytes = encode(&section, &SCENE).unwrap();
        let decoded = decode(&bytes, &budget()).unwrap();
        let moved = max_movement(&section, &decoded, &SCENE);
        println!("{capture}: {} views, {} bytes, {moved:.4} pixels", section.views.len(), bytes.len());
        assert!(moved < 0.01 && bytes.len() < bound, "{moved} pixels, {} bytes", bytes.len());
    }
}
