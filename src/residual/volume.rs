//! Residual volumes (u, v, view) of surface patches and their largest wavelet coefficients.
//!
//! Samples that no photograph shows are free: they are filled so that few coefficients describe the visible ones.

use crate::transform::daubechies::{self, VolumeShape};

/// Working memory for volumes of `L` interleaved planes.
#[derive(Debug)]
#[cfg_attr(not(feature = "encode"), allow(dead_code))]
pub(crate) struct VolumeScratch<const L: usize> {
    scratch: Vec<[f32; L]>,
    filled: Vec<[f32; L]>,
    kept: Vec<[f32; L]>,
}

impl<const L: usize> Default for VolumeScratch<L> {
    fn default() -> Self {
        VolumeScratch { scratch: Vec::new(), filled: Vec::new(), kept: Vec::new() }
    }
}

/// Rounds in which [`truncate`] fills the free samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FillEffort {
    /// Rounds in which the coefficients to keep are chosen.
    pub choosing: u32,
    /// Rounds in which the chosen ones are fitted to the visible samples.
    pub fitting: u32,
}

impl FillEffort {
    /// Free samples are left at zero and coded as if they had been seen.
    pub const HOLES_ARE_ZERO: FillEffort = FillEffort { choosing: 0, fitting: 0 };
}

impl Default for FillEffort {
    fn default() -> Self {
        FillEffort { choosing: 4, fitting: 3 }
    }
}

/// The coefficients of `L` volumes that see the same samples, those below `threshold` zero.
///
/// `residual` and `visible` hold `shape.area()` samples for each of the captured views, at most `shape.views`; views
/// that the shape pads are free, as are samples that are not visible. Alternating projections: transform, keep the large
/// coefficients, put the visible samples back.
#[cfg(feature = "encode")]
pub(crate) fn truncate<const L: usize>(
    residual: &[[f32; L]],
    visible: &[bool],
    shape: VolumeShape,
    threshold: f32,
    effort: FillEffort,
    work: &mut VolumeScratch<L>,
) -> Vec<[f32; L]> {
    let VolumeScratch { scratch, filled, kept } = work;
    if effort == FillEffort::HOLES_ARE_ZERO {
        place_visible(residual, visible, shape, filled);
    } else {
        fill_along_views(residual, visible, shape, filled);
    }
    // The transform keeps the energy: less of it than the threshold's in all lanes leaves nothing.
    let energy = filled.iter().fold([0.0f32; L], |sum, x| std::array::from_fn(|l| sum[l] + x[l] * x[l]));
    if energy.iter().all(|e| *e < threshold * threshold) {
        return Vec::new();
    }
    let mut coefficients = filled.clone();
    for round in 0..effort.choosing {
        daubechies::forward(&mut coefficients, shape, scratch);
        // High thresholds first: the large coefficients settle before the small ones divide what is left.
        let left = (effort.choosing - 1 - round) as f32 / effort.choosing as f32;
        cut(&mut coefficients, threshold * (1.0 + 3.0 * left));
        daubechies::inverse(&mut coefficients, shape, scratch);
        restore_visible(&mut coefficients, filled, visible);
    }
    daubechies::forward(&mut coefficients, shape, scratch);
    cut(&mut coefficients, threshold);
    kept.clear();
    kept.extend(coefficients.iter().map(|c| c.map(|c| if c == 0.0 { 0.0 } else { 1.0 })));
    if kept.iter().flatten().all(|k| *k == 0.0) {
        return Vec::new();
    }
    for _ in 0..effort.fitting {
        daubechies::inverse(&mut coefficients, shape, scratch);
        restore_visible(&mut coefficients, filled, visible);
        daubechies::forward(&mut coefficients, shape, scratch);
        coefficients.iter_mut().zip(kept.iter()).for_each(|(c, kept)| (0..L).for_each(|l| c[l] *= kept[l]));
    }
    cut(&mut coefficients, threshold);
    coefficients
}

/// The samples of the captured views from quantised coefficients, `L` volumes at once.
pub(crate) fn restore<const L: usize>(
    mut coefficients: Vec<[f32; L]>,
    shape: VolumeShape,
    views: usize,
    work: &mut VolumeScratch<L>,
) -> Vec<[f32; L]> {
    if coefficients.iter().flatten().any(|c| *c != 0.0) {
        daubechies::inverse(&mut coefficients, shape, &mut work.scratch);
    }
    coefficients.truncate(views * shape.area());
    coefficients
}

