//! Renders one asset, keeping what images share.

use super::file_light::FileLight;
use super::residual::{CapturedRadiance, CapturedSample, CapturedView};
use super::shadow::ShadowMap;
use super::{RenderLighting, RenderOptions, ViewRender};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::image::{Grid, RgbImage};
use crate::mesh::Mesh;
use crate::reflectance::{ReflectionGeometry, maps};
use crate::surface::atlas::{atlas_position, sample_colour, smooth_normal};
use crate::surface::displacement::DisplacedMesh;
use crate::surface::raster::{Raster, rasterise, vertex_normals};
use crate::views::{Camera, Component, PointLight, View};
use glam::DVec3;
use std::sync::OnceLock;

/// Captured views looked at for every surface point beyond those interpolated, where some are hidden.
const SPARE_VIEWS: usize = 5;
/// Smallest cosine to a light under which the residual is shown in full.
const GRAZING: f32 = 0.2;
/// Pixels of the largest image.
const MAX_PIXELS: u64 = 1 << 28;

/// Renders images of one asset. Captured views are prepared when first needed.
pub struct AssetRenderer<'a> {
    asset: &'a Asset,
    normals: Vec<[f64; 3]>,
    middle: [f64; 3],
    /// For each view which of the capture's lights it shows, the most used one first.
    light_number: Vec<usize>,
    captured: Vec<OnceLock<Option<CapturedView<'a>>>>,
    file_light: FileLight,
}

/// A surface point that a pixel sees.
struct SurfacePoint {
    point: [f64; 3],
    normal: [f64; 3],
    /// Atlas position, where there is an atlas.
    at: Option<[f64; 2]>,
}

/// Radiance and coverage of one pixel.
#[derive(Clone, Copy)]
struct RenderedPixel {
    components: [[f32; 3]; 2],
    hit: bool,
    coverage: bool,
}

impl<'a> AssetRenderer<'a> {
    /// Prepares a renderer, checking that the parts of the asset belong together.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if mesh, charts, maps and photographs do not fit each other.
    pub fn new(asset: &'a Asset) -> Result<Self> {
        let vertices = asset.mesh.positions.len();
        if asset.surface.as_ref().is_some_and(|surface| !surface.is_of(&asset.mesh)) {
            return Err(Error::parameter("the surface is not that of the mesh"));
        }
        if asset.mesh.triangles.iter().flatten().any(|&v| v as usize >= vertices) {
            return Err(Error::parameter("the mesh names vertices that it does not have"));
        }
        if let (Some(charts), Some(maps)) = (&asset.charts, &asset.reflectance) {
            let texels = charts.width as usize * charts.height as usize;
            let sizes = [maps.diffuse.data.len(), maps.specular.data.len(), maps.sigma.data.len()];
            let fits = sizes[0] == texels && sizes[1..].iter().all(|&s| s == texels || s == 0);
            let named = charts.chart_of_triangle.iter().all(|&c| (c as usize) < charts.charts.len());
            if texels == 0 || !fits || charts.chart_of_triangle.len() != asset.mesh.triangles.len() || !named {
                return Err(Error::parameter("mesh, charts and reflectance maps do not belong together"));
            }
        }
        if asset.components.is_empty() || asset.components.len() > 2 {
            return Err(Error::parameter("an asset has one or two components"));
        }
        for (view, photograph) in asset.views.iter().zip(&asset.photographs) {
            let Some(photograph) = photograph else { continue };
            let pixels = view.camera.width as usize * view.camera.height as usize;
            let images = &photograph.images;
            if photograph.mask.data.len() != pixels
                || images.len() != asset.components.len()
                || images.iter().any(|i| i.data.len() != pixels)
            {
                return Err(Error::parameter(format!("photograph {} has not its camera's size", view.name)));
            }
        }
        Ok(AssetRenderer {
            asset,
            normals: vertex_normals(&asset.mesh),
            middle: asset.mesh.bounding_sphere().0,
            light_number: number_lights(&asset.views, asset.mesh.bounding_sphere().0),
            captured: asset.views.iter().map(|_| OnceLock::new()).collect(),
            file_light: FileLight::default(),
        })
    }

