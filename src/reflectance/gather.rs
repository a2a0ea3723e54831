//! Gathers what the photographs show of each texel and fits the reflectance maps.

use super::lambert::LambertSums;
use super::lobes::equations::LobeEquations;
use super::lobes::share::{SharingScale, share_weights};
use super::lobes::{self, LOBES, LobeCosines, lobe_values};
use super::maps::ReflectanceMaps;
pub use super::sightings::ReflectanceSources;
use super::sightings::{Place, Sightings, TexelSighting};
use super::torrance_sparrow::{self, SpecularSighting, TorranceSparrowLobe};
use super::{ReflectionGeometry, lambert, palette};
use crate::error::Result;
use crate::image::Grid;
use crate::options::SpecularModel;
use crate::surface::atlas::{AtlasRaster, rasterise_atlas, smooth_normal};
use crate::surface::charts::Charts;
use crate::surface::charts::NONE;
use crate::surface::raster::vertex_normals;
use crate::views::Component;
use glam::DVec3;
use std::collections::BTreeMap;

/// Texels (each way) that share a highlight: smoother maps cost less and predict other views better:
/// held-out views of two captures gain 0.4 dB over separate texels.
const BLOCK: usize = 3;
/// Without polarisers: sightings whose half vector is nearer to the normal than this may hold highlight, radians.
const HIGHLIGHT: f32 = 0.5;

/// Distance over which weights of lobes are shared, over half the longest side of the object.
const SHARED: f64 = 0.02;
/// Sightings under less are left out of the fit of lobes: shadows and light from other parts of the object.
const MIN_COS_LIGHT: f32 = 0.05;
/// Places of a texel each way that lobes are fitted to.
const SUBDIVISION: u8 = 2;
/// The same in texels, at least.
const SHARED_TEXELS: f64 = 1.25;
/// Radiance over irradiance up to which all errors of lobes count alike; beyond it by their share.
const LOBE_FLOOR: f64 = 0.05;

/// Sightings of a block that its palette is fitted to, at most.
const MAX_SIGHTINGS: usize = 400;

