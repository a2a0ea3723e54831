//! Objects that were modelled: made, lit, exported and put into photographs by the program.

use crate::stage;

use crate::support::{complaint, json, output, sample, text, tsuya};
use serde_json::json;
use std::fmt::Write;
use std::path::Path;
use tsuya::brdf::{Brdf, ClassicalLobe, ClassicalModel};
use tsuya::decoder::{DecodeOptions, decode};
use tsuya::gltf::GltfDocument;
use tsuya::relight::{AssetShading, PointLightOptions, RenderObject, look_at, render_point_lights};
use tsuya::{Budget, PointLight};

pub const GOLD: &str = r#"{"model": "cook-torrance", "distribution": "ggx", "roughness": 0.25, "reflectance": 1, "specular": [1, 0.7, 0.3]}"#;

/// A UV sphere of radius 1, as OBJ with texture coordinates; its lower half in a group of its own.
pub fn sphere(rings: usize) -> String {
    let (mut obj, sectors) = (String::new(), 2 * rings);
    for (ring, sector) in (0..=rings).flat_map(|ring| (0..sectors).map(move |sector| (ring, sector))) {
        let (theta, phi) = (ring as f64 / rings as f64, sector as f64 / rings as f64);
        let ((s, c), (x, z)) = ((theta * std::f64::consts::PI).sin_cos(), (phi * std::f64::consts::PI).sin_cos());
        let _ = writeln!(obj, "v {} {} {}", s * x, c, s * z);
    }
    for (ring, sector) in (0..=rings).flat_map(|ring| (0..=sectors).map(move |sector| (ring, sector))) {
        let _ = writeln!(obj, "vt {} {}", sector as f64 / sectors as f64, 1.0 - ring as f64 / rings as f64);
    }
    for ring in 0..rings {
        if ring == 0 || ring == rings / 2 {
            let _ = writeln!(obj, "usemtl {}", if ring == 0 { "upper part" } else { "lower" });
        }
        for sector in 0..sectors {
            let at = |ring: usize, sector: usize| {
                let (vertex, coordinate) = (1 + ring * sectors + sector % sectors, 1 + ring * (sectors + 1) + sector);
                format!("{vertex}/{coordinate}")
            };
            let (a, b) = (at(ring, sector), at(ring, sector + 1));
            let (c, d) = (at(ring + 1, sector + 1), at(ring + 1, sector));
            let _ = writeln!(obj, "f {a} {d} {c} {b}");
        }
    }
    obj
}

pub fn read(path: &Path) -> tsuya::Asset {
    decode(&std::fs::read(path).unwrap(), &DecodeOptions::default()).unwrap()
}

fn picture(path: &Path) -> image::RgbImage {
    image::open(path).unwrap().into_rgb8()
}

/// Signal-to-noise ratio of square roots, of the greatest.
fn psnr(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let most = b.as_flattened().iter().fold(0f32, |most, &x| most.max(x)).sqrt();
    let root = |x: f32| f64::from(x.max(0.0).sqrt() / most);
    let squares = a.as_flattened().iter().zip(b.as_flattened()).map(|(&a, &b)| (root(a) - root(b)).powi(2));
    -10.0 * (squares.sum::<f64>() / (3 * a.len()) as f64).log10()
}

#[test]
fn a_point_light_on_a_sphere_is_the_models_own_value() {
    let lobe = ClassicalLobe::CookTorranceGgx { roughness: 0.3, reflectance: 0.2 };
    let text = r#"{"model": "cook-torrance", "distribution": "ggx", "diffuse": [0.3, 0.1, 0.05], "roughness": 0.3, "reflectance": 0.2}"#;
    let near = point_light_on_a_sphere(text, ClassicalModel { diffuse: [0.3, 0.1, 0.05], specular: [1.0; 3], lobe });
    // A sphere shadows itself only where light grazes it, as its depth map has it.
    assert!(near[0] > 80.0 && near[1] > 50.0, "{near:?} dB");
}

/// The axes follow the texture coordinates: around the sphere, without a seam.
#[test]
fn brushed_metal_follows_the_texture_coordinates() {
    for (text, lobe) in [
        (r#"{"model": "ward", "roughness": [0.1, 0.4]}"#, ClassicalLobe::WardAnisotropic { roughness: [0.1, 0.4] }),
        (
            r#"{"model": "ashikhmin-shirley", "exponent": [10, 200], "reflectance": 0.5}"#,
            ClassicalLobe::AshikhminShirley { exponents: [10.0, 200.0], reflectance: 0.5 },
        ),
    ] {
        let near = point_light_on_a_sphere(text, ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe });
        assert!(near[0] > 60.0, "{text}: {near:?} dB");
    }
}

