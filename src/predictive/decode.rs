//! Streams to photographs: one entry of the coding order, and all selected ones with what they are predicted from.

use super::header::{CodedEntry, PlaneHeader};
use super::model::PredictionModel;
use super::picture::{self, ViewPart, ViewStreams, ViewTask};
use super::workspace::{ParallelBudget, PlaneWorkspaces, photograph_bytes};
use super::{DecodedView, PredictionScene, low_camera, order, run_entries};
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::image::{Mask, Region, RgbImage};
use crate::limits::{Budget, Reservation};
use crate::mesh::Mesh;
use crate::parallel;
use crate::residual::tiles::TileSelection;
use crate::surface::raster;
use crate::transform::signal;
use crate::transform::synthesis::{STRIP_ROWS, StripScratch};
use crate::views::{Photograph, View};
use glam::Vec4;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Decoder of the views of a file, whatever their order ([`PlaneDecoder::for_each_view`],
/// [`ViewDecoder`](super::on_demand::ViewDecoder)).
#[derive(Debug)]
pub(crate) struct PlaneDecoder<'a> {
    pub(super) header: Cow<'a, PlaneHeader>,
    pub(super) scene: PredictionScene<'a>,
    white: [f64; 3],
    /// Levels of the transform that photographs leave out.
    reduction: usize,
    /// What of them is wanted; none for all.
    region: Option<Region>,
    pub(super) workspaces: PlaneWorkspaces,
}

impl<'a> PlaneDecoder<'a> {
    /// Creates a decoder of the views of `header`. `white` is the white board's radiance.
    pub(crate) fn new(header: &'a PlaneHeader, mesh: &'a Mesh, views: &'a [View], white: [f64; 3]) -> Self {
        PlaneDecoder::of(Cow::Borrowed(header), Cow::Borrowed(mesh), Cow::Borrowed(views), white)
    }

    pub(super) fn of(
        header: Cow<'a, PlaneHeader>,
        mesh: Cow<'a, Mesh>,
        views: Cow<'a, [View]>,
        white: [f64; 3],
    ) -> Self {
        let scene = PredictionScene::new(mesh, views);
        PlaneDecoder { header, scene, white, reduction: 0, region: None, workspaces: PlaneWorkspaces::default() }
    }

    /// Predicts views from a model, too, as the head says.
    pub(crate) fn with_model(self, model: Option<Arc<PredictionModel>>) -> Self {
        PlaneDecoder { scene: self.scene.with_model(model), ..self }
    }

    /// Leaves out the first `levels` levels of the photographs, which halves their size so often.
    pub(crate) fn reduced_by(self, levels: usize) -> Self {
        PlaneDecoder { reduction: levels, ..self }
    }

    /// Decodes only a region of the photographs that the others leave; these have it.
    pub(crate) fn within(self, region: Option<Region>) -> Self {
        PlaneDecoder { region, ..self }
    }

    /// Changes the region.
    pub(super) fn set_region(&mut self, region: Option<Region>) {
        self.region = region;
    }

    /// Whether only a region is decoded.
    pub(super) fn has_region(&self) -> bool {
        self.region.is_some()
    }

    /// Returns a decoded view as radiance.
    pub(super) fn radiance<'d>(&'d self, view: &'d DecodedView) -> DecodedPhotograph<'d> {
        DecodedPhotograph::new(&self.header, self.white, view)
    }

    /// The tiles of an entry that are needed if its photograph is wanted, or only what others are predicted from.
    fn tiles(&self, coded: &CodedEntry, is_photograph: bool) -> TileSelection {
        let grid = self.header.coding.tile_grid(&self.scene.views[coded.entry.view].camera);
        self.part(true, is_photograph).tiles(grid)
    }

    fn part(&self, is_reference: bool, is_photograph: bool) -> ViewPart {
        ViewPart { is_reference, is_photograph, reduction: self.reduction, region: self.region }
    }

    /// Ranges of the section's streams that are needed of an entry, in order, whether its photograph is wanted or only what others are predicted from.
    pub(crate) fn needed_ranges(&self, index: usize, is_photograph: bool) -> Vec<Range<u64>> {
        let coded = &self.header.entries[index];
        coded.needed_ranges(self.tiles(coded, is_photograph).includes())
    }

    /// Compares the checksums of the needed streams of an entry, and checks that drawing its view is bounded work.
    pub(super) fn check(&self, index: usize, streams: &[u8], is_photograph: bool) -> Result<()> {
        let coded = &self.header.entries[index];
        let view = &self.scene.views[coded.entry.view];
        if !coded.is_intact(self.tiles(coded, is_photograph).includes(), streams) {
            let message = format!("checksum of view {} does not match: the file is damaged", view.name);
            return Err(Error::format(Tag::PLANES, coded.offset, message));
        }
        raster::check_work(self.scene.surface.mesh(), &view.camera)
    }

