//! Files from outside that ask for too much: each is refused by what is there, before anything follows what is claimed.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use tsuya::input::FileAccess;
use tsuya::mesh::parse;
use tsuya::{Error, Limits};
use tsuya::{
    capture::{self, CaptureReadOptions, describe, read},
    image::read_radiance,
};

/// An account so small that nothing that follows a claim fits in.
fn access() -> FileAccess {
    FileAccess::new(limits(16 << 20))
}

fn limits(memory_bytes: u64) -> Limits {
    Limits { memory_bytes, ..Limits::default() }
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Folder(tempfile::tempdir().unwrap())
    }
    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn said<T>(result: tsuya::Result<T>) -> String {
    match result {
        Ok(_) => panic!("it was read"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn yaml_is_counted_before_it_is_loaded() {
    let folder = Folder::new();
    let mut laughs = String::from("a0: &a0 [x, x]\n");
    (1..31).for_each(|k| _ = writeln!(laughs, "a{k}: &a{k} [*a{0}, *a{0}]", k - 1));
    let anchored = format!("a: &a {}\nb: [{}]\n", "x".repeat(100_000), "*a, ".repeat(1000));
    let tags = format!("%TAG !e! {}\n---\n[{}]\n", "x".repeat(100_000), "!e!x 1, ".repeat(1000));
    let cases = [
        (laughs, "line 14: more than 100000 values, repeated ones counted"),
        (anchored, "line 2: more than 100000 values"),
        (tags, "line 3: more than 100000 values"),
        (format!("a: {}", "[".repeat(100_000)), "recursion limit exceeded"),
        ((0..100).map(|k| format!("{}a:\n", " ".repeat(k))).collect(), "line 33: lists and maps lie more than 32 deep"),
        ("- ".repeat(10_000), "line 1: lists and maps lie more than 32 deep"),
        ("a: 1\n".repeat(200_000), "has 1048576 at most"),
        ("--- a\n".repeat(150_000), "more than 100000 values"),
    ];
    for (text, expected) in cases {
        let text = if expected.contains("at most") { text.repeat(2) } else { text };
        let access = access();
        let error = said(capture::read_calibration(folder.write("camera.yaml", &text), &access));
        assert!(error.contains("camera.yaml: ") && error.contains(expected), "{error}\nexpected: {expected}");
        assert_eq!(access.budget().left(), 16 << 20, "{expected}");
    }
}

/// A PNG whose picture data are empty.
fn png(width: u32, height: u32, depth: u8, colour: u8, interlaced: u8) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8; 4], data: &[u8]| {
        bytes.extend((data.len() as u32).to_be_bytes());
        let body = [kind, data].concat();
        bytes.extend(&body);
        bytes.extend(crc32fast::hash(&body).to_be_bytes());
    };
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[depth, colour, 0, 0, interlaced]].concat();
    chunk(b"IHDR", &header);
    chunk(b"IDAT", &[0x78, 0x9c, 3, 0, 0, 0, 0, 1]);
    chunk(b"IEND", &[]);
    bytes
}

/// A TIFF of one grey strip that is not there.
fn tiff(width: u32, height: u32) -> Vec<u8> {
    let entries =
        [(256u16, width), (257, height), (258, 8), (259, 1), (262, 1), (273, 8), (277, 1), (278, height), (279, 100)];
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, value) in entries {
        bytes.extend([&tag.to_le_bytes()[..], &4u16.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()].concat());
    }
    bytes.extend([0; 4]);
    bytes
}

/// A true JPEG with another size in its frame header.
fn jpeg(width: u16, height: u16) -> Vec<u8> {
    let mut bytes = Vec::new();
    let grey = image::GrayImage::new(8, 8);
    grey.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Jpeg).unwrap();
    let at = bytes.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    bytes[at + 5..at + 9].copy_from_slice(&[height.to_be_bytes(), width.to_be_bytes()].concat());
    bytes
}

