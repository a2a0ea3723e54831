//! Assets made in memory from the test captures.

use crate::asset::{Asset, Camera, Photograph};
use crate::measure::mask_coverage;
use crate::surface::atlas::{AtlasRaster, layout, rasterise_atlas, texels_per_unit};
use crate::surface::raster::rasterise;
use std::path::{Path, PathBuf};

/// Folder of a capture: of the test data, or the bundled sample.
pub fn folder(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let data = std::env::var_os("TSUYA_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let found = [root.join("tests/data").join(name), data.join("captures").join(name)];
    let found = found.into_iter().find(|p| p.join("transforms.json").exists());
    if found.is_none() {
        println!("skipped: capture {name} is not here");
    }
    found
}

<<<<<<< HEAD
fn exr(path: &Path) -> RgbImage {
    exr::prelude::read_first_rgba_layer_from_file(
        path,
        |size, _| Grid::filled(size.width(), size.height(), [0f32; 3]),
        |grid: &mut RgbImage, at, (r, g, b, _): (f32, f32, f32, f32)| *grid.at_mut(at.x(), at.y()) = [r, g, b],
    )
    .unwrap()
    .layer_data
    .channel_data
    .pixels
}

fn ply(path: &Path) -> Mesh {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let count =
        |what: &str| -> usize { header.lines().find_map(|l| l.strip_prefix(what)).unwrap().trim().parse().unwrap() };
    let word = |at: usize| -> [u8; 4] { bytes[at..at + 4].try_into().unwrap() };
    let (vertices, faces) = (count("element vertex "), count("element face "));
    let start = end + vertices * 12;
    Mesh {
        positions: (0..vertices).map(|v| [0, 1, 2].map(|k| f32::from_le_bytes(word(end + v * 12 + k * 4)))).collect(),
        triangles: (0..faces)
            .map(|f| [0, 1, 2].map(|k| u32::from_le_bytes(word(start + f * 13 + 1 + k * 4))))
            .collect(),
    }
}

/// A capture as an asset without charts and reflectance.
pub fn load(name: &str) -> Option<Asset> {
    let folder = folder(name)?;
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("transforms.json")).unwrap()).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let file = |v: &serde_json::Value| folder.join(v.as_str().unwrap());
    let (white, cross) =
        (exr(&file(&json["white_reference"]["file_path"])), exr(&file(&json["white_reference"]["cross_file_path"])));
    let mean = |image: &RgbImage| {
        let mut sum = [0f64; 3];
        let mut n = 0.0;
        for y in image.height * 3 / 8..image.height * 5 / 8 {
            for x in image.width * 3 / 8..image.width * 5 / 8 {
                (0..3).for_each(|c| sum[c] += image.at(x, y)[c] as f64);
                n += 1.0;
            }
        }
        sum.map(|s| s / n)
    };
    let (white, cross) = (mean(&white), mean(&cross));
    let intensity: [f64; 3] = std::array::from_fn(|c| number(&json["light"]["intensity"][c]));
    let mut asset = Asset {
        mesh: ply(&folder.join("scan.ply")),
        white,
        components: vec![Component::Diffuse, Component::Specular],
        ..Asset::default()
    };
    for frame in json["frames"].as_array().unwrap() {
        let m = |i: usize, j: usize| number(&frame["transform_matrix"][i][j]);
        // OpenGL camera axes: y up, z backwards.
        let flip = [1.0, -1.0, -1.0];
        let rotation: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| flip[i] * m(j, i)));
        let centre = [m(0, 3), m(1, 3), m(2, 3)];
        let camera = Camera {
            width: number(&json["w"]) as u32,
            height: number(&json["h"]) as u32,
            focal: [number(&json["fl_x"]), number(&json["fl_y"])],
            principal: [number(&json["cx"]), number(&json["cy"])],
            rotation,
            translation: std::array::from_fn(|i| -(0..3).map(|j| rotation[i][j] * centre[j]).sum::<f64>()),
        };
        let position = std::array::from_fn(|c| number(&frame["light_position"][c]));
        asset.views.push(View {
            name: frame["file_path"].as_str().unwrap().into(),
            camera,
            light: Some(PointLight { position, intensity }),
        });
        let mask = image::open(file(&frame["mask_path"])).unwrap().to_luma8();
        let mask = Grid {
            width: mask.width() as usize,
            height: mask.height() as usize,
            data: mask.pixels().map(|p| p.0[0] >= 128).collect(),
        };
        let (mut off, mut on) = (exr(&file(&frame["file_path"])), exr(&file(&frame["cross_file_path"])));
        for k in 0..mask.data.len() {
            for c in 0..3 {
                let diffuse = on.data[k][c] as f64 * white[c] / cross[c];
                let inside = mask.data[k] as u8 as f64;
                off.data[k][c] = ((off.data[k][c] as f64 - diffuse) * inside) as f32;
                on.data[k][c] = (diffuse * inside) as f32;
            }
        }
        asset.photographs.push(Some(Photograph { mask, images: vec![on, off] }));
=======
/// A capture as an asset without charts and reflectance.
pub fn load(name: &str) -> Option<Asset> {
    let mut capture = crate::capture::read(folder(name)?, &Default::default()).unwrap();
    let mesh = std::mem::take(&mut capture.mesh);
    let observations = crate::separate::separate(&mut capture).unwrap();
    let mut asset =
        Asset { mesh, white: observations.white, components: observations.components, ..Asset::default() };
    for frame in observations.frames {
        let covered = || mask_coverage(&rasterise(&asset.mesh, &frame.view.camera));
        let mask = frame.mask.unwrap_or_else(covered);
        asset.photographs.push(Some(Photograph { mask, images: frame.images }));
        asset.views.push(frame.view);
>>>>>>> surface
    }
    Some(asset)
}

/// Adds charts and fitted reflectance.
pub fn fit(asset: &mut Asset, density: f64) -> AtlasRaster {
    let cameras: Vec<Camera> = asset.views.iter().map(|v| v.camera).collect();
    let charts = layout(&asset.mesh, texels_per_unit(&asset.mesh, &cameras, density)).unwrap();
    let raster = rasterise_atlas(&asset.mesh, &charts).unwrap();
    let sources = crate::reflectance::maps::Sources {
        mesh: &asset.mesh,
        views: &asset.views,
        components: &asset.components,
        photographs: &asset.photographs,
    };
    asset.reflectance = Some(crate::reflectance::maps::fit_maps(&sources, &charts, &raster));
    asset.charts = Some(charts);
    raster
}
