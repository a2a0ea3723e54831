use super::appearance::StreamSource;
use super::export::write_geometry;
use super::metallic_roughness::material;
use super::*;
use crate::asset::Asset;
use crate::brdf::Brdf;
use crate::image::Grid;
use crate::mesh::Mesh;
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::atlas::rasterise_atlas;
use crate::surface::charts::{Chart, Charts};
use crate::surface::displacement::DisplacedMesh;
use crate::surface::split::RenderMesh;
use crate::views::{PointLight, View};
use crate::{Budget, Error, Limits, Result};
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

/// A box of sides 2, 1 and 1, each side a chart of its own, four times finer in the atlas than `coarse` triangles need.
fn boxed() -> (Mesh, Charts) {
    let positions =
        (0..8).map(|k| [(k & 1) as f32 * 2.0 - 1.0, (k >> 1 & 1) as f32 - 0.5, (k >> 2) as f32 - 0.5]).collect();
    let sides = [[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]];
    let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let charts = (0..6).map(|facing| Chart { facing, offset: [12 + 22 * facing as i32, 12] }).collect();
    let chart_of_triangle = (0..12).map(|t| t / 2).collect();
    (Mesh { positions, triangles }, Charts { width: 140, height: 24, texels_per_unit: 10.0, charts, chart_of_triangle })
}

fn budget() -> Budget {
    Budget::new(Limits::default())
}

fn no_files(name: &str) -> Result<Vec<u8>> {
    Err(Error::parameter(format!("{name} is not there")))
}

/// A GLB of the box, with members that nobody knows.
fn document() -> GltfDocument {
    let json = json!({
        "asset": {"version": "2.0", "someone": [1, 0.1, 1e300]},
        "meshes": [{"primitives": [{}]}],
        "materials": [
            {"name": "lacquer", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "unknown": {"kept": true}}}},
            {"name": "other", "extensions": {"VENDOR_thing": {"deep": [null, 1.23456789012345]}}},
        ],
        "VENDOR_root": "stays",
    });
    let Value::Object(json) = json else { unreachable!() };
    let mut document = GltfDocument::new_glb(json, Vec::new());
    let (mesh, charts) = boxed();
    document.json["meshes"][0]["primitives"][0] =
        write_geometry(&mut document, &RenderMesh::with_atlas(&mesh, &charts)).unwrap();
    document
}

fn parse(bytes: &[u8]) -> Result<GltfDocument> {
    GltfDocument::parse("box.glb", bytes, &budget())
}

#[test]
fn vertices_are_split_at_charts_and_have_frames() {
    let (mesh, charts) = boxed();
    let geometry = RenderMesh::with_atlas(&mesh, &charts);
    assert_eq!((geometry.positions.len(), geometry.triangles.len()), (24, 12));
    for k in 0..24 {
        let (n, t) = (geometry.normals[k], geometry.tangents[k]);
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let along = [t[0], t[1], t[2]];
        assert!((dot(n, n) - 1.0).abs() < 1e-6 && (dot(along, along) - 1.0).abs() < 1e-6 && dot(n, along).abs() < 1e-6);
        assert!(geometry.coordinates[k].iter().all(|x| (0.0..=1.0).contains(x)));
    }
    // Tangents point to where u grows, normal x tangent times the sign to where v falls.
    for triangle in &geometry.triangles {
        for side in 0..3 {
            let (a, b) = (triangle[side] as usize, triangle[(side + 1) % 3] as usize);
            let (p, q) = (geometry.positions[a], geometry.positions[b]);
            let edge: [f32; 3] = std::array::from_fn(|k| q[k] - p[k]);
            let (n, t) = (geometry.normals[a], geometry.tangents[a]);
            let up =
                [n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]].map(|x| x * t[3]);
            let gap: [f32; 2] = std::array::from_fn(|c| geometry.coordinates[b][c] - geometry.coordinates[a][c]);
            let [right, rise] = [[t[0], t[1], t[2]], up].map(|axis| (0..3).map(|k| axis[k] * edge[k]).sum::<f32>());
            assert!(gap[0] * 140.0 * right >= -1e-3 && gap[1] * 24.0 * rise <= 1e-3, "{gap:?} {right} {rise}");
        }
    }
}