    /// Decodes an entry of the coding order from its needed streams, one after the other; `decoded` holds the views that it depends
    /// on. Calls `take` with the view; without it the photograph is not decoded, only what later views are predicted from. The memory of a photograph is charged until the reservation is dropped.
    pub(super) fn decode<'b, T>(
        &self,
        index: usize,
        streams: &[u8],
        decoded: &[Option<DecodedView>],
        is_reference: bool,
        take: Option<impl FnOnce(DecodedPhotograph) -> T>,
        budget: &'b Budget,
    ) -> Result<(Option<(T, Reservation<'b>)>, DecodedView)> {
        let coded = &self.header.entries[index];
        let (scene, coding) = (&self.scene, &self.header.coding);
        let part = self.part(is_reference, take.is_some());
        let parts = ViewStreams::cut(coded, self.tiles(coded, take.is_some()).includes(), streams);
        let parts = parts.ok_or_else(|| {
            Error::format(Tag::PLANES, coded.offset, "a view's streams are shorter than the head says")
        })?;
        if coding.is_modelled && scene.model.is_none() {
            return Err(Error::format(
                Tag::PLANES,
                8u64,
                "the views are predicted from a reflectance that is not there",
            ));
        }
        let task = ViewTask { scene, entry: &coded.entry, scale: coded.scale, coding, decoded, part };
        let mut view = picture::decode(&task, &parts, coded.offset, &self.workspaces, budget)?;
        let taken = match take {
            Some(take) => {
                let mut camera = low_camera(&self.scene.views[coded.entry.view].camera, self.reduction);
                if let Some(region) = &self.region {
                    camera = camera.cropped(region);
                }
                let bytes = photograph_bytes(&camera, coding.components.len());
                let reservation = budget.reserve("a decoded photograph", bytes)?;
                Some((take(self.radiance(&view)), reservation))
            }
            None => None,
        };
        self.workspaces.recycle(&mut view);
        Ok((taken, view))
    }

    /// Decodes the wanted views and those they depend on, side by side where they do not depend on each other, and calls
    /// `done` with the wanted ones as linear radiance, some at a time and in any order. `read` returns a range of the section's streams;
    /// entries for which it returns `None` (a file cut short) are left out with all
    /// that depend on them.
    /// # Errors
    /// [`Error::Format`] if the streams are damaged; [`Error::Limits`] if the memory for one view and those it is predicted
    /// from is not available, or drawing it is too much work; those of `read` and `done`.
    pub(crate) fn for_each_view(
        &self,
        wanted: impl Fn(usize) -> bool + Sync + Send,
        mut read: impl FnMut(Range<u64>) -> Result<Option<Vec<u8>>>,
        budget: &Budget,
        mut done: impl FnMut(Vec<(usize, Photograph)>) -> Result<()>,
    ) -> Result<()> {
        let views = &self.scene.views;
        let order = self.header.order();
        let mut streams: Vec<Option<Vec<u8>>> = vec![None; order.len()];
        let mut present = vec![false; views.len()];
        let mut entries = Vec::new();
        for index in order::closure(&order, &wanted) {
            let coded = &self.header.entries[index];
            if coded.entry.dependencies().any(|view| !present[view]) {
                continue;
            }
            let is_wanted = wanted(coded.entry.view);
            let parts: Result<Option<Vec<Vec<u8>>>> =
                self.needed_ranges(index, is_wanted).into_iter().map(&mut read).collect();
            let Some(mut parts) = parts? else { continue };
            let bytes = if parts.len() == 1 { parts.swap_remove(0) } else { parts.concat() };
            self.check(index, &bytes, is_wanted)?;
            streams[index] = Some(bytes);
            present[coded.entry.view] = true;
            entries.push(index);
        }
        let room = ParallelBudget {
            views,
            coding: &self.header.coding,
            budget,
            drawing_bytes: self.scene.drawing_bytes(),
            most: u64::MAX,
            workspaces: &self.workspaces,
        };
        let decode = |index: usize, decoded: &[Option<DecodedView>], is_reference: bool| {
            let streams = streams[index].as_deref().unwrap_or_default();
            let take = wanted(order[index].view).then_some(|view: DecodedPhotograph| view.photograph());
            self.decode(index, streams, decoded, is_reference, take, budget)
        };
        run_entries(&order, &entries, &room, decode, |given| {
            let given = given.into_iter().filter_map(|(index, photograph)| Some((order[index].view, photograph?)));
            let (photographs, _reservations): (Vec<_>, Vec<_>) =
                given.map(|(view, (photograph, reservation))| ((view, photograph), reservation)).unzip();
            done(photographs)
        })
    }
}

