//! Reflectance of every texel of the atlas: fitted from photographs, evaluated, and as integer planes for coding.

use super::palette::{self, PaletteEntry};
use super::torrance_sparrow::SIGMA_LEVELS;
use super::{ReflectionGeometry, TorranceSparrowLobe, lambert, torrance_sparrow};
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::image::{Grid, Mask};
use crate::surface::atlas::{sample_colour, sample_number};
use crate::views::Component;

/// Fitted reflectance on the atlas of [`crate::surface::charts::Charts`].
///
/// With a point light of intensity `L` at distance `r`: diffuse `K_d (L / r^2) cos(theta_i)`, specular
/// `K_s (L / r^2) / cos(theta_r) exp(-alpha^2 / (2 sigma^2))` (Miyazaki 2007, equations 7 and 8, after division by the
/// light's irradiance). Where the lights are unknown `diffuse` is the weighted mean radiance over the views, the others
/// are empty, and the object can't be relit. Where there is a palette, its lobes replace the specular formula, see
/// `spec/reflectance.md`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReflectanceMaps {
    /// Whether the lights were known, so that `diffuse` is a reflectance and not a radiance.
    pub relightable: bool,
    /// `K_d` per texel.
    pub diffuse: Grid<[f32; 3]>,
    /// `K_s` per texel; empty grid without a specular component.
    pub specular: Grid<[f32; 3]>,
    /// `sigma` per texel, radians; empty grid without a specular component.
    pub sigma: Grid<f32>,
    /// Shapes of highlights, by rising `sigma`; empty for those of Torrance and Sparrow.
    pub palette: Vec<PaletteEntry>,
}

/// Radiance of one component at an atlas position. `geometry` is that of the surface point, not used by maps that hold radiance;
/// reflectance without it is 0.
pub fn evaluate(
    maps: &ReflectanceMaps,
    component: Component,
    at: [f64; 2],
    geometry: Option<&ReflectionGeometry>,
) -> [f32; 3] {
    let diffuse = || {
        let colour = sample_colour(&maps.diffuse, at).map(|x| x as f32);
        match geometry {
            _ if !maps.relightable => colour,
            Some(geometry) => lambert::evaluate(colour, geometry),
            None => [0.0; 3],
        }
    };
    let specular = || match geometry {
        Some(geometry) if maps.relightable && !maps.specular.data.is_empty() && !maps.sigma.data.is_empty() => {
            let lobe = TorranceSparrowLobe {
                specular: sample_colour(&maps.specular, at).map(|x| x as f32),
                sigma: sample_number(&maps.sigma, at) as f32,
            };
            if maps.palette.is_empty() {
                torrance_sparrow::evaluate(&lobe, geometry)
            } else {
                palette::evaluate(&maps.palette, &lobe, geometry)
            }
        }
        _ => [0.0; 3],
    };
    match component {
        Component::Diffuse => diffuse(),
        Component::Specular => specular(),
        Component::Combined => {
            let (d, s) = (diffuse(), specular());
            std::array::from_fn(|c| d[c] + s[c])
        }
    }
}

/// Largest value of a colour plane: `round(sqrt(x / scale) * COLOUR_LEVELS)`. Part of the format.
pub(crate) const COLOUR_LEVELS: i32 = 1023;

/// Reflectance maps as integers.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ReflectancePlanes {
    /// See [`ReflectanceMaps::relightable`].
    pub relightable: bool,
    /// Reflectance at level [`COLOUR_LEVELS`] of the diffuse and the specular planes.
    pub scales: [f32; 2],
    /// Diffuse red, green, blue in `0..=COLOUR_LEVELS`; where there is a specular map its red, green, blue likewise and
    /// `sigma` in `0..=SIGMA_LEVELS`. 3 or 7 planes.
    pub planes: Vec<Grid<i32>>,
    /// See [`ReflectanceMaps::palette`]; only with a specular map.
    pub palette: Vec<PaletteEntry>,
}

