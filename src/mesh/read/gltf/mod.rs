//! glTF and GLB, as far as it is triangles: plain, quantised or compressed by meshoptimizer; meshes with skins in the pose that the nodes have.

mod accessor;
mod document;
mod meshopt;
mod skin;

use super::groups::material_names;
use super::{PreciseMesh, charge};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use accessor::{AccessorUse, BufferContent, check_type};
use document::GeometryDocument;
use glam::{DMat4, DVec3};
use skin::Skinning;
use std::collections::BTreeMap;
use std::path::Path;

/// Primitives at most, those of a mesh counted for each node that it stands in.
const MAX_PRIMITIVES: u64 = 1 << 20;

pub(super) fn read(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<PreciseMesh> {
    let file = GeometryDocument::parse(path, bytes, access)?;
    let document = &file.document;
    // Meshes may stand in many nodes and accessors in many primitives, so that the file's bytes do not bound what comes of them.
    let sizes: Vec<MeshSize> = document.meshes().map(|mesh| MeshSize::of(path, &mesh)).collect::<Result<_>>()?;
    let nodes = scene_nodes(path, document)?;
    let mut total = MeshSize::default();
    for index in nodes.iter().filter_map(|(node, _)| Some(node.mesh()?.index())) {
        total.add(&sizes[index]);
    }
    if total.primitives > MAX_PRIMITIVES {
        let count = total.primitives;
        return Err(Error::input(path, format!("glTF: {count} primitives, {MAX_PRIMITIVES} at most are read")));
    }
    let content = BufferContent::read(path, &file, access)?;
    let mut mesh = PreciseMesh::default();
    charge(path, access, &mesh, total.vertices, total.triangles)?;
    let mut transforms = vec![None; document.nodes().count()];
    nodes.iter().for_each(|(node, to_world)| transforms[node.index()] = Some(*to_world));
    let names = material_names(file.material_names.iter().map(Option::as_deref));
    let groups: Vec<usize> = names.iter().map(|name| mesh.groups.place(name)).collect();
    // A skin may be that of many nodes.
    let mut skins: BTreeMap<usize, Skinning> = BTreeMap::new();
    for (node, to_world) in &nodes {
        let Some(part) = node.mesh() else { continue };
        if let Some(skin) = node.skin().filter(|skin| !skins.contains_key(&skin.index())) {
            access.remark(path, "glTF: a mesh with a skin is taken in the pose that its joints have in the file");
            skins.insert(skin.index(), Skinning::read(&content, &skin, &transforms)?);
        }
        let skin = node.skin().and_then(|skin| skins.get(&skin.index()));
        for primitive in part.primitives().filter(is_surface) {
            let what = describe(&part, &primitive);
            let material = file.material_of.get(part.index()).and_then(|all| *all.get(primitive.index())?);
            mesh.groups.begin(mesh.triangles.len(), material.and_then(|material| groups.get(material).copied()));
            append_primitive(&content, access, &primitive, *to_world, skin, &mut mesh)
                .map_err(|message| Error::input(path, format!("{what}: {message}")))?;
        }
    }
    Ok(mesh)
}

/// Names the mesh and primitive that an error is about.
fn describe(mesh: &gltf::Mesh<'_>, primitive: &gltf::Primitive<'_>) -> String {
    format!("glTF: mesh {}, primitive {}", mesh.index(), primitive.index())
}

/// The nodes of the scene, from the first on and each before its children, with the transforms to the world.
fn scene_nodes<'a>(path: &Path, document: &'a gltf::Document) -> Result<Vec<(gltf::Node<'a>, DMat4)>> {
    let mut nodes = Vec::new();
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let Some(scene) = scene else {
        return Err(Error::input(path, "glTF: the file has no scene"));
    };
    // A node with two parents is invalid, but must not multiply the work.
    let mut visited = vec![false; document.nodes().count()];
    let mut stack: Vec<_> = scene.nodes().map(|n| (n, DMat4::IDENTITY)).collect();
    stack.reverse();
    while let Some((node, parent)) = stack.pop() {
        if std::mem::replace(&mut visited[node.index()], true) {
            return Err(Error::input(path, format!("glTF: node {} has two parents", node.index())));
        }
        let local = node.transform().matrix().map(|column| column.map(f64::from));
        let to_world = parent * DMat4::from_cols_array_2d(&local);
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
    /// Checks the types of every primitive's accessors on the way.
    fn of(path: &Path, mesh: &gltf::Mesh<'_>) -> Result<Self> {
        let mut size = MeshSize::default();
        for primitive in mesh.primitives().filter(is_surface) {
            let count = |used: AccessorUse, accessor: Option<gltf::Accessor<'_>>| match accessor {
                Some(accessor) => check_type(used, &accessor)
                    .map(|()| Some(accessor.count() as u64))
                    .map_err(|e| Error::input(path, format!("{}: {e}", describe(mesh, &primitive)))),
                None => Ok(None),
            };
            let positions = primitive.get(&gltf::Semantic::Positions);
            let vertices = count(AccessorUse::Positions, positions)?.unwrap_or(0);
            let corners = count(AccessorUse::Indices, primitive.indices())?.unwrap_or(vertices);
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

/// Returns `true` if a primitive has triangles.
fn is_surface(primitive: &gltf::Primitive<'_>) -> bool {
    use gltf::mesh::Mode;
    matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
}

fn append_primitive(
    content: &BufferContent<'_>,
    access: &FileAccess,
    primitive: &gltf::Primitive<'_>,
    to_world: DMat4,
    skin: Option<&Skinning>,
    mesh: &mut PreciseMesh,
) -> std::result::Result<(), String> {
    use gltf::mesh::Mode;
    let Some(positions) = primitive.get(&gltf::Semantic::Positions) else {
        return Err("no positions".into());
    };
    let corners = primitive.indices().map_or(positions.count(), |indices| indices.count());
    let charged = access.reserve(content.path, "glTF indices", 4 * corners as u64);
    let _indices = charged.map_err(|e| e.to_string())?;
    let offset = mesh.positions.len();
    let count = positions.count();
    mesh.positions.resize(offset + count, [0.0; 3]);
    content.each(&positions, count, |k, p| mesh.positions[offset + k] = p).map_err(|e| format!("positions: {e}"))?;
    let placed = &mut mesh.positions[offset..];
    match skin {
        // The node itself does not move a mesh with a skin (glTF 2.0, 3.7.3.3).
        Some(skin) => skin.place(content, primitive, placed)?,
        None => placed.iter_mut().for_each(|p| *p = to_world.transform_point3(DVec3::from_array(*p)).to_array()),
    }
    let mut indices: Vec<u32> = Vec::with_capacity(corners);
    match primitive.indices() {
        Some(accessor) => {
            indices.resize(corners, 0);
            content
                .each(&accessor, corners, |k, [index]| indices[k] = index as u32)
                .map_err(|e| format!("indices: {e}"))?;
        }
        None => indices.extend(0..count as u32),
    }
    if let Some((at, index)) = indices.iter().enumerate().find(|&(_, &v)| v as usize >= count) {
        return Err(format!("index {at} names vertex {index}, the primitive has {count}"));
    }
    let offset = offset as u32;
    let mirrored = skin.is_none() && to_world.determinant() < 0.0;
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