#[test]
fn a_stream_goes_in_and_out_and_the_document_survives() {
    let original = document();
    let stream: Vec<u8> = (0..1001u32).map(|k| (k * k) as u8).collect();
    let mut bound = original.clone();
    let material = find_material(&bound, &sha256(&stream), Some("lacquer")).unwrap();
    assert_eq!(inject(&mut bound, material, &stream, vec![10, 1001], None).unwrap().0, 0);
    let bytes = bound.to_bytes().unwrap();
    let read = parse(&bytes).unwrap();
    assert!(read.to_bytes().unwrap() == bytes);
    let taken = extract(&read, 0, &no_files).unwrap();
    assert_eq!((&taken.stream, &taken.materials), (&stream, &vec![0]));
    assert_eq!(taken.appearance.levels, [10, 1001]);
    assert_eq!(read.json["VENDOR_root"], "stays");
    assert_eq!(read.json["asset"], original.json["asset"]);
    assert_eq!(read.json["materials"][1], original.json["materials"][1]);

    // Found again by its trace; replaced in place, and not twice in the file.
    let mut again = read.clone();
    let material = find_material(&again, &sha256(&stream), None).unwrap();
    inject(&mut again, material, &stream[..500], vec![500], None).unwrap();
    assert_eq!(appearances(&again).unwrap().len(), 1);
    let lengths = [&again, &original].map(|document| document.binary.as_ref().unwrap().len());
    assert_eq!(lengths[0], lengths[1] + 500);
    inject(&mut again, material, &stream, vec![10, 1001], None).unwrap();
    assert!(again.to_bytes().unwrap() == bytes);

    // A second one beside the document.
    let mut both = read.clone();
    assert_eq!(inject(&mut both, 1, b"second", vec![6], Some("my%20stream.tsuya")).unwrap().0, 1);
    let beside = |name: &str| if name == "my stream.tsuya" { Ok(b"second".to_vec()) } else { no_files(name) };
    assert_eq!(extract(&both, 1, &beside).unwrap().stream, b"second");
    assert_eq!(extract(&both, 0, &beside).unwrap().stream, stream);
    assert!(matches!(extract(&both, 2, &beside), Err(Error::Parameter(_))));

    let mut stripped = read;
    strip(&mut stripped).unwrap();
    assert_eq!(stripped.json, original.json);
    assert!(stripped.to_bytes().unwrap() == original.to_bytes().unwrap());
}

#[test]
fn a_stream_in_the_middle_leaves_everything_else_where_it_is() {
    let mut edited = document();
    inject(&mut edited, 0, b"the stream", vec![10], None).unwrap();
    let Some(StreamSource::View(view)) = appearances(&edited).unwrap().pop().map(|a| a.source) else { panic!() };
    stream::push_view(&mut edited, b"later", None).unwrap();
    strip(&mut edited).unwrap();
    assert_eq!(&*edited.view(view + 1, &no_files).unwrap(), b"later");
    assert!(appearances(&edited).unwrap().is_empty());
    assert!(extract(&edited, 0, &no_files).unwrap_err().to_string().contains("has no TSUYA"));
}

