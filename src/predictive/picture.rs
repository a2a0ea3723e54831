//! One view: from its prediction and its streams to pixels, and back.

use super::order::OrderEntry;
use super::workspace::PlaneSignal;
use super::workspace::{PlaneWorkspace, PlaneWorkspaces, coding_bytes, drawing_bytes};
use super::{
    DecodedReference, DecodedView, MaskCoding, PlaneCoding, PredictionScene, PreparedView, Reprojections, ViewModels,
};
use crate::container::Tag;
use crate::entropy::{BitCoder, RangeDecoder};
use crate::error::{Error, Result};
use crate::image::Mask;
use crate::limits::Budget;
use crate::parallel;
#[cfg(feature = "encode")]
use crate::quantise::bands::RateDistortion;
use crate::residual::coefficients::{self, CoefficientModels};
use crate::residual::mask;
use crate::surface::reproject::ReferenceView;
use crate::surface::warp::{ReferenceImage, predict};
use crate::transform::frame::Window;
use crate::transform::masked::MaskedPixels;
#[cfg(feature = "encode")]
use crate::transform::shape_adaptive::TransformScratch;

/// One view's streams.
#[cfg(feature = "encode")]
#[derive(Debug, Clone, Default)]
pub(crate) struct ViewStreams {
    /// The mask; empty where masks are not coded.
    pub mask: Vec<u8>,
    /// Each component.
    pub components: Vec<Vec<u8>>,
}

/// Codes a view: its streams, and the view as the decoder has it. `signals` gives a component's signal in a frame;
/// `lambda` is the value of a bit in squared steps.
#[cfg(feature = "encode")]
pub(crate) fn encode(
    scene: &PredictionScene,
    (step, scale): (&OrderEntry, u8),
    coding: &PlaneCoding,
    (wanted_mask, lambda): (&Mask, f32),
    signals: impl Fn(&Window, usize) -> PlaneSignal + Sync + Send,
    decoded: &[Option<DecodedView>],
    is_reference: bool,
) -> Result<(ViewStreams, DecodedView)> {
    let mut coder = crate::entropy::RangeEncoder::new();
    let (stage, mask_models, ()) =
        prepare_view(scene, step, coding, (&mut coder, Some(wanted_mask)), decoded, |_| Ok(()))?;
    let mask = coder.finish();
    let parts = code_components(&stage, step, coding, decoded, |index, predicted, mut models| {
        let component = &coding.components[index];
        let target = stage.plan.forward(signals(&stage.frame, index));
        let (quantiser, choice) = (component.quantiser(scale), RateDistortion { lambda });
        let (stream, decoded) = coefficients::encode(&mut models, &stage.plan, &quantiser, predicted, &target, choice);
        (models, (stream, stage.plan.inverse_keeping(&decoded, stage.level, &mut TransformScratch::default())))
    });
    let (components, parts): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let (streams, signals): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let view = decoded_view(stage, signals, ViewModels { mask: mask_models, components }, is_reference);
    Ok((ViewStreams { mask, components: streams }, view))
}

/// Decodes a view from its streams, the mask's and each component's; `is_reference` keeps what later views need of it.
/// # Errors
/// [`Error::Format`] where a stream does not end with what it tells, [`Error::Limits`] where the memory is not there.
pub(crate) fn decode(
    scene: &PredictionScene,
    (step, scale): (&OrderEntry, u8),
    coding: &PlaneCoding,
    (streams, offset): (&[&[u8]], u64),
    decoded: &[Option<DecodedView>],
    is_reference: bool,
    (workspaces, budget): (&PlaneWorkspaces, &Budget),
) -> Result<DecodedView> {
    let view = &scene.views[step.view];
    let damaged = |what: &str| {
        let message =
            format!("view {}: the stream of {what} does not end with what it tells: the file is damaged", view.name);
        Error::format(Tag::PLANES, offset, message)
    };
    let _drawn = budget.reserve("a view being drawn", drawing_bytes(&view.camera))?;
    let admit = |frame: &Window| budget.reserve("a view being decoded", coding_bytes(frame.pixel_count(), coding));
    let mut coder = RangeDecoder::new(streams[0]);
    let (stage, mask_models, _coded) = prepare_view(scene, step, coding, (&mut coder, None), decoded, admit)?;
    if !coder.ends_as_written(0) {
        return Err(damaged("its mask"));
    }
    let parts = code_components(&stage, step, coding, decoded, |index, predicted, mut models| {
        let quantiser = coding.components[index].quantiser(scale);
        workspaces.with(|PlaneWorkspace { coefficients, transform }| {
            let scratch = std::mem::take(coefficients);
            *coefficients =
                coefficients::decode(streams[1 + index], &mut models, &stage.plan, &quantiser, predicted, scratch)?;
            Some((models, stage.plan.inverse_keeping(coefficients, stage.level, transform)))
        })
    });
    let parts: Option<Vec<_>> = parts.into_iter().collect();
    let (components, signals): (Vec<_>, Vec<_>) = parts.ok_or_else(|| damaged("a component"))?.into_iter().unzip();
    Ok(decoded_view(stage, signals, ViewModels { mask: mask_models, components }, is_reference))
}

