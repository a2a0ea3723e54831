//! Materials of a file, bound to the triangles of its mesh.

use super::appearance::UniformMaterial;
use super::material::{Material, SpecularPart};
use super::models::split_constant_part;
use crate::asset::Asset;
use crate::brdf::{ClassicalLobe, ClassicalModel, FittedMaterial, TriangleBinding};
use crate::error::{Error, Result};

impl Material {
    /// Prepares a file's material: a classical model's parts as they are, of another form the least value up to 75 degrees from the normal as
    /// Lambertian and the rest as specular.
    pub fn of_fitted(material: &FittedMaterial) -> Self {
        if let FittedMaterial::Classical(ClassicalModel { diffuse, specular, lobe }) = material {
            let part = ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe: lobe.clone() };
            let has_lobe = *lobe != ClassicalLobe::Lambert && *specular != [0.0; 3];
            let part = has_lobe.then(|| SpecularPart::new(Box::new(part)));
            return Material { albedo: *diffuse, specular: part, specular_scale: *specular };
        }
        let (albedo, rest) = split_constant_part(Box::new(material.clone()));
        Material { albedo, specular: Some(SpecularPart::new(rest)), specular_scale: [1.0; 3] }
    }
}

/// Prepared materials of a file, and which triangles take them.
pub(super) struct BoundMaterials<'a> {
    binding: &'a TriangleBinding,
    materials: Vec<UniformMaterial>,
}

impl<'a> BoundMaterials<'a> {
    /// Prepares the materials that triangles are bound to; `taps` as in [`super::PreparedSpecular::new`].
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if the binding is another mesh's, or the asset has not a material that it names.
    pub(super) fn new(asset: &Asset, binding: &'a TriangleBinding, taps: usize) -> Result<Self> {
        if binding.of_triangle.len() != asset.mesh.triangles.len() {
            return Err(Error::parameter("the binding of materials belongs to another mesh: its triangles differ"));
        }
        let materials = crate::parallel::map(binding.names.len(), |place| {
            let name = &binding.names[place];
            let found = asset.materials.iter().find(|named| named.name == *name);
            let found = found.ok_or_else(|| {
                Error::parameter(format!("triangles are bound to material '{name}', which is not there"))
            })?;
            Ok(UniformMaterial::new(Material::of_fitted(&found.material), taps))
        });
        Ok(BoundMaterials { binding, materials: materials.into_iter().collect::<Result<_>>()? })
    }

    /// The material of a triangle, if one is bound to it.
    #[inline]
    pub(super) fn material_of(&self, triangle: usize) -> Option<&UniformMaterial> {
        self.materials.get(self.binding.material_of(triangle)?)
    }

    /// Number of triangles that no material is bound to.
    pub(super) fn unbound(&self) -> usize {
        self.binding.of_triangle.len() - self.binding.counts().iter().sum::<usize>()
    }
}
