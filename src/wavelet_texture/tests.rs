use super::*;
use crate::image::{Mask, RgbImage};
use crate::limits::{Budget, Limits};
use crate::mesh::Mesh;
use crate::surface::occluders::Occluders;
use crate::views::{Camera, Component, Photograph, PointLight, View};

/// A sheet of `n x n` squares with a bump, in the plane z = 0, seen from +z.
fn mesh(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (x as f32 / n as f32 * 2.0 - 1.0, y as f32 / n as f32 * 2.0 - 1.0);
            mesh.positions.push([u, v, 0.3 * (-3.0 * (u * u + v * v)).exp()]);
        }
    }
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            mesh.triangles.push([a, a + 1, a + n + 1]);
            mesh.triangles.push([a + 1, a + n + 2, a + n + 1]);
        }
    }
    mesh
}

/// Cameras on an arc above the sheet that look at its middle, each with a light beside it.
fn views(count: usize) -> Vec<View> {
    (0..count)
        .map(|i| {
            let angle = (i as f64 / (count - 1) as f64 - 0.5) * 1.6;
            let (s, c) = angle.sin_cos();
            // Camera axes in rows: x right, y down, z forward.
            let rotation = [[c, 0.0, -s], [0.0, -1.0, 0.0], [-s, 0.0, -c]];
            let light = PointLight { position: [5.0 * s + 0.3, 0.4, 5.0 * c], intensity: [30.0, 28.0, 25.0] };
            let camera = Camera {
                width: 48,
                height: 48,
                focal: [90.0; 2],
                principal: [24.0; 2],
                rotation,
                translation: [0.0, 0.0, 5.0],
            };
            View { name: format!("{i}"), camera, light: Some(light) }
        })
        .collect()
}

/// Photographs of a chequered, slightly glossy sheet: (mask, diffuse, specular) a view.
fn photographs(mesh: &Mesh, views: &[View]) -> Vec<(Mask, Vec<RgbImage>)> {
    let occluders = Occluders::new(mesh);
    let layout = layout::PatchLayout::new(mesh);
    views
        .iter()
        .map(|view| {
            let mut mask = Mask::filled(48, 48, false);
            let mut images = vec![RgbImage::filled(48, 48, [0.0; 3]); 2];
            for i in 0..48 * 48 {
                let Some(hit) = occluders.first_hit(&view.camera, [(i % 48) as f64 + 0.5, (i / 48) as f64 + 0.5])
                else {
                    continue;
                };
                let (patch, point, _) = layout.locate(hit.triangle, hit.barycentric).unwrap();
                let (position, _) = layout.position_and_normal(patch, &point);
                let geometry = layout.geometry(patch, &point, view.camera.centre(), &view.light.unwrap());
                let pattern = 0.15 + 0.1 * ((9.0 * position[0]).sin() * (7.0 * position[1]).cos()) as f32;
                mask.data[i] = true;
                images[0].data[i] = crate::reflectance::lambert::evaluate([pattern, 0.8 * pattern, 0.1], &geometry);
                let lobe = crate::reflectance::TorranceSparrowLobe { specular: [0.2, 0.2, 0.25], sigma: 0.15 };
                images[1].data[i] = crate::reflectance::torrance_sparrow::evaluate(&lobe, &geometry);
            }
            (mask, images)
        })
        .collect()
}

const COMPONENTS: [Component; 2] = [Component::Diffuse, Component::Specular];

fn samples(count: usize) -> (Mesh, Vec<View>, WaveletSamples) {
    let (mesh, views) = (mesh(6), views(count));
    let pictures = photographs(&mesh, &views);
    let pictures: Vec<Photograph> = pictures.into_iter().map(|(mask, images)| Photograph { mask, images }).collect();
    let samples = WaveletSamples::gather(&mesh, &views, &pictures, 1.0).unwrap();
    (mesh, views, samples)
}

fn budget() -> Budget {
    Budget::new(Limits::default())
}

#[test]
fn the_section_comes_back_and_quality_grows_with_the_coefficients() {
    let (mesh, views, samples) = samples(9);
    let model = encode::fit_model(&samples, &COMPONENTS);
    let mut before = [0.0; 2];
    for (percent, least) in [(0.0, [25.0, 25.0]), (5.0, [32.0, 32.0]), (50.0, [60.0, 60.0])] {
        let options = WaveletOptions { keep_percent: percent, ..Default::default() };
        let encoded = encode(&samples, &COMPONENTS, Some(&model), &options).unwrap();
        assert_eq!(encoded, encode(&samples, &COMPONENTS, Some(&model), &options).unwrap());
        assert!(encoded.kept_percent() <= percent && encoded.kept_percent() >= 0.9 * percent, "{percent}");
        let decoded = decode(&encoded.bytes, &mesh, &COMPONENTS, views.len(), &budget()).unwrap();
        assert_eq!(decoded.layout.side_log2, samples.layout.side_log2);
        let errors = encode::sample_errors(&samples, &decoded, [1.0; 3]);
        for component in 0..2 {
            let db = errors[component].linear_db;
            assert!(db > least[component] && db > before[component], "{percent} % {errors:?}");
            before[component] = db;
        }
    }
}

