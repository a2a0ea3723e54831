//! One asset with what its images share: normals, the capture's lights, captured views.

use super::capture_lights::CaptureLights;
use super::file_light::FileLight;
use super::residual::CapturedView;
use super::shadow::ShadowMap;
use super::textures::AssetShading;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::image::Grid;
use crate::mesh::Mesh;
use crate::reflectance::{ReflectionGeometry, maps};
use crate::surface::atlas::{atlas_position, sample_colour, smooth_normal};
use crate::surface::displacement::DisplacedMesh;
#[cfg(feature = "encode")]
use crate::surface::occluders::Occluders;
use crate::surface::raster::{Raster, rasterise, vertex_normals};
#[cfg(feature = "encode")]
use crate::views::PointLight;
use crate::views::{Camera, Component};
use glam::DVec3;
#[cfg(feature = "encode")]
use glam::Vec3;
use std::sync::OnceLock;
#[cfg(feature = "encode")]
use std::sync::{Arc, Mutex};

/// An asset whose parts belong together. Captured views are prepared when first needed.
pub(super) struct PreparedAsset<'a> {
    pub(super) asset: &'a Asset,
    normals: Vec<[f64; 3]>,
    pub(super) lights: CaptureLights,
    captured: Vec<OnceLock<Option<CapturedView<'a>>>>,
    file_light: FileLight,
    shading: OnceLock<Option<AssetShading<'a>>>,
    #[cfg(feature = "encode")]
    occluders: OnceLock<Occluders>,
    /// Irradiance of the mesh's vertices from the object itself under the last lamps.
    #[cfg(feature = "encode")]
    pub(super) object_light: Mutex<Vec<(PointLight, Arc<[Vec3]>)>>,
}

/// A surface point that a pixel sees.
pub(super) struct SurfacePoint {
    pub(super) point: [f64; 3],
    pub(super) normal: [f64; 3],
    /// Atlas position, where there is an atlas.
    at: Option<[f64; 2]>,
    /// Triangle of the mesh, weights of its corners there and the place on it.
    pub(super) base: usize,
    pub(super) weights: [f64; 3],
    pub(super) on_mesh: [f64; 3],
}

impl<'a> PreparedAsset<'a> {
    /// Checks that the parts of the asset belong together.
    pub(super) fn new(asset: &'a Asset) -> Result<Self> {
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
        Ok(PreparedAsset {
            asset,
            normals: vertex_normals(&asset.mesh),
            lights: CaptureLights::new(asset),
            captured: asset.views.iter().map(|_| OnceLock::new()).collect(),
            file_light: FileLight::default(),
            shading: OnceLock::new(),
            #[cfg(feature = "encode")]
            occluders: OnceLock::new(),
            #[cfg(feature = "encode")]
            object_light: Mutex::default(),
        })
    }

    /// The finest mesh that the asset has.
    pub(super) fn surface(&self) -> &'a Mesh {
        self.asset.surface.as_ref().map_or(&self.asset.mesh, DisplacedMesh::mesh)
    }

    /// Draws the surface, and behind it the mesh where only that is met: its triangles are numbered after those of the surface. What
    /// photographs say of silhouettes is in the mesh.
    pub(super) fn draw(&self, camera: &Camera) -> Raster {
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

    pub(super) fn captured(&self, view: usize) -> Option<&CapturedView<'a>> {
        self.captured[view].get_or_init(|| self.prepare(view)).as_ref()
    }

    /// Whether a view was captured from where a camera stands.
    pub(super) fn is_captured_from(&self, view: usize, camera: &Camera) -> bool {
        let [own, other] = [&self.asset.views[view].camera, camera].map(|c| DVec3::from_array(c.centre()));
        (own - other).length() <= 1e-9 * (own - DVec3::from_array(self.middle())).length()
    }

    /// Middle of the object.
    pub(super) fn middle(&self) -> [f64; 3] {
        self.lights.middle
    }

    /// The captured views under the most used light that look most alike.
    pub(super) fn outlines(&self, camera: &Camera, views: usize) -> Vec<&CapturedView<'a>> {
        let near = self.lights.nearest(self.asset, camera, 0, views);
        near.iter().filter_map(|&(view, _)| self.captured(view)).collect()
    }

    /// A captured view with the share of its light that reaches each pixel, which relighting takes.
    pub(super) fn captured_with_shadows(&self, view: usize) -> Option<&CapturedView<'a>> {
        let captured = self.captured(view)?;
        captured.shadowed(|| {
            let light = self.asset.views[view].light?;
            let map = ShadowMap::new(self.surface(), light.position)?;
            let (camera, raster) = (&captured.camera, &captured.raster);
            let reach = |index: usize| -> f32 {
                if !raster.is_covered(index) {
                    return 1.0;
                }
                let surface = self.surface_point(camera, raster, index);
                let geometry = ReflectionGeometry::new(surface.point, surface.normal, camera.centre(), &light);
                map.visibility(surface.point, geometry.cos_light as f64) as f32
            };
            Some(Grid {
                width: raster.width,
                height: raster.height,
                data: (0..raster.depth.len()).map(reach).collect(),
            })
        });
        Some(captured)
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

    pub(super) fn surface_point(&self, camera: &Camera, raster: &Raster, index: usize) -> SurfacePoint {
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
        let on_mesh: DVec3 = match fine {
            Some(_) => (0..3).map(|k| base_weights[k] * corner(k)).sum(),
            None => DVec3::from_array(point),
        };
        let at = charts.map(|charts| atlas_position(charts, base, on_mesh));
        SurfacePoint { point, normal: normal.to_array(), at, base, weights: base_weights, on_mesh: on_mesh.to_array() }
    }

    pub(super) fn model(
        &self,
        component: Component,
        surface: &SurfacePoint,
        geometry: Option<&ReflectionGeometry>,
    ) -> [f32; 3] {
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

    /// The object's reflectance as that of any lit surface; none where it has none.
    pub(super) fn shading(&self) -> Option<&AssetShading<'a>> {
        // Its highlights count by their factors only, not by what stands for their shapes.
        made_once(&self.shading, || AssetShading::new(self.asset, 1).ok()).as_ref()
    }

    /// Normals of the mesh's vertices.
    #[cfg(feature = "encode")]
    pub(super) fn mesh_normals(&self) -> Vec<Vec3> {
        self.normals.iter().map(|&normal| DVec3::from_array(normal).as_vec3()).collect()
    }

    /// The mesh, made ready for rays.
    #[cfg(feature = "encode")]
    pub(super) fn occluders(&self) -> &Occluders {
        made_once(&self.occluders, || Occluders::new(&self.asset.mesh))
    }
}

/// The value of a cell, made before it is locked: what is made on several threads may take up other work that asks for it, too.
fn made_once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> T) -> &T {
    if let Some(value) = cell.get() {
        return value;
    }
    let made = make();
    cell.get_or_init(|| made)
}
