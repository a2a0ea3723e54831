//! Finding the mistake for which mesh and photographs do not agree, by trying.

use super::Cause;
use super::consistency::mean_given;
use super::contrast::Contrast;
use super::readings::{Change, Reading, focal, focal_factors, readings};
use super::silhouette::{SmallView, count, iou};
use crate::mesh::Mesh;
use crate::parallel;
use crate::views::Camera;

/// Views on which other readings of a capture are tried; neighbours of each other, where their photographs are compared.
const TRIED_VIEWS: usize = 8;
const FIRST_VIEWS: usize = 2;
const TRIED_NEIGHBOURS: usize = 12;
/// A later reading takes the place of an earlier one where it is so much better.
const CLEARER: f64 = 0.02;
/// Another reading is named where it comes to this intersection over union, and is so much better than what is there.
const CONVINCING_IOU: f64 = 0.6;
const BETTER_IOU: f64 = 0.25;
/// The same where mesh and masks agree in part already.
const CONVINCING_OF_FAIR: f64 = 0.93;
const BETTER_OF_FAIR: f64 = 0.06;
/// And the same for photo-consistency.
const CONVINCING_CONSISTENCY: f64 = 0.35;
const BETTER_CONSISTENCY: f64 = 0.12;
/// Bisections of the range in which a focal length is looked for.
const BISECTIONS: usize = 6;

/// The best reading so far.
struct Best {
    score: f64,
    sentence: String,
    camera: Change,
}

/// Tries all readings; returns the best of at least `least`.
fn try_all(score: &dyn Fn(&Change) -> f64, inverted: Option<f64>, least: f64) -> Option<Best> {
    let mut best: Option<Best> = None;
    let needed = |best: &Option<Best>| best.as_ref().map_or(least, |best| best.score + CLEARER);
    let mut take = |score: f64, Reading { sentence, camera }: Reading| {
        if score >= needed(&best) {
            best = Some(Best { score, sentence, camera });
        }
    };
    if let Some(inverted) = inverted {
        let sentence = "the masks are inverted: they show the background; set invert_masks".into();
        take(inverted, Reading { sentence, camera: Box::new(|camera| *camera) });
    }
    let of = |factor: f64| score(&focal(factor).camera);
    let tried = focal_factors().map(|factor| (of(factor), factor));
    let mut peak = tried.into_iter().fold((f64::MIN, 1.0), |best, one| if one.0 > best.0 { one } else { best });
    let mut step: f64 = 1.12;
    for _ in 0..BISECTIONS {
        for factor in [peak.1 * step, peak.1 / step] {
            let there = of(factor);
            if there > peak.0 {
                peak = (there, factor);
            }
        }
        step = step.sqrt();
    }
    for reading in readings() {
        take(score(&reading.camera), reading);
    }
    take(peak.0, focal(peak.1));
    best
}

/// Returns the mistake without which mesh and masks agree best, if they then do. Of fair agreement more is asked.
pub(super) fn by_silhouettes(mesh: &Mesh, views: &[&SmallView], is_fair: bool) -> Option<Cause> {
    let step = views.len().div_ceil(TRIED_VIEWS).max(1);
    let tried: Vec<(&Camera, &[bool])> =
        views.iter().step_by(step).filter_map(|view| Some((&view.camera, view.mask.as_deref()?))).collect();
    let one = |k: usize, camera: &Change, inverted: bool| {
        let (there, mask) = tried[k];
        let mask: Vec<bool> = mask.iter().map(|shown| shown ^ inverted).collect();
        iou(&count(mesh, &camera(there), Some(&mask)))
    };
    let same: Change = Box::new(|camera| *camera);
    let there = parallel::map(tried.len(), |k| one(k, &same, false));
    // What is no better on the first views is not looked at on the others.
    let first = tried.len().min(FIRST_VIEWS);
    let mean = |camera: &Change, inverted: bool| {
        let mut all = parallel::map(first, |k| one(k, camera, inverted));
        if all.iter().sum::<f64>() > there[..first].iter().sum() {
            all.extend(parallel::map(tried.len() - first, |k| one(first + k, camera, inverted)));
        }
        all.iter().sum::<f64>() / all.len().max(1) as f64
    };
    let there = there.iter().sum::<f64>() / there.len().max(1) as f64;
    let least = match is_fair {
        true => CONVINCING_OF_FAIR.max(there + BETTER_OF_FAIR),
        false => CONVINCING_IOU.max(there + BETTER_IOU),
    };
    let best = try_all(&|camera| mean(camera, false), Some(mean(&same, true)), least)?;
    // Masks drawn generously agree better with a larger mesh, but photographs do not.
    let consistency = |camera: &Change| consistency(mesh, views, camera);
    let (given, found) = (consistency(&same), consistency(&best.camera));
    let is_better = given.zip(found).is_none_or(|(given, found)| found > given);
    (!is_fair || is_better).then_some(Cause {
        sentence: best.sentence,
        silhouette_iou: Some(best.score),
        photo_consistency: found,
    })
}

/// Returns the mistake without which neighbouring photographs agree best, if they then do: of captures without masks.
pub(super) fn by_consistency(mesh: &Mesh, views: &[SmallView]) -> Option<Cause> {
    let tried: Vec<&SmallView> = views.iter().take(TRIED_NEIGHBOURS).collect();
    let mean = |camera: &Change| consistency(mesh, &tried, camera).unwrap_or(0.0);
    let same: Change = Box::new(|camera| *camera);
    let given = mean(&same);
    let best = try_all(&mean, None, CONVINCING_CONSISTENCY.max(given + BETTER_CONSISTENCY))?;
    Some(Cause { sentence: best.sentence, silhouette_iou: None, photo_consistency: Some(best.score) })
}

/// Mean photo-consistency of neighbours by another reading.
fn consistency(mesh: &Mesh, views: &[&SmallView], camera: &Change) -> Option<f64> {
    let cameras: Vec<Camera> = views.iter().map(|view| camera(&view.camera)).collect();
    let contrasts: Vec<&Contrast> = views.iter().map(|view| &view.contrast).collect();
    mean_given(mesh, &cameras, &contrasts)
}
