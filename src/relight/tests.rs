//! Figures of images of the sample.

use super::hold_out;
use super::test_capture::{fit_reflectance, load};
use super::*;
use crate::error::Error;
use crate::metrics::PhotographError;
use crate::views::{Component, Photograph, View};

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
fn relighting_with_the_captures_light_changes_little_and_two_lights_add() {
    let Some(mut asset) = load("sample-spot") else { return };
    fit_reflectance(&mut asset, 0.75);
    let renderer = AssetRenderer::new(&asset).unwrap();
    let (camera, light) = (asset.views[4].camera, asset.views[4].light.unwrap());
    let lit = |lights: Vec<PointLight>| {
        let options = RenderOptions { lighting: RenderLighting::Points(lights), ..RenderOptions::default() };
        renderer.render(&camera, &options).unwrap()
    };
    let captured = asset.photographs[4].as_ref().unwrap();
    let same = lit(vec![light]);
    let decoded = Photograph { mask: captured.mask.clone(), images: same.components.clone() };
    let error = PhotographError::compare(captured, &decoded, &asset.components, &same.hit, asset.white);
    // Shadows of the mesh and the fade at grazing light are what differs.
    assert!(error.psnr().sum.unwrap() > 25.0, "{:?}", error.psnr());
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
