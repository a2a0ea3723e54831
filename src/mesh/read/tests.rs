use super::*;
use crate::mesh::*;

fn read_bytes(name: &str, bytes: &[u8]) -> Result<Mesh> {
    parse(name, bytes, &FileAccess::default())
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
fn strips_continued_lines_and_other_encodings() {
    let strips = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n\
        property list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1.5 0\n0 1 0\n0 0 1\n9 1 2 0 3 -1 0 1 1 4\n";
    let mesh = read_bytes("a.ply", strips.as_bytes()).unwrap();
    assert_eq!(mesh.positions, expected().positions);
    // The second strip's triangles have a corner twice.
    assert_eq!(mesh.triangles, [[1, 2, 0], [0, 2, 3]]);
    let mesh = read_bytes("a.ply", strips.replace("9 1 2 0 3 -1 0 1 1 4", "8 1 2 0 3 -1 0 1 4").as_bytes()).unwrap();
    assert_eq!(mesh.triangles, [[1, 2, 0], [0, 2, 3], [0, 1, 4]]);
    fault("a.ply", strips.replace("9 1 2 0 3 -1 0 1 1 4", "8 1 2 0 3 -1 0 1 7").as_bytes());

    let mut obj = b"# \x83\x5c\x83\x8b C:\\models\\\no \x94\xfc\nv 0 0 0\nv 1 \\\n0 0\nv 1 1.5 0\r\nv 0 1 \\\r\n 0\nv 0 0 1\nf 1 2 \\\n3 4\nf 1 2 5\n".to_vec();
    assert_eq!(read_bytes("a.obj", &obj).unwrap(), expected());
    obj.extend(b"f 1 2 6\n");
    assert!(fault("a.obj", &obj).contains("a face names vertex 6 of 5"));
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
    for far in ["1e13", "-2e30"] {
        let text = ASCII_PLY.replace("1 1.5 0 1", &format!("1 {far} 0 1"));
        assert!(fault("x.ply", text.as_bytes()).contains("vertex 2 is too far away"));
    }
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
    assert!(fault("x.obj", text.replace("f -5", "f -7").as_bytes()).contains("line 11, a face names vertex -7 of 5"));
    assert!(
        fault("x.obj", text.replace("v 1 1.5", "v 1 nan").as_bytes())
            .contains("line 4, vertex 3: a vertex is not finite")
    );
    assert!(fault("x.obj", text.replace("v 1 1.5", "v 1 up").as_bytes()).contains("line 4: position parse error"));
    // Twice this number would be that of a coordinate which is there.
    let far = format!("f 1/{0}/1 2/{0}/1 3/{0}/1", isize::MIN);
    let wraps = text.replace("f 1/1/1 2/1/1 3/1/1 4/1/1", &far).replace("vt 0 0", "vt 0 0\nvt 1 0");
    assert!(fault("x.obj", wraps.as_bytes()).contains("line 10: face texcoord index out of bounds"));
    let normals = text.replace("-1//1", "-1//-2");
    assert!(fault("x.obj", normals.as_bytes()).contains("line 11: face normal index out of bounds"));
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
    assert!(past.contains("mesh 0, primitive 0: indices: accessor 1 reaches past"), "{past}");
    let fewer = fault("x.glb", &glb(|json| json.replace("\"count\":5,", "\"count\":4,")));
    assert!(fewer.contains("index 8 names vertex 4, the primitive has 4"), "{fewer}");
    fault("x.glb", &glb(|json| json.replace("\"children\":[1]", "\"children\":[0]")));
    let mut whole = glb(|json| json);
    let length = std::mem::replace(&mut whole[8], 11);
    let rest = std::mem::replace(&mut whole[9], 0);
    assert!(fault("short.glb", &whole).contains("a file of 11 bytes, as its head says"));
    (whole[8], whole[9]) = (length, rest);
    for length in (0..whole.len()).step_by(7).chain([whole.len() - 1]) {
        fault("cut.glb", &whole[..length]);
    }
}

/// Bytes that stand at the end of the binary chunk, and a document that names them.
fn glb_with(document: serde_json::Value, data: &[u8]) -> Vec<u8> {
    let mut data = data.to_vec();
    data.resize(data.len().next_multiple_of(4), 0);
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = (28 + json.len() + data.len()) as u32;
    let chunk = |kind: &[u8; 4], content: &[u8]| [&(content.len() as u32).to_le_bytes()[..], kind, content].concat();
    [&b"glTF\x02\0\0\0"[..], &length.to_le_bytes(), &chunk(b"JSON", &json), &chunk(b"BIN\0", &data)].concat()
}

/// The quad and the triangle, their positions as shorts of 1/16384 under a node that gives them their size again.
fn quantised() -> (serde_json::Value, Vec<u8>) {
    let short = |v: &f32| (v * 8192.0) as i16;
    let mut data: Vec<u8> = Vec::new();
    for position in &expected().positions {
        position.iter().for_each(|v| data.extend(short(v).to_le_bytes()));
        data.extend([0; 2]);
    }
    data.extend(expected().triangles.iter().flatten().flat_map(|&v| (v as u16).to_le_bytes()));
    let scale = 32767.0 / 8192.0;
    let document = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "extensionsUsed": ["KHR_mesh_quantization", "KHR_texture_basisu"],
        "extensionsRequired": ["KHR_mesh_quantization", "KHR_texture_basisu"],
        "textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}],
        "nodes": [{"mesh": 0, "scale": [scale, scale, scale]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 7}, "indices": 1, "material": 3}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5122, "normalized": true, "count": 5, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 9, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 40, "byteStride": 8}, {"buffer": 0, "byteOffset": 40, "byteLength": 18}],
        "buffers": [{"byteLength": data.len()}],
    });
    (document, data)
}

