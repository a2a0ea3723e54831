//! Figures of images of the sample.

use super::hold_out;
use super::scene_tests::bowl;
use super::test_capture::{fit_reflectance, load};
use super::*;
use crate::error::Error;
use crate::image::Grid;
use crate::metrics::PhotographError;
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::atlas::layout;
use crate::views::{Component, Photograph, View};
use std::f32::consts::PI;

/// Takes every sixth view out.
fn leave_out(asset: &mut Asset) -> (Vec<View>, Vec<Photograph>) {
    let (mut views, mut photographs) = (Vec::new(), Vec::new());
    for k in (0..asset.views.len()).rev().filter(|k| k % 6 == 5) {
        views.push(asset.views.remove(k));
        photographs.extend(asset.photographs.remove(k));
    }
    (views, photographs)
}

#[test]
fn captured_cameras_give_their_photographs_back() {
    let Some(mut asset) = load("sample-spot") else { return };
    fit_reflectance(&mut asset, 0.75);
    let renderer = AssetRenderer::new(&asset).unwrap();
    let mut error = PhotographError::default();
    for k in [0, 13] {
        let rendered = renderer.render(&asset.views[k].camera, &RenderOptions::default()).unwrap();
        let original = asset.photographs[k].as_ref().unwrap();
        let decoded = Photograph { mask: original.mask.clone(), images: rendered.components };
        error.merge(&PhotographError::compare(original, &decoded, &asset.components, &rendered.hit, asset.white));
    }
    let psnr = error.psnr().sum.unwrap_or(f64::INFINITY);
    assert!(psnr > 80.0, "{psnr:.1} dB");
}

#[test]
fn interpolation_beats_the_nearest_view_and_the_model() {
    let Some(mut asset) = load("sample-spot") else { return };
    let (views, originals) = leave_out(&mut asset);
    fit_reflectance(&mut asset, 0.75);
    let held = hold_out(&asset, &views, &originals).unwrap();
    let sum = |error: &PhotographError| error.psnr().sum.unwrap();
    let diffuse = |error: &PhotographError| error.psnr().diffuse.unwrap();
    assert!(sum(&held.interpolated) > 21.9, "{:?}", held.interpolated.psnr());
    assert!(sum(&held.interpolated) > sum(&held.nearest) + 2.0, "{:?}", held.nearest.psnr());
    assert!(diffuse(&held.interpolated) > 29.3 && diffuse(&held.interpolated) > diffuse(&held.nearest) + 4.0);
    assert!(sum(&held.interpolated) > sum(&held.model) + 2.0, "{:?}", held.model.psnr());
}

#[test]
fn without_lights_and_polarisers_views_are_interpolated_but_not_relit() {
    let Some(mut asset) = load("sample-spot") else { return };
    asset.components = vec![Component::Combined];
    for photograph in asset.photographs.iter_mut().flatten() {
        let specular = photograph.images.remove(1);
        for (sum, specular) in photograph.images[0].data.iter_mut().zip(&specular.data) {
            (0..3).for_each(|c| sum[c] += specular[c]);
        }
    }
    asset.views.iter_mut().for_each(|view| view.light = None);
    let (views, originals) = leave_out(&mut asset);
    fit_reflectance(&mut asset, 0.75);
    assert!(!asset.reflectance.as_ref().unwrap().relightable);
    let held = hold_out(&asset, &views, &originals).unwrap();
    let (between, nearest) = (held.interpolated.psnr().sum.unwrap(), held.nearest.psnr().sum.unwrap());
    assert!(between > 20.0 && between > nearest + 2.0, "{between:.2} against {nearest:.2} dB");
    let light = PointLight { position: [0.0, 4.0, 0.0], intensity: [50.0; 3] };
    let options = RenderOptions { lighting: RenderLighting::Points(vec![light]), ..RenderOptions::default() };
    let refused = render(&asset, &asset.views[0].camera, &options);
    assert!(matches!(refused, Err(Error::Unsupported(_))));
}

