//! Materials of a document that was modelled, with numbers in place of textures.

use super::document::{ExternalFiles, GltfDocument};
use super::metallic_roughness::material;
use crate::brdf::models::DIELECTRIC;
use crate::brdf::{FittedMaterial, Microfacets, NamedMaterial};
use crate::error::{Error, Result};
use crate::image::{parse_linear_image, parse_size};
use crate::input::{FileAccess, escaped};
use crate::mesh::material_names;
use serde_json::Value;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::Path;

/// The material of primitives that state none (glTF 2.0, 3.9.1).
pub const UNSTATED: Microfacets =
    Microfacets { base_colour: [1.0; 3], metallic: 1.0, roughness: 1.0, specular_colour: [1.0; 3] };

/// Members of a material that change nothing here: triangles are seen from both sides, and the rest is read or says nothing of the look.
const READ: [&str; 6] = ["name", "pbrMetallicRoughness", "extensions", "extras", "doubleSided", "alphaCutoff"];
/// Extensions that are read.
const SPECULAR: &str = "KHR_materials_specular";
const IOR: &str = "KHR_materials_ior";
const GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";
/// Largest index of refraction, and factor of a dielectric's reflection.
const MAX_FACTOR: f64 = 1e6;
/// Pixels of a document's pictures in all, each counted as [`LEAST_PIXELS`] at least: entries may name the same bytes again and again.
const MAX_PIXELS: u64 = 1 << 32;
const LEAST_PIXELS: u64 = 1 << 20;

/// Returns a document's materials under the names that [`parse_with_groups`](crate::mesh::parse_with_groups) gives the groups of its triangles.
///
/// Metallic-roughness, `KHR_materials_specular`, `KHR_materials_ior` and `KHR_materials_pbrSpecularGlossiness` are read. In place of a texture
/// stands its mean; whatever else would change the look is left out. Both are remarked (see [`FileAccess::remarks`]).
///
/// # Errors
///
/// [`Error::Input`] for a factor that is no number or outside its range, with its place in the document; [`Error::InputMemory`] for textures
/// beyond the limits.
pub fn document_materials(
    document: &GltfDocument,
    files: ExternalFiles<'_>,
    access: &FileAccess,
) -> Result<Vec<NamedMaterial>> {
    let all = document.list("materials");
    let names = material_names(all.iter().map(|material| material.get("name").and_then(Value::as_str)));
    let mut means = TextureMeans { document, files, access, known: BTreeMap::new(), left: MAX_PIXELS };
    let read = |(number, (json, name)): (usize, (&Value, String))| {
        let source = Source { document, access, number, name: &name };
        let microfacets = source.microfacets(json, &mut means)?;
        Ok(NamedMaterial { material: FittedMaterial::MetallicRoughness(microfacets), name })
    };
    let materials = all.iter().zip(names).enumerate().map(read).collect::<Result<_>>()?;
    let primitives = document.list("meshes").iter().filter_map(|mesh| mesh.get("primitives")?.as_array()).flatten();
    let attributes: Vec<&Value> = primitives.filter_map(|primitive| primitive.get("attributes")).collect();
    let unread = [
        ("COLOR_0", "glTF: colours of vertices are left out"),
        ("NORMAL", "glTF: normals are left out and follow from the triangles: hard edges look round"),
    ];
    for (_, text) in unread.iter().filter(|(name, _)| attributes.iter().any(|all| all.get(name).is_some())) {
        access.remark(Path::new(&document.name()), *text);
    }
    Ok(materials)
}

/// One material of a document.
struct Source<'a> {
    document: &'a GltfDocument,
    access: &'a FileAccess,
    number: usize,
    name: &'a str,
}

