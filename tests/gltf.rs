//! The glTF bridge from end to end, on the bundled sample.

use crate::support::{complaint, encoded_sample, json as report, sample, text, tsuya};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use tsuya::gltf::{self, EXTENSION, GltfDocument};
use tsuya::{Budget, Limits};

/// A folder with the encoded sample and its GLB.
struct Exported {
    folder: TempDir,
    report: Value,
}

impl Exported {
    fn new(arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.tsuya"), &encoded_sample().bytes).unwrap();
        let path = |name: &str| text(&folder.path().join(name)).to_owned();
        let (file, glb) = (path("a.tsuya"), path("spot.glb"));
        let report = report(&[&["gltf", "export", &file, "-o", &glb, "--json"], arguments].concat());
        Exported { folder, report }
    }
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }
    fn document(&self) -> GltfDocument {
        parse(&self.path("spot.glb"))
    }
    /// Runs a subcommand of `tsuya gltf` on files of the folder; options are kept as they are.
    fn run(&self, code: i32, arguments: &[&str]) -> String {
        let full: Vec<String> = (arguments.iter())
            .map(|a| if a.contains('.') { text(&self.path(a)).to_owned() } else { (*a).to_owned() })
            .collect();
        complaint(code, &[&["gltf"], &full.iter().map(String::as_str).collect::<Vec<_>>()[..]].concat())
    }
    fn write(&self, name: &str, document: &GltfDocument) {
        std::fs::write(self.path(name), document.to_bytes().unwrap()).unwrap();
    }
}

fn parse(path: &Path) -> GltfDocument {
    GltfDocument::parse(path, &std::fs::read(path).unwrap(), &Budget::new(Limits::default())).unwrap()
}

/// What a program leaves that knows neither the extension nor its data, but keeps extras.
fn as_others_leave_it(document: &GltfDocument) -> GltfDocument {
    let mut document = document.clone();
    let extras = document.json["materials"][0]["extras"].clone();
    gltf::strip(&mut document).unwrap();
    document.json["materials"][0]["extras"] = extras;
    document
}

#[test]
fn export_looks_like_the_photographs_and_loads_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("beside.png");
    let exported = Exported::new(&["--against", text(&sample()), "--picture", text(&picture)]);
    let report = &exported.report;
    let db = |key: &str| report[key].as_f64().unwrap();
    println!("image PSNR: fallback {:.2} dB, fitted reflectance {:.2} dB", db("fallback_psnr_db"), db("model_psnr_db"));
    assert!(db("fallback_psnr_db") > 17.0 && db("fallback_psnr_db") > db("model_psnr_db") - 1.0, "{report}");
    assert!(picture.exists());
    assert_eq!(report["triangles"], 1500);
    let levels: Vec<u64> = report["levels"].as_array().unwrap().iter().map(|l| l.as_u64().unwrap()).collect();
    assert!(levels.windows(2).all(|pair| pair[0] < pair[1]) && levels.len() > 5, "{levels:?}");
    assert_eq!(*levels.last().unwrap(), report["stream_bytes"].as_u64().unwrap());

    // Another reader's view of it.
    let glb = exported.bytes("spot.glb");
    assert_eq!(glb.len() as u64, report["bytes"].as_u64().unwrap());
    let (document, buffers, images) = ::gltf::import_slice(&glb).unwrap();
    let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
    let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()].0[..]));
    let count = reader.read_positions().unwrap().len();
    assert_eq!(count as u64, report["vertices"].as_u64().unwrap());
    assert_eq!(reader.read_normals().unwrap().len(), count);
    assert_eq!(reader.read_tangents().unwrap().len(), count);
    let coordinates: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
    assert!(coordinates.len() == count && coordinates.iter().flatten().all(|x| (0.0..=1.0).contains(x)));
    assert_eq!(reader.read_indices().unwrap().into_u32().len(), 4500);
    // A normal map among them: the sample has a surface finer than its mesh.
    assert_eq!(images.len(), 4);
    let required: Vec<_> = document.extensions_required().collect();
    assert!(required.is_empty() && document.extensions_used().any(|name| name == EXTENSION), "{required:?}");
    // And this crate's own: as a mesh.
    let mesh = tsuya::mesh::read(exported.path("spot.glb"), &Default::default()).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (count, 1500));
}

