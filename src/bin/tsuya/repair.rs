//! `tsuya repair`: a whole file of what is left of a damaged one.

use crate::source::{self, limits, name};
use crate::{Failed, output, progress};
use anyhow::{Context, Result};
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tsuya::container::Container;
use tsuya::decoder::{DecodeOptions, decode_from};
use tsuya::{RepairedFile, repair};

/// Makes a whole file of what is left of a damaged one: every section and every view that checksums still prove.
///
/// A view is lost with its own bytes, or with those of a view that it is predicted from; the views that are kept decode to the same bits as
/// before. Files that were cut, that have holes, changed, lost or added bytes, garbage before or after, or came through a transfer in
/// text mode are mended. Ends with code 0 where nothing is lost, 4 where something is and a file was written, 3 where nothing can be saved.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya repair broken.tsuya -o saved.tsuya",
))]
pub struct Repair {
    /// The damaged file; - is standard input.
    file: PathBuf,
    /// The file to write; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Overwrites an existing file, but never the damaged one.
    #[arg(long)]
    force: bool,
    /// Prints what was kept and what is lost as JSON.
    #[arg(long)]
    json: bool,
}

impl Repair {
    pub fn run(self) -> Result<()> {
        output::check_outputs(&[&self.output], &[&self.file], self.force)?;
        let bytes = source::read(&self.file)?;
        let repaired = {
            let _busy = progress::busy("repairing");
            let repaired = repair(&bytes, limits()).with_context(|| name(&self.file))?;
            check(&repaired).with_context(|| format!("{}: what is left of it", name(&self.file)))?;
            repaired
        };
        output::write(&self.output, &repaired.bytes, self.force)?;
        let to_stream = output::is_stream(&self.output);
        if self.json && !to_stream {
            output::print_json(&report(&repaired))?;
        } else if !to_stream {
            output::tell(&table(&repaired))?;
        }
        report_losses(&self.file, &repaired)
    }
}

/// What is written decodes.
fn check(repaired: &RepairedFile) -> Result<()> {
    let mut file = Container::open_slice(&repaired.bytes, limits())?;
    match decode_from(&mut file, &DecodeOptions { limits: limits(), ..Default::default() }) {
        Ok(_) => Ok(()),
        Err(error @ tsuya::Error::Limits { .. }) => {
            output::warn(&[format!("not checked whether it decodes: {error}")]);
            Ok(())
        }
        Err(error) => Err(error.into()),
    }
}

fn report(repaired: &RepairedFile) -> serde_json::Value {
    let kept: Vec<String> = repaired.kept.iter().map(|tag| tag.to_string()).collect();
    let sections: Vec<_> =
        repaired.lost_sections.iter().map(|(tag, why)| json!({"tag": tag.to_string(), "why": why})).collect();
    let views: Vec<_> =
        (repaired.lost_views.iter()).map(|(view, name, why)| json!({"view": view, "name": name, "why": why})).collect();
    json!({
        "was_whole": repaired.was_whole,
        "bytes": repaired.bytes.len(),
        "faults": repaired.faults,
        "kept_sections": kept,
        "views": repaired.views,
        "kept_views": repaired.views - repaired.lost_views.len(),
        "lost_sections": sections,
        "lost_views": views,
        "all_sections_known": repaired.is_all_known,
    })
}

fn table(repaired: &RepairedFile) -> String {
    let mut text = String::new();
    if repaired.was_whole {
        return "the file is undamaged: written as it is\n".into();
    }
    for fault in &repaired.faults {
        let _ = writeln!(text, "{fault}");
    }
    let kept: Vec<String> = repaired.kept.iter().map(|tag| tag.to_string()).collect();
    let _ = writeln!(text, "kept: sections {}", kept.join(" "));
    if repaired.views > 0 {
        let views = repaired.views - repaired.lost_views.len();
        let _ = writeln!(text, "kept: {views} of {} views", repaired.views);
    }
    for (tag, why) in &repaired.lost_sections {
        let _ = writeln!(text, "lost: section {tag}: {why}");
    }
    for (_, name, why) in &repaired.lost_views {
        let _ = writeln!(text, "lost: view {}: {}", output::line(name), output::line(why));
    }
    text
}

/// An error that says what is lost, where something is.
pub fn report_losses(file: &Path, repaired: &RepairedFile) -> Result<()> {
    if !repaired.has_losses() {
        return Ok(());
    }
    let mut parts = Vec::new();
    if !repaired.lost_views.is_empty() {
        // All names are in the table of tsuya repair.
        let names: Vec<&str> = repaired.lost_views.iter().take(8).map(|(_, name, _)| name.as_str()).collect();
        let more = if repaired.lost_views.len() > names.len() { ", ..." } else { "" };
        parts.push(format!("{} of {} views ({}{more})", repaired.lost_views.len(), repaired.views, names.join(", ")));
    }
    if !repaired.lost_sections.is_empty() {
        let tags: Vec<String> = repaired.lost_sections.iter().map(|(tag, _)| tag.to_string()).collect();
        parts.push(format!("sections {}", tags.join(" ")));
    }
    if !repaired.is_all_known {
        parts.push("perhaps what stood after the last section that was found".into());
    }
    Err(Failed(format!("{}: lost: {}", name(file), parts.join(", "))).into())
}