/// An EXR whose window of this name is another.
fn exr(folder: &Folder, window: &str, side: i32) -> Vec<u8> {
    let path = folder.0.path().join("plain.exr");
    exr::prelude::write_rgb_file(&path, 8, 8, |x, y| (x as f32, y as f32, 1.0)).unwrap();
    let mut bytes = std::fs::read(path).unwrap();
    let name = [window.as_bytes(), b"\0box2i\0"].concat();
    let at = bytes.windows(name.len()).position(|part| part == name).unwrap() + name.len() + 4;
    bytes[at + 8..at + 16].copy_from_slice(&[(side - 1).to_le_bytes(), (side - 1).to_le_bytes()].concat());
    bytes
}

/// A true JPEG whose only scan stands there again and again.
fn jpeg_of_scans(count: usize) -> Vec<u8> {
    let bytes = jpeg(8, 8);
    let at = bytes.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap();
    let (scan, end) = bytes[at..].split_at(bytes.len() - at - 2);
    [&bytes[..at], &scan.repeat(count), end].concat()
}

#[test]
fn pictures_are_measured_before_they_are_decoded() {
    let folder = Folder::new();
    let memory = "picture: ";
    let cases = [
        ("a.png", png(60_000, 60_000, 8, 2, 0), "a picture of 60000 x 60000 pixels; 1 to 32768 each way are read"),
        ("b.png", png(9000, 9000, 16, 6, 0), memory),
        ("c.png", png(9000, 9000, 8, 2, 1), memory),
        ("d.png", png(1, 40_000, 1, 0, 0), "a picture of 1 x 40000 pixels"),
        ("a.tif", tiff(60_000, 60_000), "a picture of 60000 x 60000 pixels"),
        ("b.tif", tiff(9000, 9000), memory),
        ("a.jpg", jpeg(65_535, 65_535), "a picture of 65535 x 65535 pixels"),
        ("b.jpg", jpeg(9000, 9000), memory),
        ("c.jpg", jpeg(500, 500), "a JPEG of 500 x 500 pixels does not fit in"),
        ("d.jpg", jpeg_of_scans(300), "a JPEG of more than 256 scans"),
        ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9000 +X 9000\n".to_vec(), memory),
        ("a.exr", exr(&folder, "displayWindow", 16_001), memory),
        ("b.exr", exr(&folder, "dataWindow", 9000), "EXR: "),
        ("c.exr", exr(&folder, "displayWindow", 40_000), "a picture of 40000 x 40000 pixels"),
    ];
    for (name, bytes, expected) in cases {
        let access = FileAccess::new(limits(64 << 20));
        let error = said(read_radiance(&folder.write(name, bytes), &access));
        assert!(error.contains(name) && error.contains(expected), "{error}\nexpected: {expected}");
        assert_eq!(expected == memory, error.contains("raise option `memory_bytes`"), "{error}");
        assert_eq!(access.budget().left(), 64 << 20, "{name}");
    }
    // The same picture is read where it may be.
    let path = folder.write("plain.exr", std::fs::read(folder.0.path().join("plain.exr")).unwrap());
    assert_eq!(read_radiance(&path, &access()).unwrap().width, 8);
}