#[test]
fn what_comes_back_is_what_went_in() {
    for arguments in [&[][..], &["--external"]] {
        let exported = Exported::new(arguments);
        let is_beside = exported.path("spot.tsuya").exists();
        assert_eq!(is_beside, !arguments.is_empty());
        exported.run(0, &["import", "spot.glb", "-o", "back.tsuya"]);
        exported.run(0, &["extract", "spot.glb", "-o", "out.tsuya", "--rest", "rest.glb"]);
        assert_eq!(exported.bytes("back.tsuya"), encoded_sample().bytes);
        assert_eq!(exported.bytes("out.tsuya"), encoded_sample().bytes);
        assert!(!exported.bytes("rest.glb").windows(EXTENSION.len()).any(|w| w == EXTENSION.as_bytes()));
        exported.run(0, &["inject", "rest.glb", "a.tsuya", "-o", "again.glb"]);
        exported.run(0, &["import", "again.glb", "-o", "third.tsuya"]);
        assert_eq!(exported.bytes("third.tsuya"), encoded_sample().bytes);
        // Nothing is overwritten unasked.
        assert!(exported.run(2, &["import", "spot.glb", "-o", "back.tsuya"]).contains("--force"));
        if is_beside {
            std::fs::remove_file(exported.path("spot.tsuya")).unwrap();
            assert!(exported.run(2, &["import", "spot.glb", "-o", "x.tsuya"]).contains("spot.tsuya"));
        }
    }
}

#[test]
fn a_document_from_another_program_gets_its_stream_back() {
    let exported = Exported::new(&[]);
    let mut document = as_others_leave_it(&exported.document());
    // More materials, other members, coordinates in another set and moved.
    document.json["materials"].as_array_mut().unwrap().insert(0, json!({"name": "floor"}));
    document.json["meshes"][0]["primitives"][0]["material"] = json!(1);
    let attributes = document.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
    let coordinates = attributes.shift_remove("TEXCOORD_0").unwrap();
    attributes.insert("TEXCOORD_1".into(), coordinates);
    document.json["materials"][1]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = json!(1);
    document.json.insert("VENDOR_members".into(), json!({"number": 0.1, "list": [1e-320, null]}));
    exported.write("other.glb", &document);
    assert!(exported.run(3, &["import", "other.glb", "-o", "x.tsuya"]).contains("tsuya gltf inject"));
    exported.run(0, &["inject", "other.glb", "a.tsuya", "-o", "other2.glb"]);
    let injected = parse(&exported.path("other2.glb"));
    assert_eq!(injected.json["VENDOR_members"], document.json["VENDOR_members"]);
    assert_eq!(injected.json["materials"][1]["extensions"][EXTENSION], json!({"appearance": 0, "texCoord": 1}));
    assert!(injected.json["materials"][0].get("extensions").is_none());
    exported.run(0, &["import", "other2.glb", "-o", "back.tsuya"]);
    assert_eq!(exported.bytes("back.tsuya"), encoded_sample().bytes);
    // Nothing says which material: a question, and an answer.
    document.json["materials"][1].as_object_mut().unwrap().remove("extras");
    exported.write("lost.glb", &document);
    assert!(exported.run(1, &["inject", "lost.glb", "a.tsuya", "-o", "x.glb"]).contains("floor"));
    exported.run(0, &["inject", "lost.glb", "a.tsuya", "-o", "found.glb", "--material", "1"]);
    // JSON alone: the stream lies beside it.
    let mut value = document.json.clone();
    value["buffers"][0]["uri"] = json!("rest.bin");
    std::fs::write(exported.path("rest.bin"), document.binary.as_ref().unwrap()).unwrap();
    std::fs::write(exported.path("plain.gltf"), Value::Object(value).to_string()).unwrap();
    exported.run(0, &["inject", "plain.gltf", "a.tsuya", "-o", "bound.gltf", "--material", "1"]);
    exported.run(0, &["import", "bound.gltf", "-o", "plain.tsuya"]);
    assert_eq!(exported.bytes("plain.tsuya"), encoded_sample().bytes);
    assert!(
        exported
            .run(1, &["inject", "plain.gltf", "a.tsuya", "-o", "bound.glb", "--material", "1"])
            .contains("ends with .gltf")
    );
}

