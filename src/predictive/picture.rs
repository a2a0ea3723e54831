//! One view: from its prediction and its streams to pixels, and back.

use super::header::CodedEntry;
#[cfg(feature = "encode")]
use super::header::CodedTile;
use super::order::OrderEntry;
use super::region;
use super::workspace::PlaneSignal;
use super::workspace::{PlaneWorkspace, PlaneWorkspaces, ViewSize};
use super::{
    DecodedReference, DecodedSignal, DecodedView, MaskCoding, PlaneCoding, PredictionScene, PreparedView,
    Reprojections, ViewModels,
};
use crate::container::Tag;
use crate::entropy::{BitCoder, RangeDecoder};
use crate::error::{Error, Result};
use crate::image::{Mask, Region};
use crate::limits::Budget;
use crate::parallel;
#[cfg(feature = "encode")]
use crate::quantise::bands::RateDistortion;
use crate::residual::coefficients::{self, CoefficientModels, PictureStreams, Prediction};
use crate::residual::mask;
use crate::residual::tiles::{TileGrid, TileSelection};
use crate::surface::reproject::ReferenceView;
use crate::surface::warp::{ReferenceImage, predict};
use crate::transform::masked::{Coefficients, MaskedPixels};
use crate::transform::shape_adaptive::{ColourLanes, TransformScratch};
use crate::transform::synthesis::HalfPicture;
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
    /// Cuts the streams of an entry's base and of its `needed` tiles apart; `None` where they are too short.
    pub(super) fn cut(coded: &CodedEntry, needed: impl Iterator<Item = bool>, mut streams: &'s [u8]) -> Option<Self> {
        let mut next = |length: &u32| {
            let part;
            (part, streams) = streams.split_at_checked(*length as usize)?;
            Some(part)
        };
        let [mask, components @ ..] = &coded.lengths[..] else { return None };
        let mask = next(mask)?;
        let base = |length| Some(PictureStreams { base: next(length)?, tiles: Vec::with_capacity(coded.tiles.len()) });
        let mut components: Vec<PictureStreams<&[u8]>> = components.iter().map(base).collect::<Option<_>>()?;
        for (tile, is_needed) in coded.tiles.iter().zip(needed) {
            for (component, length) in components.iter_mut().zip(&tile.lengths) {
                component.tiles.push(if is_needed { next(length)? } else { &[] });
            }
        }
        Some(ViewStreams { mask, components })
    }
}

/// What is decoded of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ViewPart {
    /// Whether a later view is predicted from it.
    pub is_reference: bool,
    /// Whether its photograph is wanted.
    pub is_photograph: bool,
    /// Levels of the transform that photographs leave out; 0 at their full size.
    pub reduction: usize,
    /// What of the photograph is wanted; none for all of it.
    pub region: Option<Region>,
}

impl ViewPart {
    /// What of the photograph is wanted, if that is not all or nothing.
    pub(super) fn photograph_region(self) -> Option<Region> {
        self.region.filter(|_| self.is_photograph)
    }
    /// The tiles that are needed, of a grid down to the pictures that later views are predicted from.
    pub(super) fn tiles(self, grid: TileGrid) -> TileSelection {
        match self.photograph_region() {
            Some(region) => TileSelection::of_region(grid, &region::rectangle(&region), self.reduction),
            None => TileSelection::above(grid, if self.is_photograph { self.reduction } else { grid.levels() }),
        }
    }
}

