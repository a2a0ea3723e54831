//! Profile `predictive`: the photographs' planes, predicted through the mesh from decoded views.
//!
//! Way of a picture: sqrt domain, colours rotated, predicted by warping up to two decoded views and by the model of the reflectance, all
//! transformed by the shape-adaptive 9/7, the scaled prediction subtracted, quantised, coded with contexts from the prediction.

#[cfg(feature = "encode")]
pub(crate) mod colour;
pub(crate) mod decode;
#[cfg(feature = "encode")]
pub(crate) mod encode;
pub(crate) mod header;
pub(crate) mod model;
pub(crate) mod on_demand;
pub(crate) mod order;
mod picture;
mod reflected;
mod region;
#[cfg(feature = "encode")]
pub(crate) mod repair;
pub(crate) mod workspace;

#[cfg(feature = "encode")]
pub(crate) use encode::encode_to_target;

use crate::error::Result;
use crate::image::Mask;
use crate::limits::Reservation;
use crate::mesh::Mesh;
use crate::parallel;
use crate::quantise::bands::Quantiser;
use crate::residual::coefficients::{CoefficientModels, Modelling, PictureTask, Prediction};
use crate::residual::mask::MaskModels;
use crate::residual::tiles::{TileGrid, TileSelection, Tiling};
use crate::surface::reproject::{ReferenceView, Reprojection, reproject};
use crate::surface::view_geometry::{ViewGeometry, ViewedMesh};
use crate::surface::warp::{REFERENCE_RINGS, ReferenceImage};
use crate::transform::band_masks::low_mask;
use crate::transform::window::Window;
use crate::views::{Camera, View};

use crate::transform::masked::MaskedPixels;
use crate::transform::shape_adaptive::{ColourLanes, PixelRun, WaveletPlan, level_count};
use crate::transform::synthesis::{HalfPicture, StripScratch};
use glam::Vec4;
use model::PredictionModel;
use order::{DepthFirst, OrderEntry};
use picture::ViewPart;
use region::RegionPart;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use workspace::{LEAST_PARALLEL_VIEWS, MAX_PARALLEL_VIEWS, ParallelBudget, PlaneSignal};

/// Coding of one component's pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComponentCoding {
    /// Quantiser step in the sqrt domain.
    pub step: f32,
    /// See [`Quantiser::shrink`], in 1/256.
    pub shrink: [u8; 2],
    /// Rows: what each coded channel takes of red, green and blue, in 1/16384. Orthonormal but for rounding.
    pub rotation: [[i16; 3]; 3],
    /// Whether negative radiance is coded too (as `-sqrt(-x)`).
    pub signed: bool,
    /// Whether predictions follow the ratio of the irradiances (diffuse light does, highlights do not).
    pub shaded: bool,
}

impl ComponentCoding {
    /// The quantiser of a step of the order whose scale is `scale / 64`.
    pub fn quantiser(&self, scale: u8) -> Quantiser {
        Quantiser {
            step: self.step * (scale as f32 * (1.0 / 64.0)),
            shrink: self.shrink.map(|s| s as f32 * (1.0 / 256.0)),
        }
    }
    /// Returns the rotation and its inverse as matrices.
    pub fn colour_transform(&self) -> ColourTransform {
        let entry = |row: usize, column: usize| self.rotation[row][column] as f32 * (1.0 / 16384.0);
        let column = |k: usize| Vec4::new(entry(0, k), entry(1, k), entry(2, k), 0.0);
        let row = |k: usize| Vec4::new(entry(k, 0), entry(k, 1), entry(k, 2), 0.0);
        ColourTransform { rotation: [column(0), column(1), column(2)], inverse: [row(0), row(1), row(2)] }
    }
}

/// A rotation of colours and its inverse.
#[derive(Debug, Clone, Copy)]
pub struct ColourTransform {
    rotation: [Vec4; 3],
    inverse: [Vec4; 3],
}

