//! Meshes out of PLY, OBJ and glTF files. Positions and triangles only: tsuya derives everything else from the photographs.

use crate::asset::Mesh;
use crate::error::{Error, Result};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use std::io::{BufRead, Cursor};
use std::path::Path;

/// Extensions that [`read`] knows, lower case.
pub const EXTENSIONS: [&str; 4] = ["ply", "obj", "glb", "gltf"];

/// Reads a triangle mesh. PLY (ASCII or binary, float or double) and OBJ polygons are cut into fans; all triangle primitives of
/// a glTF file's default scene are merged, with their nodes' transforms applied. The result has at least one triangle, finite
/// positions and corner indices inside the vertex list; degenerate triangles are left to [`super::clean`].
///
/// Errors name the file and the element that is wrong.
pub fn read(path: impl AsRef<Path>) -> Result<Mesh> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    parse(path, &bytes)
}

/// As [`read`], from bytes; `path` names the file in errors and finds what a glTF file refers to.
fn parse(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    if bytes.is_empty() {
        return Err(Error::input(path, "the mesh file is empty (0 bytes)"));
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let mesh = if bytes.starts_with(b"ply") {
        read_ply(path, bytes)
    } else if bytes.starts_with(b"glTF") || extension == "gltf" {
        read_gltf(path, bytes)
    } else if extension == "obj" {
        read_obj(path, bytes)
    } else {
        Err(Error::input(path, "not a mesh that tsuya reads: it should be PLY, OBJ, GLB or glTF"))
    }?;
    check(path, &mesh)?;
    Ok(mesh)
}

/// What every mesh must hold, whatever its format.
fn check(path: &Path, mesh: &Mesh) -> Result<()> {
    if let Some(index) = mesh.positions.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        let [x, y, z] = mesh.positions[index];
        return Err(Error::input(path, format!("vertex {index} is not finite: ({x}, {y}, {z})")));
    }
    let count = mesh.positions.len();
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        if let Some(corner) = triangle.iter().find(|&&v| v as usize >= count) {
            return Err(Error::input(path, format!("triangle {index} names vertex {corner}, the mesh has {count}")));
        }
    }
    if mesh.triangles.is_empty() {
        return Err(Error::input(
            path,
            format!("the mesh has {count} vertices but no triangle; a point cloud can't be used"),
        ));
    }
    Ok(())
}

/// Cuts a polygon into a fan around its first corner.
fn push_fan(triangles: &mut Vec<[u32; 3]>, corners: &[u32]) {
    if let [first, rest @ ..] = corners {
        triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
    }
}

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

/// An element that is read past.
struct PlyOther;

impl PropertyAccess for PlyOther {
    fn new() -> Self {
        PlyOther
    }
}

fn read_ply(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let in_element = |element: &str, e: ply_rs_bw::parser::ParseError| {
        // The parser's messages run over several lines; the first two say where and what.
        let text: Vec<_> = e.to_string().lines().take(2).map(|line| line.trim().to_owned()).collect();
        Error::input(path, format!("{element}: {} (truncated or damaged PLY?)", text.join(" ")))
    };
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<PlyOther>::new().read_header(&mut reader).map_err(|e| in_element("PLY header", e))?;
    let mut mesh = Mesh::default();
    for (name, element) in &header.elements {
        let what = format!("PLY element '{name}' of {}", element.count);
        match name.as_str() {
            "vertex" => {
                let vertices = Parser::<PlyVertex>::new().read_payload_for_element(&mut reader, element, &header);
                let vertices = vertices.map_err(|e| in_element(&what, e))?;
                mesh.positions = vertices.iter().map(|v| v.0.map(|c| c as f32)).collect();
            }
            "face" => {
                let faces = Parser::<PlyFace>::new().read_payload_for_element(&mut reader, element, &header);
                let faces = faces.map_err(|e| in_element(&what, e))?;
                let count = mesh.positions.len();
                for (index, face) in faces.iter().enumerate() {
                    // Vertices may follow the faces in the file; `check` then finds the fault.
                    if let Some(corner) = face.0.iter().find(|&&v| count > 0 && v as usize >= count) {
                        return Err(Error::input(
                            path,
                            format!("face {index} names vertex {corner}, the mesh has {count}"),
                        ));
                    }
                    push_fan(&mut mesh.triangles, &face.0);
                }
            }
            _ => {
                let other = Parser::<PlyOther>::new().read_payload_for_element(&mut reader, element, &header);
                other.map_err(|e| in_element(&what, e))?;
            }
        }
    }
    Ok(mesh)
}

/// Counts the lines that the OBJ parser has taken, since its errors don't say where they are.
struct CountLines<'a> {
    inner: Cursor<&'a [u8]>,
    lines: std::rc::Rc<std::cell::Cell<usize>>,
}

impl std::io::Read for CountLines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.inner.read(buffer)
    }
}

