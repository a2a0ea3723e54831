//! An object under light from all around: what every evaluator shares.

use super::appearance::{PreparedSpecular, ShadingModel, ShadingParameters};
use super::multisample::VisibilityBuffer;
use super::occlusion::Occlusion;
use super::tangents::corner_tangents;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::image::{Grid, RgbImage};
use crate::mesh::{CornerCoordinates, Mesh};
use crate::surface::displacement::DisplacedMesh;
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

/// A mesh, or a finer surface on one, with what its shadows need.
pub struct RenderObject<'a> {
    /// What is drawn.
    pub(super) mesh: &'a Mesh,
    /// The surface that is drawn, and the mesh that it lies on.
    surface: Option<(&'a DisplacedMesh, &'a Mesh)>,
    /// Unit normals of the samples at which irradiance is summed, those of the vertices first.
    pub(super) normals: Vec<Vec3>,
    /// Unit normals of the places whose visibility is known; empty where the samples are the places.
    place_normals: Vec<Vec3>,
    /// Around each sample the places whose visibility is known, and their shares; empty where the samples are the places.
    around_samples: Vec<([u32; 3], Vec3)>,
    pub(super) occlusion: Option<&'a Occlusion>,
    /// Tangents of the corners of the triangles that are drawn; empty where the frame follows from the normal.
    tangents: Vec<[Vec3; 3]>,
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
        let (place_normals, around_samples) = (Vec::new(), Vec::new());
        let tangents = Vec::new();
        Ok(RenderObject { mesh, surface: None, normals, place_normals, around_samples, occlusion, tangents })
    }

    /// Gives the surface tangents along growing `u` of texture coordinates, one for each triangle's corners: materials that are not round follow
    /// them. Nothing on a finer surface.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for another number of triangles.
    pub fn with_coordinates(mut self, coordinates: &[CornerCoordinates]) -> Result<Self> {
        if self.surface.is_some() {
            return Ok(self);
        }
        if coordinates.len() != self.mesh.triangles.len() {
            return Err(Error::parameter("the texture coordinates belong to another mesh: its triangles differ"));
        }
        self.tangents = corner_tangents(self.mesh, &self.normals, coordinates);
        Ok(self)
    }

    /// Prepares a finer surface on a mesh; `occlusion` is known at samples of the mesh, irradiance is summed at the surface's vertices.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if the surface or the visibility belongs to another mesh.
    pub fn with_surface(mesh: &'a Mesh, surface: &'a DisplacedMesh, occlusion: Option<&'a Occlusion>) -> Result<Self> {
        if !surface.is_of(mesh) {
            return Err(Error::parameter("the surface belongs to another mesh: its triangles differ"));
        }
        // Checks the mesh and the visibility.
        let base = RenderObject::new(mesh, occlusion)?;
        let fine = surface.mesh();
        let normals = surface.normals().iter().map(|n| Vec3::from_array(n.map(|x| x as f32))).collect();
        let mut around_samples = Vec::new();
        if occlusion.is_some() {
            around_samples.resize(fine.positions.len(), ([0; 3], Vec3::ZERO));
            for (triangle, corners) in fine.triangles.iter().enumerate() {
                for (k, &vertex) in corners.iter().enumerate() {
                    let corner = std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
                    let (triangle, weights) = surface.coarser(triangle, corner);
                    let weights = Vec3::from_array(weights.map(|w| w as f32));
                    around_samples[vertex as usize] = base.around(triangle, mesh.triangles[triangle], weights);
                }
            }
        }
        let place_normals = base.normals;
        Ok(RenderObject {
            mesh: fine,
            surface: Some((surface, mesh)),
            normals,
            place_normals,
            around_samples,
            occlusion,
            tangents: Vec::new(),
        })
    }

    /// Prepares what a file shows: its surface where it has one, its mesh otherwise.
    ///
    /// # Errors
    ///
    /// Those of [`Self::new`] and [`Self::with_surface`].
    pub fn of_asset(asset: &'a Asset, occlusion: Option<&'a Occlusion>) -> Result<Self> {
        match &asset.surface {
            Some(surface) => Self::with_surface(&asset.mesh, surface, occlusion),
            None => {
                let object = Self::new(&asset.mesh, occlusion)?;
                match &asset.coordinates {
                    Some(coordinates) => object.with_coordinates(coordinates),
                    None => Ok(object),
                }
            }
        }
    }

    /// The mesh that is drawn.
    pub fn mesh(&self) -> &'a Mesh {
        self.mesh
    }

    /// The mesh with visibility and reflectance maps: what is drawn, or what the surface that is drawn lies on.
    pub(super) fn base(&self) -> &'a Mesh {
        self.surface.map_or(self.mesh, |(_, base)| base)
    }

    /// Whether irradiance is summed at the places whose visibility is known.
    #[cfg(feature = "encode")]
    pub(super) fn samples_are_places(&self) -> bool {
        self.surface.is_none()
    }

    /// Unit normals of the places whose visibility is known.
    #[cfg(feature = "encode")]
    pub(super) fn place_normals(&self) -> &[Vec3] {
        if self.samples_are_places() { &self.normals } else { &self.place_normals }
    }

    /// The places whose visibility is known around a sample, and their shares.
    #[inline]
    pub(super) fn around_sample(&self, sample: usize) -> ([u32; 3], Vec3) {
        self.around_samples.get(sample).copied().unwrap_or(([sample as u32; 3], Vec3::X))
    }

    /// The places around a point of a triangle of the mesh with visibility, and their shares, by its corners and their weights.
    #[inline]
    fn around(&self, triangle: usize, corners: [u32; 3], weights: Vec3) -> ([u32; 3], Vec3) {
        let Some(occlusion) = self.occlusion else { return (corners, weights) };
        let (places, shares) = occlusion.places().interpolation(triangle, corners, weights.to_array());
        (places, Vec3::from_array(shares))
    }

    /// Tangent at a point of a triangle that is drawn; zero where the frame follows from the normal.
    #[inline]
    pub(super) fn tangent(&self, triangle: usize, weights: Vec3) -> Vec3 {
        let Some([a, b, c]) = self.tangents.get(triangle) else { return Vec3::ZERO };
        *a * weights.x + *b * weights.y + *c * weights.z
    }

    /// The point of the mesh under a point of a triangle that is drawn, the places around it, and the samples around it.
    #[inline]
    pub(super) fn sites(&self, triangle: usize, weights: Vec3, position: Vec3) -> Sites {
        let Some((surface, base)) = self.surface else { return self.sites_on_mesh(triangle, weights, position) };
        let samples = (self.mesh.triangles[triangle], weights);
        let (triangle, weights) = surface.coarser(triangle, weights.to_array().map(f64::from));
        let weights = Vec3::from_array(weights.map(|w| w as f32));
        let corners = base.triangles[triangle];
        let [p, q, r] = corners.map(|v| Vec3::from_array(base.positions[v as usize]));
        let position = p * weights.x + q * weights.y + r * weights.z;
        Sites {
            on_mesh: MeshPoint { triangle, weights, position },
            places: self.around(triangle, corners, weights),
            samples,
        }
    }

    /// What [`Self::sites`] returns, at a point of a triangle of the mesh that the surface lies on.
    pub(super) fn sites_on_mesh(&self, triangle: usize, weights: Vec3, position: Vec3) -> Sites {
        let corners = self.base().triangles[triangle];
        let places = self.around(triangle, corners, weights);
        let samples = match self.surface {
            Some((surface, _)) => {
                let (fine, weights) = surface.finer(triangle, weights.to_array().map(f64::from));
                (self.mesh.triangles[fine], Vec3::from_array(weights.map(|w| w as f32)))
            }
            None => places,
        };
        Sites { on_mesh: MeshPoint { triangle, weights, position }, places, samples }
    }
}

