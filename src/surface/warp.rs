//! Reading one view from another through the mesh.
//!
//! Decoded pictures are predicted with it, so it is bit-exact: IEEE `+ - * / sqrt` and comparisons in the order written
//! (normative, `spec/planes.md`).

use super::raster::{self, Raster};
use crate::asset::{Mesh, View};
use crate::image::Mask;
use crate::transform::shape_adaptive::Pixel;
use crate::vector::dot;
use glam::Vec4;
use std::borrow::Cow;

/// A mesh with what every view needs of it.
#[derive(Debug)]
pub struct Surface<'a> {
    mesh: Cow<'a, Mesh>,
    normals: Vec<[f64; 3]>,
}

impl<'a> Surface<'a> {
    /// Prepares a mesh.
    pub fn new(mesh: Cow<'a, Mesh>) -> Self {
        Surface { normals: raster::vertex_normals(&mesh), mesh }
    }
    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }
}

/// What a view sees of the surface.
#[derive(Debug, Clone)]
pub struct Geometry {
    /// The view.
    pub view: View,
    /// Nearest triangle, depth and barycentrics of each pixel.
    pub raster: Raster,
    /// Unit normal of each pixel, interpolated between the vertices; zero where the mesh is missed.
    normals: Vec<[f32; 3]>,
}

/// Pixels of the mask beside the mesh take the depth of their neighbours, this many rings far.
const DEPTH_RINGS: usize = 8;
/// A point is hidden in a reference when it lies behind the nearest surface there by this share of its depth.
const DEPTH_MARGIN: f64 = 0.004;
/// Least cosine between normal and light that a shading ratio takes into account.
const LEAST_COSINE: f64 = 0.05;

impl Geometry {
    /// Draws the surface into a view.
    pub fn new(surface: &Surface, view: &View) -> Self {
        let raster = raster::rasterise(&surface.mesh, &view.camera);
        let normals = (raster.triangle.iter().zip(&raster.barycentric))
            .map(|(&triangle, b)| {
                if triangle == raster::NO_TRIANGLE {
                    return [0.0; 3];
                }
                let corners = surface.mesh.triangles[triangle as usize].map(|v| surface.normals[v as usize]);
                let (b1, b2) = (b[0] as f64, b[1] as f64);
                let b0 = 1.0 - b1 - b2;
                let n: [f64; 3] = std::array::from_fn(|k| b0 * corners[0][k] + b1 * corners[1][k] + b2 * corners[2][k]);
                let length = dot(n, n).sqrt();
                if length > 0.0 { n.map(|v| (v / length) as f32) } else { [0.0; 3] }
            })
            .collect();
        Geometry { view: view.clone(), raster, normals }
    }

    /// Frees what only a view that is being decoded needs: a reference is asked for its depths alone.
    pub fn keep_as_reference(&mut self) {
        (self.normals, self.raster.triangle, self.raster.barycentric) = Default::default();
    }

    /// Gives the mask's pixels that miss the mesh the mean depth and normal of their neighbours, ring by ring.
    pub fn extend(&mut self, mask: &Mask) {
        let (width, height) = (self.raster.width, self.raster.height);
        let mut missing: Vec<usize> =
            (0..width * height).filter(|&i| mask.data[i] && self.raster.depth[i] == 0.0).collect();
        for _ in 0..DEPTH_RINGS {
            let mut ring = Vec::new();
            missing.retain(|&at| {
                let (mut depth, mut normal, mut count) = (0.0, [0.0f32; 3], 0.0f32);
                for_neighbours(at, width, height, |other| {
                    if self.raster.depth[other] > 0.0 {
                        depth += self.raster.depth[other];
                        for k in 0..3 {
                            normal[k] += self.normals[other][k];
                        }
                        count += 1.0;
                    }
                });
                if count > 0.0 {
                    ring.push((at, depth / count as f64, normal.map(|v| v / count)));
                }
                count == 0.0
            });
            if ring.is_empty() {
                break;
            }
            for (at, depth, normal) in ring {
                self.raster.depth[at] = depth;
                self.normals[at] = normal;
            }
        }
    }
}

/// Calls `visit` for the up to eight neighbours of a pixel, row by row.
#[inline(always)]
fn for_neighbours(at: usize, width: usize, height: usize, mut visit: impl FnMut(usize)) {
    let (x, y) = (at % width, at / width);
    for ny in y.saturating_sub(1)..(y + 2).min(height) {
        for nx in x.saturating_sub(1)..(x + 2).min(width) {
            if (nx, ny) != (x, y) {
                visit(ny * width + nx);
            }
        }
    }
}

