//! Materials of other programs' glTF documents: imported, and left on what is made of such a document.

use crate::make::{GOLD, read, sphere};
use crate::support::{complaint, sample, text, tsuya};
use serde_json::json;
use std::path::Path;
use tsuya::Budget;
use tsuya::brdf::FittedMaterial;
use tsuya::gltf::GltfDocument;

/// A GLB of a sphere whose materials `edit` changes; it gets the binary chunk, too.
fn sphere_glb(folder: &Path, edit: impl FnOnce(&mut GltfDocument)) -> String {
    let path = |name: &str| text(&folder.join(name)).to_owned();
    std::fs::write(path("sphere.obj"), sphere(16)).unwrap();
    let (made, glb) = (path("made.tsuya"), path("sphere.glb"));
    let red = r#"{"model": "metallic-roughness", "base_colour": [0.8, 0.05, 0.05], "roughness": 0.5}"#;
    let gold = format!("lower={GOLD}");
    let materials = ["--material", &format!("upper part={red}"), "--material", &gold];
    tsuya(&[&["make", &path("sphere.obj"), "-o", &made, "--force"][..], &materials].concat()).code(0);
    tsuya(&["gltf", "export", &made, "-o", &glb, "--force"]).code(0);
    let bytes = std::fs::read(&glb).unwrap();
    let mut document = GltfDocument::parse(Path::new(&glb), &bytes, &Budget::new(Default::default())).unwrap();
    edit(&mut document);
    std::fs::write(&glb, document.to_bytes().unwrap()).unwrap();
    glb
}

/// Adds a PNG of two pixels to a document, and returns its bufferView.
fn add_picture(document: &mut GltfDocument) -> usize {
    let mut png = Vec::new();
    let picture = image::RgbImage::from_raw(2, 1, vec![255, 0, 128, 255, 255, 0]).unwrap();
    picture.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let binary = document.binary.as_mut().unwrap();
    let (offset, length) = (binary.len(), png.len());
    binary.extend(png);
    document.json["buffers"][0]["byteLength"] = json!(offset + length);
    let views = document.json["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": length}));
    views.len() - 1
}

/// Its materials, by the names that triangles are bound to.
fn materials_of(path: &str) -> Vec<(String, FittedMaterial)> {
    let asset = read(Path::new(path));
    let of = |name: &String| asset.materials.iter().find(|named| named.name == *name).unwrap().material.clone();
    asset.binding.as_ref().unwrap().names.iter().map(|name| (name.clone(), of(name))).collect()
}

