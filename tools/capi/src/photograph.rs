//! Decoded photographs.

use crate::asset::{Asset, Camera};
use crate::error::{Error, Status};
use crate::{give, guarded};
use tsuya::decoder::{DecodeOptions, ViewSelection, decode_from};

/// A rectangle of an image, in pixels.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Region {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A decoded photograph.
pub struct Photograph {
    photograph: tsuya::Photograph,
    camera: tsuya::Camera,
    /// 1 where the object is, 0 elsewhere.
    mask: Vec<u8>,
}

/// Decodes the photograph of a view. `reduction` halves its size so often, 0 to 5, and nothing of the finer levels is read; `region` is the part to
/// decode, in pixels of that size, or null for all of it. TSUYA_STATUS_ABSENT where the file holds none of this view.
///
/// # Safety
/// `asset`, `region` and `error` are null or valid; `photograph` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_decode_view(
    asset: *const Asset,
    view: u32,
    reduction: u8,
    region: *const Region,
    photograph: *mut *mut Photograph,
    error: *mut *mut Error,
) -> Status {
    let decode = || {
        // SAFETY: as the caller says.
        let (asset, region) = unsafe { (asset.as_ref().ok_or_else(Error::null)?, region.as_ref()) };
        let view = asset.check_view(view)?;
        let region =
            region.map(|&Region { left, top, width, height }| tsuya::image::Region { left, top, width, height });
        let options = DecodeOptions {
            limits: asset.limits,
            selection: ViewSelection::Views(vec![view]),
            reduction,
            region,
            photographs_only: true,
        };
        let mut decoded = decode_from(&mut asset.open()?, &options)?;
        let found = decoded.photographs.get_mut(view).and_then(Option::take);
        let found = found.ok_or_else(|| Error::new(Status::Absent, "the file holds no photograph of this view"))?;
        let mask = found.mask.data.iter().map(|&is_shown| u8::from(is_shown)).collect();
        let camera = decoded.views[view].camera;
        // SAFETY: as the caller says.
        unsafe { give(photograph, Photograph { photograph: found, camera, mask }) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, decode) }
}

/// Frees a photograph; null is left alone.
///
/// # Safety
/// `photograph` is null or a photograph that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_photograph_free(photograph: *mut Photograph) {
    // SAFETY: as the caller says.
    unsafe { crate::free(photograph) }
}

/// Width in pixels; 0 for null.
///
/// # Safety
/// `photograph` is null or a photograph that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_photograph_width(photograph: *const Photograph) -> u32 {
    // SAFETY: as the caller says.
    unsafe { photograph.as_ref() }.map_or(0, |photograph| photograph.photograph.mask.width as u32)
}

/// Height in pixels; 0 for null.
///
/// # Safety
/// `photograph` is null or a photograph that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_photograph_height(photograph: *const Photograph) -> u32 {
    // SAFETY: as the caller says.
    unsafe { photograph.as_ref() }.map_or(0, |photograph| photograph.photograph.mask.height as u32)
}

/// Its camera, that of the decoded size and region.
///
/// # Safety
/// `photograph` and `error` are null or valid; `camera` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_photograph_camera(
    photograph: *const Photograph,
    camera: *mut Camera,
    error: *mut *mut Error,
) -> Status {
    let find = || {
        // SAFETY: as the caller says.
        let photograph = unsafe { photograph.as_ref() }.ok_or_else(Error::null)?;
        // SAFETY: as the caller says.
        unsafe { crate::put(camera, photograph.camera.into()) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, find) }
}

/// Pixels that show the object: width x height bytes, 1 or 0. Null for null.
///
/// # Safety
/// `photograph` is null or a photograph that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_photograph_mask(photograph: *const Photograph) -> *const u8 {
    // SAFETY: as the caller says.
    unsafe { photograph.as_ref() }.map_or(std::ptr::null(), |photograph| photograph.mask.as_ptr())
}

/// Linear radiance of a component: width x height x 3 numbers, 0 outside the mask. Null for null and where there is no component of this number.
///
/// # Safety
/// `photograph` is null or a photograph that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_photograph_component(photograph: *const Photograph, number: u32) -> *const f32 {
    // SAFETY: as the caller says.
    let image = unsafe { photograph.as_ref() }.and_then(|found| found.photograph.images.get(number as usize));
    image.map_or(std::ptr::null(), |image| image.data.as_ptr().cast())
}
