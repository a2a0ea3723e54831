//! Repair of section PLAN: keeps the views whose streams, and those of all that they are predicted from, are whole.
//!
//! Section VIEW stays as it is, since its cameras are coded one by another and would not come out the same in another order, and so
//! every view keeps its entry. Entries that are lost are coded anew with a mask that shows nothing, predicted from nothing; the others keep
//! their streams, and decode to the same bits as before.

use super::header::{CodedEntry, MAX_CODING, PREFIX_BYTES, PlaneHeader};
use super::order::OrderEntry;
use super::picture::{self, ViewPart, ViewTask};
use super::{MaskCoding, PlaneCoding, PredictionScene};
use crate::entropy::RangeEncoder;
use crate::error::{Error, Result};
use crate::image::Mask;
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::residual::mask::{self, MaskModels};
use crate::surface::raster::{check_work, rasterise};
use crate::views::View;
use std::borrow::Cow;
use std::collections::HashMap;
use std::ops::Range;

/// Bytes by which streams may have moved against those before them, where bytes were lost or added between.
const MAX_SHIFT: usize = 64;
/// Most bytes that are read for checksums, as a multiple of the section's.
const MAX_WORK: usize = 32;
/// Scale of entries that hold nothing.
const PLAIN_SCALE: u8 = 64;

/// Why a view is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ViewLoss {
    /// Its own streams are damaged or missing.
    Streams,
    /// It is predicted from this view, which is lost.
    Predicted(usize),
}

/// Repaired section.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RepairedPlanes {
    /// The new section.
    pub bytes: Vec<u8>,
    /// Views whose photographs are lost, in coding order.
    pub lost: Vec<(usize, ViewLoss)>,
}

/// Finds the offset of a whole head of the section in one of `ranges` of a file: at their starts, or anywhere in them.
pub(crate) fn find_head(
    file: &[u8],
    ranges: &[Range<usize>],
    views: &[View],
    components: usize,
    budget: &Budget,
) -> Option<usize> {
    let mut work = 0usize;
    let starts = ranges.iter().map(|range| range.start).chain(ranges.iter().flat_map(|range| range.clone()));
    let looks_right = |at: usize| {
        let length = file.get(at..).and_then(|bytes| PlaneHeader::head_bytes(bytes).ok()).unwrap_or(u64::MAX);
        // The first bytes of the head, before its checksum is worth the work: behind the coding is the side of tiles, if there are any.
        let plausible = file.get(at + PREFIX_BYTES..).and_then(|head| head.first_chunk::<3>());
        plausible.is_some_and(|[flags, first, second]| {
            let count = if flags & 6 == 0 { first } else { second };
            *flags <= MAX_CODING && *count as usize == components
        }) && length <= (file.len() - at) as u64
    };
    for at in starts.filter(|&at| looks_right(at)) {
        work += PlaneHeader::head_bytes(&file[at..]).map_or(0, |length| length as usize);
        if work > MAX_WORK * file.len() {
            return None;
        }
        if PlaneHeader::parse(&file[at..], views, components, budget).is_ok() {
            return Some(at);
        }
    }
    None
}

/// Repairs the section whose head begins at `start` and whose streams end before `end`.
/// # Errors
/// [`Error::Format`] if not even the head is whole, [`Error::Limits`] if drawing the lost views takes too much.
pub(crate) fn repair(
    file: &[u8],
    (start, end): (usize, usize),
    mesh: &Mesh,
    views: &[View],
    components: usize,
    budget: &Budget,
) -> Result<RepairedPlanes> {
    let bytes = file.get(start..end).ok_or_else(|| Error::parameter("range beyond the file"))?;
    let header = PlaneHeader::parse(bytes, views, components, budget)?;
    let streams = &bytes[PREFIX_BYTES + PlaneHeader::head_bytes(bytes)? as usize..];
    let found = find_streams(&header, streams);
    let mut lost: Vec<(usize, ViewLoss)> = Vec::new();
    for (coded, found) in header.entries.iter().zip(&found) {
        let needed = coded.entry.dependencies().find(|view| lost.iter().any(|(other, _)| other == view));
        match (found, needed) {
            (None, _) => lost.push((coded.entry.view, ViewLoss::Streams)),
            (_, Some(view)) => lost.push((coded.entry.view, ViewLoss::Predicted(view))),
            _ => {}
        }
    }
    let mut writer = PlaneRepairer {
        scene: PredictionScene::new(Cow::Borrowed(mesh), Cow::Borrowed(views)),
        // A mask that shows nothing can't be said where masks are what the mesh covers.
        coding: PlaneCoding {
            masks: if lost.is_empty() { header.coding.masks } else { MaskCoding::Coded },
            ..header.coding.clone()
        },
        codes_masks: header.coding.masks == MaskCoding::Coverage && !lost.is_empty(),
        models: HashMap::new(),
    };
    let (mut steps, mut body) = (Vec::with_capacity(header.entries.len()), Vec::new());
    for (coded, found) in header.entries.iter().zip(found) {
        let found = found.filter(|_| lost.iter().all(|(view, _)| *view != coded.entry.view));
        let (coded, bytes) = match found {
            Some(found) => writer.kept(mesh, coded, &streams[found])?,
            None => writer.lost(mesh, coded.entry.view)?,
        };
        steps.push(CodedEntry { offset: body.len() as u64, ..coded });
        body.extend(bytes);
    }
    let mut bytes = PlaneHeader { coding: writer.coding, entries: steps }.to_bytes();
    bytes.extend(body);
    Ok(RepairedPlanes { bytes, lost })
}

