//! Moving a stream out of a document and into it.

use super::appearance::{Appearance, StreamSource, appearances, bound_materials, extension};
use super::binding::MaterialBinding;
use super::document::{ExternalFiles, GltfDocument};
use super::{EXTENSION, EXTENSION_VERSION, MIME_TYPE};
use crate::error::{Error, Result};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// SHA-256 as 64 lower-case hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A stream that was found in a document.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtractedStream {
    /// The stream.
    pub stream: Vec<u8>,
    /// Its entry in the document.
    pub appearance: Appearance,
    /// Materials that are bound to it.
    pub materials: Vec<usize>,
    /// Binding of the first of them.
    pub binding: MaterialBinding,
}

/// Extracts the stream of the appearance with this index. Compares length and SHA-256 with those that the document states; the
/// content is not checked.
pub fn extract(document: &GltfDocument, index: usize, files: ExternalFiles<'_>) -> Result<ExtractedStream> {
    let mut all = appearances(document)?;
    if all.is_empty() {
        return Err(document.wrong(no_appearance(document)));
    }
    if index >= all.len() {
        let count = all.len();
        return Err(Error::parameter(format!("{}: appearance {index} is not there, {count} are", document.name())));
    }
    let appearance = all.swap_remove(index);
    let stream = match &appearance.source {
        StreamSource::View(view) => document.view(*view, files)?.into_owned(),
        StreamSource::Uri(uri) => files(&document.check_uri(uri)?)?,
        StreamSource::Foreign(mime) => {
            let message = format!("{}: appearance {index} is of type {mime:?}", document.name());
            return Err(Error::Unsupported(format!("{message}, only {MIME_TYPE} is read")));
        }
    };
    let wrong = |message: String| Err(document.wrong(format!("{EXTENSION}: appearance {index}: {message}")));
    if let Some(&length) = appearance.levels.last()
        && length != stream.len() as u64
    {
        return wrong(format!("levels end at {length} bytes, the stream has {}: cut or replaced", stream.len()));
    }
    let found = sha256(&stream);
    if let Some(stated) = appearance.sha256.as_ref().filter(|stated| **stated != found) {
        return wrong(format!("the stream is damaged or another one: its SHA-256 is {found}, {stated} is stated"));
    }
    let materials = bound_materials(document, index);
    let link = materials.first().and_then(|&m| extension(document.list("materials").get(m)?.as_object()?));
    let binding = link.map(MaterialBinding::from_texture_info).unwrap_or_default();
    Ok(ExtractedStream { stream, appearance, materials, binding })
}

/// Whether a document had an appearance that another program dropped: the `extras` of its materials tell.
pub fn has_lost_appearance(document: &GltfDocument) -> bool {
    let trace = |material: &Value| material.get("extras").is_some_and(|extras| extras.get(EXTENSION).is_some());
    extension(&document.json).is_none() && document.list("materials").iter().any(trace)
}

/// Error message for a document without an appearance.
fn no_appearance(document: &GltfDocument) -> String {
    if has_lost_appearance(document) {
        format!("the stream of {EXTENSION} was dropped by another program; put it back with `gltf::inject`")
    } else {
        format!("the document has no {EXTENSION}")
    }
}

/// The material that a stream belongs to: the one named or numbered by `wanted`; else the one whose `extras` repeat the stream's SHA-256;
/// else the only one whose `extras` have the extension's trace, or that is still bound; else the only one.
pub fn find_material(document: &GltfDocument, stream_sha256: &str, wanted: Option<&str>) -> Result<usize> {
    let materials = document.list("materials");
    let name = |index: &usize| materials[*index].get("name").and_then(Value::as_str);
    let all: Vec<usize> = (0..materials.len()).collect();
    if let Some(wanted) = wanted {
        let named: Vec<usize> = all.iter().copied().filter(|index| name(index) == Some(wanted)).collect();
        return match (named.as_slice(), wanted.parse::<usize>()) {
            ([one], _) => Ok(*one),
            ([], Ok(index)) if index < materials.len() => Ok(index),
            ([], _) => Err(Error::parameter(format!("no material is called {wanted:?}{}", listed(document)))),
            _ => Err(Error::parameter(format!("{} materials are called {wanted:?}; give the number", named.len()))),
        };
    }
    let trace = |index: &usize| materials[*index].get("extras").and_then(|extras| extras.get(EXTENSION));
    let own = |index: &usize| trace(index).and_then(|t| t.get("sha256")?.as_str()) == Some(stream_sha256);
    let bound = |index: &usize| trace(index).is_some() || materials[*index].as_object().and_then(extension).is_some();
    let tests: [&dyn Fn(&usize) -> bool; 3] = [&own, &bound, &|_| true];
    for test in tests {
        let found: Vec<usize> = all.iter().copied().filter(|index| test(index)).collect();
        if let [one] = found.as_slice() {
            return Ok(*one);
        }
    }
    let message = format!("which material shall carry the stream? Give its name or number{}", listed(document));
    Err(Error::parameter(message))
}

