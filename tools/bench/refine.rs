//! Refines the surface of a capture and prints how far its normals are from those of the true object, on views that were held out.
//!
//! `bench-refine CAPTURE [TRUE_MESH] [HOLD_OUT]`. The true mesh has the vertices' normals by its own triangles.

use std::error::Error;
use std::time::Instant;
use tsuya::capture;
use tsuya::encoder::{ObservedView, separate};
use tsuya::input::FileAccess;
use tsuya::internals::refine::refine_observations;
use tsuya::internals::reflectance::{ReflectanceSources, fit_maps};
use tsuya::internals::surface::{self, rasterise, vertex_normals};
use tsuya::metrics::ImagePsnr;
use tsuya::relight::hold_out;
use tsuya::{Asset, Camera, Limits, Mesh, Photograph, SpecularModel, View};

fn main() -> Result<(), Box<dyn Error>> {
    tracing_subscriber::fmt().with_max_level(tracing::Level::DEBUG).with_target(false).init();
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("a capture's folder expected")?;
    let truth = match arguments.next().filter(|path| path != "-") {
        Some(path) => Some(tsuya::mesh::read(std::path::Path::new(&path), &FileAccess::new(Limits::default()))?),
        None => None,
    };
    let every: usize = arguments.next().map_or(Ok(6), |number| number.parse())?;
    let mut captured = capture::read(&folder, &Default::default())?;
    let scan = captured.mesh.clone();
    let observations = separate(&mut captured)?;
    let left_out: Vec<ObservedView> = observations.views.iter().skip(every - 1).step_by(every).cloned().collect();
    let cameras: Vec<Camera> = left_out.iter().map(|view| view.view.camera).collect();
    let observations = observations.holding_out(Some(every))?;
    let start = Instant::now();
    let refined = refine_observations(&scan, &observations);
    println!("{:.1} s", start.elapsed().as_secs_f64());
    if let Some(truth) = &truth {
        println!("scan: {}", angles(&scan, truth, &cameras));
    }
    let Some(refined) = refined else {
        println!("not kept");
        return Ok(());
    };
    let displaced = refined.displaced(&scan)?;
    println!("{} vertices, left-out loss {:?}", displaced.mesh().positions.len(), refined.left_out_loss);
    if let Some(truth) = &truth {
        println!("refined: {}", angles(displaced.mesh(), truth, &cameras));
    }
    // Views left out, from photographs and maps that are not coded.
    let photograph = |view: &ObservedView| Photograph {
        mask: view.mask.clone().unwrap_or_else(|| rasterise(&scan, &view.view.camera).coverage()),
        images: view.images.clone(),
    };
    let views: Vec<View> = observations.views.iter().map(|view| view.view.clone()).collect();
    let photographs: Vec<Photograph> = observations.views.iter().map(photograph).collect();
    let originals: Vec<Photograph> = left_out.iter().map(photograph).collect();
    let shown: Vec<View> = left_out.iter().map(|view| view.view.clone()).collect();
    for density in [0.4, 0.8] {
        let texels = density / refined.pixel;
        let charts = surface::atlas::layout(&scan, texels)?;
        let (bytes, fine) = surface::displacement::encode(&refined.displacements(0.05), &scan, &charts)?;
        let atlas = surface::atlas::rasterise_atlas(&scan, &charts)?;
        for (name, surface, specular) in [
            ("scan, Torrance-Sparrow", None, SpecularModel::TorranceSparrow),
            ("scan, GGX lobes", None, SpecularModel::GgxLobes),
            ("surface, Torrance-Sparrow", Some(&fine), SpecularModel::TorranceSparrow),
            ("surface, GGX lobes", Some(&fine), SpecularModel::GgxLobes),
        ] {
            let (mesh, components) = (&scan, &observations.components[..]);
            let taken = &photographs;
            let (views, irradiance) = (&views[..], None);
            let sources =
                ReflectanceSources { mesh, surface, views, components, photographs: taken, specular, irradiance };
            let asset = Asset {
                mesh: scan.clone(),
                surface: surface.cloned(),
                charts: Some(charts.clone()),
                reflectance: Some(fit_maps(&sources, &charts, &atlas)?),
                white: observations.white,
                components: components.to_vec(),
                views: views.to_vec(),
                photographs: photographs.iter().cloned().map(Some).collect(),
                ..Asset::default()
            };
            let error = hold_out(&asset, &shown, &originals)?;
            let decibel = |psnr: ImagePsnr| {
                [psnr.diffuse, psnr.specular, psnr.sum].map(|db| format!("{:.2}", db.unwrap_or(f64::NAN))).join(" / ")
            };
            let [whole, model] = [error.interpolated, error.model].map(|error| decibel(error.psnr()));
            println!("{density} texels a pixel, {} bytes, {name}: {whole} dB, model alone {model} dB", bytes.len());
        }
    }
    Ok(())
}

/// Angles between the normals of two meshes on the same rays, at least four pixels inside of the silhouette.
fn angles(mesh: &Mesh, truth: &Mesh, cameras: &[Camera]) -> String {
    let normals = [vertex_normals(mesh), vertex_normals(truth)];
    let mut angles: Vec<f64> = Vec::new();
    for camera in cameras {
        let rasters = [rasterise(mesh, camera), rasterise(truth, camera)];
        let normal = |which: usize, at: usize| {
            let corners = [mesh, truth][which].triangles[rasters[which].triangle[at] as usize];
            let [b, c] = rasters[which].barycentric[at].map(f64::from);
            let n: [f64; 3] = std::array::from_fn(|k| {
                let [p, q, r] = corners.map(|v| normals[which][v as usize][k]);
                (1.0 - b - c) * p + b * q + c * r
            });
            let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
            n.map(|x| x / length)
        };
        let (width, height) = (camera.width as usize, camera.height as usize);
        for at in 0..width * height {
            let (x, y) = (at % width, at / width);
            if x < 5 || y < 5 || x + 5 >= width || y + 5 >= height || !rasters[0].is_covered(at) {
                continue;
            }
            let near = |reach: usize| {
                let around = (0..81).map(|k| (y + k / 9 - 4, x + k % 9 - 4));
                around.filter(move |&(v, u)| u.abs_diff(x) + v.abs_diff(y) < reach).map(|(v, u)| v * width + u)
            };
            let depth = |at: usize| rasters[1].depth[at];
            let step = |a: usize, b: usize| (depth(a) - depth(b)).abs() > 6.0 / camera.focal[0] * depth(a);
            let edge = |a: usize| [a - 1, a + 1, a - width, a + width].iter().any(|&b| depth(b) > 0.0 && step(a, b));
            let inside = near(4).all(|a| depth(a) > 0.0) && !near(3).any(edge);
            if inside {
                let [a, b] = [normal(0, at), normal(1, at)];
                angles.push((a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0).acos().to_degrees());
            }
        }
    }
    angles.sort_by(f64::total_cmp);
    let rms = (angles.iter().map(|a| a * a).sum::<f64>() / angles.len() as f64).sqrt();
    format!("normals on {} pixels: median {:.2}, RMS {rms:.2} degrees", angles.len(), angles[angles.len() / 2])
}
