//! Mesh codec.
