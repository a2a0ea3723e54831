//! `tsuya decode`: a file becomes photographs, mesh and maps again, as a capture that `tsuya encode` reads.

mod capture;
mod names;

use crate::source::{limits, name, open_container};
use crate::values::{find_view, region};
use crate::{output, ply, progress, repair, source};
use anyhow::{Context, Result};
use capture::{CaptureFolder, INDEX};
use clap::{Args, ValueEnum};
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use tsuya::Asset;
use tsuya::Error;
use tsuya::Photograph;
use tsuya::container::{Container, Tag};
use tsuya::decoder::{DecodeOptions, ViewSelection, decode_each, decode_from, read_views};
use tsuya::image::Region;

/// Decodes a file into a folder: photographs, masks, mesh, reflectance maps and a transforms.json that `tsuya encode` reads.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya decode vase.tsuya -o out/\n",
    "  tsuya decode vase.tsuya -o out/ --views 3,off/012.exr --format png16\n",
    "  tsuya decode vase.tsuya -o small/ --reduce 2\n",
    "  tsuya decode vase.tsuya -o vase.ply --mesh-only",
))]
pub struct Decode {
    /// The file; - is standard input.
    file: PathBuf,
    /// The folder to write; with --mesh-only a .ply file, with --section a file; - is standard output for these two.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Only these views, by number or name, with commas between; of the others nothing is read that these don't need.
    #[arg(long, value_name = "VIEW,...", value_delimiter = ',')]
    views: Vec<String>,
    /// Halves the size of the photographs N times, 0 to 5, profile predictive: of finer detail nothing is read or decoded.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=5))]
    #[arg(conflicts_with_all = ["mesh_only", "section"])]
    reduce: u8,
    /// Only this region of each photograph: its first column and row, its width and height, in pixels after --reduce. The cameras are those
    /// of the region. Profile predictive reads and decodes of fine detail only the tiles that it takes; maps of the reflectance are left out.
    #[arg(long, value_name = "X,Y,W,H", value_parser = region, conflicts_with_all = ["mesh_only", "section"])]
    region: Option<Region>,
    /// File format of the photographs.
    #[arg(long, value_enum, default_value = "exr")]
    format: Format,
    /// EXR with 16-bit floats instead of 32-bit ones.
    #[arg(long)]
    half: bool,
    /// Also an 8-bit PNG of each photograph, to look at.
    #[arg(long)]
    preview: bool,
    /// Only the mesh, as a PLY file.
    #[arg(long, conflicts_with_all = ["views", "section"])]
    mesh_only: bool,
    /// Only the content of this section, checked and decompressed.
    #[arg(long, value_name = "TAG", conflicts_with = "views")]
    section: Option<String>,
    /// Decodes what is whole of a cut or damaged file, says what is lost, and ends with code 4 where something is. Without it such a
    /// file is an error (3); tsuya repair writes a file of what is whole.
    #[arg(long)]
    salvage: bool,
    /// Writes into a folder that is not empty, over files of the same names; its other files stay.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Format {
    /// Linear radiance, all of it.
    Exr,
    /// 16-bit sRGB; the white board is the brightest.
    Png16,
    /// 8-bit sRGB; the white board is the brightest.
    Png,
}

/// Adds the time since it was made when it is dropped.
struct Timed<'a>(&'a mut Duration, Instant);

impl Drop for Timed<'_> {
    fn drop(&mut self) {
        *self.0 += self.1.elapsed();
    }
}

impl Decode {
    pub fn run(self) -> Result<()> {
        let start = Instant::now();
        if self.salvage {
            let bytes = source::read(&self.file)?;
            let repaired = tsuya::repair(&bytes, limits()).with_context(|| name(&self.file))?;
            let mut file = Container::open_slice(&repaired.bytes, limits())?;
            self.decode(&mut file, start)?;
            return repair::report_losses(&self.file, &repaired);
        }
        self.decode(&mut open_container(&self.file)?, start)
    }

