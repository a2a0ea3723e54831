//! Photo-consistency: whether neighbouring photographs show the same on the surface that both see.
//!
//! Compared is local contrast: logarithms of the radiance, without their mean around each pixel and over their deviation there. So brightness and
//! slow changes of light drop out. The measure is the correlation of the contrasts on the surface that two neighbouring views see; it means something
//! beside that of other photographs in their places.

use super::contrast::{Contrast, RADIUS};
use crate::mesh::Mesh;
use crate::parallel;
use crate::surface::raster::{Raster, check_work, rasterise};
use crate::views::Camera;
use glam::DVec3;

/// Points of the surface compared in a pair of views, at most and at least.
const MAX_POINTS: usize = 300;
const MIN_POINTS: usize = 60;
/// Neighbours that each view is compared with.
const NEIGHBOURS: usize = 2;
/// Angles between neighbours as seen from the mesh, in degrees. Nearer ones show the same whatever the mesh.
const NEIGHBOUR_DEG: (f64, f64) = (1.5, 65.0);
/// Share of the mesh's size by which a point may lie behind the surface that a view sees.
const DEPTH_TOLERANCE: f64 = 0.01;

/// Photo-consistency of one pair of neighbouring views.
pub(super) struct PairConsistency {
    /// Indices of the views.
    pub(super) views: [usize; 2],
    /// Correlation of each photograph in the first view's place with each in the second's, by rows; NaN where a photograph is of another
    /// size than the view's.
    table: Vec<f32>,
    photographs: usize,
}

impl PairConsistency {
    /// The correlation with these photographs in the views' places.
    pub(super) fn of(&self, first: usize, second: usize) -> f64 {
        f64::from(self.table[first * self.photographs + second])
    }
    /// The correlation of the views' own photographs.
    pub(super) fn given(&self) -> f64 {
        self.of(self.views[0], self.views[1])
    }
    /// The mean correlation of two photographs that are not both the views' own.
    pub(super) fn permuted(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0u32);
        for (first, row) in self.table.chunks(self.photographs).enumerate() {
            for (second, &value) in row.iter().enumerate() {
                if first != second && [first, second] != self.views && value.is_finite() {
                    sum += f64::from(value);
                    count += 1;
                }
            }
        }
        if count == 0 { 0.0 } else { sum / f64::from(count) }
    }
}

/// Compares neighbouring views, each with its own photograph and with all others in its place.
pub(super) fn compare(mesh: &Mesh, cameras: &[Camera], contrasts: &[&Contrast]) -> Vec<PairConsistency> {
    let (pairs, _) = neighbours(mesh, cameras);
    parallel::map(pairs.len(), |k| {
        let table = correlations(&pairs[k], cameras, contrasts);
        PairConsistency { views: pairs[k].views, table, photographs: contrasts.len() }
    })
}

/// Mean consistency of neighbouring views with their own photographs, 0 for those that see nothing in common; `None` without neighbours.
pub(super) fn mean_given(mesh: &Mesh, cameras: &[Camera], contrasts: &[&Contrast]) -> Option<f64> {
    let (pairs, wanted) = neighbours(mesh, cameras);
    let values = parallel::map(pairs.len(), |k| {
        let Pair { views, points } = &pairs[k];
        let [a, b] = [0, 1].map(|side| gather(contrasts[views[side]], points.iter().map(|p| p[side])));
        f64::from(dot(&a, &b))
    });
    (wanted > 0).then(|| values.iter().sum::<f64>() / wanted as f64)
}

/// Points of the surface that two views see: positions in both pictures.
struct Pair {
    views: [usize; 2],
    points: Vec<[[f32; 2]; 2]>,
}

/// Pairs of neighbouring views that have points in common, and the number of those with and without.
fn neighbours(mesh: &Mesh, cameras: &[Camera]) -> (Vec<Pair>, usize) {
    let [low, high] = mesh.bounding_box().unwrap_or_default().map(|p| DVec3::from_array(p.map(f64::from)));
    let (middle, size) = (0.5 * (low + high), (high - low).length());
    let towards: Vec<DVec3> =
        cameras.iter().map(|camera| (DVec3::from_array(camera.centre()) - middle).normalize_or_zero()).collect();
    let mut wanted: Vec<[usize; 2]> = Vec::new();
    for i in 0..cameras.len() {
        let mut near: Vec<(f64, usize)> = (0..cameras.len())
            .filter(|&j| j != i)
            .map(|j| (towards[i].angle_between(towards[j]).to_degrees(), j))
            .filter(|(angle, _)| (NEIGHBOUR_DEG.0..=NEIGHBOUR_DEG.1).contains(angle))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        wanted.extend(near.into_iter().take(NEIGHBOURS).map(|(_, j)| [i.min(j), i.max(j)]));
    }
    wanted.sort_unstable();
    wanted.dedup();
    let seen = parallel::map(cameras.len(), |k| {
        let used = wanted.iter().any(|pair| pair.contains(&k));
        (used && check_work(mesh, &cameras[k]).is_ok()).then(|| Seen::new(rasterise(mesh, &cameras[k])))
    });
    let found = parallel::map(wanted.len(), |k| {
        let [i, j] = wanted[k];
        let (from, to) = (seen[i].as_ref()?, seen[j].as_ref()?);
        let points = common_points((&cameras[i], from), (&cameras[j], to), DEPTH_TOLERANCE * size);
        (points.len() >= MIN_POINTS).then_some(Pair { views: wanted[k], points })
    });
    (found.into_iter().flatten().collect(), wanted.len())
}

