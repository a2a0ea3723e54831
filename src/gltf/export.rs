//! A GLB of an asset.

use super::document::{GltfDocument, percent_encoded};
use super::fallback::{Fallback, bake_fallback};
use super::geometry::charts;
use super::levels::prefix_lengths;
use super::stream::{inject, push_view, sha256};
use crate::asset::Asset;
use crate::container::metadata::metres_per_unit;
use crate::error::{Error, Result};
use crate::image::Grid;
use crate::limits::Limits;
use crate::surface::split::RenderMesh;
use crate::views::View;
use byteorder::{ByteOrder, LittleEndian};
use serde_json::{Map, Value, json};

/// bufferView targets.
pub(super) const VERTICES: u64 = 34962;
const INDICES: u64 = 34963;
/// Component types.
const U16: u64 = 5123;
const U32: u64 = 5125;
pub(super) const F32: u64 = 5126;

/// Location of the stream.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum StreamPlacement {
    /// Into the GLB.
    #[default]
    Inside,
    /// Into a file of this name beside the GLB; the caller writes it.
    Beside(String),
}

/// Options of [`export`].
#[derive(Debug, Clone, PartialEq)]
pub struct ExportOptions {
    /// Location of the stream.
    pub placement: StreamPlacement,
    /// Diffuse albedo of the capture's white board.
    pub white_albedo: f64,
    /// JPEG quality of the colours, 1 to 100; `None` for PNG. Roughness and metalness are always PNG.
    pub jpeg_quality: Option<u8>,
    /// Bounds on what the stream may ask for.
    pub limits: Limits,
}

impl Default for ExportOptions {
    fn default() -> Self {
        ExportOptions {
            placement: StreamPlacement::default(),
            white_albedo: 0.95,
            jpeg_quality: None,
            limits: Limits::default(),
        }
    }
}

/// An exported GLB.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportedGltf {
    /// The document.
    pub document: GltfDocument,
    /// Its fallback material.
    pub fallback: Fallback,
    /// Vertices after splitting at the borders of charts.
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Decodable prefixes of the stream.
    pub levels: Vec<u64>,
    /// SHA-256 of the stream.
    pub sha256: String,
}

/// Exports `asset`, which is `stream` decoded (its photographs are not needed). The document's node has the scene upright and, where the
/// metadata names a metric unit, in metres; positions stay those of the stream.
pub fn export(stream: &[u8], asset: &Asset, options: &ExportOptions) -> Result<ExportedGltf> {
    if !(options.white_albedo > 0.0 && options.white_albedo <= 1.0) {
        return Err(Error::parameter("the white board's albedo lies between 0 and 1"));
    }
    let charts = charts(asset)?;
    let fallback = bake_fallback(asset, options.white_albedo)?;
    let geometry = RenderMesh::with_atlas(&asset.mesh, charts);
    let title = asset.metadata.get("title").and_then(Value::as_str).unwrap_or("appearance");
    let mut root = json!({
        "asset": {"version": "2.0", "generator": concat!("tsuya ", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node(asset, title)],
        "meshes": [{"name": title, "primitives": [{"attributes": {}, "material": 0}]}],
    });
    if let Some(licence) = asset.metadata.get("licence").and_then(Value::as_str) {
        root["asset"]["copyright"] = json!(licence);
    }
    let root = match root {
        Value::Object(root) => root,
        _ => Map::new(),
    };
    let mut document = GltfDocument::new_glb(root, Vec::new());
    let primitive = write_geometry(&mut document, &geometry)?;
    document.json["meshes"][0]["primitives"][0] = primitive;
    write_material(&mut document, &fallback, title, options.jpeg_quality)?;
    let levels = prefix_lengths(stream, options.limits)?;
    let uri = match &options.placement {
        StreamPlacement::Inside => None,
        StreamPlacement::Beside(name) => Some(percent_encoded(name)),
    };
    inject(&mut document, 0, stream, levels.clone(), uri.as_deref())?;
    Ok(ExportedGltf {
        document,
        fallback,
        vertices: geometry.positions.len(),
        triangles: geometry.triangles.len(),
        levels,
        sha256: sha256(stream),
    })
}

/// The node: turned so that what is up in the photographs is up in glTF (+Y), scaled to metres.
pub(super) fn node(asset: &Asset, title: &str) -> Value {
    let mut node = json!({"name": title, "mesh": 0});
    if let Some(turn) = View::upright_rotation(&asset.views) {
        node["rotation"] = json!(turn);
    }
    let scale = metres_per_unit(&asset.metadata);
    if scale != 1.0 {
        node["scale"] = json!([scale, scale, scale]);
    }
    node
}

/// Writes the vertices and triangles; returns the primitive.
pub(super) fn write_geometry(document: &mut GltfDocument, geometry: &RenderMesh) -> Result<Value> {
    let count = geometry.positions.len();
    write_indices(document, geometry.triangles.as_flattened(), count)?;
    let attributes: [(&str, &str, Vec<u8>); 4] = [
        ("POSITION", "VEC3", floats(&geometry.positions)),
        ("NORMAL", "VEC3", floats(&geometry.normals)),
        ("TANGENT", "VEC4", floats(&geometry.tangents)),
        ("TEXCOORD_0", "VEC2", floats(&geometry.coordinates)),
    ];
    let mut named = Map::new();
    for (name, kind, bytes) in attributes {
        let view = push_view(document, &bytes, Some(VERTICES))?;
        let mut accessor = json!({"bufferView": view, "componentType": F32, "count": count, "type": kind});
        if name == "POSITION" {
            let [low, high] = bounds(&geometry.positions);
            accessor["min"] = json!(low);
            accessor["max"] = json!(high);
        }
        let accessors = document.list_mut("accessors")?;
        accessors.push(accessor);
        named.insert(name.into(), json!(accessors.len() - 1));
    }
    Ok(json!({"attributes": named, "indices": 0, "material": 0}))
}

/// Writes indices of `count` vertices; returns their accessor.
pub(super) fn write_indices(document: &mut GltfDocument, indices: &[u32], count: usize) -> Result<usize> {
    // The largest index of a type is kept free by glTF.
    let (kind, bytes): (u64, Vec<u8>) = if count <= usize::from(u16::MAX) {
        (U16, numbers(indices.iter().map(|&index| index as u16), LittleEndian::write_u16_into))
    } else {
        (U32, numbers(indices.iter().copied(), LittleEndian::write_u32_into))
    };
    let view = push_view(document, &bytes, Some(INDICES))?;
    let accessors = document.list_mut("accessors")?;
    accessors.push(json!({"bufferView": view, "componentType": kind, "count": indices.len(), "type": "SCALAR"}));
    Ok(accessors.len() - 1)
}

/// The lowest and the highest corner of positions, as their accessor has them.
pub(super) fn bounds(positions: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let bound = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
        std::array::from_fn(|c| positions.iter().map(|p| p[c]).reduce(pick).unwrap_or(0.0))
    };
    [bound(f32::min), bound(f32::max)]
}

