//! GLB and glTF files as JSON and bytes. Nothing is lost by reading and writing: unknown members and chunks stay.

use crate::container::push_u32;
use crate::error::{Error, Result};
use crate::input::percent_decoded;
use crate::limits::Budget;
use byteorder::{ByteOrder, LittleEndian};
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

const MAGIC: [u8; 4] = *b"glTF";
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;
/// Memory that a byte of JSON may take at most: `0,` makes a whole value.
const MEMORY_PER_BYTE: usize = 128;

/// A glTF document, with its binary chunk where it is a GLB.
#[derive(Debug, Clone, PartialEq)]
pub struct GltfDocument {
    /// The JSON object.
    pub json: Map<String, Value>,
    /// The binary chunk of a GLB: buffer 0. `None` for a document that is JSON alone, and a GLB without one.
    pub binary: Option<Vec<u8>>,
    /// Chunks after these, type and content, kept as they are.
    others: Vec<(u32, Vec<u8>)>,
    is_glb: bool,
    allow_outside: bool,
    /// Name of the file in errors.
    path: PathBuf,
}

/// Reader of the files that a document's relative references name.
pub type ExternalFiles<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>>;

impl GltfDocument {
    /// A GLB around a JSON object and the content of its buffer 0.
    pub fn new_glb(json: Map<String, Value>, binary: Vec<u8>) -> Self {
        GltfDocument {
            json,
            binary: Some(binary),
            others: Vec::new(),
            is_glb: true,
            allow_outside: false,
            path: PathBuf::from("-"),
        }
    }

    /// Reads a GLB (version 2) or the JSON of a glTF file; `path` is only named in errors.
    pub fn parse(path: impl AsRef<Path>, bytes: &[u8], budget: &Budget) -> Result<Self> {
        let path = path.as_ref();
        let path_of = path.to_owned();
        let mut document = GltfDocument {
            is_glb: false,
            path: path_of,
            binary: None,
            ..GltfDocument::new_glb(Map::new(), Vec::new())
        };
        let text = if bytes.starts_with(&MAGIC) {
            document.is_glb = true;
            budget.charge("GLB file", bytes.len() as u64)?;
            document.chunks(bytes)?
        } else if bytes.trim_ascii_start().starts_with(b"{") {
            bytes
        } else {
            return Err(document.wrong("neither a GLB file (it would begin with 'glTF') nor glTF JSON"));
        };
        budget.charge_items("glTF JSON", text.len() as u64, MEMORY_PER_BYTE)?;
        document.json = serde_json::from_slice(text).map_err(|e| document.wrong(format!("glTF JSON: {e}")))?;
        let version = document.json.get("asset").and_then(|asset| asset.get("version")).and_then(Value::as_str);
        match version {
            Some(version) if version.starts_with("2.") => Ok(document),
            Some(version) => {
                Err(Error::Unsupported(format!("{}: glTF version {version}, 2.x is read", path.display())))
            }
            None => Err(document.wrong("not a glTF document: it has no asset.version")),
        }
    }

