//! Metadata: a JSON object in UTF-8. Known keys have accessors here, all others are kept as they are.

use super::Tag;
use crate::limits::Budget;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Most bytes of memory for one byte of JSON: `0,` makes a whole value.
const MEMORY_PER_BYTE: u64 = 128;

/// The object's keys.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Metadata(pub Map<String, Value>);

/// Errors that the encoder measured after decoding its own file, in dB. Image PSNR as in the specification.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct AchievedError {
    /// Diffuse images.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffuse_psnr_db: Option<f64>,
    /// Specular images.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub specular_psnr_db: Option<f64>,
    /// Their sum, or the only component.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sum_psnr_db: Option<f64>,
    /// Largest error of the sum's signal `sqrt(x / white)`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest: Option<f64>,
}

/// Metres for one unit of world length, after the metadata's key `units`; 1 for units that are not metric or not known.
pub fn metres_per_unit(metadata: &Map<String, Value>) -> f64 {
    match metadata.get("units").and_then(Value::as_str) {
        Some("mm") => 0.001,
        Some("cm") => 0.01,
        _ => 1.0,
    }
}

macro_rules! text_keys {
    ($($get:ident $set:ident $key:literal $doc:literal;)*) => {
        $(
            #[doc = $doc]
            pub fn $get(&self) -> Option<&str> {
                self.0.get($key).and_then(Value::as_str)
            }
            #[doc = concat!("Sets the key `", $key, "`.")]
            pub fn $set(&mut self, value: impl Into<String>) {
                self.0.insert($key.into(), Value::String(value.into()));
            }
        )*
    };
}

impl Metadata {
    text_keys! {
        title set_title "title" "Name of the object.";
        units set_units "units" "Unit of world lengths: `m`, `cm`, `mm`, or another word.";
        color_space set_color_space "color_space" "Primaries of all colours; `linear-rec709` where nothing is said.";
        provenance set_provenance "provenance" "Where the measurement comes from.";
        licence set_licence "licence" "Terms of use.";
        generator set_generator "generator" "Program and version that wrote the file.";
        profile set_profile "profile" "Profile of the encoder.";
    }

    /// The achieved error, where the encoder wrote it down.
    pub fn achieved_error(&self) -> Option<AchievedError> {
        serde_json::from_value(self.0.get("achieved_error")?.clone()).ok()
    }
    /// Views of a repaired file whose photographs are lost: numbers, in key `repaired`.
    pub fn lost_views(&self) -> Vec<usize> {
        lost_views(&self.0)
    }
    /// Sets the key `achieved_error`.
    pub fn set_achieved_error(&mut self, error: AchievedError) {
        if let Ok(value) = serde_json::to_value(error) {
            self.0.insert("achieved_error".into(), value);
        }
    }
}

/// Views of a repaired file whose photographs are lost: numbers, in key `repaired` of the object.
pub(crate) fn lost_views(metadata: &Map<String, Value>) -> Vec<usize> {
    let numbers = metadata.get("repaired").and_then(|repaired| repaired.get("lost_views")?.as_array());
    numbers.into_iter().flatten().filter_map(|number| usize::try_from(number.as_u64()?).ok()).collect()
}

/// The section's content.
#[cfg(feature = "encode")]
pub fn encode(metadata: &Metadata) -> Result<Vec<u8>> {
    serde_json::to_vec(&metadata.0).map_err(|error| Error::parameter(format!("metadata: {error}")))
}

/// The object in the section.
pub fn decode(content: &[u8], budget: &Budget) -> Result<Metadata> {
    budget.charge_items("metadata", content.len() as u64, MEMORY_PER_BYTE as usize)?;
    let map = serde_json::from_slice(content).map_err(|error| {
        Error::format(Tag::METADATA, error.column() as u64, format!("must be one JSON object in UTF-8: {error}"))
    })?;
    Ok(Metadata(map))
}
