//! A picture's coefficients to be coded, its streams, and the state that is handed from one to the next.

use super::contexts::ContextModel;
use super::gains::GainModels;
use super::prediction::Prediction;
use super::tiles::Tiling;
use crate::entropy::{BitCoder, RangeDecoder, RansDecoder};
#[cfg(feature = "encode")]
use crate::entropy::{RangeEncoder, RansEncoder};
use crate::quantise::bands::Quantiser;
use crate::transform::shape_adaptive::{Subband, WaveletPlan};

#[derive(Debug, Clone)]
pub(super) struct CoefficientState<K> {
    pub(super) values: K,
    pub(super) gains: GainModels,
    pub(super) corrections: GainModels,
}

impl<K: ContextModel> CoefficientState<K> {
    pub(super) fn new() -> Self {
        CoefficientState { values: K::new(), gains: GainModels::default(), corrections: GainModels::default() }
    }
}

/// A picture whose coefficients are to be coded, three colours together.
#[derive(Clone, Copy)]
pub struct PictureTask<'a> {
    /// Transform of its mask.
    pub plan: &'a WaveletPlan,
    /// Steps and reconstruction.
    pub quantiser: &'a Quantiser,
    /// What it is predicted to be.
    pub prediction: Prediction<'a>,
    /// The tiles of the finest levels, whose bands have no prediction.
    pub tiling: &'a Tiling,
    /// The bands that they are parts of, from the coarsest level on.
    pub tiled_bands: &'a [Subband],
}

impl PictureTask<'_> {
    /// Bands of the base, which one stream holds.
    pub(super) fn base_bands(&self) -> usize {
        self.plan.level_bands(self.tiling.count).start
    }
}

/// Streams of a picture's coefficients.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PictureStreams<T> {
    /// All bands that are not cut into tiles.
    pub base: T,
    /// Each tile.
    pub tiles: Vec<T>,
}

/// Coder of one stream.
pub(super) trait StreamCoder<'s>: BitCoder + Sized {
    /// Starts at the first byte of `stream`, which encoders ignore.
    fn open(stream: &'s [u8]) -> Self;
    /// Ends the stream: what an encoder has written; `None` where a decoder's does not end as an encoder ends it.
    fn close(self) -> Option<Vec<u8>>;
}

macro_rules! stream_coders {
    ($encoder:ident, $decoder:ident, $($least:tt)*) => {
        #[cfg(feature = "encode")]
        impl<'s> StreamCoder<'s> for $encoder {
            fn open(_stream: &'s [u8]) -> Self {
                $encoder::new()
            }
            fn close(self) -> Option<Vec<u8>> {
                Some(self.finish())
            }
        }
        impl<'s> StreamCoder<'s> for $decoder<'s> {
            fn open(stream: &'s [u8]) -> Self {
                $decoder::new(stream)
            }
            fn close(self) -> Option<Vec<u8>> {
                self.ends_as_written$($least)*.then(Vec::new)
            }
        }
    };
}

stream_coders!(RangeEncoder, RangeDecoder, (0));
stream_coders!(RansEncoder, RansDecoder, ());
