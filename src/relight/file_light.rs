//! Irradiance by the light that a file holds, unshadowed, prepared when it is first asked for.

use crate::lighting::EnvironmentLobes;
use crate::sphere::octahedral::{self, OctahedralTaps};
use std::sync::OnceLock;

/// Cells along a side of the grid of normals.
const SIDE: usize = 16;

/// Irradiance of every normal, by cells of the octahedral grid.
#[derive(Default)]
pub(super) struct FileLight {
    cells: OnceLock<Vec<[f64; 3]>>,
}

impl FileLight {
    /// Irradiance of a surface of a unit normal; 0 where there is no light.
    pub(super) fn irradiance(&self, light: Option<&EnvironmentLobes>, normal: [f64; 3]) -> [f64; 3] {
        let Some(light) = light else { return [0.0; 3] };
        let cells = self
            .cells
            .get_or_init(|| octahedral::directions(SIDE).into_iter().map(|normal| light.irradiance(normal)).collect());
        let OctahedralTaps { cells: taps, weights } = octahedral::taps(normal, SIDE);
        let tap = |k: usize, c: usize| f64::from(weights[k]) * cells[taps[k] as usize][c];
        std::array::from_fn(|c| (0..4).map(|k| tap(k, c)).sum())
    }
}
