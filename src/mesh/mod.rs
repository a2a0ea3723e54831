//! Meshes: reading, cleaning, coding.

#[cfg(feature = "encode")]
pub mod clean;
pub mod code;
#[cfg(feature = "encode")]
pub mod read;