    /// The number, for [`RenderLighting::Capture`], of the light that a view shows; `None` if the asset's views have no such light.
    pub fn light_number(&self, view: &View) -> Option<usize> {
        (0..self.asset.views.len())
            .find(|&k| same_light(&self.asset.views[k], view, self.middle))
            .map(|k| self.light_number[k])
    }

    /// Renders one image.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for an image without pixels or of more than 2^28, a camera that is not finite, a light that no view
    /// shows; [`Error::Unsupported`] for point lights where those of the capture are unknown.
    pub fn render(&self, camera: &Camera, options: &RenderOptions) -> Result<ViewRender> {
        if camera.width == 0 || camera.height == 0 || camera.width as u64 * camera.height as u64 > MAX_PIXELS {
            return Err(Error::parameter("the image has no pixels or too many"));
        }
        let numbers = camera.focal.iter().chain(&camera.principal).chain(camera.rotation.iter().flatten());
        if !numbers.chain(&camera.translation).all(|x| x.is_finite()) || camera.focal.contains(&0.0) {
            return Err(Error::parameter("the camera has a number that is not finite, or no focal length"));
        }
        let maps = self.asset.reflectance.as_ref();
        let relightable = maps.is_some_and(|m| m.relightable);
        let (lights, light_number) = match &options.lighting {
            RenderLighting::Capture(number) => (None, *number),
            RenderLighting::Points(_) if !relightable => {
                let message = "relighting: the lights of this asset's capture are unknown, so it has no reflectance";
                return Err(Error::Unsupported(message.into()));
            }
            RenderLighting::Points(lights) => (Some(lights), 0),
        };
        let near = self.nearest(camera, light_number, options.views.max(1));
        if near.is_empty() && !self.asset.views.is_empty() && lights.is_none() && light_number > 0 {
            return Err(Error::parameter(format!("no view was captured under light {light_number}")));
        }
        let scene = ViewScene {
            renderer: self,
            options,
            camera,
            raster: self.draw(camera),
            captured: near.iter().filter_map(|&(view, _)| self.captured(view)).collect(),
            capture_light: relightable.then(|| self.capture_light(camera, &near, options.views.max(1))).flatten(),
            lights: lights.map(|lights| {
                let shadow = |l: &PointLight| options.shadows.then(|| ShadowMap::new(self.surface(), l.position));
                lights.iter().map(|l| (*l, shadow(l).flatten())).collect()
            }),
        };
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut pixels = vec![RenderedPixel { components: [[0.0; 3]; 2], hit: false, coverage: false }; width * height];
        crate::parallel::for_each_chunk(&mut pixels, width, |y, row| {
            row.iter_mut().enumerate().for_each(|(x, pixel)| *pixel = scene.pixel(y * width + x));
        });
        let plane = |value: &dyn Fn(&RenderedPixel) -> [f32; 3]| -> RgbImage {
            Grid { width, height, data: pixels.iter().map(value).collect() }
        };
        let mask = |value: fn(&RenderedPixel) -> bool| Grid { width, height, data: pixels.iter().map(value).collect() };
        Ok(ViewRender {
            image: plane(&|p| std::array::from_fn(|c| p.components[0][c].max(0.0) + p.components[1][c].max(0.0))),
            components: (0..self.asset.components.len()).map(|k| plane(&|p| p.components[k])).collect(),
            hit: mask(|p| p.hit),
            coverage: mask(|p| p.coverage),
        })
    }

