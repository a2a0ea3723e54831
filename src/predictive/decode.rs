//! Streams to photographs: all views, or some with what they are predicted from.

use super::header::{CodedEntry, PlaneHeader};
use super::picture::{self, ViewTask};
use super::workspace::{ParallelBudget, PlaneWorkspaces, photograph_bytes};
use super::{DecodedView, PredictionScene, order, run_waves};
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::image::{Mask, RgbImage};
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::surface::raster;
use crate::transform::signal;
use crate::views::{Photograph, View};
use glam::Vec4;
use std::borrow::Cow;

/// What all pictures of a file are decoded with.
#[derive(Debug)]
pub(super) struct PlaneDecoder<'a> {
    pub header: Cow<'a, PlaneHeader>,
    pub scene: PredictionScene<'a>,
    pub white: [f64; 3],
    pub workspaces: PlaneWorkspaces,
}

impl PlaneDecoder<'_> {
    /// Compares the checksum of a step's streams.
    pub(crate) fn check(&self, index: usize, streams: &[u8]) -> Result<()> {
        let coded = &self.header.entries[index];
        if crc32fast::hash(streams) == coded.checksum {
            return Ok(());
        }
        let name = &self.scene.views[coded.entry.view].name;
        let message = format!("checksum of view {name} does not match: the file is damaged");
        Err(Error::format(Tag::PLANES, coded.offset, message))
    }

    /// Decodes a step of the order from its streams, one after the other; `decoded` holds what it needs.
    pub(crate) fn decode(
        &self,
        index: usize,
        streams: &[u8],
        decoded: &[Option<DecodedView>],
        is_reference: bool,
        budget: &Budget,
    ) -> Result<DecodedView> {
        let coded = &self.header.entries[index];
        let mut rest = streams;
        let mut parts = Vec::with_capacity(coded.lengths.len());
        for &length in &coded.lengths {
            let (part, after) = rest.split_at_checked(length as usize).ok_or_else(|| {
                Error::format(Tag::PLANES, coded.offset, "a view's streams are shorter than the head says")
            })?;
            parts.push(part);
            rest = after;
        }
        let (scene, coding) = (&self.scene, &self.header.coding);
        let task = ViewTask { scene, entry: &coded.entry, scale: coded.scale, coding, decoded, is_reference };
        picture::decode(&task, &parts, coded.offset, &self.workspaces, budget)
    }
}

/// Decodes the views that `wanted` names, and those they depend on, and hands the wanted ones to `done` as linear radiance, some at a
/// time and in any order. `read` gives a step's streams, one after the other; steps for which it gives `None` (a file cut short) are left out with
/// all that depend on them.
/// # Errors
/// [`Error::Format`] where the streams are damaged; [`Error::Limits`] where the memory for one view and those it is predicted from is
/// not there, or drawing it is too much work; those of `read` and `done`.
pub(crate) fn for_each_view(
    header: &PlaneHeader,
    mesh: &Mesh,
    capture: (&[View], [f64; 3]),
    wanted: impl Fn(usize) -> bool + Sync + Send,
    mut read: impl FnMut(&CodedEntry) -> Result<Option<Vec<u8>>>,
    budget: &Budget,
    mut done: impl FnMut(Vec<(usize, Photograph)>) -> Result<()>,
) -> Result<()> {
    let (views, white) = capture;
    let scene = PredictionScene::new(Cow::Borrowed(mesh), Cow::Borrowed(views));
    let pictures = PlaneDecoder { header: Cow::Borrowed(header), scene, white, workspaces: PlaneWorkspaces::default() };
    let order = header.order();
    let mut streams: Vec<Option<Vec<u8>>> = vec![None; order.len()];
    let mut present = vec![false; views.len()];
    let mut steps = Vec::new();
    for index in order::closure(&order, &wanted) {
        let coded = &header.entries[index];
        let step = &coded.entry;
        if step.dependencies().any(|view| !present[view]) {
            continue;
        }
        let Some(bytes) = read(coded)? else { continue };
        pictures.check(index, &bytes)?;
        raster::check_work(mesh, &views[step.view].camera)?;
        streams[index] = Some(bytes);
        present[step.view] = true;
        steps.push(index);
    }
    let room = ParallelBudget { views, coding: &header.coding, budget, workspaces: &pictures.workspaces };
    let decode = |index: usize, decoded: &[Option<DecodedView>], is_reference: bool| {
        let streams = streams[index].as_deref().unwrap_or_default();
        let mut view = pictures.decode(index, streams, decoded, is_reference, budget)?;
        let number = order[index].view;
        let photograph = match wanted(number) {
            true => {
                let bytes = photograph_bytes(&views[number].camera, header.coding.components.len());
                let held = budget.reserve("a decoded photograph", bytes)?;
                Some((DecodedPhotograph::new(header, white, &view).photograph(), held))
            }
            false => None,
        };
        pictures.workspaces.recycle(&mut view);
        Ok((photograph, view))
    };
    run_waves(&order, &steps, &room, decode, |given| {
        let given = given.into_iter().filter_map(|(index, photograph)| Some((order[index].view, photograph?)));
        let (photographs, _held): (Vec<_>, Vec<_>) =
            given.map(|(view, (photograph, held))| ((view, photograph), held)).unzip();
        done(photographs)
    })
}