/// Where a target pixel is found in a reference view.
#[derive(Debug, Clone, Copy)]
pub struct Source {
    /// Position in the reference in pixels (centres at +0.5).
    position: [f32; 2],
    /// Share of this reference in a blend: the squared cosine between normal and reference, 0 where it is hidden.
    weight: f32,
    /// Square root of the ratio of the two irradiances, target over reference.
    shading: f32,
}

/// Finds every mask pixel of `target` (its geometry extended to the mask) in each reference; each parallel to `pixels`.
pub fn find(target: &Geometry, references: &[&Geometry], pixels: &[u32]) -> Vec<Vec<Source>> {
    let from = &target.view.camera;
    let centre = from.centre();
    let to: Vec<(&Geometry, [f64; 3], Option<Lights>)> = references
        .iter()
        .map(|&reference| {
            let lights = target.view.light.zip(reference.view.light).map(|(here, there)| Lights {
                there: there.position,
                brightness: mean(here.intensity) / mean(there.intensity),
            });
            (reference, reference.view.camera.centre(), lights)
        })
        .collect();
    let mut found: Vec<Vec<Source>> = references.iter().map(|_| Vec::with_capacity(pixels.len())).collect();
    for &at in pixels {
        let at = at as usize;
        let depth = target.raster.depth[at];
        let (x, y) = (at % target.raster.width, at / target.raster.width);
        let ray = from.ray([x as f64 + 0.5, y as f64 + 0.5]);
        let point: [f64; 3] = std::array::from_fn(|k| centre[k] + depth * ray[k]);
        let normal = target.normals[at].map(f64::from);
        let here = target.view.light.map(|light| irradiance(point, normal, light.position));
        for ((reference, eye, lights), found) in to.iter().zip(&mut found) {
            let source = (depth != 0.0).then(|| find_point(point, normal, here, reference, *eye, lights.as_ref()));
            found.push(source.flatten().unwrap_or(NOWHERE));
        }
    }
    found
}

/// The light of a reference: its place, and how much brighter the target's is.
struct Lights {
    there: [f64; 3],
    brightness: f64,
}

const NOWHERE: Source = Source { position: [0.0; 2], weight: 0.0, shading: 1.0 };

/// Where a reference shows a point; `here` is the irradiance that the target's light gives it.
#[inline(always)]
fn find_point(
    point: [f64; 3],
    normal: [f64; 3],
    here: Option<f64>,
    reference: &Geometry,
    eye: [f64; 3],
    lights: Option<&Lights>,
) -> Option<Source> {
    let (position, distance) = reference.view.camera.project(point)?;
    if !is_visible(&reference.raster, position, distance) {
        return None;
    }
    let towards: [f64; 3] = std::array::from_fn(|k| eye[k] - point[k]);
    let cosine = dot(normal, towards) / dot(towards, towards).sqrt();
    let cosine = if cosine > 0.05 { cosine } else { 0.05 };
    let shading = match (here, lights) {
        (Some(here), Some(lights)) => {
            let ratio = here / irradiance(point, normal, lights.there);
            (ratio * lights.brightness).sqrt().clamp(0.25, 4.0) as f32
        }
        _ => 1.0,
    };
    Some(Source { position: position.map(|p| p as f32), weight: (cosine * cosine) as f32, shading })
}

/// Irradiance of a point by a light of unit intensity.
#[inline(always)]
fn irradiance(point: [f64; 3], normal: [f64; 3], light: [f64; 3]) -> f64 {
    let l: [f64; 3] = std::array::from_fn(|k| light[k] - point[k]);
    let square = dot(l, l);
    let cosine = dot(normal, l) / square.sqrt();
    (if cosine > LEAST_COSINE { cosine } else { LEAST_COSINE }) / square
}

fn mean(v: [f64; 3]) -> f64 {
    (v[0] + v[1] + v[2]) / 3.0
}

