//! Z-buffer rasterisation of a mesh, one sample at each pixel centre.
//!
//! Decoded pictures are predicted from what this module computes, so it must give the same result everywhere: it uses
//! IEEE double with `+ - * /` and comparisons only, in the order written (normative, `spec/planes.md`).

use crate::error::Result;
use crate::image::Mask;
#[cfg(feature = "encode")]
use crate::image::MaskRuns;
use crate::limits::check;
use crate::mesh::Mesh;
use crate::parallel;
use crate::vector::cross;
use crate::views::{Camera, View};

/// No triangle at a pixel.
pub(crate) const NO_TRIANGLE: u32 = u32::MAX;

/// First intersection of each pixel's central ray.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Index of the triangle, [`NO_TRIANGLE`] where the ray misses the mesh.
    pub triangle: Vec<u32>,
    /// Camera-space z of the point; the world point is `centre + depth * ray`. 0 where the ray misses.
    pub depth: Vec<f64>,
    /// Perspective-correct barycentric coordinates of the triangle's second and third corner.
    pub barycentric: Vec<[f32; 2]>,
}

impl Raster {
    /// Pixels whose central ray meets the mesh.
    pub fn coverage(&self) -> Mask {
        let data = self.triangle.iter().map(|&triangle| triangle != NO_TRIANGLE).collect();
        Mask { width: self.width, height: self.height, data }
    }
    /// Whether the central ray of pixel `index` meets the mesh.
    pub fn is_covered(&self, index: usize) -> bool {
        self.triangle[index] != NO_TRIANGLE
    }
}

/// Returns the pixels that the mesh covers, by view.
pub fn coverage(mesh: &Mesh, views: &[View]) -> Vec<Mask> {
    parallel::map(views.len(), |index| rasterise(mesh, &views[index].camera).coverage())
}

/// Returns the pixels that the mesh covers, by view, in little memory.
#[cfg(feature = "encode")]
pub fn coverage_runs(mesh: &Mesh, views: &[View]) -> Vec<MaskRuns> {
    parallel::map(views.len(), |index| MaskRuns::new(&rasterise(mesh, &views[index].camera).coverage()))
}

/// Nearest depth drawn, as a share of the mesh's farthest vertex; triangles that reach nearer are dropped.
const NEAR: f64 = 1e-6;

/// Image positions, depths and one over these of the mesh's vertices.
fn project(mesh: &Mesh, camera: &Camera) -> Vec<[f64; 4]> {
    let project = |p: &[f32; 3]| {
        let q = camera.to_camera(p.map(f64::from));
        let inverse = 1.0 / q[2];
        [
            camera.focal[0] * q[0] * inverse + camera.principal[0],
            camera.focal[1] * q[1] * inverse + camera.principal[1],
            q[2],
            inverse,
        ]
    };
    mesh.positions.iter().map(project).collect()
}

/// The first pixel whose centre lies at or behind an image position, at least 0.
#[inline(always)]
fn pixel_from(position: f64) -> usize {
    let position = position - 0.5;
    let before = if position > 0.0 { (position as usize).min(1 << 30) } else { 0 };
    before + ((before as f64) < position) as usize
}

