//! Section `RFLC`: reflectance maps as coded images.
//!
//! The maps' integer planes go three at a time (diffuse colour, specular colour, `sigma` alone) through the shape-adaptive
//! 9/7 and the coefficient coder of the photographs' planes, without prediction, on the mask of the atlas.
//! Normative text: `spec/reflectance.md`.

use super::lobes::LOBES;
use super::maps::ReflectanceMaps;
use super::maps::{LOBE_PLANES, ReflectancePlanes, from_planes};
use crate::container::{Tag, push_f32};
use crate::entropy::RangeDecoder;
use crate::error::{Error, Result};
use crate::image::{Grid, Mask};
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::quantise::bands::Quantiser;
#[cfg(feature = "encode")]
use crate::quantise::bands::RateDistortion;
use crate::residual::coefficients;
use crate::surface::atlas::rasterise_atlas;
use crate::surface::charts::Charts;
use crate::transform::shape_adaptive::{ColourLanes, WaveletPlan};
use byteorder::{ByteOrder, LittleEndian};

const VERSION: u8 = 0;
/// Flag: the lights are known.
const RELIGHTABLE: u8 = 1;
/// Flag: a palette follows the head.
const PALETTE: u8 = 2;
/// Flag: planes of lobes follow the diffuse ones, a scale for each lobe the head.
const LOBE_WEIGHTS: u8 = 4;
/// Version, flags, number of planes, two scales, three steps.
const HEADER_BYTES: usize = 3 + 2 * 4 + 3 * 4;
/// Values stand this far below the middle of their interval, in steps.
const SHRINK: [f32; 2] = [0.08, 0.02];
/// Memory that decoding takes for a texel.
const BYTES_A_TEXEL: usize = 400;
/// And with lobes: five maps, and their planes.
const LOBE_BYTES_A_TEXEL: usize = 5 * 24;

/// The step of each group of three planes.
fn group_steps(steps: [f32; 3], with_lobes: bool) -> Vec<f32> {
    let [diffuse, specular, sigma] = steps;
    if with_lobes { [vec![diffuse], vec![specular; LOBES]].concat() } else { vec![diffuse, specular, sigma] }
}

/// Quantiser steps of the planes, in levels ([`crate::reflectance::maps::COLOUR_LEVELS`], [`crate::reflectance::torrance_sparrow::SIGMA_LEVELS`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSteps {
    /// Diffuse colour.
    pub diffuse: f32,
    /// Specular colour.
    pub specular: f32,
    /// Width of the highlight.
    pub sigma: f32,
}

/// Whether a number of the head, two scales and three steps, is one that the format allows.
fn is_in_range(index: usize, number: f32) -> bool {
    let least = if index > 1 { 1e-3 } else { 0.0 };
    (least..=1e6).contains(&number)
}

/// Bytes of the section, and the maps as the decoder has them.
/// # Errors
/// [`Error::Parameter`] where values or steps are beyond what the format holds.
#[cfg(feature = "encode")]
pub fn encode(
    maps: &ReflectanceMaps,
    mesh: &Mesh,
    charts: &Charts,
    steps: &MapSteps,
    lambda: f32,
) -> Result<(Vec<u8>, ReflectanceMaps)> {
    let mask = rasterise_atlas(mesh, charts)?.mask();
    let planes = crate::reflectance::maps::to_planes(maps, &mask);
    let with_palette = !planes.palette.is_empty() && planes.planes.len() == 7;
    let lobes = if planes.lobe_scales.is_some() { LOBE_WEIGHTS } else { 0 };
    let flags = planes.relightable as u8 + lobes + if with_palette { PALETTE } else { 0 };
    let mut bytes = vec![VERSION, flags, planes.planes.len() as u8];
    for (k, value) in planes.scales.into_iter().chain([steps.diffuse, steps.specular, steps.sigma]).enumerate() {
        if !is_in_range(k, value) {
            return Err(Error::parameter(match k {
                0 | 1 => format!("reflectance or radiance {value:e}, 1000000 at most: divide the capture's radiance"),
                _ => format!("a step of {value} levels in the reflectance maps, 0.001 to 1000000 expected"),
            }));
        }
        push_f32(&mut bytes, value);
    }
    if with_palette {
        crate::reflectance::palette::write_palette(&planes.palette, &mut bytes)?;
    }
    for &scale in planes.lobe_scales.iter().flatten() {
        if !is_in_range(0, scale) {
            let message = format!("a highlight's weight of {scale:e}, 1000000 at most: divide the capture's radiance");
            return Err(Error::parameter(message));
        }
        push_f32(&mut bytes, scale);
    }
    let plan = WaveletPlan::new(&mask);
    let mut coder = crate::entropy::RangeEncoder::new();
    let mut decoded = Vec::new();
    let group_steps = group_steps([steps.diffuse, steps.specular, steps.sigma], planes.lobe_scales.is_some());
    for (planes, step) in planes.planes.chunks(3).zip(group_steps) {
        let pixels: Vec<ColourLanes> = (0..mask.data.len())
            .map(|i| std::array::from_fn(|k| planes.get(k).map_or(0.0, |plane: &Grid<i32>| plane.data[i] as f32)))
            .collect();
        let target = plan.forward(pixels);
        let target = Some((&target[..], RateDistortion { lambda }));
        let quantiser = Quantiser { step, shrink: SHRINK };
        let coefficients = coefficients::code_alone(&mut coder, &plan, &quantiser, target);
        decoded.extend(to_grids(&plan.inverse(&coefficients), &mask, planes.len()));
    }
    bytes.extend(coder.finish());
    let decoded = from_planes(&ReflectancePlanes { planes: decoded, ..planes })?;
    Ok((bytes, decoded))
}

