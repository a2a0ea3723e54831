//! Pictures and meshes in the formats that are read.

use crate::{Seeds, pictures, scene};
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, Vec2, WritableImage, write_rgb_file,
};
use image::{DynamicImage, ImageFormat};
use std::fmt::Write;
use std::io::Cursor;

/// Puts photographs and meshes.
pub fn put(seeds: &Seeds) {
    photographs(seeds);
    videos(seeds);
    meshes(seeds);
}

fn videos(seeds: &Seeds) {
    for (chroma, bytes) in [("420jpeg", 12), ("420mpeg2", 12), ("420paldv", 12), ("422", 16), ("444", 24), ("mono", 8)]
    {
        let mut stream = format!("YUV4MPEG2 W4 H2 F30000:1001 Ip A1:1 C{chroma} XYSCSS={chroma}\n").into_bytes();
        for frame in 0..2 {
            stream.extend(b"FRAME\n");
            stream.extend((0..bytes).map(|k| (frame * 40 + k * 9) as u8));
        }
        seeds.put("photograph", &format!("video-{chroma}"), stream);
    }
    seeds.put("photograph", "video-full", "YUV4MPEG2 W2 H1 F25:1 C444 XCOLORRANGE=FULL\nFRAME Ip\nabcdef");
    seeds.put("photograph", "video-deep", "YUV4MPEG2 W2 H1 F25:1 C420p10\nFRAME\nabcdef");
}

