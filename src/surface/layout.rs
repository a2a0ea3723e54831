//! Makes charts: triangles grouped by the axis they face, borders smoothed, overlaps split, charts packed.

use super::charts::{Chart, Charts};
use super::charts::{NONE, along, area_normal, dominant, neighbours, visiting_order};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::views::Camera;
use std::collections::{HashMap, VecDeque};

/// A triangle lies in a chart only if the cosine between its normal and the chart's facing is at least this.
const STEEPEST: f64 = 0.3;
/// Price of a unit of chart border, in units of (area lost to tilt) / (square root of the mesh's area).
const BORDER_PRICE: f64 = 0.08;
/// Texels of an atlas, at most: 8192 each way. Work and memory follow them.
const MAX_TEXELS: f64 = (1u64 << 26) as f64;
/// Steps of packing charts, about, beyond which fewer widths of the atlas are tried.
const MANY_STEPS: i64 = 1 << 31;
/// Free texels between the packed charts and around them, beyond the texels that bilinear reading touches.
const GUTTER: i64 = 1;

/// Texels per unit of world length so that there are `density` texels (each way) for one pixel of the median view.
pub(crate) fn texels_per_unit(mesh: &Mesh, cameras: &[Camera], density: f64) -> f64 {
    let (middle, _) = mesh.bounding_sphere();
    let mut scales: Vec<f64> = cameras
        .iter()
        .filter_map(|camera| {
            let depth = camera.to_camera(middle)[2];
            (depth > 0.0).then(|| (camera.focal[0] * camera.focal[1]).abs().sqrt() / depth)
        })
        .collect();
    scales.sort_by(f64::total_cmp);
    let scale = scales.get(scales.len() / 2).copied().unwrap_or(1.0) * density;
    // Coded as f32: what the encoder uses is what the decoder sees.
    scale as f32 as f64
}

/// Bits of a mesh coordinate, 8 to 20, that move no vertex by more than an eighth of a pixel in the median view.
pub(crate) fn position_bits(mesh: &Mesh, cameras: &[Camera]) -> u8 {
    let (_, radius) = mesh.bounding_sphere();
    let steps = 8.0 * 2.0 * radius * texels_per_unit(mesh, cameras, 1.0);
    (steps.log2().ceil().clamp(8.0, 20.0)) as u8
}

/// Lays out the atlas of a mesh at `texels_per_unit` texels for a unit of length. Deterministic.
///
/// Every triangle lies within the atlas and is turned towards its chart's facing; no two parts of a chart overlap.
pub fn layout(mesh: &Mesh, texels_per_unit: f64) -> Result<Charts> {
    layout_within(mesh, texels_per_unit, MAX_TEXELS)
}

/// As [`layout`]; an error, before any work, where the surface has more than `max_texels`.
pub(crate) fn layout_within(mesh: &Mesh, texels_per_unit: f64, max_texels: f64) -> Result<Charts> {
    let texels_per_unit = texels_per_unit as f32 as f64;
    if !(texels_per_unit.is_finite() && texels_per_unit > 0.0) {
        return Err(Error::parameter("the texel density must be a positive number"));
    }
    if !mesh.positions.iter().all(crate::mesh::is_within_range) {
        return Err(Error::parameter("the mesh has a vertex that is not finite or beyond 1e12"));
    }
    check_work(mesh, texels_per_unit, max_texels.min(MAX_TEXELS))?;
    let neighbours = neighbours(mesh);
    let facings = smoothed_facings(mesh, &neighbours);
    let pieces = split(mesh, &neighbours, &facings, texels_per_unit);
    let order = visiting_order(&neighbours);
    let mut number: HashMap<u32, u32> = HashMap::new();
    let mut charts = Charts { texels_per_unit, chart_of_triangle: vec![NONE; facings.len()], ..Charts::default() };
    for &t in &order {
        let next = number.len() as u32;
        let chart = *number.entry(pieces[t as usize]).or_insert(next);
        if chart == next {
            charts.charts.push(Chart { facing: facings[t as usize], offset: [0, 0] });
        }
        charts.chart_of_triangle[t as usize] = chart;
    }
    pack(mesh, &mut charts)?;
    Ok(charts)
}