fn assert_near(mesh: &Mesh) {
    assert_eq!(mesh.triangles, expected().triangles);
    for (found, expected) in mesh.positions.iter().flatten().zip(expected().positions.iter().flatten()) {
        assert!((found - expected).abs() < 1e-4, "{:?}", mesh.positions);
    }
}

#[test]
fn glb_quantised_sparse_and_compressed() {
    let (document, data) = quantised();
    let access = FileAccess::default();
    assert_near(&parse("a.glb", &glb_with(document.clone(), &data), &access).unwrap());
    let remarks = access.remarks();
    assert!(remarks.len() == 1 && remarks[0].contains("KHR_texture_basisu is not needed"), "{remarks:?}");

    // The third corner out of place, and put back by sparse values.
    let (mut sparse, mut moved) = (document.clone(), data.clone());
    let third = data[16..22].to_vec();
    moved[16..22].fill(0);
    moved.resize(60, 0);
    moved.extend([2, 0]);
    moved.extend(&third);
    sparse["bufferViews"]
        .as_array_mut()
        .unwrap()
        .push(serde_json::json!({"buffer": 0, "byteOffset": 60, "byteLength": 8}));
    sparse["accessors"][0]["sparse"] = serde_json::json!({"count": 1,
        "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 2, "byteOffset": 2}});
    sparse["buffers"][0]["byteLength"] = moved.len().into();
    assert_near(&read_bytes("a.glb", &glb_with(sparse, &moved)).unwrap());

    // meshoptimizer's streams, with a buffer that only has a size.
    let vertices: Vec<[u8; 8]> = data[..40].as_chunks().0.to_vec();
    let vertices = meshopt::encode_vertex_buffer_level(&vertices, 2, Some(0)).unwrap();
    let corners: Vec<u32> = expected().triangles.iter().flatten().copied().collect();
    let indices = meshopt::encode_index_buffer(&corners, 5).unwrap();
    let mut packed = document.clone();
    let view = |offset: usize, length: usize, stride: usize, count: usize, mode: &str| {
        serde_json::json!({"EXT_meshopt_compression": {"buffer": 0, "byteOffset": offset, "byteLength": length, "byteStride": stride,
            "count": count, "mode": mode}})
    };
    packed["extensionsRequired"][1] = "EXT_meshopt_compression".into();
    packed["bufferViews"][0]["extensions"] = view(0, vertices.len(), 8, 5, "ATTRIBUTES");
    packed["bufferViews"][1]["extensions"] = view(vertices.len(), indices.len(), 2, 9, "TRIANGLES");
    packed["bufferViews"].as_array_mut().unwrap().iter_mut().for_each(|view| view["buffer"] = 1.into());
    let streams = [vertices, indices].concat();
    packed["buffers"] = serde_json::json!([{"byteLength": streams.len()},
        {"byteLength": 58, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}]);
    let whole = glb_with(packed.clone(), &streams);
    let mesh = read_bytes("a.glb", &whole).unwrap();
    let sorted = |mesh: &Mesh| {
        // The codec may begin a triangle at another corner.
        let turned = |t: &[u32; 3]| (0..3).map(|k| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]).min().unwrap();
        mesh.triangles.iter().map(turned).collect::<Vec<_>>()
    };
    assert_eq!(sorted(&mesh), sorted(&expected()));
    for at in whole.len() - streams.len()..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x55;
        let _ = read_bytes("a.glb", &bytes);
    }
    packed["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]["count"] = 1_000_000_000.into();
    assert!(fault("a.glb", &glb_with(packed, &streams)).contains("bytes can't come of"));

    let mut draco = document.clone();
    draco["extensionsRequired"] = serde_json::json!(["KHR_draco_mesh_compression"]);
    let error = fault("a.glb", &glb_with(draco, &data));
    assert!(error.contains("KHR_draco_mesh_compression is not read; `gltf-transform copy"), "{error}");
    let mut other = document;
    other["extensionsRequired"][0] = "ACME_voxels".into();
    assert!(fault("a.glb", &glb_with(other, &data)).contains("requires extension ACME_voxels"));
}

#[test]
fn glb_with_a_skin_is_read_in_its_pose() {
    let mut data: Vec<u8> = expected().positions.iter().flatten().flat_map(|v| (v - 1.0).to_le_bytes()).collect();
    data.extend(expected().triangles.iter().flatten().flat_map(|&v| (v as u16).to_le_bytes()));
    data.resize(80, 0);
    // Half on the one joint, which stands at 2, 0, 0, half on the other at 0, 2, 2.
    (0..5).for_each(|_| data.extend([0, 1, 0, 0]));
    (0..5).for_each(|_| data.extend([255, 255, 0, 0]));
    let document = serde_json::json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {"translation": [2, 0, 0], "children": [2]}, {"translation": [-2, 2, 2]}],
        "skins": [{"joints": [1, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3", "min": [-1, -1, -1], "max": [0, 0.5, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 9, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5121, "count": 5, "type": "VEC4"},
            {"bufferView": 3, "componentType": 5121, "normalized": true, "count": 5, "type": "VEC4"}],
        "bufferViews": [{"buffer": 0, "byteLength": 60}, {"buffer": 0, "byteOffset": 60, "byteLength": 18},
            {"buffer": 0, "byteOffset": 80, "byteLength": 20}, {"buffer": 0, "byteOffset": 100, "byteLength": 20}],
        "buffers": [{"byteLength": data.len()}],
    });
    let access = FileAccess::default();
    assert_near(&parse("a.glb", &glb_with(document.clone(), &data), &access).unwrap());
    assert!(access.remarks()[0].contains("skin is taken in the pose"), "{:?}", access.remarks());
    // An accessor of which one value is there, the others zeros, claims more of them than could ever be read.
    let mut claims = document.clone();
    let view =
        |offset: usize, length: usize| serde_json::json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    claims["bufferViews"].as_array_mut().unwrap().extend([view(78, 1), view(0, 64)]);
    let sparse = serde_json::json!({"count": 1, "indices": {"bufferView": 4, "componentType": 5121}, "values": {"bufferView": 5}});
    let matrices = serde_json::json!({"componentType": 5126, "count": 1u64 << 60, "type": "MAT4", "sparse": sparse});
    claims["accessors"].as_array_mut().unwrap().push(matrices);
    claims["skins"][0]["inverseBindMatrices"] = 4.into();
    assert!(read_bytes("a.glb", &glb_with(claims, &data)).is_ok());
    // One skin of many joints, of many nodes.
    let mut many = document.clone();
    many["skins"][0]["joints"] = vec![5_002; 20_000].into();
    let nodes = many["nodes"].as_array_mut().unwrap();
    nodes.extend((0..5_000).map(|_| serde_json::json!({"mesh": 0, "skin": 0})));
    many["scenes"][0]["nodes"] = [0, 1].into_iter().chain(3..5_003).collect::<Vec<_>>().into();
    assert_eq!(read_bytes("a.glb", &glb_with(many, &data)).unwrap().positions.len(), 5 * 5_001);
    data[81] = 7;
    assert!(fault("a.glb", &glb_with(document, &data)).contains("vertex 0 hangs on joint 7 of 2"));
}

