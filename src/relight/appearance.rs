//! What the surface is made of at each point.

use super::material::{Material, Specular};
use glam::Vec3;

/// Reflectance at one point.
pub struct Appearance<'a> {
    /// Diffuse albedo.
    pub albedo: Vec3,
    /// Factor of the specular part.
    pub specular_scale: Vec3,
    /// Specular part with its prepared taps.
    pub specular: Option<&'a Prepared>,
}

/// A specular part with the half vectors that stand for it.
pub struct Prepared {
    /// The part.
    pub specular: Specular,
    /// Half vectors and their probability density.
    pub(super) taps: Vec<(Vec3, f32)>,
}

impl Prepared {
    /// `taps` half vectors are looked at.
    pub fn new(specular: Specular, taps: usize) -> Self {
        let taps = specular.taps(taps).into_iter().map(|h| (h.as_vec3(), specular.density(h.to_array()) as f32));
        let taps = taps.collect();
        Prepared { specular, taps }
    }
}

/// Where appearance comes from.
pub trait Look: Sync {
    /// Appearance of a point of a triangle, by the weights of its corners.
    fn at(&self, triangle: usize, weights: Vec3, position: Vec3) -> Appearance<'_>;
}

/// One material all over.
pub struct Uniform {
    albedo: Vec3,
    scale: Vec3,
    prepared: Option<Prepared>,
}

impl Uniform {
    /// `taps` as in [`Prepared::new`].
    pub fn new(material: Material, taps: usize) -> Self {
        let vector = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
        Uniform {
            albedo: vector(material.albedo),
            scale: vector(material.specular_scale),
            prepared: material.specular.map(|s| Prepared::new(s, taps)),
        }
    }
}

impl Look for Uniform {
    fn at(&self, _: usize, _: Vec3, _: Vec3) -> Appearance<'_> {
        Appearance { albedo: self.albedo, specular_scale: self.scale, specular: self.prepared.as_ref() }
    }
}