/// A point of a mesh: triangle, weights of its corners, position.
#[derive(Clone, Copy)]
pub(super) struct MeshPoint {
    pub triangle: usize,
    pub weights: Vec3,
    pub position: Vec3,
}

/// Where reflectance, visibility and irradiance of a point are known.
pub(super) struct Sites {
    /// The point of the mesh that the reflectance maps lie on.
    pub on_mesh: MeshPoint,
    /// The places whose visibility is known around it, and their shares.
    pub places: ([u32; 3], Vec3),
    /// The samples at which irradiance is summed around it, and their shares.
    pub samples: ([u32; 3], Vec3),
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
    /// Along the surface's first axis, nearly; zero where that follows from the normal.
    pub tangent: Vec3,
    pub sites: Sites,
}

impl ShadingPoint {
    /// Returns the reflectance at the point.
    #[inline]
    pub(super) fn reflectance<'m>(&self, model: &'m dyn ShadingModel) -> ShadingParameters<'m> {
        let MeshPoint { triangle, weights, position } = self.sites.on_mesh;
        model.parameters_at(triangle, weights.to_array(), position.to_array())
    }

    /// Value between the places with visibility around the point.
    #[inline]
    pub(super) fn between_places(&self, values: &[Vec3]) -> Vec3 {
        between(self.sites.places, values)
    }

    /// Value between the samples of the surface around the point.
    #[inline]
    pub(super) fn between_samples(&self, values: &[Vec3]) -> Vec3 {
        between(self.sites.samples, values)
    }

    /// Signed distance of what is visible in a direction, by its place on the octahedral square.
    #[inline]
    pub(super) fn distance(&self, occlusion: &Occlusion, square: glam::Vec2) -> f32 {
        let (places, shares) = self.sites.places;
        occlusion.interpolated_distance(places, shares, square)
    }

    /// Frame for the half vectors of a specular part. Those of round ones follow the normal alone, so that they show no seam between charts.
    #[inline]
    pub(super) fn basis_for(&self, part: &PreparedSpecular) -> Mat3 {
        if part.is_round { self.normal_basis() } else { self.basis() }
    }

    /// Frame of the shading normal along the tangent, or where there is none that of the normal alone.
    #[inline]
    pub(crate) fn basis(&self) -> Mat3 {
        let normal = self.normal;
        let along = self.tangent - normal * normal.dot(self.tangent);
        if along.length_squared() > 1e-12 {
            let along = along.normalize();
            return Mat3::from_cols(along, normal.cross(along), normal);
        }
        self.normal_basis()
    }

    /// Frame of the shading normal, see [`crate::sphere::gaussian::tangents`].
    #[inline]
    fn normal_basis(&self) -> Mat3 {
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

/// Value between three of some, by their indices and shares.
#[inline]
pub(super) fn between((indices, shares): ([u32; 3], Vec3), values: &[Vec3]) -> Vec3 {
    let [a, b, c] = indices.map(|index| values[index as usize]);
    a * shares.x + b * shares.y + c * shares.z
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
    /// Draws the object with `samples` samples of a pixel along each side: its surface, and behind it the mesh that the surface lies on, where only
    /// that is met. What photographs say of silhouettes is in the mesh.
    pub(super) fn new(object: &RenderObject, camera: &Camera, samples: u32) -> Result<Self> {
        let fine = supersampled(camera, samples);
        check_work(object.mesh, &fine)?;
        let centre = Vec3::from_array(camera.centre().map(|x| x as f32));
        let mut raster = VisibilityBuffer::default();
        raster.draw(object.mesh, &fine);
        if let Some((_, base)) = object.surface {
            // Displaced, the surface may fill less of the picture than its mesh.
            check_work(base, &fine)?;
            let mut behind = VisibilityBuffer::default();
            behind.draw(base, &fine);
            raster.put_behind(&behind, object.mesh.triangles.len() as u32);
        }
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

/// Cosine to the camera, about, that normals of the mesh behind a surface have at least: the surface may look away there.
const LEAST_COSINE: f32 = 0.05;

fn surface_point(object: &RenderObject, raster: &VisibilityBuffer, index: usize, centre: Vec3) -> ShadingPoint {
    let triangle = raster.triangle[index] as usize;
    // Triangles of the mesh that a surface lies on come after those of the surface.
    let behind = triangle.checked_sub(object.mesh.triangles.len());
    let (mesh, triangle) = behind.map_or((object.mesh, triangle), |triangle| (object.base(), triangle));
    let corners = mesh.triangles[triangle];
    let [b, c] = raster.weights[index];
    let weights = Vec3::new(1.0 - b - c, b, c);
    let [p, q, r] = corners.map(|v| Vec3::from_array(mesh.positions[v as usize]));
    let position = p * weights.x + q * weights.y + r * weights.z;
    let outgoing = (centre - position).normalize_or(Vec3::Z);
    let interpolated = |around| between(around, &object.normals).normalize_or(Vec3::Z);
    let (sites, normal) = match behind {
        None => (object.sites(triangle, weights, position), interpolated((corners, weights))),
        Some(_) => {
            let sites = object.sites_on_mesh(triangle, weights, position);
            let normal = interpolated(sites.samples);
            let missing = (LEAST_COSINE - normal.dot(outgoing)).max(0.0);
            (sites, (normal + missing * outgoing).normalize_or(Vec3::Z))
        }
    };
    let geometric = (q - p).cross(r - p).normalize_or(normal);
    let geometric = if geometric.dot(outgoing) < 0.0 { -geometric } else { geometric };
    // None on surfaces, nor on the mesh behind one.
    let tangent = object.tangent(triangle, weights);
    ShadingPoint { position, normal, geometric, outgoing, tangent, sites }
}
