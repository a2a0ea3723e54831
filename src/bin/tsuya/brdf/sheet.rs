//! Contact sheets: for each material measured, fitted and difference.

use super::font;
use crate::pictures::beside;
use tsuya::brdf::{Brdf, SpherePair, SphereScenes, sphere_exposure};
use tsuya::image::{Grid, RgbImage};
use tsuya::metrics::{DisplayImage, difference, to_display};

/// Amplification of differences: `128 + 5 * 127 * (s - s')` of the square roots of radiance over white.
const AMPLIFICATION: f64 = 5.0;
const BACKGROUND: [u8; 3] = [24; 3];
const GAP: usize = 4;

/// Places of a point light that moves from left to right, 25 degrees high.
pub fn sweep_lights(steps: usize) -> Vec<[f64; 3]> {
    let light = |k: usize| {
        let part = if steps > 1 { k as f64 / (steps - 1) as f64 } else { 0.5 };
        let (azimuth, height) = ((150.0 * part - 75.0).to_radians(), 25f64.to_radians());
        [azimuth.sin() * height.cos(), height.sin(), azimuth.cos() * height.cos()].map(|x| 4.0 * x)
    };
    (0..steps).map(light).collect()
}

/// A material's part of the sheet: measured, fitted and difference under a point light and in the environment side by side, or, with
/// a sweep, three rows of as many pictures.
pub fn tile(
    name: &str,
    scenes: &SphereScenes,
    measured: &impl Brdf,
    fitted: &impl Brdf,
    sweep: Option<usize>,
) -> DisplayImage {
    let shown = match sweep {
        None => {
            let point = three(scenes, &scenes.point_pair(measured, fitted));
            let light = three(scenes, &scenes.environment_pair(measured, fitted));
            beside(&[point, light].concat())
        }
        Some(steps) => {
            let lights = sweep_lights(steps);
            let rows =
                |material: &dyn Fn([f64; 3]) -> RgbImage| lights.iter().map(|&l| material(l)).collect::<Vec<_>>();
            let first = rows(&|light| scenes.render_point_light(measured, light));
            let second = rows(&|light| scenes.render_point_light(fitted, light));
            let white = first.iter().map(|image| sphere_exposure(image, scenes.mask())).fold(0.0, f64::max);
            let columns: Vec<DisplayImage> = (first.into_iter().zip(second))
                .map(|(measured, fitted)| below(&three(scenes, &SpherePair { measured, fitted, white })))
                .collect();
            beside(&columns)
        }
    };
    let mut picture = Grid::filled(shown.width, shown.height + font::LINE, BACKGROUND);
    picture.data[font::LINE * shown.width..].copy_from_slice(&shown.data);
    font::write(&mut picture, 0, 0, name);
    picture
}

fn three(scenes: &SphereScenes, pair: &SpherePair) -> Vec<DisplayImage> {
    let white = [pair.white; 3];
    let mut gap = difference(&pair.measured, &pair.fitted, scenes.mask(), white, AMPLIFICATION);
    let outside = gap.data.iter_mut().zip(&scenes.mask().data).filter(|(_, inside)| !**inside);
    outside.for_each(|(pixel, _)| *pixel = [0; 3]);
    vec![to_display(&pair.measured, white), to_display(&pair.fitted, white), gap]
}

/// Tiles in columns, filled downwards.
pub fn arrange(tiles: &[DisplayImage], columns: usize) -> DisplayImage {
    let rows = tiles.len().div_ceil(columns.max(1)).max(1);
    let stacks: Vec<DisplayImage> = tiles.chunks(rows).map(below).collect();
    beside(&stacks)
}

fn below(pictures: &[DisplayImage]) -> DisplayImage {
    let width = pictures.iter().map(|p| p.width).max().unwrap_or(0);
    let height = pictures.iter().map(|p| p.height + GAP).sum::<usize>().saturating_sub(GAP);
    let mut joined = Grid::filled(width, height, BACKGROUND);
    let mut top = 0;
    for picture in pictures {
        for y in 0..picture.height {
            let start = (top + y) * width;
            joined.data[start..start + picture.width].copy_from_slice(picture.row(y));
        }
        top += picture.height + GAP;
    }
    joined
}
