//! One view: from its prediction and its streams to pixels, and back.

use super::order::Step;
use super::{ComponentCoding, DecodedView, MaskCoding, PlaneCoding, Scene, Sources, Stage, ViewModels};
use crate::entropy::{BitCoder, RangeDecoder};
use crate::image::Mask;
use crate::parallel;
use crate::residual::coefficients::{self, Models};
use crate::residual::mask;
use crate::surface::warp::{Reference, predict};
use crate::transform::shape_adaptive::Pixel;

/// A picture's signal: the sqrt domain, rotated, row-major, 0 outside the mask.
pub type Signal = Vec<Pixel>;

/// One view's streams.
#[cfg(feature = "encode")]
#[derive(Debug, Clone, Default)]
pub struct Streams {
    /// The mask; empty where masks are not coded.
    pub mask: Vec<u8>,
    /// Each component.
    pub components: Vec<Vec<u8>>,
}

/// Codes a view: its streams, the decoded signals, and what later views need.
#[cfg(feature = "encode")]
pub fn encode(
    scene: &Scene,
    (step, scale): (&Step, u8),
    coding: &PlaneCoding,
    wanted_mask: &Mask,
    signals: impl Fn(usize) -> Signal + Sync + Send,
    decoded: &[Option<DecodedView>],
    lambda: f32,
) -> (Streams, Vec<Signal>, DecodedView) {
    let mut coder = crate::entropy::RangeEncoder::new();
    let (stage, mask_models) = stage(scene, step, coding, &mut coder, Some(wanted_mask), decoded);
    let mask = coder.finish();
    let parts = code_components(&stage, step, coding, decoded, |index, predicted, mut models| {
        let component = &coding.components[index];
        let mut coder = crate::entropy::RangeEncoder::new();
        let target = stage.plan.forward(&signals(index));
        let target = Some((&target[..], coefficients::Choice { lambda }));
        let quantiser = component.quantiser(scale);
        let decoded = coefficients::code(&mut coder, &mut models, &stage.plan, &quantiser, predicted, target);
        (models, (coder.finish(), finish(&stage, component, &decoded)))
    });
    let (components, parts): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let (streams, signals): (Vec<_>, Vec<Signal>) = parts.into_iter().unzip();
    let view = decoded_view(stage, &signals, ViewModels { mask: mask_models, components });
    (Streams { mask, components: streams }, signals, view)
}

/// Decodes a view from the stream of its mask and of each component.
pub fn decode(
    scene: &Scene,
    (step, scale): (&Step, u8),
    coding: &PlaneCoding,
    mask: &[u8],
    components: &[&[u8]],
    decoded: &[Option<DecodedView>],
) -> (Vec<Signal>, Mask, DecodedView) {
    let (stage, mask_models) = stage(scene, step, coding, &mut RangeDecoder::new(mask), None, decoded);
    let parts = code_components(&stage, step, coding, decoded, |index, predicted, mut models| {
        let component = &coding.components[index];
        let mut coder = RangeDecoder::new(components[index]);
        let quantiser = component.quantiser(scale);
        let decoded = coefficients::code(&mut coder, &mut models, &stage.plan, &quantiser, predicted, None);
        (models, finish(&stage, component, &decoded))
    });
    let (components, signals): (Vec<_>, Vec<Signal>) = parts.into_iter().unzip();
    let mask = stage.mask.clone();
    let view = decoded_view(stage, &signals, ViewModels { mask: mask_models, components });
    (signals, mask, view)
}

/// Draws the view and codes its mask.
fn stage<C: BitCoder>(
    scene: &Scene,
    step: &Step,
    coding: &PlaneCoding,
    coder: &mut C,
    wanted: Option<&Mask>,
    decoded: &[Option<DecodedView>],
) -> (Stage, mask::MaskModels) {
    let mut models = parent(step, decoded).map(|view| view.models.mask.clone()).unwrap_or_default();
    let stage = scene.stage(step.view, |coverage| match coding.masks {
        MaskCoding::Coverage => coverage,
        MaskCoding::Coded => mask::code(coder, &mut models, &coverage, wanted),
    });
    (stage, models)
}

fn parent<'d>(step: &Step, decoded: &'d [Option<DecodedView>]) -> Option<&'d DecodedView> {
    decoded.get(step.parent?)?.as_ref()
}

/// Predicts the view from its references and runs `code` for each component.
fn code_components<T: Send>(
    stage: &Stage,
    step: &Step,
    coding: &PlaneCoding,
    decoded: &[Option<DecodedView>],
    code: impl Fn(usize, Option<&[Signal]>, Models) -> T + Sync + Send,
) -> Vec<T> {
    let sources = Sources::new(stage, step, decoded);
    let parent = parent(step, decoded);
    parallel::map(coding.components.len(), |index| {
        let models = parent.map_or_else(Models::default, |view| view.models.components[index].clone());
        let references: Vec<_> =
            sources.of.iter().map(|(view, sources, share)| (&view.references[index], &sources[..], *share)).collect();
        let predicted = (!references.is_empty()).then(|| {
            let shaded = coding.components[index].shaded;
            stage.plan.forward(&predict(&stage.mask, &stage.pixels, &references, shaded))
        });
        code(index, predicted.as_deref(), models)
    })
}

/// Pixels of decoded coefficients; radiance below zero is cut where the component has none.
fn finish(stage: &Stage, coding: &ComponentCoding, coefficients: &[Signal]) -> Signal {
    let mut signal = stage.plan.inverse(coefficients);
    if !coding.signed {
        for &at in &stage.pixels {
            let colour = coding.unrotate(signal[at as usize]);
            if colour.iter().any(|&v| v < 0.0) {
                signal[at as usize] = coding.rotate(colour.map(|v| if v > 0.0 { v } else { 0.0 }));
            }
        }
    }
    signal
}

fn decoded_view(mut stage: Stage, signals: &[Signal], models: ViewModels) -> DecodedView {
    let references = signals.iter().map(|signal| Reference::new(signal.clone(), &stage.mask)).collect();
    stage.geometry.keep_as_reference();
    (stage.plan, stage.pixels) = Default::default();
    DecodedView { stage, references, models }
}
