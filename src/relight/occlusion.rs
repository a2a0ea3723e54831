//! Signed spherical distances of all samples of a mesh, ready to be read in any direction.

use crate::sphere::octahedral;
use crate::sphere::octahedral::wrap;
use crate::surface::samples::SurfaceSamples;
use crate::visibility::{self, Visibility};
use glam::{Vec2, Vec3};

/// The angle, radians, that a stored byte of 127 stands for.
const MAX_DISTANCE: f32 = std::f32::consts::FRAC_PI_2;

/// Signed spherical distance functions of a mesh's samples on one octahedral grid.
///
/// The distance in a direction is the angle to the nearest direction of the other kind, positive where nothing is in the way.
pub struct Occlusion {
    side: usize,
    places: SurfaceSamples,
    /// `(side + 2)^2` bytes a sample, with a border.
    bytes: Vec<i8>,
}

impl Occlusion {
    /// From `side * side` distances, radians, of each sample in rows of an octahedral map; a sample with another number
    /// of them counts as unshadowed.
    pub fn new<D: AsRef<[f32]>>(
        side: usize,
        places: SurfaceSamples,
        distances: impl Fn(usize) -> D + Sync + Send,
    ) -> Self {
        let pitch = side + 2;
        let cells: Vec<usize> = (-1..=side as isize)
            .flat_map(|y| (-1..=side as isize).map(move |x| (x, y)))
            .map(|(x, y)| wrap(x, y, side))
            .collect();
        let rows = crate::parallel::map(places.count(), |place| {
            let distances = distances(place);
            let distances = distances.as_ref();
            if distances.len() != side * side {
                return vec![127; pitch * pitch];
            }
            cells.iter().map(|&k| (distances[k] / MAX_DISTANCE * 127.0).round().clamp(-127.0, 127.0) as i8).collect()
        });
        Occlusion { side, places, bytes: rows.concat() }
    }

    /// Decodes a file's visibility.
    pub fn from_visibility(visibility: &Visibility) -> Self {
        let cells: Vec<Vec<f32>> = octahedral::directions(visibility.size())
            .into_iter()
            .map(|direction| {
                let mut basis = vec![0.0; visibility.terms() + 1];
                visibility.basis(direction, &mut basis);
                basis
            })
            .collect();
        Self::new(visibility.size(), visibility.places().clone(), |place| {
            let weights = visibility.weights(place);
            cells.iter().map(|basis| visibility::unbounded_distance(basis, weights)).collect::<Vec<f32>>()
        })
    }

    /// Returns the samples of the surface at which distances are known.
    pub fn places(&self) -> &SurfaceSamples {
        &self.places
    }

    /// Cells along a side.
    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Distance of a cell between three samples, radians; a single one has the share 1 and comes first.
    #[inline]
    pub(super) fn cell_distance(&self, places: [u32; 3], shares: Vec3, [x, y]: [usize; 2]) -> f32 {
        let pitch = self.side + 2;
        let at = (y + 1) * pitch + x + 1;
        let [a, b, c] = places.map(|place| place as usize * pitch * pitch + at);
        let first = self.bytes[a] as f32;
        let between = if shares.x == 1.0 {
            first
        } else {
            shares.x * first + shares.y * self.bytes[b] as f32 + shares.z * self.bytes[c] as f32
        };
        between * (MAX_DISTANCE / 127.0)
    }

    /// Distance in a direction between three samples, radians.
    #[inline]
    pub(super) fn interpolated_distance(&self, places: [u32; 3], shares: Vec3, square: Vec2) -> f32 {
        let read = self.between_cells(square);
        let [a, b, c] = places.map(|place| read(place as usize));
        (shares.x * a + shares.y * b + shares.z * c) * (MAX_DISTANCE / 127.0)
    }

    /// Bytes of samples, bilinear between the cells around a place of the square.
    #[inline]
    fn between_cells(&self, square: Vec2) -> impl Fn(usize) -> f32 {
        let pitch = self.side + 2;
        let p = square * self.side as f32 + 0.5;
        let (x, y) = ((p.x as usize).min(self.side), (p.y as usize).min(self.side));
        let (s, t) = (p.x - x as f32, p.y - y as f32);
        let first = y * pitch + x;
        move |place| {
            let from = place * pitch * pitch + first;
            let (upper, lower) = (&self.bytes[from..from + 2], &self.bytes[from + pitch..from + pitch + 2]);
            let [a, b, c, d] = [upper[0], upper[1], lower[0], lower[1]].map(f32::from);
            (a + (b - a) * s) * (1.0 - t) + (c + (d - c) * s) * t
        }
    }
}

/// Share of a lobe of a sharpness that a half-space at a signed angle leaves, nearly: the Gaussian's integral as a straight ramp. Lobes
/// here are narrow: with Tokuyoshi's integral in its place no image of spot in tools/bench/relight changes by more than 0.05 dB.
#[inline]
pub(super) fn visibility_ramp(distance: f32, sharpness: f32) -> f32 {
    (0.5 + 0.36 * distance * sharpness.sqrt()).clamp(0.0, 1.0)
}
