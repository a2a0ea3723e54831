//! Agreement of a capture's mesh, cameras, masks and photographs, from small versions of some views.

mod assignment;
mod consistency;
mod contrast;
mod explain;
mod readings;
mod sentences;
mod silhouette;
mod vicinity;

use super::Capture;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::parallel;
use crate::views::{Camera, View};
use contrast::Contrast;
use glam::DVec3;
use serde::Serialize;
pub(super) use silhouette::SmallView;
use silhouette::{SilhouetteCounts, count, iou};
use std::path::Path;

/// Views whose photographs are compared, and the runs of neighbours in the capture's order that they are taken from.
const MAX_VIEWS: usize = 64;
const RUNS: usize = 16;
/// Views whose silhouettes are looked at, evenly spaced.
const MAX_SILHOUETTES: usize = 24;
/// Below this intersection over union mesh and masks have nothing to do with each other.
const REFUSED: f64 = 0.2;
/// Below this one the user is warned.
const DOUBTFUL: f64 = 0.7;
/// Below this one other readings of the capture are tried.
const FAIR: f64 = 0.9;
/// The same of photo-consistency, where there are no masks: tried, and refused if another reading is found.
const PARTLY_CONSISTENT: f64 = 0.55;
const INCONSISTENT: f64 = 0.2;
/// A reading of the capture explains it as well as another order of the photographs, which is chosen among more, if it is so much less consistent.
const AS_CONSISTENT: f64 = 0.1;
/// Share of the views with other photographs than their own that is refused.
const MISPLACED: f64 = 0.25;
/// Share of the seen surface that faces the cameras, below which the mesh is wound inwards, and below which the user is warned.
const INWARDS: f64 = 0.2;
const MIXED: f64 = 0.9;
/// Distance of a camera to the mesh over the mesh's size, below which the user is warned.
const NEAR: f64 = 0.005;
/// Two cameras are in one place where they are so near to each other, as a share of their distance to the mesh.
const SAME_PLACE: f64 = 0.02;

/// Figures of how well mesh, cameras, masks and photographs of a capture agree.
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
    /// Mean correlation, -1 to 1, of the local contrast of neighbouring photographs on the surface that both see; `None` without neighbours.
    pub photo_consistency: Option<f64>,
    /// The same with other photographs in their places: what chance gives.
    pub permuted_consistency: Option<f64>,
    /// Photographs that belong to other cameras than theirs.
    pub misplaced: Option<Misplaced>,
    /// Names of the views whose cameras are inside the mesh. Empty where most are, as in a room.
    pub cameras_inside: Vec<String>,
    /// The smallest distance of a camera to the mesh, over the length of the mesh's diagonal.
    pub nearest_camera: Option<f64>,
    /// Other reading of the capture under which it agrees, and by how much, where it does not as it is.
    pub cause: Option<Cause>,
}

/// A mistake that explains why a capture does not agree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cause {
    /// The fault and its remedy, one sentence.
    pub sentence: String,
    /// Mean intersection over union without the mistake; `None` without masks.
    pub silhouette_iou: Option<f64>,
    /// Photo-consistency without the mistake; `None` without neighbouring views.
    pub photo_consistency: Option<f64>,
}

/// Photographs that agree with their neighbours only in the places of others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Misplaced {
    /// Photographs, and the views in whose places they belong, by name.
    pub photographs: Vec<[String; 2]>,
    /// What their order has in common, if anything.
    pub pattern: Option<&'static str>,
    /// Photo-consistency of the pairs of views that are concerned, as they are given.
    pub given_consistency: f64,
    /// The same with the photographs in their places.
    pub found_consistency: f64,
}

/// Compares the mesh's silhouette with the masks, and photographs with their neighbours, and looks at which side of its triangles the cameras see.
/// Takes time for some dozens of views of 160 pixels a side, however many and large the capture's are.
pub fn agreement(capture: &Capture) -> Agreement {
    let chosen = chosen(capture.frames.len());
    let small = parallel::map(chosen.len(), |k| SmallView::new(&capture.frames[chosen[k]]));
    let all: Vec<&View> = capture.frames.iter().map(|frame| &frame.view).collect();
    of_views(&capture.mesh, &all, &chosen, &small)
}

