//! Fitted materials put into a file that has an object.

use crate::source::{self, limits};
use anyhow::{Context, Result};
use std::path::Path;
use tsuya::Error;
use tsuya::brdf::{FittedBrdf, FittedMaterial, NamedMaterial, decode_materials, encode_materials};
use tsuya::container::{self, Container, SectionCodec, Tag};

/// A fitted material as a .tsuya file holds it.
pub fn held(fitted: FittedBrdf) -> FittedMaterial {
    match fitted {
        FittedBrdf::Coded(material) => material,
        FittedBrdf::Classical(model) => FittedMaterial::Classical(model),
    }
}

/// The file with fitted materials beside those that it has, or in place of those of the same names. `name` is that of a single one.
pub fn put(asset: &Path, all: Vec<(String, FittedBrdf)>, name: Option<&str>) -> Result<Vec<u8>> {
    if name.is_some() && all.len() != 1 {
        let message = format!("--name is for one material, {} were fitted", all.len());
        return Err(Error::parameter(message).into());
    }
    let old = source::read(asset)?;
    let mut file = Container::open_slice(&old, limits()).with_context(|| source::name(asset))?;
    let mut materials = match file.read_optional(Tag::MATERIALS).with_context(|| source::name(asset))? {
        Some(section) => decode_materials(&section, &file.budget()).with_context(|| source::name(asset))?,
        None => Vec::new(),
    };
    for (own, fitted) in all {
        let (name, material) = (name.map_or(own, str::to_owned), held(fitted));
        match materials.iter_mut().find(|named| named.name == name) {
            Some(named) => named.material = material,
            None => materials.push(NamedMaterial { name, material }),
        }
    }
    let section = (Tag::MATERIALS, SectionCodec::Own, encode_materials(&materials)?);
    Ok(container::with_sections(&old, &[section], limits())?)
}
