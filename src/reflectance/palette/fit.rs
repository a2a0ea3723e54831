//! A palette from what the photographs show of highlights.
//!
//! Blocks of texels come with the width and colour that Torrance and Sparrow's lobe gives them. Widths are cut into as many classes as the
//! palette has entries; what all sightings of a class say of `f` over the half angle, stretched to the class's width, and the difference
//! angle, is averaged and fitted. Then the colours are fitted again, given the palette, and all once more.

use super::{PaletteEntry, around, shape};
use crate::brdf::BrdfSample;
use crate::brdf::dsbrdf::{self, DsbrdfFitOptions, LobeCount};
use crate::reflectance::TorranceSparrowLobe;
use crate::reflectance::torrance_sparrow::SpecularSighting;
use crate::reflectance::torrance_sparrow::{level_of_sigma, sigma_of_level};
use std::f64::consts::FRAC_PI_2;

/// Entries at most; more than these gain nothing on captures tried.
const CLASSES: usize = 4;
/// Levels that entries are apart at least.
const APART: u8 = 12;
/// Rounds of lobes and colours.
const ROUNDS: usize = 2;
/// Slices of the difference angle.
const SLICES: usize = 6;
/// Bins of the stretched half angle, growing with its square, in which a class's sightings are averaged.
const BINS: usize = 60;
/// Sightings with the light lower than this (cosine) are left out.
const MIN_COS_LIGHT: f32 = 0.1;
/// Largest specular colour, as of Torrance and Sparrow's lobe.
const MAX_COLOUR: f64 = 20.0;

/// Fits a palette to the blocks that have a lobe, and changes their colours to suit it. Empty where there are none.
pub(crate) fn fit(lobes: &mut [Option<TorranceSparrowLobe>], sightings: &[Vec<SpecularSighting>]) -> Vec<PaletteEntry> {
    let levels = classes(lobes);
    let mut palette = Vec::new();
    for _ in 0..ROUNDS {
        palette = entries(&levels, lobes, sightings);
        if palette.is_empty() {
            break;
        }
        for (lobe, seen) in lobes.iter_mut().zip(sightings) {
            if let Some(lobe) = lobe {
                recolour(&palette, lobe, seen);
            }
        }
    }
    palette
}

/// Levels at equal parts of the blocks' brightness, in order of width.
fn classes(lobes: &[Option<TorranceSparrowLobe>]) -> Vec<u8> {
    let mut widths: Vec<(f64, f64)> = (lobes.iter().flatten())
        .map(|lobe| (level_of_sigma(lobe.sigma), lobe.specular.iter().map(|&k| k as f64).sum()))
        .collect();
    widths.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = widths.iter().map(|w| w.1).sum();
    let mut levels: Vec<u8> = Vec::new();
    let (mut sum, mut next) = (0.0, 0);
    for (level, brightness) in widths {
        sum += brightness;
        while next < CLASSES && sum >= (next as f64 + 0.5) / CLASSES as f64 * total {
            next += 1;
            let level = level.round().clamp(0.0, 255.0) as u8;
            if levels.last().is_none_or(|&before| level >= before.saturating_add(APART)) {
                levels.push(level);
            }
        }
    }
    levels
}

fn usable(sighting: &SpecularSighting) -> bool {
    let g = &sighting.geometry;
    g.cos_light > MIN_COS_LIGHT && g.cos_view > 0.0 && sighting.radiance.iter().all(|x| x.is_finite())
}

/// Sums over a bin: half angle, difference angle, weight; for each colour radiance times what it is a multiple of, and its square.
#[derive(Clone, Copy, Default)]
struct SliceBin {
    angles: [f64; 3],
    product: [f64; 3],
    square: [f64; 3],
}

