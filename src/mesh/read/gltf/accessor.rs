//! Values of accessors: any component type, sparse or not, in buffer views that may be compressed.

use super::document::{GeometryDocument, MeshoptView};
use crate::error::{Error, Result};
use crate::input::{FileAccess, Folder};
use gltf::accessor::{DataType, Dimensions};
use std::path::Path;

/// The content of a file's buffers and of its compressed views.
pub(super) struct BufferContent<'a> {
    pub path: &'a Path,
    buffers: Vec<Vec<u8>>,
    /// By view; `None` where the view is a part of its buffer.
    decompressed: Vec<Option<Vec<u8>>>,
}

impl<'a> BufferContent<'a> {
    /// Reads the binary chunk, data URIs, and files in the folder of this one, which stay charged.
    pub(super) fn read(path: &'a Path, file: &GeometryDocument, access: &FileAccess) -> Result<Self> {
        let folder = Folder::containing(path, access.allows_outside());
        let mut chunk = file.chunk;
        let mut buffers = Vec::new();
        for (index, buffer) in file.document.buffers().enumerate() {
            let wrong = |message: String| Error::input(path, format!("glTF: buffer {index}: {message}"));
            let is_fallback = file.is_fallback.get(index).copied().unwrap_or(false);
            let data = match buffer.source() {
                // It only gives compressed views a size.
                gltf::buffer::Source::Bin if is_fallback => Vec::new(),
                gltf::buffer::Source::Bin => {
                    let chunk = chunk.take().ok_or_else(|| wrong("has no binary chunk".into()))?;
                    access.charge(path, "glTF buffer", chunk.len() as u64)?;
                    chunk.to_vec()
                }
                gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                    access.charge(path, "glTF buffer", uri.len() as u64)?;
                    // Without a base nothing but data is read.
                    gltf::buffer::Data::from_source(buffer.source(), None).map_err(|e| wrong(e.to_string()))?.0
                }
                gltf::buffer::Source::Uri(uri) => {
                    access.read_bytes(&folder.resolve_uri(uri)?, "glTF buffer", u64::MAX)?.keep()
                }
            };
            if data.len() < buffer.length() && !is_fallback {
                return Err(wrong(format!("{} bytes are stated, {} are there", buffer.length(), data.len())));
            }
            buffers.push(data);
        }
        let mut content = BufferContent { path, buffers, decompressed: Vec::new() };
        for (index, view) in file.compressed.iter().enumerate() {
            let decompressed = match view {
                Some(view) => Some(content.decompress(view, access).map_err(|message| {
                    Error::input(path, format!("glTF: bufferView {index}, compressed by meshoptimizer: {message}"))
                })?),
                None => None,
            };
            content.decompressed.push(decompressed);
        }
        Ok(content)
    }

    fn decompress(&self, view: &MeshoptView, access: &FileAccess) -> std::result::Result<Vec<u8>, String> {
        let buffer = self.buffers.get(view.buffer).ok_or("its buffer is not there")?;
        let end = view.offset.checked_add(view.length).filter(|&end| end <= buffer.len());
        let encoded = &buffer[view.offset..end.ok_or("it reaches past the end of its buffer")?];
        super::meshopt::decode(view, encoded, |bytes| {
            access.charge(self.path, "glTF buffer", bytes).map_err(|e| e.to_string())
        })
    }

    /// The bytes of a view; `None` where the file has fewer than are stated.
    fn view(&self, view: &gltf::buffer::View<'_>) -> Option<&[u8]> {
        if let Some(Some(bytes)) = self.decompressed.get(view.index()) {
            return bytes.get(..view.length());
        }
        let buffer = self.buffers.get(view.buffer().index())?;
        buffer.get(view.offset()..view.offset().checked_add(view.length())?)
    }

    /// The bytes of `count` items of `size` bytes, `stride` apart, from an offset in a view on.
    fn items(
        &self,
        view: &gltf::buffer::View<'_>,
        offset: usize,
        count: usize,
        size: usize,
    ) -> std::result::Result<(&[u8], usize), String> {
        let stride = view.stride().unwrap_or(size);
        if stride < size {
            return Err(format!("items of {size} bytes every {stride}"));
        }
        let needed = (count as u128).saturating_sub(1) * stride as u128 + if count > 0 { size as u128 } else { 0 };
        let bytes = self.view(view).and_then(|bytes| bytes.get(offset..));
        match bytes.filter(|bytes| bytes.len() as u128 >= needed) {
            Some(bytes) => Ok((bytes, stride)),
            None => Err(format!("bufferView {} is too short, or reaches past its buffer", view.index())),
        }
    }

    /// Calls `take(item, values)` for each of the first `most` items of an accessor with its first `N` components. Those behind may not even be
    /// there: an accessor without data may claim any number of zeros.
    pub(super) fn each<const N: usize>(
        &self,
        accessor: &gltf::Accessor<'_>,
        most: usize,
        mut take: impl FnMut(usize, [f64; N]),
    ) -> std::result::Result<(), String> {
        let (kind, size) = (accessor.data_type(), accessor.size());
        let value = component(kind, accessor.normalized());
        let width = kind.size();
        let read = |item: &[u8]| std::array::from_fn(|k| value(&item[k * width..(k + 1) * width]));
        let count = accessor.count();
        let past = |fault: String| format!("accessor {} reaches past the end of its data: {fault}", accessor.index());
        if let Some(view) = accessor.view() {
            let (bytes, stride) = self.items(&view, accessor.offset(), count, size).map_err(past)?;
            (0..count.min(most)).for_each(|k| take(k, read(&bytes[k * stride..k * stride + size])));
        } else {
            (0..count.min(most)).for_each(|k| take(k, [0.0; N]));
        }
        let Some(sparse) = accessor.sparse() else { return Ok(()) };
        let (indices, values, replaced) = (sparse.indices(), sparse.values(), sparse.count());
        let index_kind = match indices.index_type() {
            gltf::accessor::sparse::IndexType::U8 => DataType::U8,
            gltf::accessor::sparse::IndexType::U16 => DataType::U16,
            gltf::accessor::sparse::IndexType::U32 => DataType::U32,
        };
        let (at, step) = self.items(&indices.view(), indices.offset(), replaced, index_kind.size()).map_err(past)?;
        let (bytes, stride) = self.items(&values.view(), values.offset(), replaced, size).map_err(past)?;
        for k in 0..replaced {
            let item = component(index_kind, false)(&at[k * step..k * step + index_kind.size()]) as usize;
            if item >= count {
                return Err(format!("sparse value {k} replaces item {item} of {count}"));
            }
            if item < most {
                take(item, read(&bytes[k * stride..k * stride + size]));
            }
        }
        Ok(())
    }
}