/// Quantises maps. Texels outside `mask` become 0. The scale is the largest value, of the specular map that which one texel in 2000
/// exceeds: single wild fits must not cost the others their resolution.
pub(crate) fn to_planes(maps: &ReflectanceMaps, mask: &Mask) -> ReflectancePlanes {
    let mut result = ReflectancePlanes { relightable: maps.relightable, ..ReflectancePlanes::default() };
    result.palette.clone_from(&maps.palette);
    for (k, map) in [&maps.diffuse, &maps.specular].into_iter().enumerate() {
        if map.data.is_empty() {
            continue;
        }
        let mut peaks: Vec<f32> = map
            .data
            .iter()
            .zip(&mask.data)
            .filter(|(x, m)| **m && x.iter().all(|v| v.is_finite()))
            .map(|(x, _)| x[0].max(x[1]).max(x[2]))
            .collect();
        peaks.sort_by(f32::total_cmp);
        let beyond = if k == 0 { 0 } else { peaks.len() / 2000 };
        let scale = peaks.iter().rev().nth(beyond).copied().unwrap_or(0.0).max(1e-9);
        result.scales[k] = scale;
        for c in 0..3 {
            let level = |(x, &m): (&[f32; 3], &bool)| {
                let share = (x[c] / scale).max(0.0) as f64;
                if m { ((share.sqrt() * COLOUR_LEVELS as f64).round() as i32).min(COLOUR_LEVELS) } else { 0 }
            };
            let data = map.data.iter().zip(&mask.data).map(level).collect();
            result.planes.push(Grid { width: map.width, height: map.height, data });
        }
    }
    if !maps.specular.data.is_empty() {
        let (least, most) = torrance_sparrow::SIGMA_RANGE;
        let span = (most as f64 / least as f64).ln();
        let level = |(&sigma, &m): (&f32, &bool)| {
            let share = (sigma as f64 / least as f64).ln() / span;
            if m { (share.clamp(0.0, 1.0) * SIGMA_LEVELS as f64).round() as i32 } else { 0 }
        };
        let data = maps.sigma.data.iter().zip(&mask.data).map(level).collect();
        result.planes.push(Grid { width: maps.sigma.width, height: maps.sigma.height, data });
    }
    result
}

/// Maps of planes. Levels out of range (a lossy coder overshoots) are clamped.
pub(crate) fn from_planes(planes: &ReflectancePlanes) -> Result<ReflectanceMaps> {
    let wrong = |message: &str| Error::format(Tag::REFLECTANCE, 0u64, message);
    let first = planes.planes.first().ok_or_else(|| wrong("no planes; 3 or 7 expected"))?;
    let count = planes.planes.len();
    if count != 3 && count != 7 {
        return Err(wrong("3 or 7 planes expected"));
    }
    let alike = |p: &Grid<i32>| p.width == first.width && p.height == first.height && p.data.len() == first.data.len();
    if !planes.planes.iter().all(alike) || planes.scales.iter().any(|s| !(s.is_finite() && *s >= 0.0)) {
        return Err(wrong("planes of one size and finite scales expected"));
    }
    let colour = |from: usize, scale: f32| {
        let value = |level: i32| {
            let share = level.clamp(0, COLOUR_LEVELS) as f32 / COLOUR_LEVELS as f32;
            share * share * scale
        };
        let [r, g, b] = [0, 1, 2].map(|c| &planes.planes[from + c].data);
        let data = (0..first.data.len()).map(|k| [value(r[k]), value(g[k]), value(b[k])]).collect();
        Grid { width: first.width, height: first.height, data }
    };
    let mut maps = ReflectanceMaps {
        relightable: planes.relightable,
        diffuse: colour(0, planes.scales[0]),
        ..ReflectanceMaps::default()
    };
    if count == 7 {
        maps.specular = colour(3, planes.scales[1]);
        maps.sigma = planes.planes[6].map(|&level| crate::reflectance::torrance_sparrow::sigma_of_level(level));
        maps.palette.clone_from(&planes.palette);
    }
    Ok(maps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_keep_the_maps_within_a_level() {
        let colour = |k: usize| [0.9 * (k as f32 / 63.0), 0.4, 0.001 * k as f32];
        let maps = ReflectanceMaps {
            relightable: true,
            diffuse: Grid { width: 8, height: 8, data: (0..64).map(colour).collect() },
            specular: Grid { width: 8, height: 8, data: (0..64).map(colour).collect() },
            sigma: Grid { width: 8, height: 8, data: (0..64).map(|k| 0.02 + 0.012 * k as f32).collect() },
            ..Default::default()
        };
        let planes = to_planes(&maps, &Grid::filled(8, 8, true));
        assert_eq!(planes.planes.len(), 7);
        let back = from_planes(&planes).unwrap();
        for k in 0..64 {
            for c in 0..3 {
                let error = back.diffuse.data[k][c].sqrt() - maps.diffuse.data[k][c].sqrt();
                assert!(error.abs() < 0.0005, "{error}");
            }
            assert!((back.sigma.data[k] / maps.sigma.data[k]).ln().abs() < 0.0075);
        }
        assert!(from_planes(&ReflectancePlanes { planes: planes.planes[..5].to_vec(), ..planes }).is_err());
    }
}
