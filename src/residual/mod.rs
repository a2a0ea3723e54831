//! What the model leaves: measured minus predicted.

pub mod volume;
