//! What some photographs show of some points of the surface: enough to tell a light by, and no more for more photographs.

use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::parallel;
use crate::reflectance::sightings::{OpenedView, Place, radiance_at};
use crate::surface::atlas::smooth_normal;
use crate::surface::raster::vertex_normals;
use crate::views::source::{PhotographSource, open_together};
use crate::views::{Camera, Component, View};
use glam::DVec3;

/// Points on the surface.
const POINTS: usize = 6000;
/// Photographs that are looked at, at most, evenly spread.
const VIEWS: usize = 240;

/// Radiance of points of the surface in photographs.
#[derive(Debug)]
pub(crate) struct LightEvidence {
    /// The points, spread evenly over the surface, with their normals.
    pub(super) points: Vec<Place>,
    /// Cameras of the photographs that were looked at.
    pub(super) cameras: Vec<Camera>,
    /// By point.
    pub(super) sightings: Vec<Vec<LightSighting>>,
}

/// A point in a photograph.
#[derive(Debug, Clone, Copy)]
pub(super) struct LightSighting {
    /// Which of [`LightEvidence::cameras`].
    pub(super) camera: u32,
    /// Radiance of the diffuse component, or of both.
    pub(super) radiance: [f32; 3],
}

impl LightEvidence {
    /// Looks at the photographs, a few side by side.
    /// # Errors
    /// Those of opening photographs; [`Error::Parameter`] if none shows the mesh.
    pub(crate) fn gather(
        mesh: &Mesh,
        views: &[View],
        components: &[Component],
        photographs: &dyn PhotographSource,
    ) -> Result<Self> {
        let points = spread_points(mesh, POINTS);
        let chosen: Vec<usize> =
            (0..views.len().min(VIEWS)).map(|k| k * views.len() / views.len().min(VIEWS)).collect();
        let looked_at: Vec<View> = chosen.iter().map(|&view| views[view].clone()).collect();
        let shown = super::matte(components);
        let mut sightings = vec![Vec::new(); points.len()];
        for run in open_together(&looked_at, photographs.at_once()) {
            let opened = parallel::map(run.len(), |k| photographs.photograph(chosen[run.start + k]));
            let opened = opened.into_iter().collect::<Result<Vec<_>>>()?;
            let drawn = parallel::map(run.len(), |k| OpenedView::new(mesh, &looked_at[run.start + k], &opened[k]));
            let seen = parallel::map(run.len(), |k| {
                points.iter().map(|place| radiance_at(&drawn[k], place)).collect::<Vec<_>>()
            });
            for (camera, seen) in run.zip(&seen) {
                for (list, radiance) in sightings.iter_mut().zip(seen) {
                    let Some(radiance) = radiance else { continue };
                    list.push(LightSighting { camera: camera as u32, radiance: radiance[shown] });
                }
            }
        }
        if sightings.iter().all(Vec::is_empty) {
            return Err(Error::parameter(
                "option `light`: no photograph shows a point of the mesh to tell the light by; check masks and mesh",
            ));
        }
        Ok(LightEvidence { points, cameras: looked_at.iter().map(|view| view.camera).collect(), sightings })
    }
}

/// Points spread evenly over a mesh, each with its interpolated normal: evenly along the triangles' summed areas, within a triangle by the
/// sequence R2 (Roberts 2018).
fn spread_points(mesh: &Mesh, count: usize) -> Vec<Place> {
    const STEPS: [f64; 2] = [0.7548776662466927, 0.5698402909980532];
    let corner = |v: u32| DVec3::from_array(mesh.positions[v as usize].map(f64::from));
    let normals = vertex_normals(mesh);
    let mut sum = 0.0;
    let mut until = Vec::with_capacity(mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        sum += (corner(b) - corner(a)).cross(corner(c) - corner(a)).length();
        until.push(sum);
    }
    let place = |k: usize| {
        let at = (k as f64 + 0.5) / count as f64 * sum;
        let corners = mesh.triangles[until.partition_point(|&end| end <= at).min(until.len() - 1)];
        let [mut s, mut t] = STEPS.map(|step| (k as f64 * step).fract());
        if s + t > 1.0 {
            [s, t] = [1.0 - s, 1.0 - t];
        }
        let weights = [1.0 - s - t, s, t];
        let point: DVec3 = (0..3).map(|k| weights[k] * corner(corners[k])).sum();
        (point.to_array(), smooth_normal(corners, weights, &normals).to_array())
    };
    if until.is_empty() { Vec::new() } else { (0..count).map(place).collect() }
}
