//! Small inputs and their outputs for clauses of the specification, as JSON. Bytes are hexadecimal, singles the hexadecimal of their bits.

use serde_json::{Value, json};
use std::path::Path;
use tsuya::brdf::NamedMaterial;
use tsuya::image::Mask;
use tsuya::internals::entropy::{
    AverageModel, BitCoder, BitModel, Mixer, MixerContext, NumberModel, RangeEncoder, RansEncoder, SymbolCoder,
    SymbolModel, code_end,
};
use tsuya::internals::quantise::{Quantiser, RateDistortion};
use tsuya::internals::residual::MaskModels;
use tsuya::internals::residual::coefficients::{CoefficientModels, Modelling, PictureTask, Prediction, Tiling};
use tsuya::internals::transform::{ColourLanes, WaveletPlan};
use tsuya::{brdf::Brdf, internals};

/// Numbers that look random and are the same everywhere (Knuth's linear congruential generator of 32 bits, its upper half).
struct Random(u32);

impl Random {
    fn below(&mut self, bound: u32) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 16) % bound
    }
    fn skewed_bit(&mut self) -> bool {
        self.below(5) == 0
    }
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn singles(values: impl IntoIterator<Item = f32>) -> String {
    values.into_iter().map(|value| format!("{:08x}", (value + 0.0).to_bits())).collect()
}

fn finish(mut coder: RangeEncoder) -> String {
    code_end(&mut coder);
    hex(&coder.finish())
}

/// A round shape with a hole, of odd sizes.
fn round(width: usize, height: usize, radius: f32) -> Mask {
    let inside = |at: usize| {
        let (x, y) = ((at % width) as f32 - 5.2, (at / width) as f32 - 4.4);
        let squared = x * x + 1.4 * y * y;
        squared < radius * radius && squared > 0.8
    };
    Mask { width, height, data: (0..width * height).map(inside).collect() }
}

fn rows(mask: &Mask) -> Vec<String> {
    let row = |row: &[bool]| row.iter().map(|&set| if set { '#' } else { '.' }).collect();
    mask.data.chunks(mask.width).map(row).collect()
}

/// entropy.md: every kind of model, each stream with the end mark.
fn entropy() -> Vec<Value> {
    let mut random = Random(1);
    let mut coder = RangeEncoder::new();
    let probabilities = [1, 65535, 32768, 3, 65000, 700, 40000, 20, 65510, 32767, 32769, 9000];
    let bits: Vec<bool> = probabilities.iter().map(|_| random.skewed_bit()).collect();
    probabilities.iter().zip(&bits).for_each(|(&probability, &bit)| _ = coder.bit(probability, bit));
    let mut cases = vec![
        json!({"clause": "1 and 2", "kind": "bit", "stream": finish(coder), "probabilities": probabilities, "bits": bits}),
    ];

    let mut coder = RangeEncoder::new();
    let mut model = BitModel::default();
    let bits: Vec<bool> = (0..60).map(|_| random.skewed_bit()).collect();
    bits.iter().for_each(|&bit| _ = model.code(&mut coder, bit));
    cases.push(json!({"clause": "3", "kind": "model", "stream": finish(coder), "bits": bits}));

    let numbers = [0u32, 1, 2, 3, 7, 8, 1000, 65535, 65536, 4_294_967_294, 5, 5, 5, 6, 0];
    let (mut coder, mut model) = (RangeEncoder::new(), NumberModel::default());
    numbers.iter().for_each(|&number| _ = model.code(&mut coder, number));
    cases.push(json!({"clause": "4", "kind": "number", "stream": finish(coder), "values": numbers}));
    let numbers = [0, 1, -1, 2, -2, 1000, -1000, i32::MAX, -i32::MAX, 3, 3, -3];
    let (mut coder, mut model) = (RangeEncoder::new(), NumberModel::default());
    numbers.iter().for_each(|&number| _ = model.code_signed(&mut coder, number));
    cases.push(json!({"clause": "4", "kind": "signed", "stream": finish(coder), "values": numbers}));

    let (slots, selectors) = ([3usize, 4, 5, 6, 7, 8, 9, 10], [2usize, 3]);
    let (mut coder, mut mixer) = (RangeEncoder::new(), Mixer::new(slots, selectors));
    let (mut contexts, mut bits) = (Vec::new(), Vec::new());
    for _ in 0..80 {
        let context = MixerContext {
            slots: slots.map(|count| random.below(count as u32)),
            selectors: selectors.map(|count| random.below(count as u32)),
        };
        let bit = context.slots[2] > 2 || random.skewed_bit();
        mixer.code(&mut coder, &context, bit);
        contexts.push(context.slots.into_iter().chain(context.selectors).collect::<Vec<u32>>());
        bits.push(bit);
    }
    let stream = finish(coder);
    cases.push(json!({"clause": "5", "kind": "mixer", "stream": stream, "slots": slots, "selectors": selectors,
        "contexts": contexts, "bits": bits}));

    let counts = [3usize, 5];
    let (mut coder, mut average) = (RangeEncoder::new(), AverageModel::new(counts));
    let (mut contexts, mut bits) = (Vec::new(), Vec::new());
    for _ in 0..60 {
        let context = counts.map(|count| random.below(count as u32));
        let bit = context[1] > 2 || random.skewed_bit();
        average.code(&mut coder, &context, bit);
        contexts.push(context);
        bits.push(bit);
    }
    cases
        .push(json!({"clause": "6", "kind": "average", "stream": finish(coder), "slots": counts, "contexts": contexts,
        "bits": bits}));

    let (mut coder, mut symbols) = (RansEncoder::new(), SymbolModel::new(counts));
    let (mut contexts, mut values, mut equiprobable) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..80 {
        let context = counts.map(|count| random.below(count as u32));
        let value = (random.below(4) * random.below(6)).min(15);
        symbols.code(&mut coder, context, value as usize);
        let bits = random.below(4);
        let extra = random.below(1 << bits);
        coder.equiprobable(bits, extra);
        contexts.push(context);
        values.push(value);
        equiprobable.push([bits, extra]);
    }
    cases.push(json!({"clause": "7 and 8", "kind": "symbols", "stream": hex(&coder.finish()), "slots": counts,
        "contexts": contexts, "values": values, "equiprobable": equiprobable}));
    cases
}

