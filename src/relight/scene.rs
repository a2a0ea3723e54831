//! An object under light from all around: what every evaluator shares.

use super::appearance::{PreparedSpecular, ShadingModel, ShadingParameters};
use super::occlusion::Occlusion;
use super::tangents::corner_tangents;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::image::{Grid, RgbImage};
use crate::mesh::{CornerCoordinates, Mesh};
use crate::surface::displacement::DisplacedMesh;
use crate::surface::raster::vertex_normals;
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
    /// Samples of a pixel along each side; from 2 on, still images take twice as many along each side at the object's outline.
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
    pub(super) surface: Option<(&'a DisplacedMesh, &'a Mesh)>,
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
