//! Mesh and atlas of an asset that glTF can hold.

use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::surface::charts::Charts;

/// The charts of an asset with a mesh and an atlas that belong together.
pub(super) fn charts(asset: &Asset) -> Result<&Charts> {
    let mesh = &asset.mesh;
    let Some(charts) = asset.charts.as_ref().filter(|_| !mesh.triangles.is_empty()) else {
        let message = "the file has no mesh with an atlas (profile wavelet-texture?), which a glTF mesh needs for texture coordinates";
        return Err(Error::Unsupported(message.into()));
    };
    let of_mesh = charts.chart_of_triangle.len() == mesh.triangles.len()
        && charts.chart_of_triangle.iter().all(|&chart| (chart as usize) < charts.charts.len())
        && mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.positions.len());
    if !of_mesh || charts.width == 0 || charts.height == 0 {
        return Err(Error::parameter("mesh and charts do not belong together"));
    }
    Ok(charts)
}
