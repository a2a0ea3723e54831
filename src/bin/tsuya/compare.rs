//! `tsuya compare`: a file against its photographs, in figures and pictures.

use crate::comparison::{Compared, Comparison, compare};
use crate::encode::{decibel, psnr_json};
use crate::output::{self, Folder};
use crate::pictures;
use crate::values::CaptureArguments;
use anyhow::Result;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;
use tsuya::Photograph;
use tsuya::metrics;
use tsuya::metrics::DisplayImage;
use tsuya::relight::{AssetRenderer, RenderLighting, RenderOptions};

/// Amplification of the signal's differences in images.
pub const AMPLIFICATION: f64 = 8.0;

/// Compares a file with the capture it was made from.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya compare vase.tsuya vase/ -o compared/",
))]
pub struct Compare {
    /// The file; - is standard input.
    file: PathBuf,
    /// The capture.
    capture: PathBuf,
    /// A folder for the table and for pictures of the worst views: photograph, decoded, difference.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Pictures of this many views.
    #[arg(long, value_name = "N", default_value_t = 4, requires = "output")]
    pictures: usize,
    #[command(flatten)]
    reading: CaptureArguments,
    /// Writes into a folder that is not empty.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

impl Compare {
    pub fn run(self) -> Result<()> {
        // The figures come last: where they are, the pictures are there.
        let folder = |path: &PathBuf| Folder::create(path, self.force, Some("compare.json"), &[&self.file]);
        let folder = self.output.as_ref().map(folder).transpose()?;
        let comparison = compare(&self.file, &self.capture, &self.reading, true)?;
        output::warn(&comparison.warnings);
        let (report, text) = (report(&comparison), table(&comparison));
        if let Some(folder) = folder {
            self.write_pictures(&folder, &comparison)?;
            folder.write("compare.json", format!("{report:#}\n").as_bytes())?;
            folder.write("compare.txt", text.as_bytes())?;
            folder.commit()?;
        }
        if self.json { output::print_json(&report) } else { output::print(&text) }
    }

    fn write_pictures(&self, folder: &Folder, comparison: &Comparison) -> Result<()> {
        let asset = &comparison.asset;
        let mut worst: Vec<&Compared> = comparison.frames.iter().collect();
        let psnr = |frame: &Compared| frame.error.psnr().sum.unwrap_or(f64::INFINITY);
        worst.sort_by(|a, b| psnr(a).total_cmp(&psnr(b)));
        for (rank, frame) in worst.into_iter().take(self.pictures).enumerate() {
            if let Some(decoded) = &asset.photographs[frame.view] {
                let picture = side_by_side(&frame.original, decoded, asset.white);
                let name = format!("worst-{:02}-{}.png", rank + 1, file_name(&frame.name));
                folder.write(&name, &pictures::png(&picture)?)?;
            }
        }
        let renderer = AssetRenderer::new(asset)?;
        let mut names = std::collections::HashSet::new();
        for (number, (view, original)) in comparison.held_out.iter().take(self.pictures).enumerate() {
            let lighting = match (renderer.light_number(view), view.light) {
                (None, Some(light)) => RenderLighting::Points(vec![light]),
                (number, _) => RenderLighting::Capture(number.unwrap_or(0)),
            };
            let rendered = renderer.render(&view.camera, &RenderOptions { lighting, ..Default::default() })?;
            let rendered = Photograph { mask: rendered.coverage, images: rendered.components };
            let picture = side_by_side(original, &rendered, asset.white);
            // Names that differ in what file names can't hold, or in the case of letters, may be the same here.
            let mut name = file_name(&view.name);
            if !names.insert(name.to_lowercase()) {
                name = format!("{number}-{name}");
            }
            folder.write(&format!("held-out-{name}.png"), &pictures::png(&picture)?)?;
        }
        Ok(())
    }
}

/// Small photographs are shown enlarged, to about this width.
const SHOWN_WIDTH: usize = 384;

/// Photograph, decoded picture and amplified difference.
pub fn side_by_side(original: &Photograph, decoded: &Photograph, white: [f64; 3]) -> DisplayImage {
    let wanted = pictures::masked(&original.sum(), &original.mask);
    let got = decoded.sum();
    let difference = metrics::difference(&wanted, &got, &original.mask, white, AMPLIFICATION);
    let factor = (SHOWN_WIDTH / wanted.width.max(1)).max(1);
    let shown = [
        metrics::to_display(&wanted, white),
        metrics::to_display(&pictures::masked(&got, &decoded.mask), white),
        difference,
    ];
    pictures::beside(&shown.map(|picture| pictures::enlarged(&picture, factor)))
}

/// A view's name as part of a file's name.
pub fn file_name(view: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '-' };
    crate::values::stem(view).chars().map(plain).take(80).collect()
}

