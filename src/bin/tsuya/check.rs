//! `tsuya check`: whether a capture's mesh, cameras, masks and photographs belong together.

use crate::values::CaptureArguments;
use crate::{Failed, output, progress};
use anyhow::Result;
use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use tsuya::capture::CaptureReadOptions;

/// Reads a capture and checks that its mesh, cameras, masks and photographs agree; writes nothing.
///
/// Exit code 4 where they have nothing to do with each other.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya check vase/\n",
    "  tsuya check vase/ --mesh scan.ply --mesh-scale 0.001",
))]
pub struct Check {
    /// The capture: a folder, its transforms.json, a COLMAP model, or the cameras of another program.
    capture: PathBuf,
    #[command(flatten)]
    reading: CaptureArguments,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

impl Check {
    pub fn run(self) -> Result<()> {
        // As it is: what the check finds is told, not mended.
        let options = CaptureReadOptions { unchecked: true, ..self.reading.read_options()? };
        let capture = progress::open_capture(&self.capture, &options)?;
        let found = capture.agreement()?;
        if self.json {
            output::print_json(&json!({
                "frames": capture.views().len(),
                "skipped_frames": capture.skipped_frames,
                "vertices": capture.mesh.positions.len(),
                "triangles": capture.mesh.triangles.len(),
                "missing_pixels": capture.missing_pixels,
                "clipping": capture.clipping,
                "clipped_share": capture.clipping.share(),
                "agrees": !found.is_refused(),
                "agreement": found,
                "faults": found.sentences(),
                "warnings": capture.warnings,
            }))?;
        } else {
            output::warn(&capture.warnings);
            let (frames, triangles) = (capture.views().len(), capture.mesh.triangles.len());
            output::print(&format!("{frames} frames, {triangles} triangles; {} views looked at\n", found.views))?;
            let share = |share: Option<f64>| share.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share));
            let iou = found.silhouette_iou.map_or("- (no masks)".into(), |iou| format!("{iou:.3}"));
            output::print(&format!("silhouette against masks, intersection over union: {iou}\n"))?;
            output::print(&format!("masks covered by the mesh: {}\n", share(found.mask_coverage)))?;
            output::print(&format!("fronts of triangles, of the mesh as it is seen: {}\n", share(found.front_facing)))?;
            let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2}"));
            let (given, permuted) = (number(found.photo_consistency), number(found.permuted_consistency));
            output::print(&format!(
                "neighbouring photographs on the mesh, correlation: {given}, by chance {permuted}\n"
            ))?;
            output::print(&format!(
                "nearest camera, distance over the mesh's size: {}\n",
                number(found.nearest_camera)
            ))?;
            found.sentences().iter().try_for_each(|sentence| output::print(&format!("{sentence}\n")))?;
        }
        match found.is_refused() {
            true => Err(Failed("mesh, cameras, masks and photographs of the capture do not agree".into()).into()),
            false => Ok(()),
        }
    }
}
