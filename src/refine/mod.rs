//! Refinement of the surface: the scan, subdivided and displaced along its normals until it explains the photographs.
//!
//! A scan's triangles are larger than pixels and its normals are degrees wrong, so that highlights computed from it lie beside those of
//! the photographs. Photographs under known light say where: the diffuse component by its shading, the specular one by its highlights
//! (photometric stereo; Woodham 1980, Nehab et al. 2005), both by their texture in several views. One displacement a vertex is solved
//! for together with the model of reflectance, by Gauss and Newton's method, from coarse to fine meshes.

mod evidence;
mod rings;
mod schedule;
mod signal_view;
mod system;

use crate::error::Result;
use crate::image::Mask;
use crate::mesh::Mesh;
use crate::options::{EncodeOptions, Profile, Refinement};
use crate::reflectance::lobes::equations::LobeEquations;
use crate::reflectance::lobes::share::{SharingScale, share_weights};
use crate::reflectance::lobes::{LOBES, LobeCosines, lobe_values};
use crate::separate::{Observations, ObservedView, SeparatedFrames};
use crate::surface::displacement::{DisplacedMesh, Displacements, interpolated_normals};
use crate::surface::raster::rasterise;
use crate::surface::subdivision::{mean_edge, subdivide};
use crate::views::source::open_together;
use crate::views::{Camera, Component, View};
use evidence::{LossScales, SurfaceState};
use rings::Rings;
use schedule::{STAGES, Stage};
use signal_view::{SPECULAR_FLOOR, SignalView};
use std::borrow::Cow;
use std::ops::{Range, RangeInclusive};
use system::DisplacedSurface;

/// Edge of the finest mesh, in pixels of the reduced photographs.
const EDGE_PIXELS: f64 = 1.25;
/// Subdivisions, at most: as many as a file holds.
const MAX_LEVELS: u32 = 6;
/// Vertices of the finest mesh, at most.
const MAX_VERTICES: u64 = 1 << 20;
/// Pixels of all photographs, beyond which they are reduced.
const MAX_PIXELS: u64 = 16 << 20;
/// Views under known lights, at least.
const MIN_VIEWS: usize = 2 * LEAVE_OUT;
/// One view of so many is left out while it is decided whether the refinement holds, and so many at most.
const LEAVE_OUT: usize = 7;
/// Steps longer than this, in edges, are cut.
const MAX_STEP: f64 = 1.5;
/// Half a side of the object, in pixels, that lobes are shared as for at least.
const LEAST_SIZE: f64 = 150.0;
/// Iterations over which the losses' scales fall from three times their value.
const WIDE_ITERATIONS: f64 = 3.0;
/// Least cosine of a view that lobes are fitted to.
const LOBE_COS_VIEW: f64 = 0.25;

/// A refined surface: the scan, linearly subdivided and displaced.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedSurface {
    /// Subdivisions.
    pub levels: u32,
    /// Displacement of each vertex of the subdivided scan along its interpolated unit normal, world units.
    pub displacement: Vec<f64>,
    /// World length of a pixel at the object's middle, mean of the views.
    pub pixel: f64,
    /// Loss of the views that were left out while it was decided: with the scan and with the refined surface.
    pub left_out_loss: [f64; 2],
}

/// Step of coded displacements, in pixels, for photographs with a quantiser step of 1, and its range: below it normals differ by less than
/// from the true ones, above it the surface is no better than the mesh.
const CODED_STEP: f64 = 2.8;
const CODED_STEPS: RangeInclusive<f64> = 0.07..=0.28;

impl RefinedSurface {
    /// The displacements as they are to be coded beside photographs with this quantiser step.
    pub fn displacements(&self, photograph_step: f64) -> Displacements<'_> {
        let step = (CODED_STEP * photograph_step).clamp(*CODED_STEPS.start(), *CODED_STEPS.end());
        Displacements { levels: self.levels, values: &self.displacement, step: step * self.pixel }
    }
    /// Returns the displaced scan.
    /// # Errors
    /// [`crate::Error::Format`] where a displacement leads beyond all numbers.
    pub fn displaced(&self, scan: &Mesh) -> Result<DisplacedMesh> {
        DisplacedMesh::new(scan, self.levels, |vertex, _, _| self.displacement[vertex])
    }
}

