//! An object under light from all around: what every evaluator shares.

use super::multisample::VisibilityBuffer;
use super::occlusion::Occlusion;
use crate::error::{Error, Result};
use crate::image::{Grid, RgbImage};
use crate::mesh::Mesh;
use crate::surface::raster::{check_work, vertex_normals};
use crate::views::Camera;
use glam::{Mat3, Vec3};

/// Method of summing an environment's light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EvaluatorKind {
    /// Spherical Gaussians throughout (Sonoda 2011): ten of them for diffuse light, one lobe warped and looked up for specular light,
    /// the visible half-space by Wang's fit.
    SphericalGaussian,
    /// Filtered importance sampling (Krivanek & Colbert 2008) of the specular lobe; diffuse light summed over all directions at each
    /// vertex, compact sources with exact shadows.
    Filtered,
}

/// Options of an environment's renderers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvironmentOptions {
    /// The evaluator.
    pub evaluator: EvaluatorKind,
    /// Whether the object shadows itself. Needs an [`Occlusion`].
    pub shadows: bool,
    /// Samples of a pixel along each side.
    pub samples: u32,
    /// Samples of the specular lobe, 1 or more, [`EvaluatorKind::Filtered`] only.
    pub taps: usize,
}

impl Default for EnvironmentOptions {
    fn default() -> Self {
        EnvironmentOptions { evaluator: EvaluatorKind::Filtered, shadows: true, samples: 2, taps: 24 }
    }
}

/// A mesh with what its shadows need.
pub struct RenderObject<'a> {
    pub(super) mesh: &'a Mesh,
    /// Unit normals of the samples, those of the vertices first.
    pub(super) normals: Vec<Vec3>,
    pub(super) occlusion: Option<&'a Occlusion>,
}

impl<'a> RenderObject<'a> {
    /// Prepares a mesh; `occlusion`, at the samples of its surface, is what shadows need.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if triangles name vertices that do not exist, or the visibility belongs to another mesh.
    pub fn new(mesh: &'a Mesh, occlusion: Option<&'a Occlusion>) -> Result<Self> {
        let vertices = mesh.positions.len();
        if mesh.triangles.iter().flatten().any(|&v| v as usize >= vertices) {
            return Err(Error::parameter("the mesh names vertices that it does not have"));
        }
        if occlusion.is_some_and(|o| !o.places().are_on(mesh)) {
            return Err(Error::parameter("the visibility belongs to another mesh: its vertices or triangles differ"));
        }
        let single = |n: [f64; 3]| Vec3::from_array(n.map(|x| x as f32));
        let mut normals: Vec<Vec3> = vertex_normals(mesh).into_iter().map(single).collect();
        for (triangle, weights) in occlusion.iter().flat_map(|o| o.places().inner()) {
            let corners = mesh.triangles[triangle].map(|v| normals[v as usize]);
            let sum = (0..3).fold(Vec3::ZERO, |sum, k| sum + corners[k] * weights[k] as f32);
            normals.push(sum.normalize_or(Vec3::Z));
        }
        Ok(RenderObject { mesh, normals, occlusion })
    }

    /// The object's mesh.
    pub fn mesh(&self) -> &'a Mesh {
        self.mesh
    }

    /// The samples around a point of a triangle and their shares, by its corners and their weights.
    #[inline]
    pub(super) fn around(&self, triangle: usize, corners: [u32; 3], weights: Vec3) -> ([u32; 3], Vec3) {
        let Some(occlusion) = self.occlusion else { return (corners, weights) };
        let (places, shares) = occlusion.places().interpolation(triangle, corners, weights.to_array());
        (places, Vec3::from_array(shares))
    }
}

/// Surface point that an image shows.
pub(super) struct ShadingPoint {
    pub position: Vec3,
    /// Normal between the vertices' normals.
    pub normal: Vec3,
    /// Normal of the triangle, on the seen side.
    pub geometric: Vec3,
    /// Unit vector to the camera.
    pub outgoing: Vec3,
    pub triangle: usize,
    /// Barycentric weights of the triangle's corners.
    pub weights: Vec3,
    /// Surface samples around it, at which visibility and irradiance are known, and the weight of each.
    pub places: [u32; 3],
    pub shares: Vec3,
}

impl ShadingPoint {
    /// Tangent frame of the shading normal, see [`crate::sphere::gaussian::tangents`].
    #[inline]
    pub(crate) fn basis(&self) -> Mat3 {
        let normal = self.normal;
        let sign = 1f32.copysign(normal.z);
        let a = -1.0 / (sign + normal.z);
        let b = normal.x * normal.y * a;
        Mat3::from_cols(
            Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
            Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
            normal,
        )
    }
}

