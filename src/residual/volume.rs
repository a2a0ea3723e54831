//! Residual volumes (u, v, view) of surface patches and their largest wavelet coefficients.
//!
//! Samples that no photograph shows are free: they are filled so that few coefficients describe the visible ones.

use crate::quantise::dead_zone::DeadZone;
use crate::transform::daubechies::{self, VolumeShape};

/// Working memory of [`truncate`] and [`restore`].
#[derive(Debug, Default)]
pub struct Workspace {
    scratch: Vec<f32>,
    filled: Vec<f32>,
    kept: Vec<bool>,
}

/// How many times [`truncate`] goes through the free samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Rounds in which the coefficients to keep are chosen.
    pub choosing: u32,
    /// Rounds in which the chosen ones are fitted to the visible samples.
    pub fitting: u32,
}

impl Default for Effort {
    fn default() -> Self {
        Effort { choosing: 6, fitting: 4 }
    }
}

/// The coefficients of one volume, those below `threshold` zero.
///
/// `residual` and `visible` hold `shape.area()` samples for each of the captured views, at most `shape.views`; views
/// that the shape pads are free, as are samples that are not visible. Alternating projections: transform, keep the large
/// coefficients, put the visible samples back.
#[cfg(feature = "encode")]
pub fn truncate(
    residual: &[f32],
    visible: &[bool],
    shape: VolumeShape,
    threshold: f32,
    effort: Effort,
    work: &mut Workspace,
) -> Vec<f32> {
    let mut coefficients = vec![0.0; shape.len()];
    let Workspace { scratch, filled, kept } = work;
    fill_along_views(residual, visible, shape, filled);
    if filled.iter().all(|x| *x == 0.0) {
        return coefficients;
    }
    for round in 0..effort.choosing {
        coefficients.copy_from_slice(filled);
        daubechies::forward(&mut coefficients, shape, scratch);
        // High thresholds first: the large coefficients settle before the small ones divide what is left.
        let left = (effort.choosing - 1 - round) as f32 / effort.choosing as f32;
        let level = threshold * (1.0 + 3.0 * left);
        coefficients.iter_mut().for_each(|c| *c = if c.abs() < level { 0.0 } else { *c });
        daubechies::inverse(&mut coefficients, shape, scratch);
        replace_free(filled, &coefficients, visible);
    }
    coefficients.copy_from_slice(filled);
    daubechies::forward(&mut coefficients, shape, scratch);
    kept.clear();
    kept.extend(coefficients.iter().map(|c| c.abs() >= threshold));
    if !kept.contains(&true) {
        coefficients.fill(0.0);
        return coefficients;
    }
    mask(&mut coefficients, kept);
    for _ in 0..effort.fitting {
        daubechies::inverse(&mut coefficients, shape, scratch);
        replace_free(filled, &coefficients, visible);
        coefficients.copy_from_slice(filled);
        daubechies::forward(&mut coefficients, shape, scratch);
        mask(&mut coefficients, kept);
    }
    coefficients.iter_mut().for_each(|c| *c = if c.abs() < threshold { 0.0 } else { *c });
    coefficients
}

/// The samples of the captured views from quantised coefficients.
pub fn restore(levels: &[i32], shape: VolumeShape, views: usize, quantiser: DeadZone, work: &mut Workspace) -> Vec<f32> {
    let mut samples: Vec<f32> = levels.iter().map(|&q| quantiser.dequantise(q)).collect();
    if levels.iter().any(|&q| q != 0) {
        daubechies::inverse(&mut samples, shape, &mut work.scratch);
    }
    samples.truncate(views * shape.area());
    samples
}

#[cfg(feature = "encode")]
fn mask(values: &mut [f32], kept: &[bool]) {
    values.iter_mut().zip(kept).for_each(|(value, kept)| *value = if *kept { *value } else { 0.0 });
}

#[cfg(feature = "encode")]
fn replace_free(filled: &mut [f32], from: &[f32], visible: &[bool]) {
    for (i, (to, from)) in filled.iter_mut().zip(from).enumerate() {
        if !visible.get(i).copied().unwrap_or(false) {
            *to = *from;
        }
    }
}

/// Where the filling starts: each sample's free views are interpolated linearly between the visible ones before and
/// after, the axis taken as a ring. Samples that no view shows take the mean of the patch's in that view.
#[cfg(feature = "encode")]
fn fill_along_views(residual: &[f32], visible: &[bool], shape: VolumeShape, filled: &mut Vec<f32>) {
    let (area, views) = (shape.area(), shape.views);
    filled.clear();
    filled.resize(shape.len(), 0.0);
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
                    filled[between % views * area + i] = last_value + share * (value - last_value);
                }
            }
            filled[view * area + i] = value;
            (last, last_value) = (ahead, value);
        }
    }
    if unseen.is_empty() || unseen.len() == area {
        return;
    }
    for picture in filled.chunks_exact_mut(area) {
        let mean = picture.iter().sum::<f32>() / (area - unseen.len()) as f32;
        unseen.iter().for_each(|&i| picture[i] = mean);
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
        let residual: Vec<f32> =
            (0..views * 16).map(|i| (0.4 * (i / 16) as f32).sin() + 0.05 * ((i * 37) % 11) as f32).collect();
        let error = |threshold: f32, effort: Effort| {
            let mut work = Workspace::default();
            let coefficients = truncate(&residual, &visible, shape, threshold, effort, &mut work);
            let count = coefficients.iter().filter(|c| **c != 0.0).count();
            let quantiser = DeadZone { threshold, step: 0.02 * threshold };
            let levels: Vec<i32> = coefficients.iter().map(|&c| quantiser.quantise(c)).collect();
            let samples = restore(&levels, shape, views, quantiser, &mut work);
            let squares = (0..residual.len()).filter(|&i| visible[i]).map(|i| (samples[i] - residual[i]).powi(2));
            (squares.sum::<f32>(), count)
        };
        let (tight, _) = error(1e-3, Effort::default());
        assert!(tight < 1e-4, "{tight}");
        let plain = error(0.3, Effort { choosing: 0, fitting: 0 });
        let filled = error(0.3, Effort::default());
        assert!(filled.0 < 1.1 * plain.0 && filled.1 < plain.1, "{filled:?} {plain:?}");
    }

    #[test]
    fn nothing_visible_keeps_nothing() {
        let shape = VolumeShape::padded(2, 5, 2);
        let coefficients =
            truncate(&[1.0; 80], &[false; 80], shape, 0.1, Effort::default(), &mut Workspace::default());
        assert!(coefficients.len() == 128 && coefficients.iter().all(|c| *c == 0.0));
    }
}
