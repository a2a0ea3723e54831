//! One view: from its prediction and its stream to pixels, and back.

use super::order::Step;
use super::{ComponentCoding, DecodedView, Scene, Sources, Stage};
use crate::entropy::{RangeDecoder, RangeEncoder};
use crate::image::Mask;
use crate::residual::coefficients::{self, Choice, Models};
use crate::surface::warp::{Reference, predict};
use crate::transform::shape_adaptive::Pixel;

/// A picture's signal: the sqrt domain, rotated, row-major, 0 outside the mask.
pub type Signal = Vec<Pixel>;

/// Codes a view: the stream of each component, the decoded signals, and what later views need.
#[cfg(feature = "encode")]
pub fn encode(
    scene: &Scene,
    step: &Step,
    scale: u8,
    components: &[ComponentCoding],
    signals: &[Signal],
    decoded: &[Option<DecodedView>],
    lambda: f32,
) -> (Vec<Vec<u8>>, Vec<Signal>, DecodedView) {
    let (stage, models, parts) = prepare(scene, step, components.len(), decoded, |stage, sources, index, mut models| {
        let coding = &components[index];
        let mut encoder = RangeEncoder::new();
        let predicted = prediction(scene, step, stage, sources, index, coding.shaded);
        let target = stage.plan.forward(&signals[index]);
        let coefficients = coefficients::code(
            &mut encoder,
            &mut models,
            &stage.plan,
            &coding.quantiser(scale),
            predicted.as_deref(),
            Some((&target, Choice { lambda })),
        );
        (models, (encoder.finish(), finish(stage, coding, &coefficients)))
    });
    let (streams, signals): (Vec<_>, Vec<Signal>) = parts.into_iter().unzip();
    let view = decoded_view(stage, &scene.masks[step.view], &signals, models);
    (streams, signals, view)
}

/// Decodes a view from the stream of each component.
pub fn decode(
    scene: &Scene,
    step: &Step,
    scale: u8,
    components: &[ComponentCoding],
    streams: &[&[u8]],
    decoded: &[Option<DecodedView>],
) -> (Vec<Signal>, DecodedView) {
    let (stage, models, signals) = prepare(scene, step, components.len(), decoded, |stage, sources, index, mut models| {
        let coding = &components[index];
        let predicted = prediction(scene, step, stage, sources, index, coding.shaded);
        let coefficients = coefficients::code(
            &mut RangeDecoder::new(streams[index]),
            &mut models,
            &stage.plan,
            &coding.quantiser(scale),
            predicted.as_deref(),
            None,
        );
        (models, finish(stage, coding, &coefficients))
    });
    let view = decoded_view(stage, &scene.masks[step.view], &signals, models);
    (signals, view)
}

/// Draws the view, finds it in its references and runs `code` for each component, side by side where threads are there.
fn prepare<T: Send>(
    scene: &Scene,
    step: &Step,
    components: usize,
    decoded: &[Option<DecodedView>],
    code: impl Fn(&Stage, &Sources, usize, Models) -> (Models, T) + Sync,
) -> (Stage, Vec<Models>, Vec<T>) {
    let stage = scene.stage(step.view);
    let sources = Sources::new(&stage, step, decoded);
    let parent = step.parent.and_then(|view| decoded.get(view)?.as_ref());
    let run = |index: usize| {
        let models = parent.map_or_else(Models::default, |view| view.models[index].clone());
        code(&stage, &sources, index, models)
    };
    #[cfg(feature = "parallel")]
    let results: Vec<(Models, T)> = {
        use rayon::prelude::*;
        (0..components).into_par_iter().map(run).collect()
    };
    #[cfg(not(feature = "parallel"))]
    let results: Vec<(Models, T)> = (0..components).map(run).collect();
    drop(sources);
    let (models, parts) = results.into_iter().unzip();
    (stage, models, parts)
}

/// Coefficients of the prediction, if the view has references.
fn prediction(
    scene: &Scene,
    step: &Step,
    stage: &Stage,
    sources: &Sources,
    component: usize,
    shaded: bool,
) -> Option<Vec<Signal>> {
    let references: Vec<_> =
        sources.of.iter().map(|(view, sources, share)| (&view.references[component], &sources[..], *share)).collect();
    (!references.is_empty())
        .then(|| stage.plan.forward(&predict(&scene.masks[step.view], &stage.pixels, &references, shaded)))
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

fn decoded_view(stage: Stage, mask: &Mask, signals: &[Signal], models: Vec<Models>) -> DecodedView {
    let references = signals.iter().map(|signal| Reference::new(signal.clone(), mask)).collect();
    DecodedView { stage, references, models }
}