/// Fits reflectance to every texel in use: Lambert per texel and Torrance-Sparrow per block of `BLOCK` x `BLOCK` texels of a chart,
/// interpolated between blocks, where all lights are known, else the weighted mean radiance. What no photograph shows takes its
/// neighbours' values. Texels not in use are 0.
/// # Errors
/// Those of opening the photographs, and of a temporary file.
pub fn fit_maps(sources: &ReflectanceSources, charts: &Charts, atlas: &AtlasRaster) -> Result<ReflectanceMaps> {
    let normals = vertex_normals(sources.mesh);
    let relightable = !sources.views.is_empty() && sources.views.iter().all(|v| v.light.is_some());
    let irradiance = sources.irradiance.filter(|irradiance| irradiance.len() == sources.mesh.positions.len());
    let floor = irradiance.map_or([0.0; 3], irradiance_floor);
    let (width, height) = (atlas.triangle.width, atlas.triangle.height);
    let used: Vec<usize> = (0..atlas.triangle.data.len()).filter(|&k| atlas.triangle.data[k] != NONE).collect();
    let block_of = |texel: usize| {
        let chart = charts.chart_of_triangle[atlas.triangle.data[texel] as usize];
        (chart, texel / width / BLOCK, texel % width / BLOCK)
    };
    let mut blocks: BTreeMap<(u32, usize, usize), Vec<usize>> = BTreeMap::new();
    for (k, &texel) in used.iter().enumerate() {
        blocks.entry(block_of(texel)).or_default().push(k);
    }
    let keys: Vec<(u32, usize, usize)> = blocks.keys().copied().collect();
    let members: Vec<Vec<usize>> = blocks.into_values().collect();
    let specular = relightable && sources.components.iter().any(|&c| c != Component::Diffuse);
    let with_lobes = specular && sources.specular == SpecularModel::GgxLobes;
    // Lobes tell apart what lies within a texel, so that is looked at more closely.
    let denser = charts.denser(SUBDIVISION);
    let closer = if with_lobes { rasterise_atlas(sources.mesh, &denser).ok() } else { None };
    let place = |(triangle, weights)| surface_place(sources, &normals, triangle, weights);
    let places = |texel: usize| -> Vec<Place> {
        let own = (atlas.triangle.data[texel] as usize, atlas.weights(texel));
        let Some(closer) = &closer else { return vec![place(own)] };
        let chart = charts.chart_of_triangle[own.0];
        let n = SUBDIVISION as usize;
        let within = (0..n * n).map(|k| (texel / width * n + k / n) * width * n + texel % width * n + k % n);
        let on_chart = |&at: &usize| {
            closer.triangle.data[at] != NONE && charts.chart_of_triangle[closer.triangle.data[at] as usize] == chart
        };
        let found: Vec<_> =
            within.filter(on_chart).map(|at| place((closer.triangle.data[at] as usize, closer.weights(at)))).collect();
        if found.is_empty() { vec![place(own)] } else { found }
    };
    let of_block = |k: usize| members[k].iter().flat_map(|&member| places(used[member])).collect::<Vec<Place>>();
    let seen = Sightings::gather(sources, members.len(), &of_block)?;
    let fitted = seen.map(members.len(), |k, mut seen_of_block| {
        let (mut sightings, mut equations) = (Vec::new(), Vec::new());
        let diffuse: Vec<Option<[f32; 3]>> = members[k]
            .iter()
            .map(|&member| {
                let mut seen = Vec::new();
                places(used[member]).into_iter().for_each(|place| seen_of_block.next(place, &mut seen));
                let first = sightings.len();
                let mut diffuse = fit_texel(&seen, sources, relightable, &mut sightings);
                if let (Some(irradiance), Some(colour)) = (irradiance, &mut diffuse) {
                    let texel = used[member];
                    let corners = sources.mesh.triangles[atlas.triangle.data[texel] as usize];
                    divide_by_irradiance(colour, irradiance, corners, atlas.weights(texel), floor);
                }
                if with_lobes {
                    equations.push(lobe_equations(&sightings[first..]));
                }
                diffuse
            })
            .collect();
        if with_lobes {
            return (diffuse, None, Vec::new(), equations);
        }
        let lobe = torrance_sparrow::fit(&sightings);
        if sources.specular != SpecularModel::Dsbrdf {
            sightings.clear();
        }
        let step = sightings.len().div_ceil(MAX_SIGHTINGS).max(1);
        (diffuse, lobe, sightings.into_iter().step_by(step).collect::<Vec<_>>(), equations)
    })?;

    let mut place = vec![NONE; width * height];
    used.iter().enumerate().for_each(|(k, &texel)| place[texel] = k as u32);
    let around = |k: usize| {
        let (x, y) = (used[k] % width, used[k] / width);
        let place = &place;
        STEPS.into_iter().filter_map(move |(dx, dy)| {
            let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
            let found = (x < width && y < height).then(|| place[y * width + x])?;
            (found != NONE).then_some(found as usize)
        })
    };
    // Colours are filled like lobes of equal width.
    let mut diffuse: Vec<Option<TorranceSparrowLobe>> = vec![None; used.len()];
    for (members, (colours, ..)) in members.iter().zip(&fitted) {
        for (&member, colour) in members.iter().zip(colours) {
            diffuse[member] = colour.map(|specular| TorranceSparrowLobe { specular, sigma: 1.0 });
        }
    }
    let diffuse = torrance_sparrow::fill_from_neighbours(&diffuse, around);
    let relightable = relightable || irradiance.is_some();
    let mut maps =
        ReflectanceMaps { relightable, diffuse: Grid::filled(width, height, [0f32; 3]), ..ReflectanceMaps::default() };
    used.iter().zip(&diffuse).for_each(|(&texel, lobe)| maps.diffuse.data[texel] = lobe.specular);
    if with_lobes {
        let mut equations = vec![LobeEquations::default(); used.len()];
        for (members, (.., own)) in members.iter().zip(&fitted) {
            members.iter().zip(own).for_each(|(&member, own)| equations[member] = *own);
        }
        let points: Vec<[f64; 3]> = used.iter().map(|&texel| atlas.position(sources.mesh, texel).to_array()).collect();
        let shared = (SHARED * sources.mesh.half_longest_side()).max(SHARED_TEXELS / charts.texels_per_unit);
        let scale = SharingScale { cell: shared, smoothing: shared };
        let weights = share_weights(&points, scale, |k| equations[k]);
        maps.lobes = vec![Grid::filled(width, height, [0f32; 3]); LOBES];
        for (&texel, weights) in used.iter().zip(&weights) {
            for (k, map) in maps.lobes.iter_mut().enumerate() {
                map.data[texel] = std::array::from_fn(|c| weights[c][k]);
            }
        }
        maps.set_single_lobes();
        return Ok(maps);
    }
    if specular {
        let (mut block_lobes, sightings): (Vec<Option<TorranceSparrowLobe>>, Vec<Vec<SpecularSighting>>) =
            fitted.into_iter().map(|(_, lobe, sightings, _)| (lobe, sightings)).unzip();
        if sources.specular == SpecularModel::Dsbrdf {
            maps.palette = palette::fit(&mut block_lobes, &sightings);
        }
        let number = |key: (u32, usize, usize)| keys.binary_search(&key).ok();
        let near = |k: usize| {
            let (chart, y, x) = keys[k];
            STEPS
                .into_iter()
                .filter_map(move |(dx, dy)| number((chart, y.checked_add_signed(dy)?, x.checked_add_signed(dx)?)))
        };
        let block_lobes = torrance_sparrow::fill_from_neighbours(&block_lobes, near);
        maps.specular = Grid::filled(width, height, [0f32; 3]);
        maps.sigma = Grid::filled(width, height, 0f32);
        for &texel in &used {
            let (chart, row, column) = block_of(texel);
            // Position in blocks from the centre of the texel's own.
            let from = |at: usize, own: usize| (at as f64 + 0.5) / BLOCK as f64 - own as f64 - 0.5;
            let (s, t) = (from(texel % width, column), from(texel / width, row));
            let neighbour = |own: usize, offset: f64| own.checked_add_signed(if offset < 0.0 { -1 } else { 1 });
            let mut sum = [0f64; 5];
            for (y, wy) in [(Some(row), 1.0 - t.abs()), (neighbour(row, t), t.abs())] {
                for (x, wx) in [(Some(column), 1.0 - s.abs()), (neighbour(column, s), s.abs())] {
                    let (Some(x), Some(y)) = (x, y) else { continue };
                    let Some(lobe) = number((chart, y, x)).map(|k| block_lobes[k]) else { continue };
                    (0..3).for_each(|c| sum[c] += wx * wy * lobe.specular[c] as f64);
                    sum[3] += wx * wy * (lobe.sigma as f64).ln();
                    sum[4] += wx * wy;
                }
            }
            maps.specular.data[texel] = std::array::from_fn(|c| (sum[c] / sum[4]) as f32);
            maps.sigma.data[texel] = (sum[3] / sum[4]).exp() as f32;
        }
    }
    Ok(maps)
}