/// Draws the view and codes its mask, in encoding the given one.
fn prepare_view<C: BitCoder, T>(
    scene: &PredictionScene,
    step: &OrderEntry,
    coding: &PlaneCoding,
    (coder, wanted): (&mut C, Option<&Mask>),
    decoded: &[Option<DecodedView>],
    admit: impl FnOnce(&Window) -> Result<T>,
) -> Result<(PreparedView, mask::MaskModels, T)> {
    let mut models = parent(step, decoded).map(|parent| parent.models.mask.clone()).unwrap_or_default();
    let mask = |coverage: Mask| match coding.masks {
        MaskCoding::Coverage => coverage,
        MaskCoding::Coded => mask::code_mask(coder, &mut models, &coverage, wanted),
    };
    let (stage, admitted) = scene.prepare_view(step.view, coding.prediction_level as usize, mask, admit)?;
    Ok((stage, models, admitted))
}

fn parent<'d>(step: &OrderEntry, decoded: &'d [Option<DecodedView>]) -> Option<&'d DecodedReference> {
    decoded.get(step.parent?)?.as_ref()?.reference.as_ref()
}

/// Predicts the view from its references and runs `code` for each component.
fn code_components<T: Send>(
    stage: &PreparedView,
    step: &OrderEntry,
    coding: &PlaneCoding,
    decoded: &[Option<DecodedView>],
    code: impl Fn(usize, Option<&[PlaneSignal]>, CoefficientModels) -> T + Sync + Send,
) -> Vec<T> {
    let sources = Reprojections::new(stage, step, decoded);
    let parent = parent(step, decoded);
    parallel::map(coding.components.len(), |index| {
        let models = parent
            .map_or_else(|| CoefficientModels::new(coding.modelling), |view| view.models.components[index].clone());
        let references: Vec<_> = sources
            .references
            .iter()
            .map(|(view, sources, share)| (&view.pictures[index], &sources[..], *share))
            .collect();
        let predicted = (!references.is_empty()).then(|| {
            let shaded = coding.components[index].shaded;
            let low = stage.frame.low_band(stage.level);
            let predicted = predict([low.width, low.height], stage.plan.row_runs(stage.level), &references, shaded);
            stage.plan.forward_from(stage.level, predicted)
        });
        code(index, predicted.as_deref(), models)
    })
}

fn decoded_view(
    stage: PreparedView,
    signals: Vec<(MaskedPixels, Option<MaskedPixels>)>,
    models: ViewModels,
    is_reference: bool,
) -> DecodedView {
    let (size, frame, level) = (stage.low_size(), stage.frame.low_band(stage.level), stage.level);
    let PreparedView { mask, frame: whole, geometry, .. } = stage;
    let (mut signals, lows): (Vec<_>, Vec<_>) = signals.into_iter().unzip();
    let reference = is_reference.then(|| {
        let pictures = if level == 0 { std::mem::take(&mut signals) } else { lows.into_iter().flatten().collect() };
        let pictures = pictures.into_iter().map(|pixels| ReferenceImage::new(pixels, size, frame)).collect();
        DecodedReference { seen: ReferenceView::new(geometry), pictures, models }
    });
    DecodedView { mask, frame: whole, level, signals, reference }
}