/// Whether the surface fits an atlas, before anything is laid out: by its area, and by the rows of texels that thin triangles cross.
fn check_work(mesh: &Mesh, texels_per_unit: f64, max_texels: f64) -> Result<()> {
    let texels = |t: usize| {
        let area = area_normal(mesh, t).iter().map(|x| x * x).sum::<f64>().sqrt() / 2.0;
        let corners = mesh.triangles[t].map(|v| mesh.positions[v as usize].map(f64::from));
        let side = |k: usize| {
            let along = corners.map(|corner| corner[k]);
            along.into_iter().fold(f64::MIN, f64::max) - along.into_iter().fold(f64::MAX, f64::min)
        };
        area * texels_per_unit * texels_per_unit + side(0).max(side(1)).max(side(2)) * texels_per_unit
    };
    let total: f64 = (0..mesh.triangles.len()).map(texels).sum();
    if total <= max_texels {
        return Ok(());
    }
    Err(Error::parameter(format!(
        "an atlas of the mesh would have {:.0} million texels, {:.1} at most: is the mesh in another unit than the cameras \
         (option `mesh_scale`), or its density too high?",
        total / 1e6,
        max_texels / 1e6
    )))
}

/// A facing for every triangle: least area lost to tilt plus least border.
fn smoothed_facings(mesh: &Mesh, neighbours: &[[u32; 3]]) -> Vec<u8> {
    let count = mesh.triangles.len();
    let normals: Vec<[f64; 3]> = (0..count).map(|t| area_normal(mesh, t)).collect();
    let area = |t: usize| normals[t].iter().map(|x| x * x).sum::<f64>().sqrt();
    let total: f64 = (0..count).map(area).sum();
    let price = BORDER_PRICE * total.sqrt();
    let edge_length = |t: usize, side: usize| {
        let corners = mesh.triangles[t];
        let (a, b) = (mesh.positions[corners[side] as usize], mesh.positions[corners[(side + 1) % 3] as usize]);
        (0..3).map(|k| (a[k] as f64 - b[k] as f64).powi(2)).sum::<f64>().sqrt()
    };
    let best: Vec<u8> = normals.iter().map(|&n| dominant(n)).collect();
    let allowed = |t: usize, f: u8| f == best[t] || area(t) == 0.0 || along(normals[t], f) >= STEEPEST * area(t);
    let tilt = |t: usize, f: u8| area(t) - along(normals[t], f);
    let mut facings = best.clone();
    for round in 0..24 {
        // The border's price rises, so that the first rounds do not freeze a noisy start.
        let price = price * ((round + 1) as f64 / 12.0).min(1.0);
        let mut changed = false;
        for t in 0..count {
            let cost = |f: u8, facings: &[u8]| {
                let border: f64 = (0..3)
                    .filter(|&side| neighbours[t][side] != NONE && facings[neighbours[t][side] as usize] != f)
                    .map(|side| edge_length(t, side))
                    .sum();
                tilt(t, f) + price * border
            };
            let mut chosen = facings[t];
            let mut least = cost(chosen, &facings);
            for f in 0..6 {
                if f != chosen && allowed(t, f) && cost(f, &facings) < least {
                    least = cost(f, &facings);
                    chosen = f;
                }
            }
            changed |= chosen != facings[t];
            facings[t] = chosen;
        }
        // Whole regions join a neighbouring facing where that is cheaper: triangle by triangle they can't.
        let regions = components(neighbours, &facings);
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); regions.iter().max().map_or(0, |&m| m as usize + 1)];
        for t in 0..count {
            members[regions[t] as usize].push(t);
        }
        let mut members: Vec<(f64, Vec<usize>)> =
            members.into_iter().map(|member| (member.iter().map(|&t| area(t)).sum(), member)).collect();
        members.sort_by(|(a, one), (b, other)| a.total_cmp(b).then(one[0].cmp(&other[0])));
        for (_, member) in members {
            let own = facings[member[0]];
            let mut border = [0.0; 6];
            for &t in &member {
                for side in 0..3 {
                    let n = neighbours[t][side];
                    if n != NONE && regions[n as usize] != regions[t] {
                        border[facings[n as usize] as usize] += edge_length(t, side);
                    }
                }
            }
            let mut gain = 0.0;
            let mut chosen = own;
            for f in 0..6u8 {
                if f != own && border[f as usize] > 0.0 && member.iter().all(|&t| allowed(t, f)) {
                    let lost: f64 = member.iter().map(|&t| tilt(t, f) - tilt(t, own)).sum();
                    let won = price * (border[f as usize] - border[own as usize]) - lost;
                    if won > gain {
                        (gain, chosen) = (won, f);
                    }
                }
            }
            if chosen != own {
                changed = true;
                member.iter().for_each(|&t| facings[t] = chosen);
            }
        }
        if !changed && round >= 12 {
            break;
        }
    }
    facings
}

