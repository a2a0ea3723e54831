//! Quantisers.

pub mod dead_zone;
