//! Profile `tuned`: the photographs' planes, predicted through the mesh from decoded views.
//!
//! Way of a picture: sqrt domain, colours rotated, predicted by warping up to two decoded views, both transformed by the
//! shape-adaptive 9/7, the scaled prediction subtracted, quantised, coded with contexts from the prediction.

#[cfg(feature = "encode")]
pub mod colour;
pub mod decode;
pub mod decoder;
#[cfg(feature = "encode")]
pub mod encode;
pub mod header;
pub mod order;
mod picture;

use crate::asset::{Mesh, View};
use crate::image::Mask;
use crate::parallel;
use crate::residual::coefficients::{Models, Quantiser};
use crate::residual::mask::MaskModels;
use crate::surface::warp::{Geometry, Reference, Source, Surface, find};
use crate::transform::shape_adaptive::{Pixel, Plan};
use order::Step;
use std::borrow::Cow;

/// How one component's pictures are coded.
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
    /// Coded channels of a colour in the sqrt domain.
    #[inline(always)]
    pub fn rotate(&self, colour: [f32; 3]) -> Pixel {
        let row = |r: [i16; 3]| {
            let c = r.map(|v| v as f32 * (1.0 / 16384.0));
            c[0] * colour[0] + c[1] * colour[1] + c[2] * colour[2]
        };
        [row(self.rotation[0]), row(self.rotation[1]), row(self.rotation[2]), 0.0]
    }
    /// Colour in the sqrt domain of coded channels.
    #[inline(always)]
    pub fn unrotate(&self, channels: Pixel) -> [f32; 3] {
        std::array::from_fn(|k| {
            let c = [0, 1, 2].map(|row| self.rotation[row][k] as f32 * (1.0 / 16384.0));
            c[0] * channels[0] + c[1] * channels[1] + c[2] * channels[2]
        })
    }
}

/// How masks are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskCoding {
    /// A view's mask is what the mesh covers in it; no bits.
    Coverage = 0,
    /// Each view's mask is coded, given what the mesh covers.
    Coded = 1,
}

/// How all pictures of a file are coded.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneCoding {
    /// Per component.
    pub components: Vec<ComponentCoding>,
    /// How masks are stored.
    pub masks: MaskCoding,
}

/// The mesh and the views that every picture is predicted with.
#[derive(Debug)]
pub struct Scene<'a> {
    surface: Surface<'a>,
    views: Cow<'a, [View]>,
}

/// A view made ready: where its pixels are and what they see.
#[derive(Debug)]
pub struct Stage {
    geometry: Geometry,
    /// Pixels that show the object.
    pub mask: Mask,
    /// Transform of the mask.
    pub plan: Plan,
    /// Row-major indices of the mask's pixels.
    pub pixels: Vec<u32>,
}

/// Adaptive state that one view hands to those coded after it.
#[derive(Debug, Clone, Default)]
pub struct ViewModels {
    mask: MaskModels,
    /// Per component.
    components: Vec<Models>,
}

/// A view that later ones may be predicted from.
#[derive(Debug)]
pub struct DecodedView {
    stage: Stage,
    /// Per component.
    references: Vec<Reference>,
    models: ViewModels,
}

impl<'a> Scene<'a> {
    /// A mesh seen by views.
    pub fn new(mesh: Cow<'a, Mesh>, views: Cow<'a, [View]>) -> Self {
        Scene { surface: Surface::new(mesh), views }
    }

    /// Draws a view; `mask` gives its mask from what the mesh covers.
    fn stage(&self, view: usize, mask: impl FnOnce(Mask) -> Mask) -> Stage {
        let mut geometry = Geometry::new(&self.surface, &self.views[view]);
        let mask = mask(geometry.raster.coverage());
        geometry.extend(&mask);
        let pixels = (0..mask.data.len() as u32).filter(|&i| mask.data[i as usize]).collect();
        Stage { geometry, plan: Plan::new(&mask), pixels, mask }
    }
}

/// Where the references show a view's pixels.
struct Sources<'d> {
    of: Vec<(&'d DecodedView, Vec<Source>, f32)>,
}

impl<'d> Sources<'d> {
    fn new(stage: &Stage, step: &Step, decoded: &'d [Option<DecodedView>]) -> Self {
        let of = step
            .references
            .iter()
            .filter_map(|&(view, share)| {
                let reference = decoded.get(view)?.as_ref()?;
                let sources = find(&stage.geometry, &reference.stage.geometry, &stage.pixels);
                Some((reference, sources, share as f32))
            })
            .collect();
        Sources { of }
    }
}

/// Most views that are worked on side by side, so that memory does not grow with the threads.
const SIDE_BY_SIDE: usize = 8;

/// Runs `work` for the given steps of the order, wave by wave, and puts what later ones need into place; views that no
/// later step needs are dropped at once.
fn run_waves<T: Send>(
    order: &[Step],
    steps: &[usize],
    views: usize,
    work: impl Fn(usize, &[Option<DecodedView>]) -> crate::Result<(T, DecodedView)> + Sync + Send,
) -> crate::Result<Vec<(usize, T)>> {
    let mut needs = Needs::new(order, steps, views);
    let mut decoded: Vec<Option<DecodedView>> = (0..views).map(|_| None).collect();
    let mut results = Vec::with_capacity(steps.len());
    for wave in order::waves(order, steps) {
        for group in wave.chunks(SIDE_BY_SIDE) {
            let done = parallel::map(group.len(), |k| work(group[k], &decoded));
            for (&index, done) in group.iter().zip(done) {
                let (result, view) = done?;
                results.push((index, result));
                let step = &order[index];
                if needs.is_needed(step.view) {
                    decoded[step.view] = Some(view);
                }
                needs.is_done(step, |view| decoded[view] = None);
            }
        }
    }
    results.sort_by_key(|r| r.0);
    Ok(results)
}

/// How many later steps need each view.
struct Needs(Vec<usize>);

impl Needs {
    fn new(order: &[Step], steps: &[usize], views: usize) -> Self {
        let mut needs = Needs(vec![0; views]);
        for &index in steps {
            order[index].needs().for_each(|view| needs.0[view] += 1);
        }
        needs
    }
    fn is_needed(&self, view: usize) -> bool {
        self.0[view] > 0
    }
    /// Counts a step as done and calls `drop` for each view that nothing needs any more.
    fn is_done(&mut self, step: &Step, mut drop: impl FnMut(usize)) {
        for view in step.needs() {
            self.0[view] -= 1;
            if self.0[view] == 0 {
                drop(view);
            }
        }
    }
}

/// Most memory that [`run_waves`] takes at a time, from what a view takes while it is worked on and while it is kept.
fn most_memory(
    order: &[Step],
    steps: &[usize],
    views: usize,
    working: impl Fn(usize) -> u64,
    kept: impl Fn(usize) -> u64,
) -> u64 {
    let mut needs = Needs::new(order, steps, views);
    let mut held = vec![0u64; views];
    let mut most = 0;
    for wave in order::waves(order, steps) {
        for group in wave.chunks(SIDE_BY_SIDE) {
            let active: u64 = group.iter().map(|&index| working(order[index].view)).sum();
            most = most.max(active.saturating_add(held.iter().sum()));
            for &index in group {
                let step = &order[index];
                if needs.is_needed(step.view) {
                    held[step.view] = kept(step.view);
                }
                needs.is_done(step, |view| held[view] = 0);
            }
        }
    }
    most
}

#[cfg(all(test, feature = "encode", feature = "parallel"))]
mod tests;
