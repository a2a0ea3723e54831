//! Stages of the refinement, coarse to fine.

use super::evidence::LossScales;
use super::system::Priors;
use crate::reflectance::lobes::share::SharingScale;

/// Iterations on one mesh.
#[derive(Clone, Copy)]
pub(super) struct Stage {
    /// Subdivisions fewer than those of the finest mesh.
    pub(super) coarser: u32,
    pub(super) iterations: usize,
    pub(super) priors: Priors,
    pub(super) scales: LossScales,
    /// Over half the longest side of the object.
    pub(super) sharing: SharingScale,
    /// Iterations between fits of the lobes, and between drawings of depths.
    pub(super) lobes_every: usize,
    pub(super) depths_every: usize,
}

const fn stage(
    coarser: u32,
    iterations: usize,
    priors: [f64; 3],
    scales: [f64; 2],
    sharing: [f64; 2],
    every: [usize; 2],
) -> Stage {
    let [smoothness, anchor, damping] = priors;
    Stage {
        coarser,
        iterations,
        priors: Priors { smoothness, anchor, damping },
        scales: LossScales { diffuse: scales[0], specular: scales[1] },
        sharing: SharingScale { cell: sharing[0], smoothing: sharing[1] },
        lobes_every: every[0],
        depths_every: every[1],
    }
}

/// Weights fall as vertices multiply. The last stage shares lobes less widely: by then the normals are good enough.
pub(super) const STAGES: [Stage; 5] = [
    stage(2, 4, [0.02, 0.004, 0.02], [0.02, 0.06], [0.03, 0.05], [2, 4]),
    stage(1, 6, [0.02, 0.004, 0.02], [0.02, 0.06], [0.03, 0.05], [2, 4]),
    stage(0, 5, [0.08, 0.004, 0.02], [0.04, 0.04], [0.03, 0.05], [2, 8]),
    stage(0, 5, [0.05, 0.0003, 0.003], [0.04, 0.04], [0.03, 0.05], [2, 8]),
    stage(0, 6, [0.05, 0.0005, 0.01], [0.04, 0.05], [0.02, 0.02], [1, 8]),
];