/// Directions along which a subdivided scan is displaced: its vertices' normals, interpolated.
struct SubdividedScan {
    mesh: Mesh,
    base: Vec<[f64; 3]>,
    along: Vec<[f64; 3]>,
}

impl SubdividedScan {
    fn new(scan: &Mesh, levels: u32) -> Self {
        let fine = subdivide(scan, levels);
        let along = interpolated_normals(scan, &fine);
        SubdividedScan { base: fine.mesh.positions.iter().map(|p| p.map(f64::from)).collect(), mesh: fine.mesh, along }
    }
}

/// Refines a scan. `None` where the refined surface does not explain views that it was not fitted to any better than the scan does,
/// where the lights are unknown, or too few views have one.
fn refine<'o>(
    scan: &Mesh,
    views: &[View],
    white: [f64; 3],
    observe: impl Fn(usize) -> Result<Cow<'o, ObservedView>> + Sync + Send,
    runs: Vec<Range<usize>>,
) -> Result<Option<RefinedSurface>> {
    // Told before any photograph is opened.
    if views.iter().filter(|view| view.light.is_some()).count() < MIN_VIEWS {
        return Ok(None);
    }
    let pixels = |factor: usize| {
        let pixels = |camera: &Camera| (camera.width as u64 / factor as u64) * (camera.height as u64 / factor as u64);
        views.iter().map(|view| pixels(&view.camera)).sum::<u64>()
    };
    let factor = (1..64).find(|&factor| pixels(factor) <= MAX_PIXELS).unwrap_or(64);
    let reduced = |k: usize| {
        let observed = observe(k)?;
        let view = &views[k];
        let covered = || Cow::Owned(rasterise(scan, &view.camera).coverage());
        let mask: Cow<Mask> = observed.mask.as_ref().map_or_else(covered, Cow::Borrowed);
        let [diffuse, specular] = &observed.images[..] else { return Ok(None) };
        Ok(SignalView::new(view, &mask, [diffuse, specular], white, factor))
    };
    let mut signals = Vec::with_capacity(views.len());
    for run in runs {
        let some = crate::parallel::map(run.len(), |k| reduced(run.start + k));
        signals.extend(some.into_iter().collect::<Result<Vec<_>>>()?.into_iter().flatten());
    }
    if signals.len() < MIN_VIEWS {
        return Ok(None);
    }
    let pixel = pixel_length(scan, &signals);
    let finest = levels(scan, pixel);
    let size = scan.half_longest_side().max(LEAST_SIZE * pixel);
    // Coarse stages decide, by views that they leave out.
    let mut left_out = Vec::new();
    for k in (0..signals.len()).rev().filter(|k| k % LEAVE_OUT == LEAVE_OUT / 2) {
        left_out.push(signals.remove(k));
    }
    let mut state = RefinementProgress { displacement: vec![0.0; scan.positions.len()], left_out_loss: [0.0; 2] };
    for (number, stage) in STAGES.iter().enumerate() {
        let levels = finest.saturating_sub(stage.coarser);
        if stage.coarser == 0 && STAGES[number - 1].coarser > 0 {
            if state.left_out_loss[1] >= state.left_out_loss[0] {
                return Ok(None);
            }
            signals.append(&mut left_out);
        }
        state.run(scan, levels, stage, size, &mut signals, &mut left_out);
    }
    let RefinementProgress { displacement, left_out_loss, .. } = state;
    Ok(Some(RefinedSurface { levels: finest, displacement, pixel, left_out_loss }))
}