#[test]
fn what_is_wrong_is_said() {
    let mut good = document();
    inject(&mut good, 0, b"the stream", vec![10], None).unwrap();
    let fails = |edit: &dyn Fn(&mut GltfDocument), words: &str| {
        let mut document = good.clone();
        edit(&mut document);
        let error = extract(&document, 0, &no_files).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        error
    };
    fn root(document: &mut GltfDocument) -> &mut Value {
        &mut document.json["extensions"][EXTENSION]
    }
    fails(&|d| *d.binary.as_mut().unwrap().last_mut().unwrap() ^= 1, "SHA-256");
    fails(&|d| root(d)["appearances"][0]["levels"] = json!([9]), "9 bytes");
    fails(&|d| root(d)["appearances"][0]["levels"] = json!([9, 5]), "ascending");
    fails(&|d| root(d)["appearances"][0]["sha256"] = json!("1234"), "64");
    fails(&|d| root(d)["appearances"][0]["bufferView"] = json!(99), "not there");
    fails(&|d| root(d)["appearances"][0]["bufferView"] = json!(-1), "whole number");
    fails(&|d| root(d)["appearances"] = json!(7), "array");
    fails(&|d| d.json["bufferViews"][5]["byteLength"] = json!(u64::MAX), "beyond the end");
    let external = |uri: &'static str| {
        move |d: &mut GltfDocument| {
            let entry = root(d)["appearances"][0].as_object_mut().unwrap();
            entry.remove("bufferView");
            entry.insert("uri".into(), json!(uri));
        }
    };
    for uri in ["../secret", "/etc/passwd", "a/../../b", "http://host/a", "%2e%2e/a", "C%3A/a", "a%5cb", "", "a//b"] {
        fails(&external(uri), "folder");
    }
    fails(&external("data:model/vnd.tsuya;base64,AAAA"), "GLB");
    fails(&external("%zz"), "escape");
    fails(&external("gone.tsuya"), "gone.tsuya");
    assert!(matches!(fails(&|d| root(d)["version"] = json!(2), "version 2"), Error::Unsupported(_)));
    assert!(matches!(
        fails(&|d| root(d)["appearances"][0]["mimeType"] = json!("image/png"), "image/png"),
        Error::Unsupported(_)
    ));
    // Dropped by a program that kept the extras.
    fails(&|d| drop(d.json.remove("extensions")), "inject");
    // Not known which material.
    let mut unknown = document();
    let error = find_material(&unknown, "", None).unwrap_err().to_string();
    assert!(error.contains("lacquer") && error.contains("other"), "{error}");
    assert!(inject(&mut unknown, 2, b"", vec![], None).is_err());
    unknown.json.insert("extensions".into(), json!([]));
    assert!(inject(&mut unknown, 0, b"", vec![], None).is_err());
}

