//! `tsuya verify`: is a file whole, and as good as it says?

use crate::comparison::compare;
use crate::encode::psnr_json;
use crate::source::limits;
use crate::values::CaptureArguments;
use crate::{Failed, output, progress, source};
use anyhow::{Context, Result};
use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use tsuya::Asset;
use tsuya::Photograph;
use tsuya::container::{self, Metadata, Tag};
use tsuya::decoder::{DecodeOptions, decode_each};

/// The achieved error in the file is rounded; platforms may differ in the last bits of what they measure.
const TOLERANCE_DB: f64 = 0.05;

/// Checks a file: every byte of the container; on demand, that everything decodes and that its stated error is true.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya verify vase.tsuya\n",
    "  tsuya verify vase.tsuya --deep --against vase/",
))]
pub struct Verify {
    /// The file; - is standard input.
    file: PathBuf,
    /// Decodes everything, too.
    #[arg(long)]
    deep: bool,
    /// Compares with the capture and checks the error that the file states.
    #[arg(long, value_name = "CAPTURE")]
    against: Option<PathBuf>,
    #[command(flatten)]
    reading: CaptureArguments,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

impl Verify {
    pub fn run(self) -> Result<()> {
        let bytes = source::read(&self.file)?;
        let name = source::name(&self.file);
        let sections = container::verify(&bytes[..], limits()).with_context(|| name.clone())?;
        let shown = output::line(&name);
        let mut report = json!({"bytes": bytes.len(), "sections": sections.len()});
        let mut text = format!("{shown}: {} bytes in {} sections are undamaged\n", bytes.len(), sections.len());
        if self.deep {
            let _busy = progress::busy("decoding");
            let mut file = container::Container::open_slice(&bytes, limits())?;
            let mut decoded = 0;
            let options = DecodeOptions { limits: limits(), ..Default::default() };
            let count = |_: &Asset, views: Vec<(usize, Photograph)>| {
                decoded += views.len();
                Ok(())
            };
            let asset = decode_each(&mut file, &options, count).with_context(|| name.clone())?;
            if let Some(content) = file.read_optional(Tag::THUMBNAIL)? {
                let thumbnail = container::decode_thumbnail(content).with_context(|| name.clone())?;
                image::load_from_memory(&thumbnail.png)
                    .map_err(|e| tsuya::Error::format(Tag::THUMBNAIL, 0u8, format!("PNG: {e}")))?;
            }
            text += &format!("{decoded} of {} views decode\n", asset.views.len());
            report["views"] = json!(asset.views.len());
            report["views_decoded"] = json!(decoded);
            report["materials_decoded"] = json!(asset.materials.len());
            let lost = Metadata(asset.metadata.clone()).lost_views();
            let lost: Vec<String> =
                lost.iter().filter_map(|&view| Some(output::line(&asset.views.get(view)?.name))).collect();
            report["views_lost"] = json!(lost);
            if !lost.is_empty() {
                text += &format!("lost before the file was repaired: {}\n", lost.join(", "));
            }
            if !asset.materials.is_empty() {
                text += &format!("{} materials decode\n", asset.materials.len());
            }
        }
        if let Some(capture) = &self.against {
            let comparison = compare(&self.file, capture, &self.reading, false)?;
            output::warn(&comparison.warnings);
            let stated = Metadata(comparison.asset.metadata.clone()).achieved_error();
            let stated = stated.ok_or_else(|| Failed("the file states no error".into()))?;
            let measured = comparison.total.psnr();
            let figures = [
                ("diffuse", stated.diffuse_psnr_db, measured.diffuse),
                ("specular", stated.specular_psnr_db, measured.specular),
                ("sum", stated.sum_psnr_db, measured.sum),
            ];
            report["measured_psnr_db"] = psnr_json(&measured);
            for (component, stated, measured) in figures {
                let say = |db: Option<f64>| db.map_or_else(|| "none".into(), |db| format!("{db:.2} dB"));
                let agrees = match (stated, measured) {
                    (Some(stated), Some(measured)) => (stated - measured).abs() <= TOLERANCE_DB,
                    (stated, measured) => stated.is_none() && measured.is_none(),
                };
                if !agrees {
                    let (stated, measured) = (say(stated), say(measured));
                    let message = format!("{name}: {component} image PSNR is stated as {stated}, measured {measured}");
                    return Err(Failed(message).into());
                }
                if measured.is_some() {
                    text += &format!("{component} image PSNR is {}, as stated\n", say(measured));
                }
            }
        }
        if self.json { output::print_json(&report) } else { output::print(&text) }
    }
}
