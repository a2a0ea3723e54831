//! The lights of a capture: which views show the same one, which of these look most alike, and where it is between them.

use crate::asset::Asset;
use crate::views::{Camera, PointLight, View};
use glam::DVec3;

/// Captured views looked at for every surface point beyond those interpolated, where some are hidden.
const SPARE_VIEWS: usize = 5;

/// The lights under which the views of an asset were captured, standing still or moving with the camera.
pub(super) struct CaptureLights {
    /// Middle of the object.
    pub(super) middle: [f64; 3],
    /// For each view which of the lights it shows; 0 is the most used one.
    number: Vec<usize>,
}

impl CaptureLights {
    pub(super) fn new(asset: &Asset) -> Self {
        let middle = asset.mesh.bounding_sphere().0;
        CaptureLights { middle, number: number_lights(&asset.views, middle) }
    }

    /// The number of the light that a view shows; `None` if the asset's views have no such light.
    pub(super) fn number_of(&self, asset: &Asset, view: &View) -> Option<usize> {
        (0..asset.views.len()).find(|&k| same_light(&asset.views[k], view, self.middle)).map(|k| self.number[k])
    }

    /// The captured views that look most alike, with the angle at the object's middle; photographs or not.
    pub(super) fn nearest(
        &self,
        asset: &Asset,
        camera: &Camera,
        light_number: usize,
        views: usize,
    ) -> Vec<(usize, f64)> {
        let direction =
            |c: &Camera| (DVec3::from_array(c.centre()) - DVec3::from_array(self.middle)).normalize_or_zero();
        let wanted = direction(camera);
        let mut found: Vec<(usize, f64)> = (0..asset.views.len())
            .filter(|&k| self.number[k] == light_number && matches!(asset.photographs.get(k), Some(Some(_))))
            .map(|k| (k, angle(direction(&asset.views[k].camera), wanted)))
            .collect();
        found.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        found.truncate(if views == 1 { 1 } else { views + SPARE_VIEWS });
        found
    }

    /// The capture's light for a camera that was not captured: moves with the camera unless it stood still.
    pub(super) fn between(
        &self,
        asset: &Asset,
        camera: &Camera,
        near: &[(usize, f64)],
        views: usize,
    ) -> Option<PointLight> {
        let all: Vec<(usize, f64)>;
        let near = if near.is_empty() {
            // Without any photograph the nearest view's light still serves.
            let turned = |k: usize| {
                let row = |c: &Camera| DVec3::from_array(c.rotation[2]);
                angle(row(&asset.views[k].camera), row(camera))
            };
            let least = (0..asset.views.len()).min_by(|&a, &b| turned(a).total_cmp(&turned(b)))?;
            all = vec![(least, 0.0)];
            &all
        } else {
            near
        };
        let weights = weights(near.iter().map(|n| n.1), views);
        let (mut world, mut relative, mut intensity) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        let mut spread = 0f64;
        let mut sum = 0.0;
        let mut first = None;
        for (&(view, _), weight) in near.iter().zip(weights) {
            let view = &asset.views[view];
            let Some(light) = view.light.filter(|_| weight > 0.0) else { continue };
            let position = DVec3::from_array(light.position);
            spread = spread.max((position - *first.get_or_insert(position)).length());
            world += weight * position;
            relative += weight * DVec3::from_array(view.camera.to_camera(light.position));
            intensity += weight * DVec3::from_array(light.intensity);
            sum += weight;
        }
        if sum <= 0.0 {
            return None;
        }
        let still = spread < 1e-6 * (1.0 + (world / sum).length());
        let r = camera.rotation.map(DVec3::from_array);
        let turned = relative / sum - DVec3::from_array(camera.translation);
        let moved = r[0] * turned.x + r[1] * turned.y + r[2] * turned.z;
        let position = if still { world / sum } else { moved };
        Some(PointLight { position: position.to_array(), intensity: (intensity / sum).to_array() })
    }
}

/// Weights of views from their angles, in ascending order: the first `views` count, each by how much nearer it is than the next one after
/// them (Buehler et al. 2001, "Unstructured Lumigraph Rendering", equation 5). They sum to 1.
pub(super) fn weights(angles: impl Iterator<Item = f64>, views: usize) -> Vec<f64> {
    let angles: Vec<f64> = angles.collect();
    // At a captured camera that view alone.
    let exact = |k: usize| if k == 0 { 1.0 } else { 0.0 };
    if angles.first().is_some_and(|&a| a < 1e-9) {
        return (0..angles.len()).map(exact).collect();
    }
    let last = match angles.get(views) {
        Some(&next) => next,
        None => angles.last().copied().unwrap_or(0.0) * 1.5,
    }
    .max(1e-9);
    let mut weights: Vec<f64> = angles.iter().take(views).map(|&a| (1.0 - a / last).max(1e-9) / a).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights.resize(angles.len(), 0.0);
    weights
}

/// Numbers the lights under which views were captured: 0 is the one of most views.
fn number_lights(views: &[View], middle: [f64; 3]) -> Vec<usize> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for k in 0..views.len() {
        match groups.iter_mut().find(|group| same_light(&views[group[0]], &views[k], middle)) {
            Some(group) => group.push(k),
            None => groups.push(vec![k]),
        }
    }
    groups.sort_by_key(|group| (std::cmp::Reverse(group.len()), group[0]));
    let mut numbers = vec![0; views.len()];
    for (number, group) in groups.iter().enumerate() {
        group.iter().for_each(|&k| numbers[k] = number);
    }
    numbers
}

/// Whether two views have the same light: one that stands still, or moves with the camera; both unknown counts.
fn same_light(a: &View, b: &View, middle: [f64; 3]) -> bool {
    let (one, two) = match (a.light, b.light) {
        (None, None) => return true,
        (Some(one), Some(two)) => (one, two),
        _ => return false,
    };
    let gap = |p: [f64; 3], q: [f64; 3]| (DVec3::from_array(p) - DVec3::from_array(q)).length();
    let distance = gap(a.camera.centre(), middle);
    gap(one.position, two.position) < 1e-3 * distance
        || gap(a.camera.to_camera(one.position), b.camera.to_camera(two.position)) < 0.05 * distance
}

/// Angle between two directions, exact near 0.
pub(super) fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}
