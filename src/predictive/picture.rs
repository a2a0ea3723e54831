//! One view: from its prediction and its streams to pixels, and back.

use super::header::CodedEntry;
#[cfg(feature = "encode")]
use super::header::CodedTile;
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
use crate::residual::coefficients::{self, CoefficientModels, PictureStreams};
use crate::residual::mask;
#[cfg(feature = "encode")]
use crate::residual::tiles::TileGrid;
use crate::surface::reproject::ReferenceView;
use crate::surface::warp::{ReferenceImage, predict};
use crate::transform::masked::MaskedPixels;
#[cfg(feature = "encode")]
use crate::transform::shape_adaptive::TransformScratch;
use crate::transform::window::Window;

/// One view's streams.
#[derive(Debug, Clone, Default)]
pub(super) struct ViewStreams<T> {
    /// The mask; empty where masks are not coded.
    pub mask: T,
    /// Each component.
    pub components: Vec<PictureStreams<T>>,
}

#[cfg(feature = "encode")]
impl ViewStreams<Vec<u8>> {
    /// Returns the streams one after the other as they stand in the file, and the entry that describes them. The tiles are those of `grid`.
    pub(super) fn into_entry(self, entry: OrderEntry, scale: u8, grid: &TileGrid) -> (CodedEntry, Vec<u8>) {
        let mut bytes = Vec::new();
        let mut put = |streams: &mut dyn Iterator<Item = &Vec<u8>>| {
            let start = bytes.len();
            let lengths: Vec<u32> = streams
                .map(|stream| {
                    bytes.extend_from_slice(stream);
                    stream.len() as u32
                })
                .collect();
            (lengths, if bytes.len() > start { crc32fast::hash(&bytes[start..]) } else { 0 })
        };
        let parts = &self.components;
        let (lengths, checksum) =
            put(&mut std::iter::once(&self.mask).chain(parts.iter().map(|component| &component.base)));
        let tile = |(index, level): (usize, usize)| {
            let (lengths, checksum) = put(&mut parts.iter().map(|component| &component.tiles[index]));
            CodedTile { level: level as u8, lengths, checksum }
        };
        let tiles = grid.tile_levels().enumerate().map(tile).collect();
        (CodedEntry { entry, scale, lengths, checksum, tiles, offset: 0 }, bytes)
    }
}

impl<'s> ViewStreams<&'s [u8]> {
    /// Cuts the streams of an entry apart, but for the tiles of the first `finest_level` levels; `None` where they are too short.
    pub(super) fn cut(coded: &CodedEntry, finest_level: usize, mut streams: &'s [u8]) -> Option<Self> {
        let mut next = |length: &u32| {
            let part;
            (part, streams) = streams.split_at_checked(*length as usize)?;
            Some(part)
        };
        let [mask, components @ ..] = &coded.lengths[..] else { return None };
        let mask = next(mask)?;
        let base = |length| Some(PictureStreams { base: next(length)?, tiles: Vec::with_capacity(coded.tiles.len()) });
        let mut components: Vec<PictureStreams<&[u8]>> = components.iter().map(base).collect::<Option<_>>()?;
        for tile in coded.tiles.iter().take_while(|tile| tile.level as usize > finest_level) {
            for (component, length) in components.iter_mut().zip(&tile.lengths) {
                component.tiles.push(next(length)?);
            }
        }
        Some(ViewStreams { mask, components })
    }
}

/// What is decoded of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ViewPart {
    /// What later views are predicted from.
    Reference,
    /// The photograph.
    Photograph,
    /// Both.
    Both,
}

impl ViewPart {
    pub(crate) fn is_reference(self) -> bool {
        self != ViewPart::Photograph
    }
    pub(crate) fn is_photograph(self) -> bool {
        self != ViewPart::Reference
    }
    /// The part from whether a later view is predicted from it, and whether its photograph is wanted.
    pub(crate) fn new(is_reference: bool, is_photograph: bool) -> Self {
        match (is_reference, is_photograph) {
            (true, true) => ViewPart::Both,
            (false, true) => ViewPart::Photograph,
            (_, false) => ViewPart::Reference,
        }
    }
    /// Levels of the transform that are left out; `level` is that of the pictures that later views are predicted from.
    pub(super) fn finest_level(self, level: usize) -> usize {
        if self.is_photograph() { 0 } else { level }
    }
}

/// One view to code, in either direction.
#[derive(Clone, Copy)]
pub(super) struct ViewTask<'a> {
    /// The mesh and the views.
    pub scene: &'a PredictionScene<'a>,
    /// The view's entry in the coding order.
    pub entry: &'a OrderEntry,
    /// Scale of its quantiser step, in 1/64.
    pub scale: u8,
    /// Coding of all pictures of the file.
    pub coding: &'a PlaneCoding,
    /// Views decoded so far, by view; holds those that the entry depends on.
    pub decoded: &'a [Option<DecodedView>],
    /// What of it is decoded.
    pub part: ViewPart,
}

/// Codes a view; returns its streams, and the view as the decoder has it. `signals` returns a component's signal in a window;
/// `lambda` is the value of a bit in squared steps.
#[cfg(feature = "encode")]
pub(crate) fn encode(
    task: &ViewTask,
    wanted_mask: &Mask,
    lambda: f32,
    signals: impl Fn(&Window, usize) -> PlaneSignal + Sync + Send,
) -> Result<(ViewStreams<Vec<u8>>, DecodedView)> {
    let mut coder = crate::entropy::RangeEncoder::new();
    let (view, mask_models, ()) = prepare_view(task, &mut coder, Some(wanted_mask), |_| Ok(()))?;
    let mask = coder.finish();
    let parts = code_components(task, &view, |index, predicted, mut models| {
        let quantiser = task.coding.components[index].quantiser(task.scale);
        let target = view.plan.forward(signals(&view.window, index));
        let trade_off = RateDistortion { lambda };
        let picture = view.picture_task(&quantiser, predicted, 0);
        let (stream, decoded) = coefficients::encode(&mut models, &picture, &target, trade_off);
        (models, (stream, view.plan.inverse_keeping(&decoded, [0, view.level], &mut TransformScratch::default())))
    });
    let (components, parts): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let (streams, signals): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let decoded = decoded_view(view, signals, ViewModels { mask: mask_models, components }, task.part);
    Ok((ViewStreams { mask, components: streams }, decoded))
}