#[test]
fn shared_meshes_read() {
    let root = std::env::var_os("TSUYA_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), Into::into);
    let figures = [("Duck.glb", 4212), ("spot.obj", 5856), ("spot_triangulated.obj", 5856), ("bunny_lowres.ply", 948)];
    for (name, triangles) in figures {
        let path = root.join("meshes").join(name);
        if !path.exists() {
            println!("skipped: {} is not there", path.display());
            continue;
        }
        let mesh = read(&path, &FileAccess::default()).unwrap();
        assert_eq!(mesh.triangles.len(), triangles, "{name}");
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let files = [("a.glb", glb(|json| json)), ("a.ply", binary_ply(false)), ("b.ply", ASCII_PLY.as_bytes().to_vec())];
    for (name, whole) in files {
        for at in 0..whole.len() {
            for value in [0, b'9', 0xff, whole[at] ^ 1] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                if let Ok(mesh) = parse(name, &bytes, &FileAccess::default()) {
                    crate::mesh::clean::clean(mesh);
                }
            }
        }
    }
}

#[test]
fn texture_coordinates_are_those_of_obj_files() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    // By its content a PLY, with text behind its faces that reads as OBJ.
    let both = format!("{ASCII_PLY}\n{obj}");
    for (name, text, count) in [("a.obj", obj, 1), ("b.obj", &both, 0), ("c.ply", &both, 0)] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        assert_eq!(texture_coordinates(&path, &FileAccess::default()).unwrap().len(), count, "{name}");
    }
}
