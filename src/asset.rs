//! The content of a `.tsuya` file, in memory.

use crate::brdf::binding::TriangleBinding;
use crate::brdf::materials::NamedMaterial;
use crate::lighting::EnvironmentLobes;
use crate::mesh::{CornerCoordinates, Mesh};
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::charts::Charts;
use crate::surface::displacement::DisplacedMesh;
use crate::views::{Component, Photograph, View};
use crate::visibility::Visibility;

/// A decoded file: everything that rendering, export and comparison need.
#[derive(Debug, Clone, Default)]
pub struct Asset {
    /// Descriptive metadata, a JSON object; unknown keys are kept.
    pub metadata: serde_json::Map<String, serde_json::Value>,
    /// The mesh; empty in a file that carries none.
    pub mesh: Mesh,
    /// Atlas layout of the reflectance.
    pub charts: Option<Charts>,
    /// The surface, where the file has it finer than the mesh.
    pub surface: Option<DisplacedMesh>,
    /// Fitted reflectance.
    pub reflectance: Option<ReflectanceMaps>,
    /// Radiance of the white board under the unpolarised light: the unit of `sqrt(x / white)`.
    pub white: [f64; 3],
    /// The components each view holds, in this order.
    pub components: Vec<Component>,
    /// Captured views in the capture's order.
    pub views: Vec<View>,
    /// Decoded photographs, parallel to `views`; `None` for views that were not selected.
    pub photographs: Vec<Option<Photograph>>,
    /// Materials by name, fitted or modelled.
    pub materials: Vec<NamedMaterial>,
    /// Which of them the mesh's triangles take.
    pub binding: Option<TriangleBinding>,
    /// Texture coordinates of the corners of the mesh's triangles, `v` upwards: they say which way the surface's first axis goes.
    pub coordinates: Option<Vec<CornerCoordinates>>,
    /// Visibility of directions from the mesh's vertices or samples.
    pub visibility: Option<Visibility>,
    /// Light to show the object in.
    pub light: Option<EnvironmentLobes>,
}

impl Asset {
    /// Returns whether materials are bound to the mesh: then they are what is drawn, whatever was captured.
    pub fn is_modelled(&self) -> bool {
        self.binding.is_some()
    }
}
