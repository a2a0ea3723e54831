//! Visual hulls: the largest shape with the silhouettes of a capture's masks (Laurentini 1994), as a mesh for captures that have none.
//!
//! A signed distance to the silhouette's edge, in world units, is taken for each view; the least of all views is a field whose zero is the hull's
//! surface. Blocks that no surface can cross are left out, the others are contoured by marching cubes (Lorensen and Cline 1987).

mod contour;
mod distance;
mod field;
mod finish;
mod silhouette;
#[cfg(test)]
mod tests;

use super::{CaptureReadOptions, describe};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use std::path::Path;

/// Cells along the hull's longest side, at least and at most.
const RESOLUTIONS: std::ops::RangeInclusive<u32> = 8..=1024;
/// Where they are chosen from the photographs.
const CHOSEN: std::ops::RangeInclusive<u32> = 40..=160;
/// Side of a cell then, in pixels. Silhouettes say little of what is between them: finer meshes take more bytes than they save in photographs.
const CELL_PIXELS: f64 = 7.0;

/// Settings of [`visual_hull`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HullOptions {
    /// How photographs and masks are read; what it says of meshes is not used.
    pub reading: CaptureReadOptions,
    /// Cells along the hull's longest side, 8 to 1024. Default: one for each 7 pixels, 40 to 160.
    pub resolution: Option<u32>,
    /// Brightest background, an sRGB signal from 0 to 1: what is darker in all colours and joined to the photograph's edge is not the object, in
    /// photographs without a mask. Default: those photographs are not used.
    pub dark_background: Option<f64>,
}

/// A visual hull.
#[derive(Debug, Clone, PartialEq)]
pub struct VisualHull {
    /// The hull's surface in the capture's world: closed, wound outwards.
    pub mesh: Mesh,
    /// Cells along the longest side.
    pub resolution: u32,
    /// Side of a cell, in the world's unit.
    pub cell: f64,
    /// Silhouettes that were used: one for each camera, under however many lights.
    pub views: usize,
    /// Non-fatal problems found, one sentence each.
    pub warnings: Vec<String>,
}

/// Computes the visual hull of a capture from its masks, or the alpha of its photographs. Neither mesh nor lights are needed.
///
/// # Errors
/// [`Error::Input`] if there are no masks, if no point is in all silhouettes, or if they do not bound the object; [`Error::Parameter`] if the
/// resolution is out of range.
pub fn visual_hull(path: impl AsRef<Path>, options: &HullOptions) -> Result<VisualHull> {
    if let Some(resolution) = options.resolution.filter(|resolution| !RESOLUTIONS.contains(resolution)) {
        return Err(Error::parameter(format!("a hull's resolution is from 8 to 1024, it is {resolution}")));
    }
    let access = options.reading.access();
    let description = describe(path, &access)?;
    let mut warnings = description.warnings.clone();
    let views = silhouette::read(&description, options, &access, &mut warnings)?;
    let bounds = field::bounds(&description.path, &views)?;
    let longest = bounds.longest();
    let chosen = || (longest / (CELL_PIXELS * field::pixel(&bounds, &views))).round() as u32;
    let resolution = options.resolution.unwrap_or_else(|| chosen().clamp(*CHOSEN.start(), *CHOSEN.end()));
    let grid = field::FieldGrid::new(&bounds, resolution);
    let mut mesh = contour::extract(&description.path, &grid, &views, &access)?;
    if mesh.triangles.is_empty() {
        return Err(Error::input(
            &description.path,
            "the silhouettes have next to nothing in common: do some masks leave parts of the object out, or is it thinner than a cell (then set a higher \
                                                       option `resolution`)?",
        ));
    }
    let dropped = finish::keep_large_parts(&mut mesh);
    if dropped > 0 {
        warnings.push(format!("{dropped} specks of the hull, each below 1 % of its largest part, are left out"));
    }
    finish::smooth(&mut mesh, grid.cell);
    Ok(VisualHull { mesh, resolution, cell: grid.cell, views: views.len(), warnings })
}
