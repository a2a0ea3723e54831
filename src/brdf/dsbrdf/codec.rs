//! A material of lobes as bytes: each parameter as its difference from the slice before, adaptively range-coded.

use super::{DsbrdfMaterial, MAX_LOBES, MAX_SLICES};
use crate::container::Tag;
use crate::entropy::{BitCoder, NumberModel, RangeDecoder, RangeEncoder, code_end, code_raw};
use crate::error::{Error, Result};

impl DsbrdfMaterial {
    /// The coded material.
    pub fn encode(&self) -> Vec<u8> {
        let mut coder = RangeEncoder::new();
        code(&mut coder, Some(self));
        coder.finish()
    }

    /// Reads what [`DsbrdfMaterial::encode`] wrote; at most 3 x 5 x 3 x 90 numbers.
    /// # Errors
    /// [`Error::Format`] where counts or parameters are out of range, or the bytes end too early or too late.
    pub fn decode(bytes: &[u8], section: Tag) -> Result<Self> {
        let mut coder = RangeDecoder::new(bytes);
        let material = code(&mut coder, None).ok_or_else(|| {
            Error::format(section, 0, "counts or parameters of a material of lobes are out of range, or it is cut")
        })?;
        if !coder.ends_as_written(0) {
            return Err(Error::format(section, 0, "a material of lobes doesn't end where its bytes end"));
        }
        Ok(material)
    }
}

fn code<C: BitCoder>(coder: &mut C, material: Option<&DsbrdfMaterial>) -> Option<DsbrdfMaterial> {
    let slices = code_raw(coder, 7, material.map_or(0, |m| m.slices as u32)) as usize;
    let lobes = code_raw(coder, 3, material.map_or(0, |m| m.lobes as u32)) as usize;
    let amplitudes = coder.bit(1 << 15, material.is_some_and(|m| m.amplitudes));
    if !(1..=MAX_SLICES).contains(&slices) || !(1..=MAX_LOBES).contains(&lobes) {
        return None;
    }
    let parameters = 2 + amplitudes as usize;
    let curves = lobes * parameters;
    // First slices of green and blue follow red; within a curve each slice follows the one before.
    let mut first: [NumberModel; 2] = Default::default();
    let mut next: [NumberModel; 3] = Default::default();
    let mut quantised: Vec<i32> = Vec::with_capacity(3 * curves * slices);
    for curve in 0..3 * curves {
        for slice in 0..slices {
            let n = curve * slices + slice;
            let red = if curve >= curves { quantised.get(n - curves * slices).copied() } else { None };
            let before = if slice > 0 { quantised.last().copied() } else { None };
            // Green and blue change from slice to slice as red does.
            let (predicted, model) = match (before, red) {
                (None, None) => (0, &mut first[0]),
                (None, Some(red)) => (red, &mut first[1]),
                (Some(before), None) => (before, &mut next[curve % parameters]),
                (Some(before), Some(red)) => {
                    let red_before = quantised.get(n - 1 - curves * slices).copied().unwrap_or(red);
                    (before + red - red_before, &mut next[curve % parameters])
                }
            };
            let value = material.and_then(|m| m.quantised.get(n)).map_or(0, |q| q.wrapping_sub(predicted));
            let difference = model.code_signed(coder, value);
            let value = predicted.checked_add(difference).filter(crate::brdf::dsbrdf::is_in_range)?;
            quantised.push(value);
        }
    }
    if !code_end(coder) {
        return None;
    }
    DsbrdfMaterial::new(slices, lobes, amplitudes, quantised)
}