impl Source<'_> {
    fn microfacets(&self, json: &Value, means: &mut TextureMeans<'_>) -> Result<Microfacets> {
        self.remark_unread(json);
        let extension = |name: &str| json["extensions"].get(name);
        if let Some(glossy) = extension(GLOSSINESS) {
            let place = format!("extensions.{GLOSSINESS}");
            let diffuse = self.colour(glossy, &place, "diffuseFactor", 0.0..=1.0)?;
            let specular = self.colour(glossy, &place, "specularFactor", 0.0..=1.0)?;
            let glossiness = self.number(glossy, &place, "glossinessFactor", 1.0, 0.0..=1.0)?;
            let diffuse = product(diffuse, self.mean(glossy, &place, "diffuseTexture", true, means)?);
            let specular = product(specular, self.mean(glossy, &place, "specularGlossinessTexture", true, means)?);
            return Ok(material(diffuse, specular, 1.0 - glossiness));
        }
        let place = "pbrMetallicRoughness";
        let base = &json[place];
        let base_colour = self.colour(base, place, "baseColorFactor", 0.0..=1.0)?;
        let base_colour = product(base_colour, self.mean(base, place, "baseColorTexture", true, means)?);
        let [_, rough, metal] = self.mean(base, place, "metallicRoughnessTexture", false, means)?;
        let metallic = metal * self.number(base, place, "metallicFactor", 1.0, 0.0..=1.0)?;
        let roughness = rough * self.number(base, place, "roughnessFactor", 1.0, 0.0..=1.0)?;
        // In units of a dielectric's reflection, of which nothing reflects more than everything.
        let mut specular_colour = [1.0; 3];
        if let Some(json) = extension(IOR) {
            // 0 stands for infinity (KHR_materials_ior).
            let ior = self.number(json, &format!("extensions.{IOR}"), "ior", 1.5, 0.0..=MAX_FACTOR)?;
            let reflected = if ior == 0.0 { 1.0 } else { ((ior - 1.0) / (ior + 1.0)).powi(2) };
            specular_colour = [reflected / DIELECTRIC; 3];
        }
        if let Some(json) = extension(SPECULAR) {
            let place = format!("extensions.{SPECULAR}");
            let factor = self.number(json, &place, "specularFactor", 1.0, 0.0..=1.0)?;
            let colour = self.colour(json, &place, "specularColorFactor", 0.0..=MAX_FACTOR)?;
            let colour = product(colour, self.mean(json, &place, "specularColorTexture", true, means)?);
            if json.get("specularTexture").is_some() {
                self.remark(&format!("{place}.specularTexture is left out"));
            }
            specular_colour = product(specular_colour, colour).map(|x| factor * x.min(1.0 / DIELECTRIC));
        }
        Ok(Microfacets { base_colour, metallic, roughness, specular_colour })
    }

    /// Remarks what has no part in the material.
    fn remark_unread(&self, json: &Value) {
        let unread = |key: &str| !READ.contains(&key);
        for (key, value) in json.as_object().into_iter().flatten().filter(|(key, _)| unread(key)) {
            let is_usual = match key.as_str() {
                "alphaMode" => value == "OPAQUE",
                "emissiveFactor" => value.as_array().is_some_and(|all| all.iter().all(|x| x.as_f64() == Some(0.0))),
                _ => false,
            };
            if !is_usual {
                self.remark(&format!("{} is left out", escaped(key)));
            }
        }
        let read = [SPECULAR, IOR, GLOSSINESS];
        let extensions = json["extensions"].as_object().into_iter().flatten().map(|(name, _)| name.as_str());
        for name in extensions.filter(|name| !read.contains(name)) {
            self.remark(&format!("{} is left out", escaped(name)));
        }
    }

    fn remark(&self, what: &str) {
        let text = format!("glTF: material '{}': {what}", escaped(self.name));
        self.access.remark(Path::new(&self.document.name()), text);
    }

    fn wrong(&self, place: &str, key: &str, what: &str) -> Error {
        self.document.wrong(format!("glTF: materials[{}].{place}.{key} must be {what}", self.number))
    }

    fn number(&self, json: &Value, place: &str, key: &str, unstated: f64, range: RangeInclusive<f64>) -> Result<f64> {
        let Some(value) = json.get(key) else { return Ok(unstated) };
        let what = format!("a number from {} to {}", range.start(), range.end());
        value.as_f64().filter(|x| range.contains(x)).ok_or_else(|| self.wrong(place, key, &what))
    }

    /// A colour of three or four numbers, of which the fourth is alpha; white where it is not stated.
    fn colour(&self, json: &Value, place: &str, key: &str, range: RangeInclusive<f64>) -> Result<[f64; 3]> {
        let Some(value) = json.get(key) else { return Ok([1.0; 3]) };
        let numbers: Option<Vec<f64>> = value
            .as_array()
            .and_then(|all| all.iter().take(4).map(|x| x.as_f64().filter(|x| range.contains(x))).collect());
        let what = format!("a colour of numbers from {} to {}", range.start(), range.end());
        numbers.and_then(|all| all.first_chunk().copied()).ok_or_else(|| self.wrong(place, key, &what))
    }

    /// The mean of a texture, if there is one; 1 in place of one that is missing or can't be read.
    fn mean(
        &self,
        json: &Value,
        place: &str,
        key: &str,
        is_colour: bool,
        means: &mut TextureMeans<'_>,
    ) -> Result<[f64; 3]> {
        let Some(texture) = json.get(key) else { return Ok([1.0; 3]) };
        Ok(match means.of(texture, is_colour)? {
            Ok(mean) => {
                self.remark(&format!("in place of {place}.{key} stands its mean"));
                mean
            }
            Err(why) => {
                self.remark(&format!("{place}.{key} is left out: {why}"));
                [1.0; 3]
            }
        })
    }
}

