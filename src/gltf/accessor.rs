//! Numbers out of accessors: positions and texture coordinates, quantised ones included.

use super::document::{ExternalFiles, GltfDocument};
use crate::error::Result;
use crate::limits::Budget;
use byteorder::{ByteOrder, LittleEndian};
use serde_json::Value;

/// The elements of an accessor with `N` components; `None` where it is sparse, compressed, or of a type that is not read here.
pub(super) fn read_accessor<const N: usize>(
    document: &GltfDocument,
    index: u64,
    files: ExternalFiles<'_>,
    budget: &Budget,
) -> Result<Option<Vec<[f64; N]>>> {
    let wrong = |message: &str| document.wrong(format!("accessor {index}: {message}"));
    let accessor = usize::try_from(index).ok().and_then(|index| document.list("accessors").get(index));
    let accessor = accessor.ok_or_else(|| wrong("is not there"))?;
    let number = |of: &Value, key: &str| of.get(key).map_or(Some(0), Value::as_u64);
    let normalized = accessor.get("normalized").and_then(Value::as_bool).unwrap_or(false);
    let kind = match N {
        2 => "VEC2",
        _ => "VEC3",
    };
    let component = accessor.get("componentType").and_then(Value::as_u64).and_then(ComponentType::of);
    let view_index = accessor.get("bufferView").and_then(Value::as_u64);
    let (Some(component), Some(view_index)) = (component, view_index) else { return Ok(None) };
    if accessor.get("type").and_then(Value::as_str) != Some(kind) || accessor.get("sparse").is_some() {
        return Ok(None);
    }
    let view = usize::try_from(view_index).ok().and_then(|index| document.list("bufferViews").get(index));
    let view = view.ok_or_else(|| wrong("names a bufferView that is not there"))?;
    if view.get("extensions").is_some_and(|extensions| {
        ["EXT_meshopt_compression", "KHR_meshopt_compression"].iter().any(|name| extensions.get(name).is_some())
    }) {
        return Ok(None);
    }
    let (count, offset, stride) =
        match (number(accessor, "count"), number(accessor, "byteOffset"), number(view, "byteStride")) {
            (Some(count), Some(offset), Some(stride)) => (count, offset, stride),
            _ => return Err(wrong("count, byteOffset and byteStride must be whole numbers")),
        };
    let element = (N * component.bytes()) as u64;
    let stride = if stride == 0 { element } else { stride };
    let bytes = document.view(view_index, files)?;
    let needed = count
        .checked_sub(1)
        .map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(offset)?.checked_add(element));
    if stride < element || needed.is_none_or(|needed| needed > bytes.len() as u64) {
        return Err(wrong("goes beyond the end of its bufferView"));
    }
    budget.charge_items("accessor", count, size_of::<[f64; N]>())?;
    let one = |k: u64| -> [f64; N] {
        let at = (offset + k * stride) as usize;
        std::array::from_fn(|c| component.value(&bytes[at + c * component.bytes()..], normalized))
    };
    Ok(Some((0..count).map(one).collect()))
}

/// Component types.
#[derive(Clone, Copy)]
enum ComponentType {
    I8,
    U8,
    I16,
    U16,
    F32,
}

impl ComponentType {
    fn of(code: u64) -> Option<Self> {
        Some(match code {
            5120 => ComponentType::I8,
            5121 => ComponentType::U8,
            5122 => ComponentType::I16,
            5123 => ComponentType::U16,
            5126 => ComponentType::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            ComponentType::I8 | ComponentType::U8 => 1,
            ComponentType::I16 | ComponentType::U16 => 2,
            ComponentType::F32 => 4,
        }
    }

    /// The first number of `bytes`; 0 where they end early.
    fn value(self, bytes: &[u8], normalized: bool) -> f64 {
        if bytes.len() < self.bytes() {
            return 0.0;
        }
        let (value, max) = match self {
            ComponentType::I8 => (bytes[0] as i8 as f64, 127.0),
            ComponentType::U8 => (bytes[0] as f64, 255.0),
            ComponentType::I16 => (LittleEndian::read_i16(bytes) as f64, 32767.0),
            ComponentType::U16 => (LittleEndian::read_u16(bytes) as f64, 65535.0),
            ComponentType::F32 => return LittleEndian::read_f32(bytes) as f64,
        };
        if normalized { (value / max).max(-1.0) } else { value }
    }
}
