//! The object's surface: where its samples lie and which photographs see them.

pub mod patches;
#[cfg(feature = "encode")]
pub mod visibility;