/// planes.md section 8.
fn masks() -> Vec<Value> {
    let coverage = round(13, 10, 4.1);
    let mut shifted = coverage.clone();
    (1..shifted.data.len()).for_each(|at| shifted.data[at] = coverage.data[at - 1] || at % 17 == 3);
    let case = |mask: &Mask| {
        let mut coder = RangeEncoder::new();
        internals::residual::code_mask(&mut coder, &mut MaskModels::default(), &coverage, Some(mask));
        json!({"clause": "8", "coverage": rows(&coverage), "stream": hex(&coder.finish()), "mask": rows(mask)})
    };
    vec![case(&coverage), case(&shifted)]
}

/// planes.md sections 6 and 7: a stream of coefficients, and the picture of them; with a prediction, with a correction, and without.
fn planes() -> Vec<Value> {
    let mask = round(13, 10, 4.6);
    let plan = WaveletPlan::new(&mask);
    let mut random = Random(7);
    let mut picture = |scale: f32| -> Vec<ColourLanes> {
        let value = |at: usize, random: &mut Random| (at % 13) as f32 * 0.07 + random.below(100) as f32 * 0.002;
        let pixel = |at: usize| -> ColourLanes {
            let [a, b, c] = [0, 1, 2].map(|_| scale * value(at, &mut random));
            if mask.data[at] { [a, b, c, 0.0] } else { [0.0; 4] }
        };
        (0..mask.data.len()).map(pixel).collect()
    };
    let (target, predicted, correction) = (picture(1.0), picture(0.9), picture(0.4));
    let in_mask = |pixels: &[ColourLanes], mask: &Mask| {
        let kept = pixels.iter().zip(&mask.data).filter(|(_, set)| **set);
        singles(kept.flat_map(|(pixel, _)| [pixel[0], pixel[1], pixel[2]]))
    };
    let mut cases = Vec::new();
    for (modelling, name) in [(Modelling::Mixed, "mixed"), (Modelling::Direct, "direct")] {
        for [with, corrected] in [[false, false], [true, false], [true, true], [false, true]] {
            let quantiser = Quantiser { step: 0.03, shrink: [0.125, 0.0625] };
            let bands = |picture: &Vec<ColourLanes>| plan.forward(picture.clone());
            let (views, model) = (with.then(|| bands(&predicted)), corrected.then(|| bands(&correction)));
            let tiling = Tiling::default();
            let task = PictureTask {
                plan: &plan,
                quantiser: &quantiser,
                prediction: Prediction { views: views.as_deref(), correction: model.as_deref() },
                tiling: &tiling,
                tiled_bands: &[],
            };
            let (streams, decoded) = internals::residual::coefficients::encode(
                &mut CoefficientModels::new(modelling),
                &task,
                &plan.forward(target.clone()),
                RateDistortion { lambda: 0.1 },
                Default::default(),
            );
            cases.push(json!({
                "clause": "6 and 7", "modelling": name, "mask": rows(&mask),
                "step": singles([quantiser.step]), "shrink": singles(quantiser.shrink),
                "predicted": with.then(|| in_mask(&predicted, &mask)),
                "correction": corrected.then(|| in_mask(&correction, &mask)), "stream": hex(&streams.base),
                "picture": in_mask(&plan.inverse(&decoded), &mask),
            }));
        }
    }
    cases
}

/// A file as container.md says, of any sections of less than 128 bytes: tag, codec, content.
fn file(sections: &[(&[u8; 4], u8, &[u8])]) -> Vec<u8> {
    file_with(sections, |length| vec![length as u8])
}

