//! glTF and GLB, as far as it is triangles.

use super::charge;
use crate::error::{Error, Result};
use crate::input::{FileAccess, Folder};
use crate::limits::Reservation;
use crate::mesh::Mesh;
use byteorder::{ByteOrder, LittleEndian};
use std::path::Path;

/// Bytes that an object and a value of the JSON become at most: a node without members has 300, lists may have grown to twice their need.
const OBJECT_BYTES: u64 = 1024;
const VALUE_BYTES: u64 = 64;
/// Primitives at most, those of a mesh counted for each node that it stands in.
const MAX_PRIMITIVES: u64 = 1 << 20;
/// Bytes of the JSON at most: a million nodes have some 100 MB.
const MAX_JSON_BYTES: usize = 256 << 20;

/// Charges what the parsers make of the JSON of a glTF or GLB file, for as long as they hold it.
fn hold_json<'a>(path: &Path, bytes: &[u8], access: &'a FileAccess) -> Result<Reservation<'a>> {
    let chunk = |at: usize| bytes.get(at..at + 4).map(LittleEndian::read_u32);
    let json = match bytes.strip_prefix(b"glTF") {
        // The head of the file has 12 bytes, that of the chunk 8.
        Some(_) => bytes.get(20..).map(|rest| &rest[..rest.len().min(chunk(12).unwrap_or(0) as usize)]),
        None => Some(bytes),
    };
    let json = json.unwrap_or_default();
    if json.len() > MAX_JSON_BYTES {
        return Err(Error::input(
            path,
            format!("glTF: {} bytes of JSON, {MAX_JSON_BYTES} at most are read", json.len()),
        ));
    }
    let (mut objects, mut values) = (0, 0);
    for byte in json {
        objects += u64::from(*byte == b'{');
        values += u64::from(matches!(byte, b',' | b'['));
    }
    access.reserve(path, "glTF JSON", objects * OBJECT_BYTES + values * VALUE_BYTES + 4 * json.len() as u64)
}

/// The length in a GLB file's head, from which the glTF crate subtracts that of the head itself.
fn check_glb_head(path: &Path, bytes: &[u8]) -> Result<()> {
    let length = bytes.strip_prefix(b"glTF").and_then(|rest| rest.get(4..8)).map(LittleEndian::read_u32);
    match length {
        Some(length) if length < 12 => {
            Err(Error::input(path, format!("glTF: a file of {length} bytes, as its head says")))
        }
        _ => Ok(()),
    }
}

pub(super) fn read(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<Mesh> {
    check_glb_head(path, bytes)?;
    let _json = hold_json(path, bytes, access)?;
    // It may list as many faults as there are objects.
    let damaged =
        |e: gltf::Error| Error::input(path, format!("glTF: {}", e.to_string().chars().take(300).collect::<String>()));
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
    let document = file.document;
    let file = File { path, access, buffers: read_buffers(path, &document, file.blob, access)? };
    let nodes = mesh_nodes(path, &document)?;
    // Meshes may stand in many nodes and accessors in many primitives, so that the file's bytes do not bound what comes of them.
    let sizes: Vec<MeshSize> = document.meshes().map(|mesh| MeshSize::of(path, &mesh)).collect::<Result<_>>()?;
    let mut total = MeshSize::default();
    for index in nodes.iter().filter_map(|(node, _)| Some(node.mesh()?.index())) {
        total.add(&sizes[index]);
    }
    if total.primitives > MAX_PRIMITIVES {
        let count = total.primitives;
        return Err(Error::input(path, format!("glTF: {count} primitives, {MAX_PRIMITIVES} at most are read")));
    }
    let mut mesh = Mesh::default();
    charge(path, access, &mesh, total.vertices, total.triangles)?;
    for (part, to_world) in nodes.iter().filter_map(|(node, to_world)| Some((node.mesh()?, *to_world))) {
        for primitive in part.primitives() {
            append_primitive(&file, &describe(&part, &primitive), &primitive, to_world, &mut mesh)?;
        }
    }
    Ok(mesh)
}

/// Names the mesh and primitive that an error is about.
fn describe(mesh: &gltf::Mesh<'_>, primitive: &gltf::Primitive<'_>) -> String {
    format!("glTF: mesh {}, primitive {}", mesh.index(), primitive.index())
}

/// The nodes of the scene, from the first on and each before its children, with the transforms to the world.
fn mesh_nodes<'a>(path: &Path, document: &'a gltf::Document) -> Result<Vec<(gltf::Node<'a>, glam::DMat4)>> {
    let mut nodes = Vec::new();
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
        let children = stack.len();
        stack.extend(node.children().map(|child| (child, to_world)));
        stack[children..].reverse();
        nodes.push((node, to_world));
    }
    Ok(nodes)
}