/// The maps of a section, for the mesh and the charts they were made for.
pub fn decode(bytes: &[u8], mesh: &Mesh, charts: &Charts, budget: &Budget) -> Result<ReflectanceMaps> {
    let Some((header, mut stream)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
        return Err(Error::format(
            Tag::REFLECTANCE,
            bytes.len(),
            format!("ends within its head of {HEADER_BYTES} bytes"),
        ));
    };
    let [version, flags, count] = [header[0], header[1], header[2]];
    let with_lobes = flags & LOBE_WEIGHTS != 0;
    if version != VERSION
        || flags > RELIGHTABLE + PALETTE + LOBE_WEIGHTS
        || flags & !RELIGHTABLE == PALETTE + LOBE_WEIGHTS
    {
        return Err(Error::Unsupported(format!("section RFLC of version {version}, flags {flags}")));
    }
    match with_lobes {
        false if count != 3 && count != 7 => {
            return Err(Error::format(Tag::REFLECTANCE, 2, format!("{count} planes; 3 or 7 expected")));
        }
        true if count as usize != LOBE_PLANES => {
            return Err(Error::format(Tag::REFLECTANCE, 2, format!("{count} planes; {LOBE_PLANES} expected")));
        }
        _ => {}
    }
    let mut numbers = [0f32; 5];
    for (k, number) in numbers.iter_mut().enumerate() {
        *number = LittleEndian::read_f32(&header[3 + 4 * k..]);
        if !is_in_range(k, *number) {
            return Err(Error::format(Tag::REFLECTANCE, 3 + 4 * k, format!("{number} is no scale or step")));
        }
    }
    let [diffuse_scale, specular_scale, steps @ ..] = numbers;
    let mut palette = Vec::new();
    if flags & PALETTE != 0 {
        if count != 7 {
            return Err(Error::format(Tag::REFLECTANCE, 2, "a palette without specular planes"));
        }
        let end;
        (palette, end) = crate::reflectance::palette::read_palette(bytes, HEADER_BYTES, Tag::REFLECTANCE, budget)?;
        stream = bytes.get(end..).unwrap_or_default();
    }
    let mut lobe_scales = None;
    if with_lobes {
        let Some((scales, rest)) = stream.split_first_chunk::<{ 4 * LOBES }>() else {
            return Err(Error::format(Tag::REFLECTANCE, bytes.len(), "ends within the scales of its lobes"));
        };
        stream = rest;
        let scales: [f32; LOBES] = std::array::from_fn(|k| LittleEndian::read_f32(&scales[4 * k..]));
        if let Some(k) = scales.iter().position(|&scale| !is_in_range(0, scale)) {
            let at = HEADER_BYTES + 4 * k;
            return Err(Error::format(Tag::REFLECTANCE, at, format!("{} is no scale", scales[k])));
        }
        lobe_scales = Some(scales);
    }
    let texel_bytes = BYTES_A_TEXEL + if with_lobes { LOBE_BYTES_A_TEXEL } else { 0 };
    budget.charge_items("reflectance maps", charts.width as u64 * charts.height as u64, texel_bytes)?;
    let mask = rasterise_atlas(mesh, charts)?.mask();
    let plan = WaveletPlan::new(&mask);
    let mut coder = RangeDecoder::new(stream);
    let mut planes = Vec::new();
    let mut left = count as usize;
    for step in group_steps(steps, with_lobes) {
        if left == 0 {
            break;
        }
        let here = left.min(3);
        let quantiser = Quantiser { step, shrink: SHRINK };
        let coefficients = coefficients::code_alone(&mut coder, &plan, &quantiser, None);
        planes.extend(to_grids(&plan.inverse(&coefficients), &mask, here));
        left -= here;
    }
    if !coder.ends_as_written(0) {
        return Err(Error::format(Tag::REFLECTANCE, bytes.len(), "its length does not fit its content"));
    }
    let scales = [diffuse_scale, specular_scale];
    from_planes(&ReflectancePlanes { relightable: flags & RELIGHTABLE != 0, scales, planes, palette, lobe_scales })
}

/// The first `count` channels, rounded; 0 outside the mask.
fn to_grids(pixels: &[ColourLanes], mask: &Mask, count: usize) -> Vec<Grid<i32>> {
    (0..count)
        .map(|k| {
            let data = pixels.iter().zip(&mask.data).map(|(p, &m)| if m { (p[k] + 0.5).floor() as i32 } else { 0 });
            Grid { width: mask.width, height: mask.height, data: data.collect() }
        })
        .collect()
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use crate::limits::Limits;
    use crate::reflectance::codec::*;
    use crate::surface::atlas;

    #[test]
    fn what_the_reader_refuses_is_not_written() {
        let mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], triangles: vec![[0, 1, 2]] };
        let charts = atlas::layout(&mesh, 8.0).unwrap();
        let (width, height) = (charts.width as usize, charts.height as usize);
        let code = |radiance: f32, step: f32| {
            let maps = ReflectanceMaps { diffuse: Grid::filled(width, height, [radiance; 3]), ..Default::default() };
            let steps = MapSteps { diffuse: step, specular: 1.0, sigma: 1.0 };
            encode(&maps, &mesh, &charts, &steps, 0.1)
        };
        let (bytes, decoded) = code(1e6, 1.0).unwrap();
        assert_eq!(decode(&bytes, &mesh, &charts, &Budget::new(Limits::default())).unwrap(), decoded);
        assert!(code(2e6, 1.0).unwrap_err().to_string().starts_with("reflectance or radiance 2e6, 1000000 at most"));
        assert!(code(1.0, 1e-4).unwrap_err().to_string().starts_with("a step of 0.0001 levels"));
    }
}
