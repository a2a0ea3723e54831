//! Models whose parameters a file holds as they are: forms `classical` and `metallic-roughness` of section `mATl`.

use super::{ClassicalLobe, ClassicalModel, Microfacets, ShiftedGamma};
use crate::container::Tag;
use crate::{Error, Result};
use byteorder::{ByteOrder, LittleEndian};

/// Bytes of a number.
const NUMBER: usize = size_of::<f64>();

fn numbers_to_bytes(numbers: impl IntoIterator<Item = f64>, bytes: &mut Vec<u8>) {
    for number in numbers {
        let start = bytes.len();
        bytes.resize(start + NUMBER, 0);
        LittleEndian::write_f64(&mut bytes[start..], number);
    }
}

/// As many numbers as there are bytes for.
/// # Errors
/// [`Error::Format`] where bytes are left over.
fn numbers_of(bytes: &[u8], tag: Tag) -> Result<Vec<f64>> {
    if !bytes.len().is_multiple_of(NUMBER) {
        return Err(Error::format(tag, 0u8, "a parameter has 8 bytes"));
    }
    Ok(bytes.chunks_exact(NUMBER).map(LittleEndian::read_f64).collect())
}

fn out_of_range(error: Error, tag: Tag) -> Error {
    Error::format(tag, 0u8, error.to_string())
}

impl ClassicalLobe {
    /// Number of the model in a file.
    fn code(&self) -> u8 {
        match self {
            ClassicalLobe::Lambert => 0,
            ClassicalLobe::BlinnPhong { .. } => 1,
            ClassicalLobe::CookTorranceBeckmann { .. } => 2,
            ClassicalLobe::CookTorranceGgx { .. } => 3,
            ClassicalLobe::Ward { .. } => 4,
            ClassicalLobe::WardAnisotropic { .. } => 5,
            ClassicalLobe::AshikhminShirley { .. } => 6,
            ClassicalLobe::Lafortune { .. } => 7,
            ClassicalLobe::TorranceSparrow { .. } => 8,
            ClassicalLobe::ShiftedGamma(_) => 9,
        }
    }

    /// The parameters in a file's order.
    fn parameters(&self) -> Vec<f64> {
        match self {
            ClassicalLobe::Lambert => vec![],
            ClassicalLobe::BlinnPhong { exponent } => vec![*exponent],
            ClassicalLobe::CookTorranceBeckmann { roughness, reflectance }
            | ClassicalLobe::CookTorranceGgx { roughness, reflectance } => vec![*roughness, *reflectance],
            ClassicalLobe::Ward { roughness } => vec![*roughness],
            ClassicalLobe::WardAnisotropic { roughness } => roughness.to_vec(),
            ClassicalLobe::AshikhminShirley { exponents: [n, m], reflectance } => vec![*n, *m, *reflectance],
            ClassicalLobe::Lafortune { xy, z, exponent } => vec![*xy, *z, *exponent],
            ClassicalLobe::TorranceSparrow { sigma } => vec![*sigma],
            ClassicalLobe::ShiftedGamma(shape) => shape.lists().into_iter().flatten().copied().collect(),
        }
    }

    /// The model of a number with its parameters; `None` if there are not as many as it takes.
    fn from_parameters(code: u8, parameters: &[f64]) -> Option<Self> {
        Some(match (code, parameters) {
            (0, []) => ClassicalLobe::Lambert,
            (1, &[exponent]) => ClassicalLobe::BlinnPhong { exponent },
            (2, &[roughness, reflectance]) => ClassicalLobe::CookTorranceBeckmann { roughness, reflectance },
            (3, &[roughness, reflectance]) => ClassicalLobe::CookTorranceGgx { roughness, reflectance },
            (4, &[roughness]) => ClassicalLobe::Ward { roughness },
            (5, &[u, v]) => ClassicalLobe::WardAnisotropic { roughness: [u, v] },
            (6, &[n, m, reflectance]) => ClassicalLobe::AshikhminShirley { exponents: [n, m], reflectance },
            (7, &[xy, z, exponent]) => ClassicalLobe::Lafortune { xy, z, exponent },
            (8, &[sigma]) => ClassicalLobe::TorranceSparrow { sigma },
            (9, lists) => ClassicalLobe::ShiftedGamma(Box::new(shifted_gamma(lists)?)),
            _ => return None,
        })
    }
}

