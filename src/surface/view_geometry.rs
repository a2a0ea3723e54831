//! The surface as a view sees it: nearest triangle, depth and normal of every pixel (normative, `spec/planes.md`).

use super::raster::{self, Raster};
use crate::mesh::Mesh;
use crate::transform::shape_adaptive::PixelRun;
use crate::transform::window::Window;
use crate::vector::dot;
use crate::views::View;
use std::borrow::Cow;

/// A mesh with its vertex normals.
#[derive(Debug)]
pub(crate) struct ViewedMesh<'a> {
    mesh: Cow<'a, Mesh>,
    normals: Vec<[f64; 3]>,
}

impl<'a> ViewedMesh<'a> {
    /// Prepares a mesh.
    pub(crate) fn new(mesh: Cow<'a, Mesh>) -> Self {
        ViewedMesh { normals: raster::vertex_normals(&mesh), mesh }
    }
    /// The mesh.
    pub(crate) fn mesh(&self) -> &Mesh {
        &self.mesh
    }
}

/// The surface in a view.
#[derive(Debug, Clone)]
pub(crate) struct ViewGeometry {
    /// The view.
    pub view: View,
    /// Nearest triangle, depth and barycentrics of each pixel.
    pub raster: Raster,
    /// Unit normal of each pixel, interpolated between the vertices; zero where the mesh is missed.
    pub(super) normals: Vec<[f32; 3]>,
}

/// Pixels of the mask beside the mesh take the depth of their neighbours, this many rings far.
const DEPTH_RINGS: usize = 8;

impl ViewGeometry {
    /// Draws the surface into a view.
    pub(crate) fn new(surface: &ViewedMesh, view: View) -> Self {
        let raster = raster::rasterise(&surface.mesh, &view.camera);
        let normals = (raster.triangle.iter().zip(&raster.barycentric))
            .map(|(&triangle, b)| {
                if triangle == raster::NO_TRIANGLE {
                    return [0.0; 3];
                }
                let (b1, b2) = (b[0] as f64, b[1] as f64);
                let corners = surface.mesh.triangles[triangle as usize];
                interpolated_normal(corners, [1.0 - b1 - b2, b1, b2], &surface.normals)
            })
            .collect();
        ViewGeometry { view, raster, normals }
    }

    /// Unit normal of a pixel, zero where the mesh is missed.
    #[inline(always)]
    pub(crate) fn normal(&self, pixel: usize) -> [f32; 3] {
        self.normals[pixel]
    }

    /// Gives the mask's pixels (`rows` of a window) that miss the mesh the mean depth and normal of their neighbours, ring by
    /// ring.
    pub(crate) fn extend(&mut self, window: &Window, rows: &[PixelRun]) {
        let (width, height) = (self.raster.width, self.raster.height);
        let mut missing = Vec::new();
        for run in rows {
            let at = (window.top + run.line as usize) * width + window.left + run.start as usize;
            missing.extend((at..at + run.length as usize).filter(|&at| self.raster.depth[at] == 0.0));
        }
        for _ in 0..DEPTH_RINGS {
            let mut ring = Vec::new();
            missing.retain(|&at| {
                let (mut depth, mut normal, mut count) = (0.0, [0.0f32; 3], 0.0f32);
                for_neighbours(at, width, height, |other| {
                    if self.raster.depth[other] > 0.0 {
                        depth += self.raster.depth[other];
                        for k in 0..3 {
                            normal[k] += self.normals[other][k];
                        }
                        count += 1.0;
                    }
                });
                if count > 0.0 {
                    ring.push((at, depth / count as f64, normal.map(|v| v / count)));
                }
                count == 0.0
            });
            if ring.is_empty() {
                break;
            }
            for (at, depth, normal) in ring {
                self.raster.depth[at] = depth;
                self.normals[at] = normal;
            }
        }
    }
}

/// Unit normal at a place of a triangle, interpolated between those of its vertices.
#[inline(always)]
pub(crate) fn interpolated_normal(corners: [u32; 3], [a, b, c]: [f64; 3], normals: &[[f64; 3]]) -> [f32; 3] {
    let corners = corners.map(|v| normals[v as usize]);
    let n: [f64; 3] = std::array::from_fn(|k| a * corners[0][k] + b * corners[1][k] + c * corners[2][k]);
    let length = dot(n, n).sqrt();
    if length > 0.0 { n.map(|v| (v / length) as f32) } else { [0.0; 3] }
}

/// Calls `visit` for the up to eight neighbours of a pixel, row by row.
#[inline(always)]
pub(super) fn for_neighbours(at: usize, width: usize, height: usize, mut visit: impl FnMut(usize)) {
    let (x, y) = (at % width, at / width);
    for ny in y.saturating_sub(1)..(y + 2).min(height) {
        for nx in x.saturating_sub(1)..(x + 2).min(width) {
            if (nx, ny) != (x, y) {
                visit(ny * width + nx);
            }
        }
    }
}
