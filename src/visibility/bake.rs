//! From a mesh to its visibility: rays, signed distances, principal components, integers.

use super::codec;
use super::codec::VisibilitySteps;
use super::measure::measure;
use super::principal;
use super::rays::{DirectionGrid, MeshRays, RayScratch};
use super::{Visibility, VisibilityError};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::sphere::octahedral;
use crate::surface::samples::SurfaceSamples;
use std::time::Instant;

/// Options of [`bake`].
#[derive(Debug, Clone, PartialEq)]
pub struct BakeOptions {
    /// Cells along a side of the grid of directions, 8 to 128.
    pub size: usize,
    /// Terms of the first group, 1 to 64, and of the second, 0 to 64.
    pub terms: [usize; 2],
    /// Up direction of an endless ground plane below the object, which blocks all light from below.
    pub ground_up: Option<[f64; 3]>,
    /// Finest step of the weights, in radians times the square root of a steradian: 1e-6 to 1e4.
    pub weight_step: f64,
    /// Places on the mesh, at most, spread so that edges are cut alike; its vertices always count.
    pub places: usize,
}

impl Default for BakeOptions {
    fn default() -> Self {
        BakeOptions { size: 24, terms: [16, 32], ground_up: None, weight_step: 0.01, places: 0 }
    }
}

/// Baked visibility.
#[derive(Debug, Clone)]
pub struct BakedVisibility {
    /// The section `vISB`.
    pub bytes: Vec<u8>,
    /// Visibility as a decoder has it.
    pub visibility: Visibility,
    /// Seconds from the mesh to the section, without measuring the error.
    pub seconds: f64,
}

/// Places whose distances the components are computed from, at most.
const SAMPLES: usize = 4096;
/// Places that are worked on at a time.
const BLOCK: usize = 64;

/// Computes the visibility of all vertices of a mesh whose positions are finite, and of samples between them where more are asked for.
/// Vertices and triangles keep their order: the mesh must be the one that the file's MESH decodes to.
///
/// # Errors
///
/// [`Error::Parameter`] for options out of range, a mesh without triangles, or positions that are not finite.
pub fn bake(mesh: &Mesh, options: &BakeOptions) -> Result<BakedVisibility> {
    let start = Instant::now();
    check(mesh, options)?;
    let places = SurfaceSamples::with_max_count(mesh, options.places)?;
    let cut = places.subdivided(mesh);
    let count_of_places = places.count();
    // 1. Rays and distances, each value times the square root of its cell's solid angle.
    let surroundings = MeshRays::new(mesh, &cut, options.ground_up);
    let grid = DirectionGrid::new(options.size);
    let cells = options.size * options.size;
    let roots: Vec<f32> = octahedral::solid_angles(options.size).iter().map(|a| a.sqrt() as f32).collect();
    let distances = |list: &[usize]| {
        let mut scratch = RayScratch::default();
        let mut values = Vec::with_capacity(list.len() * cells);
        for &place in list {
            surroundings.signed_distances(place, &grid, &mut scratch);
            values.extend(scratch.distances.iter().zip(&roots).map(|(distance, root)| distance * root));
        }
        values
    };
    let chosen = count_of_places.min(SAMPLES);
    let sampled: Vec<usize> = (0..chosen).map(|k| k * count_of_places / chosen).collect();
    let blocks: Vec<&[usize]> = sampled.chunks(BLOCK).collect();
    let sample = crate::parallel::map(blocks.len(), |k| distances(blocks[k])).concat();
    // 2. Mean and components, as the decoder will have them.
    let count = options.terms[0] + options.terms[1];
    let (mean, components) = principal::components(&sample, cells, count);
    let spread = spread(&sample, &mean, &components);
    let unroot = |values: &[f32]| -> Vec<f32> { values.iter().zip(&roots).map(|(value, root)| value / root).collect() };
    let basis_error = (0.2 / (count_of_places as f64).sqrt()).clamp(0.0015, 0.007);
    let mean = codec::quantise(&unroot(&mean), basis_error);
    let bases: Vec<codec::QuantisedValues> = (components.iter().zip(&spread))
        .map(|(component, &spread)| codec::quantise(&unroot(component), basis_error / spread.max(1e-3)))
        .collect();
    // 3. Weights, by least squares for the bases as they are stored.
    let rooted =
        |values: Vec<f32>| -> Vec<f32> { values.iter().zip(&roots).map(|(value, root)| value * root).collect() };
    let stored: Vec<Vec<f32>> = bases.iter().map(|base| rooted(base.values())).collect();
    let stored_mean = rooted(mean.values());
    let projection = principal::least_squares(&stored);
    let project = |values: &[f32]| {
        let centred: Vec<f32> = values.iter().enumerate().map(|(i, x)| x - stored_mean[i % cells]).collect();
        principal::project(&centred, cells, &projection)
    };
    let mut weights = vec![0.0f32; count_of_places * count];
    let mut put = |list: &[usize], values: &[f32]| {
        for (&place, values) in list.iter().zip(values.chunks_exact(count)) {
            weights[place * count..][..count].copy_from_slice(values);
        }
    };
    let projected =
        crate::parallel::map(blocks.len(), |k| project(&sample[k * BLOCK * cells..][..blocks[k].len() * cells]));
    blocks.iter().zip(&projected).for_each(|(list, values)| put(list, values));
    let mut left: Vec<usize> = Vec::new();
    let mut next = sampled.iter().copied().peekable();
    left.extend((0..count_of_places).filter(|place| next.next_if_eq(place).is_none()));
    let blocks: Vec<&[usize]> = left.chunks(BLOCK).collect();
    let projected = crate::parallel::map(blocks.len(), |k| project(&distances(blocks[k])));
    blocks.iter().zip(&projected).for_each(|(list, values)| put(list, values));
    let steps = weight_steps(&weights, count, options.weight_step);
    let integers = weights
        .chunks_exact(count)
        .flat_map(|w| w.iter().zip(&steps).map(|(w, step)| (w / step).round().clamp(-127.0, 127.0) as i8))
        .collect();
    // 4. Section.
    let content = codec::VisibilityContent {
        size: options.size,
        terms: options.terms,
        ground: options.ground_up.is_some(),
        error: VisibilityError::default(),
        steps: VisibilitySteps {
            mean: mean.step,
            terms: bases.iter().zip(&steps).map(|(base, &step)| [base.step, step]).collect(),
        },
        mean: mean.integers,
        bases: bases.into_iter().map(|base| base.integers).collect(),
        places: places.clone(),
        weights: integers,
    };
    let mut bytes = codec::write(&content, mesh);
    let mut visibility = content.visibility();
    let seconds = start.elapsed().as_secs_f64();
    visibility.error = measure(&surroundings, &visibility);
    codec::state_error(&mut bytes, visibility.error);
    Ok(BakedVisibility { bytes, visibility, seconds })
}