/// Vertices and triangles that each instance of a mesh adds.
#[derive(Default)]
struct MeshSize {
    primitives: u64,
    vertices: u64,
    triangles: u64,
}

impl MeshSize {
    /// Checks the accessors of every primitive on the way.
    fn of(path: &Path, mesh: &gltf::Mesh<'_>) -> Result<Self> {
        let mut size = MeshSize::default();
        for primitive in mesh.primitives().filter(is_surface) {
            let count = |name: &str, accessor: Option<gltf::Accessor<'_>>| match accessor {
                Some(accessor) => check_accessor(name, &accessor)
                    .map(|()| Some(accessor.count() as u64))
                    .map_err(|e| Error::input(path, format!("{}, {name}: {e}", describe(mesh, &primitive)))),
                None => Ok(None),
            };
            let vertices = count("positions", primitive.get(&gltf::Semantic::Positions))?.unwrap_or(0);
            let corners = count("indices", primitive.indices())?.unwrap_or(vertices);
            let triangles = if primitive.mode() == gltf::mesh::Mode::Triangles { corners / 3 } else { corners };
            size.add(&MeshSize { primitives: 1, vertices, triangles });
        }
        Ok(size)
    }

    fn add(&mut self, other: &MeshSize) {
        self.primitives = self.primitives.saturating_add(other.primitives);
        self.vertices = self.vertices.saturating_add(other.vertices);
        self.triangles = self.triangles.saturating_add(other.triangles);
    }
}

/// Whether a primitive has triangles.
fn is_surface(primitive: &gltf::Primitive<'_>) -> bool {
    use gltf::mesh::Mode;
    matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
}

/// A file with the content of its buffers.
struct File<'a> {
    path: &'a Path,
    access: &'a FileAccess,
    buffers: Vec<Vec<u8>>,
}

/// The content of the buffers: the binary chunk, data URIs, and files in the folder of this one, which stay charged.
fn read_buffers(
    path: &Path,
    document: &gltf::Document,
    mut chunk: Option<Vec<u8>>,
    access: &FileAccess,
) -> Result<Vec<Vec<u8>>> {
    let folder = Folder::containing(path, access.allows_outside());
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let wrong = |message: String| Error::input(path, format!("glTF: buffer {}: {message}", buffer.index()));
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => chunk.take().ok_or_else(|| wrong("has no binary chunk".into()))?,
            gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                access.charge(path, "glTF buffer", uri.len() as u64)?;
                // Without a base nothing but data is read.
                gltf::buffer::Data::from_source(buffer.source(), None).map_err(|e| wrong(e.to_string()))?.0
            }
            gltf::buffer::Source::Uri(uri) => {
                access.read_bytes(&folder.resolve_uri(uri)?, "glTF buffer", u64::MAX)?.keep()
            }
        };
        if data.len() < buffer.length() {
            return Err(wrong(format!("{} bytes are stated, {} are there", buffer.length(), data.len())));
        }
        buffers.push(data);
    }
    Ok(buffers)
}

fn append_primitive(
    file: &File<'_>,
    what: &str,
    primitive: &gltf::Primitive<'_>,
    to_world: glam::DMat4,
    mesh: &mut Mesh,
) -> Result<()> {
    use gltf::mesh::Mode;
    let &File { path, access, ref buffers } = file;
    if !is_surface(primitive) {
        return Ok(());
    }
    let corners = primitive.indices().or_else(|| primitive.get(&gltf::Semantic::Positions)).map_or(0, |a| a.count());
    let _indices = access.reserve(path, "glTF indices", 4 * corners as u64)?;
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
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
    if stride < accessor.size() {
        return Err(format!("accessor {} has items of {} bytes every {stride}", accessor.index(), accessor.size()));
    }
    let needed = (accessor.count() as u128).saturating_sub(1) * stride as u128 + accessor.size() as u128;
    let end_in_view = accessor.offset() as u128 + needed;
    let view_end = view.offset() as u128 + view.length() as u128;
    if end_in_view > view.length() as u128 || view_end > view.buffer().length() as u128 {
        return Err(format!("accessor {} reaches past the end of its buffer", accessor.index()));
    }
    Ok(())
}