#[test]
fn documents_of_others_bring_their_materials() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    // What was exported comes back: the factors of the first export are those of the second.
    let glb = sphere_glb(folder.path(), |_| ());
    let imported = path("imported.tsuya");
    let said = complaint(0, &["gltf", "import", &glb, "-o", &imported]);
    assert!(said.contains("normals are left out") && !said.contains("material"), "{said}");
    tsuya(&["gltf", "export", &imported, "-o", &path("again.glb")]).code(0);
    let materials = |path: &str| {
        let bytes = std::fs::read(path).unwrap();
        GltfDocument::parse(path, &bytes, &Budget::new(Default::default())).unwrap().json["materials"].clone()
    };
    assert_eq!(materials(&path("again.glb")), materials(&glb));
    // `make` does the same, and exchanges one of them.
    tsuya(&["make", &glb, "-o", &path("same.tsuya")]).code(0);
    assert_eq!(std::fs::read(path("same.tsuya")).unwrap(), std::fs::read(&imported).unwrap());
    tsuya(&["make", &glb, "--material", &format!("lower={GOLD}"), "-o", &path("gold.tsuya")]).code(0);
    let exchanged = materials_of(&path("gold.tsuya"));
    assert_eq!(exchanged[0], materials_of(&imported)[0]);
    assert_eq!(exchanged[1].1.form(), "cook-torrance-ggx");

    // Textures become their mean, extensions what they say, and what is left out is said.
    let glb = sphere_glb(folder.path(), |document| {
        let view = add_picture(document);
        let json = &mut document.json;
        json.insert("images".into(), json!([{"bufferView": view, "mimeType": "image/png"}, {"uri": "../a.png"}]));
        json.insert("textures".into(), json!([{"source": 0}, {"source": 1}]));
        json["materials"] = json!([
            {"name": "a", "pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 1, 1], "baseColorTexture": {"index": 0},
                "metallicRoughnessTexture": {"index": 0}, "roughnessFactor": 0.6, "metallicFactor": 0.5},
                "extensions": {"KHR_materials_ior": {"ior": 2}, "KHR_materials_specular": {"specularFactor": 0.5,
                "specularColorFactor": [1, 0.5, 20]}, "KHR_materials_sheen": {}}, "normalTexture": {"index": 1}, "alphaMode": "MASK"},
            {"name": "a", "extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 0, 0, 1],
                "specularFactor": [1, 0.75, 0.25], "glossinessFactor": 0.75, "diffuseTexture": {"index": 1}}}},
        ]);
        let primitives = json["meshes"][0]["primitives"].as_array_mut().unwrap();
        assert_eq!(primitives.len(), 2);
        let mut third = primitives[1].clone();
        third.as_object_mut().unwrap().remove("material");
        primitives.push(third);
    });
    let said = complaint(0, &["gltf", "import", &glb, "-o", &imported, "--force"]);
    for expected in [
        "material 'a': in place of pbrMetallicRoughness.baseColorTexture stands its mean",
        "material 'a': normalTexture is left out",
        "material 'a': alphaMode is left out",
        "material 'a': KHR_materials_sheen is left out",
        "diffuseTexture is left out: ",
        "leads out of the document's folder",
    ] {
        assert!(said.contains(expected), "{expected}: {said}");
    }
    let all = materials_of(&imported);
    let names: Vec<&str> = all.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["a", "a (1)", "default"]);
    let factors = |place: usize| match &all[place].1 {
        FittedMaterial::MetallicRoughness(microfacets) => *microfacets,
        other => panic!("{}", other.form()),
    };
    let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|c| (a[c] - b[c]).abs() < 1e-3);
    // The second channel of (255, 0, 128) and (255, 255, 0) is roughness, the third metalness; 128 is 0.2159 as a colour.
    let a = factors(0);
    assert!(near(a.base_colour, [1.0, 0.25, 0.5 * 0.2159]), "{a:?}");
    assert!((a.roughness - 0.3).abs() < 1e-3 && (a.metallic - 0.25 * 128.0 / 255.0).abs() < 1e-3, "{a:?}");
    // ((2 - 1) / (2 + 1))^2 of the colour, 1 at most, in units of 0.04.
    assert!(near(a.specular_colour, [0.5 / 9.0 / 0.04, 0.25 / 9.0 / 0.04, 0.5 / 0.04]), "{a:?}");
    let metal = factors(1);
    assert!(
        near(metal.base_colour, [1.0, 0.75, 0.25]) && metal.metallic > 0.99 && metal.roughness == 0.25,
        "{metal:?}"
    );
    assert_eq!(factors(2), tsuya::gltf::UNSTATED);

    // The same bytes are not read again and again: the last picture is read after ten others that are none, but not after five thousand.
    for (count, green) in [(10, 0.5), (5000, 1.0)] {
        let glb = sphere_glb(folder.path(), |document| {
            let view = add_picture(document);
            let json = &mut document.json;
            let image = |k| json!({"bufferView": if k == count { view } else { 0 }});
            json.insert("images".into(), (0..=count).map(image).collect());
            json.insert("textures".into(), (0..=count).map(|k| json!({"source": k})).collect());
            let textured = |k| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}});
            json["materials"] = (0..=count).map(textured).collect();
            json["meshes"][0]["primitives"][0]["material"] = json!(count);
        });
        tsuya(&["gltf", "import", &glb, "-o", &imported, "--force"]).code(0);
        let (name, material) = &materials_of(&imported)[0];
        assert_eq!(*name, format!("material {count}"));
        assert!(
            matches!(material, FittedMaterial::MetallicRoughness(it) if (it.base_colour[1] - green).abs() < 1e-9),
            "{material:?}"
        );
    }

    // Faults are named with their place, and nothing is written.
    let glb = sphere_glb(folder.path(), |document| {
        document.json["materials"][1]["pbrMetallicRoughness"]["metallicFactor"] = json!(2);
    });
    let said = complaint(3, &["gltf", "import", &glb, "-o", &path("none.tsuya")]);
    assert!(said.contains("materials[1].pbrMetallicRoughness.metallicFactor must be a number from 0 to 1"), "{said}");
    assert!(!folder.path().join("none.tsuya").exists());
    let said = complaint(1, &["make", &path("sphere.obj"), "-o", &path("none.tsuya")]);
    assert!(said.contains("no material for upper part, lower"), "{said}");
    let said = complaint(1, &["make", text(&sample().join("scan.ply")), "-o", &path("none.tsuya")]);
    assert!(said.contains("has no materials of its own"), "{said}");
}
