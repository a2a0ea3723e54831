//! Section `lIGt`: spherical Gaussians as they are, maps as images of logarithms through the wavelet and the coefficient
//! coder of the photographs. Normative text: `spec/lighting.md`.

use super::{EnvironmentLobes, PrefilteredMap, SphericalGaussian};
use crate::container::{Tag, push_f32, push_u16};
use crate::entropy::{BitCoder, RangeDecoder, code_end};
use crate::error::{Error, Result};
use crate::image::Mask;
use crate::limits::Budget;
use crate::quantise::bands::{Quantiser, RateDistortion};
use crate::residual::coefficients;
use crate::transform::shape_adaptive::{ColourLanes, WaveletPlan};
use byteorder::{ByteOrder, LittleEndian};

const VERSION: u8 = 0;
/// Most lobes and maps. Part of the format.
const MAX_LOBES: usize = 64;
const MAX_MAPS: usize = 16;
/// Most cells along a side of a map. Part of the format.
const MAX_SIZE: usize = 1024;
/// Bytes of a lobe and of a map's head.
const LOBE_BYTES: usize = 7 * 4;
const LEVEL_BYTES: usize = 2 + 3 * 4;
/// Steps of a doubling. Part of the format.
const STEPS: usize = 64;
/// Largest integer of a cell. Part of the format.
const MAX_INDEX: i32 = 48 * STEPS as i32;
/// Values stand this far below the middle of their interval, in steps.
const SHRINK: [f32; 2] = [0.08, 0.02];
/// Memory that decoding takes for a cell.
const BYTES_A_CELL: usize = 400;

/// Options of [`encode`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightCodingOptions {
    /// Quantiser step, in 1/64 of a doubling: 3 is an error of about 1 %.
    pub step: f32,
}

impl Default for LightCodingOptions {
    fn default() -> Self {
        LightCodingOptions { step: 3.0 }
    }
}

/// A map's head.
struct LightHeader {
    size: usize,
    sharpness: f32,
    /// Radiance below which integers are linear rather than logarithmic.
    floor: f32,
    step: f32,
}

/// Returns the bytes of the section, and the light as the decoder has it. Lobes become singles.
///
/// # Errors
///
/// [`Error::Parameter`] for more than 64 lobes or 16 maps, a map of more than 1024 cells a side, or a step out of range.
#[cfg(feature = "encode")]
pub fn encode(light: &EnvironmentLobes, options: &LightCodingOptions) -> Result<(Vec<u8>, EnvironmentLobes)> {
    if light.diffuse.len() > MAX_LOBES || light.prefiltered.len() > MAX_MAPS {
        return Err(Error::parameter(format!("a light has {MAX_LOBES} lobes and {MAX_MAPS} levels at most")));
    }
    if light.prefiltered.iter().any(|level| level.size() > MAX_SIZE) {
        return Err(Error::parameter(format!("a level has {MAX_SIZE} cells a side at most")));
    }
    if !(1e-3..=1e6).contains(&options.step) {
        return Err(Error::parameter("the step of the levels must be 0.001 to 1,000,000"));
    }
    let mut bytes = vec![VERSION, light.diffuse.len() as u8, light.prefiltered.len() as u8];
    for lobe in &light.diffuse {
        for value in lobe.axis.into_iter().chain([lobe.sharpness]).chain(lobe.amplitude) {
            push_f32(&mut bytes, value as f32);
        }
    }
    let mut coder = crate::entropy::RangeEncoder::new();
    for level in &light.prefiltered {
        let cells = level.cells();
        let mean = cells.iter().flatten().map(|&x| x as f64).sum::<f64>() / (3 * cells.len()) as f64;
        let floor = ((mean / 128.0) as f32).clamp(1e-12, 1e12);
        let head = LightHeader { size: level.size(), sharpness: level.sharpness() as f32, floor, step: options.step };
        push_u16(&mut bytes, head.size as u16);
        [head.sharpness, head.floor, head.step].into_iter().for_each(|value| push_f32(&mut bytes, value));
        let integer = |x: f32| {
            let steps = (1.0 + x.max(0.0) as f64 / floor as f64).log2() * STEPS as f64;
            steps.round().min(MAX_INDEX as f64) as f32
        };
        let pixels: Vec<ColourLanes> = (cells.iter())
            .map(|cell| {
                let [r, g, b] = cell.map(integer);
                [g, r - g, b - g, 0.0]
            })
            .collect();
        code_level(&mut coder, &head, Some(&pixels));
    }
    code_end(&mut coder);
    bytes.extend(coder.finish());
    let limits = crate::limits::Limits { memory_bytes: u64::MAX, ..Default::default() };
    let decoded = decode(&bytes, &Budget::new(limits))?;
    Ok((bytes, decoded))
}