/// Finds each entry's streams: after those before, after what was found last, or a little off if bytes were lost or added.
fn find_streams(header: &PlaneHeader, streams: &[u8]) -> Vec<Option<Range<usize>>> {
    let mut work = MAX_WORK * streams.len();
    let mut is_there = |coded: &CodedEntry, start: Option<usize>| {
        let length = usize::try_from(coded.stream_bytes()).ok()?;
        let range = start.and_then(|start| Some(start..start.checked_add(length)?))?;
        let bytes = streams.get(range.clone())?;
        work = work.checked_sub(length)?;
        coded.is_intact(std::iter::repeat(true), bytes).then_some(range)
    };
    // All after a gap have moved by what the whole section is longer or shorter.
    let tail = streams.len() as i64 - header.stream_bytes() as i64;
    let mut shift = 0i64;
    let mut found: Vec<Option<Range<usize>>> = Vec::with_capacity(header.entries.len());
    for coded in &header.entries {
        let at = |shift: i64| usize::try_from(coded.offset as i64 + shift).ok();
        let place = [shift, 0, tail].into_iter().find_map(|shift| is_there(coded, at(shift)));
        shift = place.as_ref().map_or(shift, |place| place.start as i64 - coded.offset as i64);
        found.push(place);
    }
    // Bytes lost or added in two places: what is between them has moved by neither's share alone.
    for (index, coded) in header.entries.iter().enumerate().filter(|_| tail != 0) {
        if found[index].is_none() {
            let near = (1..=MAX_SHIFT as i64).flat_map(|shift| [shift, -shift]);
            let at = |shift: i64| usize::try_from(coded.offset as i64 + shift).ok();
            found[index] = near.into_iter().find_map(|shift| is_there(coded, at(shift)));
        }
    }
    found
}

/// Coder of the entries of the new section.
struct PlaneRepairer<'a> {
    scene: PredictionScene<'a>,
    coding: PlaneCoding,
    /// Whether masks that were what the mesh covers are coded now.
    codes_masks: bool,
    /// State of the masks of kept views.
    models: HashMap<usize, MaskModels>,
}

impl PlaneRepairer<'_> {
    fn kept(&mut self, mesh: &Mesh, coded: &CodedEntry, streams: &[u8]) -> Result<(CodedEntry, Vec<u8>)> {
        if !self.codes_masks {
            return Ok((coded.clone(), streams.to_vec()));
        }
        let camera = &self.scene.views[coded.entry.view].camera;
        check_work(mesh, camera)?;
        let coverage = rasterise(mesh, camera).coverage();
        let mut models = coded.entry.parent.and_then(|parent| self.models.get(&parent).cloned()).unwrap_or_default();
        let mut coder = RangeEncoder::new();
        mask::code_mask(&mut coder, &mut models, &coverage, Some(&coverage));
        self.models.insert(coded.entry.view, models);
        let mut bytes = coder.finish();
        let mut coded = coded.clone();
        let old = coded.lengths[0] as usize;
        coded.lengths[0] = bytes.len() as u32;
        bytes.extend_from_slice(&streams[old..]);
        let base: u64 = coded.lengths.iter().map(|&length| length as u64).sum();
        coded.checksum = crc32fast::hash(&bytes[..base as usize]);
        Ok((coded, bytes))
    }

    /// Codes a view that shows nothing.
    fn lost(&self, mesh: &Mesh, view: usize) -> Result<(CodedEntry, Vec<u8>)> {
        let camera = &self.scene.views[view].camera;
        check_work(mesh, camera)?;
        let step = OrderEntry { view, references: Vec::new(), parent: None };
        let nothing = Mask::filled(camera.width as usize, camera.height as usize, false);
        let black = |window: &crate::transform::window::Window, _| vec![[0.0; 4]; window.width * window.height];
        let (scene, coding) = (&self.scene, &self.coding);
        let part = ViewPart { is_reference: false, is_photograph: true, reduction: 0, region: None };
        let task = ViewTask { scene, entry: &step, scale: PLAIN_SCALE, coding, decoded: &[], part };
        let (streams, _) = picture::encode(&task, &nothing, 1.0, black, &Default::default())?;
        Ok(streams.into_entry(step, PLAIN_SCALE, &coding.tile_grid(camera)))
    }
}
