//! PLY, text and binary.

use super::{PreciseMesh, charge};
use crate::error::{Error, Result};
use crate::input::{FileAccess, escaped};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};
use std::io::Cursor;
use std::path::Path;

#[derive(Default)]
struct PlyVertex([f64; 3]);

impl PropertyAccess for PlyVertex {
    fn new() -> Self {
        PlyVertex([f64::NAN; 3])
    }
    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0[axis] = match value {
            Property::Double(v) => v,
            other => match other.to_f32_lossy() {
                Some(v) => v as f64,
                None => return PropertyAccessResult::UnsupportedType,
            },
        };
        PropertyAccessResult::Set
    }
}

#[derive(Default)]
struct PlyFace(Vec<u32>);

impl PropertyAccess for PlyFace {
    fn new() -> Self {
        PlyFace::default()
    }
    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        match value.to_u32_list() {
            Some(list) => {
                self.0 = list;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

/// Triangle strips in one list, -1 between them, as Stanford's scans have them.
#[derive(Default)]
struct PlyStrips(Vec<i32>);

impl PropertyAccess for PlyStrips {
    fn new() -> Self {
        PlyStrips::default()
    }
    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        match (name, value) {
            ("vertex_indices" | "vertex_index", Property::ListInt(list)) => {
                self.0 = list;
                PropertyAccessResult::Set
            }
            ("vertex_indices" | "vertex_index", _) => PropertyAccessResult::UnsupportedType,
            _ => PropertyAccessResult::Ignored,
        }
    }
}

/// An element that is read past.
struct PlyOther;

impl PropertyAccess for PlyOther {
    fn new() -> Self {
        PlyOther
    }
}

/// Letters of the parser's messages that are kept: they may repeat a line of any length.
const MAX_MESSAGE: usize = 300;
/// Bytes of a header with its comments, at most.
const MAX_HEADER_BYTES: usize = 1 << 20;
/// Memory of a vertex, and of a face beside its corners, while the parser reads them; lists may have grown to twice their need.
const VERTEX_BYTES: u64 = 2 * size_of::<PlyVertex>() as u64;
const FACE_BYTES: u64 = 2 * size_of::<PlyFace>() as u64 + 32;

pub(super) fn read(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<PreciseMesh> {
    let in_element = |element: &str, e: ply_rs_bw::parser::ParseError| {
        // The parser's messages run over several lines; the first two say where and what.
        let text: Vec<_> = e.to_string().lines().take(2).map(|line| line.trim().to_owned()).collect();
        let text: String = text.join(" ").chars().take(MAX_MESSAGE).collect();
        Error::input(path, format!("{element}: {text} (truncated or damaged PLY?)"))
    };
    const END: &[u8] = b"end_header";
    let start = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let Some(header_bytes) = start.windows(END.len()).position(|window| window == END) else {
        return Err(Error::input(path, format!("PLY header: no end_header within {} bytes", start.len())));
    };
    // A line of the header may become some hundred bytes of names and lists.
    let _header = access.reserve(path, "PLY header", 64 * header_bytes as u64)?;
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<PlyOther>::new().read_header(&mut reader).map_err(|e| in_element("PLY header", e))?;
    let mut mesh = PreciseMesh::default();
    for (name, element) in &header.elements {
        let what = format!("PLY element '{}' of {}", escaped(name), element.count);
        let left = (bytes.len() as u64).saturating_sub(reader.get_ref().position());
        check_count(element, header.encoding, left).map_err(|e| Error::input(path, format!("{what}: {e}")))?;
        let count = element.count as u64;
        match name.as_str() {
            "vertex" => {
                charge(path, access, &mesh, count, 0)?;
                let _parsed = access.reserve(path, "PLY vertices", count * VERTEX_BYTES)?;
                let vertices = Parser::<PlyVertex>::new().read_payload_for_element(&mut reader, element, &header);
                let vertices = vertices.map_err(|e| in_element(&what, e))?;
                mesh.positions = vertices.iter().map(|v| v.0).collect();
            }
            "face" => {
                // Each takes four bytes, in a list that has grown to twice its need.
                let corners = left / corner_bytes(element, header.encoding);
                let _parsed = access.reserve(path, "PLY faces", count * FACE_BYTES + 8 * corners)?;
                let faces = Parser::<PlyFace>::new().read_payload_for_element(&mut reader, element, &header);
                let faces = faces.map_err(|e| in_element(&what, e))?;
                append_faces(path, &faces, &mut mesh, access)?;
            }
            "tristrips" => {
                let corners = left / corner_bytes(element, header.encoding);
                let _parsed = access.reserve(path, "PLY triangle strips", count * FACE_BYTES + 8 * corners)?;
                let strips = Parser::<PlyStrips>::new().read_payload_for_element(&mut reader, element, &header);
                let strips = strips.map_err(|e| in_element(&what, e))?;
                let faces: Vec<PlyFace> =
                    strips.iter().flat_map(|list| list.0.split(|&v| v < 0)).flat_map(strip).collect();
                append_faces(path, &faces, &mut mesh, access)?;
            }
            _ if element.count == 0 => {}
            _ => {
                let other = Parser::<PlyOther>::new().read_payload_for_element(&mut reader, element, &header);
                other.map_err(|e| in_element(&what, e))?;
            }
        }
    }
    Ok(mesh)
}

fn append_faces(path: &Path, faces: &[PlyFace], mesh: &mut PreciseMesh, access: &FileAccess) -> Result<()> {
    let triangles = faces.iter().map(|face| face.0.len().saturating_sub(2) as u64).sum();
    charge(path, access, mesh, 0, triangles)?;
    mesh.triangles.reserve_exact(triangles as usize);
    let count = mesh.positions.len();
    for (index, face) in faces.iter().enumerate() {
        // Vertices may follow the faces in the file; the check of the whole mesh then finds the fault.
        if let Some(corner) = face.0.iter().find(|&&v| count > 0 && v as usize >= count) {
            return Err(Error::input(path, format!("face {index} names vertex {corner}, the mesh has {count}")));
        }
        push_fan(&mut mesh.triangles, &face.0);
    }
    Ok(())
}

/// The triangles of a strip: every second one is turned, and those with a corner twice only join its parts.
fn strip(corners: &[i32]) -> impl Iterator<Item = PlyFace> {
    corners.windows(3).enumerate().filter_map(|(index, corners)| {
        let [a, b, c] = std::array::from_fn(|k| corners[k] as u32);
        let turned = if index % 2 == 0 { [a, b, c] } else { [b, a, c] };
        (a != b && b != c && a != c).then(|| PlyFace(turned.to_vec()))
    })
}

/// Cuts a polygon into a fan around its first corner.
fn push_fan(triangles: &mut Vec<[u32; 3]>, corners: &[u32]) {
    if let [first, rest @ ..] = corners {
        triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
    }
}

/// Bytes of a number in a binary file.
fn scalar_bytes(kind: &ScalarType) -> u64 {
    match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Bytes of the file that a face's corner takes at least: in text a digit and a space.
fn corner_bytes(element: &ElementDef, encoding: Encoding) -> u64 {
    let lists = element.properties.iter().filter_map(|(_, property)| match &property.data_type {
        PropertyType::List(_, kind) => Some(scalar_bytes(kind)),
        PropertyType::Scalar(_) => None,
    });
    if encoding == Encoding::Ascii { 2 } else { lists.min().unwrap_or(1) }
}

/// Whether as many items as an element claims can stand in the bytes that are left.
fn check_count(element: &ElementDef, encoding: Encoding, left: u64) -> std::result::Result<(), String> {
    let item: u64 = match encoding {
        // A digit and a space or line end each.
        Encoding::Ascii => (2 * element.properties.len() as u64).max(1),
        _ => (element.properties.iter())
            .map(|(_, property)| match &property.data_type {
                PropertyType::Scalar(kind) | PropertyType::List(kind, _) => scalar_bytes(kind),
            })
            .sum(),
    };
    if element.count > 0 && element.properties.is_empty() {
        return Err("an element without properties".into());
    }
    // The last line may have no end.
    let room = (left + 1) / item.max(1);
    if element.count as u64 > room { Err(format!("{left} bytes are left, room for {room}")) } else { Ok(()) }
}
