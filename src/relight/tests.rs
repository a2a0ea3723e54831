//! Pictures of the sample.

use super::test_capture::{fit, load};
use super::*;
use crate::image::Grid;
use crate::measure::{hold_out, to_display};
use crate::surface::charts;
use std::time::Instant;

fn save(name: &str, image: &RgbImage, white: [f64; 3]) {
    let picture = to_display(image, white);
    let bytes: Vec<u8> = picture.data.iter().flatten().copied().collect();
    std::fs::create_dir_all("/tmp/surface").unwrap();
    image::RgbImage::from_raw(picture.width as u32, picture.height as u32, bytes)
        .unwrap()
        .save(format!("/tmp/surface/{name}.png"))
        .unwrap();
}

#[test]
#[ignore = "writes pictures"]
fn explore() {
    for name in std::env::var("CAPTURES").unwrap_or("sample-spot,bunny-ring".into()).split(',') {
        let t = Instant::now();
        let Some(mut asset) = load(name) else { return };
        println!("{name}: load {:.2} s", t.elapsed().as_secs_f64());
        let t = Instant::now();
        let raster = fit(&mut asset, 0.75);
        println!("fit {:.2} s", t.elapsed().as_secs_f64());
        let layout = asset.charts.clone().unwrap();
        let bytes = charts::encode(&asset.mesh, &layout).unwrap();
        println!(
            "{} charts, {} x {}, {} texels used, {} triangles, CHRT {} bytes",
            layout.charts.len(), layout.width, layout.height, raster.mask().count(), asset.mesh.triangles.len(), bytes.len()
        );
        let hue = |k: u32| if k == u32::MAX { [0.0; 3] } else {
            let c = layout.chart_of_triangle[k as usize];
            [(c * 37 % 17) as f32 / 17.0, (c * 53 % 13) as f32 / 13.0, (c * 29 % 11) as f32 / 11.0]
        };
        save(&format!("{name}-charts"), &raster.triangle.map(|&t| hue(t)), [1.0; 3]);
        let maps = asset.reflectance.clone().unwrap();
        save(&format!("{name}-diffuse-map"), &maps.diffuse, [0.3; 3]);
        let peak = maps.specular.data.iter().map(|x| x[0]).fold(0f32, f32::max);
        println!("K_s peak {peak}");
        save(&format!("{name}-specular-map"), &maps.specular, [0.2; 3]);
        save(&format!("{name}-sigma-map"), &maps.sigma.map(|&s| [s; 3]), [0.8; 3]);
        let renderer = Renderer::new(&asset).unwrap();
        let options = RenderOptions::default();
        let orbit = orbit(&asset, 72);
        renderer.render(&orbit[1], &options).unwrap();
        let t = Instant::now();
        let between = renderer.render(&orbit[1], &options).unwrap();
        println!("render {:.1} ms", t.elapsed().as_secs_f64() * 1e3);
        save(&format!("{name}-between"), &between.image, asset.white);
        save(&format!("{name}-captured"), &renderer.render(&asset.views[3].camera, &options).unwrap().image, asset.white);
        let photo = asset.photographs[3].as_ref().unwrap();
        let sum = Grid { width: photo.mask.width, height: photo.mask.height, data: (0..photo.mask.data.len()).map(|k| std::array::from_fn(|c| photo.images[0].data[k][c] + photo.images[1].data[k][c])).collect() };
        save(&format!("{name}-photograph"), &sum, asset.white);
        let mut model = options.clone();
        model.layers.residual = false;
        save(&format!("{name}-model"), &renderer.render(&asset.views[3].camera, &model).unwrap().image, asset.white);
        let camera = asset.views[3].camera;
        let light = PointLight { position: {
            let c = camera.centre();
            let m = bounds(&asset.mesh).0;
            // From the side and above.
            let d: [f64; 3] = std::array::from_fn(|k| c[k] - m[k]);
            [m[0] + d[2], m[1] + 2.5, m[2] - d[0] * 1.0]
        }, intensity: [60.0, 57.0, 53.0] };
        let lit = RenderOptions { lighting: Lighting::Points(vec![light]), ..options.clone() };
        let t = Instant::now();
        let relit = renderer.render(&camera, &lit).unwrap();
        println!("relit render {:.1} ms", t.elapsed().as_secs_f64() * 1e3);
        save(&format!("{name}-relit"), &relit.image, asset.white);
        let mut lit_model = lit.clone();
        lit_model.layers.residual = false;
        save(&format!("{name}-relit-model"), &renderer.render(&camera, &lit_model).unwrap().image, asset.white);
        drop(renderer);
        // Held-out views.
        let mut kept = asset.clone();
        let (mut views, mut originals) = (vec![], vec![]);
        for k in (0..asset.views.len()).rev() {
            if k % 6 == 5 {
                views.push(kept.views.remove(k));
                originals.push(kept.photographs.remove(k).unwrap());
            }
        }
        fit(&mut kept, 0.75);
        let t = Instant::now();
        let held = hold_out(&kept, &views, &originals).unwrap();
        println!("hold-out {:.2} s, coverage {:.4}", t.elapsed().as_secs_f64(), held.interpolated.coverage());
        for (what, e) in [("interpolated", held.interpolated), ("nearest", held.nearest), ("model", held.model), ("warped", held.warped)] {
            println!("  {what}: {:?}", e.psnr());
        }
    }
}
