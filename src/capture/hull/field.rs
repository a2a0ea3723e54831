//! The field whose zero is the hull's surface, its bounds and its grid.

use super::silhouette::Silhouette;
use crate::error::{Error, Result};
use crate::parallel;
use glam::{DMat3, DVec3};
use std::path::Path;

/// Bound of the field's slope. Distances to an edge in an image change by no more than a point moves across the view; oblique rays and depth add
/// to it.
const SLOPE: f64 = 2.0;
/// Parts of the box along a side while it is narrowed.
const PARTS: usize = 32;
/// Narrowings of the box, and enlargements before, at most.
const ROUNDS: usize = 6;

/// A box of the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Bounds {
    pub(super) fn longest(&self) -> f64 {
        (self.high - self.low).max_element()
    }
    fn centre(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }
}

/// The least of the views' distances at a point, exact above `floor`; what is below `floor` is only known to be.
pub(super) fn value(views: &[Silhouette], point: DVec3, floor: f64) -> f64 {
    let mut least = f64::INFINITY;
    for view in views {
        least = least.min(view.distance(point.to_array()));
        if least < floor {
            break;
        }
    }
    least
}

/// Returns whether the hull may have a part, or `Some(true)` if all, of a ball; `None` if it has none of it.
pub(super) fn meets(views: &[Silhouette], centre: DVec3, radius: f64) -> Option<bool> {
    let reach = SLOPE * radius;
    let value = value(views, centre, -reach);
    (value >= -reach).then_some(value > reach)
}

/// Side of a photograph's pixel at the middle of the box, in the world's unit: the median of the views.
pub(super) fn pixel(bounds: &Bounds, views: &[Silhouette]) -> f64 {
    let mut sides: Vec<f64> =
        views.iter().map(|view| depth(view, bounds.centre()) / (view.camera.focal[0] * view.reduction)).collect();
    sides.sort_by(f64::total_cmp);
    sides[sides.len() / 2].max(f64::MIN_POSITIVE)
}

fn depth(view: &Silhouette, point: DVec3) -> f64 {
    view.camera.to_camera(point.to_array())[2].abs()
}

/// The box of the hull: around where the rays through the silhouettes' middles meet, enlarged until the hull ends in it, then narrowed.
pub(super) fn bounds(path: &Path, views: &[Silhouette]) -> Result<Bounds> {
    let middle = |view: &Silhouette| std::array::from_fn(|k| 0.5 * (view.extent[0][k] + view.extent[1][k]));
    let (mut sum, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let ray = DVec3::from_array(view.camera.ray(middle(view))).normalize();
        let across = DMat3::IDENTITY - DMat3::from_cols(ray * ray.x, ray * ray.y, ray * ray.z);
        sum += across;
        right += across * DVec3::from_array(view.camera.centre());
    }
    let unbounded = || {
        Error::input(
            path,
            "the silhouettes do not bound the object: photographs from more sides, with masks, are needed",
        )
    };
    // Rays side by side meet nowhere.
    if sum.determinant() < 1e-9 * (views.len() as f64).powi(3) {
        return Err(unbounded());
    }
    let centre = sum.inverse() * right;
    let size = |view: &Silhouette| {
        let extent: [f64; 2] = std::array::from_fn(|k| (view.extent[1][k] - view.extent[0][k]) / view.camera.focal[k]);
        0.5 * extent[0].hypot(extent[1]) * depth(view, centre)
    };
    let half = views.iter().map(size).fold(0.0, f64::max);
    if !(half.is_finite() && half > 0.0 && centre.is_finite()) {
        return Err(unbounded());
    }
    let mut bounds = Bounds { low: centre - DVec3::splat(half), high: centre + DVec3::splat(half) };
    let nothing = || {
        let message = "no point is in all silhouettes: are the masks inverted (then set option `invert_masks`), or the cameras' poses not those of \
                       the photographs?";
        Error::input(path, message)
    };
    let mut ends = false;
    for _ in 0..ROUNDS {
        let (narrow, touches) = narrowed(&bounds, views).ok_or_else(nothing)?;
        if !touches {
            (ends, bounds) = (true, narrow);
            break;
        }
        let more = 0.5 * (bounds.high - bounds.low);
        bounds = Bounds { low: bounds.low - more, high: bounds.high + more };
    }
    if !ends {
        return Err(unbounded());
    }
    for _ in 0..ROUNDS {
        let (narrow, _) = narrowed(&bounds, views).ok_or_else(nothing)?;
        let gain = narrow.longest() / bounds.longest();
        bounds = narrow;
        if gain > 0.95 {
            break;
        }
    }
    Ok(bounds)
}

/// The box of those parts of a box in which the hull may be, and whether some of them lie at its sides.
fn narrowed(bounds: &Bounds, views: &[Silhouette]) -> Option<(Bounds, bool)> {
    let side = (bounds.high - bounds.low) / PARTS as f64;
    let layers = parallel::map(PARTS, |z| {
        let mut found: Option<([usize; 3], [usize; 3])> = None;
        for (x, y) in (0..PARTS * PARTS).map(|k| (k % PARTS, k / PARTS)) {
            let centre = bounds.low + side * DVec3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5);
            if meets(views, centre, 0.5 * side.length()).is_some() {
                let (low, high) = found.unwrap_or(([x, y, z], [x, y, z]));
                found = Some((
                    [low[0].min(x), low[1].min(y), low[2].min(z)],
                    [high[0].max(x), high[1].max(y), high[2].max(z)],
                ));
            }
        }
        found
    });
    let (low, high) = layers
        .into_iter()
        .flatten()
        .reduce(|(a, b), (c, d)| (std::array::from_fn(|k| a[k].min(c[k])), std::array::from_fn(|k| b[k].max(d[k]))))?;
    let touches = low.contains(&0) || high.contains(&(PARTS - 1));
    let at = |index: [usize; 3], more: f64| bounds.low + side * DVec3::from_array(index.map(|k| k as f64 + more));
    Some((Bounds { low: at(low, 0.0), high: at(high, 1.0) }, touches))
}

/// A grid of cubic cells around the hull.
pub(super) struct FieldGrid {
    origin: DVec3,
    /// Side of a cell.
    pub(super) cell: f64,
    /// Cells along x, y and z.
    pub(super) cells: [usize; 3],
}

impl FieldGrid {
    /// A grid of so many cells along the longest side, and one more all around.
    pub(super) fn new(bounds: &Bounds, resolution: u32) -> Self {
        let cell = bounds.longest() / f64::from(resolution);
        let sides = (bounds.high - bounds.low) / cell;
        let cells = sides.to_array().map(|side| side.ceil() as usize + 2);
        FieldGrid { origin: bounds.low - DVec3::splat(cell), cell, cells }
    }

    pub(super) fn corner(&self, at: [usize; 3]) -> DVec3 {
        self.origin + self.cell * DVec3::from_array(at.map(|k| k as f64))
    }

    /// The field at a corner of a cell, in cells, from -2 to 2. The grid's own sides are outside.
    pub(super) fn value(&self, views: &[Silhouette], at: [usize; 3]) -> f64 {
        let at_side = (0..3).any(|k| at[k] == 0 || at[k] == self.cells[k]);
        let value = value(views, self.corner(at), -2.0 * self.cell) / self.cell;
        let value = value.clamp(-2.0, 2.0);
        // No corner is on the surface, so that no triangle is without area.
        let value = if value.abs() < 1e-6 { 1e-6 } else { value };
        if at_side { value.min(-1e-3) } else { value }
    }
}
