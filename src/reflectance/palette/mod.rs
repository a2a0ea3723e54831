//! Measured lobes for the texels' highlights, in place of the Gaussian of Torrance and Sparrow.
//!
//! A few materials in the lobe form of Nishino and Lombardi 2011 (DSBRDF), each with the `sigma` that it stands for. A texel's own `sigma`
//! says which two it lies between, and stretches both to its width; its specular colour multiplies them. So the maps say where and how
//! wide highlights are, and the palette what shape they have, over the half and the difference angle.

#[cfg(feature = "encode")]
mod fit;
mod gaussian;
mod tables;

pub(crate) use tables::PaletteTables;

#[cfg(feature = "encode")]
pub(super) use fit::fit;

use super::torrance_sparrow::{level_of_sigma, sigma_of_level};
use super::{ReflectionGeometry, TorranceSparrowLobe};
use crate::brdf::dsbrdf::DsbrdfMaterial;
use crate::container::{Tag, push_u16};
use crate::error::{Error, Result};
use crate::limits::Budget;
use byteorder::{ByteOrder, LittleEndian};
use std::f64::consts::FRAC_PI_2;

/// Most entries of a palette. Part of the format.
pub(crate) const MAX_ENTRIES: usize = 8;
/// Values from here on count as 0. Part of the format.
const VALUE_LIMIT: f64 = 1e6;
/// Memory that decoding takes for an entry: three curves for each of 90 slices, 5 lobes and 3 colours.
const ENTRY_MEMORY: u64 = 100_000;

/// A material with the width that it stands for.
#[derive(Debug, Clone, PartialEq)]
pub struct PaletteEntry {
    /// Level of `sigma`, `0..=SIGMA_LEVELS`.
    pub level: u8,
    /// The lobes, per unit of specular colour.
    pub lobes: DsbrdfMaterial,
}

impl PaletteEntry {
    /// Returns the width of the highlight that the entry stands for, see [`crate::ReflectanceMaps::sigma`].
    pub fn sigma(&self) -> f32 {
        sigma_of_level(self.level.into())
    }
}

/// Specular radiance, `K_s E cos(theta_i) f`; zero where the light or the camera is behind the surface. `palette` is not empty, its
/// levels rise.
pub(crate) fn evaluate(
    palette: &[PaletteEntry],
    lobe: &TorranceSparrowLobe,
    geometry: &ReflectionGeometry,
) -> [f32; 3] {
    if geometry.cos_light <= 0.0 || geometry.cos_view <= 0.0 || lobe.sigma <= 0.0 {
        return [0.0; 3];
    }
    let shape = shape(palette, lobe.sigma, geometry.alpha as f64, geometry.difference as f64);
    std::array::from_fn(|c| {
        let value = lobe.specular[c] * geometry.irradiance[c] * geometry.cos_light * shape[c] as f32;
        if value.is_finite() { value } else { 0.0 }
    })
}

/// The two entries around a `sigma` and the weight of the second.
fn around(palette: &[PaletteEntry], sigma: f32) -> ([Option<usize>; 2], f64) {
    let level = level_of_sigma(sigma);
    let above = palette.iter().position(|entry| entry.level as f64 > level).unwrap_or(palette.len());
    let index = |k: Option<usize>| k.filter(|&k| k < palette.len());
    match (index(above.checked_sub(1)), index(Some(above))) {
        (Some(low), Some(high)) => {
            let span = (palette[high].level as f64 - palette[low].level as f64).max(1.0);
            ([Some(low), Some(high)], ((level - palette[low].level as f64) / span).clamp(0.0, 1.0))
        }
        (one, other) => ([one.or(other), None], 0.0),
    }
}

/// `f` per unit of specular colour, at the angle `alpha` between normal and half vector and the difference angle, radians: both entries
/// around the `sigma`, each stretched to it. 0 without entries, and where lobes give a million or more.
pub(crate) fn shape(palette: &[PaletteEntry], sigma: f32, alpha: f64, difference: f64) -> [f64; 3] {
    mix(palette, sigma, alpha, |entry, theta_h| palette[entry].lobes.value_at(theta_h, difference))
}

/// [`shape`] of entries whose values at a half angle are given.
fn mix(palette: &[PaletteEntry], sigma: f32, alpha: f64, value: impl Fn(usize, f64) -> [f64; 3]) -> [f64; 3] {
    let (entries, part) = around(palette, sigma);
    let mut sum = [0.0; 3];
    for (entry, weight) in entries.into_iter().zip([1.0 - part, part]) {
        let Some(entry) = entry.filter(|_| weight > 0.0) else { continue };
        let stretched = alpha * (sigma_of_level(palette[entry].level as i32) / sigma) as f64;
        let value = value(entry, stretched.min(FRAC_PI_2));
        (0..3).for_each(|c| sum[c] += weight * value[c]);
    }
    // Lobes of a file may be higher than numbers go.
    sum.map(|f| if f < VALUE_LIMIT { f } else { 0.0 })
}

/// The palette as bytes: how many entries, then of each its level, its length and its lobes.
#[cfg(feature = "encode")]
pub(super) fn write_palette(palette: &[PaletteEntry], bytes: &mut Vec<u8>) -> Result<()> {
    let count = u8::try_from(palette.len()).ok().filter(|&count| (1..=MAX_ENTRIES as u8).contains(&count));
    bytes.push(count.ok_or_else(|| Error::parameter("a palette has 1 to 8 entries"))?);
    for entry in palette {
        let coded = entry.lobes.encode();
        let length = u16::try_from(coded.len()).map_err(|_| Error::parameter("a palette's entry is too large"))?;
        bytes.push(entry.level);
        push_u16(bytes, length);
        bytes.extend(coded);
    }
    Ok(())
}

/// Reads what [`write_palette`] wrote, from `at` of the section on; returns the palette and its end.
pub(super) fn read_palette(
    bytes: &[u8],
    at: usize,
    section: Tag,
    budget: &Budget,
) -> Result<(Vec<PaletteEntry>, usize)> {
    let mut place = at;
    let mut take = |count: usize| {
        let taken = place.checked_add(count).and_then(|end| bytes.get(place..end));
        let error = || Error::format(section, place, format!("the section ends within its palette, {count} bytes"));
        let taken = taken.ok_or_else(error)?;
        place += count;
        Ok::<&[u8], Error>(taken)
    };
    let count = take(1)?.first().copied().unwrap_or(0) as usize;
    if !(1..=MAX_ENTRIES).contains(&count) {
        return Err(Error::format(section, at, format!("a palette of {count} entries; 1 to {MAX_ENTRIES} expected")));
    }
    let mut palette: Vec<PaletteEntry> = Vec::with_capacity(count);
    for _ in 0..count {
        let head = take(3)?;
        let (level, length) = (head[0], LittleEndian::read_u16(&head[1..]) as usize);
        if palette.last().is_some_and(|before| before.level >= level) {
            return Err(Error::format(section, at, "the levels of a palette must rise"));
        }
        budget.charge("palette of lobes", ENTRY_MEMORY)?;
        let lobes = DsbrdfMaterial::decode(take(length)?, section)?;
        palette.push(PaletteEntry { level, lobes });
    }
    Ok((palette, place))
}

#[cfg(all(test, feature = "encode"))]
mod tests;