#[cfg(feature = "encode")]
fn cut<const L: usize>(coefficients: &mut [[f32; L]], threshold: f32) {
    for c in coefficients {
        *c = c.map(|c| if c.abs() < threshold { 0.0 } else { c });
    }
}

#[cfg(feature = "encode")]
fn restore_visible<const L: usize>(samples: &mut [[f32; L]], measured: &[[f32; L]], visible: &[bool]) {
    for ((sample, measured), visible) in samples.iter_mut().zip(measured).zip(visible) {
        if *visible {
            *sample = *measured;
        }
    }
}

/// The visible samples, zero elsewhere.
#[cfg(feature = "encode")]
fn place_visible<const L: usize>(
    residual: &[[f32; L]],
    visible: &[bool],
    shape: VolumeShape,
    samples: &mut Vec<[f32; L]>,
) {
    samples.clear();
    samples.resize(shape.len(), [0.0; L]);
    restore_visible(samples, residual, visible);
}

/// Initial filling: each sample's free views are interpolated linearly between the visible ones before and
/// after, the axis taken as a ring. Samples that no view shows take the mean of the patch's in that view.
#[cfg(feature = "encode")]
fn fill_along_views<const L: usize>(
    residual: &[[f32; L]],
    visible: &[bool],
    shape: VolumeShape,
    filled: &mut Vec<[f32; L]>,
) {
    let (area, views) = (shape.area(), shape.views);
    filled.clear();
    filled.resize(shape.len(), [0.0; L]);
    let seen = |view: usize, i: usize| visible.get(view * area + i).copied().unwrap_or(false);
    let mut unseen = Vec::new();
    for i in 0..area {
        let Some(first) = (0..views).find(|&view| seen(view, i)) else {
            unseen.push(i);
            continue;
        };
        let (mut last, mut last_value) = (first, residual[first * area + i]);
        filled[first * area + i] = last_value;
        for ahead in first + 1..=first + views {
            let view = ahead % views;
            if !seen(view, i) {
                continue;
            }
            let value = residual[view * area + i];
            let gap = (ahead - last) as f32;
            // Without a transform along the views a blend across them has no use.
            if shape.view_levels > 0 {
                for between in last + 1..ahead {
                    let share = (between - last) as f32 / gap;
                    filled[between % views * area + i] =
                        std::array::from_fn(|l| last_value[l] + share * (value[l] - last_value[l]));
                }
            }
            filled[view * area + i] = value;
            (last, last_value) = (ahead, value);
        }
    }
    if unseen.is_empty() || unseen.len() == area {
        return;
    }
    let scale = 1.0 / (area - unseen.len()) as f32;
    for picture in filled.chunks_exact_mut(area) {
        let sum = picture.iter().fold([0.0f32; L], |sum, x| std::array::from_fn(|l| sum[l] + x[l]));
        unseen.iter().for_each(|&i| picture[i] = sum.map(|s| s * scale));
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn free_samples_cost_no_error() {
        let shape = VolumeShape::padded(2, 12, 2);
        let views = 12;
        let visible: Vec<bool> = (0..views * 16).map(|i| (i / 16 + i % 3) % views < 6).collect();
        let residual: Vec<[f32; 1]> =
            (0..views * 16).map(|i| [(0.4 * (i / 16) as f32).sin() + 0.05 * ((i * 37) % 11) as f32]).collect();
        let error = |threshold: f32, effort: FillEffort| {
            let mut work = VolumeScratch::default();
            let coefficients = truncate(&residual, &visible, shape, threshold, effort, &mut work);
            let count = coefficients.iter().filter(|c| c[0] != 0.0).count();
            let samples = restore(coefficients, shape, views, &mut work);
            let squares = (0..residual.len()).filter(|&i| visible[i]).map(|i| (samples[i][0] - residual[i][0]).powi(2));
            (squares.sum::<f32>(), count)
        };
        let (tight, _) = error(1e-3, FillEffort::default());
        assert!(tight < 1e-4, "{tight}");
        let plain = error(0.3, FillEffort { choosing: 0, fitting: 0 });
        let filled = error(0.3, FillEffort::default());
        assert!(filled.0 < 1.1 * plain.0 && filled.1 < plain.1, "{filled:?} {plain:?}");
    }

    #[test]
    fn nothing_visible_keeps_nothing() {
        let shape = VolumeShape::padded(2, 5, 2);
        let coefficients =
            truncate(&[[1.0]; 80], &[false; 80], shape, 0.1, FillEffort::default(), &mut VolumeScratch::default());
        assert!(coefficients.is_empty());
    }
}