    fn decode<R: std::io::Read + std::io::Seek>(&self, file: &mut Container<R>, start: Instant) -> Result<()> {
        let context = || name(&self.file);
        if let Some(tag) = &self.section {
            let tag = <[u8; 4]>::try_from(tag.as_bytes()).map(Tag).ok().filter(|tag| tag.is_valid());
            let tag = tag.ok_or_else(|| Error::parameter("a section's tag has four letters; tsuya info lists them"))?;
            output::check_outputs(&[&self.output], &[&self.file], self.force)?;
            let content = file.read_section(tag).with_context(context)?;
            return output::write(&self.output, &content, self.force);
        }
        let selection = self.selection(file).with_context(context)?;
        let to_stream = output::is_stream(&self.output);
        let folder = if self.mesh_only {
            output::check_outputs(&[&self.output], &[&self.file], self.force)?;
            None
        } else if to_stream {
            return Err(Error::parameter("only --mesh-only and --section can go to standard output").into());
        } else {
            Some(output::Folder::create(&self.output, self.force, Some(INDEX), &[&self.file])?)
        };
        let options = DecodeOptions {
            selection,
            limits: limits(),
            reduction: self.reduce,
            region: self.region,
            photographs_only: self.region.is_some() || self.mesh_only,
        };
        let _busy = progress::busy("decoding");
        let mut writing = Duration::ZERO;
        let (asset, views) = match folder {
            None => {
                let asset = decode_from(file, &options).with_context(context)?;
                let _timed = Timed(&mut writing, Instant::now());
                output::write(&self.output, &ply::write(&asset.mesh), self.force)?;
                (asset, 0)
            }
            Some(folder) => {
                let folder = CaptureFolder { folder, format: self.format, half: self.half, names: Default::default() };
                let mut frames = Vec::new();
                // What stopped the writing: the decoder's errors are of another kind.
                let mut stopped = None;
                let write = |asset: &Asset, decoded: Vec<(usize, Photograph)>| {
                    let _timed = Timed(&mut writing, Instant::now());
                    match folder.write_views(asset, &decoded, self.preview) {
                        Ok(written) => frames.extend(written),
                        Err(error) => {
                            stopped = Some(error);
                            return Err(Error::parameter("the views can't be written"));
                        }
                    }
                    Ok(())
                };
                let decoded = decode_each(file, &options, write);
                if let Some(error) = stopped {
                    return Err(error);
                }
                let (asset, count) = (decoded.with_context(context)?, frames.len());
                let _timed = Timed(&mut writing, Instant::now());
                folder.finish(&asset, frames)?;
                (asset, count)
            }
        };
        let seconds = (start.elapsed() - writing).as_secs_f64();
        let (read, bytes) = (file.bytes_read(), file.file_bytes());
        if self.json {
            return output::print_json(&json!({
                "views": views,
                "views_in_file": asset.views.len(),
                "bytes_read": read,
                "bytes": bytes,
                "decode_seconds": seconds,
                "seconds": start.elapsed().as_secs_f64(),
            }));
        }
        if to_stream {
            return Ok(());
        }
        output::tell(&format!(
            "{views} of {} views, {read} of {bytes} bytes read, decoded in {seconds:.2} s, written in {:.2} s\n",
            asset.views.len(),
            writing.as_secs_f64()
        ))
    }

    fn selection<R: std::io::Read + std::io::Seek>(&self, file: &mut Container<R>) -> tsuya::Result<ViewSelection> {
        if self.mesh_only {
            return Ok(ViewSelection::None);
        }
        if self.views.is_empty() {
            return Ok(ViewSelection::All);
        }
        let views = read_views(file)?;
        let wanted: tsuya::Result<Vec<usize>> = self.views.iter().map(|wanted| find_view(wanted, &views)).collect();
        Ok(ViewSelection::Views(wanted?))
    }
}
