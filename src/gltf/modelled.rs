//! A GLB of an object whose materials are bound to its mesh: metallic-roughness materials that look like them, without textures.

use super::document::GltfDocument;
use super::export::{F32, VERTICES, bounds, floats, node, write_indices};
use super::metallic_roughness::{equivalent_distribution, material};
use super::stream::push_view;
use crate::asset::Asset;
use crate::brdf::models::MIN_ALPHA;
use crate::brdf::{FittedMaterial, Microfacets};
use crate::error::{Error, Result};
use crate::relight::Material;
use crate::surface::raster::vertex_normals;
use serde_json::{Value, json};
use std::f64::consts::{FRAC_PI_2, PI};

/// Returns the metallic-roughness material that looks most like a file's material, and whether its lobe is round: glTF's is.
///
/// The diffuse albedo is that of [`Material::of_fitted`]. Width and height of the distribution are those that come nearest (see
/// [`equivalent_lobe`](super::equivalent_lobe)) to `f cos^2` with light and viewer in one direction, its mean along and across.
pub fn metallic_roughness_of(fitted: &FittedMaterial) -> (Microfacets, bool) {
    if let FittedMaterial::MetallicRoughness(microfacets) = fitted {
        return (*microfacets, true);
    }
    let Material { albedo, specular, specular_scale } = Material::of_fitted(fitted);
    let Some(part) = specular else {
        let specular_colour = [0.0; 3];
        return (
            Microfacets {
                base_colour: albedo.map(|x| x.clamp(0.0, 1.0)),
                metallic: 0.0,
                roughness: 1.0,
                specular_colour,
            },
            true,
        );
    };
    let along = |angle: f64, phi: f64, c: usize| {
        let (sin, cos) = angle.sin_cos();
        let direction = [sin * phi.cos(), sin * phi.sin(), cos];
        specular_scale[c] * part.brdf.evaluate(direction, direction)[c] * cos * cos
    };
    let lobe = |c: usize| move |angle: f64| 0.5 * (along(angle, 0.0, c) + along(angle, FRAC_PI_2, c));
    let grey = |angle: f64| (0..3).map(|c| lobe(c)(angle)).sum::<f64>() / 3.0;
    // Where it has fallen to a hundredth nothing is left to compare.
    let peak = grey(0.0);
    let end = (1..=200).map(|k| FRAC_PI_2 * (f64::from(k) / 200.0).powi(2)).find(|&angle| grey(angle) < 0.01 * peak);
    let end = (2.0 * end.unwrap_or(FRAC_PI_2)).min(FRAC_PI_2 - 1e-3);
    let (alpha, _) = equivalent_distribution(&grey, end, [MIN_ALPHA, 1.0]);
    // F D / 4 at the peak of the distribution, 1 / (pi alpha^2), is to be the lobe's.
    let height = |c: usize| 4.0 * PI * alpha * alpha * equivalent_distribution(&lobe(c), end, [alpha, alpha]).1;
    let half = |phi: f64| {
        (1..2000).map(|k| FRAC_PI_2 * f64::from(k) / 2000.0).find(|&a| along(a, phi, 1) < 0.6 * along(0.0, phi, 1))
    };
    let is_round = match (half(0.0), half(FRAC_PI_2)) {
        (Some(a), Some(b)) => (a / b).ln().abs() < 0.1,
        _ => true,
    };
    (material(albedo, std::array::from_fn(height), alpha.sqrt()), is_round)
}