#[test]
fn decoded_photographs_look_like_the_captured() {
    let (mesh, views, samples) = samples(5);
    let model = encode::fit_model(&samples, &COMPONENTS);
    let encoded =
        encode(&samples, &COMPONENTS, Some(&model), &WaveletOptions { keep_percent: 20.0, ..Default::default() })
            .unwrap();
    let decoded = decode(&encoded.bytes, &mesh, &COMPONENTS, views.len(), &budget()).unwrap();
    let occluders = Occluders::new(&mesh);
    let (mask, images) = &photographs(&mesh, &views)[1];
    let picture = decoded.photograph(1, &views[1], |x, y| {
        let hit = occluders.first_hit(&views[1].camera, [x as f64 + 0.5, y as f64 + 0.5])?;
        Some((hit.triangle, hit.barycentric))
    });
    assert_eq!(picture.mask, *mask);
    let (mut squares, mut count) = (0.0, 0.0);
    for i in (0..mask.data.len()).filter(|&i| mask.data[i]) {
        for c in 0..3 {
            squares += (images[0].data[i][c] - picture.images[0].data[i][c]).powi(2);
            count += 1.0;
        }
    }
    let psnr = -10.0 * (squares / count).log10();
    assert!(psnr > 35.0, "{psnr}");
}

#[test]
fn unknown_lights_and_one_component_work() {
    let (mesh, mut views) = (mesh(4), views(4));
    let pictures = photographs(&mesh, &views);
    views.iter_mut().for_each(|v| v.light = None);
    let pictures: Vec<Photograph> =
        pictures.into_iter().map(|(mask, images)| Photograph { mask, images: images[..1].to_vec() }).collect();
    let samples = WaveletSamples::gather(&mesh, &views, &pictures, 1.0).unwrap();
    let model = encode::fit_model(&samples, &[Component::Combined]);
    assert!(model.lobes.is_empty());
    let encoded = encode(&samples, &[Component::Combined], Some(&model), &WaveletOptions::default()).unwrap();
    let decoded = decode(&encoded.bytes, &mesh, &[Component::Combined], 4, &budget()).unwrap();
    assert!(!decoded.model.as_ref().unwrap().relightable);
    let error = encode::sample_errors(&samples, &decoded, [1.0; 3])[0];
    assert!(error.linear_db > 30.0, "{error:?}");
    let nothing = WaveletSamples::gather(&Mesh::default(), &views, &pictures, 1.0).unwrap();
    let empty = encode(&nothing, &[Component::Combined], None, &WaveletOptions::default()).unwrap();
    assert!(decode(&empty.bytes, &Mesh::default(), &[Component::Combined], 4, &budget()).is_ok());
}

#[test]
fn hostile_bytes_do_no_harm() {
    let (mesh, views, samples) = samples(3);
    let model = encode::fit_model(&samples, &COMPONENTS);
    let encoded = encode(&samples, &COMPONENTS, Some(&model), &WaveletOptions::default()).unwrap();
    let read = |bytes: &[u8]| decode(bytes, &mesh, &COMPONENTS, views.len(), &budget());
    for length in 0..HEADER_BYTES {
        assert!(read(&encoded.bytes[..length]).is_err());
    }
    for length in (HEADER_BYTES..encoded.bytes.len()).step_by(encoded.bytes.len() / 15) {
        let _ = read(&encoded.bytes[..length]);
    }
    let longer = [&encoded.bytes[..], &[1; 8]].concat();
    assert!(read(&longer).is_err());
    for at in (0..HEADER_BYTES + 40).step_by(3) {
        for value in [1, 0xff] {
            let mut bytes = encoded.bytes.clone();
            bytes[at] ^= value;
            let _ = read(&bytes);
        }
    }
    let noise: Vec<u8> = (0..5000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let _ = read(&[&encoded.bytes[..HEADER_BYTES], &noise].concat());
    let small = Budget::new(Limits { memory_bytes: 100_000, ..Default::default() });
    let refused = decode(&encoded.bytes, &mesh, &COMPONENTS, views.len(), &small);
    assert!(matches!(refused, Err(crate::Error::Limits { .. })));
    assert!(matches!(read(&[&[9], &encoded.bytes[1..]].concat()), Err(crate::Error::Unsupported(_))));
    assert!(decode(&encoded.bytes, &mesh, &COMPONENTS, views.len() + 1, &budget()).is_err());
}
