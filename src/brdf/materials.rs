//! Fitted materials by name, and section `mATl` that holds them.

use super::Brdf;
use super::compact::CompactMaterial;
use super::dsbrdf::DsbrdfMaterial;
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::limits::Budget;
use byteorder::{ByteOrder, LittleEndian};
use std::collections::HashSet;

/// A material that a few hundred bytes describe.
#[derive(Debug, Clone, PartialEq)]
pub enum FittedMaterial {
    /// Lobes of the half angle (DSBRDF).
    Dsbrdf(DsbrdfMaterial),
    /// The project's own form.
    Compact(CompactMaterial),
}

impl FittedMaterial {
    /// `dsbrdf` or `compact`.
    pub fn form(&self) -> &'static str {
        match self {
            FittedMaterial::Dsbrdf(_) => "dsbrdf",
            FittedMaterial::Compact(_) => "compact",
        }
    }

    /// The coded material, its name and length apart.
    pub fn encode(&self) -> Vec<u8> {
        match self {
            FittedMaterial::Dsbrdf(material) => material.encode(),
            FittedMaterial::Compact(material) => material.encode(),
        }
    }

    /// The material as lobes of the half angle: itself, or lobes fitted to it, 18 slices of 3.
    /// # Errors
    /// [`Error::Parameter`] where the material's values are not finite.
    pub fn to_dsbrdf(&self) -> Result<DsbrdfMaterial> {
        match self {
            FittedMaterial::Dsbrdf(material) => Ok(material.clone()),
            FittedMaterial::Compact(material) => {
                // The form is smooth up to the centre of the highlight, which needs no care there.
                let options = super::dsbrdf::DsbrdfFitOptions { min_theta_h_deg: 0.0, ..Default::default() };
                super::dsbrdf::fit_dsbrdf(&super::BrdfSample::tabulate(material, [60, 36, 9]), &options)
            }
        }
    }
}

impl Brdf for FittedMaterial {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self {
            FittedMaterial::Dsbrdf(material) => material.evaluate(incoming, outgoing),
            FittedMaterial::Compact(material) => material.evaluate(incoming, outgoing),
        }
    }

    fn evaluate_row(&self, theta_h: f64, theta_d: f64, pairs: &[[[f64; 3]; 2]], values: &mut Vec<[f64; 3]>) {
        match self {
            FittedMaterial::Dsbrdf(material) => material.evaluate_row(theta_h, theta_d, pairs, values),
            FittedMaterial::Compact(material) => material.evaluate_row(theta_h, theta_d, pairs, values),
        }
    }
}

/// A material with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedMaterial {
    /// 1 to 255 bytes of UTF-8, different for each material of a file.
    pub name: String,
    /// The material.
    pub material: FittedMaterial,
}

/// Version of the section's layout.
const VERSION: u8 = 1;
/// Memory of a decoded material at most: 744 integers and 1280 triples of doubles; 4050 integers and twice as many doubles.
const COMPACT_MEMORY: u64 = 40_000;
const DSBRDF_MEMORY: u64 = 100_000;

/// Section `mATl` of materials.
/// # Errors
/// [`Error::Parameter`] where a name is empty, longer than 255 bytes or there twice.
pub fn encode_materials(materials: &[NamedMaterial]) -> Result<Vec<u8>> {
    let mut bytes = vec![VERSION, 0, 0, 0, 0];
    LittleEndian::write_u32(&mut bytes[1..], materials.len() as u32);
    let mut names = HashSet::new();
    for NamedMaterial { name, material } in materials {
        let length = u8::try_from(name.len()).ok().filter(|&length| length > 0);
        let Some(length) = length else {
            return Err(Error::parameter(format!("material '{name}': a name has 1 to 255 bytes")));
        };
        if !names.insert(name) {
            return Err(Error::parameter(format!("two materials are called '{name}'")));
        }
        let coded = material.encode();
        bytes.push(match material {
            FittedMaterial::Dsbrdf(_) => 0,
            FittedMaterial::Compact(_) => 1,
        });
        bytes.push(length);
        bytes.extend_from_slice(name.as_bytes());
        let long =
            u16::try_from(coded.len()).map_err(|_| Error::parameter(format!("material '{name}' is too large")))?;
        let at = bytes.len();
        bytes.extend_from_slice(&[0; 2]);
        LittleEndian::write_u16(&mut bytes[at..], long);
        bytes.extend_from_slice(&coded);
    }
    Ok(bytes)
}

/// Materials of section `mATl`.
/// # Errors
/// [`Error::Format`] where the section breaks a rule of `spec/materials.md`; [`Error::Unsupported`] for another version;
/// [`Error::Limits`] where the budget ends.
pub fn decode_materials(bytes: &[u8], budget: &Budget) -> Result<Vec<NamedMaterial>> {
    let mut reader = MaterialReader { bytes, position: 0 };
    let [version] = reader.array("version")?;
    if version != VERSION {
        return Err(Error::Unsupported(format!(
            "version {version} of section {}; this build reads {VERSION}",
            Tag::MATERIALS
        )));
    }
    let count = LittleEndian::read_u32(reader.take(4, "number of materials")?);
    let mut materials = Vec::new();
    let mut names = HashSet::new();
    // Grows with the bytes that are there: each material takes some, or ends the loop.
    for _ in 0..count {
        let at = reader.position as u64;
        let [form, length] = reader.array("form and length of a name")?;
        let name = std::str::from_utf8(reader.take(length as usize, "name")?)
            .ok()
            .filter(|name| !name.is_empty())
            .ok_or_else(|| Error::format(Tag::MATERIALS, at, "a name is 1 to 255 bytes of UTF-8"))?;
        let length = LittleEndian::read_u16(reader.take(2, "length of a material")?);
        let coded = reader.take(length as usize, "material")?;
        let memory = match form {
            0 => DSBRDF_MEMORY,
            1 => COMPACT_MEMORY,
            _ => {
                return Err(Error::Unsupported(format!("material '{name}' has form {form}; this build reads 0 and 1")));
            }
        };
        budget.charge("materials", memory + 3 * name.len() as u64 + 128)?;
        if !names.insert(name) {
            return Err(Error::format(Tag::MATERIALS, at, format!("two materials are called '{name}'")));
        }
        let material = match form {
            0 => DsbrdfMaterial::decode(coded, Tag::MATERIALS).map(FittedMaterial::Dsbrdf),
            _ => CompactMaterial::decode(coded, Tag::MATERIALS).map(FittedMaterial::Compact),
        };
        let material = material.map_err(|error| match error {
            Error::Format { message, .. } => Error::format(Tag::MATERIALS, at, format!("material '{name}': {message}")),
            other => other,
        })?;
        materials.push(NamedMaterial { name: name.to_owned(), material });
    }
    if reader.position != bytes.len() {
        return Err(Error::format(Tag::MATERIALS, reader.position as u64, "bytes follow the last material"));
    }
    Ok(materials)
}

