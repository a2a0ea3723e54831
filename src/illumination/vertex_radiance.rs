//! Radiance of a mesh's vertices in all photographs, as sums that do not grow with their number.

use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::parallel;
use crate::reflectance::sightings::{OpenedView, Place, radiance_at};
use crate::surface::raster::vertex_normals;
use crate::views::source::{PhotographSource, open_run, open_together};
use crate::views::{Component, View};

/// Vertices that are worked on at a time.
const CHUNK: usize = 512;
/// Radiance below this share of the mean counts as that much, so that its logarithm exists.
const FLOOR: f32 = 1e-6;

/// The vertices of a mesh and what the photographs show of them.
pub(super) struct VertexRadiance {
    /// Position and unit normal.
    pub(super) places: Vec<Place>,
    /// Geometric mean of the radiance over the photographs that show the vertex: highlights count little in it. `None` where none does.
    pub(super) radiance: Vec<Option<[f32; 3]>>,
}

#[derive(Clone, Copy, Default)]
struct LogSum {
    sum: [f64; 3],
    count: u32,
}

impl VertexRadiance {
    /// # Errors
    /// Those of opening photographs; [`Error::Parameter`] if none shows a vertex.
    pub(super) fn gather(
        mesh: &Mesh,
        views: &[View],
        components: &[Component],
        photographs: &dyn PhotographSource,
    ) -> Result<Self> {
        let normals = vertex_normals(mesh);
        let places: Vec<Place> =
            mesh.positions.iter().zip(normals).map(|(point, normal)| (point.map(f64::from), normal)).collect();
        let shown = super::matte(components);
        let mut sums = vec![LogSum::default(); places.len()];
        for run in open_together(views, photographs.at_once()) {
            let opened = open_run(photographs, &run)?;
            let drawn = parallel::map(run.len(), |k| OpenedView::new(mesh, &views[run.start + k], &opened[k]));
            parallel::for_each_chunk(&mut sums, CHUNK, |chunk, sums| {
                for (sum, place) in sums.iter_mut().zip(&places[chunk * CHUNK..]) {
                    for view in &drawn {
                        let Some(radiance) = radiance_at(view, place) else { continue };
                        (0..3).for_each(|c| sum.sum[c] += f64::from(radiance[shown][c].max(FLOOR).ln()));
                        sum.count += 1;
                    }
                }
            });
        }
        let mean = |sum: &LogSum| (sum.count > 0).then(|| sum.sum.map(|x| (x / f64::from(sum.count)).exp() as f32));
        let radiance: Vec<_> = sums.iter().map(mean).collect();
        if radiance.iter().all(Option::is_none) {
            return Err(Error::parameter(
                "option `light`: no photograph shows a vertex of the mesh to tell the light by; check masks and mesh",
            ));
        }
        Ok(VertexRadiance { places, radiance })
    }

    /// The radiance of every vertex, that of unseen ones from their neighbours.
    pub(super) fn filled(&self, mesh: &Mesh) -> Vec<[f32; 3]> {
        let mut filled = self.radiance.clone();
        while filled.iter().any(Option::is_none) {
            let mut sums = vec![([0f32; 3], 0f32); filled.len()];
            for corners in &mesh.triangles {
                for (a, b) in [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)] {
                    let (to, from) = (corners[a] as usize, corners[b] as usize);
                    if let (None, Some(radiance)) = (filled[to], filled[from]) {
                        (0..3).for_each(|c| sums[to].0[c] += radiance[c]);
                        sums[to].1 += 1.0;
                    }
                }
            }
            let mut grown = false;
            for (radiance, (sum, count)) in filled.iter_mut().zip(sums) {
                if radiance.is_none() && count > 0.0 {
                    *radiance = Some(sum.map(|x| x / count));
                    grown = true;
                }
            }
            if !grown {
                break;
            }
        }
        let seen: Vec<[f32; 3]> = filled.iter().flatten().copied().collect();
        let mean = std::array::from_fn(|c| seen.iter().map(|r| r[c]).sum::<f32>() / seen.len().max(1) as f32);
        filled.into_iter().map(|radiance| radiance.unwrap_or(mean)).collect()
    }
}
