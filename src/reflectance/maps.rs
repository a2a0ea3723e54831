//! Reflectance of every texel of the atlas: fitted from photographs, evaluated, and as integer planes for coding.

use super::lobes::{self, LOBES};
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
    /// Weights of GGX lobes of rising roughness, per texel; empty for other models. Where there are any, `specular` and `sigma` are their
    /// nearest single lobe, and `diffuse` is that of a layer under a dielectric surface. See `spec/reflectance.md`.
    pub lobes: Vec<Grid<[f32; 3]>>,
}

impl ReflectanceMaps {
    /// Roughness of each of the lobes; empty for other models.
    pub fn lobe_roughness(&self) -> &'static [f64] {
        if self.lobes.is_empty() { &[] } else { &lobes::ROUGHNESS }
    }
    /// Weights of the lobes at an atlas position.
    pub(crate) fn lobe_weights(&self, at: [f64; 2]) -> [[f32; 3]; LOBES] {
        std::array::from_fn(|k| match self.lobes.get(k) {
            Some(map) => sample_colour(map, at).map(|x| x as f32),
            None => [0.0; 3],
        })
    }
    /// Sets `specular` and `sigma` to the nearest single lobe of each texel's lobes.
    pub(crate) fn set_single_lobes(&mut self) {
        let Some(first) = self.lobes.first() else { return };
        let (width, height) = (first.width, first.height);
        let weights = |at: usize| std::array::from_fn(|k| self.lobes.get(k).map_or([0.0; 3], |map| map.data[at]));
        let single: Vec<_> = (0..first.data.len()).map(|at| lobes::single_lobe(&weights(at))).collect();
        self.specular = Grid { width, height, data: single.iter().map(|lobe| lobe.specular).collect() };
        self.sigma = Grid { width, height, data: single.iter().map(|lobe| lobe.sigma).collect() };
    }
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
            Some(geometry) if maps.lobes.is_empty() => lambert::evaluate(colour, geometry),
            Some(geometry) => lambert::evaluate(colour.map(|x| x * lobes::layer_factor(geometry)), geometry),
            None => [0.0; 3],
        }
    };
    let specular = || match geometry {
        Some(geometry) if maps.relightable && !maps.lobes.is_empty() => {
            lobes::evaluate(&maps.lobe_weights(at), geometry)
        }
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
    /// Weights at level [`COLOUR_LEVELS`] of the planes of each lobe, which take the place of the specular map's and `sigma`'s; `None`
    /// without lobes.
    pub lobe_scales: Option<[f32; LOBES]>,
}

/// Quantises maps. Texels outside `mask` become 0. The scale is the largest value, of the specular map that which one texel in 2000
/// exceeds: single wild fits must not cost the others their resolution.
pub(crate) fn to_planes(maps: &ReflectanceMaps, mask: &Mask) -> ReflectancePlanes {
    let mut result = ReflectancePlanes { relightable: maps.relightable, ..ReflectancePlanes::default() };
    result.palette.clone_from(&maps.palette);
    if maps.lobes.is_empty() {
        for (k, map) in [&maps.diffuse, &maps.specular].into_iter().enumerate() {
            if !map.data.is_empty() {
                let share = if k == 0 { 0 } else { WILD_SHARE };
                result.scales[k] = push_colour(map, mask, share, &mut result.planes);
            }
        }
    } else {
        result.scales[0] = push_colour(&maps.diffuse, mask, 0, &mut result.planes);
        let scales = std::array::from_fn(|k| push_colour(&maps.lobes[k], mask, WILD_SHARE, &mut result.planes));
        result.lobe_scales = Some(scales);
        return result;
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

/// One texel in so many may exceed the scale of its map.
const WILD_SHARE: usize = 2000;

/// Appends the planes of a colour map and returns its scale. With `wild_share` above 0 one texel in so many may exceed it.
fn push_colour(map: &Grid<[f32; 3]>, mask: &Mask, wild_share: usize, planes: &mut Vec<Grid<i32>>) -> f32 {
    let finite = map.data.iter().zip(&mask.data).filter(|(x, m)| **m && x.iter().all(|v| v.is_finite()));
    let mut peaks: Vec<f32> = finite.map(|(x, _)| x[0].max(x[1]).max(x[2])).collect();
    peaks.sort_by(f32::total_cmp);
    let beyond = peaks.len().checked_div(wild_share).unwrap_or(0);
    let scale = peaks.iter().rev().nth(beyond).copied().unwrap_or(0.0).max(1e-9);
    for c in 0..3 {
        let level = |(x, &m): (&[f32; 3], &bool)| {
            let share = (x[c] / scale).max(0.0) as f64;
            if m { ((share.sqrt() * COLOUR_LEVELS as f64).round() as i32).min(COLOUR_LEVELS) } else { 0 }
        };
        let data = map.data.iter().zip(&mask.data).map(level).collect();
        planes.push(Grid { width: map.width, height: map.height, data });
    }
    scale
}

/// Planes of a file with lobes: diffuse colour and the colours of each lobe.
pub(crate) const LOBE_PLANES: usize = 3 + 3 * LOBES;

/// Maps of planes. Levels out of range (a lossy coder overshoots) are clamped.
pub(crate) fn from_planes(planes: &ReflectancePlanes) -> Result<ReflectanceMaps> {
    let wrong = |message: &str| Error::format(Tag::REFLECTANCE, 0u64, message);
    let first = planes.planes.first().ok_or_else(|| wrong("no planes; 3 or 7 expected"))?;
    let count = planes.planes.len();
    match planes.lobe_scales {
        None if count != 3 && count != 7 => return Err(wrong("3 or 7 planes expected")),
        Some(_) if count != LOBE_PLANES => return Err(wrong("18 planes expected")),
        _ => {}
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
    if let Some(scales) = planes.lobe_scales {
        maps.lobes = (0..LOBES).map(|k| colour(3 + 3 * k, scales[k])).collect();
        maps.set_single_lobes();
    } else if count == 7 {
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
