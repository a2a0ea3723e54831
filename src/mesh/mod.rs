//! Meshes: reading, cleaning, coding.

pub mod code;
