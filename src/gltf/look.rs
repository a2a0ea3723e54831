//! Images of the fallback as a viewer shows it, to be compared with photographs.

use super::fallback::Fallback;
use super::normal_map::frame;
use crate::asset::Asset;
use crate::brdf::Brdf;
use crate::image::{Grid, RgbImage};
use crate::parallel;
use crate::surface::atlas::{atlas_position, smooth_normal};
use crate::surface::raster::{rasterise, vertex_normals};
use crate::surface::split::RenderMesh;
use crate::vector::direction;
use crate::views::{Camera, PointLight};
use glam::DVec3;

/// Renders the asset's mesh with the fallback's textures, in the asset's unit of radiance. `light` may be `None` for an unlit fallback only:
/// anything else is black then.
pub fn render_fallback(asset: &Asset, fallback: &Fallback, camera: &Camera, light: Option<&PointLight>) -> RgbImage {
    let raster = rasterise(&asset.mesh, camera);
    let normals = vertex_normals(&asset.mesh);
    let mapped = asset.charts.as_ref().filter(|_| fallback.normal.is_some());
    let geometry = mapped.map(|charts| RenderMesh::with_atlas(&asset.mesh, charts));
    let centre = camera.centre();
    let pixel = |index: usize| -> [f32; 3] {
        let Some(charts) = asset.charts.as_ref().filter(|_| raster.is_covered(index)) else { return [0.0; 3] };
        let at = [(index % raster.width) as f64 + 0.5, (index / raster.width) as f64 + 0.5];
        let (ray, depth) = (camera.ray(at), raster.depth[index]);
        let point: [f64; 3] = std::array::from_fn(|k| centre[k] + ray[k] * depth);
        let triangle = raster.triangle[index] as usize;
        let on_atlas = atlas_position(charts, triangle, DVec3::from_array(point));
        let material = fallback.microfacets_at(on_atlas);
        if fallback.is_unlit {
            return std::array::from_fn(|c| (material.base_colour[c] / fallback.unit[c]) as f32);
        }
        let Some(light) = light else { return [0.0; 3] };
        let [b, c] = raster.barycentric[index].map(f64::from);
        let normal = smooth_normal(asset.mesh.triangles[triangle], [1.0 - b - c, b, c], &normals);
        let (to_light, squared) = direction(point, light.position);
        let (to_view, _) = direction(point, centre);
        let shading = geometry.as_ref().map_or(normal, |geometry| {
            let frame = frame(geometry, triangle, [1.0 - b - c, b, c]);
            let sum: DVec3 = frame.iter().zip(fallback.normal_at(on_atlas)).map(|(axis, x)| *axis * x).sum();
            sum.normalize_or(normal)
        });
        let (tangent, bitangent) = shading.any_orthonormal_pair();
        let frame = [tangent, bitangent, shading];
        let local = |v: [f64; 3]| frame.map(|axis| axis.dot(DVec3::from_array(v)));
        let (incoming, outgoing) = (local(to_light), local(to_view));
        let brdf = material.evaluate(incoming, outgoing);
        std::array::from_fn(|c| {
            let irradiance = light.intensity[c] / squared * incoming[2].max(0.0);
            (brdf[c] / fallback.unit[c] * irradiance) as f32
        })
    };
    let rows =
        parallel::map(raster.height, |y| (0..raster.width).map(|x| pixel(y * raster.width + x)).collect::<Vec<_>>());
    Grid { width: raster.width, height: raster.height, data: rows.concat() }
}
