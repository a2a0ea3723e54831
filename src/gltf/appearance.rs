//! The extension's objects: the root's array of appearances and the materials' links to them.

use super::document::GltfDocument;
use super::{EXTENSION, EXTENSION_VERSION, MIME_TYPE};
use crate::error::{Error, Result};
use crate::limits::check;
use serde_json::{Map, Value, json};

/// Appearances that a document may have.
const MAX_APPEARANCES: u64 = 1024;

/// Location of a stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StreamSource {
    /// In a bufferView.
    View(u64),
    /// In a file beside the document: its relative reference, escaped.
    Uri(String),
    /// Nowhere that is read: the entry is of another media type, this one.
    Foreign(String),
}

/// One entry of the root's array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Appearance {
    /// Location of the stream.
    pub source: StreamSource,
    /// Lengths of decodable prefixes of the stream, ascending; the last is the whole. Empty where nothing is said.
    pub levels: Vec<u64>,
    /// SHA-256 of the stream, 64 lower-case hexadecimal digits, where it is said.
    pub sha256: Option<String>,
}

impl Appearance {
    /// The JSON object.
    pub fn to_json(&self) -> Value {
        let mut object = Map::new();
        match &self.source {
            StreamSource::View(index) => object.insert("bufferView".into(), json!(index)),
            StreamSource::Uri(uri) => object.insert("uri".into(), json!(uri)),
            StreamSource::Foreign(_) => None,
        };
        let mime = if let StreamSource::Foreign(mime) = &self.source { mime } else { MIME_TYPE };
        object.insert("mimeType".into(), json!(mime));
        if !self.levels.is_empty() {
            object.insert("levels".into(), json!(self.levels));
        }
        if let Some(sha256) = &self.sha256 {
            object.insert("sha256".into(), json!(sha256));
        }
        Value::Object(object)
    }

    fn from_json(document: &GltfDocument, index: usize, value: &Value) -> Result<Self> {
        let wrong = |message: &str| document.wrong(format!("{EXTENSION}: appearance {index}: {message}"));
        let object = value.as_object().ok_or_else(|| wrong("must be an object"))?;
        let mime = object.get("mimeType").map_or(Some(MIME_TYPE), Value::as_str);
        let mime = mime.ok_or_else(|| wrong("mimeType must be a string"))?;
        if mime != MIME_TYPE {
            return Ok(Appearance { source: StreamSource::Foreign(mime.into()), levels: Vec::new(), sha256: None });
        }
        let source = match (object.get("bufferView"), object.get("uri")) {
            (Some(view), None) => {
                StreamSource::View(view.as_u64().ok_or_else(|| wrong("bufferView must be a whole number"))?)
            }
            (None, Some(uri)) => StreamSource::Uri(uri.as_str().ok_or_else(|| wrong("uri must be a string"))?.into()),
            _ => return Err(wrong("must have either a bufferView or a uri")),
        };
        let levels = match object.get("levels") {
            None => Vec::new(),
            Some(levels) => {
                let numbers =
                    levels.as_array().map(|levels| levels.iter().map_while(Value::as_u64).collect::<Vec<_>>());
                let complete = |numbers: &Vec<u64>| levels.as_array().is_some_and(|l| l.len() == numbers.len());
                let ascending = |numbers: &Vec<u64>| numbers.windows(2).all(|pair| pair[0] < pair[1]);
                numbers
                    .filter(|n| complete(n) && ascending(n))
                    .ok_or_else(|| wrong("levels must be ascending lengths"))?
            }
        };
        let sha256 = match object.get("sha256") {
            None => None,
            Some(digits) => {
                let digits = digits.as_str().filter(|d| d.len() == 64 && d.bytes().all(|b| b.is_ascii_hexdigit()));
                Some(digits.ok_or_else(|| wrong("sha256 must be 64 hexadecimal digits"))?.to_ascii_lowercase())
            }
        };
        Ok(Appearance { source, levels, sha256 })
    }
}

/// The extension's object of the root or of a material; `None` where it has none.
pub(super) fn extension(of: &Map<String, Value>) -> Option<&Map<String, Value>> {
    of.get("extensions")?.get(EXTENSION)?.as_object()
}

/// All appearances of a document; empty where it has none. An extension of a later version is `Unsupported`.
pub fn appearances(document: &GltfDocument) -> Result<Vec<Appearance>> {
    let Some(root) = extension(&document.json) else { return Ok(Vec::new()) };
    match root.get("version").map(Value::as_u64) {
        None | Some(Some(EXTENSION_VERSION)) => {}
        Some(Some(version)) => {
            let (name, known) = (document.name(), EXTENSION_VERSION);
            let message = format!("{name}: {EXTENSION} of version {version}, this build reads {known}");
            return Err(Error::Unsupported(message));
        }
        Some(None) => return Err(document.wrong(format!("{EXTENSION}: version must be a whole number"))),
    }
    let list = root.get("appearances").and_then(Value::as_array);
    let list = list.ok_or_else(|| document.wrong(format!("{EXTENSION}: appearances must be an array")))?;
    check("appearances", list.len() as u64, MAX_APPEARANCES)?;
    list.iter().enumerate().map(|(index, value)| Appearance::from_json(document, index, value)).collect()
}

/// Materials bound to an appearance, by index.
pub fn bound_materials(document: &GltfDocument, appearance: usize) -> Vec<usize> {
    let linked = |material: &Value| {
        material.as_object().and_then(extension).and_then(|link| link.get("appearance")?.as_u64())
            == Some(appearance as u64)
    };
    (0..document.list("materials").len()).filter(|&index| linked(&document.list("materials")[index])).collect()
}
