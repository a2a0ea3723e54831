//! The error of stored visibility against rays.

use super::rays::{DirectionGrid, MeshRays, RayScratch};
use super::{Visibility, VisibilityError};
use crate::sphere::octahedral;
use std::f32::consts::FRAC_PI_2;

/// Places looked at, and cells along a side of the grid of exact directions.
const PLACES: usize = 96;
const SIZE: usize = 90;

/// Compares with rays in 8,100 directions from up to 96 samples spread over the list; each direction counts by its solid angle.
pub(crate) fn measure(surroundings: &MeshRays, visibility: &Visibility) -> VisibilityError {
    let grid = DirectionGrid::new(SIZE);
    let angles = octahedral::solid_angles(SIZE);
    let directions = octahedral::directions(SIZE);
    let places = surroundings.places();
    let count = places.min(PLACES);
    let sums = crate::parallel::map(count, |k| {
        let place = k * places / count;
        let mut scratch = RayScratch::default();
        surroundings.signed_distances(place, &grid, &mut scratch);
        let mut basis = vec![0.0; visibility.terms() + 1];
        let (mut squared, mut wrong) = (0.0, 0.0);
        for ((&direction, &exact), &angle) in directions.iter().zip(&scratch.distances).zip(&angles) {
            visibility.basis(direction, &mut basis);
            let found = super::unbounded_distance(&basis, visibility.weights(place)).clamp(-FRAC_PI_2, FRAC_PI_2);
            squared += angle * (found as f64 - exact as f64).powi(2);
            wrong += if (found > 0.0) == (exact > 0.0) { 0.0 } else { angle };
        }
        (squared, wrong)
    });
    let (squared, wrong) = sums.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    let whole = 4.0 * std::f64::consts::PI * count.max(1) as f64;
    VisibilityError { rms_radians: (squared / whole).sqrt() as f32, wrong_signs: (wrong / whole) as f32 }
}
