//! Reading photographs at the samples of the patches.

use super::layout::PatchLayout;
use crate::error::Result;
use crate::image::{Mask, RgbImage};
use crate::parallel;
use crate::surface::occluders::{Footprint, Occluders};
use crate::surface::patches::{area_normal, unit};
use crate::views::source::{PhotographSource, open_together};
use crate::views::{Photograph, View};

/// Radiance of one patch in the photographs.
#[derive(Debug, Clone, Default)]
pub struct PatchSamples {
    /// Per view and sample, view by view and row by row: whether the photograph shows it.
    pub visible: Vec<bool>,
    /// For each component the linear radiance, in the order of `visible`; zero where not visible.
    pub radiance: Vec<Vec<[f32; 3]>>,
}

/// Radiance of the whole surface in the photographs.
#[derive(Debug, Clone)]
pub struct WaveletSamples {
    /// The patches, their sides chosen.
    pub layout: PatchLayout,
    /// Captured views.
    pub views: Vec<View>,
    /// Parallel to the views: whether the mask of the photograph has a pixel.
    pub shown: Vec<bool>,
    /// Number of components.
    pub components: usize,
    /// Parallel to the patches.
    pub patches: Vec<PatchSamples>,
}

/// Least cosine between a triangle's normal and the view that counts as seen.
const MIN_COSINE: f64 = 0.05;

impl WaveletSamples {
    /// Chooses the patches' sides for `density` samples per photograph pixel (where a patch is seen largest), casts the
    /// rays and reads the photographs by cubic B-splines. They have their cameras' sizes.
    pub fn gather(
        mesh: &crate::mesh::Mesh,
        views: &[View],
        photographs: &dyn PhotographSource,
        density: f64,
    ) -> Result<WaveletSamples> {
        let mut layout = PatchLayout::new(mesh);
        choose_sides(&mut layout, views, density);
        let occluders = Occluders::new(mesh);
        let centres: Vec<[f64; 3]> = views.iter().map(|view| view.camera.centre()).collect();
        let mut patches = vec![PatchSamples::default(); layout.patches.len()];
        let (mut components, mut shown) = (0, Vec::with_capacity(views.len()));
        for run in open_together(views, photographs.at_once()) {
            let opened = parallel::map(run.len(), |k| -> Result<_> {
                let view = run.start + k;
                let photograph = photographs.photograph(view)?;
                let Photograph { mask, images } = &*photograph;
                let footprint = Footprint::new(&occluders, mesh, &views[view].camera, Some(mask), images);
                let splines: Vec<_> =
                    images.iter().map(|image| PhotographSpline::new(image, footprint.usable())).collect();
                Ok((footprint, splines, mask.data.contains(&true)))
            });
            let opened = opened.into_iter().collect::<Result<Vec<_>>>()?;
            shown.extend(opened.iter().map(|(_, _, shown)| *shown));
            components = opened.first().map_or(components, |(_, splines, _)| splines.len());
            parallel::for_each_chunk(&mut patches, 1, |index, patch| {
                let patch = &mut patch[0];
                let side = 1usize << layout.side_log2[index];
                let area = side * side;
                if run.start == 0 {
                    patch.visible = vec![false; views.len() * area];
                    patch.radiance = vec![vec![[0.0; 3]; views.len() * area]; components];
                }
                for i in 0..area {
                    let Some(point) = layout.grid_point(index, i % side, i / side) else { continue };
                    let (position, _) = layout.position_and_normal(index, &point);
                    let facing = unit(area_normal(mesh, mesh.triangles[point.triangle as usize]));
                    for (view, (footprint, splines, _)) in run.clone().zip(&opened) {
                        let (direction, _) = crate::vector::direction(position, centres[view]);
                        if crate::vector::dot(facing, direction) < MIN_COSINE {
                            continue;
                        }
                        let Some(at) = footprint.project(position) else { continue };
                        if !occluders.is_visible(position, centres[view]) {
                            continue;
                        }
                        patch.visible[view * area + i] = true;
                        for (component, spline) in splines.iter().enumerate() {
                            patch.radiance[component][view * area + i] = spline.radiance_at(at);
                        }
                    }
                }
            });
        }
        Ok(WaveletSamples { layout, views: views.to_vec(), shown, components, patches })
    }
    /// Coefficients of all components and colours: as many as there are samples, seen or not.
    pub fn coefficients(&self) -> usize {
        self.layout.samples_per_view() * self.views.len() * self.components * 3
    }
    /// Samples that a photograph shows (counted once for all components and colours).
    pub fn visible(&self) -> usize {
        self.patches.iter().map(|p| p.visible.iter().filter(|v| **v).count()).sum()
    }
}

/// Side of each patch: the least power of two that gives `density` samples per pixel, within a third, in the view that
/// shows it largest.
fn choose_sides(layout: &mut PatchLayout, views: &[View], density: f64) {
    let largest = parallel::map(layout.patches.len(), |index| {
        let patch = &layout.patches[index];
        let projected = |view: &View| {
            let area = |triangle: u32| -> f64 {
                let corners = layout.mesh.triangles[triangle as usize].map(|v| layout.positions[v as usize]);
                let [Some((a, _)), Some((b, _)), Some((c, _))] = corners.map(|p| view.camera.project(p)) else {
                    return 0.0;
                };
                // Seen from outside, corners run clockwise in an image whose rows go down.
                let twice = (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1]);
                (0.5 * twice).max(0.0)
            };
            area(patch.first) + patch.second.map_or(area(patch.first), area)
        };
        views.iter().map(projected).fold(0.0, f64::max)
    });
    for (log2, pixels) in layout.side_log2.iter_mut().zip(largest) {
        let wanted = density * pixels / 1.5;
        *log2 = (1..crate::surface::patches::MAX_SIDE_LOG2)
            .find(|l| (1u64 << (2 * l)) as f64 >= wanted)
            .unwrap_or(crate::surface::patches::MAX_SIDE_LOG2);
    }
}

