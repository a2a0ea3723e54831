//! What is said of a capture that does not agree.

use super::{Agreement, DOUBTFUL, MIXED, Misplaced, NEAR};
use crate::input::escaped;

/// Names in a sentence, at most.
const MAX_NAMED: usize = 4;

impl Agreement {
    /// Faults and doubts, one sentence each; none if everything agrees.
    pub fn sentences(&self) -> Vec<String> {
        let mut all = Vec::new();
        if let Some(share) = self.front_facing.filter(|share| *share < MIXED) {
            let back = percent(1.0 - share);
            let why = match self.is_inwards() {
                true => "it is wound inwards",
                false => "mixed winding, holes, or cameras within it?",
            };
            all.push(format!("{back} of what the cameras see of the mesh are backs of triangles: {why}"));
        }
        let inside = self.cameras_inside.len();
        if inside > 0 {
            let cameras = if inside == 1 { "camera is" } else { "cameras are" };
            let names = listed(inside, self.cameras_inside.iter().map(|name| escaped(name).to_string()));
            all.push(format!("{inside} {cameras} inside the mesh ({names}): is the pose right, and the mesh's scale?"));
        } else if let Some(distance) = self.nearest_camera.filter(|distance| *distance < NEAR) {
            all.push(format!(
                "a camera is only {distance:.1e} of the mesh's size away from it: is the pose right, and the mesh's scale?"
            ));
        }
        all.extend(self.misplaced.as_ref().map(|misplaced| misplaced.sentence(self.views)));
        all.extend(self.cause_sentence());
        all
    }

    fn cause_sentence(&self) -> Option<String> {
        let then = |cause: &super::Cause| {
            let figure = cause.silhouette_iou.or(cause.photo_consistency).unwrap_or(0.0);
            format!("{} (then they agree to {figure:.2})", cause.sentence)
        };
        let Some(iou) = self.silhouette_iou else {
            let (cause, consistency) = (self.cause.as_ref()?, self.photo_consistency.unwrap_or(0.0));
            return Some(format!(
                "neighbouring photographs agree to {consistency:.2} on the mesh (correlation): {}",
                then(cause)
            ));
        };
        if iou >= DOUBTFUL && self.cause.is_none() {
            return None;
        }
        let covered = percent(self.mask_coverage.unwrap_or(0.0));
        let cause = match (&self.cause, &self.misplaced) {
            (Some(cause), _) => then(cause),
            (None, Some(_)) => "the masks belong to other cameras, too".into(),
            (None, None) => "is this the capture's mesh, and is it where the cameras see it?".into(),
        };
        Some(format!(
            "the mesh's silhouette and the masks agree to {iou:.2} (intersection over union), and the mesh covers {covered} of the masks: {cause}"
        ))
    }
}

impl Misplaced {
    fn sentence(&self, views: usize) -> String {
        let moved = self.photographs.len();
        let names = self
            .photographs
            .iter()
            .map(|[photograph, view]| format!("{} in the place of {}", escaped(photograph), escaped(view)));
        let pattern = self.pattern.map_or(String::new(), |pattern| format!(", {pattern}"));
        format!(
            "{moved} of {views} photographs are not those of their cameras{pattern}: they agree with their neighbours to {:.2} on the mesh \
             (correlation), in the places of others to {:.2} ({}); check the names and the order of photographs and poses",
            self.given_consistency,
            self.found_consistency,
            listed(moved, names)
        )
    }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// The first of some names, and whether there are more.
fn listed(count: usize, names: impl Iterator<Item = String>) -> String {
    let named = names.take(MAX_NAMED).collect::<Vec<_>>().join(", ");
    if count > MAX_NAMED { format!("{named}, ...") } else { named }
}
