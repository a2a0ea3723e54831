//! The triangle mesh: out of scanners' files, cleaned.

#[cfg(feature = "encode")]
pub mod clean;
#[cfg(feature = "encode")]
pub mod read;
