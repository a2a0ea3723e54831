//! Quantisers.

pub mod bands;
pub mod dead_zone;