/// World length of a pixel at the object's middle, mean of the views.
fn pixel_length(scan: &Mesh, signals: &[SignalView]) -> f64 {
    let (middle, _) = scan.bounding_sphere();
    let pixel = |view: &SignalView| view.camera().to_camera(middle)[2] / view.camera().focal[0];
    signals.iter().map(pixel).sum::<f64>() / signals.len() as f64
}

/// Subdivisions after which an edge is about a pixel long.
fn levels(scan: &Mesh, pixel: f64) -> u32 {
    let wanted = (mean_edge(scan) / pixel / EDGE_PIXELS).log2().round();
    let mut levels = if wanted > 0.0 { wanted.min(MAX_LEVELS as f64) as u32 } else { 0 };
    // Each subdivision makes about four vertices of one.
    while levels > 0 && (scan.positions.len() as u64) << (2 * levels) > MAX_VERTICES {
        levels -= 1;
    }
    levels
}

/// Displacements as far as they are known.
struct RefinementProgress {
    displacement: Vec<f64>,
    left_out_loss: [f64; 2],
}

impl RefinementProgress {
    /// Iterates on the scan subdivided `levels` times.
    fn run(
        &mut self,
        scan: &Mesh,
        levels: u32,
        stage: &Stage,
        size: f64,
        signals: &mut [SignalView],
        left_out: &mut [SignalView],
    ) {
        let mut displacement = subdivide(scan, levels).interpolate(&self.displacement, |a, b| 0.5 * (a + b));
        let SubdividedScan { mesh, base, along } = SubdividedScan::new(scan, levels);
        let rings = Rings::new(base.len(), &mesh.triangles);
        let edge = mean_edge(&mesh);
        let surface = DisplacedSurface { triangles: &mesh.triangles, rings: &rings, base: &base, along: &along, edge };
        let scale = SharingScale { cell: stage.sharing.cell * size, smoothing: stage.sharing.smoothing * size };
        let (mut weights, mut roots) = (Vec::new(), Vec::new());
        let look = |signals: &mut [SignalView], points: &[[f64; 3]]| {
            let positions = points.iter().map(|p| p.map(|x| x as f32)).collect();
            let drawn = Mesh { positions, triangles: mesh.triangles.clone() };
            crate::parallel::for_each_chunk(signals, 1, |_, view| view.iter_mut().for_each(|view| view.look(&drawn)));
        };
        // The loss of the views left out, under a model fitted to the others.
        let judge = |signals: &mut [SignalView], left_out: &mut [SignalView], displacement: &[f64]| {
            let points = surface.points(displacement);
            let normals = surface.normals(&points);
            look(signals, &points);
            look(left_out, &points);
            let weights = lobes(signals, &points, &normals, scale, &[]);
            let state = SurfaceState { points: &points, normals: &normals, along: &along, weights: &weights };
            let evidence = evidence::gather(signals, &state, &[], stage.scales);
            let roots: Vec<f32> = evidence.iter().map(|evidence| evidence.root).collect();
            evidence::loss(left_out, &state, &roots, stage.scales)
        };
        if stage.coarser == 1 {
            self.left_out_loss[0] = judge(signals, left_out, &vec![0.0; displacement.len()]);
        }
        for iteration in 0..stage.iterations {
            let points = surface.points(&displacement);
            let normals = surface.normals(&points);
            if iteration % stage.depths_every == 0 {
                look(signals, &points);
            }
            if iteration % stage.lobes_every == 0 {
                weights = lobes(signals, &points, &normals, scale, &weights);
            }
            let wide = 1.0 + 2.0 * (1.0 - iteration as f64 / WIDE_ITERATIONS).max(0.0);
            let scales = LossScales { diffuse: wide * stage.scales.diffuse, specular: wide * stage.scales.specular };
            let state = SurfaceState { points: &points, normals: &normals, along: &along, weights: &weights };
            let evidence = evidence::gather(signals, &state, &roots, scales);
            roots = evidence.iter().map(|evidence| evidence.root).collect();
            let loss = evidence.iter().fold([0.0; 3], |sum, e| std::array::from_fn(|k| sum[k] + e.loss[k]));
            tracing::debug!("evidence");
            let step = surface.step(&displacement, &evidence, &stage.priors);
            let longest = MAX_STEP * edge;
            displacement.iter_mut().zip(&step).for_each(|(d, step)| *d += step.clamp(-longest, longest));
            tracing::debug!(
                "refinement: {} vertices, iteration {iteration}, loss {:.6} diffuse, {:.6} specular",
                points.len(),
                loss[0] / loss[2],
                loss[1] / loss[2]
            );
        }
        if stage.coarser == 1 {
            self.left_out_loss[1] = judge(signals, left_out, &displacement);
        }
        self.displacement = displacement;
    }
}

