//! The tensor file: named arrays with shapes, anywhere in the file.

use crate::{Error, Result};
use byteorder::{ByteOrder, LittleEndian};
use std::path::Path;

const SIGNATURE: &[u8; 12] = b"tensor_file\0";
const MAX_FIELDS: u32 = 64;
const MAX_DIMENSIONS: u16 = 8;
/// Bytes of an item of each type: nothing, integers of 1, 2, 4 and 8 bytes without and with sign in turn, floats of 2, 4 and 8.
const ITEM_BYTES: [usize; 12] = [0, 1, 1, 2, 2, 4, 4, 8, 8, 2, 4, 8];
const FLOAT32: u8 = 10;
const FLOAT64: u8 = 11;

/// The fields of a file.
pub(crate) struct TensorFile<'a> {
    path: &'a Path,
    fields: Vec<TensorField<'a>>,
}

struct TensorField<'a> {
    name: &'a str,
    kind: u8,
    shape: Vec<usize>,
    bytes: &'a [u8],
}

/// An array of numbers, all finite.
pub(crate) struct TensorFloats {
    /// Lengths, slowest first.
    pub shape: Vec<usize>,
    /// Values, their number the product of `shape`.
    pub values: Vec<f64>,
}

impl<'a> TensorFile<'a> {
    /// Checks the whole directory.
    pub(crate) fn parse(bytes: &'a [u8], path: &'a Path) -> Result<Self> {
        let wrong = |message: String| Error::input(path, message);
        let cut = |what: &str| wrong(format!("the file is cut off in {what}; it has {} bytes", bytes.len()));
        let mut reader = TensorReader { bytes, at: 0 };
        let signature = reader.take(12).ok_or_else(|| cut("its signature"))?;
        if signature != SIGNATURE {
            return Err(wrong("not a tensor file (.bsdf): it does not begin with \"tensor_file\"".into()));
        }
        let version = reader.take(2).ok_or_else(|| cut("its version"))?;
        if version.first() != Some(&1) {
            let message = format!("{}: tensor file of version {version:?}; version 1 is known", path.display());
            return Err(Error::Unsupported(message));
        }
        let count = reader.u32().ok_or_else(|| cut("its count of fields"))?;
        if count > MAX_FIELDS {
            let swapped = count.swap_bytes();
            let why = if swapped <= MAX_FIELDS {
                format!(
                    "{swapped} if the file is big-endian: numbers of a tensor file are little-endian, swap their bytes"
                )
            } else {
                format!("at most {MAX_FIELDS} are read")
            };
            return Err(wrong(format!("{count} fields; {why}")));
        }
        let mut fields: Vec<TensorField> = Vec::new();
        for index in 0..count {
            let cut = || cut(&format!("the header of field {}", index + 1));
            let length = reader.u16().ok_or_else(cut)?;
            let name = reader.take(length.into()).ok_or_else(cut)?;
            let name =
                std::str::from_utf8(name).map_err(|_| wrong(format!("the name of field {} is not text", index + 1)))?;
            let dimensions = reader.u16().ok_or_else(cut)?;
            let kind = reader.take(1).and_then(|kind| kind.first().copied()).ok_or_else(cut)?;
            let offset = reader.u64().ok_or_else(cut)?;
            if dimensions > MAX_DIMENSIONS {
                return Err(wrong(format!("field {name}: {dimensions} dimensions, at most {MAX_DIMENSIONS} are read")));
            }
            let item_bytes = ITEM_BYTES.get(usize::from(kind)).copied().filter(|&size| size > 0);
            let item_bytes =
                item_bytes.ok_or_else(|| wrong(format!("field {name}: no such type of numbers: {kind}")))?;
            let mut shape = Vec::new();
            let mut total = Some(item_bytes);
            for _ in 0..dimensions {
                let length = usize::try_from(reader.u64().ok_or_else(cut)?).ok();
                total = total.zip(length).and_then(|(total, length)| total.checked_mul(length));
                shape.push(length.unwrap_or(usize::MAX));
            }
            let end = usize::try_from(offset)
                .ok()
                .zip(total)
                .and_then(|(start, total)| Some((start, start.checked_add(total)?)));
            let data = end.and_then(|(start, end)| bytes.get(start..end));
            let data = data.ok_or_else(|| {
                wrong(format!(
                    "field {name} of shape {shape:?} at byte {offset} ends after the file's {} bytes",
                    bytes.len()
                ))
            })?;
            if fields.iter().any(|field| field.name == name) {
                return Err(wrong(format!("field {name} is there twice")));
            }
            fields.push(TensorField { name, kind, shape, bytes: data });
        }
        Ok(TensorFile { path, fields })
    }

    /// Returns `true` if the file has a field of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.fields.iter().any(|field| field.name == name)
    }

    /// A field's bytes.
    pub(crate) fn bytes(&self, name: &str) -> Result<&'a [u8]> {
        self.field(name).map(|field| field.bytes)
    }

    /// A field of `dimensions` whose numbers are floats.
    pub(crate) fn floats(&self, name: &str, dimensions: usize) -> Result<TensorFloats> {
        let field = self.field(name)?;
        let wrong = |message: String| Error::input(self.path, format!("field {name}: {message}"));
        if field.shape.len() != dimensions {
            return Err(wrong(format!("{} dimensions, {dimensions} expected", field.shape.len())));
        }
        let values: Vec<f64> = match field.kind {
            FLOAT32 => {
                let chunks = field.bytes.chunks_exact(4);
                chunks.map(|b| LittleEndian::read_f32(b).into()).collect()
            }
            FLOAT64 => {
                let chunks = field.bytes.chunks_exact(8);
                chunks.map(LittleEndian::read_f64).collect()
            }
            other => return Err(wrong(format!("numbers of type {other}, floats expected"))),
        };
        let odd = values.iter().filter(|value| !value.is_finite()).count();
        if odd > 0 {
            return Err(wrong(format!("{odd} of {} values are not finite numbers: the file is damaged", values.len())));
        }
        if let Some(value) = values.iter().find(|value| value.abs() > 1e20) {
            return Err(wrong(format!("a value of {value:e}: the file is damaged or big-endian")));
        }
        Ok(TensorFloats { shape: field.shape.clone(), values })
    }

    fn field(&self, name: &str) -> Result<&TensorField<'a>> {
        let missing = || Error::input(self.path, format!("field {name} is missing: not an RGL material"));
        self.fields.iter().find(|field| field.name == name).ok_or_else(missing)
    }
}

struct TensorReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> TensorReader<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(taken)
    }
    fn u16(&mut self) -> Option<u16> {
        self.take(2).map(LittleEndian::read_u16)
    }
    fn u32(&mut self) -> Option<u32> {
        self.take(4).map(LittleEndian::read_u32)
    }
    fn u64(&mut self) -> Option<u64> {
        self.take(8).map(LittleEndian::read_u64)
    }
}
