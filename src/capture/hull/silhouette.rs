//! Silhouettes of a capture's views: masks at the size at which the hull is carved, as signed distances.

use super::super::description::{CaptureDescription, FrameDescription};
use super::super::photograph::PhotographReading;
use super::HullOptions;
use super::distance::signed_distances;
use crate::error::{Error, Result};
use crate::image::read::{ColorSpace, ImageFault, read_mask};
use crate::image::{Mask, RgbImage, to_srgb};
use crate::input::{FileAccess, escaped};
use crate::views::Camera;
use std::collections::BTreeMap;

/// Longest side of a silhouette, in pixels; larger masks are reduced.
const MAX_SIDE: u32 = 1536;
/// Views that a warning names, at most.
const MAX_NAMED: usize = 8;

/// One view's silhouette.
pub(super) struct Silhouette {
    /// The camera at the silhouette's size.
    pub(super) camera: Camera,
    /// Pixels of the photograph in one of the silhouette, along a side.
    pub(super) reduction: f64,
    /// Signed distances to the edge in pixels, above zero inside.
    distances: Vec<f32>,
    /// Lowest and highest column and row that are set.
    pub(super) extent: [[f64; 2]; 2],
}

impl Silhouette {
    pub(super) fn new(camera: &Camera, mask: &Mask) -> Option<Self> {
        let (mask, reduction) = reduced(mask);
        let (width, height) = (mask.width, mask.height);
        let mut extent = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for (index, _) in mask.data.iter().enumerate().filter(|(_, set)| **set) {
            for (k, at) in [index % width, index / width].into_iter().enumerate() {
                extent[0][k] = extent[0][k].min(at as f64);
                extent[1][k] = extent[1][k].max(at as f64 + 1.0);
            }
        }
        if extent[0][0] > extent[1][0] {
            return None;
        }
        let small = camera.resized([width as u32, height as u32]);
        let distances = signed_distances(&mask.data, width, height);
        Some(Silhouette { camera: small, reduction, distances, extent })
    }

    /// Distance of a world point to the silhouette's edge, in the world's unit at the point's depth: above zero inside. Beyond the photograph the
    /// silhouette goes on as it is at the photograph's edge.
    pub(super) fn distance(&self, point: [f64; 3]) -> f64 {
        let Some(([x, y], depth)) = self.camera.project(point) else { return f64::NEG_INFINITY };
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let [u, v] = [(x, width), (y, height)].map(|(at, side)| (at - 0.5).clamp(0.0, side as f64 - 1.0));
        let beyond = (x - 0.5 - u).hypot(y - 0.5 - v);
        let (left, top) = (u as usize, v as usize);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (across, down) = (u - left as f64, v - top as f64);
        let at = |x: usize, y: usize| f64::from(self.distances[y * width + x]);
        let upper = at(left, top) * (1.0 - across) + at(right, top) * across;
        let lower = at(left, bottom) * (1.0 - across) + at(right, bottom) * across;
        let mut pixels = upper * (1.0 - down) + lower * down;
        if pixels < 0.0 {
            pixels -= beyond;
        }
        pixels * depth / (0.5 * (self.camera.focal[0] + self.camera.focal[1]))
    }
}

/// A mask whose longer side is at most [`MAX_SIDE`], set where half of what a pixel stands for is, and the reduction.
fn reduced(mask: &Mask) -> (Mask, f64) {
    let longer = mask.width.max(mask.height);
    let step = longer.div_ceil(MAX_SIDE as usize);
    if step <= 1 {
        return (mask.clone(), 1.0);
    }
    let (width, height) = ((mask.width / step).max(1), (mask.height / step).max(1));
    let mut small = Mask::filled(width, height, false);
    for y in 0..height {
        for x in 0..width {
            let range = |at: usize, full: usize, side: usize| {
                at * full / side..((at + 1) * full / side).max(at * full / side + 1)
            };
            let rows = range(y, mask.height, height);
            let (mut set, mut all) = (0, 0);
            for row in rows {
                let columns = range(x, mask.width, width);
                all += columns.len();
                set += mask.row(row)[columns].iter().filter(|&&set| set).count();
            }
            small.data[y * width + x] = 2 * set >= all;
        }
    }
    (small, longer as f64 / width.max(height) as f64)
}

