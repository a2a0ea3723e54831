//! A file against the capture it was made from: what `compare` prints and `verify --against` checks.

use crate::values::{CaptureArguments, stem};
use crate::{progress, source};
use anyhow::{Context, Result};
use std::path::Path;
use tsuya::Asset;
use tsuya::Error;
use tsuya::decoder::ViewSelection;
use tsuya::encoder::separate;
use tsuya::metrics;
use tsuya::metrics::{PhotographError, coverage};
use tsuya::relight::AssetRenderer;
use tsuya::relight::{HeldOut, hold_out};
use tsuya::{Photograph, View};

/// The result.
pub struct Comparison {
    /// The decoded file.
    pub asset: Asset,
    /// Its bytes.
    pub bytes: u64,
    /// Photographs that the file has, in the capture's order.
    pub frames: Vec<Compared>,
    /// All of them together.
    pub total: PhotographError,
    /// Mean structural similarity.
    pub ssim: Option<f64>,
    /// Photographs that the file has not.
    pub held_out: Vec<(View, Photograph)>,
    /// How well they are predicted.
    pub held_out_error: Option<HeldOut>,
    /// How many of them are under lights that no view of the file has: they are relit.
    pub relit: usize,
    /// Pixels that are NaN or infinite in the capture, within the masks.
    pub missing_pixels: u64,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// One photograph and its decoded view.
pub struct Compared {
    /// Its name.
    pub name: String,
    /// Index of the view in the file.
    pub view: usize,
    /// The photograph.
    pub original: Photograph,
    /// Its errors.
    pub error: PhotographError,
    /// Structural similarity of the sum.
    pub ssim: Option<f64>,
}

/// Decodes the file, reads the capture and compares. `held_out` says whether views that the file lacks are rendered.
pub fn compare(file: &Path, capture: &Path, reading: &CaptureArguments, held_out: bool) -> Result<Comparison> {
    let (asset, bytes) = {
        let _busy = progress::busy("decoding");
        source::decode(file, ViewSelection::All)?
    };
    let mut captured = progress::read_capture(capture, &reading.read_options()?)?;
    let mut warnings = std::mem::take(&mut captured.warnings);
    let missing_pixels = captured.missing_pixels;
    let observations = separate(&mut captured)?;
    if observations.components != asset.components {
        return Err(Error::parameter(format!(
            "the file holds {:?}, the capture {:?}: they don't belong together",
            asset.components, observations.components
        ))
        .into());
    }
    let _busy = progress::busy("comparing");
    let mut unused: Vec<bool> = vec![true; asset.views.len()];
    let (mut frames, mut left_out) = (Vec::new(), Vec::new());
    for frame in observations.views {
        let camera = frame.view.camera;
        let found = (asset.views.iter().position(|view| view.name == frame.view.name))
            .or_else(|| asset.views.iter().position(|view| stem(&view.name) == stem(&frame.view.name)));
        let covered = || coverage(&asset.mesh, &camera);
        let mask = frame.mask.unwrap_or_else(covered);
        let original = Photograph { mask, images: frame.images };
        match found {
            None => left_out.push((frame.view, original)),
            Some(view) => {
                let coded = &asset.views[view].camera;
                if (coded.width, coded.height) != (camera.width, camera.height) {
                    let message = format!("view {} of the file has another size than the photograph", frame.view.name);
                    return Err(Error::parameter(message).into());
                }
                unused[view] = false;
                frames.push(Compared {
                    name: frame.view.name,
                    view,
                    original,
                    error: PhotographError::default(),
                    ssim: None,
                });
            }
        }
    }
    if frames.is_empty() {
        return Err(Error::parameter("the file has none of the capture's photographs: no name is the same").into());
    }
    let lacking = unused.iter().filter(|&&unused| unused).count();
    if lacking > 0 {
        warnings.push(format!("{lacking} views of the file are not in the capture"));
    }
    measure_frames(&asset, &mut frames);
    let mut total = PhotographError::default();
    frames.iter().for_each(|frame| total.merge(&frame.error));
    let similar: Vec<f64> = frames.iter().filter_map(|frame| frame.ssim).collect();
    let ssim = (!similar.is_empty()).then(|| similar.iter().sum::<f64>() / similar.len() as f64);
    let held_out_error = if held_out && !left_out.is_empty() {
        let (views, originals): (Vec<View>, Vec<Photograph>) = left_out.iter().cloned().unzip();
        Some(hold_out(&asset, &views, &originals).context("held-out views")?)
    } else {
        None
    };
    let renderer = AssetRenderer::new(&asset)?;
    let relit = left_out.iter().filter(|(view, _)| renderer.light_number(view).is_none()).count();
    drop(renderer);
    Ok(Comparison {
        relit,
        asset,
        bytes,
        frames,
        total,
        ssim,
        held_out: left_out,
        held_out_error,
        missing_pixels,
        warnings,
    })
}

fn measure_frames(asset: &Asset, frames: &mut [Compared]) {
    use rayon::prelude::*;
    frames.par_iter_mut().for_each(|frame| {
        // The mesh and the cameras as the decoder has them.
        let covered = coverage(&asset.mesh, &asset.views[frame.view].camera);
        let Some(decoded) = &asset.photographs[frame.view] else { return };
        frame.error = PhotographError::compare(&frame.original, decoded, &asset.components, &covered, asset.white);
        let mut both = frame.original.mask.clone();
        both.data.iter_mut().zip(&covered.data).for_each(|(inside, covered)| *inside &= covered);
        let (wanted, got) = (frame.original.sum(), decoded.sum());
        frame.ssim = metrics::ssim(&wanted, &got, &both, asset.white);
    });
}

impl Comparison {
    /// Bits for one masked pixel and colour.
    pub fn bits_per_sample(&self) -> f64 {
        8.0 * self.bytes as f64 / (3.0 * self.total.masked_pixels as f64)
    }
}