impl ColourTransform {
    /// Returns the coded channels of a colour in the sqrt domain.
    #[inline(always)]
    pub(crate) fn rotate(&self, colour: Vec4) -> Vec4 {
        product(&self.rotation, colour)
    }
    /// Returns the colour in the sqrt domain of coded channels.
    #[inline(always)]
    pub(crate) fn unrotate(&self, channels: Vec4) -> Vec4 {
        product(&self.inverse, channels)
    }
}

/// A matrix, given by its columns, times a vector: sums from left to right.
#[inline(always)]
fn product(columns: &[Vec4; 3], v: Vec4) -> Vec4 {
    columns[0] * Vec4::splat(v.x) + columns[1] * Vec4::splat(v.y) + columns[2] * Vec4::splat(v.z)
}

/// Coding of masks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskCoding {
    /// A view's mask is what the mesh covers in it; no bits.
    Coverage = 0,
    /// Each view's mask is coded, given what the mesh covers.
    Coded = 1,
}

/// Side of a tile in coefficients, binary logarithm, where the encoder is not told.
pub(crate) const DEFAULT_TILE_SIDE_LOG2: u8 = 8;

/// Coding of all pictures of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneCoding {
    /// Per component.
    pub components: Vec<ComponentCoding>,
    /// Coding of masks.
    pub masks: MaskCoding,
    /// Levels of the transform above the picture that is predicted, 0 to 3: 0 the photograph itself, 1 its low band of half the size, 2 one
    /// of a quarter. Finer bands are coded in tiles, without prediction.
    pub prediction_level: u8,
    /// Entropy modelling of coefficients.
    pub modelling: Modelling,
    /// Whether views are predicted from the reflectance, too.
    pub is_modelled: bool,
    /// Binary logarithm of a tile's side, in coefficients of its bands; not used at prediction level 0.
    pub tile_side_log2: u8,
}

impl PlaneCoding {
    /// The tiles of a view.
    pub fn tile_grid(&self, camera: &Camera) -> TileGrid {
        TileGrid::new([camera.width as usize, camera.height as usize], self.prediction_level, self.tile_side_log2)
    }
}

/// The mesh and the views that all pictures are predicted with.
#[derive(Debug)]
pub(crate) struct PredictionScene<'a> {
    surface: ViewedMesh<'a>,
    views: Cow<'a, [View]>,
    /// What the views are predicted from besides, if they are.
    model: Option<Arc<PredictionModel>>,
}

/// A view prepared for coding: mask, transform and geometry.
#[derive(Debug)]
struct PreparedView {
    /// Pixels that show the object.
    mask: Mask,
    /// Bounding window of the mask.
    window: Window,
    /// Transform of the mask in the window, but for the finest levels that are left out.
    plan: WaveletPlan,
    /// The tiles of its finest levels.
    tiling: Tiling,
    /// What is wanted of the photograph, if that is not all.
    region: Option<RegionPart>,
    /// Levels of the transform above the picture that is predicted.
    level: usize,
    /// Geometry at the resolution of the predicted picture.
    geometry: ViewGeometry,
    /// Signals of the model, by component, at this resolution in the window; empty if views are not predicted from it.
    model: Vec<PlaneSignal>,
}

impl PreparedView {
    /// The coefficients of one component.
    fn picture_task<'a>(&'a self, quantiser: &'a Quantiser, prediction: Prediction<'a>) -> PictureTask<'a> {
        let tiled_bands = match &self.region {
            Some(region) => region.bands(),
            None => self.plan.bands().get(self.base_bands()..).unwrap_or_default(),
        };
        PictureTask { plan: &self.plan, quantiser, prediction, tiling: &self.tiling, tiled_bands }
    }
    /// Bands that are not cut into tiles.
    fn base_bands(&self) -> usize {
        self.plan.level_bands(self.level).start
    }
    /// Size of the picture that is predicted.
    fn low_size(&self) -> [usize; 2] {
        [self.mask.width, self.mask.height].map(|size| size.div_ceil(1 << self.level))
    }
}

