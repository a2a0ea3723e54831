//! Materials out of files of any kind.

use crate::source;
use anyhow::Result;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use tsuya::brdf::{Brdf, ClassicalModel, FittedBrdf, FittedMaterial, MerlTable, RglMaterial};
use tsuya::decoder::ViewSelection;
use tsuya::{Error, Result as TsuyaResult};

/// A material as a file has it.
pub enum Material {
    Merl(MerlTable),
    Rgl(Box<RglMaterial>),
    Fitted(FittedBrdf),
}

/// A material with its name.
pub struct Named {
    pub name: String,
    pub material: Material,
}

/// A file of fitted classical models.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// File format, [`MODEL_FORMAT`].
    pub format: String,
    pub materials: Vec<ModelEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelEntry {
    pub name: String,
    pub model: ClassicalModel,
}

pub const MODEL_FORMAT: &str = "tsuya-brdf-models-1";
/// A model has some 300 bytes.
const MAX_MODEL_BYTES: u64 = 16 << 20;

impl Material {
    /// The material as a table: itself, or sampled at every cell.
    pub fn into_table(self) -> MerlTable {
        match self {
            Material::Merl(table) => table,
            Material::Rgl(material) => MerlTable::tabulate(&material.reciprocal()),
            other => MerlTable::tabulate(&other),
        }
    }

    /// The material between its samples, where it has samples.
    pub fn interpolated(&self) -> InterpolatedMaterial<'_> {
        InterpolatedMaterial(self)
    }
}

impl Brdf for Material {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self {
            Material::Merl(table) => table.evaluate(incoming, outgoing),
            Material::Rgl(material) => material.evaluate(incoming, outgoing),
            Material::Fitted(fitted) => fitted.evaluate(incoming, outgoing),
        }
    }
}

/// See [`Material::interpolated`].
pub struct InterpolatedMaterial<'a>(&'a Material);

impl Brdf for InterpolatedMaterial<'_> {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self.0 {
            Material::Merl(table) => table.interpolated().evaluate(incoming, outgoing),
            other => other.evaluate(incoming, outgoing),
        }
    }
}

/// The kinds of files, by the end of the name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Merl,
    Rgl,
    Models,
    Tsuya,
    /// Measured values as text.
    Measured,
}

/// Ends of the names of measured values as text.
const MEASURED: [&str; 4] = ["csv", "tsv", "txt", "dat"];

impl Kind {
    pub fn of(path: &Path) -> TsuyaResult<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "binary" => Ok(Kind::Merl),
            "bsdf" => Ok(Kind::Rgl),
            "json" => Ok(Kind::Models),
            "tsuya" => Ok(Kind::Tsuya),
            text if MEASURED.contains(&text) => Ok(Kind::Measured),
            _ => {
                let message = "a material's name ends with .binary (MERL), .bsdf (RGL), .tsuya or .json (fitted); that of measured values \
                               with .csv";
                Err(Error::parameter(format!("{}: {message}", path.display())))
            }
        }
    }
}

/// Every material of a file.
pub fn read_all(path: &Path) -> Result<Vec<Named>> {
    let named = |material| vec![Named { name: name_of(path), material }];
    Ok(match Kind::of(path)? {
        Kind::Merl => named(Material::Merl(MerlTable::read(path, &source::access())?)),
        Kind::Rgl => named(Material::Rgl(Box::new(RglMaterial::read(path, &source::access())?))),
        Kind::Models => read_models(path)?,
        Kind::Tsuya => read_tsuya(path)?,
        Kind::Measured => {
            let message = "measured values are no material yet; tsuya brdf fit makes one of them";
            return Err(Error::parameter(format!("{}: {message}", path.display())).into());
        }
    })
}

/// One material of a file: the only one, or that of a name.
pub fn read_one(path: &Path, wanted: Option<&str>) -> Result<Named> {
    let mut all = read_all(path)?;
    let names = || all.iter().map(|named| named.name.as_str()).collect::<Vec<_>>().join(", ");
    let at = match wanted {
        Some(wanted) => all.iter().position(|named| named.name == wanted),
        None if all.len() == 1 => Some(0),
        None => {
            let message = format!("{} materials: {}; --material chooses one", all.len(), names());
            return Err(Error::parameter(format!("{}: {message}", path.display())).into());
        }
    };
    match at {
        Some(at) => Ok(all.swap_remove(at)),
        None => {
            let message = format!("no material called '{}'; there are {}", wanted.unwrap_or_default(), names());
            Err(Error::parameter(format!("{}: {message}", path.display())).into())
        }
    }
}

fn read_tsuya(path: &Path) -> Result<Vec<Named>> {
    let (asset, _) = source::decode(path, ViewSelection::None)?;
    if asset.materials.is_empty() {
        return Err(Error::input(path, "the file has no material (section mATl)").into());
    }
    let fitted = |material| match material {
        FittedMaterial::Classical(model) => FittedBrdf::Classical(model),
        other => FittedBrdf::Coded(other),
    };
    let named = asset.materials.into_iter();
    Ok(named.map(|m| Named { name: m.name, material: Material::Fitted(fitted(m.material)) }).collect())
}

fn read_models(path: &Path) -> Result<Vec<Named>> {
    let bytes = source::read_at_most(path, "file of models", MAX_MODEL_BYTES)?;
    let wrong = |what: String| Error::input(path, format!("not a file of fitted models: {what}"));
    let file: ModelFile = serde_json::from_slice(&bytes).map_err(|e| wrong(e.to_string()))?;
    if file.format != MODEL_FORMAT {
        return Err(wrong(format!("its format is '{}', '{MODEL_FORMAT}' expected", file.format)).into());
    }
    let mut found = Vec::new();
    for entry in file.materials {
        entry.model.check().map_err(|e| wrong(format!("material {}: {e}", entry.name)))?;
        found.push(Named { name: entry.name, material: Material::Fitted(FittedBrdf::Classical(entry.model)) });
    }
    Ok(found)
}

/// Files, and the materials in folders: `.binary` and `.bsdf`, sorted.
pub fn expand(inputs: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for input in inputs {
        if !input.is_dir() {
            Kind::of(input)?;
            files.push(input.clone());
            continue;
        }
        let failed = |e| Error::io(input, e);
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(input).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if matches!(Kind::of(&path), Ok(Kind::Merl | Kind::Rgl)) {
                inside.push(path);
            }
        }
        if inside.is_empty() {
            return Err(Error::input(input, "the folder has no .binary and no .bsdf file").into());
        }
        inside.sort();
        files.extend(inside);
    }
    Ok(files)
}

/// A material's name: that of its file.
pub fn name_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