impl BufRead for CountLines<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        // One line at a time, so that the count stands at the line being parsed.
        let rest = self.inner.fill_buf()?;
        let end = rest.iter().position(|&b| b == b'\n').map_or(rest.len(), |n| n + 1);
        Ok(&rest[..end])
    }
    fn consume(&mut self, amount: usize) {
        self.lines.set(self.lines.get() + (amount > 0) as usize);
        self.inner.consume(amount);
    }
}

fn read_obj(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let lines = std::rc::Rc::new(std::cell::Cell::new(0));
    let mut reader = CountLines { inner: Cursor::new(bytes), lines: lines.clone() };
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    // Materials are not needed, and a missing .mtl file must not matter.
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    let (models, _) = tobj::load_obj_buf(&mut reader, &options, no_materials).map_err(|e| {
        Error::input(path, format!("{}: {e}", locate_obj_fault(bytes).unwrap_or(format!("line {}", lines.get()))))
    })?;
    let mut mesh = Mesh::default();
    for model in models {
        let offset = mesh.positions.len() as u32;
        mesh.positions.extend(model.mesh.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        mesh.triangles
            .extend(model.mesh.indices.chunks_exact(3).map(|t| [t[0] + offset, t[1] + offset, t[2] + offset]));
    }
    if mesh.positions.iter().flatten().any(|c| !c.is_finite()) {
        let place = locate_obj_fault(bytes).unwrap_or_default();
        return Err(Error::input(path, format!("{place}: a vertex is not finite")));
    }
    Ok(mesh)
}

/// Texture coordinates of each triangle's corners of an OBJ file, parallel to the triangles that [`read`] gives. Empty for other
/// formats and for files without them.
pub fn texture_coordinates(path: impl AsRef<Path>) -> Result<Vec<[[f32; 2]; 3]>> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    let Ok((models, _)) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_materials) else {
        return Ok(Vec::new());
    };
    let mut coordinates = Vec::new();
    for mesh in models.into_iter().map(|model| model.mesh) {
        // A corner's own index, or where all its indices are one, that of its vertex.
        let own = mesh.texcoord_indices.len() == mesh.indices.len();
        let indices = if own { &mesh.texcoord_indices } else { &mesh.indices };
        for corners in indices.chunks_exact(3) {
            let at = |k: usize| {
                let first = corners[k] as usize * 2;
                mesh.texcoords.get(first..first + 2).map(|uv| [uv[0], uv[1]])
            };
            let (Some(a), Some(b), Some(c)) = (at(0), at(1), at(2)) else { return Ok(Vec::new()) };
            coordinates.push([a, b, c]);
        }
    }
    Ok(coordinates)
}

/// The line of the first vertex that is not finite or face corner out of range; only asked after something went wrong.
fn locate_obj_fault(bytes: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(bytes);
    let total = text.lines().filter(|l| l.trim_start().starts_with("v ")).count() as i64;
    let mut vertices = 0;
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                if words.any(|w| w.parse::<f32>().is_ok_and(|c| !c.is_finite())) {
                    return Some(format!("line {}, vertex {}", number + 1, vertices + 1));
                }
                vertices += 1;
            }
            Some("f") => {
                for corner in words.filter_map(|w| w.split('/').next()?.parse::<i64>().ok()) {
                    let index = if corner < 0 { vertices + corner + 1 } else { corner };
                    if !(1..=total).contains(&index) {
                        return Some(format!("line {}, a face names vertex {corner} of {total}", number + 1));
                    }
                }
            }
            _ => {}
        }
    }
    None
}

fn read_gltf(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let damaged = |e: gltf::Error| Error::input(path, format!("glTF: {e}"));
    check_glb_head(path, bytes)?;
    // The glTF crate's validation itself takes the index of the positions on trust.
    let unchecked = gltf::Gltf::from_slice_without_validation(bytes).map_err(damaged)?;
    let json = unchecked.document.as_json();
    for (mesh, part) in json.meshes.iter().enumerate() {
        let mut attributes = part.primitives.iter().flat_map(|primitive| primitive.attributes.values());
        if let Some(index) = attributes.find(|index| index.value() >= json.accessors.len()) {
            return Err(Error::input(
                path,
                format!("glTF: mesh {mesh} names accessor {}, which is not there", index.value()),
            ));
        }
    }
    let file = gltf::Gltf::from_slice(bytes).map_err(damaged)?;
    let buffers = gltf::import_buffers(&file.document, path.parent(), file.blob).map_err(damaged)?;
    let document = file.document;
    let mut mesh = Mesh::default();
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let Some(scene) = scene else {
        return Err(Error::input(path, "glTF: the file has no scene"));
    };
    // A node with two parents is invalid, but must not multiply the work.
    let mut visited = vec![false; document.nodes().count()];
    let mut stack: Vec<_> = scene.nodes().map(|n| (n, glam::DMat4::IDENTITY)).collect();
    stack.reverse();
    while let Some((node, parent)) = stack.pop() {
        if std::mem::replace(&mut visited[node.index()], true) {
            return Err(Error::input(path, format!("glTF: node {} has two parents", node.index())));
        }
        let local = node.transform().matrix().map(|column| column.map(f64::from));
        let to_world = parent * glam::DMat4::from_cols_array_2d(&local);
        if let Some(part) = node.mesh() {
            for primitive in part.primitives() {
                let what = format!("glTF: mesh {}, primitive {}", part.index(), primitive.index());
                append_primitive(path, &what, &primitive, &buffers, to_world, &mut mesh)?;
            }
        }
        let children = stack.len();
        stack.extend(node.children().map(|child| (child, to_world)));
        stack[children..].reverse();
    }
    Ok(mesh)
}