/// Adaptive state that one view hands to those coded after it.
#[derive(Debug, Clone, Default)]
pub(crate) struct ViewModels {
    mask: MaskModels,
    /// Per component.
    components: Vec<CoefficientModels>,
}

/// A decoded view.
#[derive(Debug)]
pub(crate) struct DecodedView {
    /// Transform of the mask in the window.
    plan: WaveletPlan,
    /// Pixels that show the object, at the photograph's size.
    mask: Mask,
    /// The part of the photograph that the signals hold.
    window: Window,
    /// Levels of the transform that the photograph leaves out; 0 at its full size.
    reduction: usize,
    /// Whether the photograph is a region of the view's.
    is_region: bool,
    /// Levels of the transform above the picture that later views are predicted from.
    level: usize,
    /// Per component. Empty if the references of the photograph's size hold them, or where only the references were decoded.
    signals: Vec<DecodedSignal>,
    /// For views that later ones are predicted from.
    reference: Option<DecodedReference>,
}

/// A component of a decoded photograph.
#[derive(Debug)]
enum DecodedSignal {
    Whole(MaskedPixels),
    /// Of which the last level of the transform is undone when it is read.
    Half(HalfPicture),
}

impl DecodedSignal {
    fn bytes(&self) -> u64 {
        match self {
            DecodedSignal::Whole(pixels) => pixels.bytes(),
            DecodedSignal::Half(half) => half.bytes(),
        }
    }
}

/// Data of a decoded view for those predicted from it.
#[derive(Debug)]
struct DecodedReference {
    seen: ReferenceView,
    /// Per component.
    pictures: Vec<ReferenceImage>,
    /// What the model shows, per component, where that is warped like the picture.
    modelled: Vec<Option<ReferenceImage>>,
    models: ViewModels,
}

impl DecodedView {
    /// Calls `visit` for the mask's runs in a range of the window's rows, row by row, with a component's signal.
    fn for_each_run(
        &self,
        component: usize,
        rows: Range<usize>,
        strip: &mut StripScratch,
        visit: impl FnMut((&PixelRun, &[ColourLanes])),
    ) {
        match (self.signals.get(component), &self.reference) {
            (Some(DecodedSignal::Whole(signal)), _) => signal.runs(&rows).for_each(visit),
            (Some(DecodedSignal::Half(half)), _) => half.for_each_run(&self.plan, rows, strip, visit),
            (None, Some(reference)) if self.level == self.reduction => {
                let picture = reference.pictures.get(component);
                picture.into_iter().flat_map(|picture| picture.runs(&rows)).for_each(visit);
            }
            _ => {}
        }
    }
    /// Frees what only handing the view out takes.
    fn keep_reference(&mut self) {
        (self.mask, self.signals) = (Mask::default(), Vec::new());
    }
    /// Bytes of memory of the view.
    fn bytes(&self) -> u64 {
        let signals: u64 = self.signals.iter().map(DecodedSignal::bytes).sum();
        let reference = self.reference.as_ref().map_or(0, |DecodedReference { seen, pictures, modelled, .. }| {
            let modelled: u64 = modelled.iter().flatten().map(ReferenceImage::bytes).sum();
            let pictures: u64 = pictures.iter().map(|picture| picture.bytes() + workspace::MODEL_BYTES).sum();
            seen.bytes() + pictures + modelled
        });
        self.mask.data.len() as u64 + self.plan.bytes() + signals + reference
    }
    /// Whether the photograph can be had.
    fn has_signals(&self) -> bool {
        !self.is_region && self.level == self.reduction || !self.signals.is_empty()
    }
}

impl<'a> PredictionScene<'a> {
    /// Prepares a mesh for its views.
    pub(crate) fn new(mesh: Cow<'a, Mesh>, views: Cow<'a, [View]>) -> Self {
        PredictionScene { surface: ViewedMesh::new(mesh), views, model: None }
    }