/// Decodes a part of a view from its streams, which begin at byte `offset` of the section's streams.
/// # Errors
/// [`Error::Format`] if a stream does not end with its last value, [`Error::Limits`] if the memory is not available.
pub(crate) fn decode(
    task: &ViewTask,
    streams: &ViewStreams<&[u8]>,
    offset: u64,
    workspaces: &PlaneWorkspaces,
    budget: &Budget,
) -> Result<DecodedView> {
    let captured = &task.scene.views[task.entry.view];
    let damaged = |what: &str| {
        let name = &captured.name;
        let message = format!("view {name}: the stream of {what} does not end with what it tells: the file is damaged");
        Error::format(Tag::PLANES, offset, message)
    };
    let _drawn = budget.reserve("a view being drawn", drawing_bytes(&captured.camera))?;
    let admit =
        |window: &Window| budget.reserve("a view being decoded", coding_bytes(window.pixel_count(), task.coding));
    let mut coder = RangeDecoder::new(streams.mask);
    let (view, mask_models, _coded) = prepare_view(task, &mut coder, None, admit)?;
    if !coder.ends_as_written(0) {
        return Err(damaged("its mask"));
    }
    let parts = code_components(task, &view, |index, predicted, mut models| {
        let quantiser = task.coding.components[index].quantiser(task.scale);
        workspaces.with(|PlaneWorkspace { coefficients, transform }| {
            let scratch = std::mem::take(coefficients);
            let finest_level = task.part.finest_level(view.level);
            let picture = view.picture_task(&quantiser, predicted, finest_level);
            *coefficients = coefficients::decode(&streams.components[index], &mut models, &picture, scratch)?;
            Some((models, view.plan.inverse_keeping(coefficients, [finest_level, view.level], transform)))
        })
    });
    let parts: Option<Vec<_>> = parts.into_iter().collect();
    let (components, signals): (Vec<_>, Vec<_>) = parts.ok_or_else(|| damaged("a component"))?.into_iter().unzip();
    Ok(decoded_view(view, signals, ViewModels { mask: mask_models, components }, task.part))
}

/// Renders the view's geometry and codes its mask, in encoding the `wanted` one.
fn prepare_view<C: BitCoder, T>(
    task: &ViewTask,
    coder: &mut C,
    wanted: Option<&Mask>,
    admit: impl FnOnce(&Window) -> Result<T>,
) -> Result<(PreparedView, mask::MaskModels, T)> {
    let mut models = parent(task).map(|parent| parent.models.mask.clone()).unwrap_or_default();
    let mask = |coverage: Mask| match task.coding.masks {
        MaskCoding::Coverage => coverage,
        MaskCoding::Coded => mask::code_mask(coder, &mut models, &coverage, wanted),
    };
    let (view, admitted) = task.scene.prepare_view(task.entry.view, task.coding, mask, admit)?;
    Ok((view, models, admitted))
}

fn parent<'d>(task: &ViewTask<'d>) -> Option<&'d DecodedReference> {
    task.decoded.get(task.entry.parent?)?.as_ref()?.reference.as_ref()
}

/// Predicts the view from its references and runs `code` for each component.
fn code_components<T: Send>(
    task: &ViewTask,
    view: &PreparedView,
    code: impl Fn(usize, Option<&[PlaneSignal]>, CoefficientModels) -> T + Sync + Send,
) -> Vec<T> {
    let coding = task.coding;
    let reprojections = Reprojections::new(view, task.entry, task.decoded);
    let parent = parent(task);
    parallel::map(coding.components.len(), |index| {
        let models = parent
            .map_or_else(|| CoefficientModels::new(coding.modelling), |parent| parent.models.components[index].clone());
        let references: Vec<_> = (reprojections.references.iter())
            .map(|(reference, positions, share)| (&reference.pictures[index], &positions[..], *share))
            .collect();
        let predicted = (!references.is_empty()).then(|| {
            let shaded = coding.components[index].shaded;
            let low = view.window.low_band(view.level);
            let predicted = predict([low.width, low.height], view.plan.row_runs(view.level), &references, shaded);
            view.plan.forward_from(view.level, predicted)
        });
        code(index, predicted.as_deref(), models)
    })
}

fn decoded_view(
    view: PreparedView,
    signals: Vec<(MaskedPixels, Option<MaskedPixels>)>,
    models: ViewModels,
    part: ViewPart,
) -> DecodedView {
    let (size, window, level) = (view.low_size(), view.window.low_band(view.level), view.level);
    let PreparedView { mask, window: whole, geometry, .. } = view;
    let (mut signals, lows): (Vec<_>, Vec<_>) = signals.into_iter().unzip();
    let reference = part.is_reference().then(|| {
        let is_whole = part.finest_level(level) == level;
        let pictures = if is_whole { std::mem::take(&mut signals) } else { lows.into_iter().flatten().collect() };
        let pictures = pictures.into_iter().map(|pixels| ReferenceImage::new(pixels, size, window)).collect();
        DecodedReference { seen: ReferenceView::new(geometry), pictures, models }
    });
    DecodedView { mask, window: whole, level, signals, reference }
}
