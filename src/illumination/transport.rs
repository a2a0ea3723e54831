//! Light that reaches vertices of a mesh: from the lobes of an environment where nothing is in the way, from the object itself where it is.

use crate::lighting::SphericalGaussian;
use crate::mesh::Mesh;
use crate::reflectance::sightings::Place;
use crate::surface::occluders::Occluders;
use crate::vector::dot;
use std::f64::consts::PI;

/// Lobes of the environment: as many as section `lIGt` holds.
pub(super) const LOBES: usize = 64;
/// Rays of all vertices together, about, and the bounds of those of one.
const RAYS: usize = 1 << 25;
const RAYS_OF_ONE: [usize; 2] = [96, 512];
/// Rays start at this share of the mesh's diagonal above the surface.
const ABOVE: f64 = 5e-4;

/// Rays from the vertices of a mesh.
pub(super) struct VertexRays<'a> {
    mesh: &'a Mesh,
    occluders: Occluders,
    above: f64,
    directions: Vec<[f64; 3]>,
    /// For each direction the radiance of each lobe of amplitude 1.
    shapes: Vec<[f32; LOBES]>,
}

/// Irradiance of a vertex by each lobe of amplitude 1, and by the object itself.
#[derive(Clone)]
pub(super) struct VertexTransport {
    pub(super) lobes: [f32; LOBES],
    pub(super) bounce: [f32; 3],
}

impl<'a> VertexRays<'a> {
    /// `lobes` are the environment's axes and sharpness; [`LOBES`] of them count.
    pub(super) fn new(mesh: &'a Mesh, lobes: &[SphericalGaussian]) -> Self {
        let [least, most] = RAYS_OF_ONE;
        let count = (RAYS / mesh.positions.len().max(1)).clamp(least, most);
        let directions: Vec<[f64; 3]> = crate::lighting::fit::spread_directions(count).collect();
        let shape = |direction: &[f64; 3]| {
            std::array::from_fn(|k| {
                lobes.get(k).map_or(0.0, |lobe| (lobe.sharpness * (dot(lobe.axis, *direction) - 1.0)).exp() as f32)
            })
        };
        let shapes = directions.iter().map(shape).collect();
        VertexRays { mesh, occluders: Occluders::new(mesh), above: ABOVE * mesh.diagonal(), directions, shapes }
    }

    /// Calls `free(direction, weight)` for each ray of a place that leaves the object, and returns the irradiance by what the others meet, of
    /// vertices' `radiance`. The weight is the cosine times the solid angle.
    fn cast(&self, (point, normal): Place, radiance: &[[f32; 3]], mut free: impl FnMut(usize, f32)) -> [f32; 3] {
        let start = std::array::from_fn(|k| (point[k] + self.above * normal[k]) as f32);
        let angle = 4.0 * PI / self.directions.len() as f64;
        let mut bounce = [0f32; 3];
        for (k, direction) in self.directions.iter().enumerate() {
            let weight = (angle * dot(normal, *direction)) as f32;
            if weight <= 0.0 {
                continue;
            }
            match self.occluders.first_hit_from(start, direction.map(|x| x as f32)) {
                None => free(k, weight),
                Some((triangle, weights)) => {
                    for (&corner, share) in self.mesh.triangles[triangle as usize].iter().zip(weights) {
                        (0..3).for_each(|c| bounce[c] += weight * share as f32 * radiance[corner as usize][c]);
                    }
                }
            }
        }
        bounce
    }

    /// Returns how light comes to a place.
    pub(super) fn transport(&self, place: Place, radiance: &[[f32; 3]]) -> VertexTransport {
        let mut lobes = [0f32; LOBES];
        let bounce = self.cast(place, radiance, |k, weight| {
            lobes.iter_mut().zip(&self.shapes[k]).for_each(|(sum, shape)| *sum += weight * shape);
        });
        VertexTransport { lobes, bounce }
    }

    /// Returns the irradiance of a place under lobes of these amplitudes.
    pub(super) fn irradiances(
        &self,
        places: &[Place],
        radiance: &[[f32; 3]],
        amplitudes: &[[f64; 3]; LOBES],
    ) -> Vec<[f32; 3]> {
        let sky: Vec<[f32; 3]> = (self.shapes.iter())
            .map(|shape| std::array::from_fn(|c| (0..LOBES).map(|l| shape[l] * amplitudes[l][c] as f32).sum::<f32>()))
            .collect();
        crate::parallel::map(places.len(), |k| {
            let mut sum = [0f32; 3];
            let bounce = self.cast(places[k], radiance, |k, weight| {
                (0..3).for_each(|c| sum[c] += weight * sky[k][c]);
            });
            std::array::from_fn(|c| sum[c] + bounce[c])
        })
    }
}
