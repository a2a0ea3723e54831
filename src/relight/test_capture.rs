//! Assets made in memory from the test captures.

use crate::asset::Asset;
use crate::surface::atlas::{AtlasRaster, layout, rasterise_atlas, texels_per_unit};
use crate::surface::raster::rasterise;
use crate::views::{Camera, Photograph};
use std::path::{Path, PathBuf};

/// Folder of a capture: of the test data, or the bundled sample.
pub(crate) fn folder(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let data = std::env::var_os("TSUYA_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let found = [root.join("tests/data").join(name), data.join("captures").join(name)];
    let found = found.into_iter().find(|p| p.join("transforms.json").exists());
    if found.is_none() {
        println!("skipped: capture {name} is not here");
    }
    found
}

/// A capture as an asset without charts and reflectance.
pub(crate) fn load(name: &str) -> Option<Asset> {
    let mut capture = crate::capture::read(folder(name)?, &Default::default()).unwrap();
    let mesh = std::mem::take(&mut capture.mesh);
    let observations = crate::separate::separate(&mut capture).unwrap();
    let mut asset = Asset { mesh, white: observations.white, components: observations.components, ..Asset::default() };
    for frame in observations.views {
        let covered = || rasterise(&asset.mesh, &frame.view.camera).coverage();
        let mask = frame.mask.unwrap_or_else(covered);
        asset.photographs.push(Some(Photograph { mask, images: frame.images }));
        asset.views.push(frame.view);
    }
    Some(asset)
}

/// Adds charts and fitted reflectance.
pub(crate) fn fit_reflectance(asset: &mut Asset, density: f64) -> AtlasRaster {
    let cameras: Vec<Camera> = asset.views.iter().map(|v| v.camera).collect();
    let charts = layout(&asset.mesh, texels_per_unit(&asset.mesh, &cameras, density)).unwrap();
    let raster = rasterise_atlas(&asset.mesh, &charts).unwrap();
    let photographs: Vec<&Photograph> = asset.photographs.iter().flatten().collect();
    let sources = crate::reflectance::gather::ReflectanceSources {
        mesh: &asset.mesh,
        surface: None,
        views: &asset.views,
        components: &asset.components,
        photographs: &photographs,
        specular: Default::default(),
        irradiance: None,
    };
    asset.reflectance = Some(crate::reflectance::gather::fit_maps(&sources, &charts, &raster).unwrap());
    asset.charts = Some(charts);
    raster
}