/// Lobes for each class, by its sightings.
fn entries(
    levels: &[u8],
    lobes: &[Option<TorranceSparrowLobe>],
    sightings: &[Vec<SpecularSighting>],
) -> Vec<PaletteEntry> {
    // Only the levels of these matter: which class a width lies in.
    let Ok(flat) = dsbrdf::fit_dsbrdf(&[sample(0.1, 0.1, [1.0; 3])], &options()) else { return Vec::new() };
    let keys: Vec<PaletteEntry> = levels.iter().map(|&level| PaletteEntry { level, lobes: flat.clone() }).collect();
    let mut bins = vec![vec![SliceBin::default(); BINS * SLICES]; keys.len()];
    for (lobe, seen) in lobes.iter().zip(sightings) {
        let Some(lobe) = lobe else { continue };
        let (near, part) = around(&keys, lobe.sigma);
        for (class, share) in near.into_iter().zip([1.0 - part, part]) {
            let Some(class) = class.filter(|_| share > 0.0) else { continue };
            let stretch = (sigma_of_level(keys[class].level as i32) / lobe.sigma) as f64;
            for s in seen.iter().filter(|s| usable(s)) {
                let theta_h = (s.geometry.alpha as f64 * stretch).min(FRAC_PI_2 * 0.999);
                let theta_d = (s.geometry.difference as f64).min(FRAC_PI_2 * 0.999);
                let row = ((theta_h / FRAC_PI_2).sqrt() * BINS as f64) as usize;
                let slice = (theta_d / FRAC_PI_2 * SLICES as f64) as usize;
                let Some(bin) = bins[class].get_mut(slice * BINS + row) else { continue };
                let weight = share * s.geometry.cos_view as f64;
                [theta_h, theta_d, 1.0].iter().zip(&mut bin.angles).for_each(|(x, sum)| *sum += weight * x);
                for c in 0..3 {
                    let unit = (lobe.specular[c] * s.geometry.irradiance[c] * s.geometry.cos_light) as f64;
                    bin.product[c] += weight * unit * s.radiance[c] as f64;
                    bin.square[c] += weight * unit * unit;
                }
            }
        }
    }
    let entry = |(&level, bins): (&u8, &Vec<SliceBin>)| {
        let measured = |bin: &SliceBin| {
            let [theta_h, theta_d, weight] = bin.angles;
            let known = weight > 0.3 && bin.square.iter().all(|&s| s > 1e-20);
            let value = [0, 1, 2].map(|c| (bin.product[c] / bin.square[c]).clamp(0.0, 1e4));
            known.then(|| sample(theta_h / weight, theta_d / weight, value))
        };
        let samples: Vec<BrdfSample> = bins.iter().filter_map(measured).collect();
        let lobes = dsbrdf::fit_dsbrdf(&samples, &options()).ok()?;
        Some(PaletteEntry { level, lobes })
    };
    levels.iter().zip(&bins).filter_map(entry).collect()
}

fn options() -> DsbrdfFitOptions {
    DsbrdfFitOptions { slices: SLICES, lobes: LobeCount::Given(3), min_theta_h_deg: 0.0, ..DsbrdfFitOptions::default() }
}

fn sample(theta_h: f64, theta_d: f64, value: [f64; 3]) -> BrdfSample {
    BrdfSample { theta_h, theta_d, cos_incoming: 1.0, cos_outgoing: 1.0, value }
}

/// The colour that explains a block's sightings best, its width as it is.
fn recolour(palette: &[PaletteEntry], lobe: &mut TorranceSparrowLobe, sightings: &[SpecularSighting]) {
    let (mut product, mut square) = ([0.0f64; 3], [0.0f64; 3]);
    for s in sightings.iter().filter(|s| usable(s)) {
        let shape = shape(palette, lobe.sigma, s.geometry.alpha as f64, s.geometry.difference as f64);
        let weight = s.geometry.cos_view as f64;
        for c in 0..3 {
            let unit = (s.geometry.irradiance[c] * s.geometry.cos_light) as f64 * shape[c];
            product[c] += weight * unit * s.radiance[c] as f64;
            square[c] += weight * unit * unit;
        }
    }
    for c in 0..3 {
        if square[c] > 1e-20 {
            lobe.specular[c] = (product[c] / square[c]).clamp(0.0, MAX_COLOUR) as f32;
        }
    }
}