/// Decibels between a point light on a sphere that is made of a material, without and with shadows, and the model's own values.
fn point_light_on_a_sphere(material: &str, model: ClassicalModel) -> [f64; 2] {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("sphere.obj"), sphere(220)).unwrap();
    let made = at("made.tsuya");
    let made = text(&made);
    let obj = at("sphere.obj");
    let fine = ["--position-bits", "20", "--texture-bits", "20", "-o", made];
    tsuya(&[&["make", text(&obj), "--material", material][..], &fine].concat()).code(0);
    let asset = read(Path::new(made));
    assert!(asset.is_modelled() && asset.views.is_empty() && asset.metadata["title"] == "sphere");
    let camera = look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 150.0, 100, 100);
    let light = PointLight { position: [3.0, 4.0, 5.0], intensity: [80.0, 60.0, 40.0] };
    let shading = AssetShading::new(&asset, 8).unwrap();
    let object = RenderObject::of_asset(&asset, None).unwrap();
    let draw = |shadows: bool| {
        let options = PointLightOptions { samples: 1, shadows };
        render_point_lights(&object, &camera, &shading, &[light], &options).unwrap().image.data
    };
    let (found, shadowed) = (draw(false), draw(true));
    let (mut seen, mut with_shadows, mut expected) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..100 * 100 {
        let ray = camera.ray([(k % 100) as f64 + 0.5, (k / 100) as f64 + 0.5]);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let unit = |v: [f64; 3]| v.map(|x| x / dot(v, v).sqrt());
        let ray = unit(ray);
        let (half, rest) = (4.0 * ray[2], 15.0);
        let root = half * half - rest;
        // Not at the silhouette, which the mesh's corners cut.
        if root < 0.05 {
            continue;
        }
        let distance = -half - root.sqrt();
        let normal: [f64; 3] = std::array::from_fn(|c| ray[c] * distance + if c == 2 { 4.0 } else { 0.0 });
        let to_light: [f64; 3] = std::array::from_fn(|c| light.position[c] - normal[c]);
        let (incoming, outgoing) = (unit(to_light), ray.map(|x| -x));
        // Both directions in a frame whose z is the normal, and whose x goes around the sphere as u does.
        let side = unit([normal[2], 0.0, -normal[0]]);
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let across = cross(normal, side);
        let local = |v: [f64; 3]| [dot(v, side), dot(v, across), dot(v, normal)];
        let f = model.evaluate(local(incoming), local(outgoing));
        let cosine = dot(incoming, normal).max(0.0);
        seen.push(found[k]);
        with_shadows.push(shadowed[k]);
        expected.push(std::array::from_fn(|c| (f[c] * cosine * light.intensity[c] / dot(to_light, to_light)) as f32));
    }
    let near = [&seen, &with_shadows].map(|image| psnr(image, &expected));
    println!("{}: {} pixels, {near:.1?} dB", model.lobe.name(), seen.len());
    assert!(seen.len() > 3000);
    near
}

