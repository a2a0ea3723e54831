//! Images of a moving camera, many a second: the sums of either evaluator with all camera-independent data precomputed.
//!
//! What differs from [`EnvironmentScene::render`]: reflection functions are read from tables (`brdf_table`); specular light of the
//! prefiltered maps is summed at one of four pixels and interpolated between like normals; the diffuse light of spherical Gaussians is summed
//! at the samples of the surface and interpolated between them; samples of a pixel are shaded together where they show one piece of surface.

use super::antialiasing::supersampled;
use super::appearance::{ShadingModel, ShadingParameters};
use super::environment::EnvironmentScene;
use super::evaluator::ShadowedLight;
use super::filtered::evaluate_brdf;
use super::multisample::VisibilityBuffer;
use super::scene::ShadingPoint;
use crate::error::Result;
use crate::image::{Grid, RgbImage};
use crate::parallel::{for_each_chunk, for_each_chunk_pair};
use crate::surface::raster::check_work;
use crate::views::Camera;
use glam::Vec3;

/// Radiance below which a distant light's reflection is left out; 1 is white.
const FAINT: f32 = 1e-4;
/// Rows that are worked on at a time.
const ROWS: usize = 8;
/// Pieces of surface in a pixel that are told apart; samples of others count for the last.
const MAX_FRAGMENTS: usize = 4;
/// Cosine between the normals of triangles that touch, from which on they are one piece.
const LIKE: f32 = 0.8;

/// Renders an object under an environment many times a second.
pub struct RealtimeRenderer<'a> {
    stage: RealtimeScene<'a>,
    samples: VisibilityBuffer,
    coarse: Vec<Option<(Vec3, Vec3)>>,
    frame: RealtimeFrame,
}

/// Image of a [`RealtimeRenderer`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RealtimeFrame {
    /// Linear radiance, Rec. 709; 0 where nothing is hit. Of pixels that the object covers in part it is that part's share.
    pub image: RgbImage,
    /// Share of each pixel that shows the object.
    pub coverage: Grid<f32>,
}

struct RealtimeScene<'a> {
    scene: EnvironmentScene<'a>,
    vertices: Vec<Vertex>,
    /// At each sample of the surface, without the distant lights.
    irradiance: Vec<Vec3>,
    faces: Vec<Face>,
}

struct Vertex {
    position: Vec3,
    normal: Vec3,
}

/// A triangle: its normal, and the distant lights that reach all of its front or only a part.
struct Face {
    normal: Vec3,
    lit: u64,
    partial: u64,
}

/// Samples of a pixel that show one triangle and such as touch it.
#[derive(Clone, Copy, Default)]
struct Fragment {
    triangle: usize,
    /// Sums of the second and third corner's weights over the samples within the triangle, and the number of those.
    weights: [f32; 2],
    inside: u32,
    /// All samples.
    count: u32,
}

impl Fragment {
    #[inline]
    fn of(samples: &VisibilityBuffer, index: usize) -> Self {
        Fragment { triangle: samples.triangle[index] as usize, weights: samples.weights[index], inside: 1, count: 1 }
    }
}

/// Surface point that an image shows.
struct VisiblePoint {
    point: ShadingPoint,
    /// The triangle that is drawn there.
    triangle: usize,
    /// Whether the triangle's back is seen.
    turned: bool,
}

impl<'a> RealtimeRenderer<'a> {
    /// Prepares the scene.
    pub fn new(scene: EnvironmentScene<'a>) -> Self {
        let irradiance = scene.evaluator.sample_irradiance().into_owned();
        let mesh = scene.object.mesh;
        let vertices = mesh.positions.iter().zip(&scene.object.normals);
        let vertex = |(&position, &normal)| Vertex { position: Vec3::from_array(position), normal };
        let vertices = vertices.map(vertex).collect();
        let faces = crate::parallel::map(mesh.triangles.len(), |triangle| face(&scene, triangle));
        let stage = RealtimeScene { scene, vertices, irradiance, faces };
        RealtimeRenderer {
            stage,
            samples: VisibilityBuffer::default(),
            coarse: Vec::new(),
            frame: RealtimeFrame::default(),
        }
    }

