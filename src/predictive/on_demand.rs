//! Views one at a time, in any order: references of others stay decoded, so that a view mostly costs no other.

use super::DecodedView;
use super::decode::{DecodedPhotograph, PlaneDecoder};
use super::header::PlaneHeader;
use super::model::PredictionModel;
use super::order::{self, OrderEntry};
use super::workspace::peak_bytes;
use crate::error::{Error, Result};
use crate::image::Region;
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::views::View;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Decoder of single views that keeps the references of others.
///
/// The caller gets the entries of the coding order that a view still needs ([`ViewDecoder::missing_entries`]), fetches their
/// streams, and has them decoded in that order. Decoded references stay within the budget; the least recently used are
/// evicted first.
#[derive(Debug)]
pub(crate) struct ViewDecoder<'a> {
    planes: PlaneDecoder<'a>,
    order: Vec<OrderEntry>,
    /// Whether a later entry depends on the view, by view.
    is_reference: Vec<bool>,
    decoded: Vec<Option<DecodedView>>,
    /// Value of `clock` when each view was last used.
    used: Vec<u64>,
    clock: u64,
    budget: Arc<Budget>,
}

impl<'a> ViewDecoder<'a> {
    /// Creates a decoder of the views of `header`, none of them decoded. `white` is the white board's radiance.
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
            planes: PlaneDecoder::of(header, mesh, views, white),
            order,
            is_reference,
            decoded: (0..count).map(|_| None).collect(),
            used: vec![0; count],
            clock: 0,
            budget,
        }
    }

    /// Predicts views from a model, too, as the head says.
    pub(crate) fn with_model(self, model: Option<Arc<PredictionModel>>) -> Self {
        ViewDecoder { planes: self.planes.with_model(model), ..self }
    }

    /// Leaves out the first `levels` levels of the photographs.
    pub(crate) fn reduced_by(self, levels: usize) -> Self {
        ViewDecoder { planes: self.planes.reduced_by(levels), ..self }
    }

    /// Decodes only a region of the photographs from now on; those that others are predicted from stay decoded.
    pub(crate) fn set_region(&mut self, region: Option<Region>) {
        self.planes.set_region(region);
    }

    /// Returns the entries that must be decoded for `view`, in coding order, its own last; none if it is kept. Its references
    /// are not evicted before this is called for another view.
    /// # Errors
    /// [`Error::Parameter`] if `view` is out of range.
    pub(crate) fn missing_entries(&mut self, view: usize) -> Result<Vec<usize>> {
        if view >= self.decoded.len() {
            let count = self.decoded.len();
            return Err(Error::parameter(format!("view {view} does not exist: the file has {count} views")));
        }
        self.clock += 1;
        for index in order::closure(&self.order, |v| v == view) {
            self.used[self.order[index].view] = self.clock;
        }
        let kept = |v: usize| self.decoded[v].as_ref().is_some_and(|decoded| v != view || self.is_kept(decoded));
        Ok(order::closure_beyond(&self.order, |v| v == view, kept))
    }

    /// Returns a view that is kept with its signals.
    pub(crate) fn kept(&self, view: usize) -> Option<DecodedPhotograph<'_>> {
        let kept = self.decoded.get(view)?.as_ref().filter(|kept| self.is_kept(kept))?;
        Some(self.planes.radiance(kept))
    }

    fn is_kept(&self, decoded: &DecodedView) -> bool {
        decoded.has_signals() && !self.planes.has_region()
    }

    /// Ranges of the section's streams that [`ViewDecoder::decode`] needs of an entry, with `take` or without.
    pub(crate) fn needed_ranges(&self, index: usize, is_taken: bool) -> Vec<Range<u64>> {
        self.planes.needed_ranges(index, is_taken)
    }

    /// Decodes one of the [`ViewDecoder::missing_entries`], those before it decoded, from its needed streams, one after the other; returns what `take`
    /// makes of the view. Without it only what others are predicted from is decoded.
    /// # Errors
    /// [`Error::Format`] if the streams are damaged; [`Error::Limits`] if the memory for the view and those it is predicted
    /// from is not available; [`Error::Parameter`] if a view it depends on is not decoded.
    pub(crate) fn decode<T>(
        &mut self,
        index: usize,
        streams: &[u8],
        take: Option<impl FnOnce(DecodedPhotograph) -> T>,
    ) -> Result<Option<T>> {
        let Some(entry) = self.order.get(index) else {
            return Err(Error::parameter(format!("entry {index} of the coding order does not exist")));
        };
        let view = entry.view;
        if entry.dependencies().any(|needed| self.decoded[needed].is_none()) {
            return Err(Error::parameter(format!("view {view} is predicted from views that are not decoded")));
        }
        self.planes.check(index, streams, take.is_some())?;
        let peak = peak_bytes(&self.planes.scene.views[view].camera, &self.planes.header.coding);
        self.make_room(peak.saturating_add(self.planes.scene.drawing_bytes()));
        let (is_reference, budget) = (self.is_reference[view] && self.decoded[view].is_none(), self.budget.clone());
        let (taken, decoded) = self.planes.decode(index, streams, &self.decoded, is_reference, take, &budget)?;
        let taken = taken.map(|(taken, _reservation)| taken);
        if is_reference {
            let bytes = decoded.bytes();
            self.make_room(bytes);
            budget.charge("decoded views", bytes)?;
            self.decoded[view] = Some(decoded);
        }
        Ok(taken)
    }

    /// Makes `bytes` of the budget available, evicting the least recently used views if necessary, and then freeing
    /// workspaces.
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
        self.planes.workspaces.free_for(&self.budget, bytes);
    }
}