/// Connected sets of triangles of one facing, numbered from 0.
fn components(neighbours: &[[u32; 3]], facings: &[u8]) -> Vec<u32> {
    let mut result = vec![NONE; facings.len()];
    let mut next = 0;
    for start in 0..facings.len() {
        if result[start] != NONE {
            continue;
        }
        let mut stack = vec![start];
        result[start] = next;
        while let Some(t) = stack.pop() {
            for &n in &neighbours[t] {
                if n != NONE && result[n as usize] == NONE && facings[n as usize] == facings[start] {
                    result[n as usize] = next;
                    stack.push(n as usize);
                }
            }
        }
        next += 1;
    }
    result
}

/// Splits the components where their projections overlap: a chart grows triangle by triangle and leaves out those that
/// would cover its texels a second time, or come next to texels of a quite different depth.
fn split(mesh: &Mesh, neighbours: &[[u32; 3]], facings: &[u8], texels_per_unit: f64) -> Vec<u32> {
    /// Depths (in texels) of neighbouring texels differ by less than this in one sheet: nearly two texels at the steepest slope.
    const SHEET: f64 = 8.0;
    let count = facings.len();
    let regions = components(neighbours, facings);
    let mut pieces = vec![NONE; count];
    let mut next = 0;
    let mut start = 0;
    while start < count {
        if pieces[start] != NONE {
            start += 1;
            continue;
        }
        let mut claimed: HashMap<[i64; 2], f64> = HashMap::new();
        let mut refused = vec![];
        let mut queue = VecDeque::from([start]);
        pieces[start] = next;
        while let Some(t) = queue.pop_front() {
            let texels = covered(mesh, t, facings[t], texels_per_unit);
            let conflict = texels.iter().any(|&([x, y], depth)| {
                (-1..=1).any(|dy| {
                    (-1..=1).any(|dx| {
                        let other = claimed.get(&[x + dx, y + dy]);
                        other.is_some_and(|&d| (dx == 0 && dy == 0) || (d - depth).abs() > SHEET)
                    })
                })
            });
            if conflict {
                refused.push(t);
                continue;
            }
            claimed.extend(texels);
            for &n in &neighbours[t] {
                let n = n as usize;
                if n != NONE as usize && pieces[n] == NONE && regions[n] == regions[t] {
                    pieces[n] = next;
                    queue.push_back(n);
                }
            }
        }
        // The refused ones start again, charts of their own or parts of another's.
        for t in refused {
            pieces[t] = NONE;
            start = start.min(t);
        }
        next += 1;
    }
    pieces
}

/// Texels (of a grid with the origin's projection at 0) whose centres lie in a triangle, with its depth there in texels.
fn covered(mesh: &Mesh, triangle: usize, facing: u8, texels_per_unit: f64) -> Vec<([i64; 2], f64)> {
    let single = Charts {
        texels_per_unit,
        charts: vec![Chart { facing, offset: [0, 0] }],
        chart_of_triangle: vec![0; 1],
        ..Charts::default()
    };
    let one = Mesh {
        positions: mesh.triangles[triangle].map(|v| mesh.positions[v as usize]).to_vec(),
        triangles: vec![[0, 1, 2]],
    };
    let corners = single.corners(&one, 0);
    let depths: Vec<f64> = one.positions.iter().map(|p| along(p.map(f64::from), facing) * texels_per_unit).collect();
    let bound = |k: usize, pick: fn(f64, f64) -> f64| corners.iter().map(|c| c[k]).reduce(pick).unwrap_or(0.0);
    let mut texels = Vec::new();
    for y in bound(1, f64::min).floor() as i64..=bound(1, f64::max).ceil() as i64 {
        for x in row_range(&corners, y as f64 + 0.5) {
            let centre = [x as f64 + 0.5, y as f64 + 0.5];
            // side[k] is opposite corner (k + 2) % 3.
            let side: [f64; 3] = std::array::from_fn(|k| {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                (b[0] - a[0]) * (centre[1] - a[1]) - (b[1] - a[1]) * (centre[0] - a[0])
            });
            // Half-open edges: a centre on an edge between two triangles belongs to one of them.
            let within = (0..3).all(|k| {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                side[k] > 0.0 || (side[k] == 0.0 && (a[1] > b[1] || (a[1] == b[1] && a[0] < b[0])))
            });
            let sum: f64 = side.iter().sum();
            if within && sum > 0.0 {
                let depth = (0..3).map(|k| side[k] * depths[(k + 2) % 3]).sum::<f64>() / sum;
                texels.push(([x, y], depth));
            }
        }
    }
    texels
}

