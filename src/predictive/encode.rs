//! Encoder of section `PLAN`: photographs to streams.

use super::colour::ColourSums;
use super::decode::DecodedPhotograph;
use super::header::{CodedEntry, PlaneHeader};
use super::model::PredictionModel;
use super::picture::{self, ViewPart, ViewTask};
use super::workspace::PlaneSignal;
use super::workspace::{ParallelBudget, PlaneWorkspaces};
use super::{
    ComponentCoding, DEFAULT_TILE_SIDE_LOG2, DecodedView, MaskCoding, PlaneCoding, PredictionScene, order, run_entries,
};
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::image::MaskRuns;
use crate::limits::{Budget, Limits};
use crate::mesh::Mesh;
use crate::options::{DecodeSpeed, EncodeOptions, EncodeTarget};
use crate::parallel;
use crate::rate::{self, Candidate, CodedPhotographs};
use crate::reflectance::maps::ReflectanceMaps;
use crate::reflectance::stage::{ReflectanceEncoder, ReflectanceSurface};
use crate::residual::coefficients::Modelling;
use crate::residual::tiles::TILE_SIDES_LOG2;
use crate::separate::{MaskedPhotographs, check_shown};
use crate::transform::signal;
use crate::transform::window::Window;
use crate::views::source::PhotographSource;
use crate::views::{Component, Photograph, View};
use glam::Vec4;
use std::borrow::Cow;
use std::sync::Arc;

/// Encoder of all photographs: the parts that do not depend on the quality, made once for all trials of the rate control.
#[derive(Debug)]
pub struct PlaneEncoder<'a> {
    mesh: &'a Mesh,
    views: &'a [View],
    white: [f64; 3],
    components: &'a [Component],
    photographs: &'a dyn PhotographSource,
    /// Whether a pixel of each view is coded.
    shown: Vec<bool>,
    order: Vec<order::OrderEntry>,
    masks: MaskCoding,
    rotations: Vec<[[i16; 3]; 3]>,
    signed: bool,
    /// Memory that the trials share.
    workspaces: PlaneWorkspaces,
}

/// Encodes photographs at the coarsest quality that reaches the target of `options`, by default quality 75. `other_bytes` are
/// the bytes of the file beside the returned sections, `surface` what is known of it beside the mesh.
/// # Errors
/// [`crate::Error::Parameter`] if the target is out of its range, is for another profile or can't be reached.
pub(crate) fn encode_to_target(
    source: &MaskedPhotographs,
    other_bytes: u64,
    surface: &ReflectanceSurface,
    options: &EncodeOptions,
    warnings: &mut Vec<String>,
) -> Result<CodedPhotographs> {
    let &MaskedPhotographs { mesh, views, components, photographs, .. } = source;
    let encoder = PlaneEncoder::new(source, options.signed_specular)?;
    check_shown(&encoder.shown, warnings)?;
    let first_shown = encoder.shown.iter().position(|&shown| shown);
    let reflectance = ReflectanceEncoder::new(mesh, views, components, photographs, surface, options)?;
    let other_bytes = other_bytes + reflectance.displacement_bytes().map_or(0, |bytes| bytes.len() as u64 + 48);
    let (decode_speed, tile_side_log2) = (options.decode_speed, tile_side_log2(options.tile_side)?);
    let best = rate::search_step(options.target.unwrap_or(EncodeTarget::Quality(75.0)), |step| {
        let quality = PlaneQuality { step, decode_speed, tile_side_log2, ..Default::default() };
        let (map_bytes, maps) = reflectance.encode(step)?;
        let model = encoder.model(&reflectance, &maps, decode_speed)?;
        let planes = encoder.encode_each(&quality, model, |view, original, decoded| {
            source.coded_view(view, original, &decoded, first_shown == Some(view))
        })?;
        let bytes = other_bytes + (reflectance.chart_bytes().len() + map_bytes.len() + planes.bytes.len()) as u64;
        Ok(Candidate { distortion: rate::total(&planes.photographs), bytes, content: (planes, map_bytes) })
    })?;
    let (planes, maps) = best.content;
    let charts = reflectance.chart_bytes().to_vec();
    let mut sections = vec![(Tag::CHARTS, charts)];
    sections.extend(reflectance.displacement_bytes().map(|bytes| (Tag::DISPLACEMENT, bytes.to_vec())));
    sections.extend([(Tag::REFLECTANCE, maps), (Tag::PLANES, planes.bytes)]);
    Ok(CodedPhotographs { sections, views: planes.photographs, distortion: best.distortion })
}

fn tile_side_log2(side: u32) -> Result<u8> {
    let log2 = side.trailing_zeros() as u8;
    if !side.is_power_of_two() || !TILE_SIDES_LOG2.contains(&log2) {
        return Err(Error::parameter(format!("option `tile_side` is {side}: a power of two from 16 to 4096 expected")));
    }
    Ok(log2)
}

/// A finished encoding.
#[derive(Debug)]
pub struct EncodedPlanes<T = Photograph> {
    /// Content of section `PLAN`.
    pub bytes: Vec<u8>,
    /// The photographs that a decoder returns, by view, or what was made of each.
    pub photographs: Vec<T>,
}

