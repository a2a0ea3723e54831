//! Wavelet coefficients as bits: contexts from the neighbours, the coarser band, the other colours and the prediction.
//!
//! One function serves both directions, so that they can't disagree. Normative text: `spec/planes.md`.

use super::band::{BandTask, code_band};
use super::contexts::{BandPart, CodedBand, CoefficientCoder, ParentBand};
use super::direct::DirectModel;
use super::gains;
use super::mixed::MixedModel;
pub use super::prediction::Prediction;
use super::task::{CoefficientState, StreamCoder};
pub use super::task::{PictureStreams, PictureTask};
use super::tile_coder::code_tiles;
use super::tiles::Tiling;
use crate::entropy::{BitCoder, RangeDecoder, RansDecoder};
#[cfg(feature = "encode")]
use crate::entropy::{RangeEncoder, RansEncoder};
use crate::quantise::bands::{Quantiser, RateDistortion};
use crate::transform::masked::Coefficients;
use crate::transform::shape_adaptive::{ColourLanes, Orientation, WaveletPlan};

/// Entropy modelling of a picture's coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Modelling {
    /// Eight contexts of each decision, mixed: the smallest files.
    #[default]
    Mixed = 0,
    /// Symbols of 16 values, each from two contexts: decoded several times faster.
    Direct = 1,
}

/// Adaptive state of one component; handed from a picture to those coded after it.
#[derive(Debug, Clone)]
pub struct CoefficientModels(ModellingState);

#[derive(Debug, Clone)]
enum ModellingState {
    Mixed(Box<CoefficientState<MixedModel>>),
    Direct(Box<CoefficientState<DirectModel>>),
}

impl CoefficientModels {
    /// Fresh models.
    pub fn new(modelling: Modelling) -> Self {
        CoefficientModels(match modelling {
            Modelling::Mixed => ModellingState::Mixed(Box::new(CoefficientState::new())),
            Modelling::Direct => ModellingState::Direct(Box::new(CoefficientState::new())),
        })
    }
}

/// Writes the coefficients of one picture as streams; returns them as the decoder has them, too. `target` are the picture's; `decoded` is
/// memory to use again, as for [`decode`].
#[cfg(feature = "encode")]
pub fn encode(
    models: &mut CoefficientModels,
    task: &PictureTask,
    target: &[Vec<ColourLanes>],
    choice: RateDistortion,
    mut decoded: Coefficients,
) -> (PictureStreams<Vec<u8>>, Coefficients) {
    let (target, streams) = (Some((target, choice)), PictureStreams::default());
    let written = match &mut models.0 {
        ModellingState::Mixed(state) => code_streams::<RangeEncoder, _>(state, task, target, &streams, &mut decoded),
        ModellingState::Direct(state) => code_streams::<RansEncoder, _>(state, task, target, &streams, &mut decoded),
    };
    (written.unwrap_or_default(), decoded)
}

/// Reads what [`encode`] has written, of the tiles those of [`PictureTask::tiling`]; `None` where a stream does not end with its last
/// coefficient. `scratch` is memory to use again: what an earlier call has returned.
pub fn decode(
    streams: &PictureStreams<&[u8]>,
    models: &mut CoefficientModels,
    task: &PictureTask,
    mut scratch: Coefficients,
) -> Option<Coefficients> {
    match &mut models.0 {
        ModellingState::Mixed(state) => code_streams::<RangeDecoder, _>(state, task, None, streams, &mut scratch)?,
        ModellingState::Direct(state) => code_streams::<RansDecoder, _>(state, task, None, streams, &mut scratch)?,
    };
    Some(scratch)
}

fn code_streams<'s, C: StreamCoder<'s>, K: CoefficientCoder<C>>(
    models: &mut CoefficientState<K>,
    task: &PictureTask,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    streams: &PictureStreams<&'s [u8]>,
    coefficients: &mut Coefficients,
) -> Option<PictureStreams<Vec<u8>>> {
    let mut coder = C::open(streams.base);
    let mut known = code_base(&mut coder, models, task, target, coefficients);
    let base = coder.close()?;
    // The level above the tiles'; the low band alone is above none.
    let coarser = known.split_off(if known.len() > 1 { known.len() - 3 } else { 1 });
    let tiles = code_tiles::<C, K>((models, coarser), task, target, &streams.tiles, coefficients)?;
    Some(PictureStreams { base, tiles })
}

/// Codes the coefficients of a picture without a prediction, by fresh models, among what else a coder takes. `target` is for encoding.
pub(crate) fn code_alone<C: BitCoder>(
    coder: &mut C,
    plan: &WaveletPlan,
    quantiser: &Quantiser,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
) -> Coefficients {
    let (mut models, mut coefficients) = (CoefficientState::<MixedModel>::new(), Coefficients::default());
    let tiling = Tiling::default();
    let task = PictureTask { plan, quantiser, prediction: Prediction::default(), tiling: &tiling, tiled_bands: &[] };
    code_base(coder, &mut models, &task, target, &mut coefficients);
    coefficients
}

/// Codes the bands that are not cut into tiles; returns their magnitudes.
fn code_base<C: BitCoder, K: CoefficientCoder<C>>(
    coder: &mut C,
    models: &mut CoefficientState<K>,
    task: &PictureTask,
    target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    coefficients: &mut Coefficients,
) -> Vec<CodedBand<K::Magnitudes>> {
    let PictureTask { plan, quantiser, prediction, .. } = *task;
    let bands = plan.bands();
    let predicted = prediction.scaled(coder, [&mut models.gains, &mut models.corrections], bands, quantiser, target);
    coefficients.reset(task.base_bands() + task.tiled_bands.len());
    let mut known: Vec<CodedBand<K::Magnitudes>> = Vec::with_capacity(bands.len());
    for (index, band) in bands.iter().enumerate().take(task.base_bands()) {
        let step = quantiser.band_step(band);
        let task = BandTask {
            band,
            part: BandPart::whole(&band.mask),
            predicted: predicted.as_ref().and_then(|predicted| predicted.bands.get(index)).map(Vec::as_slice),
            gains: predicted.as_ref().map_or(&gains::NONE, |predicted| &predicted.gains[gains::band_class(band)]),
            target: target.map(|(target, choice)| (&target[index][..], choice)),
            step,
            inverse: 1.0 / step,
        };
        let parent =
            (band.orientation != Orientation::Low && index > 3).then(|| ParentBand::new(&known[index - 3], [0, 0]));
        // Already coded bands of the same level.
        let siblings = match band.orientation {
            Orientation::Vertical => 1,
            Orientation::Diagonal => 2,
            _ => 0,
        };
        let siblings = &known[index - siblings..];
        let out = coefficients.band_mut(index, band.mask.data.len());
        let mut rows: Vec<&mut [ColourLanes]> = out.chunks_mut(band.mask.width.max(1)).collect();
        let here = code_band(coder, &mut models.values, quantiser, &task, parent, siblings, &mut rows);
        known.push(here);
    }
    known
}
