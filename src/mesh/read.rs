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
    if bytes.is_empty() {
        return Err(Error::input(path, "the mesh file is empty (0 bytes)"));
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let mesh = if bytes.starts_with(b"ply") {
        read_ply(path, &bytes)
    } else if bytes.starts_with(b"glTF") || extension == "gltf" {
        read_gltf(path, &bytes)
    } else if extension == "obj" {
        read_obj(path, &bytes)
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
        check_accessor(accessor).map_err(|e| Error::input(path, format!("{what}, {name}: {e}")))?;
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

/// Whether an accessor stays inside its view and the view inside its buffer, which the glTF crate takes on trust.
fn check_accessor(accessor: &gltf::Accessor<'_>) -> std::result::Result<(), String> {
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
mod tests {
    use super::*;
    use std::fs;

    fn write(name: &str, bytes: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    fn read_bytes(name: &str, bytes: &[u8]) -> Result<Mesh> {
        let (_folder, path) = write(name, bytes);
        read(&path)
    }

    fn fault(name: &str, bytes: &[u8]) -> String {
        let error = read_bytes(name, bytes).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
        error
    }

    /// A quad and a triangle.
    fn expected() -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 1, 4]],
        }
    }

    const ASCII_PLY: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 5\nproperty double x\nproperty double y\n\
        property double z\nproperty uchar red\nelement face 2\nproperty list uchar uint vertex_index\nelement edge 1\n\
        property int vertex1\nend_header\n0 0 0 1\n1 0 0 1\n1 1.5 0 1\n0 1 0 1\n0 0 1 1\n4 0 1 2 3\n3 0 1 4\n7\n";

    fn binary_ply(big: bool) -> Vec<u8> {
        let order = if big { "big" } else { "little" };
        let mut bytes = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
             element face 2\nproperty list uchar int vertex_indices\nend_header\n"
        )
        .into_bytes();
        let four = |v: [u8; 4]| if big { v.into_iter().rev().collect::<Vec<_>>() } else { v.to_vec() };
        expected().positions.iter().flatten().for_each(|v| bytes.extend(four(v.to_le_bytes())));
        for face in [&[0i32, 1, 2, 3][..], &[0, 1, 4]] {
            bytes.push(face.len() as u8);
            face.iter().for_each(|v| bytes.extend(four(v.to_le_bytes())));
        }
        bytes
    }

    #[test]
    fn ply_of_every_encoding() {
        assert_eq!(read_bytes("a.ply", ASCII_PLY.as_bytes()).unwrap(), expected());
        assert_eq!(read_bytes("a.ply", &binary_ply(false)).unwrap(), expected());
        assert_eq!(read_bytes("a.ply", &binary_ply(true)).unwrap(), expected());
        let whole = binary_ply(false);
        for length in 0..whole.len() {
            let error = fault("cut.ply", &whole[..length]);
            assert!(!error.is_empty());
        }
        let cut = fault("cut.ply", &whole[..whole.len() - 1]);
        assert!(cut.contains("PLY element 'face' of 2"), "{cut}");
        let text = ASCII_PLY.replace("3 0 1 4", "3 0 1 5");
        assert!(fault("x.ply", text.as_bytes()).contains("face 1 names vertex 5, the mesh has 5"));
        let text = ASCII_PLY.replace("1 1.5 0 1", "1 nan 0 1");
        let error = fault("x.ply", text.as_bytes());
        assert!(error.contains("line 16") || error.contains("Line 16"), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
        let mut not_finite = whole.clone();
        let third = whole.windows(11).position(|w| w == b"end_header\n").unwrap() + 11 + 2 * 12;
        not_finite[third..third + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(fault("x.ply", &not_finite).contains("vertex 2 is not finite: (NaN, 1.5, 0)"));
        let text = ASCII_PLY.replace("3 0 1 4", "3 0 -1 4");
        fault("x.ply", text.as_bytes());
        let text = ASCII_PLY.replace("element vertex 5", "element vertex 4000000000");
        fault("x.ply", text.as_bytes());
        let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
            end_header\n1 2 3\n";
        assert!(fault("points.ply", points.as_bytes()).contains("no triangle"));
    }

    #[test]
    fn obj_with_objects_polygons_and_faults() {
        let text = "mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 1 1.5 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvn 0 0 1\n\
            f 1/1/1 2/1/1 3/1/1 4/1/1\nl 1 2\nf -5//1 -4//1 -1//1\n";
        assert_eq!(read_bytes("a.obj", text.as_bytes()).unwrap(), expected());
        let two = text.replace("l 1 2", "o second");
        let mesh = crate::mesh::clean::clean(read_bytes("a.obj", two.as_bytes()).unwrap()).0;
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (5, 3));
        assert!(fault("x.obj", text.replace("f -5", "f 9").as_bytes()).contains("line 11, a face names vertex 9 of 5"));
        assert!(
            fault("x.obj", text.replace("f -5", "f -7").as_bytes()).contains("line 11, a face names vertex -7 of 5")
        );
        assert!(
            fault("x.obj", text.replace("v 1 1.5", "v 1 nan").as_bytes())
                .contains("line 4, vertex 3: a vertex is not finite")
        );
        assert!(fault("x.obj", text.replace("v 1 1.5", "v 1 up").as_bytes()).contains("line 4: position parse error"));
        assert!(fault("x.obj", b"v 0 0 0\n").contains("no triangle"));
        assert!(fault("x.obj", b"").contains("empty"));
        assert!(fault("x.stl", b"solid").contains("not a mesh"));
    }

    /// The quad-and-triangle as a GLB under a node that doubles and shifts, with a mirrored child.
    fn glb(json_edit: impl Fn(String) -> String) -> Vec<u8> {
        let mut data: Vec<u8> = expected().positions.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        expected().triangles.iter().flatten().for_each(|&v| data.extend((v as u16).to_le_bytes()));
        data.resize(data.len().next_multiple_of(4), 0);
        let json = json_edit(format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
            "nodes":[{{"mesh":0,"scale":[2,2,2],"translation":[1,0,0],"children":[1]}},{{"mesh":0,"scale":[-1,1,1]}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3","min":[0,0,0],"max":[1,1.5,1]}},
              {{"bufferView":1,"componentType":5123,"count":9,"type":"SCALAR"}}],
            "bufferViews":[{{"buffer":0,"byteLength":60}},{{"buffer":0,"byteOffset":60,"byteLength":18}}],
            "buffers":[{{"byteLength":{}}}]}}"#,
            data.len()
        ));
        let mut json = json.into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut glb = b"glTF".to_vec();
        glb.extend(2u32.to_le_bytes());
        glb.extend((28 + json.len() as u32 + data.len() as u32).to_le_bytes());
        glb.extend((json.len() as u32).to_le_bytes().iter().chain(b"JSON").chain(&json));
        glb.extend((data.len() as u32).to_le_bytes().iter().chain(b"BIN\0").chain(&data));
        glb
    }

    #[test]
    fn glb_with_transforms_and_faults() {
        let mesh = read_bytes("a.glb", &glb(|json| json)).unwrap();
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (10, 6));
        assert_eq!(mesh.positions[2], [3.0, 3.0, 0.0]);
        assert_eq!(mesh.positions[7], [-1.0, 3.0, 0.0]);
        assert_eq!(mesh.triangles[..4], [[0, 1, 2], [0, 2, 3], [0, 1, 4], [5, 7, 6]]);
        let past = fault("x.glb", &glb(|json| json.replace("\"count\":9", "\"count\":12")));
        assert!(past.contains("mesh 0, primitive 0, indices: accessor 1 reaches past"), "{past}");
        let fewer = fault("x.glb", &glb(|json| json.replace("\"count\":5,", "\"count\":4,")));
        assert!(fewer.contains("index 8 names vertex 4, the primitive has 4"), "{fewer}");
        fault("x.glb", &glb(|json| json.replace("\"children\":[1]", "\"children\":[0]")));
        let whole = glb(|json| json);
        for length in (0..whole.len()).step_by(7).chain([whole.len() - 1]) {
            fault("cut.glb", &whole[..length]);
        }
    }

    #[test]
    fn shared_meshes_read() {
        let root = std::env::var_os("TSUYA_DATA")
            .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), Into::into);
        let figures =
            [("Duck.glb", 4212), ("spot.obj", 5856), ("spot_triangulated.obj", 5856), ("bunny_lowres.ply", 948)];
        for (name, triangles) in figures {
            let path = root.join("meshes").join(name);
            if !path.exists() {
                println!("skipped: {} is not there", path.display());
                continue;
            }
            let mesh = read(&path).unwrap();
            assert_eq!(mesh.triangles.len(), triangles, "{name}");
        }
    }
}
