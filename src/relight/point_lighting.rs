//! Lights given by their places: the model, and what photographs captured under lights and from cameras like these have beyond it.
//!
//! Equations 13 to 16 of Miyazaki 2007, with each captured photograph as a sample of light and view together.

use super::RenderOptions;
use super::object_light::ObjectLight;
use super::prepared_asset::{PreparedAsset, SurfacePoint};
use super::residual::{CapturedReading, CapturedSample, CapturedView, nearest_first};
use super::shadow::ShadowMap;
use crate::reflectance::ReflectionGeometry;
use crate::views::{Camera, Component, PointLight};
use glam::DVec3;

/// Photographs that a light takes its residual from, for each part of reflection, at most.
const PHOTOGRAPHS: usize = 24;
/// Smallest cosine to a light that lights a point in full.
const GRAZING: f64 = 0.2;
/// Smallest cosine to its camera at which a photograph counts in full.
const EDGE: f64 = 0.35;
/// Lit shares below this are alike: light from other parts of the object reaches what its lamp does not.
const DARK: f32 = 0.05;
/// A photograph of the same light and camera as asked for, by their distance.
const SAME: f64 = 1e-9;
/// Distance within which a photograph tells what shines where no light falls.
const NEARLY_SAME: f64 = 0.2;

/// How far the residual of a part of reflection reaches over light and view.
struct Reach {
    /// Distance beyond which a photograph says nothing.
    farthest: f64,
    /// Distance of a photograph that counts as much as the model alone.
    model: f64,
    /// Weight of what a part depends less on: the camera, and of highlights the light beside the half vector.
    beside: f64,
    /// Radiance over irradiance below which a residual is a difference to the model, above it a share of it.
    floor: f32,
}

/// Diffuse reflection is even over the light: a photograph under any light shows texture that the maps have not.
const DIFFUSE: Reach = Reach { farthest: 2.0, model: 4.0, beside: 1.0, floor: 0.02 };
/// Highlights, and images that hold both reflections, belong to the half vector.
const SPECULAR: Reach = Reach { farthest: 1.0, model: 0.4, beside: 0.1, floor: 0.005 };

fn reach_of(part: Component) -> &'static Reach {
    if part == Component::Diffuse { &DIFFUSE } else { &SPECULAR }
}

impl Reach {
    /// Weight of what lies at a distance, beside others: endless at 0, none from `farthest` on.
    fn weight(&self, distance: f64, farthest: f64) -> f64 {
        let near = (1.0 / distance - 1.0 / farthest).max(0.0);
        near * near
    }
}

/// Unit vectors from a surface point to light and camera, and half-way between.
#[derive(Clone, Copy)]
struct Directions {
    light: DVec3,
    view: DVec3,
    half: DVec3,
}

impl Directions {
    fn new(point: DVec3, light: [f64; 3], camera: [f64; 3]) -> Self {
        let towards = |target: [f64; 3]| (DVec3::from_array(target) - point).normalize_or_zero();
        let (light, view) = (towards(light), towards(camera));
        Directions { light, view, half: (light + view).normalize_or_zero() }
    }

    /// How unlike these are for a part of reflection; 0 for the same light and camera only.
    fn distance(&self, other: &Directions, part: Component) -> f64 {
        let (light, view) = ((self.light - other.light).length_squared(), (self.view - other.view).length_squared());
        let beside = reach_of(part).beside * reach_of(part).beside;
        match part {
            Component::Diffuse => (light + beside * view).sqrt(),
            _ => ((self.half - other.half).length_squared() + beside * (light + view)).sqrt(),
        }
    }
}

/// A captured view under its light.
struct LitView<'r, 'a> {
    captured: &'r CapturedView<'a>,
    light: PointLight,
}

/// A light that is asked for.
struct AskedLight {
    light: PointLight,
    shadow: Option<ShadowMap>,
    /// What it makes the object send to itself, where that is shown.
    from_object: Option<ObjectLight>,
    /// For each component the views, by their place among all, that it takes its residual from, and the distance at which that ends.
    near: Vec<(Vec<usize>, f64)>,
}

/// Point lights, and the captured views whose residuals they take.
pub(super) struct PointLighting<'r, 'a> {
    lights: Vec<AskedLight>,
    views: Vec<LitView<'r, 'a>>,
    /// Views whose masks say where the object is.
    outlines: Vec<&'r CapturedView<'a>>,
}

/// What a captured view shows at a surface point, with its light there.
struct LitReading {
    reading: CapturedReading,
    directions: Directions,
    irradiance: [f32; 3],
    /// Share of its light that falls on the point, as [`lit_share`].
    lit: f32,
}

