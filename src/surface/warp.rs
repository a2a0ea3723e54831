//! Reading one view from another through the mesh.
//!
//! Decoded pictures are predicted with it, so it is bit-exact: IEEE `+ - * / sqrt` and comparisons in the order written
//! (normative, `spec/planes.md`).

use super::reproject::Reprojection;
use super::view_geometry::for_neighbours;
use crate::image::Mask;
use crate::transform::masked::{self, MaskedPixels, RowRuns};
use crate::transform::shape_adaptive::{ColourLanes, PixelRun};
use crate::transform::window::Window;
use glam::Vec4;
use std::ops::Range;

/// A decoded picture in the sqrt domain, filled beyond its mask so that interpolation may read anywhere.
#[derive(Debug, Clone)]
pub(crate) struct ReferenceImage {
    /// Size of the picture, of which the pixels are the part in the window.
    size: [usize; 2],
    window: Window,
    /// The mask.
    rows: RowRuns,
    pixels: Vec<ColourLanes>,
}

/// Rings of pixels that are filled beyond the mask of a reference.
pub(crate) const REFERENCE_RINGS: usize = 4;
/// Rings of pixels that are filled where no reference shows the target.
const HOLE_RINGS: usize = 64;

impl ReferenceImage {
    /// Fills a few rings beyond the mask with the mean of the neighbours inside, what lies beyond them with 0. The window leaves
    /// room for the rings wherever the picture does.
    pub(crate) fn new(picture: MaskedPixels, size: [usize; 2], window: Window) -> Self {
        let Window { width, height, .. } = window;
        let rows = picture.rows().clone();
        let mut pixels = picture.zero_outside();
        let mut known = vec![false; width * height];
        for run in rows.iter() {
            let at = run.line as usize * width + run.start as usize;
            known[at..at + run.length as usize].fill(true);
        }
        let mask = Mask { width, height, data: known };
        let mut wanted = border(&mask);
        let mut known = mask.data;
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
        ReferenceImage { size, window, rows, pixels }
    }

