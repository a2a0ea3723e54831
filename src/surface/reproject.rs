//! Reprojection of the points of a view into other views.
//!
//! Predictions follow it, so it is bit-exact: IEEE `+ - * / sqrt` and comparisons in the order written (normative,
//! `spec/planes.md`).

use super::raster::Raster;
use super::view_geometry::ViewGeometry;
use crate::image::Mask;
use crate::transform::shape_adaptive::PixelRun;
use crate::transform::window::Window;
use crate::vector::{DoubleLanes, LANES, dot_lanes, lanes, towards};
use crate::views::{Camera, View};

/// A point is hidden in a reference when it lies behind the nearest surface there by this share of its depth.
const DEPTH_MARGIN: f64 = 0.004;
/// Least cosine between normal and light that a shading ratio takes into account.
const MIN_COSINE: f64 = 0.05;

/// Position of a target pixel in a reference view.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reprojection {
    /// Position in the reference in pixels (centres at +0.5).
    pub(super) position: [f32; 2],
    /// Share of this reference in a blend: the squared cosine between normal and reference, 0 where it is hidden.
    pub(super) weight: f32,
    /// Square root of the ratio of the two irradiances, target over reference.
    pub(super) shading: f32,
}

/// Depth of a decoded view, for the reprojection of those predicted from it.
#[derive(Debug, Clone)]
pub(crate) struct ReferenceView {
    view: View,
    /// The part of the picture beyond which no depth is known.
    window: Window,
    /// The farthest depth of the nine pixels around each of the window, and a margin.
    farthest: Vec<f64>,
}

impl ReferenceView {
    /// Takes the depth out of a view's geometry.
    pub(crate) fn new(geometry: ViewGeometry) -> Self {
        let Raster { width, height, depth, .. } = geometry.raster;
        // The farthest of the nine pixels around: along rows, then along columns.
        let farther = |a: f64, b: f64| if b > a { b } else { a };
        let mut along = depth.clone();
        for (along, row) in along.chunks_exact_mut(width.max(1)).zip(depth.chunks_exact(width.max(1))) {
            for (far, before) in along[1..].iter_mut().zip(row) {
                *far = farther(*far, *before);
            }
            for (far, next) in along.iter_mut().zip(&row[1..]) {
                *far = farther(*far, *next);
            }
        }
        let mut farthest = along.clone();
        for y in 0..height {
            let here = &mut farthest[y * width..][..width];
            for other in [y.checked_sub(1), (y + 1 < height).then_some(y + 1)].into_iter().flatten() {
                for (far, other) in here.iter_mut().zip(&along[other * width..][..width]) {
                    *far = farther(*far, *other);
                }
            }
            here.iter_mut().for_each(|far| *far *= 1.0 + DEPTH_MARGIN);
        }
        let window = Window::around_mask(&known_depths(&farthest, width, height), 0);
        ReferenceView { view: geometry.view, farthest: window.crop(&farthest, width), window }
    }

    /// Bytes of memory that it takes.
    pub(crate) fn bytes(&self) -> u64 {
        size_of_val(&self.farthest[..]) as u64
    }

    /// Whether a point that projects to `position` at `distance` is the surface that the view shows there: not behind the
    /// farthest of the nine pixels around, by more than a margin.
    #[inline(always)]
    fn shows(&self, position: [f64; 2], distance: f64) -> bool {
        if !(distance > 0.0 && position[0] >= 0.0 && position[1] >= 0.0) {
            return false;
        }
        let Window { left, top, width, height } = self.window;
        // Before the window's first pixel the differences are no smaller than any width.
        let (x, y) = ((position[0] as usize).wrapping_sub(left), (position[1] as usize).wrapping_sub(top));
        x < width && y < height && self.farthest.get(y * width + x).is_some_and(|&far| distance <= far)
    }
}

/// Pixels at which a depth is known.
fn known_depths(farthest: &[f64], width: usize, height: usize) -> Mask {
    Mask { width, height, data: farthest.iter().map(|&far| far > 0.0).collect() }
}

/// Irradiance of points by a light of unit intensity.
#[inline(always)]
fn irradiance(points: &[DoubleLanes; 3], normals: &[DoubleLanes; 3], light: [f64; 3]) -> DoubleLanes {
    let l = towards(points, light);
    let (square, along) = (dot_lanes(&l, &l), dot_lanes(normals, &l));
    lanes(|i| {
        let cosine = along[i] / square[i].sqrt();
        (if cosine > MIN_COSINE { cosine } else { MIN_COSINE }) / square[i]
    })
}