    /// The finest mesh that the asset has.
    fn surface(&self) -> &'a Mesh {
        self.asset.surface.as_ref().map_or(&self.asset.mesh, DisplacedMesh::mesh)
    }

    /// Draws the surface, and behind it the mesh where only that is met: its triangles are numbered after those of the surface. What
    /// photographs say of silhouettes is in the mesh.
    fn draw(&self, camera: &Camera) -> Raster {
        let mut raster = rasterise(self.surface(), camera);
        if self.asset.surface.is_some() {
            let base = rasterise(&self.asset.mesh, camera);
            let first = self.surface().triangles.len() as u32;
            for k in (0..raster.triangle.len()).filter(|&k| base.is_covered(k)) {
                if !raster.is_covered(k) {
                    raster.triangle[k] = first + base.triangle[k];
                    raster.depth[k] = base.depth[k];
                    raster.barycentric[k] = base.barycentric[k];
                }
            }
        }
        raster
    }

    /// The captured views that look most alike, with the angle at the object's middle; photographs or not.
    fn nearest(&self, camera: &Camera, light_number: usize, views: usize) -> Vec<(usize, f64)> {
        let direction =
            |c: &Camera| (DVec3::from_array(c.centre()) - DVec3::from_array(self.middle)).normalize_or_zero();
        let wanted = direction(camera);
        let mut found: Vec<(usize, f64)> = (0..self.asset.views.len())
            .filter(|&k| self.light_number[k] == light_number && matches!(self.asset.photographs.get(k), Some(Some(_))))
            .map(|k| (k, angle(direction(&self.asset.views[k].camera), wanted)))
            .collect();
        found.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        found.truncate(if views == 1 { 1 } else { views + SPARE_VIEWS });
        found
    }

    /// The capture's light for a camera that was not captured: moves with the camera unless it stood still.
    fn capture_light(&self, camera: &Camera, near: &[(usize, f64)], views: usize) -> Option<PointLight> {
        let all: Vec<(usize, f64)>;
        let near = if near.is_empty() {
            // Without any photograph the nearest view's light still serves.
            let turned = |k: usize| {
                let row = |c: &Camera| DVec3::from_array(c.rotation[2]);
                angle(row(&self.asset.views[k].camera), row(camera))
            };
            let least = (0..self.asset.views.len()).min_by(|&a, &b| turned(a).total_cmp(&turned(b)))?;
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
            let view = &self.asset.views[view];
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

    fn captured(&self, view: usize) -> Option<&CapturedView<'a>> {
        self.captured[view].get_or_init(|| self.prepare(view)).as_ref()
    }

    /// Photograph and model of a captured view.
    fn prepare(&self, view: usize) -> Option<CapturedView<'a>> {
        let photograph = self.asset.photographs.get(view)?.as_ref()?;
        let (camera, light) = (self.asset.views[view].camera, self.asset.views[view].light);
        let raster = self.draw(&camera);
        let centre = camera.centre();
        let mut models = vec![Grid::filled(raster.width, raster.height, [0f32; 3]); photograph.images.len()];
        for index in (0..raster.triangle.len()).filter(|&k| raster.is_covered(k) && photograph.mask.data[k]) {
            let surface = self.surface_point(&camera, &raster, index);
            let geometry = light.map(|light| ReflectionGeometry::new(surface.point, surface.normal, centre, &light));
            for (k, &component) in self.asset.components.iter().enumerate() {
                models[k].data[index] = self.model(component, &surface, geometry.as_ref());
            }
        }
        Some(CapturedView::new(camera, raster, photograph, models))
    }

    fn surface_point(&self, camera: &Camera, raster: &Raster, index: usize) -> SurfacePoint {
        let pixel = [(index % raster.width) as f64 + 0.5, (index / raster.width) as f64 + 0.5];
        let (centre, ray, depth) = (camera.centre(), camera.ray(pixel), raster.depth[index]);
        let point: [f64; 3] = std::array::from_fn(|k| centre[k] + ray[k] * depth);
        let triangle = raster.triangle[index] as usize;
        let [b, c] = raster.barycentric[index].map(f64::from);
        let weights = [1.0 - b - c, b, c];
        // The surface's triangle where there is one, and the mesh's.
        let fine = self.asset.surface.as_ref().filter(|surface| triangle < surface.mesh().triangles.len());
        let (base, base_weights) = match (fine, &self.asset.surface) {
            (Some(surface), _) => surface.coarser(triangle, weights),
            (None, Some(surface)) => (triangle - surface.mesh().triangles.len(), weights),
            (None, None) => (triangle, weights),
        };
        let normal = match fine {
            Some(surface) => smooth_normal(surface.mesh().triangles[triangle], weights, surface.normals()),
            None => smooth_normal(self.asset.mesh.triangles[base], weights, &self.normals),
        };
        let charts = self.asset.charts.as_ref().filter(|_| self.asset.reflectance.is_some());
        // The atlas lies on the mesh, not on its finer surface.
        let corners = self.asset.mesh.triangles[base];
        let corner = |k: usize| DVec3::from_array(self.asset.mesh.positions[corners[k] as usize].map(f64::from));
        let on_mesh = match fine {
            Some(_) => (0..3).map(|k| base_weights[k] * corner(k)).sum(),
            None => DVec3::from_array(point),
        };
        let at = charts.map(|charts| atlas_position(charts, base, on_mesh));
        SurfacePoint { point, normal: normal.to_array(), at }
    }

    fn model(&self, component: Component, surface: &SurfacePoint, geometry: Option<&ReflectionGeometry>) -> [f32; 3] {
        match (&self.asset.reflectance, surface.at) {
            // Radiance maps are of the diffuse or of the combined component.
            (Some(maps), Some(at)) if maps.relightable && geometry.is_none() && component != Component::Specular => {
                // Of views under an environment: what stands where no photograph shows a point.
                let irradiance = self.file_light.irradiance(self.asset.light.as_ref(), surface.normal);
                let diffuse = sample_colour(&maps.diffuse, at);
                std::array::from_fn(|c| (diffuse[c] * irradiance[c]) as f32)
            }
            (Some(maps), Some(at)) => maps::evaluate(maps, component, at, geometry),
            _ => [0.0; 3],
        }
    }
}