/// Decodes the light of a section.
///
/// # Errors
///
/// [`Error::Format`] for bytes that are no such section, [`Error::Limits`] beyond the budget.
pub fn decode(bytes: &[u8], budget: &Budget) -> Result<EnvironmentLobes> {
    let wrong = |at: usize, message: String| Error::format(Tag::LIGHT, at as u64, message);
    let Some((&[version, lobes, levels], rest)) = bytes.split_first_chunk::<3>() else {
        return Err(wrong(bytes.len(), "ends within its first 3 bytes".into()));
    };
    if version != VERSION {
        return Err(Error::Unsupported(format!("section lIGt of version {version}")));
    }
    let (lobes, levels) = (lobes as usize, levels as usize);
    if lobes > MAX_LOBES || levels > MAX_MAPS {
        return Err(wrong(1, format!("{lobes} lobes and {levels} levels; at most {MAX_LOBES} and {MAX_MAPS}")));
    }
    let Some((lobe_bytes, rest)) = rest.split_at_checked(lobes * LOBE_BYTES) else {
        return Err(wrong(bytes.len(), "ends within its lobes".into()));
    };
    let Some((level_bytes, stream)) = rest.split_at_checked(levels * LEVEL_BYTES) else {
        return Err(wrong(bytes.len(), "ends within the heads of its levels".into()));
    };
    let mut light = EnvironmentLobes::default();
    for (k, lobe) in lobe_bytes.chunks_exact(LOBE_BYTES).enumerate() {
        light.diffuse.push(parse_lobe(lobe).ok_or_else(|| {
            let message = "a lobe needs a unit axis, a sharpness of 1e-3 to 1e6, an amplitude of 0 to 1e30";
            wrong(3 + k * LOBE_BYTES, message.into())
        })?);
    }
    let mut heads: Vec<LightHeader> = Vec::with_capacity(levels);
    for (k, head) in level_bytes.chunks_exact(LEVEL_BYTES).enumerate() {
        let at = 3 + lobe_bytes.len() + k * LEVEL_BYTES;
        let head = parse_head(head).ok_or_else(|| wrong(at, "no size, sharpness, floor or step of a level".into()))?;
        if heads.last().is_some_and(|before| before.sharpness <= head.sharpness) {
            return Err(wrong(at, "levels must become less sharp".into()));
        }
        budget.charge_items("levels of the light", (head.size * head.size) as u64, BYTES_A_CELL)?;
        heads.push(head);
    }
    let powers = powers();
    let mut coder = RangeDecoder::new(stream);
    for head in heads {
        let cells = (code_level(&mut coder, &head, None).iter())
            .map(|pixel| {
                let [g, r, b] = [pixel[0], pixel[1], pixel[2]].map(|v| (v + 0.5).floor() as i32);
                [g.saturating_add(r), g, g.saturating_add(b)].map(|steps| radiance(steps, head.floor, &powers))
            })
            .collect();
        budget.release((head.size * head.size * (BYTES_A_CELL - 12)) as u64);
        light.prefiltered.extend(PrefilteredMap::new(head.sharpness as f64, head.size, cells));
    }
    if !code_end(&mut coder) || !coder.ends_as_written(0) {
        return Err(wrong(bytes.len() - stream.len(), "the stream does not end with the last level".into()));
    }
    Ok(light)
}

fn single(bytes: &[u8], index: usize) -> f32 {
    bytes.get(4 * index..4 * index + 4).map_or(f32::NAN, LittleEndian::read_f32)
}

fn parse_lobe(bytes: &[u8]) -> Option<SphericalGaussian> {
    let values: [f64; 7] = std::array::from_fn(|k| single(bytes, k) as f64);
    let [x, y, z, sharpness, amplitude @ ..] = values;
    let length = (x * x + y * y + z * z).sqrt();
    let right = (length - 1.0).abs() < 1e-3
        && (1e-3..=1e6).contains(&sharpness)
        && amplitude.iter().all(|a| (0.0..=1e30).contains(a));
    right.then(|| SphericalGaussian { axis: [x / length, y / length, z / length], sharpness, amplitude })
}

fn parse_head(bytes: &[u8]) -> Option<LightHeader> {
    let (size, rest) = bytes.split_at_checked(2)?;
    let size = LittleEndian::read_u16(size) as usize;
    let [sharpness, floor, step] = std::array::from_fn(|k| single(rest, k));
    let right = (4..=MAX_SIZE).contains(&size)
        && (1e-3..=1e6).contains(&sharpness)
        && (1e-13..=1e13).contains(&floor)
        && (1e-3..=1e6).contains(&step);
    right.then_some(LightHeader { size, sharpness, floor, step })
}

/// Codes one map: channels green, red - green, blue - green. In decoding there are no `pixels`.
fn code_level<C: BitCoder>(coder: &mut C, head: &LightHeader, pixels: Option<&[ColourLanes]>) -> Vec<ColourLanes> {
    let plan = WaveletPlan::new(&Mask::filled(head.size, head.size, true));
    let target = pixels.map(|pixels| plan.forward(pixels.to_vec()));
    let target = target.as_ref().map(|target| (&target[..], RateDistortion { lambda: LAMBDA }));
    let quantiser = Quantiser { step: head.step, shrink: SHRINK };
    let coefficients = coefficients::code_alone(coder, &plan, &quantiser, target);
    plan.inverse(&coefficients)
}

