//! What a `.tsuya` file holds, in memory.

use crate::brdf::materials::NamedMaterial;
use crate::image::{Grid, Mask, RgbImage};
use crate::lighting::Light;
use crate::reflectance::palette::PaletteEntry;
use crate::visibility::Visibility;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Triangle mesh in world coordinates (the capture's unit). Triangles are counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices of the triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// A pinhole camera. Pixel (0, 0) covers `0..1` in both directions, centre 0.5.
///
/// OpenCV axes: x right, y down, z forward. A world point `p` has camera coordinates `q = rotation * p + translation`
/// and the image position `(fx q.x / q.z + cx, fy q.y / q.z + cy)`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Camera {
    /// Width of the picture in pixels.
    pub width: u32,
    /// Height of the picture in pixels.
    pub height: u32,
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub principal: [f64; 2],
    /// World to camera, rows.
    pub rotation: [[f64; 3]; 3],
    /// World to camera.
    pub translation: [f64; 3],
}

impl Camera {
    /// World to camera coordinates.
    pub fn to_camera(&self, p: [f64; 3]) -> [f64; 3] {
        let r = &self.rotation;
        std::array::from_fn(|i| r[i][0] * p[0] + r[i][1] * p[1] + r[i][2] * p[2] + self.translation[i])
    }
    /// Image position in pixels and depth of a world point; `None` behind the camera.
    pub fn project(&self, p: [f64; 3]) -> Option<([f64; 2], f64)> {
        let q = self.to_camera(p);
        (q[2] > 0.0).then(|| {
            ([self.focal[0] * q[0] / q[2] + self.principal[0], self.focal[1] * q[1] / q[2] + self.principal[1]], q[2])
        })
    }
    /// The camera's place in the world.
    pub fn centre(&self) -> [f64; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|i| -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]))
    }
    /// World direction (depth 1, not unit) of the ray through an image position.
    pub fn ray(&self, pixel: [f64; 2]) -> [f64; 3] {
        let q = [(pixel[0] - self.principal[0]) / self.focal[0], (pixel[1] - self.principal[1]) / self.focal[1], 1.0];
        let r = &self.rotation;
        std::array::from_fn(|i| r[0][i] * q[0] + r[1][i] * q[1] + r[2][i] * q[2])
    }
}

/// A point light: irradiance at distance `r` is `intensity / r^2`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PointLight {
    /// World position.
    pub position: [f64; 3],
    /// Radiant intensity, red, green, blue.
    pub intensity: [f64; 3],
}

/// One captured photograph's circumstances: a camera and, where it is known, its light.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Name of the photograph, as the capture calls it.
    pub name: String,
    /// Its camera.
    pub camera: Camera,
    /// Its light, where known.
    pub light: Option<PointLight>,
}

/// The turn, a unit quaternion x, y, z, w, that brings what is up in the photographs to +y; `None` where it is there but for
/// cameras that look a little down or up.
pub fn upright(views: &[View]) -> Option<[f32; 4]> {
    let up: DVec3 = views.iter().map(|view| -DVec3::from_array(view.camera.rotation[1])).sum();
    let up = up.try_normalize().filter(|up| up.y < 0.7)?;
    Some(DQuat::from_rotation_arc(up, DVec3::Y).normalize().as_quat().normalize().to_array())
}

/// Metres for one unit of world length, after the metadata's key `units`; 1 for units that are not metric or not known.
pub fn metres(metadata: &serde_json::Map<String, serde_json::Value>) -> f64 {
    match metadata.get("units").and_then(serde_json::Value::as_str) {
        Some("mm") => 0.001,
        Some("cm") => 0.01,
        _ => 1.0,
    }
}

/// What a set of photographs shows of the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Component {
    /// Diffuse reflection: the cross-polarised photograph over the board's `beta`.
    Diffuse,
    /// Specular reflection: unpolarised minus diffuse. Signed.
    Specular,
    /// Both together, of a capture without polarisers.
    Combined,
}