/// One image in the making.
struct ViewScene<'r, 'a> {
    renderer: &'r AssetRenderer<'a>,
    options: &'r RenderOptions,
    camera: &'r Camera,
    raster: Raster,
    captured: Vec<&'r CapturedView<'a>>,
    capture_light: Option<PointLight>,
    lights: Option<Vec<(PointLight, Option<ShadowMap>)>>,
}

impl ViewScene<'_, '_> {
    fn pixel(&self, index: usize) -> RenderedPixel {
        let mut pixel = RenderedPixel { components: [[0.0; 3]; 2], hit: false, coverage: false };
        if !self.raster.is_covered(index) {
            return pixel;
        }
        let surface = self.renderer.surface_point(self.camera, &self.raster, index);
        let centre = self.camera.centre();
        let (seen, coverage) = self.sight(&surface, centre);
        pixel.hit = true;
        pixel.coverage = coverage;
        let geometry = |light: &PointLight| ReflectionGeometry::new(surface.point, surface.normal, centre, light);
        let capture = self.capture_light.as_ref().map(geometry);
        let layers = self.options.layers;
        for (k, &component) in self.renderer.asset.components.iter().enumerate() {
            let (part, whole) = match component {
                Component::Combined if layers.diffuse != layers.specular => {
                    (if layers.diffuse { Component::Diffuse } else { Component::Specular }, false)
                }
                Component::Diffuse => (component, layers.diffuse),
                Component::Specular => (component, layers.specular),
                Component::Combined => (component, layers.diffuse),
            };
            if part == component && !whole {
                continue;
            }
            let model = |geometry: Option<&ReflectionGeometry>| self.renderer.model(part, &surface, geometry);
            let bound = match (&self.lights, component) {
                (Some(_), _) => ResidualBound::All,
                (None, Component::Specular) => ResidualBound::Negative,
                (None, _) => ResidualBound::Free,
            };
            let shown = |model: [f32; 3], irradiance: [f32; 3], fade: f32| -> [f32; 3] {
                let residual =
                    if layers.residual && whole { residual(&seen, k, model, irradiance, bound) } else { [0.0; 3] };
                std::array::from_fn(|c| fade * (residual[c] + if layers.model { model[c] } else { 0.0 }))
            };
            match &self.lights {
                None => pixel.components[k] = shown(model(capture.as_ref()), [1.0; 3], 1.0),
                Some(lights) => {
                    for (light, shadow) in lights {
                        let lit = geometry(light);
                        if lit.cos_light <= 0.0 {
                            continue;
                        }
                        let reach = |map: &ShadowMap| map.visibility(surface.point, lit.cos_light as f64) as f32;
                        let reach = shadow.as_ref().map_or(1.0, reach);
                        // L_j / L of equation 15, both as irradiance; fades where the light grazes.
                        let fade = (lit.cos_light / GRAZING).min(1.0);
                        let ratio = |c: usize| match &capture {
                            Some(g) if g.irradiance[c] > 0.0 => fade * lit.irradiance[c] / g.irradiance[c],
                            _ => 0.0,
                        };
                        let sum = shown(model(Some(&lit)), std::array::from_fn(ratio), reach);
                        (0..3).for_each(|c| pixel.components[k][c] += sum[c]);
                    }
                }
            }
        }
        pixel
    }

