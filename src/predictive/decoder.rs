//! Views one at a time, in any order: what others are predicted from is kept, so that a view mostly costs no other.

use super::decode::{DecodedPhotograph, PlaneDecoder};
use super::header::{CodedEntry, PlaneHeader};
use super::order;
use super::order::OrderEntry;
use super::workspace::{PlaneWorkspaces, peak_bytes, photograph_bytes};
use super::{DecodedView, PredictionScene};
use crate::error::{Error, Result};
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::surface::raster;
use crate::views::View;
use std::borrow::Cow;
use std::sync::Arc;

/// Decodes the views of a file one at a time.
///
/// Whoever calls asks for the steps that a view still takes ([`ViewDecoder::missing_entries`]), gets their streams, and has them
/// decoded in that order. Decoded views that others need stay, within the budget; those used longest ago go first.
#[derive(Debug)]
pub(crate) struct ViewDecoder<'a> {
    pictures: PlaneDecoder<'a>,
    order: Vec<OrderEntry>,
    /// Whether a later step needs the view.
    is_reference: Vec<bool>,
    decoded: Vec<Option<DecodedView>>,
    /// When each view was last asked for.
    used: Vec<u64>,
    clock: u64,
    budget: Arc<Budget>,
}

impl<'a> ViewDecoder<'a> {
    /// A decoder of the views of `header`, none of them decoded. `white` is the white board's radiance.
    pub(crate) fn new(
        header: Cow<'a, PlaneHeader>,
        mesh: Cow<'a, Mesh>,
        views: Cow<'a, [View]>,
        white: [f64; 3],
        budget: Arc<Budget>,
    ) -> Self {
        let order = header.order();
        let count = views.len();
        let mut is_reference = vec![false; count];
        order.iter().flat_map(OrderEntry::dependencies).for_each(|view| is_reference[view] = true);
        ViewDecoder {
            pictures: PlaneDecoder {
                scene: PredictionScene::new(mesh, views),
                header,
                white,
                workspaces: PlaneWorkspaces::default(),
            },
            order,
            is_reference,
            decoded: (0..count).map(|_| None).collect(),
            used: vec![0; count],
            clock: 0,
            budget,
        }
    }

    /// The steps that `view` still takes, in coding order, its own last; none where it is kept. What it is predicted from
    /// is not given up before another view is asked for.
    /// # Errors
    /// [`Error::Parameter`] for a view that there is not.
    pub(crate) fn missing_entries(&mut self, view: usize) -> Result<Vec<usize>> {
        if view >= self.decoded.len() {
            let count = self.decoded.len();
            return Err(Error::parameter(format!("view {view} does not exist: the file has {count} views")));
        }
        self.clock += 1;
        for index in order::closure(&self.order, |v| v == view) {
            self.used[self.order[index].view] = self.clock;
        }
        let kept = |v: usize| self.decoded[v].as_ref().is_some_and(|decoded| v != view || decoded.has_signals());
        Ok(order::closure_beyond(&self.order, |v| v == view, kept))
    }

    /// Where a step's streams lie.
    pub(crate) fn entry(&self, step: usize) -> Option<&CodedEntry> {
        self.pictures.header.entries.get(step)
    }

    /// A view that is kept with its pictures.
    pub(crate) fn kept(&self, view: usize) -> Option<DecodedPhotograph<'_>> {
        let kept = self.decoded.get(view)?.as_ref().filter(|kept| kept.has_signals())?;
        Some(DecodedPhotograph::new(&self.pictures.header, self.pictures.white, kept))
    }

    /// Decodes one of the [`ViewDecoder::missing_entries`] steps, all before it decoded, from its streams; what `take` makes of the
    /// view is returned.
    /// # Errors
    /// [`Error::Format`] where the streams are damaged; [`Error::Limits`] where the memory for the view and those it is predicted
    /// from is not there; [`Error::Parameter`] where a view it needs is not decoded.
    pub(crate) fn decode<T>(
        &mut self,
        step: usize,
        streams: &[u8],
        take: impl FnOnce(DecodedPhotograph) -> T,
    ) -> Result<T> {
        let Some(OrderEntry { view, .. }) = self.order.get(step) else {
            return Err(Error::parameter(format!("step {step} does not exist")));
        };
        let view = *view;
        if self.order[step].dependencies().any(|needed| self.decoded[needed].is_none()) {
            return Err(Error::parameter(format!("view {view} is predicted from views that are not decoded")));
        }
        self.pictures.check(step, streams)?;
        raster::check_work(self.pictures.scene.surface.mesh(), &self.pictures.scene.views[view].camera)?;
        let camera = &self.pictures.scene.views[view].camera;
        let coding = &self.pictures.header.coding;
        let (most, photograph) = (peak_bytes(camera, coding), photograph_bytes(camera, coding.components.len()));
        self.make_room(most);
        let mut decoded = self.pictures.decode(step, streams, &self.decoded, self.is_reference[view], &self.budget)?;
        let held = self.budget.reserve("a decoded photograph", photograph)?;
        let taken = take(DecodedPhotograph::new(&self.pictures.header, self.pictures.white, &decoded));
        drop(held);
        self.pictures.workspaces.recycle(&mut decoded);
        if self.is_reference[view] && self.decoded[view].is_none() {
            let bytes = decoded.bytes();
            self.make_room(bytes);
            self.budget.charge("decoded views", bytes)?;
            self.decoded[view] = Some(decoded);
        }
        Ok(taken)
    }

    /// Gives up views that were not asked for of late until `bytes` are left or none of them is kept any more, and what is kept to be
    /// worked in where that takes the rest.
    fn make_room(&mut self, bytes: u64) {
        while self.budget.left() < bytes {
            let oldest = (0..self.decoded.len())
                .filter(|&view| self.used[view] < self.clock)
                .filter_map(|view| Some((self.used[view], view, self.decoded[view].as_ref()?.bytes())))
                .min();
            let Some((_, view, kept)) = oldest else { break };
            self.decoded[view] = None;
            self.budget.release(kept);
        }
        self.pictures.workspaces.free_for(&self.budget, bytes);
    }
}
