//! Streams to photographs: all views, or some with what they are predicted from.

use super::header::{CodedStep, Header};
use super::picture::{self, Signal};
use super::{Scene, order, run_waves};
use crate::asset::{Mesh, Photograph, View};
use crate::error::{Error, Result};
use crate::image::{Mask, RgbImage};
use crate::limits::Budget;
use crate::surface::raster;

/// Memory that decoding one view takes for each pixel, beside 64 bytes for each component. An upper bound.
const BYTES_A_PIXEL: u64 = 96;
const BYTES_A_COMPONENT: u64 = 160;

/// Charges what decoding a view takes and checks that drawing it is bounded work.
fn charge(mesh: &Mesh, view: &View, components: usize, budget: &Budget) -> Result<()> {
    let pixels = view.camera.width as u64 * view.camera.height as u64;
    budget.charge_items("decoded views", pixels, (BYTES_A_PIXEL + BYTES_A_COMPONENT * components as u64) as usize)?;
    raster::check_work(mesh, &view.camera)
}

/// Decodes the views that `wanted` names, and those they depend on. `read` gives a step's streams, one after the other;
/// steps for which it gives `None` (a file cut short) are left out with all that depend on them.
///
/// Returns linear photographs by view; `None` for views not wanted.
pub fn decode(
    header: &Header,
    mesh: &Mesh,
    views: &[View],
    white: [f64; 3],
    wanted: impl Fn(usize) -> bool + Sync + Send,
    mut read: impl FnMut(&CodedStep) -> Result<Option<Vec<u8>>>,
    budget: &Budget,
) -> Result<Vec<Option<Photograph>>> {
    let order = header.order();
    let mut streams: Vec<Option<Vec<u8>>> = vec![None; order.len()];
    let mut present = vec![false; views.len()];
    let mut steps = Vec::new();
    for index in order::closure(&order, &wanted) {
        let coded = &header.steps[index];
        let step = &coded.step;
        if step.references.iter().map(|r| r.0).chain(step.parent).any(|view| !present[view]) {
            continue;
        }
        let Some(bytes) = read(coded)? else { continue };
        if crc32fast::hash(&bytes) != coded.checksum {
            let name = &views[step.view].name;
            return Err(Error::format(
                "PLAN",
                coded.offset,
                format!("checksum of view {name} does not match: the file is damaged"),
            ));
        }
        charge(mesh, &views[step.view], header.coding.components.len(), budget)?;
        streams[index] = Some(bytes);
        present[step.view] = true;
        steps.push(index);
    }
    let scene = Scene::new(mesh, views);
    let results = run_waves(&order, &steps, views.len(), |index, decoded| {
        let coded = &header.steps[index];
        let mut rest = streams[index].as_deref().unwrap_or_default();
        let mut parts = Vec::with_capacity(coded.lengths.len());
        for &length in &coded.lengths {
            let (part, after) = rest.split_at_checked(length as usize).ok_or_else(|| {
                Error::format("PLAN", coded.offset, "a view's streams are shorter than the head says")
            })?;
            parts.push(part);
            rest = after;
        }
        let step = (&coded.step, coded.scale);
        let (signals, mask, view) = picture::decode(&scene, step, &header.coding, parts[0], &parts[1..], decoded);
        let photograph = wanted(coded.step.view).then(|| to_photograph(header, white, &signals, mask));
        Ok((photograph, view))
    })?;
    let mut photographs: Vec<Option<Photograph>> = vec![None; views.len()];
    for (index, photograph) in results {
        photographs[order[index].view] = photograph;
    }
    Ok(photographs)
}

/// Linear radiance of decoded signals.
pub(super) fn to_photograph(header: &Header, white: [f64; 3], signals: &[Signal], mask: Mask) -> Photograph {
    let white = white.map(|w| w as f32);
    let images = (header.coding.components.iter().zip(signals))
        .map(|(coding, signal)| {
            let data = (signal.iter().zip(&mask.data))
                .map(|(&pixel, &inside)| {
                    if !inside {
                        return [0.0; 3];
                    }
                    let s = coding.unrotate(pixel);
                    std::array::from_fn(|k| {
                        // Rounding may leave a trace below zero where there is none.
                        let s = if coding.signed || s[k] > 0.0 { s[k] } else { 0.0 };
                        s * s.abs() * white[k]
                    })
                })
                .collect();
            RgbImage { width: mask.width, height: mask.height, data }
        })
        .collect();
    Photograph { mask, images }
}
