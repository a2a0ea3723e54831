//! Shading models: reflectance at the points of a surface.

use super::brdf_table::SpecularTable;
use super::environment_light::level_of;
use super::material::{Material, SpecularPart};
use crate::reflectance::lobes::{self, LOBES, MEAN_TRANSMISSION, grazing_share, transmission};
use glam::Vec3;

/// Reflectance at one point.
pub struct ShadingParameters<'a> {
    /// Diffuse albedo, red, green, blue.
    pub albedo: [f32; 3],
    /// Whether diffuse light enters and leaves through a dielectric surface, which reflects a part of it.
    pub is_layered: bool,
    /// Specular parts, summed.
    pub highlights: Highlights<'a>,
}

/// A specular part and its factor.
#[derive(Clone, Copy)]
pub struct Highlight<'a> {
    /// Factor of its radiance, red, green, blue.
    pub scale: [f32; 3],
    /// The part with its prepared taps.
    pub part: &'a PreparedSpecular,
}

/// Specular parts of a point, [`Highlights::MAX`] at most.
#[derive(Clone, Copy, Default)]
pub struct Highlights<'a> {
    list: [Option<Highlight<'a>>; LOBES],
    count: usize,
    /// How much more all of them reflect at grazing incidence; 0 where they hold that themselves.
    grazing_gain: [f32; 3],
}

impl<'a> Highlights<'a> {
    /// Parts at most.
    pub const MAX: usize = LOBES;

    /// Adds a part; one that reflects nothing, or is one too many, is left out.
    #[inline]
    pub fn push(&mut self, scale: [f32; 3], part: &'a PreparedSpecular) {
        if self.count < Self::MAX && scale.iter().any(|&s| s > 0.0) {
            self.list[self.count] = Some(Highlight { scale, part });
            self.count += 1;
        }
    }

    /// Returns the lobes of weights that are above 0, and their Fresnel term.
    #[inline]
    pub(super) fn of_lobes(weights: &[[f32; 3]; LOBES], lobes: &'a [PreparedSpecular]) -> Self {
        let mut list = Highlights { grazing_gain: lobes::grazing_gain(weights), ..Self::default() };
        weights.iter().zip(lobes).for_each(|(&scale, part)| list.push(scale, part));
        list
    }

    /// Factor of all parts at a cosine between the half vector and either direction.
    #[inline]
    pub(super) fn fresnel(&self, cos_difference: f32) -> Vec3 {
        1.0 + Vec3::from_array(self.grazing_gain) * grazing_share(cos_difference)
    }

    /// Returns the list of at most one part.
    #[inline]
    pub fn single(scale: [f32; 3], part: Option<&'a PreparedSpecular>) -> Self {
        let mut list = Self::default();
        if let Some(part) = part {
            list.push(scale, part);
        }
        list
    }

    /// The parts, with their factors as vectors.
    #[inline]
    pub(super) fn iter(&self) -> impl Iterator<Item = (Vec3, &'a PreparedSpecular)> {
        self.list[..self.count].iter().flatten().map(|h| (Vec3::from_array(h.scale), h.part))
    }

    /// The sum of all factors.
    #[inline]
    pub(super) fn scale(&self) -> Vec3 {
        self.iter().map(|(scale, _)| scale).sum()
    }
}

impl ShadingParameters<'_> {
    /// Radiance of diffuse reflection: `all_around` is the irradiance of light from all around, `directed` that of single directions, of
    /// which each was multiplied with [`Self::entering`]; `cos_view` the cosine between normal and view.
    #[inline]
    pub(super) fn diffuse(&self, all_around: Vec3, directed: Vec3, cos_view: f32) -> Vec3 {
        let albedo = Vec3::from_array(self.albedo) / std::f32::consts::PI;
        if !self.is_layered {
            return albedo * (all_around + directed);
        }
        albedo * (all_around * MEAN_TRANSMISSION + directed) * transmission(cos_view as f64).0 as f32
    }

    /// Share of light from all around that is reflected at all, nearly: only where the highlights' factors are reflectances do they count.
    pub(super) fn hemispherical(&self) -> Vec3 {
        let diffuse = self.hemispherical_diffuse();
        if self.is_layered { (diffuse + self.highlights.scale()).min(Vec3::ONE) } else { diffuse }
    }

    /// The diffuse part of [`Self::hemispherical`].
    pub(super) fn hemispherical_diffuse(&self) -> Vec3 {
        let albedo = Vec3::from_array(self.albedo);
        if self.is_layered { albedo * (MEAN_TRANSMISSION * MEAN_TRANSMISSION) } else { albedo }
    }

    /// Share of a single direction's light, by its cosine to the normal, that reaches what reflects diffusely.
    #[inline]
    pub(super) fn entering(&self, cos_light: f32) -> f32 {
        if self.is_layered { transmission(cos_light as f64).0 as f32 } else { 1.0 }
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
    /// Whether the lobes are as wide along as across.
    pub(super) is_round: bool,
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
        let is_round = specular.lobes.iter().all(|lobe| lobe.sharpness[0] == lobe.sharpness[1]);
        PreparedSpecular { specular, taps, table: gloss, lobes, peak, is_round }
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

impl UniformMaterial {
    /// The specular part and its factor.
    pub(super) fn specular(&self) -> ([f32; 3], Option<&PreparedSpecular>) {
        (self.scale, self.prepared.as_ref())
    }
}

impl ShadingModel for UniformMaterial {
    fn parameters_at(&self, _: usize, _: [f32; 3], _: [f32; 3]) -> ShadingParameters<'_> {
        let highlights = Highlights::single(self.scale, self.prepared.as_ref());
        ShadingParameters { albedo: self.albedo, is_layered: false, highlights }
    }
}
