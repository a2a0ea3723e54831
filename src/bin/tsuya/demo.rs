//! `tsuya demo`: the whole way on the bundled sample, in half a minute.

use crate::compare::side_by_side;
use crate::encode::decibel;
use crate::{output, pictures, progress, source};
use anyhow::Result;
use clap::Args;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::Asset;
use tsuya::Error;
use tsuya::Photograph;
use tsuya::capture::{self, CaptureReadOptions};
use tsuya::decoder::{DecodeOptions, decode};
use tsuya::encoder::{EncodedFile, encode, separate};
use tsuya::metrics::to_display;
use tsuya::relight::{AssetRenderer, RenderLighting, RenderOptions, orbit};
use tsuya::{EncodeOptions, EncodeTarget, Profile};

/// The sample capture, within the program.
#[derive(rust_embed::RustEmbed)]
#[folder = "tests/data/sample-spot"]
struct Sample;

/// What its folder is called.
const SAMPLE: &str = "sample-spot";
/// Pictures of the orbit.
const ORBIT: usize = 12;
/// Small photographs are shown enlarged to about this width.
const SHOWN_WIDTH: usize = 384;

/// Encodes a sample capture, prints sizes and errors, and writes the file and pictures of it.
///
/// Into the folder go sample.tsuya, comparison.png (photograph, decoded, difference), relit.png (under the captured light, and
/// under one from another side), and orbit-000.png ... around the object. Only these files are overwritten.
#[derive(Args)]
pub struct Demo {
    /// The folder to write.
    #[arg(short, long, value_name = "DIR", default_value = "demo-out")]
    output: PathBuf,
    /// Another capture than the bundled sample.
    #[arg(long, value_name = "DIR")]
    capture: Option<PathBuf>,
}

impl Demo {
    pub fn run(self) -> Result<()> {
        let start = Instant::now();
        // The sample is there as long as this runs.
        let mut unpacked = None;
        let path = match &self.capture {
            Some(path) => path.clone(),
            None => unpacked.insert(unpack()?).join(SAMPLE),
        };
        let folder = output::Folder::create(&self.output, true, None, &[])?;
        let options = CaptureReadOptions { limits: source::limits(), ..Default::default() };
        let captured = progress::read_capture(&path, &options)?;
        output::warn(&captured.warnings);
        let frames = captured.frames.len();
        let photograph_bytes = photograph_bytes(&path)?;
        let mut text =
            format!("{}: {frames} views, photographs of {photograph_bytes} bytes\n\n", output::line(&captured.name));
        text += "                         bytes   of photographs   diffuse  specular     sum     seconds\n";
        let rows = [
            ("predictive, quality 75", Profile::Predictive, EncodeTarget::Quality(75.0)),
            ("predictive, 45 dB", Profile::Predictive, EncodeTarget::PsnrDb(45.0)),
            ("wavelet-texture, 5 %", Profile::WaveletTexture, EncodeTarget::KeepPercent(5.0)),
        ];
        let mut file = None;
        for (name, profile, target) in rows {
            let begin = Instant::now();
            let options = EncodeOptions { profile, target: Some(target), ..Default::default() };
            let encoded = {
                let _busy = progress::busy("encoding");
                encode(captured.clone(), &options)
            };
            // Not every capture reaches every target.
            match encoded {
                Ok(encoded) => {
                    let seconds = begin.elapsed().as_secs_f64();
                    text += &row(name, &encoded, photograph_bytes, seconds);
                    file.get_or_insert(encoded);
                }
                Err(error) if file.is_some() => _ = writeln!(text, "{name:22} {error}"),
                Err(error) => return Err(error.into()),
            }
        }
        text += "                                                   image PSNR, dB\n";
        let Some(file) = file else { return Ok(()) };
        folder.write("sample.tsuya", &file.bytes)?;
        pictures_of(&file.bytes, captured, &folder)?;
        folder.commit()?;
        let _ = writeln!(
            text,
            "\n{}: sample.tsuya, comparison.png, relit.png, orbit-000.png to orbit-{:03}.png; {:.1} s",
            self.output.display(),
            ORBIT - 1,
            start.elapsed().as_secs_f64()
        );
        output::tell(&text)
    }
}

