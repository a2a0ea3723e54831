//! Quantisers.

pub(crate) mod bands;
pub(crate) mod dead_zone;