/// Returns what makes a number of a component's bytes (glTF 2.0, 3.6.2.2 and 3.11).
fn component(kind: DataType, normalized: bool) -> impl Fn(&[u8]) -> f64 {
    let largest = match kind {
        _ if !normalized => 1.0,
        DataType::I8 => 127.0,
        DataType::U8 => 255.0,
        DataType::I16 => 32767.0,
        DataType::U16 => 65535.0,
        DataType::U32 | DataType::F32 => 1.0,
    };
    move |bytes: &[u8]| {
        let mut four = [0; 4];
        four[..bytes.len()].copy_from_slice(bytes);
        let [low, high, ..] = four;
        let value = match kind {
            DataType::I8 => f64::from(low as i8),
            DataType::U8 => f64::from(low),
            DataType::I16 => f64::from(i16::from_le_bytes([low, high])),
            DataType::U16 => f64::from(u16::from_le_bytes([low, high])),
            DataType::U32 => f64::from(u32::from_le_bytes(four)),
            DataType::F32 => f64::from(f32::from_le_bytes(four)),
        };
        if normalized { (value / largest).max(-1.0) } else { value }
    }
}

/// Uses of an accessor in geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum AccessorUse {
    Positions,
    Indices,
    Joints,
    Weights,
    Matrices,
}

/// Returns an error where an accessor has not the type of its use.
pub(super) fn check_type(used: AccessorUse, accessor: &gltf::Accessor<'_>) -> std::result::Result<(), String> {
    use DataType::{F32, I8, I16, U8, U16, U32};
    let (kind, shape) = (accessor.data_type(), accessor.dimensions());
    let fits = match used {
        AccessorUse::Positions => matches!(kind, F32 | I8 | U8 | I16 | U16) && shape == Dimensions::Vec3,
        AccessorUse::Indices => matches!(kind, U8 | U16 | U32) && shape == Dimensions::Scalar,
        AccessorUse::Joints => matches!(kind, U8 | U16) && shape == Dimensions::Vec4,
        AccessorUse::Weights => matches!(kind, F32 | U8 | U16) && shape == Dimensions::Vec4,
        AccessorUse::Matrices => kind == F32 && shape == Dimensions::Mat4,
    };
    let index = accessor.index();
    if fits { Ok(()) } else { Err(format!("accessor {index} of {kind:?} {shape:?} does not fit {used:?}")) }
}
