//! Materials by name, fitted or modelled, and section `mATl` that holds them.

use super::Brdf;
use super::compact::CompactMaterial;
use super::dsbrdf::DsbrdfMaterial;
use super::models::{ClassicalModel, Microfacets};
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::limits::Budget;
use byteorder::{ByteOrder, LittleEndian};
use std::collections::HashSet;

/// A material that a file holds: a few hundred bytes describe it.
#[derive(Debug, Clone, PartialEq)]
pub enum FittedMaterial {
    /// Lobes of the half angle (DSBRDF).
    Dsbrdf(DsbrdfMaterial),
    /// The project's own form.
    Compact(CompactMaterial),
    /// A classical model, fitted or given.
    Classical(ClassicalModel),
    /// glTF's metallic-roughness model.
    MetallicRoughness(Microfacets),
}

impl FittedMaterial {
    /// Name of the form: `dsbrdf`, `compact`, that of a classical model, or `metallic-roughness`.
    pub fn form(&self) -> &'static str {
        match self {
            FittedMaterial::Dsbrdf(_) => "dsbrdf",
            FittedMaterial::Compact(_) => "compact",
            FittedMaterial::Classical(model) => model.lobe.name(),
            FittedMaterial::MetallicRoughness(_) => "metallic-roughness",
        }
    }

    /// Number of the form in a file.
    fn code(&self) -> u8 {
        match self {
            FittedMaterial::Dsbrdf(_) => 0,
            FittedMaterial::Compact(_) => 1,
            FittedMaterial::Classical(_) => CLASSICAL,
            FittedMaterial::MetallicRoughness(_) => METALLIC_ROUGHNESS,
        }
    }

    /// The coded material, its name and length apart.
    pub fn encode(&self) -> Vec<u8> {
        match self {
            FittedMaterial::Dsbrdf(material) => material.encode(),
            FittedMaterial::Compact(material) => material.encode(),
            FittedMaterial::Classical(model) => model.encode(),
            FittedMaterial::MetallicRoughness(model) => model.encode(),
        }
    }

    /// The material as lobes of the half angle: itself, or lobes fitted to it, 18 slices of 3.
    /// # Errors
    /// [`Error::Parameter`] where the material's values are not finite.
    pub fn to_dsbrdf(&self) -> Result<DsbrdfMaterial> {
        match self {
            FittedMaterial::Dsbrdf(material) => Ok(material.clone()),
            _ => {
                // All forms are smooth up to the centre of the highlight, which needs no care there.
                let options = super::dsbrdf::DsbrdfFitOptions { min_theta_h_deg: 0.0, ..Default::default() };
                super::dsbrdf::fit_dsbrdf(&super::BrdfSample::tabulate(self, [60, 36, 9]), &options)
            }
        }
    }
}