/// The figures that other tools rely on, and a few more.
pub fn report(comparison: &Comparison) -> Value {
    let held_out = comparison.held_out_error.as_ref().map(|error| {
        let mut figures = psnr_json(&error.interpolated.psnr());
        figures["nearest"] = psnr_json(&error.nearest.psnr());
        figures["model"] = psnr_json(&error.model.psnr());
        figures["warped"] = psnr_json(&error.warped.psnr());
        figures["relit_views"] = json!(comparison.relit);
        figures["views"] = json!(comparison.held_out.iter().map(|(view, _)| &view.name).collect::<Vec<_>>());
        figures
    });
    let frames: Vec<Value> = (comparison.frames.iter())
        .map(|f| json!({"name": f.name, "psnr_db": f.error.psnr().sum, "ssim": f.ssim}))
        .collect();
    json!({
        "bytes": comparison.bytes,
        "masked_pixels": comparison.total.masked_pixels,
        "coverage": comparison.total.coverage(),
        "bits_per_sample": comparison.bits_per_sample(),
        "image_psnr_db": psnr_json(&comparison.total.psnr()),
        "held_out_psnr_db": held_out,
        "frames": frames,
        "missing_pixels": comparison.missing_pixels,
        "ssim": comparison.ssim,
        "warnings": comparison.warnings,
    })
}

fn table(comparison: &Comparison) -> String {
    let mut text = String::from("view                              diffuse  specular     sum     SSIM\n");
    let figures = |psnr: &metrics::ImagePsnr| {
        format!("{:>8} {:>9} {:>7}", decibel(psnr.diffuse), decibel(psnr.specular), decibel(psnr.sum))
    };
    let ssim = |value: Option<f64>| value.map_or_else(|| "-".into(), |s| format!("{s:.4}"));
    for frame in &comparison.frames {
        let _ = writeln!(
            text,
            "{:32} {}  {:>7}",
            output::line(&frame.name),
            figures(&frame.error.psnr()),
            ssim(frame.ssim)
        );
    }
    let total = comparison.total.psnr();
    let _ = writeln!(text, "{:32} {}  {:>7}  dB", "all views", figures(&total), ssim(comparison.ssim));
    if let Some(error) = &comparison.held_out_error {
        let _ = writeln!(text, "\n{} views that the file does not have, rendered:", comparison.held_out.len());
        if comparison.relit > 0 {
            let _ = writeln!(text, "({} of them under lights that no view of the file has)", comparison.relit);
        }
        let rows = [
            ("interpolated", &error.interpolated),
            ("nearest view's residual", &error.nearest),
            ("nearest photograph, warped", &error.warped),
            ("model alone", &error.model),
        ];
        for (name, error) in rows {
            let _ = writeln!(text, "{name:32} {}           dB", figures(&error.psnr()));
        }
    }
    let _ = writeln!(
        text,
        "\n{} bytes, {:.4} bits per pixel and colour, {} masked pixels, the mesh covers {:.2} % of them, {} missing",
        comparison.bytes,
        comparison.bits_per_sample(),
        comparison.total.masked_pixels,
        100.0 * comparison.total.coverage(),
        comparison.missing_pixels
    );
    text
}