/// The four neighbours of a texel or block.
const STEPS: [(isize, isize); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];

/// A place on a triangle of the mesh, on its surface.
fn surface_place(sources: &ReflectanceSources, normals: &[[f64; 3]], triangle: usize, weights: [f64; 3]) -> Place {
    match sources.surface {
        Some(surface) => surface.point(triangle, weights),
        None => {
            let corners = sources.mesh.triangles[triangle];
            let corner = |k: usize| DVec3::from_array(sources.mesh.positions[corners[k] as usize].map(f64::from));
            let point = (0..3).map(|k| weights[k] * corner(k)).sum::<DVec3>();
            (point.to_array(), smooth_normal(corners, weights, normals).to_array())
        }
    }
}

/// Diffuse colour of a texel from what was seen of it; adds what was seen of its highlight to `highlight`.
fn fit_texel(
    seen: &[TexelSighting],
    sources: &ReflectanceSources,
    relightable: bool,
    highlight: &mut Vec<SpecularSighting>,
) -> Option<[f32; 3]> {
    let layered = sources.specular == SpecularModel::GgxLobes;
    let of = |component: Component| sources.components.iter().position(|&c| c == component);
    if !relightable {
        let mut mean = LambertSums::default();
        let shown = of(Component::Diffuse).or(of(Component::Combined)).unwrap_or(0);
        seen.iter().for_each(|s| mean.add_unlit(s.radiance[shown], s.geometry.cos_view));
        return mean.solve();
    }
    let add = |sums: &mut LambertSums, radiance: [f32; 3], geometry: &ReflectionGeometry| match layered {
        true => sums.add_layer(radiance, geometry),
        false => sums.add(radiance, geometry),
    };
    if let Some(combined) = of(Component::Combined) {
        let sums = |beyond: f32| {
            let mut sums = LambertSums::default();
            for s in seen.iter().filter(|s| s.geometry.alpha > beyond) {
                add(&mut sums, s.radiance[combined], &s.geometry);
            }
            sums
        };
        // Away from highlights where the texel was seen there often enough.
        let away = sums(HIGHLIGHT);
        let diffuse = if away.weight() > 1.0 { away.solve() } else { sums(-1.0).solve() };
        highlight.extend(seen.iter().map(|s| {
            let factor = if layered { lobes::layer_factor(&s.geometry) } else { 1.0 };
            let matte = lambert::evaluate(diffuse.unwrap_or_default().map(|x| factor * x), &s.geometry);
            let radiance = std::array::from_fn(|c| s.radiance[combined][c] - matte[c]);
            SpecularSighting { radiance, geometry: s.geometry }
        }));
        return diffuse;
    }
    if let Some(index) = of(Component::Specular) {
        highlight.extend(seen.iter().map(|s| SpecularSighting { radiance: s.radiance[index], geometry: s.geometry }));
    }
    let mut sums = LambertSums::default();
    let index = of(Component::Diffuse)?;
    seen.iter().for_each(|s| add(&mut sums, s.radiance[index], &s.geometry));
    sums.solve()
}

