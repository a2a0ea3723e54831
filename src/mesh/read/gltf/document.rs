//! The JSON of a glTF file, as far as it is about geometry.

use crate::error::{Error, Result};
use crate::input::{FileAccess, escaped};
use crate::limits::Reservation;
use serde_json::{Map, Value};
use std::path::Path;

/// Bytes that an object and a value of the JSON become at most: a node without members has 300, lists may have grown to twice their need, and for a
/// while everything is there twice.
const OBJECT_BYTES: u64 = 2048;
const VALUE_BYTES: u64 = 128;
/// Bytes of the JSON at most: a million nodes have some 100 MB.
const MAX_JSON_BYTES: usize = 256 << 20;

/// Extensions that change how positions and indices are stored, and are read.
const STORAGE: [&str; 3] = ["KHR_mesh_quantization", "EXT_meshopt_compression", "KHR_meshopt_compression"];
/// Parts of the names of extensions that geometry does not need.
const APPEARANCE: [&str; 8] =
    ["_materials_", "_texture_", "_lights_", "_animation_", "_xmp", "_audio", "_variants", "_image_"];

/// A buffer view whose content is compressed by meshoptimizer (EXT_meshopt_compression).
#[derive(Debug, Clone)]
pub(super) struct MeshoptView {
    pub buffer: usize,
    pub offset: usize,
    pub length: usize,
    pub stride: usize,
    pub count: usize,
    pub mode: String,
    pub filter: String,
}

/// Parsed JSON, its binary chunk, and what the extensions of geometry say.
pub(super) struct GeometryDocument<'a> {
    pub document: gltf::Document,
    pub chunk: Option<&'a [u8]>,
    /// By buffer view.
    pub compressed: Vec<Option<MeshoptView>>,
    /// Buffers that compressed views stand for, which may have no content.
    pub is_fallback: Vec<bool>,
    /// Names of the materials.
    pub material_names: Vec<Option<String>>,
    /// The material of each mesh's primitives.
    pub material_of: Vec<Vec<Option<usize>>>,
    _held: Reservation<'a>,
}

impl<'a> GeometryDocument<'a> {
    /// Parses a glTF or GLB file. What is not about geometry is left out before anything is checked.
    pub(super) fn parse(path: &Path, bytes: &'a [u8], access: &'a FileAccess) -> Result<Self> {
        let wrong = |message: String| Error::input(path, format!("glTF: {message}"));
        let (json, chunk) = split(bytes).map_err(wrong)?;
        if json.len() > MAX_JSON_BYTES {
            return Err(wrong(format!("{} bytes of JSON, {MAX_JSON_BYTES} at most are read", json.len())));
        }
        let held = hold_json(path, json, access)?;
        let mut root: Value = serde_json::from_slice(json).map_err(|e| wrong(e.to_string()))?;
        check_extensions(path, &root, access)?;
        let (compressed, is_fallback) = (compressed_views(path, &root)?, fallback_buffers(&root));
        let material_names = members(&root, "materials").map(|m| m["name"].as_str().map(str::to_owned)).collect();
        let material_of = primitive_materials(&root);
        keep_geometry(path, &mut root, access);
        let root: gltf::json::Root = serde_json::from_value(root).map_err(|e| wrong(e.to_string()))?;
        check_attributes(path, &root)?;
        // It may list as many faults as there are objects.
        let document =
            gltf::Document::from_json(root).map_err(|e| wrong(e.to_string().chars().take(300).collect::<String>()))?;
        Ok(GeometryDocument { document, chunk, compressed, is_fallback, material_names, material_of, _held: held })
    }
}