fn file_with(sections: &[(&[u8; 4], u8, &[u8])], varint: impl Fn(usize) -> Vec<u8>) -> Vec<u8> {
    let crc = |parts: &[&[u8]]| crc32fast::hash(&parts.concat()).to_le_bytes();
    let mut file = tsuya::container::SIGNATURE.to_vec();
    file.extend([0, 0, 1, 0]);
    let mut directory = b"DRCT".to_vec();
    directory.push(sections.len() as u8);
    for (tag, codec, content) in sections {
        let head = [&tag[..], &[*codec], &varint(content.len())].concat();
        let head = [&head[..], &crc(&[&head, content])].concat();
        directory.extend(&head);
        file.extend([&head[..], content].concat());
    }
    directory.extend(crc(&[&file[..12], &directory]));
    let length = directory.len() as u32;
    file.extend([&directory[..], &length.to_le_bytes(), &tsuya::container::END_SIGNATURE].concat());
    file
}

/// container.md: files that must be refused, and why.
fn refused() -> tsuya::Result<Vec<Value>> {
    let light = tsuya::lighting::encode(&Default::default(), &Default::default())?.0;
    let whole = file(&[(b"lIGt", 2, &light)]);
    let long = file_with(&[(b"lIGt", 2, &light)], |length| vec![length as u8 | 128, 0]);
    let changed = |at: usize, bits: u8| {
        let mut bytes = whole.clone();
        bytes[at] ^= bits;
        bytes
    };
    let end = whole.len();
    let case = |why: &str, kind: &str, bytes: &[u8]| json!({"why": why, "kind": kind, "file": hex(bytes)});
    Ok(vec![
        case("nothing is wrong with this one", "sound", &whole),
        case("empty", "damaged", &[]),
        case("one byte is missing at the end", "damaged", &whole[..end - 1]),
        case("one byte too many", "damaged", &[&whole[..], &[0]].concat()),
        case("another signature", "damaged", &changed(0, 1)),
        case("line ends were changed", "damaged", &changed(5, 2)),
        case("another minor version", "unsupported", &changed(10, 2)),
        case("another major version", "unsupported", &changed(8, 1)),
        case("the header of a section differs from the directory's", "damaged", &changed(13, 1)),
        case("a byte of a section", "damaged", &changed(12 + 10, 4)),
        case("the directory's count", "damaged", &changed(end - 8 - 14 - 1, 1)),
        case("the directory's checksum", "damaged", &changed(end - 9, 1)),
        case("the directory's length", "damaged", &changed(end - 8, 1)),
        case("another end signature", "damaged", &changed(end - 1, 1)),
        case("a critical section that nobody knows", "unsupported", &file(&[(b"lIGt", 2, &light), (b"NOWN", 0, &[1])])),
        case("neither mesh nor views, and nothing that does without", "damaged", &file(&[(b"nOTe", 0, &[1])])),
        case("a length in more bytes than it needs", "damaged", &long),
        case("a section twice", "damaged", &file(&[(b"lIGt", 2, &light), (b"lIGt", 2, &light)])),
        case("a tag that is none", "damaged", &file(&[(b"lIGt", 2, &light), (b"no!e", 0, &[1])])),
    ])
}

/// Name and content of each file of clauses.
pub fn all() -> tsuya::Result<[(&'static str, Vec<Value>); 4]> {
    Ok([("entropy", entropy()), ("masks", masks()), ("planes", planes()), ("refused", refused()?)])
}

/// materials.md: values of the section's materials for pairs of directions; right to a relative 1e-9.
pub fn materials(section: &[u8]) -> tsuya::Result<Vec<Value>> {
    let unit = |x: f64, y: f64| [x, y, (1.0 - x * x - y * y).sqrt()];
    let pairs = [
        [unit(0.0, 0.0), unit(0.0, 0.0)],
        [unit(0.3, 0.1), unit(-0.3, -0.1)],
        [unit(0.3, 0.2), unit(-0.25, -0.1)],
        [unit(0.8, 0.0), unit(0.1, 0.6)],
        [unit(-0.5, 0.5), unit(0.55, -0.4)],
        [unit(0.0, 0.9), unit(0.2, -0.95)],
    ];
    let found = tsuya::brdf::decode_materials(section, &tsuya::Budget::new(Default::default()))?;
    let case = |material: &NamedMaterial| {
        let values: Vec<_> = pairs.iter().map(|[i, o]| json!([i, o, material.material.evaluate(*i, *o)])).collect();
        json!({"section": hex(section), "name": material.name, "values": values})
    };
    Ok(found.iter().map(case).collect())
}

/// Writes a file of clauses.
pub fn write(folder: &Path, version: &str, name: &str, cases: &[Value]) -> std::io::Result<()> {
    let cases: Vec<String> = cases.iter().map(|case| case.to_string()).collect();
    let title = json!(format!("tsuya {version}, {name}"));
    let text = format!("{{\"vectors\": {title},\n\"cases\": [\n{}\n]}}\n", cases.join(",\n"));
    std::fs::write(folder.join(format!("{name}.json")), text)
}