#[test]
fn ply_counts_stay_within_the_file() {
    let most = u64::MAX;
    let (xyz, list) =
        ("property float x\nproperty float y\nproperty float z\n", "property list uchar int vertex_indices\n");
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let read = |elements: &str, body: &[u8]| {
            let header = format!("ply\nformat {format} 1.0\n{elements}end_header\n");
            said(parse("a.ply", &[header.as_bytes(), body].concat(), &access()))
        };
        let error = read(&format!("element junk {most}\n"), b"");
        assert!(
            error.ends_with("a.ply: PLY element 'junk' of 18446744073709551615: an element without properties"),
            "{error}"
        );
        let error = read(&format!("element vertex {most}\n{xyz}"), b"0 0 0\n");
        assert!(error.contains("PLY element 'vertex' of 18446744073709551615: 6 bytes are left, room for"), "{error}");
        let error = read(&format!("element vertex 1\n{xyz}element face 4294967295\n{list}"), &[b'0'; 12]);
        assert!(error.contains("PLY element 'face' of 4294967295") || error.contains("'vertex'"), "{error}");
        let error = read("element vertex 2000000\nproperty uchar x\n", &[b'\n'; 8_000_000]);
        assert!(error.contains("a.ply: mesh: 240000000 bytes of memory are requested"), "{error}");
        let error = read(&"comment\n".repeat(200_000), b"");
        assert!(error.contains("no end_header within 1048576 bytes"), "{error}");
    }
    // A list whose length is claimed.
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\n{xyz}element face 1\nproperty list uint int vertex_indices\nend_header\n"
    );
    let error = said(parse("a.ply", &[header.as_bytes(), &[0; 12], &[0xff; 20]].concat(), &access()));
    assert!(error.contains("PLY element 'face' of 1") && error.contains("truncated or damaged"), "{error}");
}

#[test]
fn obj_text_is_charged_for_what_it_becomes() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let memory = |error: &str| error.contains("a.obj: ") && error.contains("raise option `memory_bytes`");
    for endless in
        ["f 1 2 3\n".repeat(100_000), format!("f{}\n", " 1 2 3".repeat(100_000)), "o a\nf 1 2 3\n".repeat(20_000)]
    {
        let error = said(parse("a.obj", format!("{corners}{endless}").as_bytes(), &access()));
        assert!(memory(&error), "{error}");
    }
    for index in ["4", "4294967297", "-4", "-9223372036854775808"] {
        let error = said(parse("a.obj", format!("{corners}f 1 2 {index}\n").as_bytes(), &access()));
        assert!(error.contains(&format!("line 4, a face names vertex {index} of 3")), "{error}");
    }
    // Materials are not followed, wherever they lead.
    let text = format!("mtllib /dev/zero\nusemtl a\n{corners}f 1 2 3\n");
    assert_eq!(parse("a.obj", text.as_bytes(), &access()).unwrap().triangles.len(), 1);
}

/// A glTF document of one triangle, its buffer in `uri`.
fn gltf(uri: &str) -> String {
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}], "buffers": [{{"byteLength": 36, "uri": "{uri}"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}}]}}"#
    )
}