#[test]
fn two_lights_add() {
    let Some(mut asset) = load("sample-spot") else { return };
    fit_reflectance(&mut asset, 0.75);
    let renderer = AssetRenderer::new(&asset).unwrap();
    let (camera, light) = (asset.views[4].camera, asset.views[4].light.unwrap());
    let lit = |lights: Vec<PointLight>| {
        let options = RenderOptions { lighting: RenderLighting::Points(lights), ..RenderOptions::default() };
        renderer.render(&camera, &options).unwrap()
    };
    let other = PointLight { position: [2.0, 4.0, -1.0], intensity: [10.0, 30.0, 50.0] };
    let (one, two, both) = (lit(vec![light]), lit(vec![other]), lit(vec![light, other]));
    for k in 0..both.components[0].data.len() {
        for c in 0..3 {
            let sum = one.components[0].data[k][c] + two.components[0].data[k][c];
            assert!((both.components[0].data[k][c] - sum).abs() < 1e-4 * (1.0 + sum.abs()));
        }
    }
    assert!(two.image.data.iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
}

/// Images of the asset under lights given by their places.
fn under(renderer: &AssetRenderer, camera: &Camera, light: PointLight) -> ViewRender {
    let options = RenderOptions { lighting: RenderLighting::Points(vec![light]), ..RenderOptions::default() };
    renderer.render(camera, &options).unwrap()
}

/// Half a ball sends to all of its points the same light: a quarter of what comes in through its opening, times the albedo, whatever part of it the lamp
/// reaches.
#[test]
fn the_dark_side_of_a_bowl_is_lit_by_the_other() {
    const ALBEDO: f32 = 0.8;
    let mesh = bowl();
    let charts = layout(&mesh, 20.0).unwrap();
    let diffuse = Grid {
        width: charts.width as usize,
        height: charts.height as usize,
        data: vec![[ALBEDO / PI; 3]; charts.width as usize * charts.height as usize],
    };
    let maps = ReflectanceMaps { relightable: true, diffuse, ..ReflectanceMaps::default() };
    let (charts, components, white) = (Some(charts), vec![Component::Combined], [1.0; 3]);
    let asset = Asset { mesh, charts, reflectance: Some(maps), components, white, ..Asset::default() };
    let renderer = AssetRenderer::new(&asset).unwrap();
    // Of irradiance 1, from 45 degrees above the right.
    let light = PointLight { position: [500.0, 500.0, 0.0], intensity: [500_000.0; 3] };
    let camera = look_at([0.0, 6.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 120.0, 64, 64);
    let image = |change: &dyn Fn(&mut RenderOptions)| {
        let mut options = RenderOptions { lighting: RenderLighting::Points(vec![light]), ..RenderOptions::default() };
        change(&mut options);
        renderer.render(&camera, &options).unwrap().image
    };
    let (all, alone) = (image(&|_| ()), image(&|options| options.layers.interreflection = false));
    let expected = ALBEDO / PI * ALBEDO * (0.5f32.sqrt() / 4.0);
    let (mut dark, mut sum) = (0, 0.0);
    for (pixel, direct) in all.data.iter().zip(&alone.data) {
        if pixel[0] > 0.0 && direct[0] == 0.0 {
            (dark, sum) = (dark + 1, sum + pixel[0]);
            assert!((pixel[0] / expected - 1.0).abs() < 0.2, "{pixel:?}, {expected} expected");
        }
    }
    assert!(dark > 100 && (sum / dark as f32 / expected - 1.0).abs() < 0.03, "{dark} {sum} {expected}");
    let unshadowed = |options: &mut RenderOptions| options.shadows = false;
    assert!(image(&unshadowed).data.iter().zip(&alone.data).all(|(a, b)| a[0] >= b[0]));
}

#[test]
fn captured_lamps_given_by_their_places_give_their_photographs_back() {
    for name in ["dome", "sample-spot"] {
        let Some(mut asset) = load(name) else { return };
        fit_reflectance(&mut asset, 0.75);
        let renderer = AssetRenderer::new(&asset).unwrap();
        let error = |brightness: f64| {
            let mut error = PhotographError::default();
            for k in (1..asset.views.len()).step_by(5) {
                let (camera, light) = (asset.views[k].camera, asset.views[k].light.unwrap());
                let light = PointLight { intensity: light.intensity.map(|x| x * brightness), ..light };
                let mut rendered = under(&renderer, &camera, light);
                let scale = |image: &mut RgbImage| {
                    image.data.iter_mut().flatten().for_each(|x| *x /= brightness as f32);
                };
                rendered.components.iter_mut().for_each(scale);
                let original = asset.photographs[k].as_ref().unwrap();
                let decoded = Photograph { mask: original.mask.clone(), images: rendered.components };
                let of_view =
                    PhotographError::compare(original, &decoded, &asset.components, &rendered.hit, asset.white);
                error.merge(&of_view);
            }
            error.psnr().sum.unwrap_or(f64::INFINITY)
        };
        let (same, brighter) = (error(1.0), error(3.0));
        assert!(same > 80.0 && brighter > 80.0, "{name}: {same:.1} dB, three times as bright {brighter:.1} dB");
    }
}

/// Each lamp that views of the dome share is left out with all its photographs.
#[test]
fn lamps_that_were_left_out_gain_from_those_around_them() {
    let Some(all) = load("dome") else { return };
    let (mut whole, mut model) = (PhotographError::default(), PhotographError::default());
    let lamp = |view: &View| view.light.unwrap();
    for left_out in [1, 3, 11] {
        let mut asset = all.clone();
        let place = lamp(&asset.views[left_out]).position;
        let (mut views, mut originals) = (Vec::new(), Vec::new());
        for k in (0..asset.views.len()).rev().filter(|&k| lamp(&all.views[k]).position == place) {
            views.push(asset.views.remove(k));
            originals.extend(asset.photographs.remove(k));
        }
        fit_reflectance(&mut asset, 0.75);
        let renderer = AssetRenderer::new(&asset).unwrap();
        for (view, original) in views.iter().zip(&originals) {
            for (residual, error) in [(true, &mut whole), (false, &mut model)] {
                // The dome was drawn without light from the object to itself.
                let layers = RenderLayers { residual, interreflection: false, ..RenderLayers::default() };
                let lighting = RenderLighting::Points(vec![lamp(view)]);
                let options = RenderOptions { layers, lighting, ..RenderOptions::default() };
                error.merge(&hold_out::compare(&renderer, &view.camera, &options, &asset, original).unwrap());
            }
        }
    }
    let (whole, model) = (whole.psnr(), model.psnr());
    let gains = [whole.diffuse, whole.specular, whole.sum].into_iter().zip([model.diffuse, model.specular, model.sum]);
    let gains: Vec<f64> = gains.map(|(whole, model)| whole.unwrap() - model.unwrap()).collect();
    println!("{whole:?}: {gains:.2?} dB more than the model");
    assert!(gains[0] > 0.6 && gains[1] > 0.9 && gains[2] > 0.6, "{whole:?}: {gains:.2?} dB more than the model");
}

/// From a captured lamp to places beside it, and to where other photographs begin to count.
#[test]
fn an_image_follows_its_light_without_a_leap() {
    let Some(mut asset) = load("dome") else { return };
    fit_reflectance(&mut asset, 0.75);
    let renderer = AssetRenderer::new(&asset).unwrap();
    let (camera, light) = (asset.views[3].camera, asset.views[3].light.unwrap());
    let root = |x: f32| (x.max(0.0) as f64 / asset.white[1]).sqrt();
    let image = |step: f64| {
        let [x, y, z] = light.position;
        under(&renderer, &camera, PointLight { position: [x + step, y, z], ..light }).image
    };
    let leap = |from: f64, to: f64| {
        let (a, b) = (image(from), image(to));
        let squares = a.data.iter().flatten().zip(b.data.iter().flatten());
        let sum: f64 = squares.map(|(a, b)| (root(*a) - root(*b)).powi(2)).sum();
        (sum / (3 * a.data.len()) as f64).sqrt()
    };
    let wide = leap(0.0, 0.4);
    assert!(leap(0.0, 1e-5) < 1e-4 && wide > 0.005, "{} beside {wide}", leap(0.0, 1e-5));
    for k in 0..8 {
        let from = 0.05 * k as f64;
        let small = leap(from, from + 1e-3);
        assert!(small < 0.2 * wide, "{small} at {from}, beside {wide}");
    }
}

#[cfg(feature = "parallel")]
#[test]
fn an_image_under_a_light_is_the_same_with_any_number_of_threads() {
    let Some(mut asset) = load("dome") else { return };
    fit_reflectance(&mut asset, 0.75);
    let light = PointLight { position: [1.5, 2.5, 2.0], intensity: [40.0, 50.0, 60.0] };
    let rendered = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| under(&AssetRenderer::new(&asset).unwrap(), &asset.views[4].camera, light))
    };
    let one = rendered(1);
    assert!(one.image.data.iter().flatten().any(|&x| x > 0.0));
    assert_eq!(one, rendered(3));
}

