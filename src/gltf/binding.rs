//! Whether a document's mesh is the one that a stream was captured with: by texture coordinates, never by the order of vertices.

use super::accessor;
use super::document::{ExternalFiles, GltfDocument};
use crate::error::Result;
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::surface::atlas::{AtlasRaster, rasterise_atlas_within};
use crate::surface::charts::Charts;
use crate::surface::charts::NONE;
use glam::{DMat3, DVec3};
use serde_json::Map;
use serde_json::Value;

/// Vertices of a primitive that are looked at, at most.
const SAMPLES: usize = 4096;
/// Largest error of the best affine map from the document's vertices to the stream's surface, as a share of the surface's size.
const TOLERANCE: f64 = 0.02;
/// Smallest share of vertices whose texture coordinates lie on the surface's atlas.
const MIN_ON_ATLAS: f64 = 0.95;

/// Agreement of a document's mesh with a stream's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeshFit {
    /// One mesh, moved or quantised at most: the root mean square distance as a share of the mesh's size.
    Same(f64),
    /// Another mesh.
    Other(f64),
    /// The document's mesh is compressed, or has no such texture coordinates: can't be said.
    Unknown,
}

/// Compares the vertices that use `materials` with the surface that the stream has at their texture coordinates. Any affine map between
/// them is allowed, one for each primitive, since tools move, scale and quantise meshes.
pub fn compare_mesh(
    document: &GltfDocument,
    materials: &[usize],
    binding: &MaterialBinding,
    mesh: &Mesh,
    charts: &Charts,
    files: ExternalFiles<'_>,
    budget: &Budget,
) -> Result<MeshFit> {
    let raster = rasterise_atlas_within(mesh, charts, budget)?;
    let (mut seen, mut missed, mut error, mut spread) = (0usize, 0usize, 0.0, 0.0);
    let middle = mean(&mesh.positions.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect::<Vec<_>>());
    for primitive in document.list("meshes").iter().filter_map(|m| m.get("primitives")?.as_array()).flatten() {
        let uses = |index: u64| materials.iter().any(|&material| material as u64 == index);
        if !primitive.get("material").and_then(Value::as_u64).is_some_and(uses) {
            continue;
        }
        let attribute = |name: &str| primitive.get("attributes")?.get(name)?.as_u64();
        let coordinates = attribute(&format!("TEXCOORD_{}", binding.tex_coord()));
        let (Some(positions), Some(coordinates)) = (attribute("POSITION"), coordinates) else { continue };
        let positions = accessor::read_accessor::<3>(document, positions, files, budget)?;
        let coordinates = accessor::read_accessor::<2>(document, coordinates, files, budget)?;
        let (Some(positions), Some(coordinates)) = (positions, coordinates) else { continue };
        if positions.len() != coordinates.len() {
            return Err(document.wrong("a primitive's positions and texture coordinates differ in number"));
        }
        let (mut from, mut to) = (Vec::new(), Vec::new());
        for k in (0..positions.len()).step_by(positions.len().div_ceil(SAMPLES).max(1)) {
            let place = DVec3::from_array(positions[k]);
            match surface_point(mesh, charts, &raster, binding.transform_coordinate(coordinates[k])) {
                Some(point) if place.is_finite() => {
                    from.push(place);
                    to.push(point);
                }
                _ => missed += 1,
            }
        }
        seen += from.len();
        error += affine_residual(&from, &to);
        spread += to.iter().map(|p| p.distance_squared(middle)).sum::<f64>();
    }
    if seen + missed == 0 {
        return Ok(MeshFit::Unknown);
    }
    let share = if spread > 0.0 { (error / spread).sqrt() } else { 1.0 };
    let on_atlas = seen as f64 / (seen + missed) as f64;
    Ok(if on_atlas >= MIN_ON_ATLAS && share <= TOLERANCE { MeshFit::Same(share) } else { MeshFit::Other(share) })
}