/// JSON and binary chunk of a GLB file; other files are JSON as a whole.
fn split(bytes: &[u8]) -> std::result::Result<(&[u8], Option<&[u8]>), String> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let number = |at: usize| bytes.get(at..at + 4).and_then(|four| Some(u32::from_le_bytes(*four.first_chunk()?)));
    let length = number(8).ok_or("a head of less than 12 bytes")? as usize;
    if number(4) != Some(2) {
        return Err(format!("a GLB file of version {}, 2 is read", number(4).unwrap_or(0)));
    }
    if length < 12 || length > bytes.len() {
        return Err(format!("a file of {length} bytes, as its head says; {} are there", bytes.len()));
    }
    let (mut at, mut json, mut binary) = (12, None, None);
    while let (Some(size), Some(kind)) = (number(at), bytes.get(at + 4..at + 8)) {
        let chunk = bytes.get(at + 8..).and_then(|rest| rest.get(..size as usize));
        let chunk = chunk.ok_or_else(|| format!("a chunk of {size} bytes reaches past the end of the file"))?;
        match kind {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
        at += 8 + chunk.len();
        if at >= length {
            break;
        }
    }
    Ok((json.ok_or("a GLB file without JSON")?, binary))
}

/// Charges what the parsers make of the JSON, for as long as they hold it.
fn hold_json<'a>(path: &Path, json: &[u8], access: &'a FileAccess) -> Result<Reservation<'a>> {
    let (mut objects, mut values) = (0, 0);
    for byte in json {
        objects += u64::from(*byte == b'{');
        values += u64::from(matches!(byte, b',' | b'['));
    }
    access.reserve(path, "glTF JSON", objects * OBJECT_BYTES + values * VALUE_BYTES + 4 * json.len() as u64)
}

/// Refuses files that need extensions which are not read.
fn check_extensions(path: &Path, root: &Value, access: &FileAccess) -> Result<()> {
    let wrong = |message: String| Error::input(path, format!("glTF: {message}"));
    let required = root["extensionsRequired"].as_array().into_iter().flatten().filter_map(Value::as_str);
    let mut primitives = members(root, "meshes").flat_map(|mesh| members(mesh, "primitives"));
    let draco = "KHR_draco_mesh_compression";
    // Where it is not required the same positions stand there uncompressed, too.
    let is_draco = primitives.any(|primitive| {
        let accessor = primitive["attributes"]["POSITION"].as_u64().and_then(|index| usize::try_from(index).ok());
        let is_empty = accessor.is_none_or(|index| root["accessors"][index]["bufferView"].is_null());
        is_empty && !primitive["extensions"][draco].is_null()
    });
    for name in required.chain(is_draco.then_some(draco)) {
        let said = escaped(name);
        if STORAGE.contains(&name) {
            continue;
        }
        if name == draco {
            return Err(wrong(format!("{draco} is not read; `gltf-transform copy IN.glb OUT.glb` decodes it")));
        }
        if APPEARANCE.iter().any(|part| name.contains(part)) {
            access.remark(path, format!("glTF: extension {said} is not needed for the mesh, and passed over"));
            continue;
        }
        return Err(wrong(format!("the file requires extension {said}, which is not read")));
    }
    Ok(())
}

fn members<'v>(value: &'v Value, key: &str) -> impl Iterator<Item = &'v Value> {
    value[key].as_array().into_iter().flatten()
}

fn members_mut<'v>(value: &'v mut Value, key: &str) -> impl Iterator<Item = &'v mut Map<String, Value>> {
    let list = value.get_mut(key).and_then(Value::as_array_mut);
    list.into_iter().flatten().filter_map(Value::as_object_mut)
}

/// The members of an object's extension of meshoptimizer.
fn meshopt(value: &Value) -> Option<&Map<String, Value>> {
    STORAGE[1..].iter().find_map(|name| value["extensions"][name].as_object())
}