fn shifted_gamma(numbers: &[f64]) -> Option<ShiftedGamma> {
    let lists: Vec<[f64; 3]> = numbers.chunks_exact(3).filter_map(|list| list.try_into().ok()).collect();
    let &[alpha, p, f0, f1, normalisation, lambda, c, k, theta0] = lists.as_slice() else { return None };
    (numbers.len() == 27).then_some(ShiftedGamma { alpha, p, f0, f1, normalisation, lambda, c, k, theta0 })
}

impl ClassicalModel {
    /// The model as a file has it, its name and length apart.
    pub(in crate::brdf) fn encode(&self) -> Vec<u8> {
        let mut bytes = vec![self.lobe.code()];
        numbers_to_bytes(self.diffuse, &mut bytes);
        if self.lobe != ClassicalLobe::Lambert {
            numbers_to_bytes(self.specular, &mut bytes);
        }
        numbers_to_bytes(self.lobe.parameters(), &mut bytes);
        bytes
    }

    /// Reads what [`Self::encode`] wrote.
    /// # Errors
    /// [`Error::Format`] for other bytes and parameters out of range, [`Error::Unsupported`] for an unknown model.
    pub(in crate::brdf) fn decode(bytes: &[u8], tag: Tag) -> Result<Self> {
        let Some((&code, bytes)) = bytes.split_first() else {
            return Err(Error::format(tag, 0u8, "a classical model has at least one byte"));
        };
        if code > 9 {
            return Err(Error::Unsupported(format!(
                "classical model {code} of section {tag}; this build reads 0 to 9"
            )));
        }
        let numbers = numbers_of(bytes, tag)?;
        let count = || Error::format(tag, 0u8, format!("classical model {code} has not {} numbers", numbers.len()));
        let colour = |at: usize| {
            let three = numbers.get(at..at + 3).and_then(|three| three.try_into().ok());
            three.ok_or_else(count)
        };
        let has_lobe = code != 0;
        let (diffuse, specular) = (colour(0)?, if has_lobe { colour(3)? } else { [0.0; 3] });
        let parameters = &numbers[if has_lobe { 6 } else { 3 }..];
        let lobe = ClassicalLobe::from_parameters(code, parameters).ok_or_else(count)?;
        let model = ClassicalModel { diffuse, specular, lobe };
        model.check().map_err(|error| out_of_range(error, tag))?;
        Ok(model)
    }
}

impl Microfacets {
    /// The model as a file has it, its name and length apart.
    pub(in crate::brdf) fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let Microfacets { base_colour, metallic, roughness, specular_colour } = *self;
        numbers_to_bytes(base_colour.into_iter().chain([metallic, roughness]).chain(specular_colour), &mut bytes);
        bytes
    }

    /// Reads what [`Self::encode`] wrote.
    /// # Errors
    /// [`Error::Format`] for other bytes and parameters out of range.
    pub(in crate::brdf) fn decode(bytes: &[u8], tag: Tag) -> Result<Self> {
        let &[r, g, b, metallic, roughness, sr, sg, sb] = numbers_of(bytes, tag)?.as_slice() else {
            return Err(Error::format(tag, 0u8, "a metallic-roughness material has 8 numbers"));
        };
        let material = Microfacets { base_colour: [r, g, b], metallic, roughness, specular_colour: [sr, sg, sb] };
        material.check().map_err(|error| out_of_range(error, tag))?;
        Ok(material)
    }
}