fn check(mesh: &Mesh, options: &BakeOptions) -> Result<()> {
    if mesh.positions.is_empty() || mesh.triangles.is_empty() {
        return Err(Error::parameter("visibility needs a mesh with a triangle"));
    }
    let corner_missing = mesh.triangles.as_flattened().iter().any(|&v| v as usize >= mesh.positions.len());
    if corner_missing || !mesh.positions.iter().all(crate::mesh::is_within_range) {
        return Err(Error::parameter(
            "visibility needs a mesh whose positions are numbers within 1e12 and whose corners exist",
        ));
    }
    if !codec::SIZES.contains(&options.size) {
        return Err(Error::parameter("the grid of directions must have 8 to 128 cells a side"));
    }
    if !(1..=codec::MAX_TERMS).contains(&options.terms[0]) || options.terms[1] > codec::MAX_TERMS {
        return Err(Error::parameter("visibility takes 1 to 64 terms, and 0 to 64 more"));
    }
    if !codec::STEPS.contains(&(options.weight_step as f32)) {
        return Err(Error::parameter("the step of the weights must be 0.000001 to 10,000"));
    }
    Ok(())
}

/// Root mean square weight of each component.
fn spread(sample: &[f32], mean: &[f32], components: &[Vec<f32>]) -> Vec<f64> {
    let columns = mean.len();
    // A part of the sample tells enough.
    let rows = sample.chunks_exact(columns).step_by(8);
    let count = rows.len().max(1) as f64;
    let mut sums = vec![0.0f64; components.len()];
    for row in rows {
        let centred: Vec<f32> = row.iter().zip(mean).map(|(x, m)| x - m).collect();
        for (sum, component) in sums.iter_mut().zip(components) {
            let weight: f32 = centred.iter().zip(component).map(|(a, b)| a * b).sum();
            *sum += (weight as f64).powi(2);
        }
    }
    sums.iter().map(|sum| (sum / count).sqrt()).collect()
}

/// The finest step, or a coarser one where 8 bits do not reach.
fn weight_steps(weights: &[f32], count: usize, finest: f64) -> Vec<f32> {
    let mut largest = vec![0.0f32; count];
    for row in weights.chunks_exact(count) {
        largest.iter_mut().zip(row).for_each(|(most, w)| *most = most.max(w.abs()));
    }
    largest.into_iter().map(|most| (most / 127.0).max(finest as f32)).collect()
}