/// One component of a view from its coefficients: the photograph's signal, if that is not the picture that later views are predicted from, and
/// that picture. `coefficients` may be taken.
fn signals(
    view: &PreparedView,
    part: ViewPart,
    coefficients: &mut Coefficients,
    work: &mut TransformScratch,
) -> (Option<DecodedSignal>, Option<MaskedPixels>) {
    let (plan, level) = (&view.plan, view.level);
    if let Some(region) = &view.region {
        let first = if part.is_reference { level } else { level.max(part.reduction) };
        let (fine, coarse) = plan.inverse_keeping(coefficients, [first, part.reduction], work);
        let pixels = region.pixels(coarse.as_ref().unwrap_or(&fine), coefficients, view.base_bands());
        return (Some(DecodedSignal::Whole(pixels)), part.is_reference.then_some(fine));
    }
    let mut inverse = |wanted: usize, kept: usize| plan.inverse_keeping(coefficients, [wanted, kept], work);
    match part.is_photograph.then_some(part.reduction) {
        Some(0) if level > 0 => {
            let (low, kept) = inverse(1, level);
            let kept = part.is_reference.then(|| kept.unwrap_or_else(|| low.clone()));
            let half = HalfPicture { low, coefficients: std::mem::take(coefficients) };
            (Some(DecodedSignal::Half(half)), kept)
        }
        Some(reduction) if !part.is_reference => (Some(DecodedSignal::Whole(inverse(reduction, reduction).0)), None),
        Some(reduction) if reduction != level => {
            let (fine, coarse) = inverse(reduction.min(level), reduction.max(level));
            match (reduction < level, coarse) {
                (true, coarse) => (Some(DecodedSignal::Whole(fine)), coarse),
                (false, coarse) => (coarse.map(DecodedSignal::Whole), Some(fine)),
            }
        }
        _ => (None, Some(inverse(level, level).0)),
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

/// Codes a view; returns its streams, and the view as the decoder has it. `target` returns a component's signal in a window;
/// `lambda` is the value of a bit in squared steps. Trials of one capture share their memory by `workspaces`.
#[cfg(feature = "encode")]
pub(crate) fn encode(
    task: &ViewTask,
    wanted_mask: &Mask,
    lambda: f32,
    target: impl Fn(&Window, usize) -> PlaneSignal + Sync + Send,
    workspaces: &PlaneWorkspaces,
) -> Result<(ViewStreams<Vec<u8>>, DecodedView)> {
    let mut coder = crate::entropy::RangeEncoder::new();
    let (view, mask_models, ()) = prepare_view(task, &mut coder, Some(wanted_mask), |_| Ok(()))?;
    let mask = coder.finish();
    let parts = code_components(task, &view, |index, prediction, mut models| {
        let quantiser = task.coding.components[index].quantiser(task.scale);
        let target = view.plan.forward(target(&view.window, index));
        let trade_off = RateDistortion { lambda };
        let picture = view.picture_task(&quantiser, prediction);
        workspaces.with(|PlaneWorkspace { coefficients, transform }| {
            let scratch = std::mem::take(coefficients);
            let stream;
            (stream, *coefficients) = coefficients::encode(&mut models, &picture, &target, trade_off, scratch);
            (models, (stream, signals(&view, task.part, coefficients, transform)))
        })
    });
    let (components, parts): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let (streams, signals): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let decoded = decoded_view(view, task.coding, signals, ViewModels { mask: mask_models, components }, task.part);
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
    let size = ViewSize::new(&captured.camera, task.coding);
    let drawing_bytes = size.drawing_bytes().saturating_add(task.scene.drawing_bytes());
    let _drawn = budget.reserve("a view being drawn", drawing_bytes)?;
    let admit = |window: &Window| {
        let (size, grid) = (size.within(window), task.coding.tile_grid(&captured.camera));
        let bytes = match task.part.photograph_region().filter(|_| grid.levels() > 0) {
            Some(region) => {
                let region = region::coding_bytes(&region, &task.part.tiles(grid), window, task.coding);
                size.coding_bytes(false).saturating_add(region)
            }
            None => size.coding_bytes(task.part.is_photograph),
        };
        budget.reserve("a view being decoded", bytes)
    };
    let mut coder = RangeDecoder::new(streams.mask);
    let (view, mask_models, _coded) = prepare_view(task, &mut coder, None, admit)?;
    if !coder.ends_as_written(0) {
        return Err(damaged("its mask"));
    }
    let parts = code_components(task, &view, |index, prediction, mut models| {
        let quantiser = task.coding.components[index].quantiser(task.scale);
        workspaces.with(|PlaneWorkspace { coefficients, transform }| {
            let scratch = std::mem::take(coefficients);
            let picture = view.picture_task(&quantiser, prediction);
            *coefficients = coefficients::decode(&streams.components[index], &mut models, &picture, scratch)?;
            Some((models, signals(&view, task.part, coefficients, transform)))
        })
    });
    let parts: Option<Vec<_>> = parts.into_iter().collect();
    let (components, signals): (Vec<_>, Vec<_>) = parts.ok_or_else(|| damaged("a component"))?.into_iter().unzip();
    Ok(decoded_view(view, task.coding, signals, ViewModels { mask: mask_models, components }, task.part))
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
    let (view, admitted) = task.scene.prepare_view(task.entry.view, (task.coding, task.part), mask, admit)?;
    Ok((view, models, admitted))
}

fn parent<'d>(task: &ViewTask<'d>) -> Option<&'d DecodedReference> {
    task.decoded.get(task.entry.parent?)?.as_ref()?.reference.as_ref()
}

