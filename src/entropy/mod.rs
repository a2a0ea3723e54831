//! Entropy coding: an adaptive binary range coder, adaptive bit models and logistic mixing of several of them.

pub(crate) mod average;
pub(crate) mod mixer;
pub(crate) mod model;
pub(crate) mod range_coder;
pub(crate) mod rans;
mod slot;
pub(crate) mod symbol;

pub(crate) use model::code_raw;
pub use model::{BitModel, NumberModel, code_end};
pub use range_coder::{RangeDecoder, RangeEncoder};
pub use rans::{RansDecoder, RansEncoder};

/// Binary arithmetic coder. Encoders write `bit`; decoders ignore it and return the decoded one, so that every model is written
/// once for both directions.
pub trait BitCoder {
    /// Codes one bit whose probability of being 1 is `probability_of_one / 65536`, in `1..=65535`.
    fn bit(&mut self, probability_of_one: u32, bit: bool) -> bool;
    /// True where the caller's bits are ignored and the returned ones count.
    const DECODES: bool;
    /// Whether the decoder has read beyond the end of its stream: later values are not from the stream. Loops over streams stop there,
    /// so that their work is bounded by the bytes.
    fn is_exhausted(&self) -> bool {
        false
    }
}

/// A coder that takes symbols of 16 values, too.
pub trait SymbolCoder: BitCoder {
    /// Codes a symbol.
    fn symbol(&mut self, starts: &symbol::SymbolStarts, symbol: usize) -> usize;
    /// Codes the lowest `count` (at most 16) bits of a number as equiprobable.
    fn equiprobable(&mut self, count: u32, value: u32) -> u32;
}