/// Fits the lobes of grey highlights, shared between neighbouring vertices; `before` are those of each vertex from the last time, or empty.
fn lobes(
    signals: &[SignalView],
    points: &[[f64; 3]],
    normals: &[[f64; 3]],
    scale: SharingScale,
    before: &[[[f32; LOBES]; 1]],
) -> Vec<[[f32; LOBES]; 1]> {
    share_weights(points, scale, |v| {
        let mut equations = LobeEquations::<1>::default();
        for view in signals {
            let Some(sighting) = view.sight(points[v], normals[v], LOBE_COS_VIEW) else { continue };
            let root = view.roots(&sighting)[1];
            let radiance = (root * root - SPECULAR_FLOOR).max(0.0);
            let [view, light, half] = sighting.cosines;
            let values = lobe_values(&LobeCosines { light, view, half }).map(|value| value * sighting.irradiance);
            // Errors count by their share of the radiance: bright highlights are not all that matters. Of the radiance expected, as soon as
            // there is one: by that seen, what lies too dark would count for more than what lies too bright.
            let expected = before.get(v).map(|before| (0..LOBES).map(|k| before[0][k] as f64 * values[k]).sum());
            equations.add(&values, [radiance], view / (expected.unwrap_or(radiance) + 0.01));
        }
        equations
    })
}

/// Returns the refined surface of a capture: `None` as [`refine`] does, and of captures whose photographs hold both components combined.
pub fn refine_observations(scan: &Mesh, observations: &Observations) -> Option<RefinedSurface> {
    if observations.components != [Component::Diffuse, Component::Specular] {
        return None;
    }
    let views: Vec<View> = observations.views.iter().map(|observed| observed.view.clone()).collect();
    let observe = |k: usize| Ok(Cow::Borrowed(&observations.views[k]));
    refine(scan, &views, observations.white, observe, open_together(&views, usize::MAX)).ok().flatten()
}

/// Returns the surface that a capture's photographs show, where `options` ask for it; adds a warning where there is none. What is kept of the
/// photographs is reduced to [`MAX_PIXELS`] of all together.
pub(crate) fn refined_surface(
    mesh: &Mesh,
    views: &[View],
    frames: &SeparatedFrames,
    options: &EncodeOptions,
    warnings: &mut Vec<String>,
) -> Result<Option<RefinedSurface>> {
    let is_asked_for = options.refine == Refinement::Surface;
    if options.refine == Refinement::None {
        return Ok(None);
    }
    if options.profile != Profile::Predictive {
        if is_asked_for {
            warnings.push("the surface stays as the mesh has it: option `refine` goes with profile predictive".into());
        }
        return Ok(None);
    }
    let refined = match frames.components == [Component::Diffuse, Component::Specular] {
        true => {
            let observe = |k: usize| frames.observe(k).map(Cow::Owned);
            refine(mesh, views, frames.white(), observe, open_together(views, frames.at_once()))?
        }
        false => None,
    };
    if refined.is_none() && is_asked_for {
        warnings.push(
            "the surface stays as the mesh has it: refining it takes polarised photographs under known lights, 14 views or more, and \
             it has to explain views better that it was not fitted to"
                .into(),
        );
    }
    Ok(refined)
}