/// What a view sees of the mesh.
struct Seen {
    raster: Raster,
    /// Pixels that show the mesh with all around them, as far as their contrast reaches.
    interior: Vec<bool>,
}

impl Seen {
    fn new(raster: Raster) -> Self {
        let (width, height) = (raster.width, raster.height);
        let around = |at: usize| [at - RADIUS, at, at + RADIUS];
        let interior = (0..width * height).map(|index| {
            let (x, y) = (index % width, index / width);
            let inside = x >= RADIUS && y >= RADIUS && x + RADIUS < width && y + RADIUS < height;
            // Corners and sides of the window tell enough of a silhouette.
            inside && around(y).iter().all(|y| around(x).iter().all(|x| raster.is_covered(y * width + x)))
        });
        Seen { interior: interior.collect(), raster }
    }
}

/// Points that two views see, evenly spread over the first view's picture.
fn common_points(from: (&Camera, &Seen), to: (&Camera, &Seen), tolerance: f64) -> Vec<[[f32; 2]; 2]> {
    let ((camera, seen), (other, shown)) = (from, to);
    let centre = DVec3::from_array(camera.centre());
    let inside: Vec<usize> = (0..seen.interior.len()).filter(|&index| seen.interior[index]).collect();
    let step = (inside.len() / (4 * MAX_POINTS)).max(1);
    let width = seen.raster.width;
    let mut points = Vec::new();
    for &index in inside.iter().step_by(step) {
        let at = [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5];
        let point = centre + seen.raster.depth[index] * DVec3::from_array(camera.ray(at));
        let Some((there, depth)) = other.project(point.to_array()) else { continue };
        let [x, y] = there;
        if !(x >= 0.0 && y >= 0.0 && x < f64::from(other.width) && y < f64::from(other.height)) {
            continue;
        }
        let nearest = y as usize * shown.raster.width + x as usize;
        if shown.interior[nearest] && (shown.raster.depth[nearest] - depth).abs() < tolerance {
            points.push([at, there].map(|position| position.map(|v| v as f32)));
        }
    }
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    points.into_iter().step_by(step).collect()
}

/// Correlations of all photographs in the first view's place with all in the second's.
fn correlations(pair: &Pair, cameras: &[Camera], contrasts: &[&Contrast]) -> Vec<f32> {
    let values = |side: usize| -> Vec<Option<Vec<f32>>> {
        let camera = &cameras[pair.views[side]];
        let size = (camera.width as usize, camera.height as usize);
        let gathered = |contrast: &&Contrast| {
            ((contrast.width, contrast.height) == size).then(|| gather(contrast, pair.points.iter().map(|p| p[side])))
        };
        contrasts.iter().map(gathered).collect()
    };
    let (first, second) = (values(0), values(1));
    let one = |a: &Option<Vec<f32>>, b: &Option<Vec<f32>>| match (a, b) {
        (Some(a), Some(b)) => dot(a, b),
        _ => f32::NAN,
    };
    first.iter().flat_map(|a| second.iter().map(|b| one(a, b))).collect()
}

/// Contrasts at some positions, of unit length together.
fn gather(contrast: &Contrast, positions: impl Iterator<Item = [f32; 2]>) -> Vec<f32> {
    let at = |[x, y]: [f32; 2]| {
        let [x, y] = [(x - 0.5).max(0.0), (y - 0.5).max(0.0)];
        let (left, top) = ((x as usize).min(contrast.width - 1), (y as usize).min(contrast.height - 1));
        let (right, bottom) = ((left + 1).min(contrast.width - 1), (top + 1).min(contrast.height - 1));
        let [above, below] = [top, bottom].map(|y| {
            let (a, b) = (contrast.value_at(left, y), contrast.value_at(right, y));
            a + (x - left as f32) * (b - a)
        });
        above + (y - top as f32) * (below - above)
    };
    let mut values: Vec<f32> = positions.map(at).collect();
    let length = dot(&values, &values).sqrt();
    if length > 0.0 {
        values.iter_mut().for_each(|value| *value /= length);
    }
    values
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 8];
    let ((a8, a1), (b8, b1)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a8.iter().zip(b8) {
        (0..8).for_each(|k| sums[k] += a[k] * b[k]);
    }
    sums.iter().sum::<f32>() + a1.iter().zip(b1).map(|(a, b)| a * b).sum::<f32>()
}