#[test]
fn gltf_buffers_stay_in_the_folder_and_accessors_in_their_buffers() {
    let folder = Folder::new();
    let triangle: Vec<u8> =
        [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    folder.write("outside.bin", &triangle);
    folder.write("in/.hidden/a.bin", &triangle);
    folder.write("in/a b.bin", &triangle);
    let path = folder.0.path().join("in/a.gltf");
    let read = |text: &str, access: &FileAccess| parse(&path, text.as_bytes(), access);
    assert_eq!(read(&gltf("a%20b.bin"), &access()).unwrap().triangles, [[0, 1, 2]]);
    let outside = folder.0.path().join("outside.bin").display().to_string();
    let absolute = format!("file://{outside}");
    let references = [
        "../outside.bin",
        "%2e%2e/outside.bin",
        "..%2Foutside.bin",
        "..\\\\outside.bin",
        "./x/../../outside.bin",
        ".hidden/a.bin",
        "C:/a.bin",
        "C:%5Ca.bin",
        "//server/a.bin",
        "http://server/a.bin",
        &outside,
        &absolute,
    ];
    for uri in references {
        let error = said(read(&gltf(uri), &access()));
        assert!(
            error.contains("in/a.gltf: the path ") && error.contains("unless option `allow_outside` is given"),
            "{uri}: {error}"
        );
    }
    for uri in ["../outside.bin", "%2e%2e/outside.bin", ".hidden/a.bin", &outside, &absolute] {
        assert!(read(&gltf(uri), &access().allow_outside(true)).is_ok(), "{uri}");
    }
    let error = said(read(&gltf("a%20b.bin").replace("\"count\": 3", "\"count\": 4294967295"), &access()));
    assert!(error.contains("4294967295 vertices, 67108864 at most are read"), "{error}");
    let error = said(read(&gltf("a%20b.bin").replace("\"count\": 3", "\"count\": 30000"), &access()));
    assert!(error.contains("mesh 0, primitive 0: positions: accessor 0 reaches past the end of its data"), "{error}");
    // One accessor, a hundred thousand times.
    let primitive = r#"{"attributes": {"POSITION": 0}}"#;
    let many = gltf("a%20b.bin").replace(primitive, &[primitive; 100_000].join(","));
    assert!(said(read(&many, &access())).contains("raise option `memory_bytes`"));
    let nodes = gltf("a%20b.bin").replace("[{\"mesh\": 0}]", &format!("[{}]", ["{}"; 50_000].join(",")));
    assert!(said(read(&nodes, &access())).contains("glTF JSON: "));
}

const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/sample-spot");

/// A copy of the sample's description and its first frames, `edit`ed as text.
fn capture(edit: impl Fn(String) -> String) -> Folder {
    let folder = Folder::new();
    let sample = Path::new(SAMPLE);
    for entry in walk(sample) {
        let name = entry.strip_prefix(sample).unwrap().to_str().unwrap();
        folder.write(name, std::fs::read(&entry).unwrap());
    }
    let text = std::fs::read_to_string(sample.join("transforms.json")).unwrap();
    folder.write("transforms.json", edit(text));
    folder
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}

fn first_photograph() -> String {
    describe(SAMPLE, &FileAccess::default()).unwrap().frames[0].view.name.clone()
}

#[test]
fn captures_name_only_their_own_files() {
    let first = first_photograph();
    let whole = format!("\"{first}\"");
    for name in
        ["/etc/passwd", "../x.png", "..\\\\x.png", "a/../../x.png", ".ssh/id_rsa", "C:\\\\x.png", "file:///etc/passwd"]
    {
        for (key, value) in [("first frame", whole.as_str()), ("mesh", "\"scan.ply\""), ("white", "\"white_off.exr\"")]
        {
            let folder = capture(|text| text.replacen(value, &format!("\"{name}\""), 1));
            let error = said(describe(folder.0.path(), &access()));
            let expected = error.contains("transforms.json: the path ") && error.contains("`allow_outside`");
            assert!(expected, "{key} {name}: {error}");
        }
    }
}

#[test]
fn no_absolute_name_gets_into_a_view() {
    let first = first_photograph();
    let folder = capture(|text| text);
    let absolute = folder.0.path().join(&first).display().to_string();
    let text = std::fs::read_to_string(folder.0.path().join("transforms.json")).unwrap();
    folder.write("transforms.json", text.replacen(&format!("\"{first}\""), &format!("\"{absolute}\""), 1));
    let capture = read(folder.0.path(), &CaptureReadOptions::default()).unwrap();
    assert_eq!(capture.frames[0].view.name, first);
    assert!(capture.frames.iter().all(|frame| Path::new(&frame.view.name).is_relative()));
    // A photograph outside, which was allowed.
    let other = Folder::new();
    let elsewhere = other.write("somebody/first.exr", std::fs::read(folder.0.path().join(&first)).unwrap());
    folder.write("transforms.json", text.replacen(&format!("\"{first}\""), &format!("{elsewhere:?}"), 1));
    assert!(said(read(folder.0.path(), &CaptureReadOptions::default())).contains("`allow_outside`"));
    let options = CaptureReadOptions { allow_outside: true, ..Default::default() };
    assert_eq!(read(folder.0.path(), &options).unwrap().frames[0].view.name, "first.exr");
}

#[cfg(unix)]
#[test]
fn folders_devices_and_pipes_are_no_files() {
    let first = first_photograph();
    for (value, key) in
        [(format!("\"{first}\""), "photograph"), ("\"scan.ply\"".into(), "mesh"), ("\"white_off.exr\"".into(), "white")]
    {
        for (name, expected) in [
            ("masks-are-here", "is a folder, not a file"),
            ("pipe", "is a pipe, a device or a socket; only regular files are read"),
            ("zero", "leads out of its folder by a link"),
            ("circle", "is a link that leads nowhere"),
        ] {
            let folder = capture(|text| text.replacen(&value, &format!("\"{name}\""), 1));
            std::fs::create_dir(folder.0.path().join("masks-are-here")).unwrap();
            std::os::unix::fs::symlink("/dev/zero", folder.0.path().join("zero")).unwrap();
            std::os::unix::fs::symlink("circle", folder.0.path().join("circle")).unwrap();
            let made = std::process::Command::new("mkfifo").arg(folder.0.path().join("pipe")).status();
            if name == "pipe" && !made.is_ok_and(|status| status.success()) {
                continue;
            }
            let error = said(read(folder.0.path(), &CaptureReadOptions::default()));
            assert!(error.contains(expected), "{key}, {name}: {error}");
        }
    }
    assert!(said(read_radiance(Path::new("/dev/zero"), &access())).contains("only regular files are read"));
    assert!(said(capture::read_calibration("/dev/zero", &access())).contains("only regular files are read"));
    assert!(said(tsuya::mesh::read("/dev/zero", &access())).contains("only regular files are read"));
    assert!(said(tsuya::brdf::MerlTable::read("/dev/zero", &access())).contains("only regular files are read"));
    assert!(said(tsuya::brdf::RglMaterial::read("/dev/zero", &access())).contains("only regular files are read"));
}

#[test]
fn descriptions_of_any_length_are_bounded() {
    let folder = Folder::new();
    let describe = |text: String| said(describe(folder.write("transforms.json", text), &FileAccess::default()));
    let error = describe(format!("{{\"frames\": [{}]}}", ["{}"; 70_000].join(",")));
    assert!(error.ends_with("line 1, frames: a list of 70000, 65536 at most are read"), "{error}");
    let error = describe(format!("{{\"frames\": {}", "[".repeat(1_000_000)));
    assert!(error.contains("recursion limit exceeded") && error.len() < 400, "{error}");
    let error = describe(format!("{{\"frames\": \"{}\"}}", "x".repeat(1_000_000)));
    assert!(error.contains("expected a list, found \"xxxx") && error.len() < 400, "{error}");
    let small = FileAccess::new(limits(1 << 20));
    let path = folder.write("transforms.json", "0,".repeat(100_000));
    let error = said(tsuya::capture::describe(&path, &small));
    assert!(error.contains("JSON document: ") && error.contains("raise option `memory_bytes`"), "{error}");
    assert_eq!(small.budget().left(), 1 << 20);
}

#[test]
fn kinds_of_light_are_named_a_few_times_only() {
    let pose = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]";
    let frame =
        |k: usize| format!(r#"{{"file_path": "a.png", "transform_matrix": {pose}, "light": {{"type": "kind {k}"}}}}"#);
    let frames: Vec<String> = (0..20_000).map(frame).collect();
    let folder = Folder::new();
    let path =
        folder.write("transforms.json", format!(r#"{{"w": 4, "h": 4, "fl_x": 4, "frames": [{}]}}"#, frames.join(",")));
    let warnings = describe(path, &FileAccess::default()).unwrap().warnings;
    assert_eq!(warnings.len(), 9);
    assert_eq!(warnings[0], "light type \"kind 0\" is not a point light: taken as unknown");
    assert_eq!(warnings[8], "the lights of 19992 frames are of yet other types: taken as unknown");
}

#[test]
fn a_colmap_model_is_read_from_its_workspace() {
    let folder = Folder::new();
    folder.write("images/a.png", "x");
    folder.write("sparse/0/cameras.txt", "1 PINHOLE 32 32 50 50 16 16\n");
    let images = |name: &str| folder.write("sparse/0/images.txt", format!("1 1 0 0 0 0 0 1 1 {name}\n\n"));
    images("a.png");
    let described = describe(folder.0.path().join("sparse/0"), &access())
        .unwrap_or_else(|_| describe(folder.0.path(), &access()).unwrap());
    assert_eq!(described.frames[0].photograph.first(), folder.0.path().join("images/a.png"));
    for name in ["../../x.png", "/etc/passwd", ".ssh/id_rsa", "..\\..\\x.png"] {
        images(name);
        let error = said(describe(folder.0.path(), &access()));
        assert!(error.contains("images.txt: the path ") && error.contains("`allow_outside`"), "{name}: {error}");
    }
    images(&"x".repeat(5000));
    assert!(said(describe(folder.0.path(), &access())).contains("line 1: a NAME of 5000 bytes, 4096 at most are read"));
    // Counts that are claimed.
    folder.write("sparse/0/cameras.bin", [0xff; 8]);
    folder.write("sparse/0/images.bin", [0xff; 8]);
    assert!(said(describe(folder.0.path(), &access())).contains("the file ends at byte 8 within camera 0"));
}

#[test]
fn photographs_are_charged_together() {
    let options = |memory_bytes| CaptureReadOptions { limits: limits(memory_bytes), ..Default::default() };
    let error = said(read(SAMPLE, &options(4 << 20)));
    assert!(
        error.contains("transforms.json: photographs of the capture: ")
            && error.contains("raise option `memory_bytes`"),
        "{error}"
    );
    // As many are read at once as fit: little more than the photographs themselves is enough.
    let capture = read(SAMPLE, &options(64 << 20)).unwrap();
    assert_eq!(capture.frames.len(), 36);
    assert_eq!(capture.frames, read(SAMPLE, &CaptureReadOptions::default()).unwrap().frames);
}

#[test]
fn a_mesh_in_another_unit_is_told() {
    let scan = std::fs::read(Path::new(SAMPLE).join("scan.ply")).unwrap();
    let scaled = |factor: f32| {
        let folder = capture(|text| text);
        let mesh = parse("scan.ply", &scan, &FileAccess::default()).unwrap();
        let mut text = String::new();
        mesh.positions
            .iter()
            .for_each(|p| _ = writeln!(text, "v {} {} {}", p[0] * factor, p[1] * factor, p[2] * factor));
        mesh.triangles.iter().for_each(|t| _ = writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1));
        let path = folder.write("scaled.obj", text);
        (folder, path)
    };
    let words = [
        (
            1e3,
            "the mesh is about 1,000 times larger than the cameras' distance: millimetres? Scale it with option `mesh_scale` 0.001",
        ),
        (1e2, "about 100 times larger than the cameras' distance: centimetres? Scale it with option `mesh_scale` 0.01"),
        (
            1e-3,
            "about 1,000 times smaller than the cameras' distance: metres, and the cameras in millimetres? Scale it with option `mesh_scale` 1000",
        ),
        (
            1e6,
            "about 1,000,000 times larger than the cameras' distance, which is no unit of length. Scale it with option `mesh_scale` 0.000001",
        ),
    ];
    for (factor, expected) in words {
        let (folder, mesh) = scaled(factor);
        let options = CaptureReadOptions { mesh: Some(mesh.clone()), ..Default::default() };
        let error = said(read(folder.0.path(), &options));
        assert!(error.contains("scaled.obj: ") && error.contains(expected), "{error}\nexpected: {expected}");
        let options = CaptureReadOptions { mesh_scale: Some(1.0 / f64::from(factor)), ..options };
        assert_eq!(read(folder.0.path(), &options).unwrap().frames.len(), 36);
        // Taken as it is, it is refused by the work that it makes.
        if factor == 1e3 {
            let mesh = read(folder.0.path(), &CaptureReadOptions { mesh_scale: Some(1.0), ..options }).unwrap().mesh;
            let error = tsuya::internals::surface::atlas::layout(&mesh, 100.0).unwrap_err();
            assert!(
                matches!(&error, Error::Parameter(text) if text.contains("million texels, 67.1 at most")),
                "{error}"
            );
        }
    }
}