/// A photograph as a cubic B-spline that passes through its pixels.
struct PhotographSpline {
    width: usize,
    height: usize,
    coefficients: Vec<[f32; 3]>,
}

impl PhotographSpline {
    /// Pixels that are not usable are extended from their neighbours first, so that the edge does not ring.
    fn new(image: &RgbImage, usable: &Mask) -> Self {
        let (width, height) = (image.width, image.height);
        let mut data = image.data.clone();
        extend(&mut data, usable, 5);
        let mut spline = PhotographSpline { width, height, coefficients: data };
        for y in 0..height {
            filter(&mut spline.coefficients, y * width, 1, width);
        }
        for x in 0..width {
            filter(&mut spline.coefficients, x, width, height);
        }
        spline
    }
    fn radiance_at(&self, at: [f64; 2]) -> [f32; 3] {
        let split = |x: f64| {
            let x = x - 0.5;
            let cell = x.floor();
            (cell as isize, basis((x - cell) as f32))
        };
        let ((x, wx), (y, wy)) = (split(at[0]), split(at[1]));
        let mut sum = [0.0f32; 3];
        for (j, wy) in wy.iter().enumerate() {
            let row = mirror(y + j as isize - 1, self.height) * self.width;
            for (i, wx) in wx.iter().enumerate() {
                let c = self.coefficients[row + mirror(x + i as isize - 1, self.width)];
                let weight = wx * wy;
                (0..3).for_each(|k| sum[k] += weight * c[k]);
            }
        }
        sum
    }
}

/// The four cubic B-splines that reach a point at `t` in `0..1` of its cell.
fn basis(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        s * s * s / 6.0,
        (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
        (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
        t * t * t / 6.0,
    ]
}

/// Index mirrored at the centres of the first and the last pixel.
fn mirror(index: isize, length: usize) -> usize {
    let last = length as isize - 1;
    if last == 0 {
        return 0;
    }
    let index = index.rem_euclid(2 * last);
    (if index > last { 2 * last - index } else { index }) as usize
}

/// Interpolating prefilter of the cubic B-spline along one line, mirrored ends (Unser 1999).
fn filter(data: &mut [[f32; 3]], start: usize, stride: usize, length: usize) {
    if length < 2 {
        return;
    }
    let pole = 3f32.sqrt() - 2.0;
    let at = |i: usize| start + i * stride;
    let mut sum = data[at(0)];
    let mut power = pole;
    for i in 1..length.min(24) {
        (0..3).for_each(|c| sum[c] += power * data[at(i)][c]);
        power *= pole;
    }
    data[at(0)] = sum;
    for i in 1..length {
        let before = data[at(i - 1)];
        (0..3).for_each(|c| data[at(i)][c] += pole * before[c]);
    }
    let (last, before) = (data[at(length - 1)], data[at(length - 2)]);
    data[at(length - 1)] = std::array::from_fn(|c| pole / (pole * pole - 1.0) * (pole * before[c] + last[c]));
    for i in (0..length - 1).rev() {
        let after = data[at(i + 1)];
        (0..3).for_each(|c| data[at(i)][c] = pole * (after[c] - data[at(i)][c]));
    }
    for i in 0..length {
        data[at(i)] = data[at(i)].map(|x| 6.0 * x);
    }
}

/// Fills pixels next to usable ones with their mean, ring by ring; the rest become zero.
fn extend(data: &mut [[f32; 3]], usable: &Mask, rings: usize) {
    let (width, height) = (usable.width, usable.height);
    let mut known = usable.data.clone();
    for _ in 0..rings {
        let mut found = Vec::new();
        for y in 0..height {
            for x in 0..width {
                if known[y * width + x] {
                    continue;
                }
                let (mut sum, mut count) = ([0.0f32; 3], 0.0);
                for ny in y.saturating_sub(1)..(y + 2).min(height) {
                    for nx in x.saturating_sub(1)..(x + 2).min(width) {
                        if known[ny * width + nx] {
                            (0..3).for_each(|c| sum[c] += data[ny * width + nx][c]);
                            count += 1.0;
                        }
                    }
                }
                if count > 0.0 {
                    found.push((y * width + x, sum.map(|s| s / count)));
                }
            }
        }
        for (i, value) in found {
            data[i] = value;
            known[i] = true;
        }
    }
    data.iter_mut().zip(&known).filter(|(_, known)| !**known).for_each(|(value, _)| *value = [0.0; 3]);
}

#[cfg(test)]
mod tests {
    use crate::wavelet_texture::samples::*;

    #[test]
    fn splines_pass_through_their_pixels() {
        let mut image = RgbImage::filled(17, 12, [0.0; 3]);
        for (i, p) in image.data.iter_mut().enumerate() {
            *p = [(i * 7 % 13) as f32, (i % 5) as f32, 1.0];
        }
        let spline = PhotographSpline::new(&image, &Mask::filled(17, 12, true));
        for (x, y) in [(0, 0), (16, 11), (5, 6), (16, 3), (1, 10)] {
            let read = spline.radiance_at([x as f64 + 0.5, y as f64 + 0.5]);
            let error = (0..3).map(|c| (read[c] - image.value_at(x, y)[c]).abs()).fold(0.0, f32::max);
            assert!(error < 1e-4, "{x} {y} {error}");
        }
    }
}