/// The materials' names for a message.
fn listed(document: &GltfDocument) -> String {
    let materials = document.list("materials");
    if materials.is_empty() {
        return "; the document has no material".into();
    }
    let one = |(index, material): (usize, &Value)| match material.get("name").and_then(Value::as_str) {
        Some(name) => format!("{index} {name:?}"),
        None => index.to_string(),
    };
    let mut names: Vec<String> = materials.iter().enumerate().take(12).map(one).collect();
    if materials.len() > names.len() {
        names.push("...".into());
    }
    format!("; the document has {}", names.join(", "))
}

/// Binds a stream to a material: in the binary chunk, or by reference where `uri` is given (already escaped). A stream that was bound to
/// the material before is replaced. Returns the
/// appearance's index and how the material is bound to it.
pub fn inject(
    document: &mut GltfDocument,
    material: usize,
    stream: &[u8],
    levels: Vec<u64>,
    uri: Option<&str>,
) -> Result<(usize, MaterialBinding)> {
    if material >= document.list("materials").len() {
        return Err(Error::parameter(format!("material {material} is not there{}", listed(document))));
    }
    appearances(document)?;
    let before = document.list("materials")[material].as_object().and_then(extension);
    let (place, kept) = match before
        .and_then(|link| Some((link.get("appearance")?.as_u64()?, MaterialBinding::from_texture_info(link))))
    {
        Some((index, binding)) => {
            (usize::try_from(index).ok().filter(|&i| i < appearances(document).map_or(0, |a| a.len())), Some(binding))
        }
        None => (None, None),
    };
    if let Some(index) = place {
        drop_view(document, index)?;
    }
    let source = match uri {
        Some(uri) => StreamSource::Uri(uri.into()),
        None => StreamSource::View(push_view(document, stream, None)?),
    };
    let sha256 = sha256(stream);
    let appearance = Appearance { source, levels, sha256: Some(sha256.clone()) }.to_json();
    // The extension's objects may have members of others: only what is ours is set.
    let wrong = document.wrong("extensions and materials must be objects, extensionsUsed an array");
    let write = |document: &mut GltfDocument| -> Option<(usize, MaterialBinding)> {
        let root = child(&mut document.json, "extensions")?;
        let root = child(root, EXTENSION)?;
        root.insert("version".into(), json!(EXTENSION_VERSION));
        let list = root.entry("appearances").or_insert_with(|| json!([])).as_array_mut()?;
        let index = match place {
            Some(index) => {
                let entry = list.get_mut(index)?.as_object_mut()?;
                ["bufferView", "uri", "mimeType", "levels", "sha256"]
                    .iter()
                    .for_each(|key| drop(entry.shift_remove(*key)));
                entry.extend(appearance.as_object()?.clone());
                index
            }
            None => {
                list.push(appearance);
                list.len() - 1
            }
        };
        let material = document.json.get_mut("materials")?.get_mut(material)?.as_object_mut()?;
        let binding = kept.unwrap_or_else(|| fallback_binding(material));
        let link = child(child(material, "extensions")?, EXTENSION)?;
        link.insert("appearance".into(), json!(index));
        link.extend(binding.info.clone());
        // Extras of others may be anything.
        if let Some(trace) = child(material, "extras").and_then(|extras| child(extras, EXTENSION)) {
            trace.insert("appearance".into(), json!(index));
            trace.insert("sha256".into(), json!(sha256));
        }
        let used = document.json.entry("extensionsUsed").or_insert_with(|| json!([])).as_array_mut()?;
        let mut names = vec![EXTENSION];
        names.extend(binding.texture_transform().is_some().then_some("KHR_texture_transform"));
        for name in names {
            if !used.iter().any(|known| known == name) {
                used.push(json!(name));
            }
        }
        Some((index, binding))
    };
    write(document).ok_or(wrong)
}

/// Returns the object under a key, added if there is none; `None` if something else is there.
fn child<'a>(object: &'a mut Map<String, Value>, key: &str) -> Option<&'a mut Map<String, Value>> {
    object.entry(key).or_insert_with(|| json!({})).as_object_mut()
}

/// The fallback's textures lie on the stream's atlas: where a tool moved them, the stream moves along.
fn fallback_binding(material: &Map<String, Value>) -> MaterialBinding {
    let pbr = material.get("pbrMetallicRoughness").and_then(Value::as_object);
    let places = [(pbr, "baseColorTexture"), (pbr, "metallicRoughnessTexture"), (Some(material), "emissiveTexture")];
    let info = places.into_iter().find_map(|(of, key)| of?.get(key)?.as_object());
    info.map(MaterialBinding::from_texture_info).unwrap_or_default()
}