/// Value of a bit of the maps, in squared steps. The encoder's choice.
const LAMBDA: f32 = 0.1;

/// `2^(k / 64)`: products of repeated square roots of 2, so that they are the same everywhere.
fn powers() -> [f64; STEPS] {
    let mut roots = [0.0; 6];
    let mut root = 2f64;
    for slot in &mut roots {
        root = root.sqrt();
        *slot = root;
    }
    std::array::from_fn(|k| {
        let bits = (0..6).filter(|bit| k >> (5 - bit) & 1 == 1);
        bits.fold(1.0, |product, bit| product * roots[bit])
    })
}

/// `floor (2^(steps / 64) - 1)`.
fn radiance(steps: i32, floor: f32, powers: &[f64; STEPS]) -> f32 {
    let steps = steps.clamp(0, MAX_INDEX) as usize;
    let whole = (1u64 << (steps / STEPS)) as f64;
    (floor as f64 * (whole * powers[steps % STEPS] - 1.0)) as f32
}

#[cfg(test)]
mod tests {
    use crate::lighting::codec::*;

    fn light() -> EnvironmentLobes {
        let level = |sharpness: f64, size: usize| {
            let cells = (0..size * size).map(|k| [0.2 + 0.01 * (k % size) as f32, (k / size) as f32, 40.0]).collect();
            PrefilteredMap::new(sharpness, size, cells).unwrap()
        };
        let lobe = |x: f64| SphericalGaussian {
            axis: [x, (1.0 - x * x).sqrt(), 0.0],
            sharpness: 3.5,
            amplitude: [1.0, 0.0, 2e4],
        };
        EnvironmentLobes { diffuse: vec![lobe(0.5), lobe(-1.0)], prefiltered: vec![level(80.0, 24), level(5.0, 16)] }
    }

    fn read(bytes: &[u8]) -> Result<EnvironmentLobes> {
        decode(bytes, &Budget::new(crate::limits::Limits { memory_bytes: 1 << 22, ..Default::default() }))
    }

    #[test]
    fn powers_of_two_are_right() {
        let powers = powers();
        assert!((0..STEPS).all(|k| (powers[k] - (k as f64 / 64.0).exp2()).abs() < 1e-15 * 4.0));
        assert_eq!(radiance(64, 3.0, &powers), 3.0);
        assert_eq!(radiance(-5, 3.0, &powers), 0.0);
    }

    #[test]
    fn light_comes_back() {
        let light = light();
        let (bytes, decoded) = encode(&light, &LightCodingOptions { step: 1.0 }).unwrap();
        assert_eq!(read(&bytes).unwrap(), decoded);
        assert!((decoded.diffuse[0].axis[1] - light.diffuse[0].axis[1]).abs() < 1e-7);
        for (a, b) in light.prefiltered.iter().zip(&decoded.prefiltered) {
            assert_eq!(a.sharpness(), b.sharpness());
            for (x, y) in a.cells().iter().flatten().zip(b.cells().iter().flatten()) {
                assert!((x - y).abs() < 0.03 * x + 0.12, "{x} {y}");
            }
        }
        let empty = encode(&EnvironmentLobes::default(), &LightCodingOptions::default()).unwrap();
        assert_eq!(
            (empty.1.clone(), read(&empty.0).unwrap()),
            (EnvironmentLobes::default(), EnvironmentLobes::default())
        );
    }

    #[test]
    fn damage_is_an_error() {
        let (bytes, _) = encode(&light(), &LightCodingOptions::default()).unwrap();
        for length in 0..bytes.len() {
            assert!(read(&bytes[..length]).is_err(), "{length}");
        }
        assert!(read(&[&bytes[..], &[1]].concat()).is_err());
        assert!(read(&[&bytes[..], &[0]].concat()).is_err());
        for (at, value) in
            [(0, 1), (1, 65), (2, 17), (3 + 3, 0x7f), (3 + 15, 0xff), (3 + 56, 0xff), (3 + 57, 0xff), (3 + 61, 0xff)]
        {
            let mut damaged = bytes.clone();
            damaged[at] = value;
            assert!(read(&damaged).is_err(), "{at}");
        }
        let limited = decode(&bytes, &Budget::new(crate::limits::Limits { memory_bytes: 1000, ..Default::default() }));
        assert!(matches!(limited, Err(Error::Limits { .. })));
        // Damage behind the checksum: an error or another light, never anything else.
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            if let Ok(light) = read(&damaged) {
                assert!(
                    light.prefiltered.iter().all(|level| level
                        .cells()
                        .iter()
                        .flatten()
                        .all(|x| x.is_finite() && *x >= 0.0))
                );
            }
        }
    }
}