    /// Draws one image.
    pub fn render(&mut self, camera: &Camera, look: &dyn ShadingModel) -> Result<&RealtimeFrame> {
        let mesh = self.stage.scene.object.mesh;
        let fine = supersampled(camera, self.stage.scene.options.samples);
        check_work(mesh, &fine)?;
        let RealtimeRenderer { stage, samples, coarse, frame } = self;
        samples.draw(mesh, &fine);
        let centre = Vec3::from_array(camera.centre().map(|x| x as f32));
        let (width, height) = (camera.width as usize, camera.height as usize);
        let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
        coarse.resize(half_width * half_height, None);
        for_each_chunk(coarse, half_width * ROWS / 2, |part, values| {
            for (k, value) in values.iter_mut().enumerate() {
                let (x, y) = (k % half_width * 2, (part * ROWS / 2 + k / half_width) * 2);
                // Of the four pixels the first that shows the object.
                let places = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
                let shown = places.iter().filter(|&&(x, y)| x < width && y < height);
                let spot = shown.filter_map(|&at| stage.visible_point(&stage.first(samples, at)?, centre)).next();
                *value = spot.and_then(|spot| Some((spot.point.normal, stage.reflected(&spot.point, look)?)));
            }
        });
        let coarse = CoarseSpecular { width: half_width, height: half_height, values: coarse };
        if (frame.image.width, frame.image.height) != (width, height) {
            frame.image = RgbImage::filled(width, height, [0.0; 3]);
            frame.coverage = Grid::filled(width, height, 0.0);
        }
        let share = 1.0 / (stage.scene.options.samples as f32).powi(2);
        for_each_chunk_pair(&mut frame.image.data, &mut frame.coverage.data, width * ROWS, |part, image, coverage| {
            let mut list = [Fragment::default(); MAX_FRAGMENTS];
            for (k, (pixel, covered)) in image.iter_mut().zip(coverage).enumerate() {
                let (x, y) = (k % width, part * ROWS + k / width);
                let mut sum = Vec3::ZERO;
                *covered = 0.0;
                for piece in stage.fragments(samples, (x, y), &mut list) {
                    *covered += share * piece.count as f32;
                    if let Some(spot) = stage.visible_point(piece, centre) {
                        sum += share * piece.count as f32 * stage.radiance(&spot, look, &coarse, [x, y]);
                    }
                }
                *pixel = sum.to_array();
            }
        });
        Ok(frame)
    }
}

fn face(scene: &EnvironmentScene, triangle: usize) -> Face {
    let corners = scene.object.mesh.triangles[triangle].map(|v| scene.object.mesh.positions[v as usize]);
    let [p, q, r] = corners.map(Vec3::from_array);
    let normal = (q - p).cross(r - p).normalize_or(Vec3::Y);
    let (mut lit, mut partial) = (0, 0);
    for (k, ShadowedLight { light, map }) in scene.evaluator.distant_lights().iter().enumerate() {
        let cosine = normal.dot(Vec3::from_array(light.direction));
        if scene.options.shadows && cosine <= 0.0 {
            continue;
        }
        match map {
            Some(map) => match map.triangle_visibility(corners.map(|c| c.map(f64::from)), cosine as f64) {
                Some(true) => lit |= 1 << k,
                Some(false) => {}
                None => partial |= 1 << k,
            },
            None => lit |= 1 << k,
        }
    }
    Face { normal, lit, partial }
}

