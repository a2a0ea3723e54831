//! Entropy coding: an adaptive binary range coder, adaptive bit models and logistic mixing of several of them.

pub mod average;
pub mod mixer;
pub mod model;
pub mod range_coder;
mod slot;

pub use model::{BitModel, Number, code_end, code_raw};
pub use range_coder::{RangeDecoder, RangeEncoder};

/// Where the bits of a model go: the encoder writes the given bit, the decoder returns the one it read.
/// With it every model is written once for both directions.
pub trait BitCoder {
    /// Codes one bit whose probability of being 1 is `probability_of_one / 65536`, in `1..=65535`.
    fn bit(&mut self, probability_of_one: u32, bit: bool) -> bool;
    /// True where the caller's bits are ignored and the returned ones count.
    const DECODES: bool;
}

/// Predicts bits from contexts, and learns from them.
pub trait Predictor {
    /// What tells one bit's circumstances from another's.
    type Context;
    /// Probability of a 1 in 1/65536, without learning.
    fn probability(&self, context: &Self::Context) -> u32;
    /// Codes one bit and learns from it.
    fn code<C: BitCoder>(&mut self, coder: &mut C, context: &Self::Context, bit: bool) -> bool;
}