/// A reference and what is the same for all pixels: the light's place in it, and how much brighter the target's is.
struct ReprojectionTarget<'a> {
    seen: &'a ReferenceView,
    eye: [f64; 3],
    light: Option<([f64; 3], f64)>,
}

/// Finds every mask pixel of `target` (`rows` of a window, to which its geometry is extended) in each reference; pixels in
/// the rows' order.
pub(crate) fn reproject(
    target: &ViewGeometry,
    references: &[&ReferenceView],
    window: &Window,
    rows: &[PixelRun],
) -> Vec<Vec<Reprojection>> {
    let from = &target.view.camera;
    let (centre, r) = (from.centre(), &from.rotation);
    let to: Vec<ReprojectionTarget> = references
        .iter()
        .map(|&seen| {
            let light = target
                .view
                .light
                .zip(seen.view.light)
                .map(|(here, there)| (there.position, mean(here.intensity) / mean(there.intensity)));
            ReprojectionTarget { seen, eye: seen.view.camera.centre(), light }
        })
        .collect();
    let count = rows.iter().map(|run| run.length as usize).sum();
    let mut found: Vec<Vec<Reprojection>> = references.iter().map(|_| Vec::with_capacity(count)).collect();
    for run in rows {
        let y = window.top + run.line as usize;
        let q1 = (y as f64 + 0.5 - from.principal[1]) / from.focal[1];
        let end = window.left + (run.start + run.length) as usize;
        for first in (window.left + run.start as usize..end).step_by(LANES) {
            let used = LANES.min(end - first);
            // Lanes beyond the run repeat its last pixel.
            let column = |i: usize| first + i.min(used - 1);
            let at = |i: usize| y * target.raster.width + column(i);
            let depths = lanes(|i| target.raster.depth[at(i)]);
            let q0 = lanes(|i| (column(i) as f64 + 0.5 - from.principal[0]) / from.focal[0]);
            let points =
                [0, 1, 2].map(|k| lanes(|i| centre[k] + depths[i] * (r[0][k] * q0[i] + r[1][k] * q1 + r[2][k])));
            let normals = [0, 1, 2].map(|k| lanes(|i| target.normals[at(i)][k] as f64));
            let here = target.view.light.map(|light| irradiance(&points, &normals, light.position));
            for (to, found) in to.iter().zip(&mut found) {
                let sources = reproject_points(&points, &normals, here.as_ref(), to);
                found.extend((0..used).map(|i| if depths[i] != 0.0 { sources[i] } else { HIDDEN }));
            }
        }
    }
    found
}

const HIDDEN: Reprojection = Reprojection { position: [0.0; 2], weight: 0.0, shading: 1.0 };

/// Reprojects points into a reference; `here` is their irradiance under the target's light.
#[inline(always)]
fn reproject_points(
    points: &[DoubleLanes; 3],
    normals: &[DoubleLanes; 3],
    here: Option<&DoubleLanes>,
    to: &ReprojectionTarget,
) -> [Reprojection; LANES] {
    let Camera { rotation: r, translation: t, focal, principal, .. } = &to.seen.view.camera;
    let q =
        [0, 1, 2].map(|k| lanes(|i| r[k][0] * points[0][i] + r[k][1] * points[1][i] + r[k][2] * points[2][i] + t[k]));
    let x = lanes(|i| focal[0] * q[0][i] / q[2][i] + principal[0]);
    let y = lanes(|i| focal[1] * q[1][i] / q[2][i] + principal[1]);
    let v = towards(points, to.eye);
    let (square, along) = (dot_lanes(&v, &v), dot_lanes(normals, &v));
    let weights = lanes(|i| {
        let cosine = along[i] / square[i].sqrt();
        let cosine = if cosine > 0.05 { cosine } else { 0.05 };
        cosine * cosine
    });
    let shading = match (here, to.light) {
        (Some(here), Some((light, brightness))) => {
            let there = irradiance(points, normals, light);
            lanes(|i| {
                let root = (here[i] / there[i] * brightness).sqrt();
                let root = if root > 0.25 { root } else { 0.25 };
                if root < 4.0 { root } else { 4.0 }
            })
        }
        _ => [1.0; LANES],
    };
    std::array::from_fn(|i| {
        if !to.seen.shows([x[i], y[i]], q[2][i]) {
            return HIDDEN;
        }
        Reprojection { position: [x[i] as f32, y[i] as f32], weight: weights[i] as f32, shading: shading[i] as f32 }
    })
}

fn mean(v: [f64; 3]) -> f64 {
    (v[0] + v[1] + v[2]) / 3.0
}