// Comparisons, not `f64::min` and `max`: those are calls where the processor's instructions treat NaN otherwise.
#[inline(always)]
fn min(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}
#[inline(always)]
fn max(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// The edge between two corners, evaluated from its lower vertex index, so that both triangles at an edge round alike and leave no crack.
struct Edge {
    from: [f64; 2],
    along: [f64; 2],
    sign: f64,
}

impl Edge {
    #[inline(always)]
    fn new(vertices: &[u32; 3], corners: &[[f64; 4]; 3], i: usize, j: usize) -> Self {
        let (a, b, sign) = match vertices[i] <= vertices[j] {
            true => (&corners[i], &corners[j], 1.0),
            false => (&corners[j], &corners[i], -1.0),
        };
        Edge { from: [a[0], a[1]], along: [b[0] - a[0], b[1] - a[1]], sign }
    }
    /// The product that is the same for a row.
    #[inline(always)]
    fn row(&self, y: f64) -> f64 {
        self.along[0] * (y - self.from[1])
    }
    /// On which side a pixel's centre lies, and how far: `sign * (along[0] * (y - from[1]) - along[1] * (x - from[0]))`.
    #[inline(always)]
    fn at(&self, row: f64, x: f64) -> f64 {
        self.sign * (row - self.along[1] * (x - self.from[0]))
    }
}

/// Draws the mesh as `camera` sees it. Triangles are two-sided; of equally near ones the first in the mesh wins.
pub fn rasterise(mesh: &Mesh, camera: &Camera) -> Raster {
    draw(mesh, camera, f64::INFINITY, false).0
}

/// Draws those triangles of a mesh that face the camera as [`rasterise`] does, unless it takes unreasonably long; see [`check_work`].
/// # Errors
/// [`crate::Error::Limits`] for thousands of triangles that each fill the picture.
pub(crate) fn rasterise_facing(mesh: &Mesh, camera: &Camera) -> Result<Raster> {
    let pixels = camera.width as f64 * camera.height as f64;
    let (raster, work) = draw(mesh, camera, MAX_LAYERS * pixels, true);
    check_layers(work, pixels)?;
    Ok(raster)
}

/// Draws triangles, all or those whose corners run counter-clockwise, until their bounds hold more than `most` pixels together; returns how many
/// these were, too.
fn draw(mesh: &Mesh, camera: &Camera, most: f64, is_facing: bool) -> (Raster, f64) {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut inverse_depth = vec![0.0f64; width * height];
    let mut triangle = vec![NO_TRIANGLE; width * height];
    let mut barycentric = vec![[0.0f32; 2]; width * height];
    let projected = project(mesh, camera);
    let farthest = projected.iter().fold(0.0f64, |far, p| if p[2] > far { p[2] } else { far });
    let near = NEAR * farthest;
    let mut work = 0.0;
    for (index, corners) in mesh.triangles.iter().enumerate() {
        let c = corners.map(|v| projected[v as usize]);
        if !(c[0][2] > near && c[1][2] > near && c[2][2] > near) {
            continue;
        }
        // Rows run downwards, and so what runs counter-clockwise has a negative area.
        let side = |k: usize, axis: usize| c[k][axis] - c[0][axis];
        if is_facing && side(1, 0) * side(2, 1) - side(2, 0) * side(1, 1) >= 0.0 {
            continue;
        }
        // Pixels whose centres lie within the bounds.
        let bounds = |axis: usize, size: usize| {
            let [a, b, c] = [c[0][axis], c[1][axis], c[2][axis]];
            let end = max(max(a, b), c) + 0.5;
            let end = if end > 0.0 { (end as usize).min(size) } else { 0 };
            pixel_from(min(min(a, b), c))..end
        };
        let (columns, rows) = (bounds(0, width), bounds(1, height));
        if columns.is_empty() || rows.is_empty() {
            continue;
        }
        work += columns.len() as f64 * rows.len() as f64;
        if work > most {
            break;
        }
        let edges = [Edge::new(corners, &c, 1, 2), Edge::new(corners, &c, 2, 0), Edge::new(corners, &c, 0, 1)];
        let inverse = [c[0][3], c[1][3], c[2][3]];
        for y in rows {
            let py = y as f64 + 0.5;
            let parts = [edges[0].row(py), edges[1].row(py), edges[2].row(py)];
            let row = y * width + columns.start..y * width + columns.end;
            let drawn = (inverse_depth[row.clone()].iter_mut())
                .zip(&mut triangle[row.clone()])
                .zip(&mut barycentric[row])
                .zip(columns.clone());
            for (((inverse_depth, triangle), barycentric), x) in drawn {
                let px = x as f64 + 0.5;
                let (e0, e1) = (edges[0].at(parts[0], px), edges[1].at(parts[1], px));
                // On different sides of two edges is outside.
                if (e0 > 0.0 && e1 < 0.0) || (e0 < 0.0 && e1 > 0.0) {
                    continue;
                }
                let e = [e0, e1, edges[2].at(parts[2], px)];
                let inside = (e[0] >= 0.0 && e[1] >= 0.0 && e[2] >= 0.0) || (e[0] <= 0.0 && e[1] <= 0.0 && e[2] <= 0.0);
                let area = e[0] + e[1] + e[2];
                if !inside || area == 0.0 {
                    continue;
                }
                let weights = [e[0] * inverse[0], e[1] * inverse[1], e[2] * inverse[2]];
                let sum = weights[0] + weights[1] + weights[2];
                let here = sum / area;
                if here > *inverse_depth {
                    *inverse_depth = here;
                    *triangle = index as u32;
                    *barycentric = [(weights[1] / sum) as f32, (weights[2] / sum) as f32];
                }
            }
        }
    }
    let depth = inverse_depth.iter().map(|&d| if d > 0.0 { 1.0 / d } else { 0.0 }).collect();
    (Raster { width, height, triangle, depth, barycentric }, work)
}

/// Most pixels that all triangles' bounds may hold together, for each pixel of the picture.
const MAX_LAYERS: f64 = 4096.0;

/// Refuses a mesh and camera whose drawing would take unreasonably long: thousands of triangles that each fill the picture.
pub(crate) fn check_work(mesh: &Mesh, camera: &Camera) -> Result<()> {
    let size = [camera.width as f64, camera.height as f64];
    let pixels = size[0] * size[1];
    let projected = project(mesh, camera);
    let mut work = 0.0;
    for corners in &mesh.triangles {
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for position in corners.map(|vertex| projected[vertex as usize]).iter().filter(|position| position[2] > 0.0) {
            for k in 0..2 {
                bounds[k] = [min(bounds[k][0], position[k]), max(bounds[k][1], position[k])];
            }
        }
        let side = |k: usize| max(min(bounds[k][1], size[k]) - max(bounds[k][0], 0.0), 0.0);
        work += side(0) * side(1);
    }
    check_layers(work, pixels)
}

fn check_layers(work: f64, pixels: f64) -> Result<()> {
    check("layers of triangles over a picture", (work / pixels.max(1.0)).ceil() as u64, MAX_LAYERS as u64)
}

/// Unit normals of the vertices: the mean of the adjacent triangles' normals weighted by their areas, outward for
/// counter-clockwise triangles; `[0, 0, 0]` where they cancel. Summed in triangle order, so the same everywhere.
pub fn vertex_normals(mesh: &Mesh) -> Vec<[f64; 3]> {
    let mut normals = vec![[0.0f64; 3]; mesh.positions.len()];
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|v| mesh.positions[v as usize].map(f64::from));
        let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
        let n = cross(u, v);
        for &vertex in corners {
            for k in 0..3 {
                normals[vertex as usize][k] += n[k];
            }
        }
    }
    for n in &mut normals {
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        if length > 0.0 {
            *n = [n[0] / length, n[1] / length, n[2] / length];
        }
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Camera { width: 40, height: 30, focal: [50.0, 50.0], principal: [20.0, 15.0], rotation, translation: [0.0; 3] }
    }

    #[test]
    fn a_tilted_quad_has_no_crack_and_true_depth() {
        // Plane z = 2 + 0.5 x, cut along its diagonal, much larger than the picture.
        let corner = |x: f32, y: f32| [x, y, 2.0 + 0.5 * x];
        let mesh = Mesh {
            positions: vec![corner(-3.0, -3.0), corner(3.0, -3.0), corner(3.0, 3.0), corner(-3.0, 3.0)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let raster = rasterise(&mesh, &camera());
        for y in 0..30 {
            for x in 0..40 {
                let at = y * 40 + x;
                assert!(raster.is_covered(at), "hole at {x}, {y}");
                let slope = (x as f64 + 0.5 - 20.0) / 50.0;
                let expected = 2.0 / (1.0 - 0.5 * slope);
                assert!((raster.depth[at] - expected).abs() < 1e-6);
            }
        }
        assert!(raster.triangle.contains(&0) && raster.triangle.contains(&1));
    }

    #[test]
    fn the_nearer_triangle_hides_and_what_is_behind_is_dropped() {
        let positions =
            [5.0f32, 2.0, -1.0].into_iter().flat_map(|z| [[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 9.0, z]]).collect();
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]] };
        let raster = rasterise(&mesh, &camera());
        assert_eq!(raster.triangle[15 * 40 + 20], 1);
        assert!((raster.depth[15 * 40 + 20] - 2.0).abs() < 1e-12);
    }
}
