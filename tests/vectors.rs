//! The test vectors of `spec/vectors`, which `cargo run --release --features internals --example vectors` writes, against the library and against the reference
//! decoder.

#[path = "../tools/platforms/src/checksums.rs"]
mod checksums;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use tsuya::brdf::Brdf;
use tsuya::image::Mask;
use tsuya::internals::entropy::{
    AverageModel, BitCoder, BitModel, Mixer, MixerContext, NumberModel, RangeDecoder, RansDecoder, SymbolCoder,
    SymbolModel, code_end,
};
use tsuya::internals::quantise::Quantiser;
use tsuya::internals::residual::MaskModels;
use tsuya::internals::residual::coefficients::{
    CoefficientModels, Modelling, PictureStreams, PictureTask, Prediction, Tiling,
};
use tsuya::internals::transform::{ColourLanes, WaveletPlan};
use tsuya::{Error, brdf, internals};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("spec/vectors")
}

fn cases(name: &str) -> Vec<Value> {
    let text = std::fs::read(folder().join(format!("{name}.json"))).unwrap();
    let vectors: Value = serde_json::from_slice(&text).unwrap();
    assert_eq!(vectors["vectors"], format!("tsuya 0.1, {name}"));
    vectors["cases"].as_array().unwrap().clone()
}

fn bytes(hex: &Value) -> Vec<u8> {
    let hex = hex.as_str().unwrap();
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn singles(hex: &Value) -> Vec<f32> {
    let value = |four: &[u8]| f32::from_be_bytes([four[0], four[1], four[2], four[3]]);
    bytes(hex).chunks(4).map(value).collect()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| (value + 0.0).to_bits()).collect()
}

fn numbers(list: &Value) -> Vec<i64> {
    list.as_array().unwrap().iter().map(|v| v.as_i64().unwrap_or_else(|| v.as_bool().unwrap() as i64)).collect()
}

fn rows(case: &Value) -> Mask {
    let rows: Vec<&str> = case.as_array().unwrap().iter().map(|row| row.as_str().unwrap()).collect();
    let data = rows.iter().flat_map(|row| row.bytes().map(|byte| byte == b'#')).collect();
    Mask { width: rows[0].len(), height: rows.len(), data }
}

/// Checksums of all that the golden files decode to, in both profiles and every decoding mode.
#[test]
fn golden_files_decode_to_what_they_did() {
    let mut files = 0;
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "tsuya") {
            let expected = std::fs::read_to_string(path.with_extension("txt")).unwrap();
            let (title, expected) = expected.split_once('\n').unwrap();
            assert!(title.starts_with("tsuya 0.1, "), "{title}");
            assert_eq!(checksums::checksums_of(&std::fs::read(&path).unwrap()), expected, "{}", path.display());
            files += 1;
        }
    }
    assert_eq!(files, 16);
}

#[test]
fn streams_give_the_values_that_entropy_md_says() {
    for case in cases("entropy") {
        let (kind, stream) = (case["kind"].as_str().unwrap(), bytes(&case["stream"]));
        let mut coder = RangeDecoder::new(&stream);
        let expected = numbers(case.get("values").unwrap_or(&case["bits"]));
        let contexts = case["contexts"].as_array().map(|list| list.iter().map(numbers).collect::<Vec<_>>());
        let contexts = contexts.unwrap_or_default();
        let counts = |key: &str| numbers(&case[key]).iter().map(|&count| count as usize).collect::<Vec<_>>();
        let found: Vec<i64> = match kind {
            "bit" => numbers(&case["probabilities"]).iter().map(|&p| coder.bit(p as u32, false) as i64).collect(),
            "model" => {
                let mut model = BitModel::default();
                expected.iter().map(|_| model.code(&mut coder, false) as i64).collect()
            }
            "number" => {
                let mut model = NumberModel::default();
                expected.iter().map(|_| model.code(&mut coder, 0) as i64).collect()
            }
            "signed" => {
                let mut model = NumberModel::default();
                expected.iter().map(|_| model.code_signed(&mut coder, 0) as i64).collect()
            }
            "mixer" => {
                let mut mixer =
                    Mixer::new(counts("slots").try_into().unwrap(), counts("selectors").try_into().unwrap());
                let context = |c: &[i64]| MixerContext {
                    slots: std::array::from_fn(|k| c[k] as u32),
                    selectors: std::array::from_fn(|k| c[8 + k] as u32),
                };
                contexts.iter().map(|c| mixer.code(&mut coder, &context(c), false) as i64).collect()
            }
            "average" => {
                let mut average = AverageModel::new(counts("slots").try_into().unwrap());
                let mut code = |c: &[i64]| average.code(&mut coder, &[c[0] as u32, c[1] as u32], false) as i64;
                contexts.iter().map(|c| code(c)).collect()
            }
            "symbols" => {
                let mut coder = RansDecoder::new(&stream);
                let mut symbols = SymbolModel::new(counts("slots").try_into().unwrap());
                let extra: Vec<Vec<i64>> = case["equiprobable"].as_array().unwrap().iter().map(numbers).collect();
                let mut code = |(c, extra): (&Vec<i64>, &Vec<i64>)| {
                    let value = symbols.code(&mut coder, [c[0] as u32, c[1] as u32], 0);
                    assert_eq!(coder.equiprobable(extra[0] as u32, 0) as i64, extra[1]);
                    value as i64
                };
                let found: Vec<i64> = contexts.iter().zip(&extra).map(&mut code).collect();
                assert_eq!(found, expected, "{kind}");
                assert!(coder.ends_as_written());
                continue;
            }
            _ => panic!("{kind}"),
        };
        assert_eq!(found, expected, "{kind}");
        assert!(code_end(&mut coder) && coder.ends_as_written(0), "{kind}");
    }
}