/// Strips a document of everything of the extension, the traces in `extras` too. The stream's bytes go where they lie at the end of
/// the binary chunk, as this program writes them; elsewhere their bufferView stays, unused, so that nothing else moves.
pub fn strip(document: &mut GltfDocument) -> Result<()> {
    for index in (0..appearances(document)?.len()).rev() {
        drop_view(document, index)?;
    }
    let drop_from = |object: &mut Map<String, Value>, key: &str| {
        if let Some(Value::Object(inner)) = object.get_mut(key) {
            inner.shift_remove(EXTENSION);
            if inner.is_empty() {
                object.shift_remove(key);
            }
        }
    };
    drop_from(&mut document.json, "extensions");
    if let Some(Value::Array(materials)) = document.json.get_mut("materials") {
        for material in materials.iter_mut().filter_map(Value::as_object_mut) {
            drop_from(material, "extensions");
            drop_from(material, "extras");
        }
    }
    if let Some(Value::Array(used)) = document.json.get_mut("extensionsUsed") {
        used.retain(|name| name != EXTENSION);
        if used.is_empty() {
            document.json.shift_remove("extensionsUsed");
        }
    }
    Ok(())
}

/// Appends bytes to the binary chunk and a bufferView for them; returns its index. Aligned to 4 bytes.
pub(super) fn push_view(document: &mut GltfDocument, bytes: &[u8], target: Option<u64>) -> Result<u64> {
    if !document.is_glb() {
        return Err(Error::parameter("only a GLB holds the stream itself; with .gltf it lies beside the document"));
    }
    let buffers = document.list_mut("buffers")?;
    let own = buffers.first().is_none_or(|buffer| buffer.get("uri").is_none());
    if buffers.is_empty() {
        buffers.push(json!({"byteLength": 0}));
    }
    let stated = buffers.first().and_then(|buffer| buffer.get("byteLength")?.as_u64());
    if !own {
        return Err(document.wrong("buffer 0 is not the GLB's binary chunk; put the stream beside the document"));
    }
    let binary = document.binary.get_or_insert_default();
    let Some(stated) = stated.filter(|&stated| stated <= binary.len() as u64) else {
        return Err(document.wrong("buffer 0 is longer than the binary chunk"));
    };
    // The chunk may be padded beyond the buffer.
    binary.truncate(stated as usize);
    binary.resize(binary.len().next_multiple_of(4), 0);
    let offset = binary.len();
    binary.extend(bytes);
    let length = binary.len();
    if let Some(Value::Object(buffer)) = document.list_mut("buffers")?.first_mut() {
        buffer.insert("byteLength".into(), json!(length));
    }
    let mut view = json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()});
    if let (Some(target), Some(view)) = (target, view.as_object_mut()) {
        view.insert("target".into(), json!(target));
    }
    let views = document.list_mut("bufferViews")?;
    views.push(view);
    Ok(views.len() as u64 - 1)
}

/// Removes the bufferView of an appearance if it is the last one, of the last bytes, and of this appearance alone.
fn drop_view(document: &mut GltfDocument, index: usize) -> Result<()> {
    let all = appearances(document)?;
    let Some(StreamSource::View(view)) = all.get(index).map(|appearance| &appearance.source) else { return Ok(()) };
    let shared = all.iter().filter(|other| other.source == StreamSource::View(*view)).count() > 1;
    let views = document.list("bufferViews");
    let number = |of: &Value, key: &str| of.get(key).map_or(Some(0), Value::as_u64);
    let range = |view: &Value| {
        let (buffer, offset, length) =
            (number(view, "buffer")?, number(view, "byteOffset")?, number(view, "byteLength")?);
        Some((buffer, offset, offset.checked_add(length)?))
    };
    let last = views.len().checked_sub(1).filter(|&last| last as u64 == *view && !shared && document.is_glb());
    let Some((0, start, end)) = last.and_then(|last| range(&views[last])) else { return Ok(()) };
    // Another view's compressed data may lie anywhere.
    let compressed = |view: &Value| view.get("extensions").is_some();
    let ends_before = |view: &Value| range(view).is_some_and(|(b, _, e)| b != 0 || e <= start) && !compressed(view);
    if start == 0 && (views.len() > 1 || document.list("buffers").len() > 1) {
        return Ok(());
    }
    let at_end = document.list("buffers").first().and_then(|b| b.get("byteLength")?.as_u64()) == Some(end);
    let used_elsewhere =
        |key: &str| document.list(key).iter().any(|o| o.get("bufferView").and_then(Value::as_u64) == Some(*view));
    if !at_end
        || !views[..views.len() - 1].iter().all(ends_before)
        || used_elsewhere("accessors")
        || used_elsewhere("images")
    {
        return Ok(());
    }
    let Some(binary) = document.binary.as_mut().filter(|binary| start < end && end <= binary.len() as u64) else {
        return Ok(());
    };
    binary.truncate(start as usize);
    document.list_mut("bufferViews")?.pop();
    if start == 0 {
        // Nothing else had a bufferView.
        document.binary = None;
        document.json.shift_remove("bufferViews");
        document.json.shift_remove("buffers");
    } else if let Some(Value::Object(buffer)) = document.list_mut("buffers")?.first_mut() {
        buffer.insert("byteLength".into(), json!(start));
    }
    Ok(())
}