impl Brdf for FittedMaterial {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self {
            FittedMaterial::Dsbrdf(material) => material.evaluate(incoming, outgoing),
            FittedMaterial::Compact(material) => material.evaluate(incoming, outgoing),
            FittedMaterial::Classical(model) => model.evaluate(incoming, outgoing),
            FittedMaterial::MetallicRoughness(model) => model.evaluate(incoming, outgoing),
        }
    }

    fn evaluate_row(&self, theta_h: f64, theta_d: f64, pairs: &[[[f64; 3]; 2]], values: &mut Vec<[f64; 3]>) {
        match self {
            FittedMaterial::Dsbrdf(material) => material.evaluate_row(theta_h, theta_d, pairs, values),
            FittedMaterial::Compact(material) => material.evaluate_row(theta_h, theta_d, pairs, values),
            FittedMaterial::Classical(model) => model.evaluate_row(theta_h, theta_d, pairs, values),
            FittedMaterial::MetallicRoughness(model) => model.evaluate_row(theta_h, theta_d, pairs, values),
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

/// Versions of the section's layout: the second has the forms from [`CLASSICAL`] on.
const VERSIONS: std::ops::RangeInclusive<u8> = 1..=2;
/// Numbers of forms.
const CLASSICAL: u8 = 2;
const METALLIC_ROUGHNESS: u8 = 3;
/// Memory of a decoded material at most: 744 integers and 1280 triples of doubles; 4050 integers and twice as many doubles.
const COMPACT_MEMORY: u64 = 40_000;
const DSBRDF_MEMORY: u64 = 100_000;
const MODEL_MEMORY: u64 = 1024;

/// Section `mATl` of materials.
/// # Errors
/// [`Error::Parameter`] where a name is empty, longer than 255 bytes or there twice, or a parameter is out of its range.
pub fn encode_materials(materials: &[NamedMaterial]) -> Result<Vec<u8>> {
    // What the first version can hold is written as such.
    let has_models = materials.iter().any(|named| named.material.code() >= CLASSICAL);
    let mut bytes = vec![if has_models { *VERSIONS.end() } else { *VERSIONS.start() }, 0, 0, 0, 0];
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
        let checked = match material {
            FittedMaterial::Classical(model) => model.check(),
            FittedMaterial::MetallicRoughness(model) => model.check(),
            FittedMaterial::Dsbrdf(_) | FittedMaterial::Compact(_) => Ok(()),
        };
        checked.map_err(|error| Error::parameter(format!("material '{name}': {error}")))?;
        let coded = material.encode();
        bytes.push(material.code());
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
    if !VERSIONS.contains(&version) {
        return Err(Error::Unsupported(format!(
            "version {version} of section {}; this build reads {} and {}",
            Tag::MATERIALS,
            VERSIONS.start(),
            VERSIONS.end()
        )));
    }
    let last_form = if version == *VERSIONS.start() { CLASSICAL - 1 } else { METALLIC_ROUGHNESS };
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
            _ if form <= last_form => MODEL_MEMORY,
            _ => {
                let message = format!("material '{name}' has form {form}; version {version} has 0 to {last_form}");
                return Err(Error::Unsupported(message));
            }
        };
        budget.charge("materials", memory + 3 * name.len() as u64 + 128)?;
        if !names.insert(name) {
            return Err(Error::format(Tag::MATERIALS, at, format!("two materials are called '{name}'")));
        }
        let material = match form {
            0 => DsbrdfMaterial::decode(coded, Tag::MATERIALS).map(FittedMaterial::Dsbrdf),
            1 => CompactMaterial::decode(coded, Tag::MATERIALS).map(FittedMaterial::Compact),
            CLASSICAL => ClassicalModel::decode(coded, Tag::MATERIALS).map(FittedMaterial::Classical),
            _ => Microfacets::decode(coded, Tag::MATERIALS).map(FittedMaterial::MetallicRoughness),
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
    use crate::brdf::{BrdfSample, ClassicalLobe, ShiftedGamma};

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
        all.push(NamedMaterial { name: "ward".into(), material: models().swap_remove(5) });
        all
    }

    /// Every model with parameters of its own.
    fn models() -> Vec<FittedMaterial> {
        let three = |x: f64| [x, 0.5 * x, 1.0 / 3.0];
        let shape = ShiftedGamma {
            alpha: three(0.1),
            p: three(0.7),
            f0: three(0.2),
            f1: three(0.01),
            normalisation: three(0.9),
            lambda: three(2.0),
            c: three(1.0),
            k: three(1.5),
            theta0: three(-0.2),
        };
        let lobes = [
            ClassicalLobe::Lambert,
            ClassicalLobe::BlinnPhong { exponent: 80.1 },
            ClassicalLobe::CookTorranceBeckmann { roughness: 0.2, reflectance: 0.1 },
            ClassicalLobe::CookTorranceGgx { roughness: 0.21, reflectance: 0.11 },
            ClassicalLobe::Ward { roughness: 0.2 },
            ClassicalLobe::WardAnisotropic { roughness: [0.2, 0.3] },
            ClassicalLobe::AshikhminShirley { exponents: [80.0, 40.0], reflectance: 0.1 },
            ClassicalLobe::Lafortune { xy: -1.0, z: 0.95, exponent: 20.0 },
            ClassicalLobe::TorranceSparrow { sigma: 0.15 },
            ClassicalLobe::ShiftedGamma(Box::new(shape)),
        ];
        let classical = |lobe: ClassicalLobe| {
            let specular = if lobe == ClassicalLobe::Lambert { [0.0; 3] } else { [0.4, 0.5, 0.6] };
            FittedMaterial::Classical(ClassicalModel { diffuse: [0.1, 0.2, 0.3], specular, lobe })
        };
        let gold = Microfacets {
            base_colour: [1.0, 0.7, 0.3],
            metallic: 1.0,
            roughness: 0.3,
            specular_colour: [1.0, 0.9, 2.0],
        };
        lobes.into_iter().map(classical).chain([FittedMaterial::MetallicRoughness(gold)]).collect()
    }

    #[test]
    fn every_model_comes_back_and_its_parameters_are_checked() {
        let budget = || Budget::new(Limits::default());
        for material in models() {
            let named = NamedMaterial { name: "one".into(), material: material.clone() };
            let bytes = encode_materials(std::slice::from_ref(&named)).unwrap();
            assert_eq!(bytes[0], 2);
            assert_eq!(
                decode_materials(&bytes, &budget()).unwrap(),
                std::slice::from_ref(&named),
                "{}",
                material.form()
            );
            let (incoming, outgoing) = ([0.6, 0.0, 0.8], [-0.28, 0.0, 0.96]);
            assert!(material.evaluate(incoming, outgoing).iter().all(|v| *v > 0.0), "{}", material.form());
            // A number that is none, a number too few or too many, the form in a section of the first version.
            let mut wrong = bytes.clone();
            let last = wrong.len() - 8;
            wrong[last..].copy_from_slice(&f64::NAN.to_le_bytes());
            assert!(matches!(decode_materials(&wrong, &budget()), Err(Error::Format { .. })), "{}", material.form());
            for coded in [&material.encode()[..material.encode().len() - 8], &[material.encode(), vec![0; 8]].concat()]
            {
                let decoded = match &material {
                    FittedMaterial::Classical(_) => ClassicalModel::decode(coded, Tag::MATERIALS).map(drop),
                    _ => Microfacets::decode(coded, Tag::MATERIALS).map(drop),
                };
                assert!(matches!(decoded, Err(Error::Format { .. })), "{}", material.form());
            }
            let first = [&[1], &bytes[1..]].concat();
            assert!(matches!(decode_materials(&first, &budget()), Err(Error::Unsupported(_))));
        }
        let wide = ClassicalLobe::Ward { roughness: f64::INFINITY };
        let material = FittedMaterial::Classical(ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe: wide });
        assert!(encode_materials(&[NamedMaterial { name: "wide".into(), material }]).is_err());
        assert!(matches!(ClassicalModel::decode(&[10], Tag::MATERIALS), Err(Error::Unsupported(_))));
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