/// Predicts the view from its references and runs `code` for each component.
fn code_components<T: Send>(
    task: &ViewTask,
    view: &PreparedView,
    code: impl Fn(usize, Prediction, CoefficientModels) -> T + Sync + Send,
) -> Vec<T> {
    let coding = task.coding;
    let reprojections = Reprojections::new(view, task.entry, task.decoded);
    let parent = parent(task);
    parallel::map(coding.components.len(), |index| {
        let models = parent
            .map_or_else(|| CoefficientModels::new(coding.modelling), |parent| parent.models.components[index].clone());
        let shaded = coding.components[index].shaded;
        let low = view.window.low_band(view.level);
        let (size, rows) = ([low.width, low.height], view.plan.row_runs(view.level));
        let references: Vec<_> = (reprojections.references.iter())
            .map(|(reference, positions, share)| ([&reference.pictures[index]], &positions[..], *share))
            .collect();
        // Of those that have a model where it is warped, too.
        let both: Vec<_> = (reprojections.references.iter())
            .filter_map(|(reference, positions, share)| {
                let modelled = reference.modelled.get(index)?.as_ref()?;
                Some(([&reference.pictures[index], modelled], &positions[..], *share))
            })
            .collect();
        let model = view.model.get(index);
        let is_modelled = model.is_some() && !both.is_empty();
        let (warped, known) = match references.is_empty() {
            true => (None, None),
            false if is_modelled && both.len() == references.len() => {
                let [warped, known] = predict(size, rows, &both, shaded);
                (Some(warped), Some(known))
            }
            false => {
                let [warped] = predict(size, rows, &references, shaded);
                let known = is_modelled.then(|| predict(size, rows, &both, shaded)).map(|[_, known]| known);
                (Some(warped), known)
            }
        };
        let correction = model.map(|model| {
            // What the model has beyond its own warp, or, where that says nothing, beyond that of the photographs.
            let difference = |known: &PlaneSignal| {
                let difference = |(a, b): (&ColourLanes, &ColourLanes)| std::array::from_fn(|k| a[k] - b[k]);
                model.iter().zip(known).map(difference).collect()
            };
            let correction = known.as_ref().or(warped.as_ref()).map_or_else(|| model.clone(), difference);
            view.plan.forward_from(view.level, correction)
        });
        let views = warped.map(|warped| view.plan.forward_from(view.level, warped));
        code(index, Prediction { views: views.as_deref(), correction: correction.as_deref() }, models)
    })
}

fn decoded_view(
    view: PreparedView,
    coding: &PlaneCoding,
    signals: Vec<(Option<DecodedSignal>, Option<MaskedPixels>)>,
    models: ViewModels,
    part: ViewPart,
) -> DecodedView {
    let (size, low_window, level) = (view.low_size(), view.window.low_band(view.level), view.level);
    let PreparedView { mut mask, mut window, plan, region, geometry, model, .. } = view;
    let (signals, pictures): (Vec<_>, Vec<_>) = signals.into_iter().unzip();
    let reference = part.is_reference.then(|| {
        let pictures = pictures.into_iter().flatten().map(|pixels| ReferenceImage::new(pixels, size, low_window));
        let modelled = model.into_iter().zip(&coding.components).map(|(signal, component)| {
            let pixels = || MaskedPixels::new(low_window.width, plan.row_runs(level).into(), signal);
            component.shaded.then(|| ReferenceImage::new(pixels(), size, low_window))
        });
        let modelled = modelled.collect();
        DecodedReference { pictures: pictures.collect(), modelled, seen: ReferenceView::new(geometry), models }
    });
    let (reduction, is_region) = (part.reduction, region.is_some());
    if let Some(region) = region {
        (mask, window) = (region.mask(), region.window());
    } else if !part.is_photograph && reduction < level {
        mask = Mask::default();
    } else if reduction > 0 {
        let inside = plan.low_mask(reduction);
        let [width, height] = [mask.width, mask.height].map(|size| size.div_ceil(1 << reduction));
        window = window.low_band(reduction);
        mask = Mask::filled(width, height, false);
        for y in 0..inside.height {
            let row = (window.top + y) * width + window.left;
            mask.data[row..row + inside.width].copy_from_slice(inside.row(y));
        }
    }
    let signals = signals.into_iter().flatten().collect();
    DecodedView { plan, mask, window, reduction, is_region, level, signals, reference }
}
