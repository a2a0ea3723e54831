//! Textures of the metallic-roughness model.

use crate::asset::Asset;
use crate::error::{Error, Status};
use crate::{guarded, put};
use std::sync::PoisonError;
use tsuya::gltf::{Fallback, bake_fallback};
use tsuya::image::Grid;

/// A texture of three bytes for each texel, rows from the top; the memory belongs to the asset. All zero where there is none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Texture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// width x height x 3 bytes.
    pub texels: *const u8,
}

/// The fitted reflectance as glTF's metallic-roughness model takes it, on the mesh TSUYA_MESH_KIND_TEXTURED.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Textures {
    /// Base colour, sRGB.
    pub base_colour: Texture,
    /// Green: roughness, blue: metalness; linear. None for a surface without highlights.
    pub metallic_roughness: Texture,
    /// Specular colour, sRGB, to be multiplied with `specular_scale`; or none.
    pub specular_colour: Texture,
    /// Factor of the specular colour.
    pub specular_scale: f32,
    /// Normals of a surface finer than the mesh, 0 to 255 for -1 to 1: tangent, up in the texture, normal; or none.
    pub normal: Texture,
    /// Whether the base colour is the light that was seen, since that of the capture is unknown: to be shown unlit.
    pub is_unlit: bool,
}

/// Textures that were made, and the albedo that they were made for.
pub(crate) struct TextureData(f64, Box<Fallback>);

impl Texture {
    const NONE: Self = Texture { width: 0, height: 0, texels: std::ptr::null() };

    fn of(map: &Grid<[u8; 3]>) -> Self {
        Texture { width: map.width as u32, height: map.height as u32, texels: map.data.as_ptr().cast() }
    }
}

/// Bakes the reflectance into textures, once for each albedo. `white_albedo` is the diffuse albedo of the capture's white board, such as 0.95: colours
/// are relative to it. TSUYA_STATUS_ABSENT in a file without reflectance.
///
/// # Safety
/// `asset` and `error` are null or valid; `textures` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_textures(
    asset: *const Asset,
    white_albedo: f64,
    textures: *mut Textures,
    error: *mut *mut Error,
) -> Status {
    let bake = || {
        // SAFETY: as the caller says.
        let asset = unsafe { asset.as_ref() }.ok_or_else(Error::null)?;
        if !(white_albedo > 0.0 && white_albedo <= 1.0) {
            return Err(Error::new(Status::Parameter, "an albedo lies above 0 and is at most 1"));
        }
        let model = asset.model()?;
        if model.reflectance.is_none() {
            return Err(Error::new(
                Status::Absent,
                "the file has no reflectance, so there is nothing to make textures of",
            ));
        }
        // They stay where they are until the asset is freed.
        let mut all = asset.textures.lock().unwrap_or_else(PoisonError::into_inner);
        let at = match all.iter().position(|TextureData(albedo, _)| *albedo == white_albedo) {
            Some(at) => at,
            None => {
                all.push(TextureData(white_albedo, Box::new(bake_fallback(model, white_albedo)?)));
                all.len() - 1
            }
        };
        let baked = &all[at].1;
        let texture = |map: &Option<Grid<[u8; 3]>>| map.as_ref().map_or(Texture::NONE, Texture::of);
        let found = Textures {
            base_colour: Texture::of(&baked.base_colour),
            metallic_roughness: texture(&baked.metallic_roughness),
            specular_colour: texture(&baked.specular_colour),
            specular_scale: baked.specular_scale,
            normal: texture(&baked.normal),
            is_unlit: baked.is_unlit,
        };
        // SAFETY: as the caller says.
        unsafe { put(textures, found) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, bake) }
}