    /// Bytes of memory that it takes.
    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&self.pixels[..]) + size_of_val(&self.rows[..])) as u64
    }
    /// The mask's runs in a range of the window's lines with their pixels.
    pub(crate) fn runs(&self, lines: &Range<usize>) -> impl Iterator<Item = (&PixelRun, &[ColourLanes])> {
        masked::runs(masked::runs_within(&self.rows, lines), 0, self.window.width, &self.pixels)
    }

    /// Catmull-Rom interpolation of pictures of one size and window; `position` is clamped to them.
    #[inline(always)]
    fn read<const N: usize>(images: [&Self; N], position: [f32; 2]) -> [Vec4; N] {
        let [columns, rows] = images[0].size.map(|size| size as i64 - 1);
        let (x, y) = (position[0] - 0.5, position[1] - 0.5);
        let (left, top) = (floor(x), floor(y));
        let (wx, wy) = (catmull_rom(x - left as f32), catmull_rom(y - top as f32));
        let (left, top) = (left as i64 - 1, top as i64 - 1);
        let Window { left: x0, top: y0, width, height } = images[0].window;
        let (inner_left, inner_top) = (left - x0 as i64, top - y0 as i64);
        let mut sums = [Vec4::ZERO; N];
        let add = |sum: &mut Vec4, j: usize, taps: &[ColourLanes; 4]| {
            let mut line = Vec4::ZERO;
            for (wx, pixel) in wx.into_iter().zip(taps) {
                line += Vec4::splat(wx) * Vec4::from_array(*pixel);
            }
            *sum += Vec4::splat(wy[j]) * line;
        };
        if inner_left >= 0 && inner_top >= 0 && inner_left + 4 <= width as i64 && inner_top + 4 <= height as i64 {
            let start = inner_top as usize * width + inner_left as usize;
            for (sum, image) in sums.iter_mut().zip(images) {
                for j in 0..4 {
                    if let Some(taps) = image.pixels.get(start + j * width..).and_then(|row| row.first_chunk()) {
                        add(sum, j, taps);
                    }
                }
            }
        } else {
            for (sum, image) in sums.iter_mut().zip(images) {
                for j in 0..4 {
                    let y = (top + j as i64).clamp(0, rows) as usize;
                    let taps = std::array::from_fn(|i| {
                        let x = (left + i as i64).clamp(0, columns) as usize;
                        let inside = x >= x0 && y >= y0 && x - x0 < width && y - y0 < height;
                        if inside { image.pixels[(y - y0) * width + x - x0] } else { [0.0; 4] }
                    });
                    add(sum, j, &taps);
                }
            }
        }
        sums
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
fn fill_ring(
    pixels: &mut [ColourLanes],
    known: &mut [bool],
    wanted: &[usize],
    width: usize,
    height: usize,
) -> Vec<usize> {
    let ring: Vec<(usize, ColourLanes)> = wanted
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

/// Predicts the target's mask pixels (`rows` of a window of the given size) from up to two references, each with its sources
/// and its share: of several pictures alike, which a reference has of one size and window.
///
/// Holes are filled from their surroundings. `shaded` scales by the ratio of the irradiances (diffuse light follows the
/// lamp, highlights do not). The result covers the window, 0 outside the mask.
pub(crate) fn predict<const N: usize>(
    [width, height]: [usize; 2],
    rows: &[PixelRun],
    references: &[([&ReferenceImage; N], &[Reprojection], f32)],
    shaded: bool,
) -> [Vec<ColourLanes>; N] {
    let mut out = [(); N].map(|()| vec![[0.0f32; 4]; width * height]);
    let mut known = vec![false; width * height];
    let mut holes = Vec::new();
    let pixels = rows.iter().flat_map(|run| {
        let at = run.line as usize * width + run.start as usize;
        at..at + run.length as usize
    });
    for (index, at) in pixels.enumerate() {
        let (mut sums, mut total) = ([Vec4::ZERO; N], 0.0f32);
        for (images, sources, share) in references {
            let source = &sources[index];
            let weight = share * source.weight;
            if weight > 0.0 {
                let factor = if shaded { weight * source.shading } else { weight };
                let read = ReferenceImage::read(*images, source.position);
                sums.iter_mut().zip(read).for_each(|(sum, read)| *sum += Vec4::splat(factor) * read);
                total += weight;
            }
        }
        if total > 0.0 {
            out.iter_mut().zip(sums).for_each(|(out, sum)| out[at] = (sum / Vec4::splat(total)).to_array());
            known[at] = true;
        } else {
            holes.push(at);
        }
    }
    out.iter_mut().for_each(|out| fill_holes(out, &known, &holes, [width, height]));
    out
}

/// Gives holes the mean of their known neighbours, ring by ring.
pub(crate) fn fill_holes(pixels: &mut [ColourLanes], known: &[bool], holes: &[usize], [width, height]: [usize; 2]) {
    if holes.is_empty() {
        return;
    }
    let (mut known, mut holes) = (known.to_vec(), holes.to_vec());
    for _ in 0..HOLE_RINGS {
        if holes.is_empty() || fill_ring(pixels, &mut known, &holes, width, height).is_empty() {
            break;
        }
        holes.retain(|&at| !known[at]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::surface::reproject::{ReferenceView, reproject};
    use crate::surface::view_geometry::{ViewGeometry, ViewedMesh};
    use crate::views::View;
    use crate::views::{Camera, PointLight};
    use std::borrow::Cow;

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
        let surface = ViewedMesh::new(Cow::Borrowed(&mesh));
        let (here, there) = (ViewGeometry::new(&surface, view(0.5, 4.0)), ViewGeometry::new(&surface, view(0.0, 1.0)));
        let mask = here.raster.coverage();
        assert_eq!(mask.count(), 48 * 32);
        let window = Window { left: 0, top: 0, width: 48, height: 32 };
        let rows: Vec<PixelRun> = (0..32).map(|line| PixelRun { line, start: 0, length: 48 }).collect();
        let picture: Vec<ColourLanes> = (0..48 * 32).map(|i| [(i % 48) as f32, (i / 48) as f32, 1.0, 0.0]).collect();
        let reference = ReferenceImage::new(MaskedPixels::new(48, rows[..].into(), picture), [48, 32], window);
        let sources = &reproject(&here, &[&ReferenceView::new(there)], &window, &rows)[0];
        let [predicted] = predict([48, 32], &rows, &[([&reference], sources, 1.0)], true);
        // Parallax: 40 * 0.5 / 4 = 5 pixels; brightness: sqrt(4).
        let at = 16 * 48 + 20;
        for (value, expected) in predicted[at].iter().zip([2.0 * 25.0, 2.0 * 16.0, 2.0, 0.0]) {
            assert!((value - expected).abs() < 1e-4, "{:?}", predicted[at]);
        }
    }
}