#[test]
fn samples_of_a_pixel_tend_to_its_mean() {
    let Some(mut asset) = load("sample-spot") else { return };
    fit_reflectance(&mut asset, 0.75);
    let renderer = AssetRenderer::new(&asset).unwrap();
    let camera = look_at([0.5, 1.2, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 32.0, 96, 96);
    let render = |samples| renderer.render(&camera, &RenderOptions { samples, ..RenderOptions::default() });
    let exact = render(8).unwrap();
    let error = |samples| {
        let found = render(samples).unwrap();
        assert_eq!((found.image.width, found.components.len(), found.hit.data.len()), (96, 2, 96 * 96));
        let pairs = found.image.data.as_flattened().iter().zip(exact.image.data.as_flattened());
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
    };
    let [one, two, four] = [1, 2, 4].map(error);
    assert!(two < 0.4 * one && four < 0.4 * two, "{one} {two} {four}");
    assert!([0, 9].into_iter().all(|samples| matches!(render(samples), Err(Error::Parameter(_)))));
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let mesh = crate::surface::atlas::tests::bumpy_sphere(8);
    let camera = look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 60.0, 48, 48);
    let mut asset = Asset { mesh, components: vec![Component::Combined], white: [1.0; 3], ..Asset::default() };
    let rendered = render(&asset, &camera, &RenderOptions::default()).unwrap();
    assert!((600..1000).contains(&rendered.hit.count()), "{}", rendered.hit.count());
    assert!(render(&asset, &Camera { width: 0, ..camera }, &RenderOptions::default()).is_err());
    assert!(render(&asset, &Camera { focal: [f64::NAN; 2], ..camera }, &RenderOptions::default()).is_err());
    asset.views.push(View { name: "small".into(), camera, light: None });
    asset.photographs.push(Some(Photograph::default()));
    assert!(matches!(render(&asset, &camera, &RenderOptions::default()), Err(Error::Parameter(_))));
    asset.mesh.triangles.push([0, 1, 9999]);
    assert!(matches!(AssetRenderer::new(&asset), Err(Error::Parameter(_))));
}

#[test]
#[ignore = "prints times"]
fn times() {
    let Some(mut asset) = load("bunny-ring") else { return };
    let clock = std::time::Instant::now();
    let raster = fit_reflectance(&mut asset, 0.75);
    println!("fit of {} texels: {:.2} s", raster.mask().count(), clock.elapsed().as_secs_f64());
    let charts = asset.charts.as_ref().unwrap();
    let bytes = crate::surface::charts::encode(&asset.mesh, charts).unwrap().len();
    println!("{} charts, {bytes} bytes", charts.charts.len());
    let renderer = AssetRenderer::new(&asset).unwrap();
    for camera in orbit(&asset, 72).iter().take(3) {
        for what in ["first", "again"] {
            let clock = std::time::Instant::now();
            renderer.render(camera, &RenderOptions::default()).unwrap();
            println!("384 x 384, {what}: {:.1} ms", clock.elapsed().as_secs_f64() * 1e3);
        }
    }
}