#[test]
fn what_was_made_is_drawn_as_a_job_draws_it_and_keeps_its_shadows() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let path = |name: &str| text(&at(name)).to_owned();
    std::fs::write(at("gold.json"), GOLD).unwrap();
    let spot = sample().join("scan.ply");
    tsuya(&["make", text(&spot), "--material", &path("gold.json"), "-o", &path("made.tsuya")]).code(0);
    let figures = json(&["bake", &path("made.tsuya"), "-o", &path("baked.tsuya"), "--json"]);
    assert_eq!(figures["triangles"], 1500);
    assert_eq!(read(&at("baked.tsuya")).binding, read(&at("made.tsuya")).binding);
    let sky = image::RgbImage::from_fn(64, 32, |x, y| {
        let sun = if (20..24).contains(&x) && (6..9).contains(&y) { 255 } else { 0 };
        image::Rgb([60 + 2 * y as u8, 90, 120 - y as u8].map(|v: u8| v.max(sun)))
    });
    sky.save(at("sky.png")).unwrap();
    let camera = json!({"position": [0.4, 0.8, 3.0], "target": [0.0, 0.0, 0.0], "up": [0, 1, 0], "fov_y_deg": 45});
    let common = json!({"environment": {"file": "sky.png", "scale": 4}, "camera": camera, "size": [96, 96]});
    let job = |name: &str, more: serde_json::Value| {
        let mut job = common.clone();
        job.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        std::fs::write(at(name), job.to_string()).unwrap();
    };
    let gold: serde_json::Value = serde_json::from_str(GOLD).unwrap();
    for evaluator in ["filtered", "sg"] {
        job("mesh.json", json!({"mesh": "baked.tsuya", "material": gold, "evaluator": evaluator}));
        job("asset.json", json!({"asset": "baked.tsuya", "evaluator": evaluator}));
        job("unbaked.json", json!({"asset": "made.tsuya", "evaluator": evaluator}));
        let render = |name: &str| {
            let exr = path(&format!("{evaluator}-{name}.exr"));
            tsuya(&["render", "--job", &path(&format!("{name}.json")), "-o", &exr]).code(0);
            std::fs::read(exr).unwrap()
        };
        let [mesh, asset, unbaked] = ["mesh", "asset", "unbaked"].map(render);
        assert!(mesh == asset, "{evaluator}: the same evaluator, another picture");
        // The visibility of the file, or one computed alike.
        assert!(asset == unbaked, "{evaluator}");
    }
    // Any camera, a light or an environment; the parts of it sum to the whole.
    let views = ["--light", "2,3,4,30", "--size", "96x96"];
    let shown = |name: &str, more: &[&str]| {
        tsuya(&[&["render", &path("baked.tsuya"), "-o", &path(name)][..], &views, more].concat()).code(0);
    };
    shown("around.png", &["--orbit", "3"]);
    let around = picture(&at("around-000.png"));
    let lit = around.pixels().filter(|p| p[0] > 60 && p[0] > p[2]).count();
    assert!(lit > 300, "{lit} pixels shine golden");
    assert!(around != picture(&at("around-001.png")));
    shown("one.png", &[]);
    assert!(around == picture(&at("one.png")));
    shown("given.png", &["--camera", "0,1,3,0,0,0"]);
    shown("free.png", &["--camera", "0,1,3,0,0,0", "--no-shadows"]);
    assert!(picture(&at("given.png")) != picture(&at("free.png")));
    shown("specular.png", &["--camera", "0,1,3,0,0,0", "--layers", "specular"]);
    // Gold has no diffuse reflection.
    assert!(picture(&at("given.png")) == picture(&at("specular.png")));
    tsuya(&["render", &path("made.tsuya"), "-o", &path("env.png"), "--env", &path("sky.png"), "--orbit", "1"]).code(0);
    assert_eq!(picture(&at("env-000.png")).dimensions(), (800, 600));
    let said = complaint(1, &["render", &path("made.tsuya"), "-o", &path("none.png")]);
    assert!(said.contains("--light X,Y,Z,I or --environment FILE"), "{said}");
    assert!(
        complaint(1, &["render", &path("made.tsuya"), "-o", &path("none.png"), "--view", "0", "--light", "1,1,1,1"])
            .contains("no view")
    );
    let said = complaint(1, &["render", &path("made.tsuya"), "-o", &path("none.png"), "--light", "1,1,1"]);
    assert!(said.contains("intensity"), "{said}");
    // Into a photograph.
    tsuya(&["composite", &path("asset.json"), "--photograph", "environment", "-o", &path("placed.png")]).code(0);
    // With light of its own it needs no other.
    tsuya(&["light", "fit", &path("sky.png"), "-o", &path("lit.tsuya"), "--force"]).code(0);
    let light = read(&at("lit.tsuya")).light.unwrap();
    let section = tsuya::lighting::encode(&light, &Default::default()).unwrap().0;
    let section = (tsuya::container::Tag::LIGHT, tsuya::container::SectionCodec::Own, section);
    let with =
        tsuya::container::with_sections(&std::fs::read(at("baked.tsuya")).unwrap(), &[section], Default::default());
    std::fs::write(at("own.tsuya"), with.unwrap()).unwrap();
    tsuya(&["render", &path("own.tsuya"), "-o", &path("own.png"), "--size", "64x64"]).code(0);
}

