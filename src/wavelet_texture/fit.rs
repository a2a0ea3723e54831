//! Fitting the reflection model to the samples.

use super::model::{ReflectionModel, VertexLobe};
use super::samples::WaveletSamples;
use crate::parallel;
use crate::reflectance::lambert::LambertSums;
use crate::reflectance::torrance_sparrow::{self, SpecularSighting};
use crate::views::Component;

/// Most sightings that one vertex's lobe is fitted to.
const MAX_SIGHTINGS: usize = 384;

/// Fits `K_d` at each sample and a lobe at each vertex (to all samples of the triangles around it that lie nearer to it
/// than to their other corners). Without known lights: the mean radiance, and no lobes.
pub(crate) fn fit(samples: &WaveletSamples, components: &[Component]) -> ReflectionModel {
    let relightable = samples.views.iter().all(|v| v.light.is_some());
    let diffuse_component = components.iter().position(|c| *c != Component::Specular);
    let specular_component = components.iter().position(|c| *c == Component::Specular);
    let diffuse = parallel::map(samples.patches.len(), |patch| match diffuse_component {
        Some(component) => fit_diffuse(samples, patch, component, relightable),
        None => {
            vec![[0.0; 3]; 1 << (2 * samples.layout.side_log2[patch])]
        }
    });
    let lobes = match specular_component {
        Some(component) if relightable => fit_lobes(samples, component),
        _ => Vec::new(),
    };
    let lobes = lobes.iter().map(|lobe| VertexLobe { specular: lobe.specular, log_sigma: lobe.sigma.ln() }).collect();
    ReflectionModel { relightable, diffuse, lobes }
}

fn fit_diffuse(samples: &WaveletSamples, patch: usize, component: usize, relightable: bool) -> Vec<[f32; 3]> {
    let layout = &samples.layout;
    let side_log2 = layout.side_log2[patch];
    let (side, area) = (1usize << side_log2, 1usize << (2 * side_log2));
    let data = &samples.patches[patch];
    let mut grid = vec![[0.0; 3]; area];
    let mut known = vec![false; area];
    for i in 0..area {
        let Some(point) = layout.grid_point(patch, i % side, i / side) else { continue };
        let (position, normal) = layout.position_and_normal(patch, &point);
        let mut sums = LambertSums::default();
        for (view, captured) in samples.views.iter().enumerate() {
            let at = view * area + i;
            if !data.visible[at] {
                continue;
            }
            let radiance = data.radiance[component][at];
            let centre = captured.camera.centre();
            match &captured.light {
                Some(light) if relightable => {
                    let geometry = crate::reflectance::ReflectionGeometry::new(position, normal, centre, light);
                    sums.add(radiance, &geometry);
                }
                _ => {
                    let (direction, _) = crate::vector::direction(position, centre);
                    sums.add_unlit(radiance, crate::vector::dot(normal, direction) as f32);
                }
            }
        }
        if let Some(diffuse) = sums.solve() {
            known[i] = true;
            grid[i] = diffuse;
        }
    }
    spread(&mut grid, &mut known, side);
    grid
}

/// Fills samples that no photograph shows with the mean of their neighbours, ring by ring.
fn spread(grid: &mut [[f32; 3]], known: &mut [bool], side: usize) {
    while known.contains(&true) && known.contains(&false) {
        let before = known.to_vec();
        for i in 0..known.len() {
            if before[i] {
                continue;
            }
            let (x, y) = (i % side, i / side);
            let (mut sum, mut count) = ([0.0f32; 3], 0.0);
            for (nx, ny) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                if nx < side && ny < side && before[ny * side + nx] {
                    (0..3).for_each(|c| sum[c] += grid[ny * side + nx][c]);
                    count += 1.0;
                }
            }
            if count > 0.0 {
                grid[i] = sum.map(|s| s / count);
                known[i] = true;
            }
        }
    }
}

fn fit_lobes(samples: &WaveletSamples, component: usize) -> Vec<crate::reflectance::TorranceSparrowLobe> {
    let layout = &samples.layout;
    let count = layout.mesh.positions.len();
    let mut patches_of_vertex: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (index, patch) in (0u32..).zip(&layout.patches) {
        for corner in patch.corners {
            let list = &mut patches_of_vertex[corner as usize];
            if list.last() != Some(&index) {
                list.push(index);
            }
        }
    }
    let lobes = parallel::map(count, |vertex| {
        let mut sightings = Vec::new();
        for &patch in &patches_of_vertex[vertex] {
            gather(samples, patch as usize, vertex as u32, component, &mut sightings);
        }
        let stride = sightings.len().div_ceil(MAX_SIGHTINGS).max(1);
        let some: Vec<SpecularSighting> = sightings.into_iter().step_by(stride).collect();
        torrance_sparrow::fit(&some)
    });
    let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); count];
    for v in &layout.mesh.triangles {
        for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
            neighbours[a as usize].push(b as usize);
            neighbours[b as usize].push(a as usize);
        }
    }
    torrance_sparrow::fill_from_neighbours(&lobes, |i| neighbours[i].iter().copied())
}

/// Sightings of a patch's samples that lie nearest to one of its corners.
fn gather(
    samples: &WaveletSamples,
    patch: usize,
    vertex: u32,
    component: usize,
    sightings: &mut Vec<SpecularSighting>,
) {
    let layout = &samples.layout;
    let side_log2 = layout.side_log2[patch];
    let (side, area) = (1usize << side_log2, 1usize << (2 * side_log2));
    let data = &samples.patches[patch];
    let corners = layout.patches[patch].corners;
    for i in 0..area {
        let Some(point) = layout.grid_point(patch, i % side, i / side) else { continue };
        let weight: f64 = corners.iter().zip(point.weights).filter(|(c, _)| **c == vertex).map(|(_, w)| w).sum();
        if point.weights.iter().any(|w| *w > weight) {
            continue;
        }
        let (position, normal) = layout.position_and_normal(patch, &point);
        for (view, captured) in samples.views.iter().enumerate() {
            let at = view * area + i;
            let (true, Some(light)) = (data.visible[at], &captured.light) else { continue };
            let geometry =
                crate::reflectance::ReflectionGeometry::new(position, normal, captured.camera.centre(), light);
            sightings.push(SpecularSighting { radiance: data.radiance[component][at], geometry });
        }
    }
}
