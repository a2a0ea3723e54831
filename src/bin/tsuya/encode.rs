//! `tsuya encode`: a capture becomes a file.

mod plan;

use crate::values::{CaptureArguments, numbers, triple};
use crate::{output, progress};
use anyhow::Result;
use clap::{Args, ValueEnum};
use serde_json::{Map, Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::Component;
use tsuya::Error;
use tsuya::encoder::{EncodedFile, encode};
use tsuya::metrics::ImagePsnr;
use tsuya::{CaptureLight, DecodeSpeed, EncodeOptions, EncodeTarget, Profile, Refinement, SpecularModel};

/// Encodes a capture: photographs with their cameras, and a mesh, into one .tsuya file.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya encode vase/ -o vase.tsuya\n",
    "  tsuya encode vase/ -o vase.tsuya --psnr 42 --title Vase --licence CC0-1.0\n",
    "  tsuya encode vase/ --plan",
))]
pub struct Encode {
    /// The capture: a folder, its transforms.json, a COLMAP model, or the cameras of another program.
    capture: PathBuf,
    /// The file to write; - is standard output.
    #[arg(short, long, value_name = "FILE", required_unless_present = "plan")]
    output: Option<PathBuf>,
    /// Only says what the encode will take: photographs, time, memory, temporary space and bytes, as rough ranges from their sizes. Nothing is
    /// read but the capture's description, and nothing is written.
    #[arg(long, conflicts_with = "output")]
    plan: bool,
    #[command(flatten)]
    target: TargetArguments,
    /// How photographs are stored.
    #[arg(long, value_enum, default_value = "predictive")]
    profile: ProfileName,
    /// Profile predictive: trades file size for decoding speed.
    #[arg(long, alias = "decoding", value_enum, default_value = "auto", value_name = "LEVEL")]
    faster_decoding: FasterDecoding,
    /// Profile predictive: side of the tiles that faster files are cut into, in coefficients; a power of two, 16 to 4096.
    #[arg(long, default_value_t = 256, value_name = "N")]
    tile_side: u32,
    /// Leaves every K-th view out of the file, so that compare can judge images between the captured ones.
    #[arg(long, value_name = "K")]
    hold_out: Option<usize>,
    #[command(flatten)]
    reading: CaptureArguments,
    /// Bits of a mesh coordinate, 8 to 20 [default: enough to move no vertex by more than an eighth of a pixel].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(8..=20))]
    position_bits: Option<u8>,
    /// Profile predictive: model that highlights are fitted with.
    #[arg(long, value_enum, default_value = "auto", value_name = "MODEL")]
    specular: SpecularName,
    /// What the photographs correct before they are encoded.
    #[arg(long, value_enum, default_value = "auto", value_name = "WHAT")]
    refine: RefinementName,
    /// Light of the photographs, where the capture does not state it: camera[:DX,DY,DZ], X,Y,Z or environment.
    ///
    /// `camera` is a lamp that stands still relative to the camera: a flash, or the lamp of a turntable that turns the object before the
    /// camera. DX, DY, DZ lead from the camera to it, to the right, upwards and backwards in the photograph, in the capture's unit; without
    /// them the place is fitted. X,Y,Z is a lamp that stands still relative to the object, in the coordinates of the capture's cameras.
    /// Either may be followed by :I or :R,G,B, its intensity (irradiance at distance r is I / r^2); without it the light is taken to be white
    /// and so strong that the object's brightest parts are nearly white.
    ///
    /// `environment` estimates all that is around the object, standing still relative to it, together with its diffuse reflectance
    /// (profile predictive); the file holds it as its light. :I or :R,G,B behind it is its mean radiance.
    #[arg(long, value_name = "LIGHT", value_parser = capture_light, allow_hyphen_values = true)]
    light: Option<CaptureLight>,
    /// Profile predictive: keeps specular radiance below zero (noise, double bounces), too.
    #[arg(long)]
    signed_specular: bool,
    /// Does not decode the finished file to compare every photograph with what the file states of it.
    #[arg(long)]
    no_check: bool,
    /// Name of the object [default: the capture's folder].
    #[arg(long)]
    title: Option<String>,
    /// Terms of use.
    #[arg(long, visible_alias = "license")]
    licence: Option<String>,
    /// Where the measurement comes from.
    #[arg(long)]
    provenance: Option<String>,
    /// Unit of world lengths: m, cm, mm, or another word.
    #[arg(long)]
    units: Option<String>,
    /// Further metadata; may come several times.
    #[arg(long, value_name = "KEY=VALUE")]
    meta: Vec<String>,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

/// How fine the encoding is.
#[derive(Args)]
#[group(multiple = false)]
pub struct TargetArguments {
    /// 0 to 100 [default: 75]; 25 more halve the quantiser step.
    #[arg(long, value_name = "Q")]
    quality: Option<f64>,
    /// Image PSNR at least, in dB.
    #[arg(long, value_name = "DB")]
    psnr: Option<f64>,
    /// Bytes of the file at most.
    #[arg(long, value_name = "N")]
    max_bytes: Option<u64>,
    /// Largest error of any pixel, on the square root of its radiance over the white board's.
    #[arg(long, value_name = "E")]
    max_error: Option<f64>,
    /// Profile wavelet-texture: coefficients kept, in per cent [default: 5].
    #[arg(long, alias = "keep", value_name = "PERCENT")]
    keep_percent: Option<f64>,
}

impl TargetArguments {
    fn target(&self) -> Option<EncodeTarget> {
        (self.quality.map(EncodeTarget::Quality))
            .or(self.psnr.map(EncodeTarget::PsnrDb))
            .or(self.max_bytes.map(EncodeTarget::MaxBytes))
            .or(self.max_error.map(EncodeTarget::MaxError))
            .or(self.keep_percent.map(EncodeTarget::KeepPercent))
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum ProfileName {
    /// Photographs predicted through the mesh from each other.
    #[value(alias = "tuned")]
    Predictive,
    /// The Wavelet-Texture method as published: residual volumes on patches of the surface.
    #[value(alias = "paper")]
    WaveletTexture,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum FasterDecoding {
    /// As 0 for photographs of up to 1.5 megapixels; larger ones as 1, predicted from pictures of at most 0.4 megapixels.
    #[value(name = "auto")]
    Automatic,
    /// The smallest file.
    #[value(name = "0", alias = "small")]
    Normal,
    /// About a fifth larger, a view in about a third of the time: for pages and apps that show views as they come.
    #[value(name = "1", alias = "fast")]
    Fast,
    /// About a third larger, a view in about a fifth of the time.
    #[value(name = "2", alias = "fastest")]
    Fastest,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum SpecularName {
    /// `ggx` where the surface was refined, else `torrance-sparrow`.
    Auto,
    /// The lobe of Torrance and Sparrow.
    TorranceSparrow,
    /// Measured shapes: a palette of lobes of half and difference angle.
    Dsbrdf,
    /// Weights of five GGX lobes, shared by neighbours; diffuse light passes a dielectric surface.
    Ggx,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum RefinementName {
    /// `surface` where photographs are polarised and their lights known, else `none`.
    Auto,
    /// The mesh stays as it is.
    None,
    /// Profile predictive: the mesh is subdivided and displaced until it explains shading and highlights under known lights, and that is
    /// kept where it explains views better that it was not fitted to. Views and other lamps are rendered from it; environments, glTF
    /// and baked visibility take the mesh still.
    Surface,
}

impl Encode {
    pub fn run(self) -> Result<()> {
        let Some(output) = &self.output else {
            return plan::print(&self.capture, &self.reading.outside.access(), &self.options()?, self.json);
        };
        let inputs = self.reading.files(&self.capture)?;
        let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
        output::check_outputs(&[output], &inputs, self.force)?;
        if self.json && output::is_stream(output) {
            return Err(Error::parameter("--json and the file can't both go to standard output").into());
        }
        let mut options = self.options()?;
        let start = Instant::now();
        let capture = progress::open_capture(&self.capture, &self.reading.read_options()?)?;
        let (skipped, missing, clipping) = (capture.skipped_frames, capture.missing_pixels, capture.clipping);
        if capture.origin != [0.0; 3] {
            options.metadata.entry("origin").or_insert_with(|| json!(capture.origin));
        }
        let encoded = {
            let _busy = progress::busy("encoding");
            encode(capture, &options)?
        };
        output::write(output, &encoded.bytes, self.force)?;
        let seconds = start.elapsed().as_secs_f64();
        output::warn(&encoded.warnings);
        if self.json {
            let mut report = report(&encoded, seconds);
            report["skipped_frames"] = json!(skipped);
            report["missing_pixels"] = json!(missing);
            report["clipping"] = json!(clipping);
            return output::print_json(&report);
        }
        let text = table(&encoded, seconds);
        if output::is_stream(output) {
            if !output::is_quiet() {
                output::eprint_line(text.trim_end());
            }
            return Ok(());
        }
        output::tell(&text)
    }

    fn options(&self) -> Result<EncodeOptions> {
        let mut metadata = Map::new();
        let known = [
            ("title", &self.title),
            ("licence", &self.licence),
            ("provenance", &self.provenance),
            ("units", &self.units),
        ];
        for (key, value) in known {
            if let Some(value) = value {
                metadata.insert(key.into(), Value::String(value.clone()));
            }
        }
        for pair in &self.meta {
            let Some((key, value)) = pair.split_once('=').filter(|(key, _)| !key.is_empty()) else {
                return Err(Error::parameter(format!("--meta takes KEY=VALUE, not '{pair}'")).into());
            };
            metadata.insert(key.into(), Value::String(value.into()));
        }
        let profile = match self.profile {
            ProfileName::Predictive => Profile::Predictive,
            ProfileName::WaveletTexture => Profile::WaveletTexture,
        };
        let specular = match self.specular {
            SpecularName::Auto => SpecularModel::Automatic,
            SpecularName::TorranceSparrow => SpecularModel::TorranceSparrow,
            SpecularName::Dsbrdf => SpecularModel::Dsbrdf,
            SpecularName::Ggx => SpecularModel::GgxLobes,
        };
        if matches!(specular, SpecularModel::Dsbrdf | SpecularModel::GgxLobes) && profile == Profile::WaveletTexture {
            let message =
                "--specular dsbrdf and ggx go with profile predictive: profile wavelet-texture has the published model";
            return Err(Error::parameter(message).into());
        }
        let decode_speed = match self.faster_decoding {
            FasterDecoding::Automatic => DecodeSpeed::Automatic,
            FasterDecoding::Normal => DecodeSpeed::Normal,
            FasterDecoding::Fast => DecodeSpeed::Fast,
            FasterDecoding::Fastest => DecodeSpeed::Fastest,
        };
        if matches!(decode_speed, DecodeSpeed::Fast | DecodeSpeed::Fastest) && profile == Profile::WaveletTexture {
            let message = "--faster-decoding goes with profile predictive: profile wavelet-texture has no predictions";
            return Err(Error::parameter(message).into());
        }
        Ok(EncodeOptions {
            specular,
            refine: match self.refine {
                RefinementName::Auto => Refinement::Automatic,
                RefinementName::None => Refinement::None,
                RefinementName::Surface => Refinement::Surface,
            },
            profile,
            decode_speed,
            tile_side: self.tile_side,
            target: self.target.target(),
            hold_out: self.hold_out,
            light: self.light,
            position_bits: self.position_bits,
            signed_specular: self.signed_specular,
            check: !self.no_check,
            metadata,
            ..Default::default()
        })
    }
}

/// Parses `camera`, `camera:DX,DY,DZ` or `X,Y,Z`, each with `:I` or `:R,G,B` behind it.
fn capture_light(text: &str) -> std::result::Result<CaptureLight, String> {
    let mut parts = text.split(':');
    let first = parts.next().unwrap_or_default();
    let is_camera = first == "camera";
    let offset = if is_camera { parts.next().filter(|part| !part.is_empty()).map(triple).transpose()? } else { None };
    let intensity = parts.next().map(|part| match numbers(part)?.0[..] {
        [all] => Ok([all; 3]),
        [r, g, b] => Ok([r, g, b]),
        _ => Err("an intensity is one number or three".to_string()),
    });
    let intensity = intensity.transpose()?;
    if parts.next().is_some() {
        return Err("a light is camera[:DX,DY,DZ[:INTENSITY]], X,Y,Z[:INTENSITY] or environment[:RADIANCE]".into());
    }
    if first == "environment" {
        return Ok(CaptureLight::Environment { mean_radiance: intensity });
    }
    if is_camera {
        return Ok(CaptureLight::Camera { offset, intensity });
    }
    let position = triple(first).map_err(|error| format!("neither `camera`, `environment` nor a place: {error}"))?;
    Ok(CaptureLight::Lamp { position, intensity })
}

/// The figures that other tools rely on, and a few more.
pub fn report(encoded: &EncodedFile, seconds: f64) -> Value {
    let sample = |linear: bool| {
        let of = |component| {
            let errors = encoded.sample_psnr.as_ref()?;
            let error = errors.iter().find(|(c, _)| *c == component)?.1;
            let db = if linear { error.linear_db } else { error.sqrt_db };
            db.is_finite().then_some(db)
        };
        let mut object = json!({"diffuse": of(Component::Diffuse), "specular": of(Component::Specular)});
        if let Some(db) = of(Component::Combined) {
            object["combined"] = json!(db);
        }
        object
    };
    let sections: Vec<Value> =
        encoded.sections.iter().map(|(tag, bytes)| json!({"tag": tag, "bytes": bytes})).collect();
    json!({
        "bytes": encoded.bytes.len(),
        "seconds": seconds,
        "threads": rayon::current_num_threads(),
        "sections": sections,
        "sample_psnr_db": {"linear": sample(true), "sqrt": sample(false)},
        "kept_percent": encoded.kept_percent,
        "image_psnr_db": psnr_json(&encoded.image_psnr),
        "coverage": encoded.coverage,
        "checked": encoded.reader_memory.is_some(),
        "reader_memory_bytes": encoded.reader_memory,
        "assumed_light": encoded.assumed_light,
        "warnings": encoded.warnings,
    })
}

/// A PSNR as JSON; null where nothing differs or nothing was compared.
pub fn psnr_json(psnr: &ImagePsnr) -> Value {
    json!({"diffuse": psnr.diffuse, "specular": psnr.specular, "sum": psnr.sum})
}

/// dB for people.
pub fn decibel(db: Option<f64>) -> String {
    db.map_or_else(|| "-".into(), |db| format!("{db:.2}"))
}

/// On what share of the masks a PSNR is measured.
pub fn covered(share: f64) -> String {
    let percent = 100.0 * share;
    format!("on the {percent:.1} % of the masks that the mesh covers; {:.1} % are lost", 100.0 - percent)
}

fn table(encoded: &EncodedFile, seconds: f64) -> String {
    let mut text = String::from("section      bytes\n");
    for (tag, bytes) in &encoded.sections {
        let _ = writeln!(text, "{tag}    {bytes:10}");
    }
    let _ = writeln!(text, "file    {:10}   {seconds:.1} s", encoded.bytes.len());
    let psnr = &encoded.image_psnr;
    let share = covered(encoded.coverage);
    let _ = match psnr.diffuse.or(psnr.specular) {
        Some(_) => writeln!(
            text,
            "image PSNR: diffuse {} dB, specular {} dB, sum {} dB, {share}",
            decibel(psnr.diffuse),
            decibel(psnr.specular),
            decibel(psnr.sum)
        ),
        None => writeln!(text, "image PSNR: {} dB, {share}", decibel(psnr.sum)),
    };
    for (component, error) in encoded.sample_psnr.iter().flatten() {
        let name = format!("{component:?}").to_lowercase();
        let _ = writeln!(text, "sample PSNR, {name}: linear {:.2} dB, sqrt {:.2} dB", error.linear_db, error.sqrt_db);
    }
    if let Some(kept) = encoded.kept_percent {
        let _ = writeln!(text, "coefficients kept: {kept:.3} %");
    }
    if encoded.reader_memory.is_some() {
        let _ = writeln!(text, "decoded again: every photograph is as stated");
    }
    text
}