/// The silhouettes of all views that have a mask.
pub(super) fn read(
    description: &CaptureDescription,
    options: &HullOptions,
    access: &FileAccess,
    warnings: &mut Vec<String>,
) -> Result<Vec<Silhouette>> {
    let declared = options.reading.color_space.as_ref().or(description.color_space.as_ref());
    let space = declared.map_or_else(|| Ok(ColorSpace::from_files()), |name| ColorSpace::from_name(name))?;
    let (mut kept, mut reading) = (0u64, 1u64);
    for frame in &description.frames {
        let Camera { width, height, .. } = frame.view.camera;
        let step = width.max(height).div_ceil(MAX_SIDE).max(1);
        kept += 4 * u64::from(width / step + 1) * u64::from(height / step + 1);
        let pixels = u64::from(width) * u64::from(height);
        let photographs = PhotographReading { access, space: &space };
        // The distances of a silhouette are computed out of place.
        reading = reading.max(photographs.memory(frame, width, height).saturating_add(16 * pixels));
    }
    access.charge(&description.path, "silhouettes of the capture", kept)?;
    let at_once = (access.budget().left() / reading).max(1) as usize;
    let groups = by_camera(&description.frames);
    let mut found = Vec::new();
    let (mut without, mut faults) = (Vec::new(), Vec::new());
    for some in groups.chunks(at_once) {
        let outcomes = crate::parallel::map(some.len(), |k| read_group(&some[k], options, access, &space));
        for (outcome, group) in outcomes.into_iter().zip(some) {
            match outcome {
                Ok(Some(silhouette)) => found.push(silhouette),
                Ok(None) => without.push(escaped(&group[0].view.name)),
                Err(ImageFault::Unreadable(error)) => faults.push(error.to_string()),
                Err(ImageFault::Wrong(error)) => return Err(error),
            }
        }
    }
    if found.is_empty() {
        let why = faults.first().cloned().unwrap_or_else(|| {
            "no view has a mask (mask_path, files in masks/, or alpha): a hull needs them; for photographs before a dark background set \
             option `dark_background`"
                .into()
        });
        return Err(Error::input(&description.path, why));
    }
    for (names, what) in
        [(without, "views without a mask, or with an empty one, are"), (faults, "views that can't be read are")]
    {
        if !names.is_empty() {
            let shown = names.iter().take(MAX_NAMED).cloned().collect::<Vec<_>>().join(", ");
            warnings.push(format!("{} {what} not used: {shown}", names.len()));
        }
    }
    Ok(found)
}

/// Frames of one camera under several lights stand together: where a light does not reach, masks may leave the object out.
fn by_camera(frames: &[FrameDescription]) -> Vec<Vec<&FrameDescription>> {
    let mut places: BTreeMap<Vec<u64>, usize> = BTreeMap::new();
    let mut groups: Vec<Vec<&FrameDescription>> = Vec::new();
    for frame in frames {
        let Camera { width, height, focal, principal, rotation, translation } = &frame.view.camera;
        let numbers = focal.iter().chain(principal).chain(rotation.as_flattened()).chain(translation);
        let key = numbers.map(|number| number.to_bits()).chain([u64::from(*width), u64::from(*height)]).collect();
        let place = *places.entry(key).or_insert(groups.len());
        if place == groups.len() {
            groups.push(Vec::new());
        }
        groups[place].push(frame);
    }
    groups
}

/// The silhouette of frames of one camera: what any of their masks shows.
fn read_group(
    frames: &[&FrameDescription],
    options: &HullOptions,
    access: &FileAccess,
    space: &ColorSpace,
) -> std::result::Result<Option<Silhouette>, ImageFault> {
    let (mut all, mut fault): (Option<Mask>, _) = (None, None);
    for frame in frames {
        match (read_mask_of(frame, options, access, space), &mut all) {
            (Ok(Some(mask)), Some(all)) => all.data.iter_mut().zip(mask.data).for_each(|(set, more)| *set |= more),
            (Ok(Some(mask)), None) => all = Some(mask),
            (Ok(None), _) => {}
            (Err(ImageFault::Unreadable(error)), _) => fault = Some(error),
            (Err(wrong), _) => return Err(wrong),
        }
    }
    match (all, fault) {
        (Some(mask), _) => Ok(Silhouette::new(&frames[0].view.camera, &mask)),
        (None, Some(error)) => Err(ImageFault::Unreadable(error)),
        (None, None) => Ok(None),
    }
}

fn read_mask_of(
    frame: &FrameDescription,
    options: &HullOptions,
    access: &FileAccess,
    space: &ColorSpace,
) -> std::result::Result<Option<Mask>, ImageFault> {
    let camera = &frame.view.camera;
    let size = (camera.width, camera.height);
    let (mut mask, photograph) = match &frame.mask {
        Some(path) => (Some(read_mask(path, access, size)?), None),
        None => {
            let read = PhotographReading { access, space }.read(&frame.photograph, Some(size))?;
            (read.alpha, Some(read.photograph))
        }
    };
    if options.reading.invert_masks {
        mask.iter_mut().flat_map(|mask| &mut mask.data).for_each(|shown| *shown = !*shown);
    }
    if let (None, Some(photograph), Some(level)) = (&mask, photograph, options.dark_background) {
        mask = Some(before_dark(&photograph, level));
    }
    if let Some(mask) = &mut mask
        && !frame.lens.is_pinhole()
    {
        *mask = frame.lens.undistort_mask(camera, mask);
    }
    Ok(mask)
}

/// What is not dark, or not joined to the photograph's edge by what is dark.
fn before_dark(photograph: &RgbImage, level: f64) -> Mask {
    let (width, height) = (photograph.width, photograph.height);
    let mut mask = Mask::filled(width, height, true);
    let is_dark = |at: usize| {
        let brightest = photograph.data[at].iter().fold(0.0f32, |a, &b| a.max(b));
        to_srgb(f64::from(brightest)) <= level
    };
    let on_edge = |at: &usize| {
        let (x, y) = (at % width, at / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let mut reached: Vec<usize> = (0..width * height).filter(|at| on_edge(at) && is_dark(*at)).collect();
    reached.iter().for_each(|&at| mask.data[at] = false);
    while let Some(at) = reached.pop() {
        let (x, y) = (at % width, at / width);
        let near = [
            (x > 0, at.wrapping_sub(1)),
            (x + 1 < width, at + 1),
            (y > 0, at.wrapping_sub(width)),
            (y + 1 < height, at + width),
        ];
        for (_, next) in near.into_iter().filter(|(there, _)| *there) {
            if mask.data[next] && is_dark(next) {
                mask.data[next] = false;
                reached.push(next);
            }
        }
    }
    mask
}