impl RealtimeScene<'_> {
    /// The first sample of a pixel that shows the object.
    #[inline]
    fn first(&self, samples: &VisibilityBuffer, at: (usize, usize)) -> Option<Fragment> {
        let index = self.samples_of(samples, at).find(|&index| samples.is_covered(index))?;
        Some(Fragment::of(samples, index))
    }

    /// Numbers of a pixel's samples.
    #[inline]
    fn samples_of(&self, samples: &VisibilityBuffer, (x, y): (usize, usize)) -> impl Iterator<Item = usize> + use<> {
        let (n, width) = (self.scene.options.samples as usize, samples.width);
        let first = y * n * width + x * n;
        (0..n).flat_map(move |row| first + row * width..first + row * width + n)
    }

    /// Puts the pieces of surface that a pixel shows into a list.
    #[inline]
    fn fragments<'p>(
        &self,
        samples: &VisibilityBuffer,
        at: (usize, usize),
        list: &'p mut [Fragment; MAX_FRAGMENTS],
    ) -> &'p [Fragment] {
        let triangles = &self.scene.object.mesh.triangles;
        let mut count = 0;
        for index in self.samples_of(samples, at) {
            if !samples.is_covered(index) {
                continue;
            }
            let new = Fragment::of(samples, index);
            let touches = |other: usize| {
                let shared = triangles[new.triangle].iter().any(|corner| triangles[other].contains(corner));
                shared && self.faces[new.triangle].normal.dot(self.faces[other].normal) > LIKE
            };
            let known = &mut list[..count];
            if let Some(piece) = known.iter_mut().find(|piece| piece.triangle == new.triangle) {
                piece.weights = [piece.weights[0] + new.weights[0], piece.weights[1] + new.weights[1]];
                piece.inside += 1;
                piece.count += 1;
            } else if let Some(k) = (0..count).find(|&k| k == MAX_FRAGMENTS - 1 || touches(known[k].triangle)) {
                known[k].count += 1;
            } else {
                list[count] = new;
                count += 1;
            }
        }
        &list[..count]
    }

    /// The point that stands for a piece, if it faces the camera.
    #[inline]
    fn visible_point(&self, piece: &Fragment, centre: Vec3) -> Option<VisiblePoint> {
        let triangle = piece.triangle;
        let corners = self.scene.object.mesh.triangles[triangle];
        let [b, c] = piece.weights.map(|sum| sum / piece.inside as f32);
        let weights = Vec3::new(1.0 - b - c, b, c);
        let [p, q, r] = corners.map(|v| &self.vertices[v as usize]);
        let position = p.position * weights.x + q.position * b + r.position * c;
        let normal = (p.normal * weights.x + q.normal * b + r.normal * c).normalize_or(Vec3::Z);
        let outgoing = (centre - position).normalize_or(Vec3::Z);
        let geometric = self.faces[triangle].normal;
        let turned = geometric.dot(outgoing) < 0.0;
        let geometric = if turned { -geometric } else { geometric };
        let sites = self.scene.object.sites(triangle, weights, position);
        let tangent = self.scene.object.tangent(triangle, weights);
        let point = ShadingPoint { position, normal, geometric, outgoing, tangent, sites };
        (normal.dot(outgoing) > 0.0).then_some(VisiblePoint { point, triangle, turned })
    }

    /// Specular radiance without the distant lights; `None` where there is no specular part.
    fn reflected(&self, point: &ShadingPoint, shading: &dyn ShadingModel) -> Option<Vec3> {
        let highlights = point.reflectance(shading).highlights;
        let sum = highlights.scale();
        let shine = || self.scene.evaluator.tabulated_specular(point, &highlights);
        (sum.max_element() > 0.0).then(|| shine() / sum.max(Vec3::splat(1e-20)))
    }

    #[inline]
    fn radiance(
        &self,
        spot: &VisiblePoint,
        look: &dyn ShadingModel,
        coarse: &CoarseSpecular,
        [x, y]: [usize; 2],
    ) -> Vec3 {
        let point = &spot.point;
        let parameters = point.reflectance(look);
        let irradiance = point.between_samples(&self.irradiance);
        let scale = parameters.highlights.scale();
        let reflected = if scale.max_element() > 0.0 { coarse.between(x, y, point.normal) } else { None };
        let mut shine = scale * reflected.unwrap_or(Vec3::ZERO);
        let directed = self.distant(spot, &parameters, &mut shine);
        parameters.diffuse(irradiance, directed, point.normal.dot(point.outgoing)) + shine
    }

    /// Returns the distant lights' irradiance that enters, and adds their highlights.
    #[inline]
    fn distant(&self, spot: &VisiblePoint, parameters: &ShadingParameters, shine: &mut Vec3) -> Vec3 {
        let mut directed = Vec3::ZERO;
        let lights = self.scene.evaluator.distant_lights();
        let point = &spot.point;
        let face = &self.faces[spot.triangle];
        // From behind every light is tried.
        let (lit, mut left) = if spot.turned {
            (0, u64::MAX.checked_shr(64 - lights.len() as u32).unwrap_or(0))
        } else {
            (face.lit, face.lit | face.partial)
        };
        let cos_outgoing = point.normal.dot(point.outgoing);
        while left != 0 {
            let k = left.trailing_zeros() as usize;
            left &= left - 1;
            let ShadowedLight { light, map } = &lights[k];
            let direction = Vec3::from_array(light.direction);
            let cosine = point.normal.dot(direction);
            if cosine <= 0.0 {
                continue;
            }
            let mut reach = 1.0;
            if lit >> k & 1 == 0 && self.scene.options.shadows {
                let geometric = point.geometric.dot(direction);
                if geometric <= 0.0 {
                    continue;
                }
                if let Some(map) = map {
                    reach = map.visibility(point.position.as_dvec3().to_array(), geometric as f64) as f32;
                }
                if reach <= 0.0 {
                    continue;
                }
            }
            let arriving = Vec3::from_array(light.irradiance) * (cosine * reach);
            directed += arriving * parameters.entering(cosine);
            let length = (direction + point.outgoing).length().max(1e-6);
            let cos_half = (cosine + cos_outgoing) / length;
            let sine = (1.0 - cos_half * cos_half).max(0.0).sqrt();
            let fresnel = parameters.highlights.fresnel(0.5 * length);
            for (scale, part) in parameters.highlights.iter() {
                let scale = fresnel * scale;
                let Some(gloss) = &part.table else {
                    let frame = point.basis().transpose();
                    *shine += scale * arriving * evaluate_brdf(part, frame * direction, frame * point.outgoing);
                    continue;
                };
                let value = gloss.distribution(sine) / (cosine * cos_outgoing).max(1e-6);
                if value * arriving.max_element() * scale.max_element() * gloss.max_remainder() > FAINT {
                    let remainder = gloss.remainder(sine, 0.5 * length, cosine - cos_outgoing);
                    *shine += scale * arriving * value * remainder;
                }
            }
        }
        directed
    }
}

/// Normal and specular reflection of every fourth pixel, where it shows a shiny object.
struct CoarseSpecular<'a> {
    width: usize,
    height: usize,
    values: &'a [Option<(Vec3, Vec3)>],
}

impl CoarseSpecular<'_> {
    /// Between the four nearest, those with a like normal counting most; `None` where none shows the object.
    #[inline]
    fn between(&self, x: usize, y: usize, normal: Vec3) -> Option<Vec3> {
        let (column, row) = (x / 2, y / 2);
        let beside =
            |at: usize, odd: bool, size: usize| if odd { (at + 1).min(size - 1) } else { at.saturating_sub(1) };
        let columns = [(column, 0.75), (beside(column, x % 2 == 1, self.width), 0.25)];
        let rows = [(row, 0.75), (beside(row, y % 2 == 1, self.height), 0.25)];
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for (row, share) in rows {
            for (column, part) in columns {
                if let Some((other, value)) = self.values[row * self.width + column] {
                    let weight = share * part * (1e-3 + (normal.dot(other).max(0.0)).powi(32));
                    sum += weight * value;
                    total += weight;
                }
            }
        }
        (total > 0.0).then(|| sum / total)
    }
}