/// Writes the sample's files into a temporary folder.
fn unpack() -> Result<output::Staging> {
    let parent = std::env::temp_dir();
    let staging = output::Staging::create_in(&parent).map_err(|e| Error::io(&parent, e))?;
    for name in Sample::iter() {
        let (path, file) = (staging.join(SAMPLE).join(&*name), Sample::get(&name));
        let failed = |e| Error::io(&path, e);
        std::fs::create_dir_all(path.parent().unwrap_or(&parent)).map_err(failed)?;
        std::fs::write(&path, file.map(|file| file.data).unwrap_or_default()).map_err(failed)?;
    }
    Ok(staging)
}

fn pictures_of(bytes: &[u8], mut captured: capture::Capture, folder: &output::Folder) -> Result<()> {
    let _busy = progress::busy("pictures");
    let asset = decode(bytes, &DecodeOptions::default())?;
    let observed = separate(&mut captured)?.views.swap_remove(0);
    let (Some(view), Some(Some(decoded))) = (asset.views.first(), asset.photographs.first()) else {
        return Err(Error::parameter("the file has no view").into());
    };
    let mask = observed.mask.unwrap_or_else(|| decoded.mask.clone());
    let original = Photograph { mask, images: observed.images };
    let shown = (SHOWN_WIDTH / view.camera.width.max(1) as usize).max(1);
    let comparison = side_by_side(&original, decoded, asset.white);
    folder.write("comparison.png", &pictures::png(&comparison)?)?;

    let renderer = AssetRenderer::new(&asset)?;
    let relit = relit(&renderer, &asset)?;
    folder.write("relit.png", &pictures::png(&relit)?)?;
    for (number, mut camera) in orbit(&asset, ORBIT).into_iter().enumerate() {
        camera = enlarge(camera, shown);
        let rendered = renderer.render(&camera, &RenderOptions::default())?;
        let picture = pictures::png(&to_display(&rendered.image, asset.white))?;
        folder.write(&format!("orbit-{number:03}.png"), &picture)?;
    }
    Ok(())
}

fn row(name: &str, encoded: &EncodedFile, photograph_bytes: u64, seconds: f64) -> String {
    let psnr = &encoded.image_psnr;
    format!(
        "{name:22} {:8} {:14.2} % {:>9} {:>9} {:>7} {:9.1}\n",
        encoded.bytes.len(),
        100.0 * encoded.bytes.len() as f64 / photograph_bytes.max(1) as f64,
        decibel(psnr.diffuse),
        decibel(psnr.specular),
        decibel(psnr.sum),
        seconds
    )
}

/// The first view under its captured light and, where lights are known, under that of a view from another side.
fn relit(renderer: &AssetRenderer, asset: &Asset) -> Result<tsuya::metrics::DisplayImage> {
    let first = asset.views[0].camera;
    let shown = (SHOWN_WIDTH / first.width.max(1) as usize).max(1);
    let camera = enlarge(first, shown);
    let mut lightings = vec![RenderLighting::Capture(0)];
    let relightable = asset.reflectance.as_ref().is_some_and(|maps| maps.relightable);
    if relightable {
        let quarter = asset.views.len() / 6;
        let lights = [quarter, asset.views.len() - 1 - quarter].map(|k| asset.views[k].light);
        lightings.extend(lights.into_iter().flatten().map(|light| RenderLighting::Points(vec![light])));
    }
    let mut shown = Vec::new();
    for lighting in lightings {
        let rendered = renderer.render(&camera, &RenderOptions { lighting, ..Default::default() })?;
        shown.push(to_display(&rendered.image, asset.white));
    }
    Ok(pictures::beside(&shown))
}

/// The same view with `factor` times as many pixels each way.
fn enlarge(camera: tsuya::Camera, factor: usize) -> tsuya::Camera {
    camera.scaled([camera.width, camera.height].map(|side| side * factor as u32), [factor as f64; 2])
}

/// Bytes of the capture's photographs on disk.
fn photograph_bytes(path: &Path) -> Result<u64> {
    let description = capture::describe(path, &source::access())?;
    let files = description.frames.iter().flat_map(|frame| frame.photograph.files());
    Ok(files.filter_map(|file| std::fs::metadata(file).ok()).map(|metadata| metadata.len()).sum())
}
