//! A tangent-space normal map of a surface that is finer than the mesh.

use crate::asset::Asset;
use crate::image::{Grid, Mask};
use crate::surface::atlas::AtlasRaster;
use crate::surface::charts::Charts;
use crate::surface::split::RenderMesh;
use glam::{DVec3, Vec3};

/// Tangent, direction up in the picture and normal at a place of a triangle, as a viewer has them between the vertices.
pub(super) fn frame(geometry: &RenderMesh, triangle: usize, weights: [f64; 3]) -> [DVec3; 3] {
    let corners = geometry.triangles[triangle].map(|vertex| vertex as usize);
    let between = |vector: &dyn Fn(usize) -> Vec3| -> DVec3 {
        (0..3).map(|k| vector(corners[k]).as_dvec3() * weights[k]).sum::<DVec3>().normalize_or_zero()
    };
    let normal = between(&|vertex| Vec3::from_array(geometry.normals[vertex]));
    let tangent = between(&|vertex| {
        let [x, y, z, _] = geometry.tangents[vertex];
        Vec3::new(x, y, z)
    });
    let sign = geometry.tangents[corners[0]][3] as f64;
    [tangent, normal.cross(tangent) * sign, normal]
}

/// Bakes the normals of an asset's surface on its atlas, 8 bits from -1 to 1: x along the tangent, y up in the picture, z along the mesh's
/// own normal. `None` where the file has no surface finer than its mesh.
pub(super) fn bake_normal_map(
    asset: &Asset,
    charts: &Charts,
    atlas: &AtlasRaster,
    mask: &Mask,
) -> Option<Grid<[u8; 3]>> {
    let surface = asset.surface.as_ref().filter(|surface| surface.is_of(&asset.mesh))?;
    let geometry = RenderMesh::with_atlas(&asset.mesh, charts);
    let data = crate::parallel::map(mask.data.len(), |texel| {
        if !mask.data[texel] {
            return [0.0; 3];
        }
        let triangle = atlas.triangle.data[texel] as usize;
        let weights = atlas.weights(texel);
        let fine = DVec3::from_array(surface.point(triangle, weights).1);
        // The frame need not be a right-angled one between vertices: the numbers are those that a viewer's sum makes the normal of.
        let matrix = glam::DMat3::from_cols_array_2d(&frame(&geometry, triangle, weights).map(|axis| axis.to_array()));
        let local = if matrix.determinant().abs() > 1e-3 { matrix.inverse() * fine } else { DVec3::Z };
        local.normalize_or(DVec3::Z).as_vec3().to_array()
    });
    let mut map = Grid { width: mask.width, height: mask.height, data };
    map.fill_outside(mask);
    let code = |x: f32| ((0.5 * x + 0.5).clamp(0.0, 1.0) * 255.0).round() as u8;
    Some(map.map(|normal| normal.map(code)))
}