/// The length in a GLB file's head, from which the glTF crate subtracts that of the head itself.
fn check_glb_head(path: &Path, bytes: &[u8]) -> Result<()> {
    let length = bytes.strip_prefix(b"glTF").and_then(|rest| rest.get(4..8)?.try_into().ok()).map(u32::from_le_bytes);
    match length {
        Some(length) if length < 12 => {
            Err(Error::input(path, format!("glTF: a file of {length} bytes, as its head says")))
        }
        _ => Ok(()),
    }
}

fn append_primitive(
    path: &Path,
    what: &str,
    primitive: &gltf::Primitive<'_>,
    buffers: &[gltf::buffer::Data],
    to_world: glam::DMat4,
    mesh: &mut Mesh,
) -> Result<()> {
    use gltf::mesh::Mode;
    if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        return Ok(());
    }
    let positions = primitive.get(&gltf::Semantic::Positions);
    let accessors = [("positions", positions), ("indices", primitive.indices())];
    for (name, accessor) in accessors.iter().filter_map(|(name, a)| Some((name, a.as_ref()?))) {
        check_accessor(name, accessor).map_err(|e| Error::input(path, format!("{what}, {name}: {e}")))?;
    }
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(|data| &data.0[..]));
    let Some(positions) = reader.read_positions() else {
        return Err(Error::input(path, format!("{what}: no positions (or compressed ones, which are not read)")));
    };
    let offset = mesh.positions.len() as u32;
    let before = mesh.positions.len();
    mesh.positions.extend(positions.map(|p| {
        let world = to_world.transform_point3(glam::DVec3::from_array(p.map(f64::from)));
        world.to_array().map(|c| c as f32)
    }));
    let count = (mesh.positions.len() - before) as u32;
    let indices: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..count).collect(),
    };
    if let Some((at, index)) = indices.iter().enumerate().find(|&(_, &v)| v >= count) {
        return Err(Error::input(path, format!("{what}: index {at} names vertex {index}, the primitive has {count}")));
    }
    let mirrored = to_world.determinant() < 0.0;
    let mut push = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a + offset, b + offset, c + offset];
        mesh.triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
    };
    match primitive.mode() {
        Mode::Triangles => indices.chunks_exact(3).for_each(|t| push([t[0], t[1], t[2]])),
        Mode::TriangleStrip => indices.windows(3).enumerate().for_each(|(n, t)| {
            push(if n % 2 == 0 { [t[0], t[1], t[2]] } else { [t[0], t[2], t[1]] });
        }),
        _ => indices.windows(2).skip(1).for_each(|pair| push([indices[0], pair[0], pair[1]])),
    }
    Ok(())
}

/// Whether an accessor has the type of its use and stays inside its view, and the view inside its buffer: the glTF crate takes
/// that on trust.
fn check_accessor(name: &str, accessor: &gltf::Accessor<'_>) -> std::result::Result<(), String> {
    use gltf::accessor::{DataType, Dimensions};
    let (kind, shape) = (accessor.data_type(), accessor.dimensions());
    let fits = match name {
        "positions" => kind == DataType::F32 && shape == Dimensions::Vec3,
        _ => matches!(kind, DataType::U8 | DataType::U16 | DataType::U32) && shape == Dimensions::Scalar,
    };
    if !fits {
        return Err(format!("{kind:?} {shape:?} is not supported"));
    }
    if accessor.sparse().is_some() {
        return Err("sparse accessors are not supported".into());
    }
    let Some(view) = accessor.view() else {
        return Err("the accessor has no buffer view".into());
    };
    let stride = view.stride().unwrap_or(accessor.size());
    let needed = (accessor.count() as u128).saturating_sub(1) * stride as u128 + accessor.size() as u128;
    let end_in_view = accessor.offset() as u128 + needed;
    let view_end = view.offset() as u128 + view.length() as u128;
    if end_in_view > view.length() as u128 || view_end > view.buffer().length() as u128 {
        return Err(format!("accessor {} reaches past the end of its buffer", accessor.index()));
    }
    Ok(())
}

#[cfg(test)]
#[path = "read_tests.rs"]
mod tests;