#[test]
fn hostile_bytes_are_refused() {
    let mut whole = document();
    inject(&mut whole, 0, b"the stream", vec![10], None).unwrap();
    let bytes = whole.to_bytes().unwrap();
    for length in 0..bytes.len() {
        assert!(parse(&bytes[..length]).is_err(), "{length} bytes");
    }
    assert!(parse(&[&bytes[..], &[0]].concat()).is_err());
    let changed = |at: usize, with: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[at..at + with.len()].copy_from_slice(with);
        parse(&bytes)
    };
    assert!(matches!(changed(4, &[3]), Err(Error::Unsupported(_))));
    for length in [0u32, 3, u32::MAX, bytes.len() as u32] {
        assert!(changed(12, &length.to_le_bytes()).is_err(), "JSON of {length} bytes");
    }
    assert!(changed(16, b"BIN\0").is_err());
    // Claims cost nothing: the limit is the bytes that are there.
    let little = Budget::new(Limits { memory_bytes: 100, ..Limits::default() });
    assert!(matches!(GltfDocument::parse("x", &bytes, &little), Err(Error::Limits { .. })));
    for text in ["", "{", "[]", "{}", r#"{"asset":{"version":"1.0"}}"#, r#"{"asset":{"version":2}}"#, "glTF"] {
        assert!(parse(text.as_bytes()).is_err(), "{text}");
    }
    let deep = format!("{}{}", r#"{"asset":{"version":"2.0"},"a":"#, "[".repeat(100_000));
    assert!(parse(deep.as_bytes()).is_err());
    assert!(!parse(br#" {"asset":{"version":"2.0"}}"#).unwrap().is_glb());
}

#[test]
fn the_mesh_is_recognised_by_texture_coordinates() {
    let (mesh, charts) = boxed();
    let compare = |document: &GltfDocument, binding: &MaterialBinding| {
        compare_mesh(document, &[0], binding, &mesh, &charts, &no_files, &budget()).unwrap()
    };
    let plain = MaterialBinding::default();
    assert!(matches!(compare(&document(), &plain), MeshFit::Same(share) if share < 1e-6));
    // Moved, scaled, quantised, in another order: the same.
    let mut moved = document();
    let accessor = &moved.json["accessors"][1];
    let view = &moved.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let at = view["byteOffset"].as_u64().unwrap() as usize;
    let bytes: Vec<u8> = (0..72)
        .flat_map(|k| {
            let chunk: [u8; 4] = moved.binary.as_ref().unwrap()[at + 4 * k..][..4].try_into().unwrap();
            ((f32::from_le_bytes(chunk) * 9000.0) as i16 + 500).to_le_bytes()
        })
        .collect();
    let view = stream::push_view(&mut moved, &bytes, None).unwrap();
    let entry = moved.json["accessors"][1].as_object_mut().unwrap();
    entry.insert("bufferView".into(), json!(view));
    entry.insert("componentType".into(), json!(5122));
    entry.insert("normalized".into(), json!(true));
    assert!(matches!(compare(&moved, &plain), MeshFit::Same(share) if share < 1e-3));
    // Another transform of the coordinates is another place.
    let info = json!({"extensions": {"KHR_texture_transform": {"offset": [0.3, 0.0], "scale": [0.5, 1.0]}}});
    assert!(matches!(
        compare(&document(), &MaterialBinding::from_texture_info(info.as_object().unwrap())),
        MeshFit::Other(_)
    ));
    // Another shape.
    let mut bent = document();
    for k in 0..12 {
        bent.binary.as_mut().unwrap()[at + 24 * k + 2] ^= 0x60;
    }
    assert!(matches!(compare(&bent, &plain), MeshFit::Other(_)));
    // Not readable.
    let mut compressed = document();
    compressed.json["bufferViews"][1]["extensions"] = json!({"EXT_meshopt_compression": {}});
    assert_eq!(compare(&compressed, &plain), MeshFit::Unknown);
    assert_eq!(
        compare_mesh(&document(), &[1], &plain, &mesh, &charts, &no_files, &budget()).unwrap(),
        MeshFit::Unknown
    );
}

#[test]
fn texture_transforms_follow_the_extension() {
    let info = json!({"texCoord": 1, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0.25], "rotation": 0.5, "scale": [2, 3]}}});
    let binding = MaterialBinding::from_texture_info(info.as_object().unwrap());
    assert_eq!(binding.tex_coord(), 1);
    let (sin, cos) = 0.5f64.sin_cos();
    let [u, v] = binding.transform_coordinate([0.1, 0.2]);
    assert!((u - (cos * 0.2 + sin * 0.6 + 0.5)).abs() < 1e-12 && (v - (cos * 0.6 - sin * 0.2 + 0.25)).abs() < 1e-12);
    assert_eq!(MaterialBinding::default().transform_coordinate([0.1, 0.2]), [0.1, 0.2]);
}

