//! `tsuya hull`: a mesh out of the masks.

use crate::values::OutsideArgument;
use crate::{output, ply, progress, source};
use anyhow::Result;
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use tsuya::capture::{CaptureReadOptions, HullOptions, describe, visual_hull};

/// Makes a mesh from the masks of a capture that has none: the visual hull, the largest shape with these silhouettes.
///
/// Hollows that no silhouette shows are filled, so a scan is better where there is one. Photographs from all sides are needed.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya hull vase/ -o hull.ply && tsuya encode vase/ --mesh hull.ply -o vase.tsuya",
))]
pub struct Hull {
    /// The capture: a folder, its transforms.json, a COLMAP model, or the cameras of another program.
    capture: PathBuf,
    /// Writes the mesh, as PLY, for `tsuya encode --mesh`; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Cells along the hull's longest side, 8 to 1024 [default: one for each 7 pixels, 40 to 160].
    #[arg(long, value_name = "N")]
    resolution: Option<u32>,
    /// Photographs without a mask show the object before a background that is no brighter than this, 0 to 1: what is darker, and joined to the
    /// photograph's edge, is not the object.
    #[arg(long, value_name = "LEVEL")]
    dark_background: Option<f64>,
    /// The masks show the background, not the object.
    #[arg(long)]
    invert_masks: bool,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

impl Hull {
    pub fn run(self) -> Result<()> {
        let description = describe(&self.capture, &self.outside.access())?;
        let mut inputs: Vec<&Path> = description.files().collect();
        inputs.extend([description.path.as_path(), self.capture.as_path()]);
        output::check_outputs(&[&self.output], &inputs, self.force)?;
        let options = HullOptions {
            reading: CaptureReadOptions {
                invert_masks: self.invert_masks,
                limits: source::limits(),
                allow_outside: self.outside.allow_outside,
                ..CaptureReadOptions::default()
            },
            resolution: self.resolution,
            dark_background: self.dark_background,
        };
        let busy = progress::busy("carving");
        let hull = visual_hull(&self.capture, &options)?;
        drop(busy);
        let mut files = output::Files::new(self.force);
        files.add(&self.output, &ply::write(&hull.mesh))?;
        files.commit()?;
        output::warn(&hull.warnings);
        if output::is_stream(&self.output) {
            return Ok(());
        }
        let (vertices, triangles) = (hull.mesh.positions.len(), hull.mesh.triangles.len());
        if self.json {
            return output::print_json(&json!({
                "views": hull.views,
                "resolution": hull.resolution,
                "cell": hull.cell,
                "vertices": vertices,
                "triangles": triangles,
                "warnings": hull.warnings,
            }));
        }
        let (views, resolution, cell) = (hull.views, hull.resolution, hull.cell);
        output::tell(&format!(
            "{views} silhouettes, {resolution} cells of {cell:.3e} along the longest side, {triangles} triangles\n"
        ))
    }
}