    /// Predicts views from a model, too.
    pub(crate) fn with_model(self, model: Option<Arc<PredictionModel>>) -> Self {
        PredictionScene { model, ..self }
    }

    /// Bytes that drawing the model takes beside what the view's size does.
    pub(crate) fn drawing_bytes(&self) -> u64 {
        self.model.as_ref().map_or(0, |model| model.drawing_bytes())
    }

    /// Renders the geometry of a view, of which a part is to be coded; `mask` returns its mask from the coverage of the mesh, `admit` may
    /// refuse its window.
    fn prepare_view<T>(
        &self,
        view: usize,
        (coding, part): (&PlaneCoding, ViewPart),
        mask: impl FnOnce(Mask) -> Mask,
        admit: impl FnOnce(&Window) -> Result<T>,
    ) -> Result<(PreparedView, T)> {
        let view = &self.views[view];
        let (width, height) = (view.camera.width as usize, view.camera.height as usize);
        let levels = level_count(width, height);
        let level = levels.min(coding.prediction_level as usize);
        let mut geometry =
            ViewGeometry::new(&self.surface, View { camera: low_camera(&view.camera, level), ..view.clone() });
        let low = geometry.raster.coverage();
        let mask = mask(if level == 0 { low } else { enlarged(&low, width, height, level) });
        let window = Window::around_mask(&mask, REFERENCE_RINGS << level);
        let admitted = admit(&window)?;
        let inside = Mask { width: window.width, height: window.height, data: window.crop(&mask.data, width) };
        let (region, grid) = (part.photograph_region(), coding.tile_grid(&view.camera));
        let mut tiles = part.tiles(grid);
        // Masks of the levels that are not planned as a whole.
        let (mut finer, mut low) = (Vec::new(), inside);
        for _ in 0..if region.is_some() { level } else { tiles.finest_level() } {
            let next = low_mask(&low);
            finer.push(std::mem::replace(&mut low, next));
        }
        let plan = WaveletPlan::above(&finer, low, levels);
        geometry.extend(&window.low_band(level), plan.row_runs(level));
        let region = region.map(|region| RegionPart::new((&region, part.reduction), &tiles, &window, &finer, &plan));
        if region.as_ref().is_some_and(|region| !region.has_tiles()) {
            tiles = TileSelection::above(grid, level);
        }
        let base = plan.level_bands(level).start;
        let bands = region.as_ref().map_or_else(|| plan.bands().get(base..).unwrap_or_default(), RegionPart::bands);
        let rows = (&window.low_band(level), plan.row_runs(level), level);
        // A view that shows nothing has no model, so that it can be written without one.
        let model = match self.model.as_ref().filter(|_| coding.is_modelled && !rows.1.is_empty()) {
            Some(model) => model.signals(&geometry, coding, rows)?,
            None => Vec::new(),
        };
        let tiling = Tiling::new(&tiles, window.corner(), |level| window.low_band(level).size(), bands);
        Ok((PreparedView { mask, window, plan, tiling, region, level, geometry, model }, admitted))
    }
}

/// The camera of the low band after some levels: its pixel `k` stands where pixel `2^levels k` of the picture does.
pub(crate) fn low_camera(camera: &Camera, levels: usize) -> Camera {
    if levels == 0 {
        return *camera;
    }
    let scale = 1.0 / (1u32 << levels) as f64;
    Camera {
        width: camera.width.div_ceil(1 << levels),
        height: camera.height.div_ceil(1 << levels),
        focal: camera.focal.map(|f| f * scale),
        principal: camera.principal.map(|c| (c - 0.5) * scale + 0.5),
        ..*camera
    }
}

/// A mask of the low band's size at the picture's.
fn enlarged(low: &Mask, width: usize, height: usize, levels: usize) -> Mask {
    let mut data = Vec::with_capacity(width * height);
    let mut line = Vec::with_capacity(low.width << levels);
    for y in 0..height {
        if y & ((1 << levels) - 1) == 0 {
            line.clear();
            low.row(y >> levels).iter().for_each(|&set| line.resize(line.len() + (1 << levels), set));
        }
        data.extend_from_slice(&line[..width]);
    }
    Mask { width, height, data }
}