#[test]
fn a_name_that_ends_with_gltf_gets_json_and_its_buffer_beside_it() {
    let exported = Exported::new(&[]);
    let glb = exported.document();
    exported.run(0, &["export", "a.tsuya", "-o", "spot é.gltf"]);
    let document = parse(&exported.path("spot é.gltf"));
    assert!(!document.is_glb() && document.binary.is_none());
    assert_eq!(document.json["buffers"][0]["uri"], "spot%20%C3%A9.bin");
    let length = document.json["buffers"][0]["byteLength"].as_u64().unwrap() as usize;
    assert_eq!(exported.bytes("spot é.bin").len(), length);
    // The same mesh and textures; the stream beside them.
    assert_eq!(document.json["accessors"], glb.json["accessors"]);
    assert_eq!(exported.bytes("spot é.bin")[..], glb.binary.as_ref().unwrap()[..length]);
    assert_eq!(exported.bytes("spot é.tsuya"), encoded_sample().bytes);
    exported.run(0, &["import", "spot é.gltf", "-o", "back.tsuya"]);
    assert_eq!(exported.bytes("back.tsuya"), encoded_sample().bytes);
    // Any of the three that is there already stops it.
    std::fs::remove_file(exported.path("spot é.gltf")).unwrap();
    std::fs::remove_file(exported.path("spot é.tsuya")).unwrap();
    assert!(exported.run(2, &["export", "a.tsuya", "-o", "spot é.gltf"]).contains("spot é.bin"));
    assert!(!exported.path("spot é.gltf").exists());
    // A GLB that is injected or stripped into JSON.
    exported.run(0, &["extract", "spot.glb", "-o", "out.tsuya", "--rest", "rest.gltf"]);
    exported.run(0, &["inject", "rest.gltf", "a.tsuya", "-o", "again.gltf"]);
    exported.run(0, &["inject", "spot.glb", "a.tsuya", "-o", "moved.gltf"]);
    for name in ["again", "moved"] {
        assert_eq!(exported.bytes(&format!("{name}.tsuya")), encoded_sample().bytes, "{name}");
        exported.run(0, &["import", &format!("{name}.gltf"), "-o", &format!("{name}-back.tsuya")]);
    }
}

#[test]
fn damage_other_meshes_and_the_future_are_named() {
    let exported = Exported::new(&[]);
    let document = exported.document();
    let fails = |code: i32, words: &str, edit: &dyn Fn(&mut GltfDocument)| {
        let mut edited = document.clone();
        edit(&mut edited);
        exported.write("edited.glb", &edited);
        let said = exported.run(code, &["import", "edited.glb", "-o", "x.tsuya"]);
        assert!(said.contains(words), "{said}");
        assert!(!exported.path("x.tsuya").exists());
    };
    let middle = |d: &mut GltfDocument| {
        let binary = d.binary.as_mut().unwrap();
        let at = binary.len() - 5000;
        binary[at] ^= 1;
    };
    fails(3, "SHA-256", &middle);
    // The file's own checksums find it, too.
    fails(3, "PLAN", &|d| {
        middle(d);
        d.json["extensions"][EXTENSION]["appearances"][0].as_object_mut().unwrap().remove("sha256");
    });
    fails(5, "version 9", &|d| d.json["extensions"][EXTENSION]["version"] = json!(9));
    // A mesh of the same numbers of vertices and triangles, but not this one: its coordinates lie elsewhere.
    fails(4, "another mesh", &|d| {
        let accessors = d.json["accessors"].as_array_mut().unwrap();
        let coordinates = accessors.iter_mut().find(|a| a["type"] == "VEC2").unwrap();
        let view = coordinates["bufferView"].as_u64().unwrap() as usize;
        let start = d.json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
        let length = d.json["bufferViews"][view]["byteLength"].as_u64().unwrap() as usize;
        d.binary.as_mut().unwrap()[start..start + length].rotate_left(length / 16 * 8);
    });
    let cut = &exported.bytes("spot.glb")[..60_000];
    std::fs::write(exported.path("cut.glb"), cut).unwrap();
    assert!(exported.run(3, &["import", "cut.glb", "-o", "x.tsuya"]).contains("cut"));
    assert!(exported.run(3, &["inject", "spot.glb", "cut.glb", "-o", "x.glb"]).contains("not a .tsuya file"));
    tsuya(&["gltf", "import", text(&exported.path("a.tsuya")), "-o", "-"]).code(3);
    // Profile wavelet-texture has no atlas to bind to.
    let paper = exported.path("p.tsuya");
    tsuya(&["encode", text(&sample()), "-o", text(&paper), "--profile", "wavelet-texture", "--keep-percent", "0.5"])
        .code(0);
    assert!(exported.run(5, &["export", "p.tsuya", "-o", "p.glb"]).contains("atlas"));
}