/// Share of a light that falls on a surface: what reaches it, less where it grazes, nothing from behind.
fn lit_share(surface: &SurfacePoint, directions: &Directions, reach: f32) -> f32 {
    reach * (directions.light.dot(DVec3::from_array(surface.normal)) / GRAZING).clamp(0.0, 1.0) as f32
}

/// One component at a surface point: which part of reflection is shown, and whether that is all the component has.
pub(super) type ShownPart = Option<(Component, bool)>;

impl<'r, 'a> PointLighting<'r, 'a> {
    pub(super) fn new(
        renderer: &'r PreparedAsset<'a>,
        camera: &Camera,
        lights: &[PointLight],
        options: &RenderOptions,
    ) -> Self {
        let asset = renderer.asset;
        let photographed = |&k: &usize| matches!(asset.photographs.get(k), Some(Some(_)));
        let lit = |k: usize| asset.views[k].light.map(|light| (k, light));
        let candidates: Vec<(usize, PointLight)> = match options.layers.residual {
            true => (0..asset.views.len()).filter(photographed).filter_map(lit).collect(),
            false => Vec::new(),
        };
        let most = if options.views == 1 { 1 } else { PHOTOGRAPHS };
        // Which views are near is told by the object's middle.
        let middle = DVec3::from_array(renderer.middle());
        let captured: Vec<Directions> = candidates
            .iter()
            .map(|&(k, light)| Directions::new(middle, light.position, asset.views[k].camera.centre()))
            .collect();
        // It falls into shadows, so that it is not shown without them.
        let shows_own = options.shadows && options.layers.interreflection;
        let mut lights: Vec<AskedLight> = lights
            .iter()
            .map(|light| {
                let asked = Directions::new(middle, light.position, camera.centre());
                let near = |&part: &Component| {
                    let mut order: Vec<(f64, usize)> =
                        captured.iter().enumerate().map(|(k, own)| (asked.distance(own, part), k)).collect();
                    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                    let farthest = order.get(most).map_or(f64::INFINITY, |next| next.0);
                    order.truncate(most);
                    (order.into_iter().map(|(_, k)| k).collect(), farthest.clamp(2.0 * SAME, reach_of(part).farthest))
                };
                let shadow = || ShadowMap::new(renderer.surface(), light.position);
                let shadow = options.shadows.then(shadow).flatten();
                let from_object = || ObjectLight::under(renderer, light, shadow.as_ref());
                AskedLight {
                    light: *light,
                    from_object: shows_own.then(from_object).flatten(),
                    shadow,
                    near: asset.components.iter().map(near).collect(),
                }
            })
            .collect();
        // Only those that some light takes are prepared.
        let mut place = vec![None; candidates.len()];
        let mut views = Vec::new();
        for near in lights.iter_mut().flat_map(|light| &mut light.near) {
            near.0.retain_mut(|k| {
                let (view, light) = candidates[*k];
                let found = *place[*k].get_or_insert_with(|| {
                    let captured = renderer.captured_with_shadows(view)?;
                    views.push(LitView { captured, light });
                    Some(views.len() - 1)
                });
                *k = found.unwrap_or(0);
                found.is_some()
            });
        }
        PointLighting { lights, views, outlines: renderer.outlines(camera, options.views.max(1)) }
    }

    /// Whether the nearest captured mask that tells lets a surface point stand.
    pub(super) fn covers(&self, camera: &Camera, surface: &SurfacePoint) -> bool {
        for (_, captured) in nearest_first(&self.outlines, surface.point, camera.centre()) {
            match captured.sample_at(surface.point) {
                CapturedSample::Seen(_) => return true,
                CapturedSample::Cut => return false,
                CapturedSample::Unseen => {}
            }
        }
        true
    }

    /// Returns the radiance of each component at a surface point, parallel to `parts`.
    pub(super) fn radiance(
        &self,
        renderer: &PreparedAsset,
        camera: &Camera,
        surface: &SurfacePoint,
        options: &RenderOptions,
        parts: &[ShownPart],
    ) -> [[f32; 3]; 2] {
        let point = DVec3::from_array(surface.point);
        let readings: Vec<Option<LitReading>> = self.views.iter().map(|view| view.read(surface)).collect();
        let mut sum = [[0f32; 3]; 2];
        for AskedLight { light, shadow, from_object, near } in &self.lights {
            let geometry = ReflectionGeometry::new(surface.point, surface.normal, camera.centre(), light);
            let visibility = |map: &ShadowMap| map.visibility(surface.point, geometry.cos_light as f64) as f32;
            let directions = Directions::new(point, light.position, camera.centre());
            let reach = shadow.as_ref().map_or(1.0, visibility);
            let lit = lit_share(surface, &directions, reach);
            let asked = LitPoint { directions, irradiance: geometry.irradiance, lit };
            let from_object =
                from_object.as_ref().map(|own| own.reflected(renderer, camera, surface, lit)).unwrap_or_default();
            for (component, part) in parts.iter().enumerate() {
                let Some((part, is_whole)) = *part else { continue };
                let model = renderer.model(part, surface, Some(&geometry)).map(|x| x * reach);
                let (views, farthest) = &near[component];
                let near = views.iter().filter(|_| is_whole).filter_map(|&view| readings[view].as_ref());
                let shown = asked.radiance([model, from_object.of(part)], near, component, part, *farthest);
                for c in 0..3 {
                    sum[component][c] += if options.layers.model { shown[c] } else { shown[c] - model[c] };
                }
            }
        }
        sum
    }
}