/// Quality of an encoding and its trade-offs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneQuality {
    /// Quantiser step of the diffuse (or only) component, in the sqrt domain.
    pub step: f32,
    /// Step of the specular component relative to it. In the sum of both an error in the darker one weighs less
    /// (`d sqrt(D + S) = (sqrt D e_D + sqrt S e_S) / sqrt(D + S)` for errors of the sqrt signals).
    pub specular_ratio: f32,
    /// Value of a bit in squared steps, for the rate-distortion choice of each coefficient.
    pub lambda: f32,
    /// Trade of file size for decoding speed.
    pub decode_speed: DecodeSpeed,
    /// See [`PlaneCoding::tile_side_log2`].
    pub tile_side_log2: u8,
}

impl Default for PlaneQuality {
    fn default() -> Self {
        PlaneQuality {
            step: 0.05,
            specular_ratio: 1.5,
            lambda: 0.1,
            decode_speed: DecodeSpeed::default(),
            tile_side_log2: DEFAULT_TILE_SIDE_LOG2,
        }
    }
}

/// Largest view that is coded by mixed modelling, and largest picture that is predicted of larger ones, where the encoder is free to choose.
const MAX_MIXED_PIXELS: u64 = 1_500_000;
const MAX_PREDICTED_PIXELS: u64 = 400_000;

/// Prediction level and modelling; `pixels` are those of the largest view.
fn mode(decode_speed: DecodeSpeed, pixels: u64) -> (u8, Modelling) {
    match decode_speed {
        DecodeSpeed::Automatic if pixels <= MAX_MIXED_PIXELS => (0, Modelling::Mixed),
        DecodeSpeed::Automatic => {
            let level = (1..3).find(|level| pixels >> (2 * level) <= MAX_PREDICTED_PIXELS);
            (level.unwrap_or(3), Modelling::Direct)
        }
        DecodeSpeed::Normal => (0, Modelling::Mixed),
        DecodeSpeed::Fast => (1, Modelling::Direct),
        DecodeSpeed::Fastest => (2, Modelling::Direct),
    }
}

/// Memory of views that are coded side by side, beside that of one.
const SIDE_BY_SIDE_BYTES: u64 = 512 << 20;
/// Reconstruction offsets, see [`ComponentCoding::shrink`].
const SHRINK: [u8; 2] = [20, 6];

impl<'a> PlaneEncoder<'a> {
    /// Chooses order, colour rotations and mask coding. `signed` also keeps the sign of specular radiance below zero.
    pub fn new(source: &MaskedPhotographs<'a>, signed: bool) -> Result<Self> {
        let &MaskedPhotographs { mesh, views, components, white, covered, photographs } = source;
        let order = order::coarse_to_fine(views, mesh.bounding_sphere().0);
        let white32 = white.map(|w| w as f32);
        let mut sums = vec![ColourSums::default(); components.len()];
        let mut shown = Vec::with_capacity(views.len());
        let mut same = true;
        source.for_each(|view, Photograph { mask, images }| {
            same = same && MaskRuns::new(mask) == covered[view];
            shown.push(mask.data.contains(&true));
            parallel::for_each_chunk(&mut sums, 1, |component, sums| {
                let pixels = images[component].data.iter().zip(&mask.data).filter(|(_, inside)| **inside);
                pixels.for_each(|(colour, _)| sums[0].add(signal::forward(*colour, white32, signed)));
            });
            Ok(())
        })?;
        let masks = if same { MaskCoding::Coverage } else { MaskCoding::Coded };
        let rotations = sums.iter().map(ColourSums::rotation).collect();
        let workspaces = PlaneWorkspaces::default();
        Ok(PlaneEncoder {
            mesh,
            views,
            white,
            components,
            photographs,
            shown,
            order,
            masks,
            rotations,
            signed,
            workspaces,
        })
    }

    /// Codes all views.
    pub fn encode(&self, quality: &PlaneQuality) -> Result<EncodedPlanes> {
        self.encode_each(quality, None, |_, _, decoded| decoded)
    }

