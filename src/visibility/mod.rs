//! Visibility of all directions from the vertices of a mesh, or from samples between them as well, as a signed distance on the sphere, in
//! few numbers a sample.
//!
//! The signed spherical distance of a direction is its angle to the nearest direction of the other kind: positive where the
//! direction is free, negative where the mesh blocks it (Wang 2009; Sonoda 2011, equation 2), here at most a right angle either
//! way, beyond which no half-space differs from all or nothing. It is smooth enough for a
//! principal component analysis over the samples and for linear interpolation between them.

#[cfg(feature = "encode")]
pub(crate) mod bake;
pub(crate) mod codec;
#[cfg(feature = "encode")]
mod measure;
#[cfg(feature = "encode")]
mod principal;
#[cfg(feature = "encode")]
pub(crate) mod rays;

#[cfg(feature = "encode")]
pub use bake::{BakeOptions, BakedVisibility, bake};

pub use crate::surface::samples::SurfaceSamples;

use crate::sphere::octahedral::{OctahedralTaps, taps};
use std::f64::consts::FRAC_PI_2;

/// Visibility of a mesh's surface samples: `distance(sample, direction) = mean(direction) + sum_k weight(sample, k) base(direction, k)`.
///
/// Directions are those of the mesh's world. Bases are functions on the octahedral grid,
/// bilinear between its cells, already multiplied by the steps of their weights; weights are integers of 8 bits.
#[derive(Debug, Clone, PartialEq)]
pub struct Visibility {
    size: usize,
    terms: [usize; 2],
    ground: bool,
    error: VisibilityError,
    /// For each cell the mean, then one value for each term.
    bases: Vec<f32>,
    /// Samples of the surface.
    places: SurfaceSamples,
    /// For each sample one integer for each term.
    weights: Vec<i8>,
}

/// Error of the stored visibility, over all directions, samples of the surface counted alike.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VisibilityError {
    /// Root mean square error of the signed distance, radians.
    pub rms_radians: f32,
    /// Share of directions whose sign is wrong: free ones taken for blocked ones or the reverse, 0 to 1.
    pub wrong_signs: f32,
}

impl Visibility {
    /// Returns the samples of the surface: the mesh's vertices, and perhaps points between them.
    pub fn places(&self) -> &SurfaceSamples {
        &self.places
    }
    /// Number of terms, all of them.
    pub fn terms(&self) -> usize {
        self.terms[0] + self.terms[1]
    }
    /// Number of terms of the first group, which alone serves for broad lobes (16), and of the second (32).
    pub fn groups(&self) -> [usize; 2] {
        self.terms
    }
    /// Cells along a side of the grid of directions.
    pub fn size(&self) -> usize {
        self.size
    }
    /// Whether an endless plane below the object was taken as blocking, too.
    pub fn has_ground(&self) -> bool {
        self.ground
    }
    /// The error that the encoder measured.
    pub fn error(&self) -> VisibilityError {
        self.error
    }
    /// For each cell of the grid, row by row, the mean and then one value for each term.
    pub fn bases(&self) -> &[f32] {
        &self.bases
    }
    /// For each sample one integer for each term; the vertices come first.
    pub fn all_weights(&self) -> &[i8] {
        &self.weights
    }
    /// Returns the weights of a sample, [`Visibility::terms`] of them; none if it is out of range.
    pub fn weights(&self, place: usize) -> &[i8] {
        let terms = self.terms();
        self.weights.get(place.saturating_mul(terms)..).and_then(|rest| rest.get(..terms)).unwrap_or(&[])
    }
    /// Interpolates the weights of three samples by their shares: as many as `out` holds, [`Visibility::terms`] at most.
    pub fn interpolate(&self, places: [u32; 3], shares: [f32; 3], out: &mut [f32]) {
        out.fill(0.0);
        for (place, share) in places.into_iter().zip(shares) {
            for (sum, &weight) in out.iter_mut().zip(self.weights(place as usize)) {
                *sum += share * weight as f32;
            }
        }
    }
    /// The mean and the bases in a direction: as many as `out` holds, [`Visibility::terms`] + 1 at most. With [`unbounded_distance`] they
    /// serve for every sample.
    pub fn basis(&self, direction: [f64; 3], out: &mut [f32]) {
        let stride = self.terms() + 1;
        let OctahedralTaps { cells, weights } = taps(direction, self.size);
        out.fill(0.0);
        for (cell, share) in cells.into_iter().zip(weights) {
            for (sum, &value) in out.iter_mut().zip(&self.bases[cell as usize * stride..][..stride]) {
                *sum += share * value;
            }
        }
    }
    /// Signed distance in radians, -pi/2 to pi/2, of a unit direction as seen from a sample.
    pub fn signed_distance(&self, place: usize, direction: [f64; 3]) -> f64 {
        let weights = self.weights(place);
        self.at_cells(direction, |values| {
            weights.iter().zip(values).map(|(&weight, &value)| weight as f32 * value).sum()
        })
    }
    /// Returns the signed distance, radians, of a direction by weights of [`Visibility::interpolate`], as many as are given.
    pub fn signed_distance_of_weights(&self, weights: &[f32], direction: [f64; 3]) -> f64 {
        self.at_cells(direction, |values| weights.iter().zip(values).map(|(weight, value)| weight * value).sum())
    }
    fn at_cells(&self, direction: [f64; 3], sum: impl Fn(&[f32]) -> f32) -> f64 {
        let stride = self.terms() + 1;
        let OctahedralTaps { cells, weights } = taps(direction, self.size);
        let mut distance = 0.0;
        for (cell, share) in cells.into_iter().zip(weights) {
            if let Some((mean, values)) = self.bases[cell as usize * stride..][..stride].split_first() {
                distance += share * (mean + sum(values));
            }
        }
        (distance as f64).clamp(-FRAC_PI_2, FRAC_PI_2)
    }
}

/// Signed distance in radians by a direction's [`Visibility::basis`] and a sample's weights; may lie beyond a right angle.
#[inline]
pub fn unbounded_distance(basis: &[f32], weights: &[i8]) -> f32 {
    let Some((mean, values)) = basis.split_first() else { return 0.0 };
    mean + values.iter().zip(weights).map(|(value, &weight)| value * weight as f32).sum::<f32>()
}