pub(super) fn floats<const N: usize>(elements: &[[f32; N]]) -> Vec<u8> {
    numbers(elements.as_flattened().iter().copied(), LittleEndian::write_f32_into)
}

/// Numbers as an accessor stores them.
fn numbers<T>(values: impl Iterator<Item = T>, write_into: fn(&[T], &mut [u8])) -> Vec<u8> {
    let values: Vec<T> = values.collect();
    let mut bytes = vec![0; values.len() * size_of::<T>()];
    write_into(&values, &mut bytes);
    bytes
}

/// Writes the textures and the material.
fn write_material(
    document: &mut GltfDocument,
    fallback: &Fallback,
    name: &str,
    jpeg_quality: Option<u8>,
) -> Result<()> {
    let base = push_texture(document, &fallback.base_colour, "base colour", jpeg_quality)?;
    let mut pbr = json!({"baseColorTexture": {"index": base}, "metallicFactor": 0, "roughnessFactor": 1});
    let mut material = json!({"name": name});
    let mut extensions = Map::new();
    if let (Some(roughness), Some(colour)) = (&fallback.metallic_roughness, &fallback.specular_colour) {
        let index = push_texture(document, roughness, "metallic-roughness", None)?;
        pbr["metallicFactor"] = json!(1);
        pbr["metallicRoughnessTexture"] = json!({"index": index});
        let index = push_texture(document, colour, "specular colour", jpeg_quality)?;
        let factor = [fallback.specular_scale; 3];
        let object = json!({"specularColorFactor": factor, "specularColorTexture": {"index": index}});
        extensions.insert("KHR_materials_specular".into(), object);
    } else {
        // Nothing but what is seen: no viewer's light adds a reflection.
        extensions.insert("KHR_materials_specular".into(), json!({"specularFactor": 0}));
    }
    if let Some(normal) = &fallback.normal {
        let index = push_texture(document, normal, "normal", None)?;
        material["normalTexture"] = json!({"index": index});
    }
    if fallback.is_unlit {
        // Shines by itself. KHR_materials_unlit would say the same, but excludes other extensions.
        pbr = json!({"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1});
        material["emissiveTexture"] = json!({"index": base});
        material["emissiveFactor"] = json!([1, 1, 1]);
    }
    material["pbrMetallicRoughness"] = pbr;
    material["extensions"] = json!(extensions);
    document.list_mut("materials")?.push(material);
    document.list_mut("extensionsUsed")?.push(json!("KHR_materials_specular"));
    Ok(())
}

/// Writes a texture as PNG or JPEG; returns its index.
fn push_texture(
    document: &mut GltfDocument,
    texture: &Grid<[u8; 3]>,
    name: &str,
    jpeg_quality: Option<u8>,
) -> Result<usize> {
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    use image::{ExtendedColorType, ImageEncoder};
    let mut file = Vec::new();
    let bytes: Vec<u8> = texture.data.iter().flatten().copied().collect();
    let (width, height, kind) = (texture.width as u32, texture.height as u32, ExtendedColorType::Rgb8);
    let (mime, written) = match jpeg_quality {
        Some(quality) => {
            let encoder = JpegEncoder::new_with_quality(&mut file, quality);
            ("image/jpeg", encoder.write_image(&bytes, width, height, kind))
        }
        None => {
            let encoder = PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive);
            ("image/png", encoder.write_image(&bytes, width, height, kind))
        }
    };
    written.map_err(|e| Error::parameter(format!("{mime}: {e}")))?;
    let view = push_view(document, &file, None)?;
    let images = document.list_mut("images")?;
    images.push(json!({"name": name, "mimeType": mime, "bufferView": view}));
    let source = images.len() - 1;
    let samplers = document.list_mut("samplers")?;
    if samplers.is_empty() {
        // Linear, between mip levels too; clamped to the edge.
        samplers.push(json!({"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}));
    }
    let textures = document.list_mut("textures")?;
    textures.push(json!({"sampler": 0, "source": source}));
    Ok(textures.len() - 1)
}