/// Whether a point that projects to `position` at `distance` is the surface that the view shows there: not behind the
/// farthest of the nine pixels around, by more than a margin.
fn is_visible(raster: &Raster, position: [f64; 2], distance: f64) -> bool {
    if !(position[0] >= 0.0 && position[1] >= 0.0) {
        return false;
    }
    let (x, y) = (position[0] as usize, position[1] as usize);
    if x >= raster.width || y >= raster.height {
        return false;
    }
    let mut farthest = 0.0;
    let columns = x.saturating_sub(1)..(x + 2).min(raster.width);
    for ny in y.saturating_sub(1)..(y + 2).min(raster.height) {
        for &depth in &raster.depth[ny * raster.width..][columns.clone()] {
            if depth > farthest {
                farthest = depth;
            }
        }
    }
    distance <= farthest * (1.0 + DEPTH_MARGIN)
}

/// A decoded picture in the sqrt domain, filled beyond its mask so that interpolation may read there.
#[derive(Debug, Clone)]
pub struct Reference {
    width: usize,
    height: usize,
    pixels: Vec<Pixel>,
}

/// Rings of pixels that are filled beyond the mask of a reference.
const REFERENCE_RINGS: usize = 4;
/// Rings of pixels that are filled where no reference shows the target.
const HOLE_RINGS: usize = 64;

impl Reference {
    /// Fills a few rings beyond the mask with the mean of the neighbours inside.
    pub fn new(mut pixels: Vec<Pixel>, mask: &Mask) -> Self {
        let (width, height) = (mask.width, mask.height);
        let mut known = mask.data.clone();
        let mut wanted = border(mask);
        for ring in 1..=REFERENCE_RINGS {
            let front = fill_ring(&mut pixels, &mut known, &wanted, width, height);
            if ring == REFERENCE_RINGS {
                break;
            }
            wanted.clear();
            for &at in &front {
                for_neighbours(at, width, height, |other| {
                    if !known[other] {
                        wanted.push(other);
                    }
                });
            }
            wanted.sort_unstable();
            wanted.dedup();
        }
        Reference { width, height, pixels }
    }

    /// The picture; beyond its mask a few rings of filled pixels.
    pub fn pixels(&self) -> &[Pixel] {
        &self.pixels
    }

    /// Catmull-Rom interpolation; `position` is clamped to the picture.
    #[inline(always)]
    fn read(&self, position: [f32; 2]) -> Vec4 {
        let (x, y) = (position[0] - 0.5, position[1] - 0.5);
        let (left, top) = (floor(x), floor(y));
        let (wx, wy) = (catmull_rom(x - left as f32), catmull_rom(y - top as f32));
        let (left, top) = (left as i64 - 1, top as i64 - 1);
        let (width, height) = (self.width as i64, self.height as i64);
        let mut sum = Vec4::ZERO;
        let mut add = |j: usize, taps: &[Pixel; 4]| {
            let mut line = Vec4::ZERO;
            for (wx, pixel) in wx.into_iter().zip(taps) {
                line += Vec4::splat(wx) * Vec4::from_array(*pixel);
            }
            sum += Vec4::splat(wy[j]) * line;
        };
        if left >= 0 && top >= 0 && left + 4 <= width && top + 4 <= height {
            for j in 0..4 {
                let start = (top as usize + j) * self.width + left as usize;
                if let Some(taps) = self.pixels.get(start..).and_then(|row| row.first_chunk()) {
                    add(j, taps);
                }
            }
        } else {
            for j in 0..4 {
                let row = (top + j as i64).clamp(0, height - 1) * width;
                let taps = std::array::from_fn(|i| self.pixels[(row + (left + i as i64).clamp(0, width - 1)) as usize]);
                add(j, &taps);
            }
        }
        sum
    }
}

/// The largest integer not above a number whose magnitude is below 2^31.
#[inline(always)]
fn floor(value: f32) -> i32 {
    let towards_zero = value as i32;
    towards_zero - (towards_zero as f32 > value) as i32
}

/// Pixels beside a mask, ascending.
fn border(mask: &Mask) -> Vec<usize> {
    let width = mask.width;
    // Where a row or one of those beside it is set.
    let tall = |y: usize| -> Vec<bool> {
        let [above, here, below] = [y.saturating_sub(1), y, (y + 1).min(mask.height - 1)].map(|y| mask.row(y));
        above.iter().zip(here).zip(below).map(|((a, b), c)| a | b | c).collect()
    };
    let mut border = Vec::new();
    for y in 0..mask.height {
        let (tall, here) = (tall(y), mask.row(y));
        if !tall.contains(&true) {
            continue;
        }
        let beside = |x: usize| tall[x] || (x > 0 && tall[x - 1]) || (x + 1 < width && tall[x + 1]);
        border.extend((0..width).filter(|&x| !here[x] && beside(x)).map(|x| y * width + x));
    }
    border
}

