//! The decoder as a C library: `include/tsuya.h` is made of these files. Every function stands between C and the library: it checks pointers, catches
//! panics, and turns errors into a status and a message.

mod asset;
mod error;
mod mesh;
mod photograph;
mod textures;

use std::panic::{AssertUnwindSafe, catch_unwind};

pub use asset::{Asset, Camera, Component, Limits, PointLight, View};
pub use error::{Error, Status};
pub use mesh::{Mesh, MeshKind};
pub use photograph::{Photograph, Region};
pub use textures::{Texture, Textures};

/// Does work that may fail, and says how it went.
///
/// # Safety
/// `error` is null or can be written to.
unsafe fn guarded(error: *mut *mut Error, work: impl FnOnce() -> Result<(), Error>) -> Status {
    let failed = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return Status::Ok,
        Ok(Err(failed)) => failed,
        Err(_) => Error::new(Status::Internal, "a defect of the library: a panic was caught"),
    };
    let status = failed.status();
    if !error.is_null() {
        // SAFETY: not null, and the caller says that it can be written to.
        unsafe { error.write(Box::into_raw(Box::new(failed))) };
    }
    status
}

/// Gives an object to the caller.
///
/// # Safety
/// `place` is null or can be written to.
unsafe fn give<T>(place: *mut *mut T, object: T) -> Result<(), Error> {
    if place.is_null() {
        return Err(Error::null());
    }
    // SAFETY: not null, and the caller says that it can be written to.
    unsafe { place.write(Box::into_raw(Box::new(object))) };
    Ok(())
}

/// Writes a value where the caller wants it.
///
/// # Safety
/// `place` is null or can be written to.
unsafe fn put<T>(place: *mut T, value: T) -> Result<(), Error> {
    if place.is_null() {
        return Err(Error::null());
    }
    // SAFETY: not null, and the caller says that it can be written to.
    unsafe { place.write(value) };
    Ok(())
}

/// Ends an object.
///
/// # Safety
/// `object` is null or came from [`give`] and is not used any more.
unsafe fn free<T>(object: *mut T) {
    if !object.is_null() {
        // SAFETY: it came from a box, and only once.
        let object = unsafe { Box::from_raw(object) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(object)));
    }
}
