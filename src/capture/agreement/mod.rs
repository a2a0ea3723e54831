//! Agreement of a capture's mesh, cameras and masks, from small versions of some views.

mod readings;
mod silhouette;

use super::Capture;
use crate::error::{Error, Result};
use crate::parallel;
use crate::views::Camera;
use serde::Serialize;
use silhouette::{SilhouetteCounts, SmallView, count, iou};
use std::path::Path;

/// Views that are looked at, evenly spaced.
const MAX_VIEWS: usize = 24;
/// Views on which other readings of a capture are tried.
const TRIED_VIEWS: usize = 8;
/// Below this intersection over union mesh and masks have nothing to do with each other.
const REFUSED: f64 = 0.2;
/// Below this one the user is warned.
const DOUBTFUL: f64 = 0.7;
/// Share of the seen surface that faces the cameras, below which the mesh is wound inwards, and below which the user is warned.
const INWARDS: f64 = 0.2;
const MIXED: f64 = 0.9;

/// Figures of how well mesh, cameras and masks of a capture agree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Views that were looked at.
    pub views: usize,
    /// Mean intersection over union of the mesh's silhouette and the masks; `None` without masks.
    pub silhouette_iou: Option<f64>,
    /// Share of the masks' pixels that the mesh covers; `None` without masks.
    pub mask_coverage: Option<f64>,
    /// Share of the pixels that show the mesh which show the front of a triangle; `None` where no view shows the mesh.
    pub front_facing: Option<f64>,
    /// Other reading of the capture under which mesh and masks agree, and by how much, where they do not as they are.
    pub cause: Option<Cause>,
}

/// A mistake that explains why mesh and masks disagree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cause {
    /// The fault and its remedy, one sentence.
    pub sentence: String,
    /// Mean intersection over union without the mistake.
    pub silhouette_iou: f64,
}

/// Compares the mesh's silhouette with the masks and looks at which side of its triangles the cameras see. Takes time for some dozens of views of
/// 160 pixels a side, however many and large the capture's are.
pub fn agreement(capture: &Capture) -> Agreement {
    let step = capture.frames.len().div_ceil(MAX_VIEWS).max(1);
    let views: Vec<SmallView> = capture.frames.iter().step_by(step).map(SmallView::new).collect();
    let counts = parallel::map(views.len(), |k| count(&capture.mesh, &views[k].camera, views[k].mask.as_deref()));
    let masked: Vec<&SilhouetteCounts> =
        counts.iter().zip(&views).filter(|(_, view)| view.mask.is_some()).map(|(c, _)| c).collect();
    let sum = |of: fn(&SilhouetteCounts) -> u64| counts.iter().map(of).sum::<u64>();
    let share = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
    let mean = masked.iter().map(|counts| iou(counts)).sum::<f64>() / masked.len().max(1) as f64;
    let silhouette_iou = (!masked.is_empty()).then_some(mean);
    let both = masked.iter().map(|counts| counts.both).sum::<u64>();
    let mut found = Agreement {
        views: views.len(),
        silhouette_iou,
        mask_coverage: share(both, masked.iter().map(|counts| counts.masked).sum()),
        front_facing: share(sum(|counts| counts.front), sum(|counts| counts.covered)),
        cause: None,
    };
    if silhouette_iou.is_some_and(|iou| iou < DOUBTFUL) {
        let tried: Vec<(Camera, Vec<bool>)> =
            views.into_iter().filter_map(|view| Some((view.camera, view.mask?))).collect();
        let step = tried.len().div_ceil(TRIED_VIEWS).max(1);
        let tried: Vec<_> = tried.into_iter().step_by(step).collect();
        found.cause = readings::explain(&capture.mesh, &tried);
    }
    found
}

impl Agreement {
    /// Returns `true` if mesh and masks have nothing to do with each other.
    pub fn is_refused(&self) -> bool {
        self.silhouette_iou.is_some_and(|iou| iou < REFUSED)
    }

    fn is_inwards(&self) -> bool {
        self.front_facing.is_some_and(|share| share < INWARDS)
    }

    /// Faults and doubts, one sentence each; none if everything agrees.
    pub fn sentences(&self) -> Vec<String> {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let mut all = Vec::new();
        if let Some(share) = self.front_facing.filter(|share| *share < MIXED) {
            let (back, why) = (
                percent(1.0 - share),
                if self.is_inwards() { "it is wound inwards" } else { "mixed winding, holes, or cameras within it?" },
            );
            all.push(format!("{back} of what the cameras see of the mesh are backs of triangles: {why}"));
        }
        if let Some(iou) = self.silhouette_iou.filter(|iou| *iou < DOUBTFUL) {
            let covered = percent(self.mask_coverage.unwrap_or(0.0));
            let cause = match &self.cause {
                Some(cause) => format!("{} (then they agree to {:.2})", cause.sentence, cause.silhouette_iou),
                None => "is this the capture's mesh, and is it where the cameras see it?".into(),
            };
            all.push(format!(
                "the mesh's silhouette and the masks agree to {iou:.2} (intersection over union), and the mesh covers {covered} of the masks: \
                 {cause}"
            ));
        }
        all
    }
}

/// Turns a mesh that is wound inwards, warns of what is doubtful, and refuses what can't be right.
pub(super) fn settle(path: &Path, capture: &mut Capture) -> Result<()> {
    let found = agreement(capture);
    let mut sentences = found.sentences();
    if found.is_refused() {
        let last = sentences.pop().unwrap_or_default();
        return Err(Error::input(path, format!("{last}; set unchecked to take the capture as it is")));
    }
    if found.is_inwards() {
        capture.mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        sentences[0] += "; its triangles were turned";
    }
    capture.warnings.extend(sentences);
    Ok(())
}

#[cfg(test)]
mod tests;
