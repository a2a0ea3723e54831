//! What the photographs show of places on the surface: gathered view by view, read place by place, and between in a file, as it grows with the
//! number of photographs.

use super::ReflectionGeometry;
use crate::error::{Error, Result};
use crate::input::{scratch_file, scratch_folder};
use crate::mesh::Mesh;
use crate::options::SpecularModel;
use crate::parallel;
use crate::surface::displacement::DisplacedMesh;
use crate::surface::raster::{Raster, rasterise};
use crate::vector::{direction, dot};
use crate::views::source::{MOST_OPEN, PhotographSource, open_run, open_together};
use crate::views::{Component, Photograph, PointLight, View};
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use tempfile::SpooledTempFile;

/// Sightings with a smaller `cos(normal, view)` are left out: they are half of the model's error (and few of its pixels).
const GRAZING: f64 = 0.25;
/// A surface point is hidden where the mesh is nearer by this many pixel widths.
const MARGIN_PIXELS: f64 = 4.0;
/// Blocks of places that are read together.
const CHUNK: usize = 1024;
/// Chunks that are gathered side by side.
const SIDE_BY_SIDE: usize = 16;

/// Input of [`fit_maps`](super::gather::fit_maps).
pub struct ReflectanceSources<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Its surface, where that is finer.
    pub surface: Option<&'a DisplacedMesh>,
    /// The captured views; the maps are relightable if all of them have a light.
    pub views: &'a [View],
    /// Components of the photographs.
    pub components: &'a [Component],
    /// Photographs, by view; NaN pixels are missing.
    pub photographs: &'a dyn PhotographSource,
    /// Model of the specular component.
    pub specular: SpecularModel,
    /// Irradiance of the mesh's vertices in all views, where the light is an environment and the views have none.
    pub irradiance: Option<&'a [[f32; 3]]>,
}

/// A point of the surface and its unit normal.
pub(crate) type Place = ([f64; 3], [f64; 3]);

/// One photograph's radiance at a place, per component, and how the place lay there.
pub(super) struct TexelSighting {
    pub(super) geometry: ReflectionGeometry,
    pub(super) radiance: [[f32; 3]; 2],
}

/// The sightings of blocks of places.
pub(super) struct Sightings<'a> {
    views: &'a [View],
    components: usize,
    runs: Vec<Range<usize>>,
    /// By run of views and chunk of blocks: where its bytes begin, and their number.
    parts: Vec<Vec<(u64, usize)>>,
    /// For each block its number of bytes, and for each of its places a byte with a bit for each view of the run that shows it, and their
    /// radiance.
    file: SpooledTempFile,
}

// A byte has a bit for each view of a run.
const _: () = assert!(MOST_OPEN <= u8::BITS as usize);

fn failed(error: std::io::Error) -> Error {
    Error::io(scratch_folder(), error)
}

/// A view that is looked at.
pub(crate) struct OpenedView<'a> {
    view: &'a View,
    centre: [f64; 3],
    photograph: &'a Photograph,
    raster: Raster,
}

impl<'a> OpenedView<'a> {
    /// Draws the mesh as the view shows it.
    pub(crate) fn new(mesh: &Mesh, view: &'a View, photograph: &'a Photograph) -> Self {
        OpenedView { view, centre: view.camera.centre(), photograph, raster: rasterise(mesh, &view.camera) }
    }
}

impl<'a> Sightings<'a> {
    /// Looks at `blocks` blocks of places in all photographs; `places` returns those of a block.
    pub(super) fn gather(
        sources: &ReflectanceSources<'a>,
        blocks: usize,
        places: &(dyn Fn(usize) -> Vec<Place> + Sync),
    ) -> Result<Self> {
        let drawn = sources.surface.map_or(sources.mesh, DisplacedMesh::mesh);
        let views = sources.views;
        let runs = open_together(views, sources.photographs.at_once());
        let mut file = scratch_file();
        let (mut parts, mut end) = (Vec::with_capacity(runs.len()), 0);
        for run in &runs {
            let photographs = open_run(sources.photographs, run)?;
            let opened = parallel::map(run.len(), |k| OpenedView::new(drawn, &views[run.start + k], &photographs[k]));
            let chunks = blocks.div_ceil(CHUNK);
            let mut of_run = Vec::with_capacity(chunks);
            for first in (0..chunks).step_by(SIDE_BY_SIDE) {
                let some = parallel::map(SIDE_BY_SIDE.min(chunks - first), |k| {
                    let start = (first + k) * CHUNK;
                    let mut bytes = Vec::new();
                    (start..blocks.min(start + CHUNK))
                        .for_each(|block| write_block(&mut bytes, &places(block), &opened));
                    bytes
                });
                for bytes in some {
                    file.write_all(&bytes).map_err(failed)?;
                    of_run.push((end, bytes.len()));
                    end += bytes.len() as u64;
                }
            }
            parts.push(of_run);
        }
        Ok(Sightings { views, components: sources.components.len().min(2), runs, parts, file })
    }

