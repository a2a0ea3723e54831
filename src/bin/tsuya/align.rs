//! `tsuya align`: where a mesh stands in the photographs' world.

use crate::values::{CaptureArguments, OutsideArgument};
use crate::{output, ply, source};
use anyhow::Result;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tsuya::Camera;
use tsuya::Error;
use tsuya::capture::{CaptureReadOptions, align, apply_pose, describe, read_correspondences};

/// Registers a mesh to a capture by points marked in its photographs.
///
/// POINTS is JSON: {"points": [{"frame": "off/000.exr", "pixel": [61.5, 40.25], "mesh": [0.12, 0.80, -0.31]}, ...]} with pixel
/// positions from the upper left corner and mesh points in the mesh file's coordinates. Six points or more, not in one plane.
#[derive(Args)]
pub struct Align {
    /// The capture.
    capture: PathBuf,
    /// The marked points.
    points: PathBuf,
    /// Writes the pose, for `tsuya encode --mesh-pose`; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Writes the mesh in the capture's world, as PLY.
    #[arg(long, value_name = "FILE")]
    write_mesh: Option<PathBuf>,
    /// The mesh [default: the one that the capture names, or the only one in its folder].
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// Finds the mesh's scale, too; needs points in two frames.
    #[arg(long)]
    scale: bool,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

impl Align {
    pub fn run(self) -> Result<()> {
        let access = self.outside.access();
        let reading = CaptureArguments { mesh: self.mesh.clone(), outside: self.outside, ..Default::default() };
        let mut inputs = reading.files(&self.capture)?;
        inputs.push(self.points.clone());
        let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
        let outputs: Vec<&Path> = self.output.iter().chain(&self.write_mesh).map(PathBuf::as_path).collect();
        output::check_outputs(&outputs, &inputs, self.force)?;
        let description = describe(&self.capture, &access)?;
        let points = read_correspondences(&self.points, &description, &access)?;
        let cameras: Vec<Camera> = description.frames.iter().map(|frame| frame.view.camera).collect();
        let alignment = align(&cameras, &points, self.scale)?;
        let report = json!({
            "mesh_transform": alignment.pose,
            "scale": alignment.scale,
            "points": points.len(),
            "rms_pixels": alignment.rms_pixels,
            "max_pixels": alignment.max_pixels,
            "errors_pixels": alignment.errors_pixels,
        });
        let mut files = output::Files::new(self.force);
        if let Some(path) = &self.output {
            files.add(path, format!("{report:#}\n").as_bytes())?;
        }
        if let Some(path) = &self.write_mesh {
            let options = CaptureReadOptions { mesh: self.mesh.clone(), ..Default::default() };
            let mut mesh = tsuya::mesh::read(description.find_mesh(&options)?, &access)?;
            apply_pose(&mut mesh, &alignment.pose);
            files.add(path, &ply::write(&mesh))?;
        }
        files.commit()?;
        if self.output.as_deref().is_some_and(output::is_stream) {
            return Ok(());
        }
        if self.json {
            return output::print_json(&report);
        }
        let mut text = String::from("mesh to world:\n");
        for row in &alignment.pose {
            let _ = writeln!(text, "{:14.8} {:14.8} {:14.8} {:14.8}", row[0], row[1], row[2], row[3]);
        }
        let _ = writeln!(
            text,
            "scale {:.6}\nreprojection error of {} points: {:.3} pixels RMS, {:.3} at most",
            alignment.scale,
            points.len(),
            alignment.rms_pixels,
            alignment.max_pixels
        );
        output::print(&text)
    }
}

/// Bytes of a pose with its errors, at most.
const MAX_POSE_BYTES: u64 = 1 << 20;

/// The pose in a file that `align -o` wrote.
pub fn read_pose(path: &Path) -> tsuya::Result<[[f64; 4]; 4]> {
    let bytes = source::read_at_most(path, "pose", MAX_POSE_BYTES)?;
    let value: Value = serde_json::from_slice(&bytes).map_err(|e| Error::input(path, e.to_string()))?;
    let pose: Option<[[f64; 4]; 4]> =
        value.get("mesh_transform").and_then(|rows| serde_json::from_value(rows.clone()).ok());
    pose.ok_or_else(|| Error::input(path, "key \"mesh_transform\" should be a 4 x 4 matrix in rows"))
}