/// Compares a mesh with those of `all` views that are chosen, and what they show.
pub(super) fn of_views(mesh: &Mesh, all: &[&View], chosen: &[usize], views: &[SmallView]) -> Agreement {
    let name = |view: usize| all[chosen[view]].name.clone();
    let silhouettes: Vec<&SmallView> = views.iter().step_by(views.len().div_ceil(MAX_SILHOUETTES).max(1)).collect();
    let counts =
        parallel::map(silhouettes.len(), |k| count(mesh, &silhouettes[k].camera, silhouettes[k].mask.as_deref()));
    let masked: Vec<&SilhouetteCounts> =
        counts.iter().zip(&silhouettes).filter(|(_, view)| view.mask.is_some()).map(|(c, _)| c).collect();
    let sum = |of: fn(&SilhouetteCounts) -> u64| counts.iter().map(of).sum::<u64>();
    let share = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
    let mean = masked.iter().map(|counts| iou(counts)).sum::<f64>() / masked.len().max(1) as f64;
    let silhouette_iou = (!masked.is_empty()).then_some(mean);
    let both = masked.iter().map(|counts| counts.both).sum::<u64>();

    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let contrasts: Vec<&Contrast> = views.iter().map(|view| &view.contrast).collect();
    let pairs = consistency::compare(mesh, &cameras, &contrasts);
    let mean = |of: fn(&consistency::PairConsistency) -> f64| {
        (!pairs.is_empty()).then(|| pairs.iter().map(of).sum::<f64>() / pairs.len() as f64)
    };
    let same_place = |a: usize, b: usize| is_same_place(&cameras[a], &cameras[b], &mesh.bounding_sphere());
    let misplaced = assignment::reordering(&pairs, views.len(), &same_place).map(|order| Misplaced {
        pattern: order.pattern(views.len()),
        photographs: order.moved.iter().map(|views| views.map(name)).collect(),
        given_consistency: order.given,
        found_consistency: order.found,
    });

    let everywhere: Vec<Camera> = all.iter().map(|view| view.camera).collect();
    let vicinity = vicinity::vicinity(mesh, &everywhere);
    let mut found = Agreement {
        views: views.len(),
        silhouette_iou,
        mask_coverage: share(both, masked.iter().map(|counts| counts.masked).sum()),
        front_facing: share(sum(|counts| counts.front), sum(|counts| counts.covered)),
        photo_consistency: mean(consistency::PairConsistency::given),
        permuted_consistency: mean(consistency::PairConsistency::permuted),
        misplaced,
        cameras_inside: vicinity.inside.iter().map(|&k| all[k].name.clone()).collect(),
        nearest_camera: vicinity.nearest,
        cause: None,
    };
    let consistency = found.photo_consistency.unwrap_or(0.0);
    found.cause = match silhouette_iou {
        Some(iou) if iou < FAIR => explain::by_silhouettes(mesh, &silhouettes, iou >= DOUBTFUL),
        None if consistency < PARTLY_CONSISTENT => explain::by_consistency(mesh, views),
        _ => None,
    };
    found.decide();
    found
}

/// Indices of the frames to look at: all, or runs of neighbours, for photographs are mostly in the order of their taking.
pub(super) fn chosen(frames: usize) -> Vec<usize> {
    if frames <= MAX_VIEWS {
        return (0..frames).collect();
    }
    let length = MAX_VIEWS / RUNS;
    (0..RUNS).flat_map(|run| (0..length).map(move |k| run * frames / RUNS + k)).collect()
}

fn is_same_place(a: &Camera, b: &Camera, (middle, _): &([f64; 3], f64)) -> bool {
    let [a, b, middle] = [a.centre(), b.centre(), *middle].map(DVec3::from_array);
    a.distance(b) <= SAME_PLACE * a.distance(middle)
}

impl Agreement {
    /// Returns `true` if mesh and masks have nothing to do with each other, or a large share of the photographs is not of its cameras.
    pub fn is_refused(&self) -> bool {
        self.silhouette_iou.is_some_and(|iou| iou < REFUSED)
            || self
                .misplaced
                .as_ref()
                .is_some_and(|moved| moved.photographs.len() as f64 > MISPLACED * self.views as f64)
            || (self.silhouette_iou.is_none()
                && self.cause.is_some()
                && self.photo_consistency.is_none_or(|found| found < INCONSISTENT))
    }

    /// Keeps one of two explanations: with wrong poses some other order of the photographs is more consistent, too, and with wrong photographs
    /// some other reading.
    fn decide(&mut self) {
        let Some(misplaced) = &self.misplaced else { return };
        let found = misplaced.found_consistency;
        match self.cause.as_ref().map(|cause| cause.photo_consistency.unwrap_or(1.0)) {
            Some(consistency) if consistency >= found - AS_CONSISTENT => self.misplaced = None,
            Some(_) => self.cause = None,
            None => {}
        }
    }

    fn is_inwards(&self) -> bool {
        self.front_facing.is_some_and(|share| share < INWARDS)
    }
}

/// Turns a mesh that is wound inwards, warns of what is doubtful, and refuses what can't be right.
pub(super) fn settle(path: &Path, found: Agreement, mesh: &mut Mesh, warnings: &mut Vec<String>) -> Result<()> {
    if found.is_refused() {
        let sentences = found.sentences().join("; ");
        return Err(Error::input(path, format!("{sentences}; set unchecked to take the capture as it is")));
    }
    let mut sentences = found.sentences();
    if found.is_inwards() {
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        sentences[0] += "; its triangles were turned";
    }
    warnings.extend(sentences);
    Ok(())
}

#[cfg(test)]
mod tests;