fn product(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| a[c] * b[c])
}

/// Means of a document's pictures, each read once.
struct TextureMeans<'a> {
    document: &'a GltfDocument,
    files: ExternalFiles<'a>,
    access: &'a FileAccess,
    /// By the picture's number and whether it is a colour: the mean, or why there is none.
    known: BTreeMap<(usize, bool), std::result::Result<[f64; 3], String>>,
    /// Pixels that may still be read.
    left: u64,
}

impl TextureMeans<'_> {
    /// The mean over all pixels, linear.
    fn of(&mut self, texture: &Value, is_colour: bool) -> Result<std::result::Result<[f64; 3], String>> {
        let entry = |list: &str, index: Option<u64>| {
            let place = index.and_then(|index| usize::try_from(index).ok());
            place.and_then(|place| Some((place, self.document.list(list).get(place)?)))
        };
        let image =
            entry("textures", texture["index"].as_u64()).and_then(|(_, it)| entry("images", it["source"].as_u64()));
        let Some((place, image)) = image else { return Ok(Err("it names no texture with an image".into())) };
        if let Some(known) = self.known.get(&(place, is_colour)) {
            return Ok(known.clone());
        }
        let mean = match self.read(image, is_colour) {
            Err(error @ Error::InputMemory { .. }) => return Err(error),
            mean => mean.map_err(|e| e.to_string()),
        };
        self.known.insert((place, is_colour), mean.clone());
        Ok(mean)
    }

    fn read(&mut self, image: &Value, is_colour: bool) -> Result<[f64; 3]> {
        let bytes = match (image["bufferView"].as_u64(), image["uri"].as_str()) {
            (Some(view), _) => self.document.view(view, self.files)?,
            (None, Some(uri)) => Cow::Owned((self.files)(&self.document.check_uri(uri)?)?),
            (None, None) => return Err(self.document.wrong("glTF: the image has neither bufferView nor uri")),
        };
        let name = self.document.name();
        let path = Path::new(&name);
        self.spend(LEAST_PIXELS)?;
        let (width, height) = parse_size(path, &bytes, self.access)?;
        self.spend((u64::from(width) * u64::from(height)).saturating_sub(LEAST_PIXELS))?;
        let space = if is_colour { "srgb" } else { "linear" };
        let image = parse_linear_image(path, &bytes, self.access, space)?;
        let sum = image.data.iter().fold([0.0; 3], |sum, p| std::array::from_fn(|c| sum[c] + f64::from(p[c])));
        let mean = sum.map(|x| x / image.data.len() as f64);
        if mean.iter().any(|x| !x.is_finite()) {
            return Err(self.document.wrong("glTF: the image has values that are no numbers"));
        }
        Ok(mean.map(|x| x.clamp(0.0, 1.0)))
    }

    fn spend(&mut self, pixels: u64) -> Result<()> {
        let message = || format!("glTF: the images have more than {MAX_PIXELS} pixels in all");
        self.left = self.left.checked_sub(pixels).ok_or_else(|| self.document.wrong(message()))?;
        Ok(())
    }
}