impl LitView<'_, '_> {
    fn read(&self, surface: &SurfacePoint) -> Option<LitReading> {
        let CapturedSample::Seen(mut reading) = self.captured.sample_at(surface.point) else { return None };
        let point = DVec3::from_array(surface.point);
        let directions = Directions::new(point, self.light.position, self.captured.camera.centre());
        // At the edge of what a camera sees photographs and model differ most, and darkness there is no shadow.
        let facing = (directions.view.dot(DVec3::from_array(surface.normal)) / EDGE).clamp(0.1, 1.0) as f32;
        reading.confidence *= facing * facing;
        let squared = (DVec3::from_array(self.light.position) - point).length_squared();
        Some(LitReading {
            reading,
            directions,
            lit: lit_share(surface, &directions, reading.reach),
            irradiance: self.light.intensity.map(|l| if squared > 0.0 { (l / squared) as f32 } else { 0.0 }),
        })
    }
}

/// A surface point under a light that is asked for.
struct LitPoint {
    directions: Directions,
    irradiance: [f32; 3],
    /// Share of the light that falls on it, as [`lit_share`].
    lit: f32,
}

impl LitPoint {
    /// Radiance of a component whose model is `model`: what photographs near in light and view lead to, and the model, averaged in the
    /// (signed) square-root signal, and what it reflects of light `from_object`. A photograph of this light and camera stands alone.
    fn radiance<'p>(
        &self,
        [model, from_object]: [[f32; 3]; 2],
        near: impl Iterator<Item = &'p LitReading>,
        component: usize,
        part: Component,
        farthest: f64,
    ) -> [f32; 3] {
        let reach = reach_of(part);
        let own = 1.0 / reach.model;
        let mut total = own * own;
        let mut sum = model.map(|x| total * (x.max(0.0) as f64).sqrt());
        let mut nearest = 0f32;
        for captured in near {
            let distance = self.directions.distance(&captured.directions, part);
            let nearness = 1.0 - (distance / NEARLY_SAME).min(1.0) as f32;
            nearest = nearest.max(nearness);
            let floor = [(0.5 * self.lit / DARK).min(1.0).max(nearness) * reach.floor, reach.floor];
            let led_to = |c: usize| self.led_to(captured, component, c, model[c], floor);
            if distance < SAME {
                return std::array::from_fn(led_to);
            }
            // What is in shadow here and was lit there tells little, and the other way round.
            let alike = 1.0 - (self.lit - captured.lit).abs() as f64;
            let weight = reach.weight(distance, farthest) * alike * alike * captured.reading.confidence as f64;
            for c in 0..3 {
                let radiance = led_to(c) as f64;
                sum[c] += weight * radiance.abs().sqrt().copysign(radiance);
            }
            total += weight;
        }
        // Photographs under such a light show what the object sends to itself.
        let unshown = 1.0 - nearest;
        std::array::from_fn(|c| (sum[c] / total * (sum[c] / total).abs()) as f32 + unshown * from_object[c])
    }

    /// The radiance that a photograph leads to under this light: it has to the model here the ratio, both over the floor, that it has to
    /// the model there. It is the photograph's, in proportion to the irradiance, where the models agree. What is darker here than there
    /// takes less of it, and what lies in the dark nothing from afar: edges of shadows would be drawn there.
    fn led_to(&self, captured: &LitReading, component: usize, c: usize, model: f32, floor: [f32; 2]) -> f32 {
        let shown = &captured.reading.components[component];
        let [here, there] = [floor[0] * self.irradiance[c], floor[1] * captured.irradiance[c]];
        let expected = shown.model[c] * captured.reading.reach + there;
        let radiance = (model + here) * ((shown.photograph[c] + there) / expected) - here;
        let share = ((self.lit + DARK) / (captured.lit + DARK)).min(1.0);
        let radiance = if share < 1.0 { model + share * (radiance - model) } else { radiance };
        if expected > 0.0 && radiance.is_finite() { radiance } else { model }
    }
}