fn compressed_views(path: &Path, root: &Value) -> Result<Vec<Option<MeshoptView>>> {
    let read = |(index, view): (usize, &Value)| {
        let Some(extension) = meshopt(view) else { return Ok(None) };
        let number = |key: &str, usual: Option<u64>| {
            let value = extension.get(key).map_or(usual, Value::as_u64).and_then(|value| usize::try_from(value).ok());
            value.ok_or_else(|| {
                Error::input(path, format!("glTF: bufferView {index}: {key} of its compression is no number"))
            })
        };
        let text = |key: &str| extension.get(key).and_then(Value::as_str).unwrap_or("NONE").to_owned();
        Ok(Some(MeshoptView {
            buffer: number("buffer", None)?,
            offset: number("byteOffset", Some(0))?,
            length: number("byteLength", None)?,
            stride: number("byteStride", None)?,
            count: number("count", None)?,
            mode: text("mode"),
            filter: text("filter"),
        }))
    };
    members(root, "bufferViews").enumerate().map(read).collect()
}

fn primitive_materials(root: &Value) -> Vec<Vec<Option<usize>>> {
    let of_primitive = |primitive: &Value| primitive["material"].as_u64().and_then(|index| usize::try_from(index).ok());
    members(root, "meshes").map(|mesh| members(mesh, "primitives").map(of_primitive).collect()).collect()
}

fn fallback_buffers(root: &Value) -> Vec<bool> {
    let is_fallback = |buffer: &Value| meshopt(buffer).is_some_and(|m| m.get("fallback") == Some(&Value::Bool(true)));
    members(root, "buffers").map(is_fallback).collect()
}

/// Takes out what is not geometry, so that neither its faults nor its extensions matter.
fn keep_geometry(path: &Path, root: &mut Value, access: &FileAccess) {
    let is_kept = |name: &str| ["POSITION", "JOINTS_0", "WEIGHTS_0"].contains(&name);
    for mesh in root.get_mut("meshes").and_then(Value::as_array_mut).into_iter().flatten() {
        let mut has_targets = false;
        for primitive in members_mut(mesh, "primitives") {
            if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
                attributes.retain(|name, _| is_kept(name));
            }
            has_targets |= primitive.contains_key("targets");
            primitive.retain(|key, _| ["attributes", "indices", "mode"].contains(&key.as_str()));
        }
        let weighs = members(mesh, "weights").any(|weight| weight.as_f64() != Some(0.0));
        if has_targets && weighs {
            access.remark(path, "glTF: morph targets have no effect: meshes are read as they are without");
        }
        if let Some(mesh) = mesh.as_object_mut() {
            mesh.retain(|key, _| key == "primitives");
        }
    }
    for node in members_mut(root, "nodes") {
        if node.get("extensions").is_some_and(|all| all.get("EXT_mesh_gpu_instancing").is_some()) {
            access.remark(path, "glTF: EXT_mesh_gpu_instancing is not read: each mesh is there once");
        }
        let kept = ["children", "matrix", "mesh", "rotation", "scale", "skin", "translation"];
        node.retain(|key, _| kept.contains(&key.as_str()));
    }
    for key in ["accessors", "bufferViews", "buffers", "scenes", "skins"] {
        for item in members_mut(root, key) {
            item.retain(|key, _| !["extensions", "extras", "name"].contains(&key.as_str()));
        }
    }
    if let Some(root) = root.as_object_mut() {
        let kept = ["accessors", "asset", "bufferViews", "buffers", "meshes", "nodes", "scene", "scenes", "skins"];
        root.retain(|key, _| kept.contains(&key.as_str()));
    }
}

/// The glTF crate's validation itself takes the index of the positions on trust.
fn check_attributes(path: &Path, root: &gltf::json::Root) -> Result<()> {
    for (mesh, part) in root.meshes.iter().enumerate() {
        let mut attributes = part.primitives.iter().flat_map(|primitive| primitive.attributes.values());
        if let Some(index) = attributes.find(|index| index.value() >= root.accessors.len()) {
            let index = index.value();
            return Err(Error::input(path, format!("glTF: mesh {mesh} names accessor {index}, which is not there")));
        }
    }
    Ok(())
}
