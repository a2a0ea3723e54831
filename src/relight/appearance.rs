//! Shading models: reflectance at the points of a surface.

use super::brdf_table::SpecularTable;
use super::environment_light::level_of;
use super::material::{Material, SpecularPart};
use glam::Vec3;

/// Reflectance at one point.
pub struct ShadingParameters<'a> {
    /// Diffuse albedo, red, green, blue.
    pub albedo: [f32; 3],
    /// Factor of the specular part.
    pub specular_scale: [f32; 3],
    /// Specular part with its prepared taps.
    pub specular: Option<&'a PreparedSpecular>,
}

impl<'a> ShadingParameters<'a> {
    /// Returns albedo and specular scale as vectors, and the specular part if it reflects anything.
    #[inline]
    pub(super) fn parts(&self) -> (Vec3, Vec3, Option<&'a PreparedSpecular>) {
        let scale = Vec3::from_array(self.specular_scale);
        (Vec3::from_array(self.albedo), scale, self.specular.filter(|_| scale.max_element() > 0.0))
    }
}

/// A specular part with the half vectors that stand for it.
pub struct PreparedSpecular {
    /// The part.
    pub specular: SpecularPart,
    /// Half vectors, their probability density, and the level of light for a tap seen along its half vector.
    pub(super) taps: Vec<(Vec3, f32, f32)>,
    /// Tabulated lobe, if the table is accurate enough.
    pub(super) table: Option<SpecularTable>,
    /// Sharpness (the mean of both directions) and amplitude of its lobes, and the sum of the latter.
    pub(super) lobes: Vec<(f32, f32)>,
    pub(super) peak: f32,
}

impl PreparedSpecular {
    /// `taps` half vectors are looked at.
    pub fn new(specular: SpecularPart, taps: usize) -> Self {
        let halves = specular.taps(taps);
        let count = halves.len() as f32;
        let taps = halves.into_iter().map(|half| {
            let density = specular.density(half.to_array()) as f32;
            // The solid angle of a tap as that of a lobe, see `filtered`.
            let sharpness = 2.0 * std::f32::consts::PI * count * density / 4.0;
            (half.as_vec3(), density, level_of(sharpness))
        });
        let taps = taps.collect();
        let gloss = SpecularTable::new(&*specular.brdf);
        let mean = |s: [f64; 2]| (s[0] * s[1]).sqrt() as f32;
        let lobes: Vec<(f32, f32)> = specular.lobes.iter().map(|l| (mean(l.sharpness), l.amplitude as f32)).collect();
        let peak = lobes.iter().map(|l| l.1).sum::<f32>().max(1e-30);
        PreparedSpecular { specular, taps, table: gloss, lobes, peak }
    }
}

/// Source of a surface's reflectance.
pub trait ShadingModel: Sync {
    /// Returns the reflectance at a point of a triangle, given by the weights of its corners.
    fn parameters_at(&self, triangle: usize, weights: [f32; 3], position: [f32; 3]) -> ShadingParameters<'_>;
}

/// One material all over.
pub struct UniformMaterial {
    albedo: [f32; 3],
    scale: [f32; 3],
    prepared: Option<PreparedSpecular>,
}

impl UniformMaterial {
    /// `taps` as in [`PreparedSpecular::new`].
    pub fn new(material: Material, taps: usize) -> Self {
        UniformMaterial {
            albedo: material.albedo.map(|x| x as f32),
            scale: material.specular_scale.map(|x| x as f32),
            prepared: material.specular.map(|s| PreparedSpecular::new(s, taps)),
        }
    }
}

impl ShadingModel for UniformMaterial {
    fn parameters_at(&self, _: usize, _: [f32; 3], _: [f32; 3]) -> ShadingParameters<'_> {
        ShadingParameters { albedo: self.albedo, specular_scale: self.scale, specular: self.prepared.as_ref() }
    }
}
