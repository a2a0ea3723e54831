//! Profile `tuned`: the photographs' planes, predicted through the mesh from decoded views.
//!
//! Way of a picture: sqrt domain, colours rotated, predicted by warping up to two decoded views, both transformed by the
//! shape-adaptive 9/7, the scaled prediction subtracted, quantised, coded with contexts from the prediction.

#[cfg(feature = "encode")]
pub mod colour;
pub mod order;
pub mod picture;

use crate::asset::{Mesh, View};
use crate::image::Mask;
use crate::residual::coefficients::{Models, Quantiser};
use crate::surface::warp::{Geometry, Reference, Source, Surface, find};
use crate::transform::shape_adaptive::{Pixel, Plan};
use order::Step;

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

/// What every picture of a file is coded with.
#[derive(Debug)]
pub struct Scene<'a> {
    surface: Surface<'a>,
    views: &'a [View],
    masks: &'a [Mask],
}

/// A view made ready: where its pixels are and what they see.
#[derive(Debug)]
pub struct Stage {
    geometry: Geometry,
    /// Transform of its mask.
    pub plan: Plan,
    /// Row-major indices of its mask's pixels.
    pub pixels: Vec<u32>,
}

/// A view that later ones may be predicted from.
#[derive(Debug)]
pub struct DecodedView {
    stage: Stage,
    /// Per component.
    references: Vec<Reference>,
    models: Vec<Models>,
}

impl<'a> Scene<'a> {
    /// `views` and `masks` are parallel; a mask has its view's size.
    pub fn new(mesh: &'a Mesh, views: &'a [View], masks: &'a [Mask]) -> Self {
        Scene { surface: Surface::new(mesh), views, masks }
    }

    fn stage(&self, view: usize) -> Stage {
        let mask = &self.masks[view];
        let mut geometry = Geometry::new(&self.surface, &self.views[view]);
        geometry.extend(mask);
        let pixels = (0..mask.data.len() as u32).filter(|&i| mask.data[i as usize]).collect();
        Stage { geometry, plan: Plan::new(mask), pixels }
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