fn photographs(seeds: &Seeds) {
    let value = |x: u32, y: u32, k: u32| (x * 31 + y * 17 + k * 50) as u8;
    let colour = image::RgbImage::from_fn(8, 4, |x, y| image::Rgb([0, 1, 2].map(|k| value(x, y, k))));
    let colour = DynamicImage::ImageRgb8(colour);
    let kinds = [
        ("grey", DynamicImage::ImageLuma8(colour.to_luma8())),
        ("alpha", DynamicImage::ImageRgba8(colour.to_rgba8())),
        ("deep", DynamicImage::ImageRgb16(colour.to_rgb16())),
        ("float", DynamicImage::ImageRgb32F(colour.to_rgb32f())),
        ("colour", colour),
    ];
    let formats = [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Jpeg, ImageFormat::Hdr];
    for (name, picture) in &kinds {
        for format in formats {
            let mut bytes = Vec::new();
            // Not every format takes every kind.
            if picture.write_to(&mut Cursor::new(&mut bytes), format).is_ok() {
                seeds.put("photograph", &format!("{name}.{}", format.extensions_str()[0]), bytes);
            }
        }
    }
    seeds.put("photograph", "plain.tif", pictures::tiff(6, 3, |x, y| value(x, y, 0)));
    let folder = std::env::temp_dir().join(format!("tsuya-seeds-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for temporary files");
    let path = folder.join("a.exr");
    write_rgb_file(&path, 8, 4, |x, y| (x as f32, y as f32, 0.5)).expect("a picture");
    seeds.put("photograph", "colour.exr", std::fs::read(&path).expect("the picture"));
    let _ = std::fs::remove_dir_all(&folder);
    for (name, compression) in [
        ("plain", Compression::Uncompressed),
        ("rle", Compression::RLE),
        ("zip", Compression::ZIP1),
        ("piz", Compression::PIZ),
        ("pxr24", Compression::PXR24),
        ("b44", Compression::B44),
    ] {
        let channel = |name: &str, k: usize| {
            AnyChannel::new(name, FlatSamples::F32((0..32).map(|at| (at * k % 7) as f32 * 0.25).collect()))
        };
        let channels = AnyChannels::sort(["R", "G", "B", "A"].iter().zip(1..).map(|(n, k)| channel(n, k)).collect());
        let encoding = Encoding { compression, ..Encoding::UNCOMPRESSED };
        let layer = Layer::new((8, 4), LayerAttributes::named("main"), encoding, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("a picture");
        seeds.put("photograph", &format!("{name}.exr"), bytes.into_inner());
    }
    seeds.put("photograph", "parts.exr", exr_of_parts());
    profiles(seeds);
}

/// Pictures that say something about their colours.
fn profiles(seeds: &Seeds) {
    use image::ImageEncoder;
    for (name, profile) in [
        ("p3", moxcms::ColorProfile::new_display_p3()),
        ("adobe", moxcms::ColorProfile::new_adobe_rgb()),
        ("grey", moxcms::ColorProfile::new_gray_with_gamma(2.2)),
    ] {
        let profile = profile.encode().expect("a profile");
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = image::codecs::tiff::TiffEncoder::new(&mut bytes);
        encoder.set_icc_profile(profile.clone()).expect("TIFF holds profiles");
        encoder.write_image(&[90; 96], 8, 4, image::ExtendedColorType::Rgb8).expect("a picture");
        seeds.put("photograph", &format!("{name}.tif"), bytes.into_inner());
        let mut bytes = Vec::new();
        let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
        encoder.set_icc_profile(profile).expect("PNG holds profiles");
        encoder.write_image(&[90; 96], 8, 4, image::ExtendedColorType::Rgb8).expect("a picture");
        seeds.put("photograph", &format!("{name}.png"), bytes);
    }
    let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nCOLORCORR=1 2 4\nPRIMARIES=.7 .3 .2 .7 .1 .1 .33 .33\n\n-Y 4 +X 7\n";
    seeds.put("photograph", "header.hdr", [header.as_bytes(), &[128; 112]].concat());
}

/// Depth, then colour in a window of its own.
fn exr_of_parts() -> Vec<u8> {
    let part = |name: &str, channels: &[&str], at: i32| {
        let values = |k: usize| FlatSamples::F32((0..32).map(|at| (at * k % 7) as f32 * 0.25).collect());
        let channels = channels.iter().zip(1..).map(|(name, k)| AnyChannel::new(*name, values(k)));
        let mut attributes = LayerAttributes::named(name);
        attributes.layer_position = Vec2(at, at);
        Layer::new((8, 4), attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(channels.collect()))
    };
    let parts = vec![part("depth", &["Z"], 0), part("beauty", &["R", "G", "B", "A"], 1)];
    let window = ImageAttributes::new(IntegerBounds::from_dimensions((8, 4)));
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layers(window, parts).write().non_parallel().to_buffered(&mut bytes).expect("a picture");
    bytes.into_inner()
}

/// The first byte says which of the extensions: PLY, OBJ, GLB, glTF.
fn meshes(seeds: &Seeds) {
    let mesh = scene::mesh();
    let put = |kind: u8, name: &str, content: &[u8]| seeds.put("mesh_file", name, [&[kind][..], content].concat());
    put(0, "ascii.ply", pictures::ply().as_bytes());
    for order in ["little", "big"] {
        let mut bytes = pictures::ply().split("end_header\n").next().expect("a head").to_owned();
        bytes.push_str("end_header\n");
        let mut bytes = bytes.replace("ascii", &format!("binary_{order}_endian")).into_bytes();
        let little = order == "little";
        for x in mesh.positions.iter().flatten() {
            bytes.extend(if little { x.to_le_bytes() } else { x.to_be_bytes() });
        }
        for triangle in &mesh.triangles {
            bytes.push(3);
            triangle.iter().for_each(|v| bytes.extend(if little { v.to_le_bytes() } else { v.to_be_bytes() }));
        }
        put(0, &format!("{order}.ply"), &bytes);
    }
    let mut obj = String::from("# comment\nmtllib a.mtl\no part\n");
    for [x, y, z] in &mesh.positions {
        let _ = writeln!(obj, "v {x} {y} {z}\nvt {x} {y}\nvn {x} {y} {z}");
    }
    for [a, b, c] in mesh.triangles.iter().map(|triangle| triangle.map(|v| v + 1)) {
        let _ = writeln!(obj, "f {a}/{a}/{a} {b}/{b} {c}");
    }
    put(1, "mixed.obj", obj.as_bytes());
    put(1, "quads.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\ng a\nusemtl b\nf -4 -3 -2 -1\nf 1/1 2/1 3/1\n");
    let (document, binary) = gltf(false);
    put(2, "mesh.glb", &glb(&document, &binary));
    put(3, "mesh.gltf", gltf(true).0.as_bytes());
    seeds.put("gltf", "appearance.glb", appearance());
    seeds.put("gltf", "mesh.glb", glb(&document, &binary));
    seeds.put("gltf", "mesh.gltf", gltf(true).0);
    seeds.put("gltf", "materials.glb", materials());
}

/// A document with materials of every kind that is read, two of them with a picture.
fn materials() -> Vec<u8> {
    let mut png = Vec::new();
    let picture = image::RgbImage::from_fn(3, 2, |x, y| image::Rgb([90 * x as u8, 120, 250 * y as u8]));
    picture.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let document = serde_json::json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": png.len() }],
        "bufferViews": [{ "buffer": 0, "byteLength": png.len() }],
        "images": [{ "bufferView": 0 }, { "uri": "a.png" }],
        "textures": [{ "source": 0 }, { "source": 1 }],
        "meshes": [{ "primitives": [{ "attributes": { "COLOR_0": 0 }, "material": 0 }] }],
        "materials": [
            { "name": "a", "pbrMetallicRoughness": { "baseColorFactor": [1, 0.5, 0.2, 1], "metallicFactor": 0.3, "roughnessFactor": 0.4,
                "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 0 } }, "alphaMode": "BLEND" },
            { "extensions": { "KHR_materials_ior": { "ior": 1.8 }, "KHR_materials_specular": { "specularFactor": 0.5,
                "specularColorFactor": [1, 2, 0], "specularColorTexture": { "index": 1 }, "specularTexture": { "index": 0 } } } },
            { "name": "a", "emissiveFactor": [0, 0, 1], "extensions": { "KHR_materials_sheen": {},
                "KHR_materials_pbrSpecularGlossiness": { "diffuseFactor": [0.5, 0.5, 0, 1], "specularFactor": [0.2, 0.2, 0.2],
                "glossinessFactor": 0.6, "diffuseTexture": { "index": 0 }, "specularGlossinessTexture": { "index": 0 } } } },
        ],
    });
    glb(&document.to_string(), &png)
}

/// A document with the scene's mesh under a turned node, and its buffer, which may stand in the document.
fn gltf(inside: bool) -> (String, Vec<u8>) {
    let mesh = scene::mesh();
    let mut binary: Vec<u8> = mesh.positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let positions = binary.len();
    binary.extend(mesh.triangles.iter().flatten().flat_map(|&v| (v as u16).to_le_bytes()));
    let mut buffer = serde_json::json!({ "byteLength": binary.len() });
    if inside {
        buffer["uri"] = format!("data:application/octet-stream;base64,{}", base64(&binary)).into();
    }
    let document = serde_json::json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [
            { "children": [1], "rotation": [0, 0.6, 0, 0.8], "scale": [1, -1, 2] },
            { "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1] },
        ],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0 }, "indices": 1 },
            { "attributes": { "POSITION": 0 }, "mode": 5 },
            { "attributes": { "POSITION": 0 }, "indices": 1, "mode": 6 },
        ] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1] },
            { "bufferView": 1, "componentType": 5123, "count": 24, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": positions, "byteStride": 12 },
            { "buffer": 0, "byteOffset": positions, "byteLength": binary.len() - positions },
        ],
        "buffers": [buffer],
    });
    (document.to_string(), binary)
}