/// Irradiance that a texel has at least where it is divided by: this share of the mean over the vertices.
const FLOOR: f32 = 0.04;

fn irradiance_floor(irradiance: &[[f32; 3]]) -> [f32; 3] {
    let count = irradiance.len().max(1) as f64;
    std::array::from_fn(|c| FLOOR * (irradiance.iter().map(|e| f64::from(e[c])).sum::<f64>() / count) as f32)
}

/// Makes `K_d` of mean radiance; no surface reflects more than it gets.
fn divide_by_irradiance(
    colour: &mut [f32; 3],
    irradiance: &[[f32; 3]],
    corners: [u32; 3],
    weights: [f64; 3],
    floor: [f32; 3],
) {
    for c in 0..3 {
        let here = (0..3).map(|k| weights[k] as f32 * irradiance[corners[k] as usize][c]).sum::<f32>();
        colour[c] = (colour[c] / here.max(floor[c]).max(f32::MIN_POSITIVE)).min(std::f32::consts::FRAC_1_PI);
    }
}

/// Normal equations of the lobes of one texel.
fn lobe_equations(sightings: &[SpecularSighting]) -> LobeEquations<3> {
    let mut equations = LobeEquations::default();
    for SpecularSighting { radiance, geometry } in sightings {
        if geometry.cos_light < MIN_COS_LIGHT || geometry.irradiance.iter().any(|&e| e <= 0.0) {
            continue;
        }
        let seen: [f64; 3] = std::array::from_fn(|c| radiance[c] as f64 / geometry.irradiance[c] as f64);
        let mean = (seen.iter().sum::<f64>() / 3.0).max(0.0);
        let weight = geometry.cos_view as f64 / (mean + LOBE_FLOOR);
        equations.add(&lobe_values(&LobeCosines::from(geometry)), seen, weight);
    }
    equations
}