/// Positions of a view's pixels in its references.
struct Reprojections<'d> {
    references: Vec<(&'d DecodedReference, Vec<Reprojection>, f32)>,
}

impl<'d> Reprojections<'d> {
    fn new(view: &PreparedView, entry: &OrderEntry, decoded: &'d [Option<DecodedView>]) -> Self {
        let references: Vec<(&DecodedReference, f32)> = (entry.references.iter())
            .filter_map(|&(view, share)| Some((decoded.get(view)?.as_ref()?.reference.as_ref()?, share as f32)))
            .collect();
        let seen: Vec<&ReferenceView> = references.iter().map(|(reference, _)| &reference.seen).collect();
        let found = reproject(&view.geometry, &seen, &view.window.low_band(view.level), view.plan.row_runs(view.level));
        let of = references.into_iter().zip(found).map(|((view, share), sources)| (view, sources, share)).collect();
        Reprojections { references: of }
    }
}

/// Runs `work` for the given entries of the order, depth first and as many side by side as the memory budget allows, and hands
/// the results to `done`, with the entries' indices. Decoded views are kept as long as later entries need them; `work` receives
/// `true` if a later view is predicted from this one.
fn run_entries<T: Send>(
    order: &[OrderEntry],
    steps: &[usize],
    room: &ParallelBudget,
    work: impl Fn(usize, &[Option<DecodedView>], bool) -> Result<(T, DecodedView)> + Sync + Send,
    mut done: impl FnMut(Vec<(usize, T)>) -> Result<()>,
) -> Result<()> {
    let views = room.views.len();
    let mut needs = ReferenceCounts::new(order, steps, views);
    let mut decoded: Vec<Option<DecodedView>> = (0..views).map(|_| None).collect();
    let mut held: Vec<Option<Reservation>> = (0..views).map(|_| None).collect();
    let mut schedule = DepthFirst::new(order, steps);
    loop {
        let most = parallel::threads().clamp(LEAST_PARALLEL_VIEWS, MAX_PARALLEL_VIEWS);
        let group = schedule.take(most, |first| room.parallel_views(order, first));
        if group.is_empty() {
            return Ok(());
        }
        let results = parallel::map(group.len(), |k| work(group[k], &decoded, needs.is_needed(order[group[k]].view)));
        let mut given = Vec::with_capacity(group.len());
        for (&index, result) in group.iter().zip(results) {
            let (result, mut view) = result?;
            let step = &order[index];
            view.keep_reference();
            if needs.is_needed(step.view) {
                held[step.view] = Some(room.budget.reserve("decoded views", view.bytes())?);
                decoded[step.view] = Some(view);
            }
            needs.count_done(step, |view| (decoded[view], held[view]) = (None, None));
            given.push((index, result));
        }
        schedule.done(order, &group);
        done(given)?;
    }
}

/// Counts of the later entries that need each view.
struct ReferenceCounts(Vec<usize>);

impl ReferenceCounts {
    fn new(order: &[OrderEntry], steps: &[usize], views: usize) -> Self {
        let mut needs = ReferenceCounts(vec![0; views]);
        for &index in steps {
            order[index].dependencies().for_each(|view| needs.0[view] += 1);
        }
        needs
    }
    fn is_needed(&self, view: usize) -> bool {
        self.0[view] > 0
    }
    /// Counts a step as done and calls `drop` for each view that nothing needs any more.
    fn count_done(&mut self, step: &OrderEntry, mut drop: impl FnMut(usize)) {
        for view in step.dependencies() {
            self.0[view] -= 1;
            if self.0[view] == 0 {
                drop(view);
            }
        }
    }
}

#[cfg(all(test, feature = "encode", feature = "parallel"))]
mod test_model;
#[cfg(all(test, feature = "encode", feature = "parallel"))]
mod tests;
