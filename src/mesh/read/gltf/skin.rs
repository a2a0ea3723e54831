//! Skins: vertices moved by the joints that they hang on (glTF 2.0, 3.7.3).

use super::accessor::{AccessorUse, BufferContent, check_type};
use crate::error::{Error, Result};
use glam::{DMat4, DVec3};
use gltf::Semantic;

/// The matrices of a skin's joints, from the mesh's coordinates to the world.
pub(super) struct Skinning(Vec<DMat4>);

impl Skinning {
    /// Reads a skin. `nodes` are the transforms to the world by node; joints outside the scene stand still.
    pub(super) fn read(content: &BufferContent, skin: &gltf::Skin<'_>, nodes: &[Option<DMat4>]) -> Result<Self> {
        let wrong = |message: String| Error::input(content.path, format!("glTF: skin {}: {message}", skin.index()));
        let to_world = |joint: gltf::Node<'_>| nodes.get(joint.index()).copied().flatten().unwrap_or(DMat4::IDENTITY);
        let mut joints: Vec<DMat4> = skin.joints().map(to_world).collect();
        if let Some(accessor) = skin.inverse_bind_matrices() {
            check_type(AccessorUse::Matrices, &accessor).map_err(wrong)?;
            let to_joint = |k: usize, columns: [f64; 16]| {
                if let Some(joint) = joints.get_mut(k) {
                    *joint *= DMat4::from_cols_array(&columns);
                }
            };
            content.each(&accessor, skin.joints().len(), to_joint).map_err(wrong)?;
        }
        Ok(Skinning(joints))
    }

    /// Moves the positions of a primitive.
    pub(super) fn place(
        &self,
        content: &BufferContent,
        primitive: &gltf::Primitive<'_>,
        positions: &mut [[f64; 3]],
    ) -> std::result::Result<(), String> {
        let (joints, weights) = (primitive.get(&Semantic::Joints(0)), primitive.get(&Semantic::Weights(0)));
        let (Some(joints), Some(weights)) = (joints, weights) else {
            return Err("a mesh with a skin, but without JOINTS_0 and WEIGHTS_0".into());
        };
        check_type(AccessorUse::Joints, &joints)?;
        check_type(AccessorUse::Weights, &weights)?;
        if joints.count() < positions.len() || weights.count() < positions.len() {
            return Err(format!("{} vertices have joints, {} positions", joints.count(), positions.len()));
        }
        let mut hung: Vec<[usize; 4]> = vec![[0; 4]; positions.len()];
        content.each(&joints, positions.len(), |k, item: [f64; 4]| {
            if let Some(hung) = hung.get_mut(k) {
                *hung = item.map(|joint| joint as usize);
            }
        })?;
        let mut fault = None;
        content.each(&weights, positions.len(), |k, weights: [f64; 4]| {
            let (Some(position), Some(hung)) = (positions.get_mut(k), hung.get(k)) else { return };
            let sum: f64 = weights.iter().sum();
            let at = DVec3::from_array(*position);
            let mut placed = DVec3::ZERO;
            for (&joint, weight) in hung.iter().zip(weights).filter(|(_, weight)| *weight != 0.0) {
                match self.0.get(joint) {
                    Some(matrix) => placed += matrix.transform_point3(at) * (weight / sum),
                    None => fault = Some(format!("vertex {k} hangs on joint {joint} of {}", self.0.len())),
                }
            }
            *position = placed.to_array();
        })?;
        fault.map_or(Ok(()), Err)
    }
}