struct MaterialReader<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> MaterialReader<'a> {
    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8]> {
        let end = self.position.saturating_add(count);
        let taken = self.bytes.get(self.position..end).ok_or_else(|| {
            Error::format(
                Tag::MATERIALS,
                self.position as u64,
                format!("the section ends within: {what}, {count} bytes"),
            )
        })?;
        self.position = end;
        Ok(taken)
    }
    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let taken = self.take(N, what)?;
        taken.try_into().map_err(|_| Error::format(Tag::MATERIALS, self.position as u64, format!("{what} is missing")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Limits;
    use crate::brdf::BrdfSample;

    struct Glossy;
    impl Brdf for Glossy {
        fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
            let angles = crate::brdf::HalfDifference::from_directions(incoming, outgoing);
            let highlight = 4.0 * (-(angles.theta_h / 0.15).powi(2)).exp() / (0.2 + incoming[2] * outgoing[2]);
            [0.2 + highlight, 0.1 + highlight, 0.03 + highlight]
        }
    }

    fn materials() -> Vec<NamedMaterial> {
        let samples = BrdfSample::tabulate(&Glossy, [45, 18, 6]);
        let lobes = super::super::dsbrdf::fit_dsbrdf(&samples, &Default::default()).unwrap();
        let mut all = vec![NamedMaterial { name: "lobes".into(), material: FittedMaterial::Dsbrdf(lobes) }];
        #[cfg(feature = "encode")]
        {
            let compact = crate::brdf::compact::fit_compact(&samples, &Default::default()).unwrap();
            all.push(NamedMaterial { name: "own form \u{8276}".into(), material: FittedMaterial::Compact(compact) });
        }
        all
    }

    #[test]
    fn materials_come_back_and_damage_is_found() {
        let all = materials();
        let bytes = encode_materials(&all).unwrap();
        let budget = || Budget::new(Limits { memory_bytes: 1 << 20, ..Limits::default() });
        assert!(decode_materials(&bytes, &budget()).unwrap() == all);
        for cut in 0..bytes.len() {
            assert!(decode_materials(&bytes[..cut], &budget()).is_err(), "cut at {cut}");
        }
        assert!(decode_materials(&[bytes.as_slice(), &[0]].concat(), &budget()).is_err());
        assert!(matches!(decode_materials(&[&[9], &bytes[1..]].concat(), &budget()), Err(Error::Unsupported(_))));
        assert!(encode_materials(&[all[0].clone(), all[0].clone()]).is_err());
        // A count that the bytes don't bear out, and a budget that doesn't suffice.
        let mut many = bytes.clone();
        many[1..5].fill(0xff);
        assert!(matches!(decode_materials(&many, &budget()), Err(Error::Format { .. })));
        let small = Budget::new(Limits { memory_bytes: 20_000, ..Limits::default() });
        assert!(matches!(decode_materials(&bytes, &small), Err(Error::Limits { .. })));
        // Whatever decodes is finite.
        for at in 5..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            for named in decode_materials(&damaged, &budget()).unwrap_or_default() {
                let value = named.material.evaluate([0.6, 0.0, 0.8], [-0.28, 0.0, 0.96]);
                assert!(value.iter().all(|v| !v.is_nan() && *v >= 0.0), "{value:?}");
            }
        }
    }

    #[cfg(feature = "encode")]
    #[test]
    fn a_compact_material_is_small_and_close_and_has_lobes() {
        let all = materials();
        let compact = &all[1].material;
        assert!(compact.encode().len() <= 256);
        for (of, most) in [(compact.clone(), 0.03), (FittedMaterial::Dsbrdf(compact.to_dsbrdf().unwrap()), 0.4)] {
            let samples = BrdfSample::tabulate(&Glossy, [20, 15, 5]);
            let error = |s: &BrdfSample| {
                let angles = crate::brdf::HalfDifference { theta_h: s.theta_h, theta_d: s.theta_d, phi_d: 1.2 };
                let (incoming, outgoing) = angles.directions();
                let (a, b) = (of.evaluate(incoming, outgoing), Glossy.evaluate(incoming, outgoing));
                if outgoing[2] > 0.05 && incoming[2] > 0.05 { (a[1].ln_1p() - b[1].ln_1p()).powi(2) } else { 0.0 }
            };
            let root_mean_square = (samples.iter().map(error).sum::<f64>() / samples.len() as f64).sqrt();
            assert!(root_mean_square < most, "{}: {root_mean_square}", of.form());
        }
    }
}