#[test]
fn masks_and_planes_are_what_planes_md_says() {
    for case in cases("masks") {
        let stream = bytes(&case["stream"]);
        let mut coder = RangeDecoder::new(&stream);
        let found =
            internals::residual::code_mask(&mut coder, &mut MaskModels::default(), &rows(&case["coverage"]), None);
        assert_eq!(found, rows(&case["mask"]));
        assert!(coder.ends_as_written(0));
    }
    for case in cases("planes") {
        let mask = rows(&case["mask"]);
        let plan = WaveletPlan::new(&mask);
        let (step, shrink) = (singles(&case["step"])[0], singles(&case["shrink"]));
        let quantiser = Quantiser { step, shrink: [shrink[0], shrink[1]] };
        let part = |name: &str| {
            if !case[name].is_string() {
                return None;
            }
            let values = singles(&case[name]);
            let mut values = values.chunks(3);
            let mut pixel = |&set: &bool| -> ColourLanes {
                if !set {
                    return [0.0; 4];
                }
                let v = values.next().unwrap();
                [v[0], v[1], v[2], 0.0]
            };
            Some(plan.forward(mask.data.iter().map(&mut pixel).collect()))
        };
        let (views, correction) = (part("predicted"), part("correction"));
        let modelling = if case["modelling"] == "mixed" { Modelling::Mixed } else { Modelling::Direct };
        let (stream, mut models) = (bytes(&case["stream"]), CoefficientModels::new(modelling));
        let tiling = Tiling::default();
        let (plan, quantiser) = (&plan, &quantiser);
        let prediction = Prediction { views: views.as_deref(), correction: correction.as_deref() };
        let task = PictureTask { plan, quantiser, prediction, tiling: &tiling, tiled_bands: &[] };
        let streams = PictureStreams { base: &stream[..], tiles: Vec::new() };
        let found = internals::residual::coefficients::decode(&streams, &mut models, &task, Default::default());
        let found = found.expect("a stream that ends rightly");
        let picture = plan.inverse(&found);
        let in_mask = picture.iter().zip(&mask.data).filter(|(_, set)| **set);
        let in_mask: Vec<f32> = in_mask.flat_map(|(pixel, _)| [pixel[0], pixel[1], pixel[2]]).collect();
        assert_eq!(bits(&in_mask), bits(&singles(&case["picture"])), "{}", case["modelling"]);
    }
}

#[test]
fn materials_have_the_values_that_materials_md_says() {
    for case in cases("materials").into_iter().chain(cases("models")) {
        let found = brdf::decode_materials(&bytes(&case["section"]), &tsuya::Budget::new(Default::default())).unwrap();
        let named = found.iter().find(|material| case["name"] == material.name.as_str()).unwrap();
        for value in case["values"].as_array().unwrap() {
            let three = |k: usize| [0, 1, 2].map(|c| value[k][c].as_f64().unwrap());
            let (found, expected) = (named.material.evaluate(three(0), three(1)), three(2));
            let near = |c: usize| (found[c] - expected[c]).abs() <= 1e-9 * expected[c].abs();
            assert!((0..3).all(near), "{}: {found:?} {expected:?}", named.name);
        }
    }
}

#[test]
fn files_that_break_a_rule_are_refused() {
    for case in cases("refused") {
        let found = match tsuya::decoder::decode(&bytes(&case["file"]), &Default::default()) {
            Ok(_) => "sound",
            Err(Error::Format { .. }) => "damaged",
            Err(Error::Unsupported(_)) => "unsupported",
            Err(error) => panic!("{case}: {error}"),
        };
        assert_eq!(found, case["kind"], "{}", case["why"]);
    }
}

/// The same by `tools/reference`.
#[test]
fn the_reference_decoder_agrees() {
    let python = std::env::var("TSUYA_PYTHON").unwrap_or_else(|_| "python3".into());
    if !Command::new(&python).args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success()) {
        println!("skipped: needs Python with NumPy");
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(&python).arg(root.join("tools/reference/vectors.py")).arg(folder()).output().unwrap();
    let (said, complained) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}{complained}");
    assert!(said.contains("16 golden files, 50 cases: the same"), "{said}");
}