#[test]
fn groups_take_materials_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let path = |name: &str| text(&at(name)).to_owned();
    std::fs::write(at("sphere.obj"), sphere(16)).unwrap();
    let red = r#"{"model": "lambert", "diffuse": [0.8, 0.05, 0.05]}"#;
    let blue = r#"{"model": "metallic-roughness", "base_colour": [0.05, 0.05, 0.8], "roughness": 0.6}"#;
    let (obj, made) = (path("sphere.obj"), path("made.tsuya"));
    let report = json(&[
        "make",
        &obj,
        "--material",
        &format!("upper part={red}"),
        "--material",
        &format!("lower={blue}"),
        "-o",
        &made,
        "--json",
    ]);
    // A triangle at each pole has no area.
    let expected = json!([
        {"name": "upper part", "form": "lambert", "triangles": 16 * 16 * 2 - 32 },
        {"name": "lower", "form": "metallic-roughness", "triangles": 16 * 16 * 2 - 32}
    ]);
    assert_eq!(report["materials"], expected);
    assert!(output(&["info", &made]).contains("made of: upper part, lambert, 480 triangles"));
    assert!(output(&["verify", &made, "--deep"]).contains("2 materials decode"));
    let halves = |file: &str| {
        let light = ["--light", "0,0,6,40", "--light", "0,0,-6,40", "--size", "64x64", "--force"];
        let camera = ["--camera", "0,0,4,0,0,0", "-o", &path("halves.png")];
        tsuya(&[&["render", file][..], &light, &camera].concat()).code(0);
        let picture = picture(&at("halves.png"));
        let at = |y: u32| picture.get_pixel(32, y).0;
        (at(20), at(44))
    };
    let (upper, lower) = halves(&made);
    assert!(upper[0] > 3 * upper[2] && lower[2] > 2 * lower[0], "{upper:?} {lower:?}");

    // One material is replaced by its name, or all of them; what was not bound stays.
    let changed = path("changed.tsuya");
    tsuya(&["make", &made, "--material", &format!("upper part={GOLD}"), "-o", &changed]).code(0);
    let asset = read(Path::new(&changed));
    let forms: Vec<&str> = asset.materials.iter().map(|named| named.material.form()).collect();
    assert_eq!(forms, ["cook-torrance-ggx", "metallic-roughness"]);
    assert_eq!(asset.binding, read(Path::new(&made)).binding);
    tsuya(&["make", &changed, "--material", red, "-o", &changed, "--force"]).code(0);
    let asset = read(Path::new(&changed));
    assert_eq!((asset.materials.len(), asset.binding.unwrap().names), (1, vec!["lambert".to_owned()]));

    // A GLB of it has the groups again, and shows the same colours.
    let glb = path("sphere.glb");
    tsuya(&["gltf", "export", &made, "-o", &glb]).code(0);
    let bytes = std::fs::read(&glb).unwrap();
    let document = GltfDocument::parse(Path::new(&glb), &bytes, &Budget::new(Default::default())).unwrap();
    let names: Vec<_> =
        document.json["materials"].as_array().unwrap().iter().map(|m| m["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["upper part", "lower"]);
    let colour = &document.json["materials"][1]["pbrMetallicRoughness"];
    assert_eq!((&colour["baseColorFactor"][2], &colour["roughnessFactor"]), (&json!(0.8), &json!(0.6)));
    let again = path("again.tsuya");
    tsuya(&["make", &glb, "--material", red, "--material", &format!("lower={blue}"), "-o", &again]).code(0);
    let (upper, lower) = halves(&again);
    assert!(upper[0] > 3 * upper[2] && lower[2] > 2 * lower[0], "{upper:?} {lower:?}");

    // Fitted materials are put in by their name, and taken from files that hold several.
    let mut rows = "theta_i,phi_i,theta_o,phi_o,r,g,b\n".to_owned();
    for k in 0..60 {
        let (theta_i, theta_o, phi) = ((7 * k) % 80, (13 * k) % 80, (29 * k) % 360);
        let _ = writeln!(rows, "{theta_i},0,{theta_o},{phi},0.2,0.1,0.02");
    }
    std::fs::write(at("paint.csv"), rows).unwrap();
    let fit = ["brdf", "fit", &path("paint.csv"), "--form", "lambert", "--asset", &made, "--name", "lower", "-o"];
    tsuya(&[&fit[..], &[&made, "--force"]].concat()).code(0);
    let asset = read(Path::new(&made));
    let found = asset.materials.iter().find(|named| named.name == "lower").unwrap();
    let value = found.material.evaluate([0.0, 0.0, 1.0], [0.6, 0.0, 0.8]);
    assert!(found.material.form() == "lambert" && (value[0] - 0.2).abs() < 0.01, "{value:?}");
    let fitted = format!("upper part={{\"model\": \"fitted\", \"file\": {:?}, \"name\": \"lower\"}}", made);
    let both = ["make", &obj, "--material", &fitted, "--material", &made, "-o", &path("both.tsuya")];
    let said = complaint(1, &both);
    assert!(said.contains("has upper part, lower"), "{said}");
    tsuya(&["make", &obj, "--material", &fitted, "--material", &format!("lower={made}"), "-o", &path("both.tsuya")])
        .code(0);

    // What can't be made is said.
    let refused = |code: i32, materials: &[&str]| {
        let mut arguments = vec!["make", &obj, "-o", "refused.tsuya"];
        materials.iter().for_each(|material| arguments.extend(["--material", material]));
        let said = complaint(code, &arguments);
        assert!(!Path::new("refused.tsuya").exists());
        said
    };
    let named = |name: &str| format!("{name}={red}");
    assert!(refused(1, &[&named("lower")]).contains("no material for upper part; --material NAME=MATERIAL"));
    assert!(refused(1, &[&named("handle")]).contains("no group handle; it has upper part, lower"));
    assert!(refused(1, &[&named("lower"), &named("lower"), red]).contains("twice for lower"));
    assert!(refused(1, &[red, blue]).contains("twice for the whole mesh"));
    assert!(refused(1, &[r#"{"model": "ward"}"#]).contains("ward needs roughness"));
    assert!(refused(1, &[r#"{"model": "ward", "roughness": 0.1, "exponent": 2}"#]).contains("takes no \"exponent\""));
    let texture = r#"{"model": "ward", "roughness": {"texture": "r.png"}}"#;
    assert!(refused(5, &[texture]).contains("numbers and colours only"));
    let ply = sample().join("scan.ply");
    let said = complaint(1, &["make", text(&ply), "--material", &named("lower"), "-o", &path("x.tsuya")]);
    assert!(said.contains("has no groups"), "{said}");
    assert!(complaint(2, &["make", &obj, "--material", red, "-o", &made]).contains("--force"));
    let json = complaint(1, &[&fit[..], &[&path("x.json")]].concat());
    assert!(json.contains(".tsuya file"), "{json}");
}

#[test]
fn a_made_object_stands_on_a_marker() {
    let folder = stage::stage();
    let at = |name: &str| folder.path().join(name);
    let path = |name: &str| text(&at(name)).to_owned();
    std::fs::write(at("sphere.obj"), sphere(24)).unwrap();
    tsuya(&["make", &path("sphere.obj"), "--material", GOLD, "-o", &path("made.tsuya")]).code(0);
    tsuya(&["bake", &path("made.tsuya"), "-o", &path("made.tsuya"), "--force", "--resolution", "12"]).code(0);
    let place = |frames: &str, assets: &[&str], out: &str| {
        let mut arguments = vec!["ar".to_owned(), path(frames), "--marker".into(), "tag36h11:0:0.1".into()];
        assets.iter().for_each(|asset| arguments.extend(["--asset".into(), path(asset)]));
        arguments.extend(["--camera".into(), path("camera.json"), "--env".into(), path("sky.png")]);
        arguments.extend(["-o".into(), path(out), "--json".into()]);
        if assets.len() > 1 {
            arguments.extend(["--translate", "-0.06,0,0", "--translate", "0.06,0,0"].map(String::from));
        }
        json(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    assert_eq!(place("frames/1.png", &["made.tsuya"], "one.png")["with_marker"], 1);
    let (before, after) = (picture(&at("frames/1.png")), picture(&at("one.png")));
    let changed = before.pixels().zip(after.pixels()).filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 20)).count();
    assert!((1500..40_000).contains(&changed), "{changed}");
    // A sequence, and beside an object that was captured.
    assert_eq!(place("frames", &["made.tsuya"], "moving")["with_marker"], 4);
    assert_eq!(place("frames/1.png", &["made.tsuya", "asset.tsuya"], "two.png")["with_marker"], 1);
    assert!(picture(&at("two.png")) != after);
    if let Some(kept) = std::env::var_os("TSUYA_KEEP") {
        for name in ["one.png", "two.png", "moving/2.png"] {
            std::fs::copy(at(name), Path::new(&kept).join(name.replace('/', "-"))).unwrap();
        }
    }
}