/// Decodes as [`PlaneDecoder::for_each_view`] and gathers the photographs by view; `None` for views not wanted or left out.
/// # Errors
/// As [`PlaneDecoder::for_each_view`].
pub fn decode(
    header: &PlaneHeader,
    mesh: &Mesh,
    (views, white): (&[View], [f64; 3]),
    wanted: impl Fn(usize) -> bool + Sync + Send,
    read: impl FnMut(Range<u64>) -> Result<Option<Vec<u8>>>,
    budget: &Budget,
) -> Result<Vec<Option<Photograph>>> {
    for (_, view) in views.iter().enumerate().filter(|(view, _)| wanted(*view)) {
        budget.charge("decoded photographs", photograph_bytes(&view.camera, header.coding.components.len()))?;
    }
    let mut photographs: Vec<Option<Photograph>> = vec![None; views.len()];
    PlaneDecoder::new(header, mesh, views, white).for_each_view(wanted, read, budget, |given| {
        given.into_iter().for_each(|(view, photograph)| photographs[view] = Some(photograph));
        Ok(())
    })?;
    Ok(photographs)
}

/// A decoded view as linear radiance.
#[derive(Debug, Clone, Copy)]
pub struct DecodedPhotograph<'a> {
    header: &'a PlaneHeader,
    white: [f32; 3],
    view: &'a DecodedView,
}

impl<'a> DecodedPhotograph<'a> {
    pub(super) fn new(header: &'a PlaneHeader, white: [f64; 3], view: &'a DecodedView) -> Self {
        DecodedPhotograph { header, white: white.map(|w| w as f32), view }
    }

    /// Pixels that show the object.
    pub fn mask(&self) -> &'a Mask {
        &self.view.mask
    }

    /// Calls `visit` for each row of the window that holds the mask, with the index of its first pixel in the image: a
    /// component's radiance with 1 as fourth channel, 0 outside the mask.
    pub fn for_each_row(&self, component: usize, mut visit: impl FnMut(usize, &[[f32; 4]])) {
        let (window, columns) = (self.view.window, self.mask().width);
        let mut strip = StripScratch::default();
        for first in (0..window.height).step_by(STRIP_ROWS) {
            let rows = first..window.height.min(first + STRIP_ROWS);
            self.for_each_row_within(component, rows, &mut strip, |y, row| {
                visit((window.top + y) * columns + window.left, row);
            });
        }
    }

    /// As [`DecodedPhotograph::for_each_row`], for some rows of the window, by their numbers.
    fn for_each_row_within(
        &self,
        component: usize,
        rows: Range<usize>,
        strip: &mut StripScratch,
        mut visit: impl FnMut(usize, &[[f32; 4]]),
    ) {
        let Some(coding) = self.header.coding.components.get(component) else { return };
        let colours = coding.colour_transform();
        let white = Vec4::new(self.white[0], self.white[1], self.white[2], 0.0);
        // A low band is larger by the gain of the low pass along rows and columns, for each level.
        let scale = 1.0 / (1u32 << self.view.reduction) as f32;
        let mut radiance = vec![[0.0; 4]; self.view.window.width];
        let mut line = rows.start;
        self.view.for_each_run(component, rows.clone(), strip, |(run, pixels)| {
            // Rows before the run's are complete.
            while line < run.line as usize {
                visit(line, &radiance);
                radiance.fill([0.0; 4]);
                line += 1;
            }
            for (radiance, pixel) in radiance[run.start as usize..].iter_mut().zip(pixels) {
                let signal = colours.unrotate(Vec4::from_array(*pixel) * scale);
                *radiance = (signal::inverse(signal, white, coding.signed) + Vec4::W).to_array();
            }
        });
        while line < rows.end {
            visit(line, &radiance);
            radiance.fill([0.0; 4]);
            line += 1;
        }
    }

    /// Returns all components.
    pub fn photograph(&self) -> Photograph {
        let (mask, window) = (self.mask(), self.view.window);
        let image = |component: usize| {
            let mut image = RgbImage::filled(mask.width, mask.height, [0.0; 3]);
            let rows = window.top * mask.width..(window.top + window.height) * mask.width;
            parallel::for_each_chunk(&mut image.data[rows], STRIP_ROWS * mask.width, |k, part| {
                let first = k * STRIP_ROWS;
                let rows = first..window.height.min(first + STRIP_ROWS);
                self.for_each_row_within(component, rows, &mut StripScratch::default(), |y, row| {
                    let at = (y - first) * mask.width + window.left;
                    part[at..].iter_mut().zip(row).for_each(|(colour, [r, g, b, _])| *colour = [*r, *g, *b]);
                });
            });
            image
        };
        let images = (0..self.header.coding.components.len()).map(image).collect();
        Photograph { mask: mask.clone(), images }
    }
}