    /// The model that views are predicted from besides: of a finer surface and its lobes, unless decoding is to be fast.
    fn model<'m>(
        &self,
        reflectance: &'m ReflectanceEncoder,
        maps: &'m ReflectanceMaps,
        decode_speed: DecodeSpeed,
    ) -> Result<Option<PredictionModel>> {
        let is_fast = matches!(decode_speed, DecodeSpeed::Fast | DecodeSpeed::Fastest);
        let surface = reflectance.surface().filter(|_| !is_fast && maps.relightable && !maps.lobes.is_empty());
        if surface.is_none() {
            return Ok(None);
        }
        let parts = (surface, Some(reflectance.charts()), Some(maps));
        PredictionModel::new(self.mesh, parts, self.components, self.white, &Budget::new(Limits::UNLIMITED)).map(Some)
    }

    /// Codes all views, predicted from a model, too, and keeps of each what `take` makes of its index, its photograph and what is decoded of that.
    pub(super) fn encode_each<T: Send>(
        &self,
        quality: &PlaneQuality,
        model: Option<PredictionModel>,
        take: impl Fn(usize, &Photograph, Photograph) -> T + Sync + Send,
    ) -> Result<EncodedPlanes<T>> {
        let largest = self.views.iter().map(|view| view.camera.width as u64 * view.camera.height as u64).max();
        let (prediction_level, modelling) = mode(quality.decode_speed, largest.unwrap_or(0));
        // What the mesh covers is drawn at the size of the prediction.
        let masks = if prediction_level == 0 { self.masks } else { MaskCoding::Coded };
        let (is_modelled, tile_side_log2) = (model.is_some(), quality.tile_side_log2);
        let components = self.component_codings(quality);
        let coding = PlaneCoding { components, masks, prediction_level, modelling, is_modelled, tile_side_log2 };
        let scene = PredictionScene::new(Cow::Borrowed(self.mesh), Cow::Borrowed(self.views));
        let scene = scene.with_model(model.map(Arc::new));
        let white = self.white.map(|w| w as f32);
        let all: Vec<usize> = (0..self.order.len()).collect();
        let mut header = PlaneHeader { coding, entries: Vec::new() };
        let scale = 64;
        let budget = Budget::new(Limits::UNLIMITED);
        let room = ParallelBudget {
            views: self.views,
            coding: &header.coding,
            budget: &budget,
            drawing_bytes: scene.drawing_bytes(),
            most: SIDE_BY_SIDE_BYTES,
            workspaces: &self.workspaces,
        };
        let mut results = Vec::with_capacity(all.len());
        let encode = |index: usize, decoded: &[Option<DecodedView>], is_reference: bool| {
            let entry = &self.order[index];
            let target = &*self.photographs.photograph(entry.view)?;
            let plane = |window: &Window, component: usize| -> PlaneSignal {
                let coding = &header.coding.components[component];
                let rotation = coding.colour_transform();
                let Photograph { mask, images } = target;
                let colours = window.crop(&images[component].data, mask.width);
                (colours.into_iter().zip(window.crop(&mask.data, mask.width)))
                    .map(|(c, m)| match m {
                        true => {
                            let [r, g, b] = signal::forward(c, white, coding.signed);
                            rotation.rotate(Vec4::new(r, g, b, 0.0)).to_array()
                        }
                        false => [0.0; 4],
                    })
                    .collect()
            };
            let part = ViewPart { is_reference, is_photograph: true, reduction: 0, region: None };
            let task = ViewTask { scene: &scene, entry, scale, coding: &header.coding, decoded, part };
            let (streams, mut view) = picture::encode(&task, &target.mask, quality.lambda, plane, &self.workspaces)?;
            let photograph = DecodedPhotograph::new(&header, self.white, &view).photograph();
            self.workspaces.recycle(&mut view);
            Ok(((streams, take(entry.view, target, photograph)), view))
        };
        run_entries(&self.order, &all, &room, encode, |given| {
            results.extend(given);
            Ok(())
        })?;
        results.sort_by_key(|(index, _)| *index);
        let mut photographs: Vec<Option<T>> = (0..self.views.len()).map(|_| None).collect();
        let mut body = Vec::new();
        for (index, (streams, photograph)) in results {
            let step = self.order[index].clone();
            let grid = header.coding.tile_grid(&self.views[step.view].camera);
            photographs[step.view] = Some(photograph);
            let (coded, bytes) = streams.into_entry(step, scale, &grid);
            header.entries.push(CodedEntry { offset: body.len() as u64, ..coded });
            body.extend(bytes);
        }
        let mut bytes = header.to_bytes();
        bytes.extend(body);
        Ok(EncodedPlanes { bytes, photographs: photographs.into_iter().flatten().collect() })
    }

    fn component_codings(&self, quality: &PlaneQuality) -> Vec<ComponentCoding> {
        (self.components.iter().zip(&self.rotations))
            .map(|(component, &rotation)| {
                let ratio = if *component == Component::Specular { quality.specular_ratio } else { 1.0 };
                ComponentCoding {
                    step: quality.step * ratio,
                    shrink: SHRINK,
                    rotation,
                    signed: self.signed && *component == Component::Specular,
                    shaded: *component != Component::Specular,
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mode_follows_the_size_of_the_photographs() {
        let automatic = |pixels: u64| mode(DecodeSpeed::Automatic, pixels);
        assert_eq!([0, 1_500_000].map(automatic), [(0, Modelling::Mixed); 2]);
        let direct = [1_500_001, 1_600_003, 1_600_004, 6_400_000, 6_400_016, 60_000_000].map(automatic);
        assert_eq!(direct, [1, 1, 2, 2, 3, 3].map(|level| (level, Modelling::Direct)));
        assert_eq!(mode(DecodeSpeed::Normal, 60_000_000), (0, Modelling::Mixed));
    }

    #[test]
    fn sides_of_tiles_are_powers_of_two_in_their_range() {
        assert_eq!([16, 256, 4096].map(|side| tile_side_log2(side).ok()), [Some(4), Some(8), Some(12)]);
        assert!([0, 8, 100, 8192].into_iter().all(|side| tile_side_log2(side).is_err()));
    }
}