    /// Splits a GLB; returns the JSON's text.
    fn chunks<'b>(&mut self, bytes: &'b [u8]) -> Result<&'b [u8]> {
        let number = |at: usize| bytes.get(at..at + 4).map(LittleEndian::read_u32);
        let (Some(version), Some(length)) = (number(4), number(8)) else {
            return Err(self.wrong("cut within the first 12 bytes of the GLB"));
        };
        if version != 2 {
            return Err(Error::Unsupported(format!("{}: GLB version {version}, 2 is read", self.path.display())));
        }
        if length as usize != bytes.len() {
            let message = format!("the GLB says that it has {length} bytes, it has {}: cut or extended", bytes.len());
            return Err(self.wrong(message));
        }
        let mut text = None;
        let mut at = 12;
        while at < bytes.len() {
            let (Some(length), Some(kind)) = (number(at), number(at + 4)) else {
                return Err(self.wrong(format!("byte {at}: cut within a chunk's head")));
            };
            let Some(content) = bytes[at + 8..].get(..length as usize) else {
                return Err(self.wrong(format!("byte {at}: a chunk of {length} bytes goes beyond the end of the file")));
            };
            match (kind, text) {
                (JSON_CHUNK, None) => text = Some(content),
                (_, None) => return Err(self.wrong("the GLB's first chunk must be JSON")),
                (BINARY_CHUNK, Some(_)) if self.binary.is_none() && self.others.is_empty() => {
                    self.binary = Some(content.to_vec());
                }
                (JSON_CHUNK | BINARY_CHUNK, Some(_)) => {
                    return Err(
                        self.wrong(format!("byte {at}: a second chunk of JSON or binary data, or not in order"))
                    );
                }
                _ => self.others.push((kind, content.to_vec())),
            }
            at += 8 + length as usize;
        }
        text.ok_or_else(|| self.wrong("the GLB has no JSON chunk"))
    }

    /// Returns the file's bytes: GLB or JSON, as it was read.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a GLB beyond 4 GiB.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let unwritable = |e| Error::parameter(format!("glTF JSON: {e}"));
        if !self.is_glb {
            return serde_json::to_vec_pretty(&self.json).map_err(unwritable);
        }
        let mut text = serde_json::to_vec(&self.json).map_err(unwritable)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bytes = Vec::new();
        bytes.extend(MAGIC);
        push_u32(&mut bytes, 2);
        bytes.extend([0; 4]);
        let mut chunk = |kind: u32, content: &[u8]| {
            let padded = content.len().next_multiple_of(4);
            push_u32(&mut bytes, padded as u32);
            push_u32(&mut bytes, kind);
            bytes.extend(content);
            bytes.resize(bytes.len() + padded - content.len(), 0);
        };
        chunk(JSON_CHUNK, &text);
        self.binary.iter().for_each(|content| chunk(BINARY_CHUNK, content));
        self.others.iter().for_each(|(kind, content)| chunk(*kind, content));
        let Ok(length) = u32::try_from(bytes.len()) else {
            return Err(Error::parameter("a GLB holds at most 4 GiB; put the stream beside it"));
        };
        LittleEndian::write_u32(&mut bytes[8..12], length);
        Ok(bytes)
    }

    /// Makes JSON alone of a GLB: its buffer 0 becomes the file of this reference, and its content, if there is any, is returned.
    ///
    /// # Errors
    ///
    /// [`Error::Unsupported`] for a GLB with chunks of other kinds, for which JSON has no place.
    pub fn take_buffer(&mut self, reference: &str) -> Result<Option<Vec<u8>>> {
        if !self.others.is_empty() {
            let message =
                format!("{}: the GLB has chunks besides JSON and buffer 0: it stays a GLB", self.path.display());
            return Err(Error::Unsupported(message));
        }
        self.is_glb = false;
        let Some(mut content) = self.binary.take() else { return Ok(None) };
        if let Some(Value::Object(buffer)) = self.json.get_mut("buffers").and_then(|buffers| buffers.get_mut(0)) {
            buffer.insert("uri".into(), json!(reference));
            let length =
                buffer.get("byteLength").and_then(Value::as_u64).and_then(|length| usize::try_from(length).ok());
            // What fills up a chunk is no part of the buffer.
            content.truncate(length.unwrap_or(content.len()));
        }
        Ok(Some(content))
    }

    /// True for a GLB, false for JSON alone.
    pub fn is_glb(&self) -> bool {
        self.is_glb
    }

    /// An error in this file.
    pub(super) fn wrong(&self, message: impl Into<String>) -> Error {
        Error::input(&self.path, message)
    }

    /// Name of the file in errors.
    pub(super) fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// The objects of one of the root's arrays; empty where there is none.
    pub fn list(&self, key: &str) -> &[Value] {
        self.json.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }

    /// Returns a list to edit; the array is made where there is none.
    pub(super) fn list_mut(&mut self, key: &str) -> Result<&mut Vec<Value>> {
        let wrong = self.wrong(format!("{key} must be an array"));
        self.json.entry(key).or_insert_with(|| json!([])).as_array_mut().ok_or(wrong)
    }

    /// The bytes of a bufferView.
    pub fn view(&self, index: u64, files: ExternalFiles<'_>) -> Result<Cow<'_, [u8]>> {
        let wrong = |message: String| self.wrong(format!("bufferView {index}: {message}"));
        let view = usize::try_from(index).ok().and_then(|index| self.list("bufferViews").get(index));
        let view = view.ok_or_else(|| wrong("is not there".into()))?;
        let number = |key: &str| match view.get(key) {
            None => Ok(0),
            Some(value) => value.as_u64().ok_or_else(|| wrong(format!("{key} must be a whole number, not negative"))),
        };
        let (buffer, offset, length) = (number("buffer")?, number("byteOffset")?, number("byteLength")?);
        let bytes = self.buffer(buffer, files)?;
        let end = offset.checked_add(length).filter(|&end| end <= bytes.len() as u64).ok_or_else(|| {
            wrong(format!("{length} bytes from {offset} go beyond the end of a buffer of {} bytes", bytes.len()))
        })?;
        let range = offset as usize..end as usize;
        Ok(match bytes {
            Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[range]),
            Cow::Owned(bytes) => Cow::Owned(bytes[range].to_vec()),
        })
    }

    fn buffer(&self, index: u64, files: ExternalFiles<'_>) -> Result<Cow<'_, [u8]>> {
        let wrong = |message: &str| self.wrong(format!("buffer {index}: {message}"));
        let buffer = usize::try_from(index).ok().and_then(|index| self.list("buffers").get(index));
        let buffer = buffer.ok_or_else(|| wrong("is not there"))?;
        match (buffer.get("uri").and_then(Value::as_str), &self.binary) {
            (Some(uri), _) => Ok(Cow::Owned(files(&self.check_uri(uri)?)?)),
            (None, Some(binary)) if index == 0 => Ok(Cow::Borrowed(binary)),
            _ => Err(wrong("has neither a uri nor the GLB's binary chunk")),
        }
    }

    /// Allows references that lead out of the document's folder.
    pub fn allow_outside(self, allowed: bool) -> Self {
        GltfDocument { allow_outside: allowed, ..self }
    }

    /// The path that a relative reference means; only files beside the document or below are followed, unless outside is allowed.
    pub fn check_uri(&self, uri: &str) -> Result<String> {
        let refused = |why: &str| Err(self.wrong(format!("the reference {:?} {why}", uri.get(..60).unwrap_or(uri))));
        let Some(path) = percent_decoded(uri) else { return refused("has a wrong % escape") };
        let is_plain = |part: &str| !part.is_empty() && part != ".." && !part.contains(['\\', ':', '\0']);
        if uri.starts_with("data:") {
            return refused("holds the data itself, which is not read; write a GLB");
        }
        if !self.allow_outside && !path.split('/').all(is_plain) {
            return refused("leads out of the document's folder; only files beside it are read");
        }
        Ok(path)
    }
}

/// The reference to a file beside the document: everything but letters, digits and `-_.~` escaped.
pub fn percent_encoded(name: &str) -> String {
    let escape = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    name.bytes().map(escape).collect()
}
