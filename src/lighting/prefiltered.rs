//! Light ready for shading: a few spherical Gaussians for diffuse reflection, prefiltered maps for specular reflection.

use super::SphericalGaussian;
use super::environment::turn_y;
use crate::sphere::octahedral::{OctahedralTaps, directions, solid_angles, taps};

/// Sharpness of the maps that the encoder makes, from a mirror's to nearly diffuse (Sonoda 2011, section 4.2).
pub(crate) const SHARPNESS: [f64; 7] = [21_000.0, 5_250.0, 1_312.0, 328.0, 82.0, 20.0, 5.0];

/// The light of an environment. What a file's section `lIGt` holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EnvironmentLobes {
    /// Radiance as a sum of lobes, for diffuse reflection.
    pub diffuse: Vec<SphericalGaussian>,
    /// The environment seen through lobes of falling sharpness.
    pub prefiltered: Vec<PrefilteredMap>,
}

/// The environment averaged by a lobe, about every direction of an octahedral grid.
#[derive(Debug, Clone, PartialEq)]
pub struct PrefilteredMap {
    sharpness: f64,
    size: usize,
    /// Cells of [`crate::sphere::octahedral`], row by row.
    cells: Vec<[f32; 3]>,
}

impl PrefilteredMap {
    /// From `size * size` cells; `None` where their number is another or `sharpness` is not positive.
    pub fn new(sharpness: f64, size: usize, cells: Vec<[f32; 3]>) -> Option<Self> {
        let right = size > 0 && sharpness > 0.0 && sharpness.is_finite() && Some(cells.len()) == size.checked_mul(size);
        right.then_some(PrefilteredMap { sharpness, size, cells })
    }
    /// Sharpness of the lobe.
    pub fn sharpness(&self) -> f64 {
        self.sharpness
    }
    /// Cells along a side.
    pub fn size(&self) -> usize {
        self.size
    }
    /// Mean radiance about each cell's direction, row by row.
    pub fn cells(&self) -> &[[f32; 3]] {
        &self.cells
    }
    /// Mean radiance, weighted by the lobe about a direction: `int G L / int G`. Bilinear between cells.
    #[inline]
    pub fn mean_radiance(&self, direction: [f64; 3]) -> [f32; 3] {
        let OctahedralTaps { cells, weights } = taps(direction, self.size);
        let mut sum = [0.0; 3];
        for (cell, weight) in cells.into_iter().zip(weights) {
            let cell = &self.cells[cell as usize];
            (0..3).for_each(|c| sum[c] += weight * cell[c]);
        }
        sum
    }
}