/// [`for_each_view`], gathered by view; `None` for views not wanted.
pub fn decode(
    header: &PlaneHeader,
    mesh: &Mesh,
    (views, white): (&[View], [f64; 3]),
    wanted: impl Fn(usize) -> bool + Sync + Send,
    read: impl FnMut(&CodedEntry) -> Result<Option<Vec<u8>>>,
    budget: &Budget,
) -> Result<Vec<Option<Photograph>>> {
    for (_, view) in views.iter().enumerate().filter(|(view, _)| wanted(*view)) {
        budget.charge("decoded photographs", photograph_bytes(&view.camera, header.coding.components.len()))?;
    }
    let mut photographs: Vec<Option<Photograph>> = vec![None; views.len()];
    for_each_view(header, mesh, (views, white), wanted, read, budget, |given| {
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

    /// Calls `visit` for each row of the part that holds the mask, with the index of its first pixel in the picture: a component's
    /// radiance with 1 as fourth channel, 0 outside the mask.
    pub fn for_each_row(&self, component: usize, mut visit: impl FnMut(usize, &[[f32; 4]])) {
        let (Some(coding), window) = (self.header.coding.components.get(component), self.view.window) else { return };
        let colours = coding.colour_transform();
        let white = Vec4::new(self.white[0], self.white[1], self.white[2], 0.0);
        let columns = self.mask().width;
        let mut visit = |y: usize, row: &[[f32; 4]]| visit((window.top + y) * columns + window.left, row);
        let mut radiance = vec![[0.0; 4]; window.width];
        let mut line = 0;
        self.view.for_each_run(component, |(run, pixels)| {
            // Rows before the run's are complete.
            while line < run.line as usize {
                visit(line, &radiance);
                radiance.fill([0.0; 4]);
                line += 1;
            }
            for (radiance, pixel) in radiance[run.start as usize..].iter_mut().zip(pixels) {
                let signal = colours.unrotate(Vec4::from_array(*pixel));
                *radiance = (signal::inverse(signal, white, coding.signed) + Vec4::W).to_array();
            }
        });
        while line < window.height {
            visit(line, &radiance);
            radiance.fill([0.0; 4]);
            line += 1;
        }
    }

    /// All components.
    pub fn photograph(&self) -> Photograph {
        let mask = self.mask();
        let image = |component: usize| {
            let mut image = RgbImage::filled(mask.width, mask.height, [0.0; 3]);
            self.for_each_row(component, |first, row| {
                image.data[first..].iter_mut().zip(row).for_each(|(colour, [r, g, b, _])| *colour = [*r, *g, *b]);
            });
            image
        };
        let images = (0..self.header.coding.components.len()).map(image).collect();
        Photograph { mask: mask.clone(), images }
    }
}