    /// Calls `fit` with each block and what was seen of it, some side by side, and returns the results in order.
    pub(super) fn map<T: Send>(
        mut self,
        blocks: usize,
        fit: impl Fn(usize, BlockSightings) -> T + Sync + Send,
    ) -> Result<Vec<T>> {
        let mut results = Vec::with_capacity(blocks);
        for chunk in 0..blocks.div_ceil(CHUNK) {
            let count = CHUNK.min(blocks - chunk * CHUNK);
            let mut runs = Vec::with_capacity(self.parts.len());
            for parts in &self.parts {
                let (offset, length) = parts[chunk];
                let mut bytes = vec![0; length];
                self.file.seek(SeekFrom::Start(offset)).map_err(failed)?;
                self.file.read_exact(&mut bytes).map_err(failed)?;
                runs.push(bytes);
            }
            // Of each block the bytes of each run.
            let mut of_blocks: Vec<Vec<&[u8]>> = (0..count).map(|_| Vec::with_capacity(runs.len())).collect();
            for mut rest in runs.iter().map(Vec::as_slice) {
                for block in &mut of_blocks {
                    let own;
                    let (length, after) = rest.split_first_chunk().unwrap_or((&[0; 4], &[]));
                    (own, rest) = after.split_at((u32::from_le_bytes(*length) as usize).min(after.len()));
                    block.push(own);
                }
            }
            let (views, components, view_runs) = (self.views, self.components, &self.runs);
            results.extend(parallel::map(count, |k| {
                fit(chunk * CHUNK + k, BlockSightings { views, components, view_runs, bytes: of_blocks[k].clone() })
            }));
        }
        Ok(results)
    }
}

/// The sightings of one block's places, which are asked for one after the other.
pub(super) struct BlockSightings<'a> {
    views: &'a [View],
    components: usize,
    view_runs: &'a [Range<usize>],
    /// By run, from the next place on.
    bytes: Vec<&'a [u8]>,
}

impl BlockSightings<'_> {
    /// Adds what was seen of the next place, view by view.
    pub(super) fn next(&mut self, (point, normal): Place, seen: &mut Vec<TexelSighting>) {
        const DARK: PointLight = PointLight { position: [0.0; 3], intensity: [0.0; 3] };
        for (run, bytes) in self.view_runs.iter().zip(&mut self.bytes) {
            let Some((&shown, mut rest)) = bytes.split_first() else { continue };
            for view in run.clone().filter(|view| shown >> (view - run.start) & 1 == 1) {
                let mut radiance = [[0f32; 3]; 2];
                for value in radiance[..self.components].as_flattened_mut() {
                    let Some((value_bytes, after)) = rest.split_first_chunk() else { continue };
                    (*value, rest) = (f32::from_le_bytes(*value_bytes), after);
                }
                let view = &self.views[view];
                let geometry =
                    ReflectionGeometry::new(point, normal, view.camera.centre(), &view.light.unwrap_or(DARK));
                seen.push(TexelSighting { geometry, radiance });
            }
            *bytes = rest;
        }
    }
}

fn write_block(bytes: &mut Vec<u8>, places: &[Place], opened: &[OpenedView]) {
    let start = bytes.len();
    bytes.extend([0; 4]);
    for place in places {
        let shown = bytes.len();
        bytes.push(0);
        for (bit, view) in opened.iter().enumerate() {
            if let Some(radiance) = radiance_at(view, place) {
                bytes[shown] |= 1 << bit;
                let components = view.photograph.images.len().min(2);
                bytes.extend(radiance[..components].as_flattened().iter().flat_map(|value| value.to_le_bytes()));
            }
        }
    }
    let length = (bytes.len() - start - 4) as u32;
    bytes[start..start + 4].copy_from_slice(&length.to_le_bytes());
}

/// Radiance of a place in a view, of each component, where the view shows it.
pub(crate) fn radiance_at(opened: &OpenedView, &(point, normal): &Place) -> Option<[[f32; 3]; 2]> {
    let OpenedView { view, centre, photograph, raster } = opened;
    let cos_view = dot(normal, direction(point, *centre).0) as f32;
    if (cos_view as f64) < GRAZING {
        return None;
    }
    let (at, depth) = view.camera.project(point)?;
    let (x, y) = ((at[0] - 0.5).floor(), (at[1] - 0.5).floor());
    if !(x >= 0.0 && y >= 0.0 && x + 1.0 < raster.width as f64 && y + 1.0 < raster.height as f64) {
        return None;
    }
    let (s, t) = ((at[0] - 0.5 - x) as f32, (at[1] - 0.5 - y) as f32);
    let first = y as usize * raster.width + x as usize;
    let margin = MARGIN_PIXELS * depth / view.camera.focal[0].abs();
    let taps = [
        (first, (1.0 - s) * (1.0 - t)),
        (first + 1, s * (1.0 - t)),
        (first + raster.width, (1.0 - s) * t),
        (first + raster.width + 1, s * t),
    ];
    let mut radiance = [[0f32; 3]; 2];
    let visible = taps.iter().all(|&(index, weight)| {
        for (sum, image) in radiance.iter_mut().zip(&photograph.images) {
            (0..3).for_each(|c| sum[c] += weight * image.data[index][c]);
        }
        photograph.mask.data[index] && raster.is_covered(index) && (raster.depth[index] - depth).abs() < margin
    });
    (visible && radiance.iter().flatten().all(|x| x.is_finite())).then_some(radiance)
}