/// Where the triangles lie in a texture atlas: each chart is an orthographic projection along one axis of the world,
/// so that its texture coordinates follow from the mesh and four numbers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Charts {
    /// Width of the atlas in texels.
    pub width: u32,
    /// Height of the atlas in texels.
    pub height: u32,
    /// Texels for one unit of world length.
    pub texels_per_unit: f64,
    /// The charts.
    pub charts: Vec<Chart>,
    /// For each triangle of the mesh the index of its chart.
    pub chart_of_triangle: Vec<u32>,
}

/// One chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Chart {
    /// Direction the chart faces: 0 +x, 1 -x, 2 +y, 3 -y, 4 +z, 5 -z.
    pub facing: u8,
    /// Texel position of the world origin's projection (may lie outside the atlas).
    pub offset: [i32; 2],
}

impl Charts {
    /// Atlas position, in texels (texel centres at +0.5), of the three corners of a triangle.
    pub fn corners(&self, mesh: &Mesh, triangle: usize) -> [[f64; 2]; 3] {
        let chart = self.charts[self.chart_of_triangle[triangle] as usize];
        mesh.triangles[triangle].map(|vertex| {
            let p = mesh.positions[vertex as usize];
            let (u, v) = match chart.facing / 2 {
                0 => (p[1], p[2]),
                1 => (p[2], p[0]),
                _ => (p[0], p[1]),
            };
            // The far side is mirrored so that no chart is.
            let u = if chart.facing.is_multiple_of(2) { u as f64 } else { -(u as f64) };
            [
                u * self.texels_per_unit + chart.offset[0] as f64,
                v as f64 * self.texels_per_unit + chart.offset[1] as f64,
            ]
        })
    }
}

/// Fitted reflectance on the atlas of [`Charts`].
///
/// With a point light of intensity `L` at distance `r`: diffuse `K_d (L / r^2) cos(theta_i)`, specular
/// `K_s (L / r^2) / cos(theta_r) exp(-alpha^2 / (2 sigma^2))` (Miyazaki 2007, equations 7 and 8, after division by the
/// light's irradiance). Where the lights are unknown `diffuse` is the weighted mean radiance over the views, the others
/// are empty, and the object can't be relit. Where there is a palette, its lobes replace the specular formula, see
/// [`crate::reflectance::palette`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReflectanceMaps {
    /// Whether the lights were known, so that `diffuse` is a reflectance and not a radiance.
    pub relightable: bool,
    /// `K_d` per texel.
    pub diffuse: Grid<[f32; 3]>,
    /// `K_s` per texel; empty grid without a specular component.
    pub specular: Grid<[f32; 3]>,
    /// `sigma` per texel, radians; empty grid without a specular component.
    pub sigma: Grid<f32>,
    /// Shapes of highlights, by rising `sigma`; empty for those of Torrance and Sparrow.
    pub palette: Vec<PaletteEntry>,
}

/// A decoded file: everything that rendering, export and comparison need.
#[derive(Debug, Clone, Default)]
pub struct Asset {
    /// Descriptive metadata, a JSON object; unknown keys are kept.
    pub metadata: serde_json::Map<String, serde_json::Value>,
    /// The mesh; empty in a file that carries none.
    pub mesh: Mesh,
    /// Atlas layout of the reflectance.
    pub charts: Option<Charts>,
    /// Fitted reflectance.
    pub reflectance: Option<ReflectanceMaps>,
    /// Radiance of the white board under the unpolarised light: the unit of `sqrt(x / white)`.
    pub white: [f64; 3],
    /// The components each view holds, in this order.
    pub components: Vec<Component>,
    /// Captured views in the capture's order.
    pub views: Vec<View>,
    /// Decoded photographs, parallel to `views`; `None` for views that were not asked for.
    pub photographs: Vec<Option<Photograph>>,
    /// Fitted materials by name.
    pub materials: Vec<NamedMaterial>,
    /// What the mesh's vertices see.
    pub visibility: Option<Visibility>,
    /// Light to show the object in.
    pub light: Option<Light>,
}

/// One view's decoded pictures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Photograph {
    /// Pixels that show the object.
    pub mask: Mask,
    /// Linear radiance per component, parallel to [`Asset::components`]; zero outside the mask.
    pub images: Vec<RgbImage>,
}