/// A triangle with a stream and a trace of it.
fn appearance() -> Vec<u8> {
    let numbers = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0.1, 0.1, 0.3, 0.1, 0.1, 0.3f32];
    let mut binary: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    binary.extend(b"the stream");
    let name = "TSUYA_materials_appearance";
    let views = [(0, 36), (36, 24), (60, 10)];
    let views = views.map(|(from, length)| serde_json::json!({"buffer": 0, "byteOffset": from, "byteLength": length}));
    let document = serde_json::json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": binary.len() }],
        "bufferViews": views,
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" },
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] }],
        "materials": [{ "extensions": { name: { "appearance": 0 } }, "extras": { name: { "appearance": 0 } } }],
        "extensionsUsed": [name],
        "extensions": { name: {
            "version": 1,
            "appearances": [{ "bufferView": 2, "mimeType": "model/vnd.tsuya", "levels": [10] }],
        } },
    });
    glb(&document.to_string(), &binary)
}

fn glb(document: &str, binary: &[u8]) -> Vec<u8> {
    let mut chunks = Vec::new();
    for (kind, fill, content) in [(b"JSON", b' ', document.as_bytes()), (b"BIN\0", 0, binary)] {
        let padded = content.len().next_multiple_of(4);
        chunks.extend((padded as u32).to_le_bytes());
        chunks.extend(kind);
        chunks.extend(content);
        chunks.resize(chunks.len() + padded - content.len(), fill);
    }
    let head = [*b"glTF", 2u32.to_le_bytes(), (chunks.len() as u32 + 12).to_le_bytes()].concat();
    [head, chunks].concat()
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |bits, k| bits << 8 | three.get(k).copied().unwrap_or(0) as u32);
        for k in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * k) & 63) as usize] as char;
            text.push(if k <= three.len() { letter } else { '=' });
        }
    }
    text
}