impl EnvironmentLobes {
    /// Mean radiance weighted by a lobe of any sharpness about a direction, `int G L / int G`; interpolated between the two
    /// maps about it in the logarithm of the sharpness; beyond them the outermost map.
    /// Times the lobe's [`SphericalGaussian::integral`] it is the inner product of the lobe and the light. Black without maps.
    #[inline]
    pub fn prefiltered_radiance(&self, direction: [f64; 3], sharpness: f64) -> [f32; 3] {
        // Maps come from sharp to dull.
        let below =
            self.prefiltered.iter().position(|level| level.sharpness <= sharpness).unwrap_or(self.prefiltered.len());
        let (Some(dull), Some(sharp)) =
            (self.prefiltered.get(below), below.checked_sub(1).and_then(|k| self.prefiltered.get(k)))
        else {
            return self
                .prefiltered
                .get(below)
                .or(self.prefiltered.last())
                .map_or([0.0; 3], |level| level.mean_radiance(direction));
        };
        let part = ((sharpness / dull.sharpness).ln() / (sharp.sharpness / dull.sharpness).ln()) as f32;
        let (a, b) = (dull.mean_radiance(direction), sharp.mean_radiance(direction));
        std::array::from_fn(|c| a[c] + part * (b[c] - a[c]))
    }
    /// With all radiance times `factor`.
    pub fn scaled(self, factor: f64) -> Self {
        let diffuse = self.diffuse.iter().map(|lobe| lobe.scaled(factor)).collect();
        let scaled = |mut level: PrefilteredMap| {
            level.cells.iter_mut().flatten().for_each(|x| *x = (*x * factor as f32).clamp(0.0, f32::MAX));
            level
        };
        EnvironmentLobes { diffuse, prefiltered: self.prefiltered.into_iter().map(scaled).collect() }
    }
    /// Turned about +Y, as [`super::EnvironmentMap::rotated_y`].
    pub fn turned_y(self, degrees: f64) -> Self {
        if degrees == 0.0 {
            return self;
        }
        let turn = |lobe: SphericalGaussian| SphericalGaussian { axis: turn_y(lobe.axis, degrees), ..lobe };
        let turned = |level: PrefilteredMap| {
            let cells = directions(level.size).into_iter().map(|d| level.mean_radiance(turn_y(d, -degrees))).collect();
            PrefilteredMap { cells, ..level }
        };
        let levels = self.prefiltered.into_iter().map(turned).collect();
        EnvironmentLobes { diffuse: self.diffuse.into_iter().map(turn).collect(), prefiltered: levels }
    }
    /// The environment as its sharpest map has it; `None` without maps.
    pub fn environment(&self) -> Option<super::EnvironmentMap> {
        let sharpest = self.prefiltered.first()?;
        // Pixels at the horizon about as large as cells.
        Some(super::EnvironmentMap::from_fn((2 * sharpest.size).clamp(32, 1024), |d| sharpest.mean_radiance(d)))
    }
    /// Irradiance of the diffuse lobes on a surface that nothing shadows.
    pub fn irradiance(&self, normal: [f64; 3]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for lobe in &self.diffuse {
            let part = lobe.irradiance(normal);
            (0..3).for_each(|c| sum[c] += part[c]);
        }
        sum
    }
    /// Mean radiance of all directions, by the least sharp map.
    pub fn mean_radiance(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        if let Some(level) = self.prefiltered.last() {
            for (cell, angle) in level.cells.iter().zip(solid_angles(level.size)) {
                (0..3).for_each(|c| sum[c] += cell[c] as f64 * angle / (4.0 * std::f64::consts::PI));
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_interpolated_in_the_logarithm() {
        let level = |sharpness: f64, value: f32| PrefilteredMap::new(sharpness, 4, vec![[value; 3]; 16]).unwrap();
        let light = EnvironmentLobes { diffuse: Vec::new(), prefiltered: vec![level(64.0, 3.0), level(4.0, 1.0)] };
        let at = |sharpness| light.prefiltered_radiance([0.0, 1.0, 0.0], sharpness)[0];
        assert!(
            (at(16.0) - 2.0).abs() < 1e-6 && at(64.0) == 3.0 && at(1000.0) == 3.0 && at(4.0) == 1.0 && at(1.0) == 1.0
        );
        assert_eq!(EnvironmentLobes::default().prefiltered_radiance([1.0, 0.0, 0.0], 5.0), [0.0; 3]);
        assert!((light.mean_radiance()[0] - 1.0).abs() < 1e-12);
        let linear: Vec<[f32; 3]> = directions(16).iter().map(|d| d.map(|x| x as f32)).collect();
        let level = PrefilteredMap::new(1.0, 16, linear).unwrap();
        for d in [[0.6, 0.8, 0.0], [0.6, -0.8, 0.0], [-0.48, -0.6, 0.64], [0.0, -1.0, 0.0]] {
            let found = level.mean_radiance(d);
            assert!((0..3).all(|c| (found[c] as f64 - d[c]).abs() < 0.08), "{d:?} {found:?}");
        }
        assert!(PrefilteredMap::new(1.0, 4, vec![[0.0; 3]; 15]).is_none());
    }
}