/// Columns that a triangle may cover in a row of texels: where the row's middle crosses its edges, and one more on either side.
fn row_range(corners: &[[f64; 2]; 3], y: f64) -> std::ops::Range<i64> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        if a[1].min(b[1]) > y || a[1].max(b[1]) < y {
            continue;
        }
        let crossing = a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1]));
        // A level edge is crossed all along.
        let ends = if a[1] == b[1] { [a[0], b[0]] } else { [crossing; 2] };
        low = low.min(ends[0]).min(ends[1]);
        high = high.max(ends[0]).max(ends[1]);
    }
    if low > high { 0..0 } else { low.floor() as i64 - 1..high.ceil() as i64 + 2 }
}

/// Packs the charts' rectangles, highest first, on a skyline; tries a few widths and keeps the smallest atlas.
fn pack(mesh: &Mesh, charts: &mut Charts) -> Result<()> {
    let mut bounds = vec![[f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY]; charts.charts.len()];
    for t in 0..mesh.triangles.len() {
        let bound = &mut bounds[charts.chart_of_triangle[t] as usize];
        for corner in charts.corners(mesh, t) {
            *bound =
                [bound[0].min(corner[0]), bound[1].min(corner[1]), bound[2].max(corner[0]), bound[3].max(corner[1])];
        }
    }
    // Bilinear reading touches texels up to one from the position.
    let rectangles: Vec<[i64; 4]> = bounds
        .iter()
        .map(|b| {
            let (x, y) = (b[0].floor() as i64 - 1, b[1].floor() as i64 - 1);
            [x, y, b[2].ceil() as i64 + 1 - x + GUTTER, b[3].ceil() as i64 + 1 - y + GUTTER]
        })
        .collect();
    let mut order: Vec<usize> = (0..rectangles.len()).collect();
    order.sort_by_key(|&k| (-rectangles[k][3], -rectangles[k][2], k));
    let area: i64 = rectangles.iter().map(|r| r[2].saturating_mul(r[3])).fold(0, i64::saturating_add);
    let widest = rectangles.iter().map(|r| r[2]).max().unwrap_or(1);
    if widest.max(area_width(area)) > 60_000 {
        return Err(Error::parameter("the atlas would be over 60000 texels wide; lower its density"));
    }
    let mut best: Option<(i64, i64, Vec<[i64; 2]>)> = None;
    let steps = area_width(area).saturating_mul(rectangles.len() as i64).max(1);
    for step in 0..(MANY_STEPS / steps).clamp(1, 12) {
        let width = widest.max(((area as f64).sqrt() * (0.9 + 0.05 * step as f64)) as i64) + GUTTER;
        let (height, places) = skyline(&rectangles, &order, width);
        if best.as_ref().is_none_or(|b| width * height < b.0 * b.1) {
            best = Some((width, height, places));
        }
    }
    let (width, height, places) = best.unwrap_or((1, 1, Vec::new()));
    (charts.width, charts.height) = (width.max(1) as u32, height.max(1) as u32);
    for (chart, (place, rectangle)) in charts.charts.iter_mut().zip(places.iter().zip(&rectangles)) {
        chart.offset = [(place[0] - rectangle[0]) as i32, (place[1] - rectangle[1]) as i32];
    }
    Ok(())
}

/// Width of a square of this area.
fn area_width(area: i64) -> i64 {
    (area as f64).sqrt() as i64
}

/// Bottom-left packing; returns the height used and each rectangle's place.
fn skyline(rectangles: &[[i64; 4]], order: &[usize], width: i64) -> (i64, Vec<[i64; 2]>) {
    let mut tops = vec![GUTTER; width as usize];
    let mut places = vec![[0, 0]; rectangles.len()];
    let mut height = GUTTER;
    for &k in order {
        let (w, h) = (rectangles[k][2] as usize, rectangles[k][3]);
        let mut best = (i64::MAX, 0);
        // Columns of the window whose tops are higher than all to their right in it: the first is the highest.
        let mut highest: VecDeque<usize> = VecDeque::new();
        let mut next = GUTTER as usize;
        for x in GUTTER as usize..=(width as usize).saturating_sub(w).max(GUTTER as usize) {
            for column in next..(x + w).min(width as usize) {
                while highest.back().is_some_and(|&k| tops[k] <= tops[column]) {
                    highest.pop_back();
                }
                highest.push_back(column);
            }
            next = next.max((x + w).min(width as usize));
            while highest.front().is_some_and(|&k| k < x) {
                highest.pop_front();
            }
            let top = highest.front().map_or(GUTTER, |&k| tops[k]);
            if top < best.0 {
                best = (top, x);
            }
        }
        let (y, x) = best;
        places[k] = [x as i64, y];
        let end = (x + w).min(width as usize);
        tops[x..end].fill(y + h);
        height = height.max(y + h);
    }
    (height, places)
}