/// Sets each wanted pixel to the mean of its known neighbours; returns those that had one.
fn fill_ring(pixels: &mut [Pixel], known: &mut [bool], wanted: &[usize], width: usize, height: usize) -> Vec<usize> {
    let ring: Vec<(usize, Pixel)> = wanted
        .iter()
        .filter_map(|&at| {
            let (mut sum, mut count) = ([0.0f32; 4], 0.0f32);
            for_neighbours(at, width, height, |other| {
                if known[other] {
                    for k in 0..4 {
                        sum[k] += pixels[other][k];
                    }
                    count += 1.0;
                }
            });
            (count > 0.0).then(|| (at, sum.map(|v| v / count)))
        })
        .collect();
    for (at, value) in &ring {
        pixels[*at] = *value;
        known[*at] = true;
    }
    ring.into_iter().map(|(at, _)| at).collect()
}

#[inline(always)]
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, 0.5 * t3 - 0.5 * t2]
}

/// Predicts the target's mask pixels from up to two references, each with its sources and its share.
///
/// Holes are filled from their surroundings. `shaded` scales by the ratio of the irradiances (diffuse light follows the
/// lamp, highlights do not). The result covers the whole picture, 0 outside the mask.
pub fn predict(mask: &Mask, pixels: &[u32], references: &[(&Reference, &[Source], f32)], shaded: bool) -> Vec<Pixel> {
    let (width, height) = (mask.width, mask.height);
    let mut out = vec![[0.0f32; 4]; width * height];
    let mut known = vec![false; width * height];
    let mut holes = Vec::new();
    for (index, &at) in pixels.iter().enumerate() {
        let (mut sum, mut total) = (Vec4::ZERO, 0.0f32);
        for (reference, sources, share) in references {
            let source = &sources[index];
            let weight = share * source.weight;
            if weight > 0.0 {
                let factor = if shaded { weight * source.shading } else { weight };
                sum += Vec4::splat(factor) * reference.read(source.position);
                total += weight;
            }
        }
        if total > 0.0 {
            out[at as usize] = (sum / Vec4::splat(total)).to_array();
            known[at as usize] = true;
        } else {
            holes.push(at as usize);
        }
    }
    for _ in 0..HOLE_RINGS {
        if holes.is_empty() || fill_ring(&mut out, &mut known, &holes, width, height).is_empty() {
            break;
        }
        holes.retain(|&at| !known[at]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::{Camera, PointLight};

    /// A plane seen by two cameras side by side: a picture of it warps onto the other to the shift of its parallax.
    #[test]
    fn a_plane_warps_by_its_parallax_and_shading_follows_the_light() {
        let mesh = Mesh {
            positions: vec![[-9.0, -9.0, 4.0], [9.0, -9.0, 4.0], [9.0, 9.0, 4.0], [-9.0, 9.0, 4.0]],
            triangles: vec![[0, 2, 1], [0, 3, 2]],
        };
        let view = |x: f64, intensity: f64| View {
            name: String::new(),
            camera: Camera {
                width: 48,
                height: 32,
                focal: [40.0, 40.0],
                principal: [24.0, 16.0],
                rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                translation: [-x, 0.0, 0.0],
            },
            light: Some(PointLight { position: [0.0, 0.0, 0.0], intensity: [intensity; 3] }),
        };
        let surface = Surface::new(Cow::Borrowed(&mesh));
        let (here, there) = (Geometry::new(&surface, &view(0.5, 4.0)), Geometry::new(&surface, &view(0.0, 1.0)));
        let mask = here.raster.coverage();
        assert_eq!(mask.count(), 48 * 32);
        let pixels: Vec<u32> = (0..48 * 32).collect();
        let picture: Vec<Pixel> = (0..48 * 32).map(|i| [(i % 48) as f32, (i / 48) as f32, 1.0, 0.0]).collect();
        let reference = Reference::new(picture, &mask);
        let sources = &find(&here, &[&there], &pixels)[0];
        let predicted = predict(&mask, &pixels, &[(&reference, sources, 1.0)], true);
        // Parallax: 40 * 0.5 / 4 = 5 pixels; brightness: sqrt(4).
        let at = 16 * 48 + 20;
        for (value, expected) in predicted[at].iter().zip([2.0 * 25.0, 2.0 * 16.0, 2.0, 0.0]) {
            assert!((value - expected).abs() < 1e-4, "{:?}", predicted[at]);
        }
    }
}