/// World position of the surface at a texture coordinate; `None` beside the charts.
fn surface_point(mesh: &Mesh, charts: &Charts, raster: &AtlasRaster, at: [f64; 2]) -> Option<DVec3> {
    let at = [at[0] * charts.width as f64, at[1] * charts.height as f64];
    let index =
        |x: f64, size: u32| (x >= -1.0 && x < size as f64 + 1.0).then(|| (x.max(0.0) as usize).min(size as usize - 1));
    let texel = index(at[1], charts.height)? * charts.width as usize + index(at[0], charts.width)?;
    let triangle = *raster.triangle.data.get(texel).filter(|&&t| t != NONE)? as usize;
    // Charts are parallel projections, so that a triangle's plane goes on beyond it.
    let [a, b, c] = charts.corners(mesh, triangle);
    let cross = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let area = cross(a, b, c);
    let weights = [cross(at, b, c) / area, cross(a, at, c) / area, cross(a, b, at) / area];
    let corners = mesh.triangles[triangle].map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
    let point: DVec3 = (0..3).map(|k| weights[k] * corners[k]).sum();
    point.is_finite().then_some(point)
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len().max(1) as f64
}

/// Sum of the squared distances that the best affine map leaves.
fn affine_residual(from: &[DVec3], to: &[DVec3]) -> f64 {
    let (middle_from, middle_to) = (mean(from), mean(to));
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    let (mut square, mut product) = (DMat3::ZERO, DMat3::ZERO);
    for (&x, &y) in from.iter().zip(to) {
        square += outer(x - middle_from, x - middle_from);
        product += outer(y - middle_to, x - middle_from);
    }
    // Flat meshes leave one direction free.
    let trace = square.x_axis.x + square.y_axis.y + square.z_axis.z;
    let map = product * (square + DMat3::from_diagonal(DVec3::splat(1e-12 * trace + 1e-300))).inverse();
    let gap = |(&x, &y): (&DVec3, &DVec3)| (map * (x - middle_from)).distance_squared(y - middle_to);
    from.iter().zip(to).map(gap).sum()
}

/// Mapping of texture coordinates to the atlas: the set and the transform of a `textureInfo` object.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MaterialBinding {
    /// `texCoord` and `extensions.KHR_texture_transform`, as in glTF.
    pub(super) info: Map<String, Value>,
}

impl MaterialBinding {
    /// Takes `texCoord` and `KHR_texture_transform` of any `textureInfo` object.
    pub fn from_texture_info(info: &Map<String, Value>) -> Self {
        let mut kept = Map::new();
        if let Some(set) = info.get("texCoord") {
            kept.insert("texCoord".into(), set.clone());
        }
        if let Some(transform) = info.get("extensions").and_then(|e| e.get("KHR_texture_transform")) {
            kept.insert("extensions".into(), serde_json::json!({"KHR_texture_transform": transform}));
        }
        MaterialBinding { info: kept }
    }

    pub(super) fn texture_transform(&self) -> Option<&Value> {
        self.info.get("extensions")?.get("KHR_texture_transform")
    }

    /// Which `TEXCOORD_n`.
    pub fn tex_coord(&self) -> u64 {
        let overridden = self.texture_transform().and_then(|transform| transform.get("texCoord"));
        overridden.or(self.info.get("texCoord")).and_then(Value::as_u64).unwrap_or(0)
    }

    /// A texture coordinate as `KHR_texture_transform` changes it.
    pub fn transform_coordinate(&self, at: [f64; 2]) -> [f64; 2] {
        let transform = self.texture_transform();
        let number =
            |key: &str, k: usize, default: f64| transform.and_then(|t| t.get(key)?.get(k)?.as_f64()).unwrap_or(default);
        let rotation = transform.and_then(|t| t.get("rotation")?.as_f64()).unwrap_or(0.0);
        let (sin, cos) = rotation.sin_cos();
        let (u, v) = (at[0] * number("scale", 0, 1.0), at[1] * number("scale", 1, 1.0));
        // Counter-clockwise on the image, whose v goes down.
        [cos * u + sin * v + number("offset", 0, 0.0), cos * v - sin * u + number("offset", 1, 0.0)]
    }
}