    /// Returns what the captured views that see a surface point show there, with weights that sum to 1 (none if none sees it), and whether
    /// their masks let the point stand.
    fn sight(&self, surface: &SurfacePoint, centre: [f64; 3]) -> (Vec<([CapturedRadiance; 2], f32)>, bool) {
        let point = DVec3::from_array(surface.point);
        let towards = |centre: [f64; 3]| (DVec3::from_array(centre) - point).normalize_or_zero();
        let wanted = towards(centre);
        let mut order: Vec<(f64, &CapturedView)> =
            self.captured.iter().map(|c| (angle(towards(c.camera.centre()), wanted), *c)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut seen, mut angles, mut cut) = (Vec::new(), Vec::new(), false);
        for (angle, captured) in order {
            if seen.len() > self.options.views {
                break;
            }
            match captured.sample_at(surface.point) {
                CapturedSample::Seen(shown, confidence) => {
                    seen.push((shown, confidence));
                    angles.push(angle);
                }
                CapturedSample::Cut => cut |= seen.is_empty(),
                CapturedSample::Unseen => {}
            }
        }
        let weights = weights(angles.into_iter(), self.options.views);
        seen.iter_mut().zip(weights).for_each(|(s, weight)| s.1 *= weight as f32);
        let total: f32 = seen.iter().map(|s| s.1).sum();
        seen.iter_mut().for_each(|s| s.1 /= total);
        (seen, !cut)
    }
}

/// Which residuals may not exceed their share of the captured model.
#[derive(Clone, Copy, PartialEq)]
enum ResidualBound {
    /// None.
    Free,
    /// Those that take away: a highlight which the capture didn't have leaves no black hole where the model has none.
    Negative,
    /// All: under other lights what the capture had beyond the model lies elsewhere, or is not lit.
    All,
}

/// The residual of a component where its model is `model`, interpolated: of every view the radiance that its residual leads to, the mean of
/// these in the (signed) square-root signal, minus the model. A residual is scaled by `irradiance`; a bounded one by the lesser of that
/// and the model's ratio to the model in the view.
fn residual(
    seen: &[([CapturedRadiance; 2], f32)],
    component: usize,
    model: [f32; 3],
    irradiance: [f32; 3],
    bound: ResidualBound,
) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for (shown, weight) in seen {
        let CapturedRadiance { photograph, model: captured } = &shown[component];
        for c in 0..3 {
            let residual = photograph[c] - captured[c];
            let bounded = bound == ResidualBound::All || (bound == ResidualBound::Negative && residual < 0.0);
            let scale =
                if bounded && captured[c] > 0.0 { irradiance[c].min(model[c] / captured[c]) } else { irradiance[c] };
            // The first is exact where model and captured model agree.
            let radiance =
                if scale == 1.0 { photograph[c] + (model[c] - captured[c]) } else { model[c] + scale * residual };
            sum[c] += weight * radiance.abs().sqrt().copysign(radiance);
        }
    }
    if seen.is_empty() {
        return [0.0; 3];
    }
    std::array::from_fn(|c| sum[c] * sum[c].abs() - model[c])
}
/// Weights of views from their angles, in ascending order: the first `views` count, each by how much nearer it is than the next one after
/// them (Buehler et al. 2001, "Unstructured Lumigraph Rendering", equation 5). They sum to 1.
fn weights(angles: impl Iterator<Item = f64>, views: usize) -> Vec<f64> {
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

fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}