/// Image of an object under an environment.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentRender {
    /// Linear radiance, Rec. 709; 0 where nothing is hit. Of pixels that the object covers in part it is that part's share.
    pub image: RgbImage,
    /// The diffuse part of it.
    pub diffuse: RgbImage,
    /// Share of each pixel that shows the object.
    pub coverage: Grid<f32>,
}

/// A mesh drawn with all samples of an image.
pub(super) struct SampledView {
    raster: VisibilityBuffer,
    centre: Vec3,
    samples: usize,
}

impl SampledView {
    /// Draws the object with `samples` samples of a pixel along each side.
    pub(super) fn new(object: &RenderObject, camera: &Camera, samples: u32) -> Result<Self> {
        let fine = supersampled(camera, samples);
        check_work(object.mesh, &fine)?;
        let centre = Vec3::from_array(camera.centre().map(|x| x as f32));
        let mut raster = VisibilityBuffer::default();
        raster.draw(object.mesh, &fine);
        Ok(SampledView { raster, centre, samples: samples as usize })
    }

    fn point(&self, object: &RenderObject, index: usize) -> ShadingPoint {
        surface_point(object, &self.raster, index, self.centre)
    }
}

/// Draws the object, shading each sample; the number that `shade` gets differs from sample to sample.
pub(super) fn shade_samples(
    object: &RenderObject,
    drawn: &SampledView,
    shade: impl Fn(&ShadingPoint, usize) -> [Vec3; 2] + Sync + Send,
) -> EnvironmentRender {
    let (raster, n) = (&drawn.raster, drawn.samples);
    let (width, height) = (raster.width / n, raster.height / n);
    let rows = crate::parallel::map(height, |y| {
        let mut row = vec![([0f32; 3], [0f32; 3], 0f32); width];
        for (x, pixel) in row.iter_mut().enumerate() {
            let (mut sum, mut hits) = ([Vec3::ZERO; 2], 0);
            for k in 0..n * n {
                let index = (y * n + k / n) * width * n + x * n + k % n;
                if !raster.is_covered(index) {
                    continue;
                }
                hits += 1;
                let point = drawn.point(object, index);
                if point.normal.dot(point.outgoing) > 0.0 {
                    let parts = shade(&point, index);
                    sum = [sum[0] + parts[0], sum[1] + parts[1]];
                }
            }
            let share = 1.0 / (n * n) as f32;
            let [diffuse, specular] = sum.map(|part| part * share);
            *pixel = ((diffuse + specular).to_array(), diffuse.to_array(), hits as f32 * share);
        }
        row
    });
    let pixels = rows.concat();
    EnvironmentRender {
        image: Grid { width, height, data: pixels.iter().map(|p| p.0).collect() },
        diffuse: Grid { width, height, data: pixels.iter().map(|p| p.1).collect() },
        coverage: Grid { width, height, data: pixels.iter().map(|p| p.2).collect() },
    }
}

/// Returns the camera with `samples` pixels for each along either side.
pub(super) fn supersampled(camera: &Camera, samples: u32) -> Camera {
    camera.scaled([camera.width * samples, camera.height * samples], [samples as f64; 2])
}

fn surface_point(object: &RenderObject, raster: &VisibilityBuffer, index: usize, centre: Vec3) -> ShadingPoint {
    let triangle = raster.triangle[index] as usize;
    let corners = object.mesh.triangles[triangle];
    let [b, c] = raster.weights[index];
    let weights = Vec3::new(1.0 - b - c, b, c);
    let [p, q, r] = corners.map(|v| Vec3::from_array(object.mesh.positions[v as usize]));
    let position = p * weights.x + q * weights.y + r * weights.z;
    let normal = corners.map(|v| object.normals[v as usize]);
    let normal = (normal[0] * weights.x + normal[1] * weights.y + normal[2] * weights.z).normalize_or(Vec3::Z);
    let outgoing = (centre - position).normalize_or(Vec3::Z);
    let geometric = (q - p).cross(r - p).normalize_or(normal);
    let geometric = if geometric.dot(outgoing) < 0.0 { -geometric } else { geometric };
    let (places, shares) = object.around(triangle, corners, weights);
    ShadingPoint { position, normal, geometric, outgoing, triangle, weights, places, shares }
}