/// Exports an asset whose materials are bound to its mesh. The document has no stream: what binds one to a material is an atlas. Returns the
/// names of materials whose anisotropy is left out, too.
///
/// # Errors
///
/// [`Error::Unsupported`] for an asset without such materials, [`Error::Parameter`] if mesh and binding do not fit each other.
pub fn export_modelled(asset: &Asset) -> Result<(GltfDocument, Vec<String>)> {
    let Some(binding) = &asset.binding else {
        return Err(Error::Unsupported("the file has no materials that are bound to its mesh".into()));
    };
    let mesh = &asset.mesh;
    let vertices = mesh.positions.len();
    if binding.of_triangle.len() != mesh.triangles.len()
        || mesh.triangles.iter().flatten().any(|&vertex| vertex as usize >= vertices)
    {
        return Err(Error::parameter("mesh and binding of materials do not belong together"));
    }
    let title = asset.metadata.get("title").and_then(Value::as_str).unwrap_or("object");
    let root = json!({
        "asset": {"version": "2.0", "generator": concat!("tsuya ", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node(asset, title)],
        "meshes": [{"name": title, "primitives": []}],
    });
    let Value::Object(root) = root else { return Err(Error::parameter("no document")) };
    let mut document = GltfDocument::new_glb(root, Vec::new());
    let normals: Vec<[f32; 3]> = vertex_normals(mesh).into_iter().map(|n| n.map(|x| x as f32)).collect();
    let mut attributes = json!({});
    for (name, values) in [("POSITION", &mesh.positions), ("NORMAL", &normals)] {
        let view = push_view(&mut document, &floats(values), Some(VERTICES))?;
        let mut accessor = json!({"bufferView": view, "componentType": F32, "count": vertices, "type": "VEC3"});
        if name == "POSITION" {
            let [low, high] = bounds(values);
            accessor["min"] = json!(low);
            accessor["max"] = json!(high);
        }
        let accessors = document.list_mut("accessors")?;
        accessors.push(accessor);
        attributes[name] = json!(accessors.len() - 1);
    }
    let mut primitives = Vec::new();
    let mut simplified = Vec::new();
    for place in (0..binding.names.len()).map(Some).chain([None]) {
        let own = (0..mesh.triangles.len()).filter(|&triangle| binding.material_of(triangle) == place);
        let indices: Vec<u32> = own.flat_map(|triangle| mesh.triangles[triangle]).collect();
        if indices.is_empty() {
            continue;
        }
        let accessor = write_indices(&mut document, &indices, vertices)?;
        let mut primitive = json!({"attributes": attributes, "indices": accessor});
        if let Some(name) = place.map(|place| &binding.names[place]) {
            let found = asset.materials.iter().find(|named| named.name == *name);
            let found = found.ok_or_else(|| {
                Error::parameter(format!("triangles are bound to material '{name}', which is not there"))
            })?;
            let (microfacets, is_round) = metallic_roughness_of(&found.material);
            if !is_round {
                simplified.push(name.clone());
            }
            let materials = document.list_mut("materials")?;
            materials.push(material_json(name, &microfacets));
            primitive["material"] = json!(materials.len() - 1);
        }
        primitives.push(primitive);
    }
    document.json["meshes"][0]["primitives"] = json!(primitives);
    let extends = document.list("materials").iter().any(|material| material.get("extensions").is_some());
    if extends {
        document.list_mut("extensionsUsed")?.push(json!("KHR_materials_specular"));
    }
    Ok((document, simplified))
}

fn material_json(name: &str, microfacets: &Microfacets) -> Value {
    let Microfacets { base_colour: [r, g, b], metallic, roughness, specular_colour } = *microfacets;
    let mut json = json!({
        "name": name,
        "pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness},
    });
    if specular_colour == [0.0; 3] {
        json["extensions"] = json!({"KHR_materials_specular": {"specularFactor": 0}});
    } else if specular_colour != [1.0; 3] {
        json["extensions"] = json!({"KHR_materials_specular": {"specularColorFactor": specular_colour}});
    }
    json
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{Brdf, ClassicalLobe, ClassicalModel};

    #[test]
    fn models_become_the_metallic_roughness_material_that_looks_like_them() {
        let of = |diffuse: [f64; 3], specular: [f64; 3], lobe: ClassicalLobe| {
            metallic_roughness_of(&FittedMaterial::Classical(ClassicalModel { diffuse, specular, lobe }))
        };
        // The same distribution: a metal of its colour, a plastic of 4 %.
        let ggx = |reflectance| ClassicalLobe::CookTorranceGgx { roughness: 0.09, reflectance };
        let (gold, is_round) = of([0.0; 3], [1.0, 0.7, 0.3], ggx(1.0));
        assert!(is_round && gold.metallic > 0.999 && (gold.roughness - 0.3).abs() < 0.01, "{gold:?}");
        assert!((0..3).all(|c| (gold.base_colour[c] - [1.0, 0.7, 0.3][c]).abs() < 0.03), "{gold:?}");
        let (plastic, _) = of([0.5, 0.2, 0.1], [1.0; 3], ggx(0.04));
        assert!(plastic.metallic < 1e-6 && (plastic.roughness - 0.3).abs() < 0.01, "{plastic:?}");
        assert!(plastic.specular_colour.iter().all(|s| (s - 1.0).abs() < 0.05), "{plastic:?}");
        // Others: near the value that they have where light and viewer are in one direction.
        for lobe in [
            ClassicalLobe::BlinnPhong { exponent: 60.0 },
            ClassicalLobe::CookTorranceBeckmann { roughness: 0.2, reflectance: 0.5 },
            ClassicalLobe::Ward { roughness: 0.15 },
            ClassicalLobe::AshikhminShirley { exponents: [100.0; 2], reflectance: 0.3 },
            ClassicalLobe::Lafortune { xy: -1.0, z: 1.0, exponent: 40.0 },
        ] {
            let model = ClassicalModel { diffuse: [0.3; 3], specular: [0.2; 3], lobe };
            let (near, is_round) = metallic_roughness_of(&FittedMaterial::Classical(model.clone()));
            let direction = [0.1, 0.0, 0.99f64.sqrt()];
            let (found, expected) = (near.evaluate(direction, direction)[1], model.evaluate(direction, direction)[1]);
            assert!(is_round && (found / expected - 1.0).abs() < 0.25, "{model:?}: {found} {expected}");
        }
        assert!(!of([0.0; 3], [1.0; 3], ClassicalLobe::WardAnisotropic { roughness: [0.1, 0.3] }).1);
        assert_eq!(of([0.5; 3], [0.0; 3], ClassicalLobe::Lambert).0.specular_colour, [0.0; 3]);
    }
}