#[test]
fn the_fallback_reflects_what_was_fitted() {
    // Plastic: both reflections as asked for.
    let plastic = material([0.5, 0.3, 0.1], [0.06, 0.05, 0.04], 0.5);
    assert!(plastic.metallic < 0.1, "{plastic:?}");
    let up = [0.0, 0.0, 1.0];
    let brdf = plastic.evaluate(up, up);
    let peak = 1.0 / (4.0 * std::f64::consts::PI * 0.0625);
    for (c, (diffuse, specular)) in [(0.5, 0.06), (0.3, 0.05), (0.1, 0.04)].into_iter().enumerate() {
        let wanted = diffuse / std::f64::consts::PI + peak * specular;
        assert!((brdf[c] / wanted - 1.0).abs() < 0.05, "{} {wanted}", brdf[c]);
    }
    // Gold: a metal of that colour.
    let gold = material([0.01, 0.008, 0.005], [1.0, 0.77, 0.34], 0.3);
    assert!(gold.metallic > 0.9, "{gold:?}");
    assert!(gold.base_colour.iter().zip([1.0, 0.77, 0.34]).all(|(a, b)| (a - b).abs() < 0.05), "{gold:?}");
    // Chalk.
    let chalk = material([0.8; 3], [0.0; 3], 1.0);
    assert_eq!((chalk.metallic, chalk.specular_colour), (0.0, [0.0; 3]));
    assert!(chalk.evaluate(up, [0.0, 0.0, -1.0]) == [0.0; 3]);

    let (mesh, charts) = boxed();
    let map = |colour: [f32; 3]| Grid::filled(140, 24, colour);
    let (intensity, place) = ([8.0, 6.0, 4.0], [0.0, 0.0, 2.0]);
    let unit = [2.0, 1.5, 1.0];
    // White board of albedo 0.9 facing a light of intensity 4 x unit at distance 2: no unit to be found.
    let view =
        View { name: "a".into(), camera: Default::default(), light: Some(PointLight { position: place, intensity }) };
    let asset = Asset {
        mesh,
        charts: Some(charts),
        white: unit.map(|u| 0.9 / std::f64::consts::PI * u),
        views: vec![view],
        reflectance: Some(ReflectanceMaps {
            palette: Vec::new(),
            lobes: Vec::new(),
            relightable: true,
            diffuse: map([0.1, 0.05, 0.02]),
            specular: map([0.05; 3]),
            sigma: Grid::filled(140, 24, 0.1),
        }),
        ..Asset::default()
    };
    let fallback = bake_fallback(&asset, 0.9).unwrap();
    assert!(fallback.unit.iter().all(|u| (u - 1.0).abs() < 1e-9), "{:?}", fallback.unit);
    assert!(fallback.normal.is_none());
    // A finer surface: a viewer that interpolates the frames of vertices finds its normals in the map.
    let bump = |_: usize, _: usize, [x, y, z]: [f64; 3]| 0.01 * (9.0 * x).sin() * (7.0 * y + 5.0 * z).cos();
    let surface = DisplacedMesh::new(&asset.mesh, 4, bump).unwrap();
    let charts = asset.charts.clone().unwrap();
    let geometry = RenderMesh::with_atlas(&asset.mesh, &charts);
    let atlas = rasterise_atlas(&asset.mesh, &charts).unwrap();
    let map = bake_fallback(&Asset { surface: Some(surface.clone()), ..asset.clone() }, 0.9).unwrap().normal.unwrap();
    let (mut turned, mut worst) = (0.0f64, 0.0f64);
    for texel in (0..map.data.len()).filter(|&texel| atlas.mask().data[texel]) {
        let (triangle, weights) = (atlas.triangle.data[texel] as usize, atlas.weights(texel));
        let between = |vectors: &dyn Fn(usize) -> [f32; 3]| -> DVec3 {
            let corner = |k: usize| Vec3::from_array(vectors(geometry.triangles[triangle][k] as usize)).as_dvec3();
            (0..3).map(|k| corner(k) * weights[k]).sum::<DVec3>().normalize()
        };
        let normal = between(&|v| geometry.normals[v]);
        let tangent = between(&|v| std::array::from_fn(|c| geometry.tangents[v][c]));
        let [x, y, z] = map.data[texel].map(|code| code as f64 / 127.5 - 1.0);
        let found = (tangent * x - normal.cross(tangent) * y + normal * z).normalize();
        let expected = DVec3::from_array(surface.point(triangle, weights).1);
        turned = turned.max(expected.angle_between(normal).to_degrees());
        worst = worst.max(expected.angle_between(found).to_degrees());
    }
    assert!(turned > 4.0 && worst < 1.5, "{turned} {worst}");
}

#[test]
fn lobes_have_equivalents() {
    let (alpha, peak) = equivalent_lobe(0.02);
    assert!((alpha / 0.02 - 1.503).abs() < 0.01 && (peak - 1.140).abs() < 0.005, "{alpha} {peak}");
    let (alpha, peak) = equivalent_lobe(0.4);
    assert!((alpha / 0.4 - 1.167).abs() < 0.01 && (peak - 1.212).abs() < 0.005, "{alpha} {peak}");
}
